#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include <rubato/report/page_data.hpp>

namespace rubato::report {

namespace {

/// Calls `use(row, values)` for each row of datasets of equal shape, reading some megabytes at a time.
template <typename Use>
void for_each_row(const record::Reader& reader, const std::vector<std::string>& paths, const Use& use) {
  constexpr std::size_t slab_values = std::size_t{1} << 20;
  const std::size_t rows = reader.rows(paths.front());
  const std::size_t size = reader.info(paths.front()).row_size();
  const std::size_t slab = std::clamp<std::size_t>(slab_values / size, 1, rows);
  for (std::size_t first = 0; first < rows; first += slab) {
    const std::size_t count = std::min(slab, rows - first);
    std::vector<std::vector<double>> slabs;
    for (const std::string& path : paths) {
      slabs.push_back(reader.read(path, first, count));
    }
    std::vector<std::span<const double>> values(paths.size());
    for (std::size_t row = 0; row < count; ++row) {
      std::ranges::transform(slabs, values.begin(),
                             [&](const auto& all) { return std::span(all).subspan(row * size, size); });
      use(first + row, values);
    }
  }
}

/// What is drawn of one grid function over all stored levels.
struct Drawing {
  std::string name, group;
  bool logarithmic = false;  ///< of its magnitude
};

struct Extremes {
  double low = std::numeric_limits<double>::infinity(), high = -std::numeric_limits<double>::infinity();
  void add(std::span<const double> values) {
    for (const double value : values) {
      low = value < low ? value : low;
      high = value > high ? value : high;
    }
  }
};

/// log10 of magnitudes, from 16 decades below the largest; zero counts as the smallest other value.
void take_logarithms(std::vector<double>& low, std::vector<double>& high) {
  constexpr double decades = 16.0;
  double smallest = std::numeric_limits<double>::infinity(), largest = 0.0;
  for (std::size_t i = 0; i < low.size(); ++i) {
    for (const double value : {low[i], high[i]}) {
      smallest = value > 0.0 && value < smallest ? value : smallest;
      largest = value > largest ? value : largest;
    }
  }
  const double floor = largest == 0.0 ? -decades : std::max(std::log10(smallest), std::log10(largest) - decades);
  for (auto* values : {&low, &high}) {
    for (double& value : *values) {
      value = std::isnan(value) ? value : std::max(value > 0.0 ? std::log10(value) : floor, floor);
    }
  }
}

void write_blocks(Json& json, const Drawing& drawing, std::vector<double> low, std::vector<double> high,
                  bool is_whole) {
  if (drawing.logarithmic) {
    take_logarithms(low, high);
  }
  Extremes extremes;
  extremes.add(low);
  extremes.add(high);
  if (extremes.low > extremes.high) {  // nothing is defined
    extremes = {0.0, 0.0};
  }
  json.entry("logarithmic", drawing.logarithmic).entry("thinned", !is_whole);
  json.key("high");
  write_u16(json, high, extremes.low, extremes.high);
  if (!is_whole) {
    json.key("low");
    write_u16(json, low, extremes.low, extremes.high);
  }
}

void write_partition(Json& json, std::string_view key, const Partition& partition) {
  json.key(key).begin_object().entry("count", partition.places()).entry("parts", partition.parts()).end_object();
}

/// The middles of cells lie along the same axis as the nodes.
std::string_view display_name(std::string_view dimension) {
  constexpr std::string_view cells = "_cell";
  return dimension.ends_with(cells) ? dimension.substr(0, dimension.size() - cells.size()) : dimension;
}

void write_axis(Json& json, std::string_view key, const record::Reader& reader, const std::string& name,
                const Partition& partition) {
  const std::vector<double> x = reader.read("/grid/" + name);
  json.key(key).begin_object().entry("name", display_name(name)).entry("first", x.front()).entry("last", x.back());
  json.entry("count", partition.places()).entry("parts", partition.parts()).end_object();
}

std::vector<double> magnitudes(std::span<const double> values) {
  std::vector<double> all(values.begin(), values.end());
  std::ranges::for_each(all, [](double& value) { value = std::abs(value); });
  return all;
}

std::vector<double> differences(std::span<const double> a, std::span<const double> b) {
  std::vector<double> all(a.size());
  std::ranges::transform(a, b, all.begin(), [](double left, double right) { return left - right; });
  return all;
}

/// Gathers a drawing of a lattice in one dimension: space by time, as one matrix of blocks.
class SpaceTimeMap {
public:
  SpaceTimeMap(Drawing drawing, const std::vector<std::size_t>& shape, std::size_t bytes)
      : drawing_(std::move(drawing)), blocks_(plan(shape, bytes)) {}

  void add(std::size_t /*level*/, std::span<const double> values) { blocks_.add_row(values); }

  void write(Json& json, const record::Reader& reader, const std::vector<std::string>& dimensions) const {
    const std::vector<double> t = reader.read("/states/t");
    std::vector<double> first, last;
    for (std::size_t part = 0; part < blocks_.rows().parts(); ++part) {
      first.push_back(t[blocks_.rows().begin(part)]);
      last.push_back(t[blocks_.rows().end(part) - 1]);
    }
    json.begin_object().entry("name", drawing_.name).entry("group", drawing_.group).entry("shape", "space-time");
    write_partition(json, "levels", blocks_.rows());
    write_axis(json, "x", reader, dimensions.front(), blocks_.columns());
    json.key("t_first");
    write_f64(json, first);
    json.key("t_last");
    write_f64(json, last);
    write_blocks(json, drawing_, blocks_.low(), blocks_.high(), blocks_.is_whole());
    json.end_object();
  }

private:
  /// Two bytes for each value if all fit, else four for each block: as many blocks along time as along space where both
  /// have enough.
  static BlockEnvelope plan(const std::vector<std::size_t>& shape, std::size_t bytes) {
    const std::size_t levels = shape[0], cells = shape[1];
    if (2 * levels * cells <= bytes) {
      return {{levels, levels}, {cells, cells}};
    }
    const std::size_t blocks = std::max<std::size_t>(bytes / 4, 16);
    const auto side = static_cast<std::size_t>(std::sqrt(static_cast<double>(blocks)));
    const std::size_t columns = std::min(cells, std::max(side, blocks / levels));
    return {{levels, blocks / columns}, {cells, columns}};
  }

  Drawing drawing_;
  BlockEnvelope blocks_;
};

/// Gathers a drawing of a lattice in two or three dimensions: pictures of some stored levels (in three dimensions, of
/// the slice in the middle of the slowest axis), and the extremes over the whole grid at every stored level.
class Film {
public:
  Film(Drawing drawing, const std::vector<std::size_t>& shape, std::size_t bytes)
      : drawing_(std::move(drawing)), height_(shape[shape.size() - 2]), width_(shape.back()) {
    std::size_t grid = 1;
    for (std::size_t i = 1; i < shape.size(); ++i) {
      grid *= shape[i];
    }
    slices_ = grid / (height_ * width_);
    constexpr std::size_t enough_frames = 40, smallest_picture = 32;
    const std::size_t levels = shape[0];
    const double blocks = static_cast<double>(bytes) / (4.0 * static_cast<double>(std::min(levels, enough_frames)));
    const double scale = std::sqrt(blocks / static_cast<double>(height_ * width_));
    const auto reduced = [&](std::size_t size) {
      const auto wanted = static_cast<std::size_t>(static_cast<double>(size) * std::min(scale, 1.0));
      return Partition(size, std::max(wanted, smallest_picture));
    };
    rows_ = reduced(height_);
    columns_ = reduced(width_);
    const std::size_t picture = rows_.parts() * columns_.parts() * (is_whole() ? 2 : 4);
    const std::size_t frames = std::clamp<std::size_t>(bytes / picture, 2, std::max<std::size_t>(levels, 2));
    for (std::size_t i = 0; i < std::min(frames, levels); ++i) {
      frames_.push_back(levels == 1 ? 0 : i * (levels - 1) / (std::min(frames, levels) - 1));
    }
  }

  void add(std::size_t level, std::span<const double> values) {
    extremes_.push_back({});
    extremes_.back().add(values);
    if (!std::ranges::binary_search(frames_, level)) {
      return;
    }
    BlockEnvelope picture(rows_, columns_);
    const auto slice = values.subspan(slices_ / 2 * height_ * width_, height_ * width_);
    for (std::size_t row = 0; row < height_; ++row) {
      picture.add_row(slice.subspan(row * width_, width_));
    }
    low_.insert(low_.end(), picture.low().begin(), picture.low().end());
    high_.insert(high_.end(), picture.high().begin(), picture.high().end());
  }

  void write(Json& json, const record::Reader& reader, const std::vector<std::string>& dimensions) const {
    const std::vector<double> t = reader.read("/states/t");
    json.begin_object().entry("name", drawing_.name).entry("group", drawing_.group).entry("shape", "film");
    json.key("levels").begin_object().entry("count", t.size()).entry("parts", frames_.size()).end_object();
    json.key("t_first");
    write_f64(json, pick(t, frames_));
    json.key("t_last");
    write_f64(json, pick(t, frames_));
    write_axis(json, "y", reader, dimensions[dimensions.size() - 2], rows_);
    write_axis(json, "x", reader, dimensions.back(), columns_);
    if (slices_ > 1) {
      const std::vector<double> across = reader.read("/grid/" + dimensions.front());
      json.key("slice")
          .begin_object()
          .entry("axis", display_name(dimensions.front()))
          .entry("at", across[slices_ / 2])
          .end_object();
    }
    write_blocks(json, drawing_, low_, high_, is_whole());
    std::vector<double> lowest, highest;
    for (const Extremes& extremes : extremes_) {
      const bool none = extremes.low > extremes.high;
      lowest.push_back(none ? std::numeric_limits<double>::quiet_NaN() : extremes.low);
      highest.push_back(none ? std::numeric_limits<double>::quiet_NaN() : extremes.high);
    }
    constexpr std::size_t buckets = 1000;
    const auto kept = merge(envelope(lowest, buckets), envelope(highest, buckets));
    json.key("extremes").begin_object().key("t");
    write_f64(json, pick(t, kept));
    json.key("low");
    write_f32(json, pick(lowest, kept));
    json.key("high");
    write_f32(json, pick(highest, kept));
    json.end_object().end_object();
  }

private:
  [[nodiscard]] bool is_whole() const { return rows_.is_whole() && columns_.is_whole(); }

  Drawing drawing_;
  std::size_t height_, width_, slices_ = 1;
  Partition rows_{1, 1}, columns_{1, 1};
  std::vector<std::size_t> frames_;
  std::vector<Extremes> extremes_;
  std::vector<double> low_, high_;
};

template <typename Map>
class MapWriter {
public:
  MapWriter(Json& json, const record::Reader& reader, std::size_t bytes)
      : json_(json), reader_(reader), bytes_(bytes) {}

  void field(const Contents::Field& field) {
    const record::DatasetInfo info = reader_.info(field.path);
    Map map({field.name, "field"}, info.shape, bytes_);
    const std::string exact_path = "/exact/" + field.name;
    if (field.at_midpoints || !reader_.has(exact_path)) {
      for_each_row(reader_, {field.path}, [&](std::size_t level, const auto& values) { map.add(level, values[0]); });
      write(map, info);
      return;
    }
    Map exact({field.name, "exact"}, info.shape, bytes_);
    Map error({field.name, "error"}, info.shape, bytes_);
    for_each_row(reader_, {field.path, exact_path}, [&](std::size_t level, const auto& values) {
      map.add(level, values[0]);
      exact.add(level, values[1]);
      error.add(level, differences(values[0], values[1]));
    });
    for (const Map* drawn : {&map, &exact, &error}) {
      write(*drawn, info);
    }
  }

  void residual(const std::string& name) {
    const std::string path = "/laws/fields/" + name;
    const record::DatasetInfo info = reader_.info(path);
    Map map({name, "residual", true}, info.shape, bytes_);
    for_each_row(reader_, {path},
                 [&](std::size_t level, const auto& values) { map.add(level, magnitudes(values[0])); });
    write(map, info);
  }

private:
  void write(const Map& map, const record::DatasetInfo& info) {
    map.write(json_, reader_, {info.dimensions.begin() + 1, info.dimensions.end()});
  }

  Json& json_;
  const record::Reader& reader_;
  std::size_t bytes_;
};

template <typename Map>
void write_all(Json& json, const record::Reader& reader, const Contents& contents, std::size_t bytes) {
  MapWriter<Map> writer(json, reader, bytes);
  json.key("maps").begin_array();
  for (const Contents::Field& field : contents.fields) {
    writer.field(field);
  }
  for (const std::string& name : contents.residual_fields) {
    writer.residual(name);
  }
  json.end_array();
}

}  // namespace

std::size_t count_maps(const Contents& contents) {
  return contents.fields.size() + 2 * contents.exact.size() + contents.residual_fields.size();
}

void write_maps(Json& json, const record::Reader& reader, const Contents& contents, const Resolution& resolution) {
  if (contents.axes.size() < 2) {
    write_all<SpaceTimeMap>(json, reader, contents, resolution.map_bytes);
  } else {
    write_all<Film>(json, reader, contents, resolution.map_bytes);
  }
}

}  // namespace rubato::report
