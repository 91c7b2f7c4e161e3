#pragma once

#include <span>
#include <vector>

#include <rubato/problem/formula_table.hpp>
#include <rubato/problem/problem.hpp>

namespace rubato {

/// The rate of the fastest motion about a point of an orbit: about the largest |eigenvalue| of J H''.
///
/// A power iteration with (J H'')², whose products are differences of gradients. From the coordinates alone it comes
/// back to coordinates, so that only lengths of one unit are compared.
class LocalFrequency {
public:
  explicit LocalFrequency(const Problem& problem);

  /// At z = (q, p), of a step of length h, which sets the size of the differences where z is 0. 0 where nothing turns
  /// or grows, not a number for a problem that is stated by L or has constraints, or where the gradient is not defined.
  [[nodiscard]] double operator()(std::span<const double> z, double h);

private:
  /// J ∇H(z + v) - J ∇H(z), into `v`.
  void apply(std::span<const double> z, std::span<double> v);
  void gradient(std::span<const double> z, std::vector<double>& into);

  std::vector<FormulaTable> gradient_;  ///< one, or none
  std::vector<double> here_, there_, point_, v_;
};

}  // namespace rubato
