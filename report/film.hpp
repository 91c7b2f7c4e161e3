#pragma once

#include <rubato/report/contents.hpp>
#include <rubato/report/drawing.hpp>

namespace rubato::report {

/// A drawing of a lattice in a plane or a volume: pictures of some stored levels (of a volume, of the slice in the
/// middle of its slowest axis), and the extremes over the whole grid at every stored level. Levels are added one after
/// the other. Not part of the library's interface.
class Film {
public:
  /// How the pictures of all films of a page are divided, and which stored levels they show.
  struct Plan {
    std::size_t height, width, slices;    ///< of the grid
    Partition rows, columns;              ///< of a picture
    Partition first_rows, first_columns;  ///< of a picture of the first field
    std::vector<std::size_t> frames;
    std::size_t levels;
    std::size_t extremes_points;
    std::string times;  ///< path of the times of all levels

    /// Of a dataset with other places, as cells between walls are, at the same levels.
    [[nodiscard]] Plan of(const record::DatasetInfo& info) const;
  };
  [[nodiscard]] static Demand demand(const record::DatasetInfo& field, const Contents& contents);
  /// As finely as `bytes` of the page allow for all films together. The first field is drawn at every node if that
  /// leaves room for some eight levels; of the others pictures of at least some 24 levels come before their detail.
  [[nodiscard]] static Plan plan(const record::DatasetInfo& field, const Contents& contents, std::size_t bytes);
  /// "map_times", or another key: the times of the pictures.
  static void write_times(Json& json, std::string_view key, const record::Reader& reader, const Plan& plan);

  Film(Drawing drawing, const Plan& plan)
      : drawing_(std::move(drawing)),
        plan_(plan),
        rows_(drawing_.is_first ? plan.first_rows : plan.rows),
        columns_(drawing_.is_first ? plan.first_columns : plan.columns) {}
  void add(std::size_t level, std::span<const double> values);
  void write(Json& json, const record::Reader& reader, const std::vector<std::string>& dimensions) const;

private:
  void write_extremes(Json& json, std::span<const double> t) const;

  Drawing drawing_;
  Plan plan_;
  Partition rows_, columns_;
  Census census_;
  std::vector<Extremes> extremes_;
  std::vector<double> low_, high_;
};

}  // namespace rubato::report
