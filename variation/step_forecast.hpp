#pragma once

#include <array>
#include <cstddef>

#include <rubato/base/state.hpp>
#include <rubato/variation/step_potential.hpp>

namespace rubato {

/// The length of the coming step on the law with a step potential, foreseen from those before it in two ways: |h| as a
/// polynomial of time; and by the node law (theory, sections 8 and 9), |h|^s c + f'(h) = E - H(z_k), whose coefficient
/// c = (s+1) η + O(h) is a polynomial of time too, and a smooth one where |h| has a bend. What came nearer last time is
/// what is foreseen.
class StepForecast {
public:
  /// |h| of the step from `time`, at least one step known.
  /// \param last h of the step before
  /// \param remaining E - H(z_k)
  [[nodiscard]] double length(double time, double last, double remaining, const StepPotential& potential, int order);
  /// A step from `time` that met the law.
  void add(double time, double h, double remaining, const StepPotential& potential, int order);
  void restart() { *this = {}; }
  [[nodiscard]] bool empty() const { return known_ == 0; }

  void save(StateWriter& state) const;
  void restore(StateReader& state);

private:
  struct Sample {
    double start = 0.0, middle = 0.0;  ///< times
    double length = 0.0;
    double coefficient = 0.0;  ///< c
  };
  [[nodiscard]] double polynomial(double Sample::*at, double Sample::*value, double time) const;
  [[nodiscard]] double by_length(double time, double last) const;
  [[nodiscard]] double by_law(double time, double guess, double remaining, const StepPotential& potential,
                              int order) const;

  std::array<Sample, 4> samples_{};  ///< newest first
  std::size_t known_ = 0;
  double by_length_ = 0.0, by_law_ = 0.0;        ///< foreseen for the coming step
  double length_error_ = 0.0, law_error_ = 0.0;  ///< of the last ones
};

}  // namespace rubato
