#include <rubato/report/csv.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <set>
#include <string>

#include <fmt/format.h>

#include <rubato/record/run_shape.hpp>
#include <rubato/report/contents.hpp>
#include <rubato/report/output_file.hpp>

namespace rubato::report {

namespace {

/// A name as one field of a row: in quotes where it would not be one otherwise.
std::string csv_field(const std::string& name) {
  if (name.find_first_of(",\"\n\r") == std::string::npos) {
    return name;
  }
  std::string text = R"(")";
  for (const char c : name) {
    text += c;
    if (c == '"') {
      text += c;
    }
  }
  return text + '"';
}

std::string in_lower_case(std::string text) {
  std::ranges::transform(text, text.begin(),
                         [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; });
  return text;
}

/// A dataset with one or more columns, as part of a table.
struct TableSource {
  std::string path;
  std::vector<std::string> names;
};

/// The sign of a value that is not a number means nothing, and would be written.
double unsigned_if_undefined(double value) {
  return std::isnan(value) ? std::abs(value) : value;
}

class Exporter {
public:
  Exporter(const record::Reader& reader, std::filesystem::path folder, bool overwrite)
      : reader_(reader), folder_(std::move(folder)), overwrite_(overwrite) {
    std::error_code error;
    std::filesystem::create_directories(folder_, error);
    if (error) {
      throw record::Error(folder_, error.message());
    }
  }

  /// What the rows of a table are numbered by, in its first column.
  struct Numbers {
    std::string name;
    std::vector<std::int64_t> values;
  };

  /// Datasets with equally many rows, side by side.
  void table(const std::string& name, const Numbers& numbers, const std::vector<TableSource>& sources) {
    OutputFile file(path_of(name), overwrite_);
    std::string text = numbers.name;
    for (const TableSource& source : sources) {
      for (const std::string& column : source.names) {
        text += text.empty() ? "" : ",";
        text += csv_field(column);
      }
    }
    text += '\n';
    constexpr std::size_t slab = 8192;
    const std::size_t rows = reader_.rows(sources.front().path);
    for (std::size_t first = 0; first < rows; first += slab) {
      const std::size_t count = std::min(slab, rows - first);
      std::vector<std::vector<double>> values;
      values.reserve(sources.size());
      for (const TableSource& source : sources) {
        values.push_back(reader_.read(source.path, first, count));
      }
      for (std::size_t row = 0; row < count; ++row) {
        bool is_first = numbers.name.empty();
        if (!is_first) {
          text += fmt::format("{}", numbers.values.at(first + row));
        }
        for (std::size_t i = 0; i < sources.size(); ++i) {
          const std::size_t width = sources[i].names.size();
          for (std::size_t column = 0; column < width; ++column) {
            text += is_first ? "" : ",";
            fmt::format_to(std::back_inserter(text), "{}", unsigned_if_undefined(values[i][row * width + column]));
            is_first = false;
          }
        }
        text += '\n';
      }
      file.write(text);
      text.clear();
    }
    file.write(text);
    finish(file);
  }

  /// A grid function over all stored levels, or at other times.
  void field(const std::string& name, const std::string& path, const std::string& times = "/states/t") {
    OutputFile file(path_of(name), overwrite_);
    const record::DatasetInfo info = reader_.info(path);
    std::vector<std::vector<double>> axes;
    for (std::size_t i = 1; i < info.dimensions.size(); ++i) {
      axes.push_back(reader_.read("/grid/" + info.dimensions[i]));
    }
    std::size_t inner = info.row_size();
    for (std::size_t axis = 0; axis < axes.size(); ++axis) {
      inner /= axes[axis].size();
      std::string text = info.dimensions[axis + 1];
      for (std::size_t i = 0; i < info.row_size(); ++i) {
        fmt::format_to(std::back_inserter(text), ",{}", axes[axis][i / inner % axes[axis].size()]);
      }
      file.write(text + '\n');
    }
    const std::vector<double> t = reader_.read(times);
    for (std::size_t level = 0; level < t.size(); ++level) {
      std::string text = fmt::format("{}", t[level]);
      for (const double value : reader_.read(path, level, 1)) {
        fmt::format_to(std::back_inserter(text), ",{}", unsigned_if_undefined(value));
      }
      file.write(text + '\n');
    }
    finish(file);
  }

  [[nodiscard]] std::vector<std::filesystem::path> files() && { return std::move(files_); }

private:
  void finish(OutputFile& file) {
    file.finish();
    files_.push_back(path_);
  }

  /// Of the next file: names that differ by case alone are one on some file systems, so that all but the first of them
  /// have a number.
  const std::filesystem::path& path_of(const std::string& name) {
    const std::size_t dot = name.rfind('.');
    std::string unique = name;
    for (int i = 2; !taken_.insert(in_lower_case(unique)).second; ++i) {
      unique = fmt::format("{}_{}{}", name.substr(0, dot), i, name.substr(dot));
    }
    path_ = folder_ / unique;
    return path_;
  }

  const record::Reader& reader_;
  std::filesystem::path folder_;
  bool overwrite_;
  std::filesystem::path path_;  ///< of the file that is written
  std::set<std::string> taken_;
  std::vector<std::filesystem::path> files_;
};

void export_levels(Exporter& exporter, const record::Reader& reader, const Contents& contents) {
  std::vector<TableSource> levels{
      {"/levels/t", {"t"}}, {"/levels/gamma", {"gamma"}}, {"/levels/node_energy", {"node_energy"}}};
  if (const std::string physical(figures::level_times); reader.has(physical)) {
    levels.insert(levels.begin() + 1, {physical, {"time"}});
  }
  for (const std::string& name : contents.invariants) {
    levels.push_back({"/laws/" + name, {name}});
  }
  for (const std::string& name : contents.totals) {
    levels.push_back({"/laws/totals/" + name, {"total_" + name}});
  }
  // A step has the number of the level that it begins at.
  const std::vector<std::int64_t> of_steps = reader.read_integers("/levels/step");
  std::vector<std::int64_t> of_levels = {0};
  std::ranges::transform(of_steps, std::back_inserter(of_levels), [](std::int64_t step) { return step + 1; });
  exporter.table("levels.csv", {"level", std::move(of_levels)}, levels);

  std::vector<TableSource> steps;
  for (const char* name : {"h", "energy", "iterations"}) {
    steps.push_back({std::string("/levels/") + name, {name}});
  }
  steps.push_back({record::off_law_path(reader), {"off_law"}});
  steps.push_back({"/levels/step_condition", {"step_condition"}});
  for (const std::string& name : contents.residuals) {
    for (const char* suffix : {"_max", "_rms"}) {
      steps.push_back({"/laws/" + name + suffix, {name + suffix}});
    }
  }
  exporter.table("steps.csv", {"step", of_steps}, steps);
}

void export_states(Exporter& exporter, const Contents& contents) {
  std::vector<TableSource> states{{"/states/level", {"level"}},
                                  {"/states/t", {"t"}},
                                  {"/states/q", contents.coordinates},
                                  {"/states/p", contents.momenta}};
  if (!contents.velocities.empty()) {
    states.push_back({"/states/q_dot", contents.velocities});
  }
  for (const std::string& name : contents.exact) {
    states.push_back({"/exact/" + name, {"exact_" + name}});
  }
  exporter.table("states.csv", {}, states);
}

/// What an ensemble reports on each member: all that is one number, and the last states of orbits.
void export_members(Exporter& exporter, const record::Reader& reader) {
  const std::string group = "/members/", last = group + "last/";
  std::vector<TableSource> members{{group + "number", {"member"}}};
  for (const record::DatasetInfo& info : reader.datasets()) {
    if (!info.path.starts_with(group) || info.path.ends_with("/number") || !info.grows || info.is_text) {
      continue;
    }
    const std::string name = info.path.substr(group.size());
    if (info.shape.size() == 1) {
      members.push_back({info.path, {name}});
    } else if (info.path == last + "q" || info.path == last + "p") {
      members.push_back(
          {info.path, reader.read_strings(info.path.ends_with('q') ? "/states/coordinate" : "/states/momentum")});
    }
  }
  exporter.table("members.csv", {}, members);
}

/// What is reported at output times.
void export_output(Exporter& exporter, const record::Reader& reader, const Contents& contents) {
  const std::string times = "/output/t";
  if (!reader.has(times)) {
    return;
  }
  std::vector<TableSource> numbers{{times, {"t"}}};
  if (reader.has("/output/q") && contents.kind == Contents::Kind::orbit) {
    numbers.push_back({"/output/q", contents.coordinates});
    numbers.push_back({"/output/p", contents.momenta});
  }
  for (const record::DatasetInfo& info : reader.datasets()) {
    if (!info.path.starts_with("/output/") || !info.grows || info.path.ends_with("/t")) {
      continue;
    }
    const std::string name = info.path.substr(info.path.rfind('/') + 1);
    const bool is_quantity = info.path.starts_with("/output/quantities/");
    if (is_quantity && info.shape.size() == 1) {
      numbers.push_back({info.path, {name}});
    } else if (contents.kind == Contents::Kind::lattice) {
      exporter.field((is_quantity ? "output_quantity_" : "output_") + name + ".csv", info.path, times);
    }
  }
  exporter.table("output.csv", {}, numbers);
}

/// What an ensemble shows at output times, all members one after the other: orbits, and quantities that are numbers.
void export_member_outputs(Exporter& exporter, const record::Reader& reader) {
  const std::string group = "/output/";
  if (!reader.has(group + "member")) {
    return;
  }
  std::vector<TableSource> columns{{group + "member", {"member"}}, {group + "t", {"t"}}};
  for (const auto& [path, names] : {std::pair("q", "/states/coordinate"), std::pair("p", "/states/momentum")}) {
    if (reader.has(group + path) && reader.has(names)) {
      columns.push_back({group + path, reader.read_strings(names)});
    }
  }
  for (const record::DatasetInfo& info : reader.datasets()) {
    if (info.path.starts_with(group + "quantities/") && info.grows && info.shape.size() == 1 &&
        !info.path.ends_with("/t")) {
      columns.push_back({info.path, {info.path.substr(info.path.rfind('/') + 1)}});
    }
  }
  exporter.table("output.csv", {}, columns);
}

/// The crossings of each event; in an ensemble of each member.
void export_events(Exporter& exporter, const record::Reader& reader) {
  constexpr std::string_view events = "/events/", times = "/t";
  for (const record::DatasetInfo& axis : reader.datasets()) {
    if (!axis.path.starts_with(events) || !axis.path.ends_with(times)) {
      continue;
    }
    const std::string group = axis.path.substr(0, axis.path.size() - times.size());
    std::vector<TableSource> columns;
    const auto add = [&](const std::string& name, const std::string& names = "") {
      if (reader.has(group + "/" + name)) {
        columns.push_back(
            {group + "/" + name, names.empty() ? std::vector<std::string>{name} : reader.read_strings(names)});
      }
    };
    add("member");
    add("t");
    add("direction");
    add("stops");
    add("q", "/states/coordinate");
    add("p", "/states/momentum");
    add("quantities", group + "/quantity");
    exporter.table("events_" + group.substr(events.size()) + ".csv", {}, columns);
  }
}

}  // namespace

std::vector<std::filesystem::path> export_csv(const record::Reader& reader, const std::filesystem::path& folder,
                                              bool overwrite) {
  if (reader.has("/members/number")) {
    Exporter exporter(reader, folder, overwrite);
    export_members(exporter, reader);
    export_member_outputs(exporter, reader);
    export_events(exporter, reader);
    return std::move(exporter).files();
  }
  const Contents contents = contents_of(reader);
  Exporter exporter(reader, folder, overwrite);
  export_levels(exporter, reader, contents);
  export_events(exporter, reader);
  if (contents.kind == Contents::Kind::orbit) {
    export_states(exporter, contents);
    export_output(exporter, reader, contents);
    return std::move(exporter).files();
  }
  for (const Contents::Field& field : contents.fields) {
    exporter.field("field_" + field.name + ".csv", field.path);
  }
  for (const std::string& name : contents.exact) {
    exporter.field("exact_" + name + ".csv", "/exact/" + name);
  }
  for (const std::string& name : contents.residual_fields) {
    exporter.field("residual_" + name + ".csv", "/laws/fields/" + name);
  }
  export_output(exporter, reader, contents);
  return std::move(exporter).files();
}

}  // namespace rubato::report
