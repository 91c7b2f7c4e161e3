#include <rubato/ode/midpoint_scheme.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/Core>

#include <rubato/ode/constrained_midpoint.hpp>
#include <rubato/ode/increment.hpp>
#include <rubato/ode/one_step_state.hpp>
#include <rubato/ode/step_matrix.hpp>
#include <rubato/ode/tuning.hpp>

namespace rubato {

namespace {

using namespace tuning::midpoint;

/// Size is 2n where that is small enough for the compiler to unroll, else Eigen::Dynamic. Matrix: a step matrix of
/// ode/step_matrix.hpp.
template <int Size, typename Matrix>
class MidpointScheme final : public OneStepState<Eigen::Matrix<double, Size, 1>> {
  using Vector = Eigen::Matrix<double, Size, 1>;
  using Base = OneStepState<Vector>;
  using Base::delta_;
  using Base::evaluator_;
  using Base::z_;

public:
  MidpointScheme(const Hamiltonian& hamiltonian, std::span<const double> z_0, Matrix matrix)
      : Base(hamiltonian, z_0),
        energy_size_(hamiltonian.size_code()),
        gradient_rounding_(hamiltonian.gradient_code()),
        size_(static_cast<Eigen::Index>(z_0.size())),
        history_(size_),
        matrix_(std::move(matrix)) {
    for (Vector* vector : {&rate_, &correction_, &point_, &gradient_, &f_, &rounding_point_}) {
      vector->setZero(size_);
    }
  }

  [[nodiscard]] Status advance(double h, double accuracy) override {
    Base::forget_trial();
    double before = std::numeric_limits<double>::infinity();
    if (!factored_) {
      predict(h);
      if (!factor(h)) {
        return Status::undefined;
      }
    } else {
      delta_ += (h - trial_h_) * rate_;
      const double out_of_date = std::abs(h - factored_h_) / std::abs(h);
      if (out_of_date > Matrix::refactor_ratio && !factor(h)) {
        return Status::undefined;
      }
      contraction_ = std::max(contraction_, out_of_date * matrix_.stiffness());
      before = std::max(last_size_, std::abs(h - trial_h_) / std::abs(h));
    }
    trial_h_ = h;
    StagnationTest test(accuracy, contraction_, before);
    for (int iteration = 0; iteration < most_midpoint_iterations; ++iteration) {
      z_.displaced(0.5, delta_, point_);
      energy_ = evaluator_.gradient(point_.data(), gradient_.data());
      ++iterations_;
      apply_j(gradient_, f_);
      correction_ = h * f_ - delta_;
      const double residual = history_.relative_size(correction_, delta_, z_.value());
      matrix_.solve(correction_.data());
      delta_ += correction_;
      const double size = history_.relative_size(correction_, delta_, z_.value());
      if (!std::isfinite(size) || !std::isfinite(energy_)) {
        factored_ = false;
        return Status::undefined;
      }
      const auto verdict = test.judge(size, residual);
      contraction_ = *test.contraction();
      last_size_ = size;
      if (verdict == StagnationTest::Verdict::done ||
          (verdict != StagnationTest::Verdict::again && residual_is_rounding(h))) {
        energy_ += 0.5 * gradient_.dot(correction_);  // to first order, at the corrected midpoint
        rate_ = f_;
        matrix_.solve(rate_.data());
        slope_ = 0.5 * gradient_.dot(rate_);
        return Status::success;
      }
      if (verdict != StagnationTest::Verdict::again && !factor(h)) {
        return Status::undefined;
      }
    }
    factored_ = false;
    return Status::not_converged;
  }

  [[nodiscard]] Status advance_to(std::span<const double> z_1, double h) override {
    history_ = VelocityHistory<Vector>(size_);
    point_ = Eigen::Map<const Vector>(z_1.data(), size_) - z_.value();
    history_.record(h, point_);
    start_level();
    return advance(h, 0.0);
  }

  /// (I - A) V_1 = (I + A) V_0, A = ½hJH_zz at the midpoint: V_1 = 2(I - A)⁻¹V_0 - V_0.
  [[nodiscard]] Status tangent(std::span<double> columns) override {
    if (!factor(trial_h_)) {
      return Status::undefined;
    }
    for (std::size_t first = 0; first < columns.size(); first += static_cast<std::size_t>(size_)) {
      Eigen::Map<Vector> column(columns.data() + first, size_);
      point_ = column;
      matrix_.solve(point_.data());
      column = 2.0 * point_ - column;
    }
    return Status::success;
  }

  [[nodiscard]] double discrete_energy() const override { return energy_; }
  [[nodiscard]] formula::SumSize energy_size() override {
    z_.displaced(0.5, delta_, point_);
    // z_k is rounded where it is reported, and so is the middle; what that makes of the rest of the step comes on top.
    rounding_point_ = 2.5 * (point_.cwiseAbs() + delta_.cwiseAbs());
    return energy_size_(as_span(point_), as_span(rounding_point_));
  }
  [[nodiscard]] double discrete_energy_slope() const override { return slope_; }
  [[nodiscard]] int iterations() const override { return iterations_; }

  void accept() override {
    history_.record(trial_h_, delta_);
    Base::take();
    start_level();
  }

  void save(StateWriter& state) const override {
    z_.save(state);
    history_.save(state);
  }

  void restore(StateReader& state) override {
    Base::restore_state(state);
    history_.restore(state);
    start_level();
  }

  void restart(std::span<const double> z) override {
    Base::stand_at(Eigen::Map<const Vector>(z.data(), size_));
    history_ = VelocityHistory<Vector>(size_);
    start_level();
  }

private:
  void start_level() {
    factored_ = false;
    iterations_ = 0;
  }

  [[nodiscard]] NodeEnergy node_at(const Vector& z) override {
    NodeEnergy node;
    node.gamma = evaluator_.gamma(z.data(), node.energy);
    return node;
  }

  /// Whether what the last correction mended, h f - δ, was no more than its evaluation rounds at.
  bool residual_is_rounding(double h) {
    constexpr double unit = 0.5 * std::numeric_limits<double>::epsilon();
    // δ before the correction, and the midpoint made of it, are rounded.
    rounding_point_ = point_.cwiseAbs() + delta_.cwiseAbs();
    gradient_rounding_.run(as_span(point_), as_span(rounding_point_));
    const auto n = static_cast<std::size_t>(size_) / 2;
    for (std::size_t i = 0; i < 2 * n; ++i) {
      const auto row = static_cast<Eigen::Index>(i);
      const double residual = std::abs(h * f_[row] - (delta_[row] - correction_[row]));
      const double slope_bound = gradient_rounding_.bound(1 + (i < n ? n + i : i - n));
      if (!(residual <= 2.0 * unit * (std::abs(h) * slope_bound + 4.0 * std::abs(delta_[row])))) {
        return false;
      }
    }
    return true;
  }

  void predict(double h) {
    if (!history_.empty()) {
      history_.predict(h, delta_);
      return;
    }
    evaluator_.gradient(z_.value().data(), gradient_.data());
    apply_j(gradient_, f_);
    delta_ = h * f_;
  }

  /// Factors I - ½h J H_zz at the middle of the present δ.
  bool factor(double h) {
    z_.displaced(0.5, delta_, point_);
    factored_ = matrix_.factor(evaluator_, point_.data(), h) == Status::success;
    ++iterations_;
    factored_h_ = h;
    contraction_ = std::numeric_limits<double>::infinity();
    return factored_;
  }

  formula::SumSizeEvaluator energy_size_;
  formula::RoundingEvaluator gradient_rounding_;
  Eigen::Index size_;
  VelocityHistory<Vector> history_;

  Vector rate_, correction_, point_, gradient_, f_, rounding_point_;  ///< rate_ = dδ/dh along the solved step
  Matrix matrix_;
  bool factored_ = false;  ///< whether there is a matrix, and a trial step, for this level
  double factored_h_ = 0.0;
  double contraction_ = 0.0;                ///< seen with the matrix, or to be expected of one for another h
  double trial_h_ = 0.0, last_size_ = 0.0;  ///< of the last trial: h, and the last correction's relative size
  double energy_ = 0.0;
  double slope_ = 0.0;
  int iterations_ = 0;
};

template <int Size>
std::unique_ptr<OneStepScheme> dense_scheme(const Hamiltonian& hamiltonian, std::span<const double> z_0) {
  using Matrix = DenseStepMatrix<Size>;
  return std::make_unique<MidpointScheme<Size, Matrix>>(hamiltonian, z_0, Matrix(hamiltonian));
}

}  // namespace

std::unique_ptr<OneStepScheme> make_midpoint_scheme(const Hamiltonian& hamiltonian, std::span<const double> z_0) {
  if (!hamiltonian.constraints().none()) {
    return make_constrained_midpoint(hamiltonian, z_0);
  }
  check_initial_state(hamiltonian, z_0);
  switch (z_0.size()) {
    case 2: return dense_scheme<2>(hamiltonian, z_0);
    case 4: return dense_scheme<4>(hamiltonian, z_0);
    case 6: return dense_scheme<6>(hamiltonian, z_0);
    default: break;
  }
  if (std::optional<HessianBand> band = HessianBand::of(hamiltonian)) {
    using Scheme = MidpointScheme<Eigen::Dynamic, BandStepMatrix>;
    return std::make_unique<Scheme>(hamiltonian, z_0, BandStepMatrix(*std::move(band)));
  }
  return dense_scheme<Eigen::Dynamic>(hamiltonian, z_0);
}

}  // namespace rubato
