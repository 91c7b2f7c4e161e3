#include <rubato/report/page.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <iterator>
#include <limits>
#include <stdexcept>
#include <tuple>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/figures/text.hpp>
#include <rubato/report/assets.hpp>
#include <rubato/report/comparison.hpp>
#include <rubato/report/ensemble_page.hpp>
#include <rubato/report/output_file.hpp>
#include <rubato/report/page_data.hpp>

namespace rubato::report {

namespace {

/// In the order in which they are run: each uses only those before it.
constexpr std::array scripts{"theme.js",   "unpack.js",  "format.js",   "colour.js",   "curve.js",      "plane.js",
                             "map.js",     "profile.js", "player.js",   "portrait.js", "cards.js",      "tables.js",
                             "section.js", "orbit.js",   "ensemble.js", "lattice.js",  "comparison.js", "main.js"};

/// What write_page() recognises its own pages by, near their beginning.
constexpr std::string_view mark = R"(<meta name="generator" content="Rubato">)";

std::string replace_once(std::string text, std::string_view place, std::string_view content) {
  return text.replace(text.find(place), place.size(), content);
}

std::string assemble(std::string_view title, const std::string& data) {
  std::string script(asset("uPlot.iife.min.js"));
  for (const char* name : scripts) {
    script += fmt::format("\n// {}\n{}", name, asset(name));
  }
  std::string page(asset("page.html"));
  // From the last place to the first, so that what is put in is not searched for places.
  page = replace_once(std::move(page), "{{data}}", data);
  page = replace_once(std::move(page), "{{script}}", script);
  page = replace_once(std::move(page), "{{style}}", fmt::format("{}\n{}", asset("uPlot.min.css"), asset("page.css")));
  page = replace_once(std::move(page), "{{licence}}", asset("LICENSE"));
  return replace_once(std::move(page), "{{title}}", escape_html(title));
}

/// Everything that a page shows of one record.
class Part {
public:
  Part(const record::Reader& reader, const PageOptions& options)
      : reader_(reader),
        notes_(options.notes ? options.notes(reader) : Notes()),
        contents_(drawn(contents_of(reader), notes_, options.field)),
        summary_(summarise(reader, contents_)),
        needs_(reader, contents_) {
    std::ranges::stable_sort(contents_.fields, {}, [&](const Contents::Field& field) {
      return std::tuple(field.name != options.field,
                        std::ranges::find(notes_.fields, field.name) - notes_.fields.begin(), !has_exact(field.name),
                        field.at_midpoints);
    });
  }

  [[nodiscard]] const Needs& needs() const { return needs_; }

  void write_kind(Json& json) const {
    json.entry("kind", contents_.kind == Contents::Kind::orbit ? "orbit" : "lattice");
    write_description(json, {reader_, contents_, summary_, notes_});
  }
  void write_figures(Json& json, std::span<const std::size_t> shares) const {
    const Source source{reader_, contents_, summary_, notes_};
    const Resolution resolution = shares.empty() ? Resolution() : needs_.resolution(shares);
    write_curves(json, source, resolution);
    write_off_law(json, reader_, resolution);
    write_sections(json, source, resolution);
    if (contents_.kind == Contents::Kind::orbit) {
      write_states(json, source, resolution);
    } else {
      write_maps(json, source, resolution);
    }
  }

private:
  /// Without auxiliary fields, but for the one that is asked for.
  static Contents drawn(Contents contents, const Notes& notes, const std::string& asked) {
    if (!asked.empty() && std::ranges::find(contents.fields, asked, &Contents::Field::name) == contents.fields.end()) {
      std::vector<std::string> names;
      std::ranges::transform(contents.fields, std::back_inserter(names), &Contents::Field::name);
      throw std::invalid_argument(
          fmt::format("--field {}: the record has no such field; {}", asked,
                      names.empty() ? "it is not of a lattice" : fmt::format("it has {}", fmt::join(names, ", "))));
    }
    std::erase_if(contents.fields, [&](const Contents::Field& field) {
      return field.name != asked && std::ranges::find(notes.auxiliary, field.name) != notes.auxiliary.end();
    });
    return contents;
  }
  [[nodiscard]] bool has_exact(const std::string& name) const {
    return std::ranges::find(contents_.exact, name) != contents_.exact.end();
  }

  const record::Reader& reader_;
  Notes notes_;
  Contents contents_;
  figures::Statistics summary_;
  Needs needs_;
};

[[noreturn]] void refuse_size(std::size_t most, std::size_t least, std::string_view who) {
  throw std::invalid_argument(fmt::format("a page of {} MB is too small: {} least {:.2f} MB",
                                          static_cast<double>(most) / 1e6, who,
                                          std::ceil(static_cast<double>(least) / 1e4) / 1e2));
}

/// Shares the bytes of a page among the figures of its parts; nothing for a page in full. `text` is what the page has
/// besides.
std::vector<std::vector<std::size_t>> shares_for(const std::vector<Part>& parts, std::size_t text,
                                                 const PageOptions& options) {
  std::vector<std::vector<std::size_t>> shares(parts.size());
  if (options.full) {
    return shares;
  }
  std::vector<Demand> demands;
  std::size_t least = text;
  for (const Part& part : parts) {
    for (const Demand& demand : part.needs().demands()) {
      demands.push_back(demand);
      least += demand.least;
    }
  }
  if (least > options.max_bytes) {
    refuse_size(options.max_bytes, least, parts.size() == 1 ? "this record needs at" : "these records need at");
  }
  const std::vector<std::size_t> all = share(options.max_bytes - text, demands);
  auto next = all.begin();
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const auto count = static_cast<std::ptrdiff_t>(parts[i].needs().demands().size());
    shares[i].assign(next, next + count);
    next += count;
  }
  return shares;
}

/// The page whose data begin with what `begin` writes; then comes what is said and drawn of each part, by `write_part`.
/// Written twice: without figures, which shows how long its text is, and with them.
template <typename Write>
std::string assemble_within(std::string_view title, const std::vector<Part>& parts, const PageOptions& options,
                            const Write& write) {
  std::vector<std::vector<std::size_t>> shares;
  const auto data = [&](bool with_figures) {
    Json json;
    write(json, [&](std::size_t part) {
      parts[part].write_kind(json);
      if (with_figures) {
        parts[part].write_figures(json, shares[part]);
      }
    });
    return json.text();
  };
  shares = shares_for(parts, assemble(title, data(false)).size(), options);
  std::string page = assemble(title, data(true));
  if (!options.full && page.size() > options.max_bytes) {
    throw std::logic_error(
        fmt::format("report: a page of {} bytes where {} were to suffice", page.size(), options.max_bytes));
  }
  return page;
}

/// The page of an ensemble: all arrays have as many numbers at most, which are halved until the page fits.
std::string ensemble_page(const record::Reader& reader, const PageOptions& options) {
  constexpr std::size_t least_rows = 16, bytes_of_row = 6;
  const auto with = [&](std::size_t most_rows) {
    Json json;
    json.begin_object().entry("kind", "ensemble");
    write_provenance(json, reader);
    write_ensemble_summary(json, reader);
    write_ensemble(json, reader, most_rows);
    json.end_object();
    return assemble(reader.header().title, json.text());
  };
  if (options.full) {
    return with(std::numeric_limits<std::size_t>::max());
  }
  std::string page = with(least_rows);
  if (page.size() > options.max_bytes) {
    refuse_size(options.max_bytes, page.size(), "this record needs at");
  }
  const std::size_t columns = std::max<std::size_t>(count_ensemble_columns(reader), 1);
  // As if all columns were as long; where some are shorter, the others get what these leave.
  for (std::size_t rows = options.max_bytes / bytes_of_row; rows > least_rows; rows -= rows / 4) {
    if (rows > 16 * (options.max_bytes / columns)) {
      continue;
    }
    std::string larger = with(rows);
    if (larger.size() <= options.max_bytes) {
      return larger;
    }
  }
  return page;
}

}  // namespace

std::string_view asset(std::string_view name) {
  const auto all = assets();
  const auto found = std::ranges::find(all, name, &Asset::name);
  if (found == all.end()) {
    throw std::logic_error(fmt::format("report: there is no asset '{}'", name));
  }
  return found->text;
}

void write_provenance(Json& json, const record::Reader& reader) {
  const record::Header& header = reader.header();
  json.entry("title", header.title).entry("problem", header.problem);
  json.key("provenance").begin_object();
  json.entry("record", reader.file().filename().string()).entry("format", header.format);
  json.entry("version", header.version).entry("compiler", header.compiler);
  json.entry("threads", static_cast<std::size_t>(header.threads)).entry("finished", header.finished).end_object();
}

void write_description(Json& json, const Source& source) {
  write_provenance(json, source.reader);
  json.key("summary").begin_array();
  for (const figures::Line& line : figures::lines_of(source.summary)) {
    json.begin_array().value(line.label).value(line.value).value(line.remark).value(line.is_headline).end_array();
  }
  json.end_array();
}

std::string page(const record::Reader& reader, const PageOptions& options) {
  if (is_ensemble(reader)) {
    return ensemble_page(reader, options);
  }
  std::vector<Part> parts;
  parts.emplace_back(reader, options);
  return assemble_within(reader.header().title, parts, options, [](Json& json, const auto& write_part) {
    json.begin_object();
    write_part(0);
    json.end_object();
  });
}

std::string comparison_page(const record::Reader& a, const record::Reader& b, const PageOptions& options,
                            const Canonical& canonical) {
  const Comparison comparison = compare(a, b, canonical);
  std::vector<Part> parts;
  parts.emplace_back(a, options);
  parts.emplace_back(b, options);
  const std::string title = fmt::format("{} and {}", a.file().filename().string(), b.file().filename().string());
  return assemble_within(title, parts, options, [&](Json& json, const auto& write_part) {
    json.begin_object().entry("kind", "comparison").key("lines").begin_array();
    for (const auto& line : comparison.lines) {
      json.begin_array().value(line[0]).value(line[1]).value(line[2]).end_array();
    }
    json.end_array().key("only_in").begin_array();
    for (const auto& lines : comparison.only_in) {
      json.begin_array();
      for (const std::string& line : lines) {
        json.value(line);
      }
      json.end_array();
    }
    json.end_array().key("records").begin_array();
    for (const std::size_t part : {0, 1}) {
      json.begin_object();
      write_part(part);
      json.end_object();
    }
    json.end_array().end_object();
  });
}

void write_page(const std::filesystem::path& file, const std::string& text, bool overwrite) {
  bool may_replace = overwrite;
  if (!overwrite && std::filesystem::is_regular_file(file)) {
    std::string beginning(1000, '\0');
    std::ifstream(file).read(beginning.data(), static_cast<std::streamsize>(beginning.size()));
    may_replace = beginning.find(mark) != std::string::npos;
  }
  OutputFile output(file, may_replace);
  output.write(text);
  output.finish();
}

}  // namespace rubato::report
