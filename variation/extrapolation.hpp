#pragma once

#include <array>
#include <cstddef>
#include <limits>

#include <rubato/base/state.hpp>

namespace rubato {

/// What a number that changes from level to level is next, foreseen by polynomials of time through its last 1, 2, … 6
/// values: whichever of them has been nearest of late. Where levels follow something smooth that is the highest
/// degree; where they are far apart beside what they follow, or all but equal, a low one, as high ones exaggerate.
class Extrapolation {
public:
  /// The value at the distance `ahead` from the newest one; at least one is known.
  [[nodiscard]] double at(double ahead);
  /// A value, at the distance `ahead` from the one before. What was foreseen there is judged by it.
  void add(double ahead, double value);
  /// How far the one that was believed has been off of late, weighted towards the last; infinite as long as nothing was
  /// foreseen.
  [[nodiscard]] double error() const { return errors_[best_]; }
  [[nodiscard]] double newest() const { return differences_[0]; }
  [[nodiscard]] bool empty() const { return known_ == 0; }

  void save(StateWriter& state) const;
  void restore(StateReader& state);

private:
  static constexpr std::size_t most = 6;
  static constexpr double never = std::numeric_limits<double>::infinity();
  static constexpr std::array<double, most> nothing_foreseen{never, never, never, never, never, never};

  template <typename Count>
  void take_in(Count count, double ahead, double value);

  std::size_t known_ = 0, foreseen_count_ = 0, best_ = 0;
  std::array<double, most> distances_{};    ///< of the values before the newest one from it, backward
  std::array<double, most> differences_{};  ///< divided, of the newest 1, 2, … values
  std::array<double, most> foreseen_{};     ///< by each degree
  double foreseen_ahead_ = 0.0;
  std::array<double, most> errors_ = nothing_foreseen;
};

}  // namespace rubato
