#pragma once

#include <memory>

#include <rubato/base/status.hpp>

namespace rubato::solve {

/// Solves A x = b for one small dense A and any number of right-hand sides, by LU with partial pivoting. All memory is
/// taken at construction, so that a Newton step inside a time loop allocates nothing; sizes up to 8 run code unrolled
/// for their size (tens of nanoseconds at n = 2 and 4), sizes above 16 Eigen's blocked factorisation.
///
///     DenseSolver solver(4);
///     if (const Status status = solver.factor(jacobian); status != Status::success) return status;
///     solver.solve(residual);   // in place
class DenseSolver {
public:
  /// Throws std::invalid_argument unless 1 <= n <= 4096.
  explicit DenseSolver(int n);
  ~DenseSolver();
  DenseSolver(DenseSolver&&) noexcept;
  DenseSolver& operator=(DenseSolver&&) noexcept;

  [[nodiscard]] int size() const { return n_; }

  /// P A = L U from A(i, j) = matrix[i + j n]; the matrix is copied. Status::undefined if an entry is not finite,
  /// Status::singular if a pivot vanishes. After either, `solve` may not be called.
  Status factor(const double* matrix);

  /// Replaces each of the columns of rhs (n × columns, column-major) by its solution. Backward stable: the residual is
  /// a small multiple of ε ‖A‖ ‖x‖ whatever the conditioning. Hypothesis: the last `factor` succeeded.
  void solve(double* rhs, int columns = 1) const;

  /// min |u_ii| / max |u_ii|: the order of magnitude of 1 / cond(A) in most cases, never a bound. 0 if `factor` failed.
  [[nodiscard]] double rcond_estimate() const { return rcond_; }

private:
  struct Storage;
  int n_;
  double rcond_ = 0.0;
  std::unique_ptr<Storage> storage_;
};

}  // namespace rubato::solve
