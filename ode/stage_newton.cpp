#include <rubato/ode/stage_newton.hpp>

#include <cmath>
#include <stdexcept>

#include <fmt/core.h>

namespace rubato {

namespace {

using Eigen::Index;

/// Below this an eigenvalue is real, whose imaginary part is rounding; others are larger than 1.
constexpr double real_to = 1e-6;

}  // namespace

StageNewton::StageNewton(const GaussTableau& tableau, Index size) : size_(size) {
  if (size < 1 || size > most_components) {
    throw std::invalid_argument(
        fmt::format("stage equations of {} components; dense matrices are for 1 to {}", size, most_components));
  }
  const GaussTableau::Eigenbasis& basis = tableau.inverse_eigenbasis();
  bool any_single = false;
  for (Index e = 0; e < basis.values.size(); ++e) {
    std::complex<double> value = basis.values[e];
    const bool single = std::abs(value.imag()) < real_to;
    if (!single && value.imag() < 0.0) {
      continue;  // its conjugate stands for both
    }
    any_single = any_single || single;
    // An eigenvector of a real eigenvalue is real but for a common factor of modulus 1.
    std::complex<double> turn = 1.0;
    if (single) {
      value = value.real();
      Index largest = 0;
      basis.V.col(e).cwiseAbs().maxCoeff(&largest);
      turn = basis.V(largest, e) / std::abs(basis.V(largest, e));
    }
    parts_.push_back({value, turn * value * basis.V_inverse.row(e).transpose(),
                      (single ? 1.0 : 2.0) / turn * basis.V.col(e),
                      solve::DenseSolver(static_cast<int>(single ? size : 2 * size))});
  }
  matrix_.setZero(2 * size, 2 * size);
  if (any_single) {
    single_.setZero(size, size);
  }
  rhs_.setZero(2 * size);
  result_.setZero(size, tableau.stages);
}

Status StageNewton::factor(double h, const Eigen::MatrixXd& hessian) {
  const Index n = size_ / 2;
  for (Part& part : parts_) {
    const auto shifted = [&](auto block) {  // Re λ - h J H_zz
      block.topRows(n) = -h * hessian.bottomRows(n);
      block.bottomRows(n) = h * hessian.topRows(n);
      block.diagonal().array() += part.value.real();
    };
    if (part.is_pair()) {
      shifted(matrix_.topLeftCorner(size_, size_));
      shifted(matrix_.bottomRightCorner(size_, size_));
      matrix_.topRightCorner(size_, size_).diagonal().setConstant(-part.value.imag());
      matrix_.bottomLeftCorner(size_, size_).diagonal().setConstant(part.value.imag());
    } else {
      shifted(single_.topRows(size_));
    }
    const Status status = part.factors.factor(part.is_pair() ? matrix_.data() : single_.data());
    if (status != Status::success) {
      return status;
    }
  }
  return Status::success;
}

void StageNewton::solve(Rows& right) {
  result_.setZero();
  const Index m = result_.cols();
  for (Part& part : parts_) {
    rhs_.setZero();
    for (Index r = 0; r < size_; ++r) {
      for (Index i = 0; i < m; ++i) {
        rhs_[r] += part.from_stages[i].real() * right(r, i);
        rhs_[size_ + r] += part.from_stages[i].imag() * right(r, i);
      }
    }
    part.factors.solve(rhs_.data());
    for (Index r = 0; r < size_; ++r) {
      for (Index i = 0; i < m; ++i) {
        result_(r, i) += part.to_stages[i].real() * rhs_[r];
        if (part.is_pair()) {
          result_(r, i) -= part.to_stages[i].imag() * rhs_[size_ + r];
        }
      }
    }
  }
  right.leftCols(m) = result_;
}

double StageNewton::factor_operations() const {
  double sum = 0.0;
  for (const Part& part : parts_) {
    const double n = part.factors.size();
    sum += 2.0 / 3.0 * n * n * n + 2.0 * n * n;
  }
  return sum;
}

double StageNewton::solve_operations() const {
  double sum = 0.0;
  for (const Part& part : parts_) {
    const double n = part.factors.size();
    sum += 2.0 * n * n + 4.0 * static_cast<double>(result_.size());
  }
  return sum;
}

}  // namespace rubato
