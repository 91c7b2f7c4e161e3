#pragma once

#include <cstddef>
#include <limits>
#include <span>
#include <vector>

#include <rubato/record/reader.hpp>
#include <rubato/report/contents.hpp>

/// How the bytes of a page are shared among what it shows. Not part of the library's interface.
namespace rubato::report {

inline constexpr std::size_t no_limit = std::numeric_limits<std::size_t>::max();

/// Bytes of the page, base 64 and braces included, that one part of it can be drawn with at the coarsest, and in full.
struct Demand {
  std::size_t least = 0, whole = 0;
  double weight = 1.0;
};

/// Every part gets its least; beyond that all are raised together, in proportion to their weights, and none gets more
/// than it can use: what small parts leave goes to the large ones. The shares add up to at most `bytes`, which must not
/// be less than all leasts together.
[[nodiscard]] std::vector<std::size_t> share(std::size_t bytes, std::span<const Demand> demands);

/// The length of `bytes` bytes in base 64.
[[nodiscard]] constexpr std::size_t packed_size(std::size_t bytes) {
  return (bytes + 2) / 3 * 4;
}

/// Of numbers per entry that share `bytes` of base 64, how many entries there is room for.
[[nodiscard]] constexpr std::size_t entries_in(std::size_t bytes, std::size_t bytes_per_entry) {
  return bytes == no_limit ? no_limit : bytes / 4 * 3 / bytes_per_entry;
}

/// Bounds for what surrounds the arrays of one figure: keys, braces and its name, every byte of which may be escaped.
enum class Frame : std::size_t { column = 380, curve = 420, map = 1200 };
[[nodiscard]] std::size_t frame_of(Frame frame, std::string_view name);

/// How finely a page shows what it shows of one record; no_limit: in full.
struct Resolution {
  std::size_t curve_points = no_limit;    ///< of each curve over levels, steps or stored levels
  std::size_t off_law = no_limit;         ///< marks of times off the law
  std::size_t path_states = no_limit;     ///< of an orbit's path
  std::size_t column_points = no_limit;   ///< of each coordinate and momentum against time, if the path is thinned
  std::size_t map_bytes = no_limit;       ///< of the page, for all maps of fields together
  std::size_t quantity_bytes = no_limit;  ///< of the page, for all maps of node quantities together
  std::size_t crossings = no_limit;       ///< points of each section
};

/// What a record's figures need.
class Needs {
public:
  Needs(const record::Reader& reader, const Contents& contents);

  [[nodiscard]] const std::vector<Demand>& demands() const { return demands_; }
  /// The finest drawing that fits into shares of demands().
  [[nodiscard]] Resolution resolution(std::span<const std::size_t> shares) const;

private:
  std::vector<Demand> demands_;  ///< of curves, times off the law, sections, and the path and the columns of an orbit,
                                 ///< or the maps of a lattice's fields and of its node quantities
  bool is_orbit_;
  std::size_t curves_, curve_frames_, section_columns_, section_frames_, columns_, column_frames_;
};

}  // namespace rubato::report
