#pragma once

#include <concepts>
#include <cstddef>
#include <span>
#include <type_traits>
#include <vector>

#include <rubato/base/status.hpp>
#include <rubato/grids/buffer.hpp>

namespace rubato::solve {

/// A linear operator out = A in, as a view of any callable f(const double* in, double* out) that outlives it.
class OperatorRef {
public:
  // NOLINTNEXTLINE(bugprone-forwarding-reference-overload): the constraint leaves copies alone
  template <class F>
  requires std::invocable<F&, const double*, double*> &&
      (!std::same_as<std::remove_cvref_t<F>, OperatorRef>)OperatorRef(F&& f)
      : object_(const_cast<void*>(static_cast<const void*>(&f))),
        call_([](void* object, const double* in, double* out) {
          (*static_cast<std::remove_reference_t<F>*>(object))(in, out);
        }) {}

  void operator()(const double* in, double* out) const { call_(object_, in, out); }

private:
  void* object_;
  void (*call_)(void*, const double*, double*);
};

/// When an iteration stops. Residuals are ‖b - A x‖ / ‖b‖ in the Euclidean norm.
struct GmresOptions {
  double tolerance = 1e-13;   ///< success once residual <= tolerance
  double acceptable = 1e-10;  ///< success as well if it stagnates at or below this (a cycle gains less than a factor 2)
  int max_iterations = 500;
};

struct GmresOutcome {
  Status status = Status::success;
  int iterations = 0;     ///< applications of A, over all cycles
  double residual = 0.0;  ///< of the returned x, computed from its definition
};

/// Solves A x = b without the matrix, by restarted GMRES. With A P for A and x = P y it is preconditioned from the
/// right, and what is minimised is the true residual. Modified Gram–Schmidt, compensated scalar products: the same bits
/// for every number of threads. Memory: (restart + 1) · size doubles, of which an iteration that ends early leaves the
/// last ones untouched.
class Gmres {
public:
  /// Throws std::invalid_argument unless size >= 1 and 1 <= restart <= 1000.
  explicit Gmres(std::size_t size, int restart = 30);

  /// x holds the first guess, then the result. b and x have `size` values; A must not change its input.
  ///
  /// Status: not_converged after max_iterations or when stagnating above `acceptable`; singular if A has no solution
  /// within the space it generates; undefined if a value is not finite (x is then unchanged since the last cycle).
  GmresOutcome solve(OperatorRef a, std::span<const double> b, std::span<double> x, const GmresOptions& options = {});

  [[nodiscard]] std::size_t size() const { return size_; }

private:
  std::span<double> basis(int j) { return {basis_.data() + static_cast<std::size_t>(j) * size_, size_}; }

  std::size_t size_;
  int restart_;
  grids::Buffer basis_;
  // The Hessenberg matrix, triangular by rotations, column j at j (restart + 1), and the rotated right-hand side.
  std::vector<double> hessenberg_;
  std::vector<double> cosines_;
  std::vector<double> sines_;
  std::vector<double> reduced_;
};

}  // namespace rubato::solve
