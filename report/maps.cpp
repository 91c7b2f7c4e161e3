#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <rubato/record/error.hpp>
#include <rubato/report/film.hpp>
#include <rubato/report/page_data.hpp>
#include <rubato/report/space_time_map.hpp>

namespace rubato::report {

namespace {

/// Calls `use(row, values)` for each row of datasets of equal shape, reading some megabytes at a time.
template <typename Use>
void for_each_row(const record::Reader& reader, const std::string& times, const std::vector<std::string>& paths,
                  const Use& use) {
  constexpr std::size_t slab_values = std::size_t{1} << 20;
  const std::size_t rows = reader.rows(times);
  const std::size_t size = reader.info(paths.front()).row_size();
  for (const std::string& path : paths) {
    const record::DatasetInfo info = reader.info(path);
    if (info.shape.front() != rows || info.row_size() != size) {
      throw record::Error(reader.file(), fmt::format("{} has {} rows of {} values, where {} of {} are stored", path,
                                                     info.shape.front(), info.row_size(), rows, size));
    }
  }
  const std::size_t slab = std::clamp<std::size_t>(slab_values / size, 1, rows);
  for (std::size_t first = 0; first < rows; first += slab) {
    const std::size_t count = std::min(slab, rows - first);
    std::vector<std::vector<double>> slabs;
    slabs.reserve(paths.size());
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

/// Where the stored states are of a moving frame: what takes their rows to the laboratory, at the nearest nodes.
class Laboratory {
public:
  /// Of rows that are of the laboratory already.
  Laboratory() = default;
  /// \param shape of a dataset of a field, levels first, then the directions of the grid, x last
  Laboratory(const record::Reader& reader, const std::vector<std::string>& dimensions,
             const std::vector<std::size_t>& shape)
      : cells_(shape.rbegin(), shape.rend() - 1) {
    if (!reader.has("/frame/shift")) {
      return;
    }
    const std::vector<double> shift = reader.read("/frame/shift");
    const std::size_t directions = cells_.size(), levels = shape.front();
    if (shift.size() != levels * directions) {
      throw record::Error(reader.file(), "/frame/shift has not one row for each stored level");
    }
    by_.resize(shift.size());
    periods_.resize(shift.size());
    for (std::size_t a = 0; a < directions; ++a) {  // of x first
      const std::vector<double> nodes = reader.read("/grid/" + dimensions[directions - 1 - a], 0, 2);
      const auto cells = static_cast<double>(cells_[a]);
      for (std::size_t i = a; i < shift.size(); i += directions) {
        const double moved = std::round(shift[i] / (nodes.at(1) - nodes.at(0)));
        periods_[i] = std::floor(moved / cells);
        by_[i] = static_cast<std::size_t>(moved - cells * periods_[i]);
      }
    }
    if (reader.has("/frame/turn")) {
      names_ = reader.read_strings("/frame/row");
      turn_ = reader.read("/frame/turn");
      if (turn_.size() != levels * names_.size() * names_.size()) {
        throw record::Error(reader.file(), "/frame/turn has not one entry for each pair of fields and stored level");
      }
    }
  }

  [[nodiscard]] bool turns() const { return !names_.empty(); }
  /// What a field is multiplied by at a stored level to be a part of field `of` of the laboratory. Hypothesis: turns().
  [[nodiscard]] double factor(std::size_t level, const std::string& of, const std::string& field) const {
    const auto number = [this](const std::string& name) {
      return static_cast<std::size_t>(std::ranges::find(names_, name) - names_.begin());
    };
    const std::size_t row = number(of), column = number(field), fields = names_.size();
    return std::max(row, column) < fields ? turn_[(level * fields + row) * fields + column] : 0.0;
  }

  /// A row at the nodes of the laboratory. \param jump how much larger the field is a period farther, for each
  /// direction; none where it repeats
  [[nodiscard]] std::span<const double> operator()(std::size_t level, std::span<const double> values,
                                                   std::span<const double> jump = {}) {
    if (by_.empty()) {
      return values;
    }
    moved_.resize(values.size());
    const std::size_t directions = cells_.size();
    for (std::size_t node = 0; node < values.size(); ++node) {
      std::size_t rest = node, target = 0, stride = 1;
      double beyond = 0.0;
      for (std::size_t a = 0; a < directions; ++a) {
        const std::size_t at = rest % cells_[a] + by_[level * directions + a];
        if (!jump.empty()) {
          beyond += jump[a] * (periods_[level * directions + a] + static_cast<double>(at / cells_[a]));
        }
        target += at % cells_[a] * stride;
        rest /= cells_[a];
        stride *= cells_[a];
      }
      moved_[target] = values[node] - beyond;
    }
    return moved_;
  }

private:
  std::vector<std::size_t> cells_;  ///< of x first
  std::vector<std::size_t> by_;     ///< whole cells, for each level and direction; none where nothing moves
  std::vector<double> periods_;     ///< and whole periods beside them
  std::vector<std::string> names_;  ///< of the fields, in the order of rows and columns of turn_
  std::vector<double> turn_;
  std::vector<double> moved_;
};

/// Writes the drawings of all fields and residuals as maps of one kind, each dataset read once.
template <typename Map>
class MapWriter {
public:
  MapWriter(Json& json, const Source& source, const typename Map::Plan& plan)
      : json_(json),
        reader_(source.reader),
        notes_(source.notes),
        plan_(plan),
        group_(source.contents.field_group),
        first_(source.contents.fields.front().path),
        shape_(reader_.info(first_).shape) {
    if (group_ != "field") {
      return;  // quantities are of the laboratory
    }
    const record::DatasetInfo info = reader_.info(first_);
    laboratory_ = Laboratory(reader_, {info.dimensions.begin() + 1, info.dimensions.end()}, shape_);
    if (laboratory_.turns()) {
      turned_ = source.contents.fields;
    }
  }

  void field(const Contents::Field& field) {
    const record::DatasetInfo info = shape_of(field.path);
    Map map({.name = field.name, .group = group_, .starts_late = field.at_midpoints, .is_first = field.path == first_},
            plan_);
    const std::string exact_path = "/exact/" + field.name, jump_path = "/frame/jump/" + field.name;
    const std::vector<double> jump =
        group_ == "field" && reader_.has(jump_path) ? reader_.read(jump_path) : std::vector<double>();
    std::vector<std::string> paths = {field.path};
    std::ranges::transform(turned_, std::back_inserter(paths), &Contents::Field::path);
    if (field.at_midpoints || group_ != "field" || !reader_.has(exact_path)) {
      for_each_row(reader_, plan_.times, paths, [&](std::size_t level, const auto& values) {
        map.add(level, laboratory_(level, turned(level, field, values), jump));
      });
      write(map, info);
      return;
    }
    constexpr bool draws_exact = std::is_same_v<Map, SpaceTimeMap>;
    Map exact({.name = field.name, .group = "exact"}, plan_), error({.name = field.name, .group = "error"}, plan_);
    std::vector<double> difference(info.row_size());
    paths.push_back(exact_path);
    for_each_row(reader_, plan_.times, paths, [&](std::size_t level, const auto& values) {
      const std::span<const double> here = turned(level, field, values);
      std::ranges::transform(here, values.back(), difference.begin(), std::minus());
      map.add(level, laboratory_(level, here, jump));
      if (draws_exact) {
        exact.add(level, laboratory_(level, values.back(), jump));
      }
      error.add(level, laboratory_(level, difference));
    });
    write(map, info);
    if (draws_exact) {
      write(exact, info);
    }
    write(error, info);
  }

  void residual(const std::string& name) {
    const std::string path = "/laws/fields/" + name;
    const record::DatasetInfo info = reader_.info(path);
    const bool moves = reader_.has("/frame/shift");
    if (info.shape.size() != shape_.size() || info.row_size() == 0 || (moves && info.shape != shape_)) {
      throw record::Error(reader_.file(), path + " has not the shape of the fields");
    }
    Drawing drawing{.name = name,
                    .group = "residual",
                    .logarithmic = true,
                    .starts_late = true,
                    .has_gaps = reader_.has(std::string(figures::laws_taken))};
    if (const auto level = notes_.rounding.find(path); level != notes_.rounding.end()) {
      drawing.rounding = level->second;
    }
    Map map(drawing, plan_.of(info));
    std::vector<double> magnitude(info.row_size());
    for_each_row(reader_, plan_.times, {path}, [&](std::size_t level, const auto& values) {
      std::ranges::transform(values[0], magnitude.begin(), [](double value) { return std::abs(value); });
      map.add(level, laboratory_(level, magnitude));
    });
    write(map, info);
  }

private:
  /// A field as the laboratory has it; `values` are the field's own, then those of all fields where the frame turns.
  [[nodiscard]] std::span<const double> turned(std::size_t level, const Contents::Field& field,
                                               std::span<const std::span<const double>> values) {
    if (turned_.empty()) {
      return values[0];
    }
    in_laboratory_.assign(values[0].size(), 0.0);
    for (std::size_t other = 0; other < turned_.size(); ++other) {
      const double factor = laboratory_.factor(level, field.name, turned_[other].name);
      for (std::size_t node = 0; factor != 0.0 && node < in_laboratory_.size(); ++node) {
        in_laboratory_[node] += factor * values[1 + other][node];
      }
    }
    return in_laboratory_;
  }

  /// \throws record::Error if it is not that of the first field, which the plan is for
  [[nodiscard]] record::DatasetInfo shape_of(const std::string& path) const {
    record::DatasetInfo info = reader_.info(path);
    if (info.shape != shape_) {
      throw record::Error(reader_.file(), path + " has not the shape of the fields");
    }
    return info;
  }

  void write(const Map& map, const record::DatasetInfo& info) {
    map.write(json_, reader_, {info.dimensions.begin() + 1, info.dimensions.end()});
  }

  Json& json_;
  const record::Reader& reader_;
  const Notes& notes_;
  const typename Map::Plan& plan_;
  std::string group_;
  std::string first_;  ///< path of the first field
  std::vector<std::size_t> shape_;
  Laboratory laboratory_;
  std::vector<Contents::Field> turned_;  ///< all fields, where the frame turns
  std::vector<double> in_laboratory_;
};

template <typename Map>
void write_all(Json& json, const Source& source, std::size_t bytes, const std::string& name) {
  const Contents& contents = source.contents;
  const typename Map::Plan plan = Map::plan(source.reader.info(contents.fields.front().path), contents, bytes);
  Map::write_times(json, name + "_times", source.reader, plan);
  MapWriter<Map> writer(json, source, plan);
  json.key(name + "s").begin_array();
  for (const Contents::Field& field : contents.fields) {
    writer.field(field);
  }
  for (const std::string& residual : contents.residual_fields) {
    writer.residual(residual);
  }
  json.end_array();
}

}  // namespace

void write_maps(Json& json, const Source& source, const Resolution& resolution) {
  const auto write = source.contents.axes.size() < 2 ? &write_all<SpaceTimeMap> : &write_all<Film>;
  write(json, source, resolution.map_bytes, "map");
  if (!source.contents.node_quantities.empty()) {
    const Contents quantities = with_quantities_as_fields(source.contents);
    write(json, {source.reader, quantities, source.summary, source.notes}, resolution.quantity_bytes, "quantity_map");
  }
}

}  // namespace rubato::report
