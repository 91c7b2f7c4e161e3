#include <algorithm>
#include <numeric>

#include <rubato/report/page_data.hpp>

namespace rubato::report {

namespace {

/// Coordinates beyond these are left to the record itself; the page says so.
constexpr std::size_t most_coordinates = 48;
/// The first states are all kept, so that a piece of the orbit can be drawn as a line.
constexpr std::size_t lead = 1500;

struct Column {
  std::string name, group;
  const std::vector<double>* rows;
  std::size_t stride, offset;
};

}  // namespace

void write_states(Json& json, const record::Reader& reader, const Contents& contents, const Resolution& resolution) {
  const std::vector<double> t = reader.read("/states/t");
  const std::vector<double> q = reader.read("/states/q");
  const std::vector<double> p = reader.read("/states/p");
  std::vector<std::vector<double>> exact;
  for (const std::string& name : contents.exact) {
    exact.push_back(reader.read("/exact/" + name));
  }
  const std::size_t n = contents.coordinates.size();
  const std::size_t shown = std::min(n, most_coordinates);
  std::vector<Column> columns;
  for (std::size_t i = 0; i < shown; ++i) {
    columns.push_back({contents.coordinates[i], "q", &q, n, i});
  }
  for (std::size_t i = 0; i < shown; ++i) {
    columns.push_back({contents.momenta[i], "p", &p, n, i});
  }
  for (std::size_t i = 0; i < exact.size(); ++i) {
    columns.push_back({contents.exact[i], "exact", &exact[i], 1, 0});
  }

  std::vector<std::size_t> kept(std::min(t.size(), lead));
  std::iota(kept.begin(), kept.end(), std::size_t{0});
  std::vector<std::size_t> every(t.size());
  std::iota(every.begin(), every.end(), std::size_t{0});
  const std::size_t buckets = std::max<std::size_t>(50, resolution.state_buckets / (2 * shown));
  if (t.size() <= 2 * resolution.state_buckets + lead) {
    kept = every;
  } else {
    for (std::size_t i = 0; i < 2 * shown; ++i) {
      const Column& column = columns[i];
      kept = merge(kept, envelope(pick(*column.rows, every, column.stride, column.offset), buckets));
    }
  }

  json.key("states").begin_object();
  json.entry("count", t.size()).entry("lead", kept.size() == t.size() ? t.size() : lead);
  json.entry("coordinates", n).entry("coordinates_shown", shown);
  json.key("t");
  write_f64(json, pick(t, kept));
  json.key("columns").begin_array();
  for (const Column& column : columns) {
    json.begin_object().entry("name", column.name).entry("group", column.group).key("values");
    write_f32(json, pick(*column.rows, kept, column.stride, column.offset));
    json.end_object();
  }
  json.end_array().end_object();
}

}  // namespace rubato::report
