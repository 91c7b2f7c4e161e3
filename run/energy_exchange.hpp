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
///
/// Far from a start deep in a well, X_k is large at all levels although the terms are small there. So the mean of the
/// error over time is compared with that of Σ |T_i(z_k)| as well.
class EnergyExchange {
public:
  /// A level, in order. \param terms T_i, those of the first call at the start \param rounding a bound of the rounding
  /// error of the node energy \param steps taken so far, each of which may add a rounding error
  void add(std::span<const double> terms, double node_energy, double rounding, double t, double steps);

  void measure(figures::Measures& measures) const;

  void save(StateWriter& state) const;
  void restore(StateReader& state);

private:
  /// The mean error over the mean of Σ |T_i|.
  [[nodiscard]] double remaining() const { return size_integral_ > 0.0 ? error_integral_ / size_integral_ : 0.0; }

  struct Level {
    double exchanged = 0.0;  ///< X_k
    double error = 0.0;      ///< of the node energy, 0 where rounding explains it
    double t = 0.0;
  };

  std::vector<double> first_;  ///< T_i(z_0)
  double first_energy_ = 0.0;
  double size_ = 0.0;  ///< the largest Σ |T_i|
  double last_size_ = 0.0;
  double error_integral_ = 0.0, size_integral_ = 0.0;  ///< of the error and of Σ |T_i| over time
  std::vector<Level> levels_;
};

}  // namespace rubato
