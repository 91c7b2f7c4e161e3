#include <rubato/report/page.hpp>

#include <algorithm>
#include <array>
#include <fstream>
#include <limits>
#include <stdexcept>

#include <fmt/format.h>

#include <rubato/report/assets.hpp>
#include <rubato/report/comparison.hpp>
#include <rubato/report/output_file.hpp>
#include <rubato/report/page_data.hpp>

namespace rubato::report {

namespace {

/// In the order in which they are run: each uses only those before it.
constexpr std::array scripts{"theme.js", "unpack.js",  "format.js",     "colour.js",   "curve.js", "plane.js",
                             "map.js",   "profile.js", "player.js",     "portrait.js", "cards.js", "tables.js",
                             "orbit.js", "lattice.js", "comparison.js", "main.js"};

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

std::size_t size_of_text() {
  std::size_t size = 0;
  for (const Asset& asset : assets()) {
    size += asset.text.size();
  }
  return size;
}

constexpr std::size_t curve_point_bytes = 16;  // 12 bytes, in base 64

/// Shares the bytes of a page among what it shows.
Resolution resolution_for(const PageOptions& options, const Contents& contents, std::size_t records) {
  constexpr std::size_t unlimited = std::size_t{1} << 40;
  if (options.full) {
    return {unlimited, unlimited, unlimited};
  }
  constexpr std::size_t reserve = 60'000;  // the problem, tables, names
  const std::size_t fixed = size_of_text() + reserve;
  const std::size_t room = (options.max_bytes > fixed ? options.max_bytes - fixed : 0) / records;
  const bool is_lattice = contents.kind == Contents::Kind::lattice;
  // Curves take at most a third of the room where there are maps, else half; states as much again.
  const std::size_t for_curves = room / (is_lattice ? 3 : 2);
  const std::size_t buckets =
      std::clamp<std::size_t>(for_curves / (2 * curve_point_bytes * count_curves(contents)), 20, 2000);
  Resolution resolution{.curve_buckets = buckets, .state_buckets = 0, .map_bytes = 0};
  const std::size_t used = 2 * buckets * curve_point_bytes * count_curves(contents);
  const std::size_t left = room > used ? room - used : 0;
  if (is_lattice) {
    resolution.map_bytes = left * 3 / 4;
  } else {
    const std::size_t columns = 2 * std::min<std::size_t>(contents.coordinates.size(), 48) + contents.exact.size() + 2;
    resolution.state_buckets = std::min<std::size_t>(5000, left * 3 / 4 / (8 * columns));
  }
  return resolution;
}

void write_contents(Json& json, const record::Reader& reader, const Contents& contents, const Resolution& resolution) {
  write_description(json, reader, contents);
  write_curves(json, reader, contents, resolution);
  write_bridges(json, reader);
  if (contents.kind == Contents::Kind::orbit) {
    write_states(json, reader, contents, resolution);
  } else {
    write_maps(json, reader, contents, resolution);
  }
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

void write_description(Json& json, const record::Reader& reader, const Contents& contents) {
  const record::Header& header = reader.header();
  json.entry("title", header.title).entry("problem", header.problem);
  json.key("provenance").begin_object();
  json.entry("record", reader.file().filename().string()).entry("format", header.format);
  json.entry("version", header.version).entry("compiler", header.compiler);
  json.entry("threads", static_cast<std::size_t>(header.threads)).entry("finished", header.finished).end_object();
  json.key("summary").begin_array();
  for (const Line& line : lines_of(summarise(reader, contents))) {
    json.begin_array().value(line.label).value(line.value).value(line.remark).value(line.is_headline).end_array();
  }
  json.end_array();
}

std::string page(const record::Reader& reader, const PageOptions& options) {
  const Contents contents = contents_of(reader);
  const Resolution resolution = resolution_for(options, contents, 1);
  Json json;
  json.begin_object().entry("kind", contents.kind == Contents::Kind::orbit ? "orbit" : "lattice");
  write_contents(json, reader, contents, resolution);
  json.end_object();
  return assemble(reader.header().title, json.text());
}

std::string comparison_page(const record::Reader& a, const record::Reader& b, const PageOptions& options,
                            const Canonical& canonical) {
  const Comparison comparison = compare(a, b, canonical);
  Json json;
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
  for (const record::Reader* reader : {&a, &b}) {
    const Contents contents = contents_of(*reader);
    json.begin_object().entry("kind", contents.kind == Contents::Kind::orbit ? "orbit" : "lattice");
    write_contents(json, *reader, contents, resolution_for(options, contents, 2));
    json.end_object();
  }
  json.end_array().end_object();
  return assemble(fmt::format("{} and {}", a.file().filename().string(), b.file().filename().string()), json.text());
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
