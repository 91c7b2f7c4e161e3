#include <rubato/ode/gauss_function.hpp>

#include <cmath>
#include <limits>

#include <rubato/ode/darboux.hpp>
#include <rubato/ode/increment.hpp>
#include <rubato/ode/tuning.hpp>
#include <rubato/solve/small_matrices.hpp>

namespace rubato {

namespace {

using namespace tuning::gauss_function;

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

}  // namespace

GaussFunction::GaussFunction(const Hamiltonian& hamiltonian, int stages)
    : tableau_(stages),
      centred_(tableau_.a.rowwise() - 0.5 * tableau_.b.transpose()),
      evaluator_(hamiltonian),
      m_(stages),
      size_(static_cast<Index>(evaluator_.dimension())),
      factors_(static_cast<int>(m_ * size_)) {
  for (VectorXd* vector : {&w_, &gradient_}) {
    vector->setZero(size_);
  }
  stages_.setZero(m_ * size_);
  energies_.setZero(m_);
  gradients_.setZero(size_, m_);
  slopes_.setZero(size_, m_);
  hessians_.assign(static_cast<std::size_t>(m_), MatrixXd::Zero(size_, size_));
}

bool GaussFunction::evaluate() {
  for (Index i = 0; i < m_; ++i) {
    energies_[i] = evaluator_.hessian(stages_.data() + i * size_, gradients_.col(i).data(),
                                      hessians_[static_cast<std::size_t>(i)].data());
    auto slope = slopes_.col(i);
    slope.head(size_ / 2) = gradients_.col(i).tail(size_ / 2);
    slope.tail(size_ / 2) = -gradients_.col(i).head(size_ / 2);
  }
  return energies_.allFinite() && gradients_.allFinite();
}

/// The matrix of the stage equations linearised, I - h (a_ij - b_j/2) J H_zz(Z_j).
Status GaussFunction::factor(double h) {
  MatrixXd matrix = MatrixXd::Identity(m_ * size_, m_ * size_);
  const Index n = size_ / 2;
  for (Index j = 0; j < m_; ++j) {
    const MatrixXd& hessian = hessians_[static_cast<std::size_t>(j)];
    for (Index i = 0; i < m_; ++i) {
      auto block = matrix.block(i * size_, j * size_, size_, size_);
      block.topRows(n) -= h * centred_(i, j) * hessian.bottomRows(n);
      block.bottomRows(n) += h * centred_(i, j) * hessian.topRows(n);
    }
  }
  return factors_.factor(matrix.data());
}

VectorXd GaussFunction::mean_slope(Index i) const {
  VectorXd mean = VectorXd::Zero(size_);
  for (Index j = 0; j < m_; ++j) {
    mean += centred_(i, j) * slopes_.col(j);
  }
  return mean;
}

Status GaussFunction::expand(std::span<const double> w, double h) {
  w_ = Eigen::Map<const VectorXd>(w.data(), size_);
  h_ = h;
  for (Index i = 0; i < m_; ++i) {
    stages_.segment(i * size_, size_) = w_;
  }
  double last = std::numeric_limits<double>::infinity();
  for (int iteration = 0; iteration < most_stage_iterations; ++iteration) {
    if (!evaluate()) {
      return Status::undefined;
    }
    if (const Status status = factor(h); status != Status::success) {
      return status;
    }
    VectorXd correction(m_ * size_);
    for (Index i = 0; i < m_; ++i) {
      correction.segment(i * size_, size_) = w_ + h * mean_slope(i) - stages_.segment(i * size_, size_);
    }
    factors_.solve(correction.data());
    stages_ += correction;
    const double size = correction.norm() / (stages_.norm() + std::numeric_limits<double>::min());
    if (!std::isfinite(size)) {
      return Status::undefined;
    }
    // Newton's corrections square until they stagnate at rounding.
    if (size <= std::numeric_limits<double>::epsilon() || (size >= 0.5 * last && size < 1e-12)) {
      if (!evaluate()) {
        return Status::undefined;
      }
      gradient_ = -h * solve::product(gradients_, tableau_.b);
      return Status::success;
    }
    last = size;
  }
  return Status::not_converged;
}

double GaussFunction::value() const {
  double sum = -h_ * tableau_.b.dot(energies_);
  for (Index i = 0; i < m_; ++i) {
    for (Index j = 0; j < m_; ++j) {
      // k_iᵀJ⁻¹k_j = -k_iᵀJk_j = k_iᵀ∇H(Z_j), since Jk = J²∇H = -∇H.
      sum -= 0.5 * h_ * h_ * tableau_.b[i] * centred_(i, j) * slopes_.col(i).dot(gradients_.col(j));
    }
  }
  return sum;
}

double GaussFunction::rate() const {
  return -tableau_.b.dot(energies_);
}

Status GaussFunction::second_variation(double& second_rate, VectorXd& gradient_rate, MatrixXd& hessian) {
  if (const Status status = factor(h_); status != Status::success) {
    return status;
  }
  MatrixXd derivative = MatrixXd::Zero(m_ * size_, size_ + 1);  // of the stages, by w and by h
  for (Index i = 0; i < m_; ++i) {
    derivative.block(i * size_, 0, size_, size_).setIdentity();
    derivative.block(i * size_, size_, size_, 1) = mean_slope(i);
  }
  factors_.solve(derivative.data(), static_cast<int>(size_ + 1));
  second_rate = 0.0;
  gradient_rate = -solve::product(gradients_, tableau_.b);
  hessian = MatrixXd::Zero(size_, size_);
  for (Index i = 0; i < m_; ++i) {
    const auto rows = derivative.middleRows(i * size_, size_);
    const MatrixXd change = tableau_.b[i] * solve::product(hessians_[static_cast<std::size_t>(i)], rows);  // of b_i ∇H
    hessian -= h_ * change.leftCols(size_);
    gradient_rate -= h_ * change.col(size_);
    second_rate -= tableau_.b[i] * gradients_.col(i).dot(rows.col(size_));
  }
  return Status::success;
}

}  // namespace rubato
