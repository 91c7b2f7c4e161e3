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
    std::size_t height, width, slices;  ///< of the grid
    Partition rows, columns;            ///< of a picture
    std::vector<std::size_t> frames;
    std::size_t levels;
    std::size_t extremes_points;
  };
  [[nodiscard]] static Demand demand(const record::DatasetInfo& field, const Contents& contents);
  /// As finely as `bytes` of the page allow for all films together: pictures of at least some 24 levels come before
  /// their detail.
  [[nodiscard]] static Plan plan(const record::DatasetInfo& field, const Contents& contents, std::size_t bytes);
  /// "map_times": the times of the pictures.
  static void write_times(Json& json, const record::Reader& reader, const Plan& plan);

  Film(Drawing drawing, const Plan& plan) : drawing_(std::move(drawing)), plan_(plan) {}
  void add(std::size_t level, std::span<const double> values);
  void write(Json& json, const record::Reader& reader, const std::vector<std::string>& dimensions) const;

private:
  void write_extremes(Json& json, std::span<const double> t) const;

  Drawing drawing_;
  Plan plan_;
  Census census_;
  std::vector<Extremes> extremes_;
  std::vector<double> low_, high_;
};

}  // namespace rubato::report
