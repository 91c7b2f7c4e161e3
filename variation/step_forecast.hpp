#pragma once

#include <rubato/base/state.hpp>
#include <rubato/variation/extrapolation.hpp>
#include <rubato/variation/step_potential.hpp>

namespace rubato {

/// The length of the coming step on the law with a step potential, foreseen from those before it in two ways: |h| as a
/// function of time; and by the node law (theory, sections 8 and 9), |h|^s c + f'(h) = E - H(z_k), whose coefficient
/// c = (s+1) η + O(h) is a function of time too, and a smooth one where |h| has a bend. What has been nearer of late is
/// what is foreseen.
class StepForecast {
public:
  /// |h| of the coming step, at least one step known.
  /// \param last h of the step before
  /// \param remaining E - H(z_k)
  [[nodiscard]] double length(double last, double remaining, const StepPotential& potential, int order);
  /// A step that met the law, the slope of E_k there, f'' included, and f'.
  void add(double h, double remaining, double slope, double potential, int order);
  void restart() { *this = {}; }
  [[nodiscard]] bool empty() const { return lengths_.empty(); }

  void save(StateWriter& state) const;
  void restore(StateReader& state);

private:
  [[nodiscard]] double by_law(double c, double guess, double remaining, const StepPotential& potential,
                              int order) const;

  Extrapolation lengths_, coefficients_;
  double last_ = 0.0;       ///< |h| of the newest step: the time from its start to the coming one's
  double law_scale_ = 0.0;  ///< d|h|/dc there
};

}  // namespace rubato
