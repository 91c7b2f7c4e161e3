#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>

#include <rubato/base/status.hpp>

/// \file
/// LU with partial pivoting of matrices of a few rows, as plain loops: for sizes that the compiler knows they unroll.

namespace rubato::solve {

namespace elimination {

/// True if a pivot can be divided by; its reciprocal must be finite as well.
inline bool usable(double pivot) {
  const double reciprocal = 1.0 / pivot;
  return std::isfinite(reciprocal) && reciprocal != 0.0;
}

/// An entry that is not finite always reaches the diagonal of U: its row is filled by its multiplier, its column by
/// every multiplier of its pivot row (0 · inf and 0 · NaN are NaN). So looking at pivots is enough.
inline Status judge(double pivot) {
  return std::isfinite(pivot) ? Status::singular : Status::undefined;
}

/// Right-looking LU of the n × n column-major array a; reciprocals of the pivots go to the diagonal's own array, which
/// saves the divisions of every solve. With n a std::integral_constant the loops unroll.
template <class Size>
Status factor_in_place(Size n, double* a, double* reciprocals, int* swaps, double& rcond) {
  double smallest = std::numeric_limits<double>::infinity();
  double largest = 0.0;
  for (int k = 0; k < n; ++k) {
    int row = k;
    for (int i = k + 1; i < n; ++i) {
      if (std::abs(a[i + k * n]) > std::abs(a[row + k * n])) {
        row = i;
      }
    }
    swaps[k] = row;
    if (row != k) {
      for (int j = 0; j < n; ++j) {
        std::swap(a[k + j * n], a[row + j * n]);
      }
    }
    const double pivot = a[k + k * n];
    if (!usable(pivot)) {
      return judge(pivot);
    }
    smallest = std::min(smallest, std::abs(pivot));
    largest = std::max(largest, std::abs(pivot));
    reciprocals[k] = 1.0 / pivot;
    for (int i = k + 1; i < n; ++i) {
      a[i + k * n] *= reciprocals[k];
    }
    for (int j = k + 1; j < n; ++j) {
      const double factor = a[k + j * n];
      for (int i = k + 1; i < n; ++i) {
        a[i + j * n] -= a[i + k * n] * factor;
      }
    }
  }
  rcond = smallest / largest;
  return Status::success;
}

template <class Size>
void substitute(Size n, const double* a, const double* reciprocals, const int* swaps, double* b) {
  for (int k = 0; k < n; ++k) {
    std::swap(b[k], b[swaps[k]]);
  }
  for (int k = 0; k < n; ++k) {
    for (int i = k + 1; i < n; ++i) {
      b[i] -= a[i + k * n] * b[k];
    }
  }
  for (int k = n - 1; k >= 0; --k) {
    b[k] *= reciprocals[k];
    for (int i = 0; i < k; ++i) {
      b[i] -= a[i + k * n] * b[k];
    }
  }
}

}  // namespace elimination

/// DenseSolver for a size that is known to the compiler, on the stack and inline.
template <int N>
class FixedSolver {
public:
  FixedSolver() = default;
  explicit FixedSolver(int /*n*/) {}

  /// As DenseSolver::factor.
  Status factor(const double* matrix) {
    std::copy_n(matrix, factors_.size(), factors_.begin());
    double rcond = 0.0;
    return elimination::factor_in_place(std::integral_constant<int, N>{}, factors_.data(), reciprocals_.data(),
                                        swaps_.data(), rcond);
  }
  /// As DenseSolver::solve, for one column.
  void solve(double* rhs) const {
    elimination::substitute(std::integral_constant<int, N>{}, factors_.data(), reciprocals_.data(), swaps_.data(), rhs);
  }

private:
  std::array<double, static_cast<std::size_t>(N) * N> factors_{};
  std::array<double, N> reciprocals_{};
  std::array<int, N> swaps_{};
};

}  // namespace rubato::solve
