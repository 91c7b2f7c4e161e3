#include <rubato/solve/dense_solver.hpp>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <vector>

#include <fmt/core.h>
#include <Eigen/LU>
#include <rubato/solve/elimination.hpp>
#include <rubato/solve/tuning.hpp>

namespace rubato::solve {
namespace {

using namespace tuning::dense;

using elimination::factor_in_place;
using elimination::substitute;
using elimination::usable;

template <int N>
using Fixed = std::integral_constant<int, N>;

/// Calls f with the size as a constant where unrolling pays, as an int otherwise.
template <class F>
decltype(auto) with_size(int n, F&& f) {
  switch (n) {
    case 1: return f(Fixed<1>{});
    case 2: return f(Fixed<2>{});
    case 3: return f(Fixed<3>{});
    case 4: return f(Fixed<4>{});
    case 5: return f(Fixed<5>{});
    case 6: return f(Fixed<6>{});
    case 7: return f(Fixed<7>{});
    case 8: return f(Fixed<8>{});
    default: return f(n);
  }
}

/// Eigen's blocked LU, with its row swaps made readable: permuting in place by them needs no memory.
struct BlockedFactor : Eigen::PartialPivLU<Eigen::MatrixXd> {
  using PartialPivLU::PartialPivLU;
  [[nodiscard]] const TranspositionType& swaps() const { return m_rowsTranspositions; }
};

}  // namespace

struct DenseSolver::Storage {
  std::vector<double> factors;  ///< n × n: L below the diagonal, U on and above it
  std::vector<double> reciprocals;
  std::vector<int> swaps;
  BlockedFactor blocked;  ///< used instead of the above when n > largest_unblocked
};

DenseSolver::DenseSolver(int n) : n_(n), storage_(std::make_unique<Storage>()) {
  if (n < 1 || n > 4096) {
    throw std::invalid_argument(fmt::format("DenseSolver: the size must be between 1 and 4096, not {}", n));
  }
  if (n > largest_unblocked) {
    storage_->blocked = BlockedFactor(n);
    return;
  }
  storage_->factors.resize(static_cast<std::size_t>(n) * n);
  storage_->reciprocals.resize(n);
  storage_->swaps.resize(n);
}

DenseSolver::~DenseSolver() = default;
DenseSolver::DenseSolver(DenseSolver&&) noexcept = default;
DenseSolver& DenseSolver::operator=(DenseSolver&&) noexcept = default;

Status DenseSolver::factor(const double* matrix) {
  rcond_ = 0.0;
  Storage& s = *storage_;
  if (n_ > largest_unblocked) {
    s.blocked.compute(Eigen::Map<const Eigen::MatrixXd>(matrix, n_, n_));
    const auto pivots = s.blocked.matrixLU().diagonal();
    for (const double pivot : pivots) {
      if (!std::isfinite(pivot)) {
        return Status::undefined;
      }
    }
    for (const double pivot : pivots) {
      if (!usable(pivot)) {
        return Status::singular;
      }
    }
    rcond_ = pivots.cwiseAbs().minCoeff() / pivots.cwiseAbs().maxCoeff();
    return Status::success;
  }
  return with_size(n_, [&](auto n) {
    std::copy_n(matrix, n * n, s.factors.data());
    return factor_in_place(n, s.factors.data(), s.reciprocals.data(), s.swaps.data(), rcond_);
  });
}

void DenseSolver::solve(double* rhs, int columns) const {
  const Storage& s = *storage_;
  if (n_ > largest_unblocked) {
    Eigen::Map<Eigen::MatrixXd> b(rhs, n_, columns);
    for (int k = 0; k < n_; ++k) {
      if (const int row = s.blocked.swaps().coeff(k); row != k) {
        b.row(k).swap(b.row(row));
      }
    }
    s.blocked.matrixLU().triangularView<Eigen::UnitLower>().solveInPlace(b);
    s.blocked.matrixLU().triangularView<Eigen::Upper>().solveInPlace(b);
    return;
  }
  with_size(n_, [&](auto n) {
    for (int column = 0; column < columns; ++column) {
      substitute(n, s.factors.data(), s.reciprocals.data(), s.swaps.data(), rhs + column * n);
    }
  });
}

}  // namespace rubato::solve
