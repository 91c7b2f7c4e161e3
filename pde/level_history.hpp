#pragma once

#include <array>
#include <span>
#include <vector>

#include <rubato/base/state.hpp>
#include <rubato/grids/field_set.hpp>

namespace rubato {

/// The rates of the last steps, for prediction: of a field that evolves its velocity δ/h at the middle of the step, of
/// a field that exists at midpoints only its value there (held as δ/2); extrapolated in time (Lagrange, at most cubic).
/// The step under way stands behind the samples, in the memory of the fourth, which falls out where it is predicted.
class LevelHistory {
public:
  static constexpr std::size_t most = 4;

  LevelHistory(std::vector<bool> at_midpoints, std::size_t nodes);

  [[nodiscard]] bool empty() const { return known_ == 0; }
  void forget();

  /// δ of the step under way.
  [[nodiscard]] grids::FieldSet& increment() { return samples_[std::min(known_, most - 1)].rate; }
  /// It becomes a sample at a time relative to the current level.
  void record(double time, double h);
  /// The current level moves on by h.
  void advance(double h);

  /// δ of the coming step of length h, predicted.
  void predict(double h);
  /// The same from δ(from) as well, which it replaces: how the step changes with its length.
  void shift(double from, double h);
  /// Velocities at the current level (0 for fields at midpoints).
  void velocity(grids::FieldSet& rate) const;

  void save(StateWriter& state) const;
  void restore(StateReader& state);

private:
  struct Sample {
    double time = 0.0;  ///< relative to the current level
    grids::FieldSet rate;
  };
  using Weights = std::array<double, most>;
  /// Of the first `count` samples.
  [[nodiscard]] Weights weights(double time, std::size_t count) const;
  /// out = Σ evolving[i] rate_i over the first `count`, or with the weights of fields at midpoints; out may be one.
  void combine(std::size_t count, const Weights& evolving, const Weights& midpoint, grids::FieldSet& out) const;

  std::vector<bool> at_midpoints_;
  std::array<Sample, most> samples_;  ///< newest first
  std::size_t known_ = 0;
};

}  // namespace rubato
