#include <algorithm>
#include <map>

#include <fmt/format.h>

#include <rubato/record/error.hpp>
#include <rubato/report/page_data.hpp>

namespace rubato::report {

namespace {

constexpr std::size_t most_coordinates = 48;

/// The datasets of an orbit's states, each read once.
class States {
public:
  explicit States(const record::Reader& reader) : t_(state_times(reader)), reader_(reader) {}

  [[nodiscard]] const std::vector<double>& t() const { return t_; }
  [[nodiscard]] const double* column(const StateColumn& column) { return dataset(column).data() + column.offset; }
  [[nodiscard]] std::size_t stride(const StateColumn& column) { return dataset(column).size() / t_.size(); }

private:
  const std::vector<double>& dataset(const StateColumn& column) {
    const auto found = datasets_.find(column.path);
    return found != datasets_.end()
               ? found->second
               : datasets_.emplace(column.path, read_rows(reader_, column.path, t_.size(), column.offset))
                     .first->second;
  }

  std::vector<double> t_;
  const record::Reader& reader_;
  std::map<std::string, std::vector<double>> datasets_;
};

}  // namespace

std::vector<double> read_rows(const record::Reader& reader, const std::string& path, std::size_t rows,
                              std::size_t column) {
  std::vector<double> values = reader.read(path);
  if (rows == 0 || values.size() % rows != 0 || values.size() / rows <= column) {
    throw record::Error(reader.file(), fmt::format("{} has {} values, which are not {} rows with a column number {}",
                                                   path, values.size(), rows, column + 1));
  }
  return values;
}

std::vector<StateColumn> state_columns(const Contents& contents) {
  std::vector<StateColumn> columns;
  for (const auto& [names, group, path] : {std::tuple(&contents.coordinates, "q", "/states/q"),
                                           {&contents.momenta, "p", "/states/p"},
                                           {&contents.velocities, "q_dot", "/states/q_dot"}}) {
    for (std::size_t i = 0; i < std::min(names->size(), most_coordinates); ++i) {
      columns.push_back({(*names)[i], group, path, i});
    }
  }
  for (const std::string& name : contents.exact) {
    columns.push_back({name, "exact", "/exact/" + name, 0});
  }
  return columns;
}

void write_states(Json& json, const Source& source, const Resolution& resolution) {
  States states(source.reader);
  const std::vector<StateColumn> columns = state_columns(source.contents);
  const std::vector<double>& t = states.t();

  Path path{.size = t.size(), .columns = {}, .strides = {}};
  for (const StateColumn& column : columns) {
    if (column.offset >= states.stride(column)) {
      throw record::Error(source.reader.file(), fmt::format("{} has no column for {}", column.path, column.name));
    }
    if (column.group != "exact") {
      path.columns.push_back(states.column(column));
      path.strides.push_back(states.stride(column));
    }
  }
  const PathSelection selection = thin_path(path, resolution.path_states);
  const bool is_whole = selection.kept.size() == t.size();

  json.key("states").begin_object().entry("count", t.size()).entry("deviation", selection.deviation);
  json.entry("coordinates", source.contents.coordinates.size());
  json.key("starts").begin_array();
  for (const std::size_t start : selection.starts) {
    json.value(start);
  }
  json.end_array().key("t");
  write_f64(json, pick(t, selection.kept));
  json.key("columns").begin_array();
  for (const StateColumn& column : columns) {
    const std::span<const double> values(states.column(column), (t.size() - 1) * states.stride(column) + 1);
    const auto picked = [&](std::span<const std::size_t> kept) { return pick(values, kept, states.stride(column)); };
    json.begin_object().entry("name", column.name).entry("group", column.group).key("values");
    write_f32(json, picked(selection.kept));
    if (!is_whole) {
      std::vector<double> all;
      for (std::size_t k = 0; k < t.size(); ++k) {
        all.push_back(values[k * states.stride(column)]);
      }
      const std::vector<std::size_t> kept = envelope_within(all, resolution.column_points);
      json.key("over_time").begin_object().key("x");
      write_f64(json, pick(t, kept));
      json.key("y");
      write_f32(json, pick(all, kept));
      json.end_object();
    }
    json.end_object();
  }
  json.end_array().end_object();
}

}  // namespace rubato::report
