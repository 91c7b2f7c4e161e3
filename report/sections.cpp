#include <algorithm>

#include <rubato/report/page_data.hpp>

namespace rubato::report {

void write_sections(Json& json, const Source& source, const Resolution& resolution) {
  json.key("sections").begin_array();
  for (const std::string& name : source.contents.sections) {
    const std::string group = "/events/" + name;
    const std::vector<std::string> quantities = source.reader.read_strings(group + "/quantity");
    const std::size_t rows = source.reader.rows(group + "/t");
    const std::vector<double> values = source.reader.read(group + "/quantities");
    // Of more points than there is room for every n-th: where they lie is as dense as before.
    const std::size_t stride = rows == 0 ? 1 : (rows - 1) / std::min(rows, resolution.crossings) + 1;
    json.begin_object().entry("name", name).entry("count", rows).key("columns").begin_array();
    for (std::size_t column = 0; column < quantities.size(); ++column) {
      std::vector<double> picked;
      for (std::size_t row = 0; row < rows; row += stride) {
        picked.push_back(values[row * quantities.size() + column]);
      }
      json.begin_object().entry("name", quantities[column]).key("values");
      write_f32(json, picked);
      json.end_object();
    }
    json.end_array().end_object();
  }
  json.end_array();
}

}  // namespace rubato::report
