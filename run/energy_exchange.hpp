#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include <rubato/base/state.hpp>
#include <rubato/figures/verdict.hpp>

namespace rubato {

/// The error of the node energy relative to the energy that the motion exchanges between the terms T_i of H.
///
/// At a level k that is X_k = Σ |T_i(z_k) - T_i(z_0)|, or its mean over the run where that is larger, as at the return
/// of a periodic orbit. |H(z_k) - H(z_0)| <= X_k by the triangle inequality: an error near X_k means that the terms do
/// not balance. A close encounter enlarges X_k only while it lasts, so that it hides no error that remains. An H of one
/// term is measured by its size. Errors that rounding explains count as none, and so does an X of next to 0.
class EnergyExchange {
public:
  /// A level, in order. \param terms T_i, those of the first call at the start \param rounding a bound of the rounding
  /// error of the node energy \param steps taken so far, each of which may add a rounding error
  void add(std::span<const double> terms, double node_energy, double rounding, double t, double steps);

  void measure(figures::Measures& measures) const;

  void save(StateWriter& state) const;
  void restore(StateReader& state);

private:
  struct Level {
    double exchanged = 0.0;  ///< X_k
    double error = 0.0;      ///< of the node energy, 0 where rounding explains it
    double t = 0.0;
  };

  std::vector<double> first_;  ///< T_i(z_0)
  double first_energy_ = 0.0;
  double size_ = 0.0;  ///< the largest Σ |T_i|
  std::vector<Level> levels_;
};

}  // namespace rubato
