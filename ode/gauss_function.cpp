#include <rubato/ode/gauss_function.hpp>

#include <cmath>
#include <limits>

#include <rubato/ode/darboux.hpp>
#include <rubato/ode/increment.hpp>

namespace rubato {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr int most_stage_iterations = 50;

}  // namespace

GaussFunction::GaussFunction(const Hamiltonian& hamiltonian, int stages)
    : tableau_(stages),
      centred_(tableau_.a.rowwise() - 0.5 * tableau_.b.transpose()),
      evaluator_(hamiltonian),
      m_(stages),
      size_(static_cast<Index>(evaluator_.dimension())) {
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
void GaussFunction::factor(double h) {
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
  factors_.compute(matrix);
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
    factor(h);
    VectorXd residual(m_ * size_);
    for (Index i = 0; i < m_; ++i) {
      residual.segment(i * size_, size_) =
          w_ + h * slopes_ * centred_.row(i).transpose() - stages_.segment(i * size_, size_);
    }
    const VectorXd correction = factors_.solve(residual);
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
      gradient_ = -h * gradients_ * tableau_.b;
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

void GaussFunction::second_variation(double& second_rate, VectorXd& gradient_rate, MatrixXd& hessian) {
  factor(h_);
  MatrixXd right = MatrixXd::Zero(m_ * size_, size_ + 1);
  for (Index i = 0; i < m_; ++i) {
    right.block(i * size_, 0, size_, size_).setIdentity();
    right.block(i * size_, size_, size_, 1) = slopes_ * centred_.row(i).transpose();
  }
  const MatrixXd derivative = factors_.solve(right);  // of the stages, by w and by h
  second_rate = 0.0;
  gradient_rate = -gradients_ * tableau_.b;
  hessian = MatrixXd::Zero(size_, size_);
  for (Index i = 0; i < m_; ++i) {
    const MatrixXd& own = hessians_[static_cast<std::size_t>(i)];
    const auto rows = derivative.middleRows(i * size_, size_);
    hessian -= h_ * tableau_.b[i] * own * rows.leftCols(size_);
    gradient_rate -= h_ * tableau_.b[i] * own * rows.rightCols(1);
    second_rate -= tableau_.b[i] * gradients_.col(i).dot(rows.rightCols(1).col(0));
  }
}

}  // namespace rubato
