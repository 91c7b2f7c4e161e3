#pragma once

#include <rubato/report/contents.hpp>
#include <rubato/report/drawing.hpp>

namespace rubato::report {

/// A drawing of a lattice on a line: space by time in blocks, and the profile along space of the first level in each
/// row of blocks. Levels are added one after the other. Not part of the library's interface.
class SpaceTimeMap {
public:
  /// How the levels and the cells of all maps of a page are divided.
  struct Plan {
    Partition levels, cells;
    std::string times;  ///< path of the times of all levels

    /// Of a dataset with other places, as cells between walls are, at the same levels.
    [[nodiscard]] Plan of(const record::DatasetInfo& info) const { return {levels, cells.of(info.shape[1]), times}; }
  };
  [[nodiscard]] static Demand demand(const record::DatasetInfo& field, const Contents& contents);
  /// As finely as `bytes` of the page allow for all maps together: in full if possible, else thinned along time only,
  /// else with as many blocks along time as along space.
  [[nodiscard]] static Plan plan(const record::DatasetInfo& field, const Contents& contents, std::size_t bytes);
  /// "map_times", or another key: the first and the last time in each row of blocks.
  static void write_times(Json& json, std::string_view key, const record::Reader& reader, const Plan& plan);

  SpaceTimeMap(Drawing drawing, const Plan& plan);
  void add(std::size_t level, std::span<const double> values);
  void write(Json& json, const record::Reader& reader, const std::vector<std::string>& dimensions) const;

private:
  [[nodiscard]] bool has_profiles() const { return drawing_.group != "error" && drawing_.group != "residual"; }

  Drawing drawing_;
  Census census_;
  BlockEnvelope blocks_, profiles_;
};

}  // namespace rubato::report
