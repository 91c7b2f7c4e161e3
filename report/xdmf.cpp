#include <rubato/report/xdmf.hpp>

#include <algorithm>
#include <fstream>
#include <stdexcept>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/report/contents.hpp>
#include <rubato/report/output_file.hpp>
#include <rubato/report/packing.hpp>

namespace rubato::report {

namespace {

constexpr std::string_view first_line = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n";

struct Attribute {
  std::string name, path;
};

/// How an XDMF file names the record: relative to itself.
std::string name_of_record(const record::Reader& reader, const std::filesystem::path& file) {
  return escape_html(std::filesystem::proximate(std::filesystem::absolute(reader.file()),
                                                std::filesystem::absolute(file).parent_path())
                         .generic_string());
}

/// What stands before a dataset of the record.
std::string reference_to(const std::string& record) {
  return fmt::format("Format=\"HDF\">{}:/", record);
}

/// Whether the file was written for this record: its first reference to data, near its beginning, leads there.
bool describes(const std::filesystem::path& file, const record::Reader& reader) {
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(file, ignored)) {
    return false;  // a pipe would be waited for
  }
  constexpr std::size_t first_grid = 8192;
  std::string beginning(first_grid, '\0');
  std::ifstream stream(file, std::ios::binary);
  stream.read(beginning.data(), first_grid);
  return beginning.starts_with(first_line) &&
         beginning.find(reference_to(name_of_record(reader, file))) != std::string::npos;
}

class Xdmf {
public:
  Xdmf(const record::Reader& reader, const std::filesystem::path& file)
      : reader_(reader), reference_(reference_to(name_of_record(reader, file))) {}

  /// One grid for each of these times, all with the same nodes. Axes are slowest first, as in the record.
  void collection(const std::string& name, const std::string& times, const std::vector<std::string>& axes,
                  const std::vector<Attribute>& attributes) {
    const std::vector<double> t = reader_.read(times);
    std::vector<std::size_t> sizes;
    std::vector<double> origin, spacing;
    for (const std::string& axis : axes) {
      const std::vector<double> x = reader_.read("/grid/" + axis);
      sizes.push_back(x.size());
      origin.push_back(x.front());
      spacing.push_back(x.size() > 1 ? (x.back() - x.front()) / static_cast<double>(x.size() - 1) : 1.0);
    }
    // XDMF knows regular grids in two and three dimensions; a line is one of a single row.
    if (sizes.size() == 1) {
      sizes.insert(sizes.begin(), 1);
      origin.insert(origin.begin(), 0.0);
      spacing.insert(spacing.begin(), 1.0);
    }
    const std::string dimensions = fmt::format("{}", fmt::join(sizes, " "));
    const bool is_flat = sizes.size() == 2;
    text_ += fmt::format(R"(    <Grid Name="{}" GridType="Collection" CollectionType="Temporal">)", name) + "\n";
    for (std::size_t level = 0; level < t.size(); ++level) {
      text_ += fmt::format(R"(      <Grid Name="{0} {1}" GridType="Uniform">
        <Time Value="{2}"/>
        <Topology TopologyType="{3}" Dimensions="{4}"/>
        <Geometry GeometryType="{5}">
          <DataItem Dimensions="{6}" Format="XML">{7}</DataItem>
          <DataItem Dimensions="{6}" Format="XML">{8}</DataItem>
        </Geometry>
)",
                           name, level, t[level], is_flat ? "2DCoRectMesh" : "3DCoRectMesh", dimensions,
                           is_flat ? "ORIGIN_DXDY" : "ORIGIN_DXDYDZ", sizes.size(), fmt::join(origin, " "),
                           fmt::join(spacing, " "));
      for (const Attribute& attribute : attributes) {
        write(attribute, level, dimensions);
      }
      text_ += "      </Grid>\n";
    }
    text_ += "    </Grid>\n";
  }

  [[nodiscard]] std::string text() const {
    return fmt::format("{}<Xdmf Version=\"2.0\">\n  <Domain>\n{}  </Domain>\n</Xdmf>\n", first_line, text_);
  }

private:
  /// Row number `level` of a dataset: its first value, the strides, and how many values, along each dimension.
  void write(const Attribute& attribute, std::size_t level, const std::string& dimensions) {
    const std::vector<std::size_t> shape = reader_.info(attribute.path).shape;
    std::vector<std::size_t> start(shape.size(), 0), stride(shape.size(), 1), count = shape;
    start[0] = level;
    count[0] = 1;
    text_ += fmt::format(R"(        <Attribute Name="{0}" AttributeType="Scalar" Center="Node">
          <DataItem ItemType="HyperSlab" Dimensions="{1}">
            <DataItem Dimensions="3 {2}" Format="XML">{3} {4} {5}</DataItem>
            <DataItem Dimensions="{6}" NumberType="Float" Precision="8" {7}{8}</DataItem>
          </DataItem>
        </Attribute>
)",
                         escape_html(attribute.name), dimensions, shape.size(), fmt::join(start, " "),
                         fmt::join(stride, " "), fmt::join(count, " "), fmt::join(shape, " "), reference_,
                         escape_html(attribute.path.substr(1)));
  }

  const record::Reader& reader_;
  std::string reference_;
  std::string text_;
};

}  // namespace

void export_xdmf(const record::Reader& reader, const std::filesystem::path& file, bool overwrite) {
  const Contents contents = contents_of(reader);
  if (contents.kind != Contents::Kind::lattice) {
    throw std::invalid_argument(
        fmt::format("{}: is the record of an orbit; XDMF describes fields on a grid", reader.file().string()));
  }
  std::vector<Attribute> fields, residuals;
  for (const Contents::Field& field : contents.fields) {
    fields.push_back({field.name, field.path});
  }
  for (const std::string& name : contents.exact) {
    fields.push_back({"exact " + name, "/exact/" + name});
  }
  for (const std::string& name : contents.residual_fields) {
    residuals.push_back({"residual of " + name, "/laws/fields/" + name});
  }
  Xdmf xdmf(reader, file);
  xdmf.collection("fields", contents.field_times, contents.axes, fields);
  if (!residuals.empty()) {
    const std::vector<std::string> dimensions = reader.info(residuals.front().path).dimensions;
    xdmf.collection("residuals", contents.field_times, {dimensions.begin() + 1, dimensions.end()}, residuals);
  }
  if (!contents.node_quantities.empty()) {
    const Contents quantities = with_quantities_as_fields(contents);
    std::vector<Attribute> attributes;
    for (const Contents::Field& quantity : quantities.fields) {
      attributes.push_back({quantity.name, quantity.path});
    }
    xdmf.collection("quantities", quantities.field_times, contents.axes, attributes);
  }
  OutputFile output(file, overwrite || describes(file, reader));
  output.write(xdmf.text());
  output.finish();
}

}  // namespace rubato::report
