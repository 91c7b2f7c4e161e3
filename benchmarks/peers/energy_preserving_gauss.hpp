#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <span>

#include <Eigen/Dense>

#include <rubato/formula/rounding.hpp>
#include <rubato/ode/hamiltonian.hpp>
#include <rubato/ode/increment.hpp>

/// Gauss collocation that keeps H itself, at equal steps: Brugnano, Iavernaro and Trigiante, "Energy and quadratic
/// invariants preserving integrators based upon Gauss collocation formulae", SIAM J. Numer. Anal. 50 (2012).
///
/// With P the values at the nodes of the Legendre polynomials that are orthonormal on [0, 1], two stages are
/// A = P X P⁻¹, X = [[1/2, -ξ], [ξ, 0]], ξ = 1/(2√3). Since Pᵀ diag(b) P = 1, the method is symplectic if and only if
/// X + Xᵀ = e₁e₁ᵀ, so that it stays so with ξ + α in place of ξ, for any one α. Then Σ b_i c_i² - 1/3 = 2ξα + α², and
/// the map conserves H + (2ξα + α²)/2 h² Γ + O(h⁴), Γ = fᵀ H_zz f. So it is of order 2, of order 4 with α = O(h²), and
///
///     H(z_{k+1}) - H(z_k) = h⁵(…) - (2ξα + α²)/2 h² (Γ(z_{k+1}) - Γ(z_k)) + …:
///
/// a step has an α with which H is the same at both ends unless Γ is, nearly. Where none is found, α = 0.
class EnergyPreservingGauss {
public:
  using Index = Eigen::Index;
  using Vector = Eigen::VectorXd;
  using Matrix = Eigen::MatrixXd;

  /// With less than -ξ/2 the nodes, 1/2 ± (ξ + α), are within half their distance of each other.
  static constexpr double largest_alpha = 0.14;

  EnergyPreservingGauss(const rubato::Hamiltonian& hamiltonian, std::span<const double> z_0)
      : evaluator_(hamiltonian),
        rounding_(hamiltonian.size_code()),
        z_(Vector(Eigen::Map<const Vector>(z_0.data(), static_cast<Index>(z_0.size())))),
        gradient_(z_.value()),
        point_(z_.value()),
        f_there_(z_.value()),
        delta_(z_.value()),
        matrix_(2 * z_.value().size(), 2 * z_.value().size()),
        stages_(z_.value().size(), 2),
        slopes_(stages_),
        residual_(stages_),
        correction_(stages_) {
    curvature(z_.value(), hessian_here_, gamma_here_);
    energy_ = evaluator_.value(z_0.data());
  }

  /// A step with H(z_{k+1}) = H(z_0), if there is an α for it, else with α = 0. \return whether the stages were found
  bool step(double h) {
    evaluations_ = 0;
    begin(h, guess());
    tuned_ = tune(h);
    if (!tuned_ && alpha_ != 0.0) {
      begin(h, 0.0);
      if (!solve(h)) {
        return false;
      }
      curvature(end(), hessian_there_, gamma_there_);
    }
    accept();
    return true;
  }
  /// True if the present step has an α at all: whether H(z_{k+1}) - H(z_0) changes its sign between any of many.
  [[nodiscard]] bool has_alpha(double h) {
    constexpr int parts = 64;
    double last = std::numeric_limits<double>::quiet_NaN();
    for (int i = -parts; i <= parts; ++i) {
      begin(h, largest_alpha * i / parts);
      const double defect = solve(h) ? miss() : std::numeric_limits<double>::quiet_NaN();
      if (defect * last <= 0.0) {
        return true;
      }
      last = defect;
    }
    return false;
  }
  /// A step with that α.
  bool step(double h, double alpha) {
    evaluations_ = 0;
    begin(h, alpha);
    if (!solve(h)) {
      return false;
    }
    curvature(end(), hessian_there_, gamma_there_);
    tuned_ = true;
    accept();
    return true;
  }

  [[nodiscard]] const Vector& state() const { return z_.value(); }
  /// Of the last step.
  ///@{
  [[nodiscard]] double alpha() const { return alpha_; }
  [[nodiscard]] bool tuned() const { return tuned_; }             ///< true if it kept H
  [[nodiscard]] int evaluations() const { return evaluations_; }  ///< of ∇H at both stages, or of H_zz
  ///@}

private:
  static constexpr double xi = 0.28867513459481288;
  static constexpr double epsilon = std::numeric_limits<double>::epsilon();

  struct Past {
    double alpha = 0.0;
    Matrix slopes;
  };

  /// A node of the step that begins at 0 and ends at 1.
  static double node(double alpha, int i) { return 0.5 + (i == 0 ? -1.0 : 1.0) * (xi + alpha); }

  void curvature(const Vector& z, Matrix& hessian, double& gamma) {
    hessian.resize(z.size(), z.size());
    evaluator_.hessian(z.data(), gradient_.data(), hessian.data());
    rubato::apply_j(gradient_, f_there_);
    gamma = f_there_.dot(hessian * f_there_);
    ++evaluations_;
  }

  [[nodiscard]] double guess() const {
    if (foreseen_[0] && foreseen_[1]) {
      return 2.0 * past_[0].alpha - past_[1].alpha;
    }
    return foreseen_[0] ? past_[0].alpha : 0.0;
  }

  /// The stages to begin with: by the slopes of the last two steps, extrapolated; on the tangent.
  void begin(double h, double alpha) {
    set(alpha);
    if (known_ == 0) {
      evaluator_.gradient(z_.value().data(), gradient_.data());
      rubato::apply_j(gradient_, f_there_);
      slopes_.colwise() = f_there_;
    } else {
      slopes_.setZero();
      const int count = 2 * static_cast<int>(std::min<std::size_t>(known_, past_.size()));
      const auto time = [this](int k) { return node(past_[at(k / 2)].alpha, k % 2) - 1.0 - k / 2; };
      for (int i = 0; i < 2; ++i) {
        for (int k = 0; k < count; ++k) {
          double weight = 1.0;
          for (int l = 0; l < count; ++l) {
            weight *= l == k ? 1.0 : (node(alpha, i) - time(l)) / (time(k) - time(l));
          }
          slopes_.col(i) += weight * past_[at(k / 2)].slopes.col(k % 2);
        }
      }
    }
    stages_.noalias() = h * slopes_ * a_.transpose();
    // I - h A⊗J H_zz with H_zz where the step begins, which is known.
    const Index size = stages_.rows(), n = size / 2;
    for (Index i = 0; i < 2; ++i) {
      for (Index j = 0; j < 2; ++j) {
        auto block = matrix_.block(i * size, j * size, size, size);
        block.topRows(n) = -h * a_(i, j) * hessian_here_.bottomRows(n);
        block.bottomRows(n) = h * a_(i, j) * hessian_here_.topRows(n);
      }
    }
    matrix_.diagonal().array() += 1.0;
    factors_.compute(matrix_);
  }
  static std::size_t at(int i) { return static_cast<std::size_t>(i); }

  /// A = P X Pᵀ/2, P = [[1, -1], [1, 1]].
  void set(double alpha) {
    alpha_ = alpha;
    a_ << 0.25, 0.25 - xi - alpha, 0.25 + xi + alpha, 0.25;
  }

  /// Another α from the stages of the last, to first order.
  void move(double h, double alpha) {
    const double change = alpha - alpha_;
    set(alpha);
    residual_.col(0) = -h * change * slopes_.col(1);
    residual_.col(1) = h * change * slopes_.col(0);
    correct();
    stages_ += correction_;
  }
  void correct() {
    Eigen::Map<Vector> right(residual_.data(), residual_.size());
    Eigen::Map<Vector>(correction_.data(), correction_.size()) = factors_.solve(right);
  }

  /// Simplified Newton iteration, until what the next correction would mend is less than rounding; δ.
  bool solve(double h) {
    double last = std::numeric_limits<double>::infinity();
    for (int iteration = 0; iteration < 50; ++iteration) {
      for (Index i = 0; i < 2; ++i) {
        z_.displaced(1.0, stages_.col(i), point_);
        evaluator_.gradient(point_.data(), gradient_.data());
        rubato::apply_j(gradient_, f_there_);
        slopes_.col(i) = f_there_;
      }
      ++evaluations_;
      residual_.noalias() = h * slopes_ * a_.transpose();
      residual_ -= stages_;
      correct();
      const double size = correction_.cwiseAbs().maxCoeff() / stages_.cwiseAbs().maxCoeff();
      if (!std::isfinite(size)) {
        return false;
      }
      stages_ += correction_;
      if (std::isfinite(last) && size > 1e-13) {
        contraction_ = size / last;
      }
      if (std::min(contraction_, 1.0) * size <= 0.25 * epsilon || (size >= 0.5 * last && size < 16.0 * epsilon)) {
        // δ = Σ (A⁻ᵀb)_i Y_i, given by f where that is known.
        const Eigen::Vector2d of_stages = a_.transpose().inverse() * Eigen::Vector2d(0.5, 0.5);
        delta_ = 0.5 * h * (slopes_.col(0) + slopes_.col(1)) + (correction_ - residual_) * of_stages;
        return true;
      }
      last = size;
    }
    return false;
  }

  [[nodiscard]] const Vector& end() {
    z_.displaced(1.0, delta_, point_);
    return point_;
  }
  [[nodiscard]] double miss() { return evaluator_.value(end().data()) - energy_; }

  /// Secants on α, the first slope by Γ.
  bool tune(double h) {
    if (!solve(h)) {
      return false;
    }
    curvature(end(), hessian_there_, gamma_there_);
    // H is reported at a rounded z, which is half an ε of itself off.
    const double allowed = rounding_({point_.data(), static_cast<std::size_t>(point_.size())}).rounding +
                           epsilon * gradient_.cwiseAbs().dot(point_.cwiseAbs());
    double slope = -(xi + alpha_) * h * h * (gamma_there_ - gamma_here_);
    double defect = miss();
    for (int trial = 0; trial < 20; ++trial) {
      if (std::abs(defect) <= (trial < 8 ? 1.0 : 4.0) * allowed) {
        foreseeable_ = allowed < 0.1 * std::abs(slope * alpha_);
        return true;
      }
      const double last = alpha_, next = alpha_ - defect / slope;
      if (!(std::abs(next) <= largest_alpha)) {
        return false;
      }
      move(h, next);
      if (!solve(h)) {
        return false;
      }
      const double before = defect;
      defect = miss();
      if (std::abs(defect - before) > 2.0 * allowed) {
        slope = (defect - before) / (alpha_ - last);
      }
    }
    return false;
  }

  void accept() {
    z_.add(delta_);
    std::swap(past_[0], past_[1]);
    foreseen_[1] = foreseen_[0];
    past_[0] = {alpha_, slopes_};
    foreseen_[0] = tuned_ && foreseeable_;
    ++known_;
    std::swap(hessian_here_, hessian_there_);
    gamma_here_ = gamma_there_;
  }

  rubato::HamiltonianEvaluator evaluator_;
  rubato::formula::SumSizeEvaluator rounding_;
  rubato::CompensatedState<Vector> z_;
  Vector gradient_, point_, f_there_, delta_;
  Matrix matrix_, hessian_here_, hessian_there_, stages_, slopes_, residual_, correction_;
  Eigen::PartialPivLU<Matrix> factors_;
  Eigen::Matrix2d a_;
  std::array<Past, 2> past_;
  std::array<bool, 2> foreseen_{};  ///< true if α of the last two steps was known to a tenth of itself
  std::size_t known_ = 0;
  double energy_ = 0.0, alpha_ = 0.0, gamma_here_ = 0.0, gamma_there_ = 0.0;
  double contraction_ = 1.0;
  bool tuned_ = false, foreseeable_ = false;
  int evaluations_ = 0;
};
