#include "core.hpp"

#include <algorithm>

namespace rubato::python {

namespace {

std::string last_part(const std::string& path) {
  return path.substr(path.rfind('/') + 1);
}

/// A dataset as the package knows it: path, names of its dimensions, description, whether it holds names.
py::tuple described(const std::string& path, const std::vector<std::string>& dimensions, const std::string& description,
                    bool is_text) {
  return py::make_tuple(path, py::tuple(py::cast(dimensions)), description, is_text);
}

/// The rows that a run left in memory. Arrays that are read are views of them, and keep them.
class Memory {
public:
  explicit Memory(std::shared_ptr<MemoryRecord> rows) : rows_(std::move(rows)) {}

  [[nodiscard]] py::list datasets() const {
    py::list all;
    for (const record::Dataset& dataset : rows_->layout().datasets) {
      std::vector<std::string> dimensions = {last_part(dataset.axis)};
      std::ranges::transform(dataset.dimensions, std::back_inserter(dimensions), &last_part);
      all.append(described(dataset.path, dimensions, dataset.description, false));
    }
    for (const record::Scale& scale : rows_->layout().scales) {
      all.append(described(scale.path, {last_part(scale.path)}, scale.description, scale.values.index() == 1));
    }
    return all;
  }

  [[nodiscard]] py::object read(const std::string& path) const {
    const record::Layout& layout = rows_->layout();
    if (const auto scale = std::ranges::find(layout.scales, path, &record::Scale::path); scale != layout.scales.end()) {
      if (const auto* names = std::get_if<std::vector<std::string>>(&scale->values)) {
        return py::cast(*names);
      }
      std::vector<double> places = std::get<std::vector<double>>(scale->values);
      const std::size_t count = places.size();
      return own(std::move(places), {count});
    }
    const auto dataset = std::ranges::find(layout.datasets, path, &record::Dataset::path);
    if (dataset == layout.datasets.end()) {
      throw py::key_error(path);
    }
    const auto number = static_cast<std::size_t>(dataset - layout.datasets.begin());
    std::vector<std::size_t> shape = {0};
    for (const std::string& dimension : dataset->dimensions) {
      const auto scale = std::ranges::find(layout.scales, dimension, &record::Scale::path);
      shape.push_back(std::visit([](const auto& places) { return places.size(); }, scale->values));
    }
    return std::visit(
        [&](const auto& values) -> py::object {
          using Number = typename std::remove_cvref_t<decltype(values)>::value_type;
          shape.front() = values.size() / rows_->row_size(number);
          auto* const kept = new std::shared_ptr<MemoryRecord>(rows_);
          const py::capsule owner(kept, [](void* all) { delete static_cast<std::shared_ptr<MemoryRecord>*>(all); });
          return py::array_t<Number>(shape, values.data(), owner);
        },
        rows_->values(number));
  }

private:
  std::shared_ptr<MemoryRecord> rows_;
};

py::list datasets_of(const record::Reader& reader) {
  py::list all;
  for (const record::DatasetInfo& info : reader.datasets()) {
    all.append(described(info.path, info.dimensions, info.description, info.is_text));
  }
  return all;
}

py::object read_of(const record::Reader& reader, const std::string& path) {
  if (!reader.has(path)) {
    throw py::key_error(path);
  }
  const record::DatasetInfo info = reader.info(path);
  if (info.is_text) {
    return py::cast(reader.read_strings(path));
  }
  if (info.type != record::Type::f64) {
    return own(reader.read_integers(path), info.shape);
  }
  std::vector<double> values;
  {
    const py::gil_scoped_release released;
    values = reader.read(path);
  }
  return own(std::move(values), info.shape);
}

py::dict header_of(const record::Reader& reader) {
  const record::Header& header = reader.header();
  py::dict all;
  all["format"] = header.format;
  all["title"] = header.title;
  all["problem"] = header.problem;
  all["version"] = header.version;
  all["compiler"] = header.compiler;
  all["threads"] = header.threads;
  all["finished"] = header.finished;
  return all;
}

report::PageOptions page_options() {
  return {.notes = [](const record::Reader& reader) {
    const RecordNotes notes = notes_on(reader);
    return report::Notes{.fields = notes.fields, .auxiliary = notes.auxiliary, .rounding = notes.rounding};
  }};
}

py::tuple compare(const std::string& a, const std::string& b) {
  const record::Reader first(a), second(b);
  if (is_ensemble(first) || is_ensemble(second)) {
    const auto comparison = report::compare_ensembles(first, second);
    return py::make_tuple(report::to_json(comparison), report::to_table(comparison));
  }
  const auto comparison = report::compare(first, second);
  return py::make_tuple(report::to_json(comparison), report::to_table(comparison));
}

}  // namespace

void define_records(py::module_& module) {
  py::class_<MemoryRecord, std::shared_ptr<MemoryRecord>>(module, "Rows");
  py::class_<Memory>(module, "Memory")
      .def(py::init<std::shared_ptr<MemoryRecord>>())
      .def("datasets", &Memory::datasets)
      .def("read", &Memory::read, py::arg("path"));
  py::class_<record::Reader>(module, "Reader")
      .def(py::init([](const std::string& file) { return record::Reader(file); }), py::arg("file"))
      .def("datasets", &datasets_of)
      .def("read", &read_of, py::arg("path"))
      .def_property_readonly("header", &header_of)
      .def_property_readonly("is_ensemble", [](const record::Reader& reader) { return is_ensemble(reader); })
      .def("page", [](const record::Reader& reader) { return report::page(reader, page_options()); })
      .def("export_csv", [](const record::Reader& reader, const std::string& folder, bool overwrite) {
        std::vector<std::string> files;
        for (const auto& file : report::export_csv(reader, folder, overwrite)) {
          files.push_back(file.string());
        }
        return files;
      });
  module.def("compare", &compare, py::arg("a"), py::arg("b"));
}

}  // namespace rubato::python
