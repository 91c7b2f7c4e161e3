#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include <rubato/problem/formula_table.hpp>
#include <rubato/problem/problem.hpp>

namespace rubato {

/// The rate at which the motion turns at a point of an orbit, of its modes the mean by their forces.
///
/// With v = J∇H, A = JH'' and |v|² = Σ |v_a (H''v)_a|, which no unit changes, it is ω = |Av|/|v|. A mode of frequency
/// ω_i and energy E_i counts by ω_i² E_i: of a stiff spring that follows a slow motion that is nothing, of one that
/// holds a part (ω/ω_i)² of the energy as much as of all the rest.
class LocalFrequency {
public:
  explicit LocalFrequency(const Problem& problem);

  /// At z = (q, p), of a step of length h, which sets the size of differences where z is 0. 0 where no velocity
  /// changes, not a number at rest, for a problem that is stated by L or has constraints, or where ∇H is not defined.
  [[nodiscard]] double operator()(std::span<const double> z, double h);

private:
  /// J∇H, the time at rest.
  [[nodiscard]] std::vector<double> flow(std::span<const double> z);
  /// A v by differences of J∇H, which is `rate` at z: along coordinates and along momenta, so that only lengths of one
  /// unit are compared.
  [[nodiscard]] std::vector<double> product(std::span<const double> z, std::span<const double> rate,
                                            std::span<const double> v, double h);

  std::vector<FormulaTable> gradient_;  ///< one, or none
  std::size_t moving_ = 0;              ///< coordinates but for the time
};

}  // namespace rubato
