#include <rubato/ode/gauss_scheme.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

#include <rubato/formula/batch.hpp>
#include <rubato/ode/increment.hpp>
#include <rubato/ode/one_step_state.hpp>
#include <rubato/ode/stage_newton.hpp>
#include <rubato/solve/small_matrices.hpp>
#include <rubato/variation/gauss_tableau.hpp>

namespace rubato {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Rows = StageNewton::Rows;

constexpr int most_gauss_iterations = 100;
/// A fixed-point iteration that shrinks its corrections by less gives way to Newton's. By how much is a matter of what
/// both cost, between these (corrections that shrink by less than half count as rounding): to digits_to_go digits by
/// the first, or in newton_corrections by the second.
constexpr double slow_contraction = 0.2, slowest_contraction = 0.5;
constexpr double digits_to_go = 12.0, newton_corrections = 5.0;
/// What an instruction of a formula takes, for all stages side by side, in the operations of a factorisation.
constexpr double operations_of_instruction = 10.0;
/// Newton's iteration stays while steps are at least this part of the one that asked for it.
constexpr double back_to_fixed_point = 0.5;
/// E_k is told from its neighbours by terms of order h^s, and its slope with it: a trial that is not the last is solved
/// nearly as well as the last.
constexpr double loosest = 1e-13;
/// What the next correction would mend, relative, by the contraction seen so far, at which a trial is solved well
/// enough; and one that may be the last, whose leftovers, of one sign, must not add up.
constexpr double loose_leftover = 0.5 * std::numeric_limits<double>::epsilon();
constexpr double least_leftover = 1e-3 * std::numeric_limits<double>::epsilon();
/// A correction larger than this shows how fast corrections contract, and one larger than the second about how fast.
constexpr double measurable = 1e-13, visible = 4e-15;
/// Corrections of this size are lost in rounding.
constexpr double lost_correction = 0.5 * std::numeric_limits<double>::epsilon();
/// Relative change of h that asks for another matrix.
constexpr double refactor_ratio = 0.03;
/// A step this many times longer or shorter than the last one is not begun from its polynomial.
constexpr double longest_continuation = 3.0;

/// Trial steps at one level that are kept to begin others from, and the largest weight that one may have.
constexpr std::size_t most_trials = 4;
constexpr double farthest_extrapolation = 20.0;

/// J∇H at the stages, and H there.
class StageEvaluator {
public:
  StageEvaluator(const Hamiltonian& hamiltonian, int stages)
      : evaluate_(hamiltonian.gradient_code()), outputs_(hamiltonian.gradient_code().output_count(), stages) {}

  void operator()(const Rows& Z, Rows& f, VectorXd& energies) {
    in_.clear();
    out_.clear();
    for (Index r = 0; r < Z.rows(); ++r) {
      in_.push_back(Z.row(r).data());
    }
    for (Index r = 0; r < outputs_.rows(); ++r) {
      out_.push_back(outputs_.row(r).data());
    }
    evaluate_(static_cast<std::size_t>(Z.cols()), in_, out_);
    const Index n = Z.rows() / 2;
    energies = outputs_.row(0).transpose();
    f.topRows(n) = outputs_.bottomRows(n);
    f.bottomRows(n) = -outputs_.middleRows(1, n);
  }

private:
  formula::BatchEvaluator evaluate_;
  Rows outputs_;  ///< H, then ∇H
  std::vector<const double*> in_;
  std::vector<double*> out_;
};

class GaussScheme final : public OneStepState<VectorXd> {
public:
  GaussScheme(const Hamiltonian& hamiltonian, int stages, std::span<const double> z_0)
      : OneStepState(hamiltonian, z_0),
        tableau_(stages),
        stages_(hamiltonian, stages),
        energy_size_(hamiltonian.size_code()),
        rounding_(hamiltonian.gradient_code()),
        m_(stages),
        size_(static_cast<Index>(z_0.size())) {
    for (Rows* rows : {&Y_, &Z_, &f_, &last_f_, &trial_f_, &base_, &miss_, &next_, &correction_, &bounds_}) {
      rows->setZero(size_, m_);
    }
    for (Trial& trial : trials_) {
      trial.gap.setZero(size_, m_);
    }
    for (VectorXd* vector : {&lost_, &largest_, &point_, &gradient_, &errors_}) {
      vector->setZero(size_);
    }
    of_stages_ = solve::quotient(tableau_.a.transpose(), tableau_.b).value();
    energies_.setZero(m_);
    weights_.setZero(m_, m_);
    end_weights_.setZero(m_, m_);
    if (size_ <= StageNewton::most_components) {
      hessian_.setZero(size_, size_);
      stage_newton_.emplace(tableau_, size_);
      slow_ = contraction_worth_newton(hamiltonian);
    }
  }

  [[nodiscard]] int order() const override { return static_cast<int>(2 * m_); }
  [[nodiscard]] bool has_node_law() const override { return false; }

  [[nodiscard]] Status advance(double h, double accuracy) override {
    forget_trial();
    if (newton_ && std::abs(h) < back_to_fixed_point * newton_step_) {
      newton_ = false;
    }
    bool continued = start(h);
    Status status = iterate(h, accuracy);
    if (status != Status::success && stage_newton_.has_value()) {
      // Newton's iteration from the same start, and from the tangent.
      if (!newton_) {
        newton_ = true;
        newton_step_ = std::abs(h);
        continued = start(h);
        status = iterate(h, accuracy);
      }
      if (status != Status::success && continued) {
        start_on_tangent(h);
        status = iterate(h, accuracy);
      }
    }
    trial_h_ = h;
    if (status == Status::success) {
      finish(h);
      remember(h);
    }
    return status;
  }

  [[nodiscard]] double discrete_energy() const override { return energy_; }
  [[nodiscard]] double discrete_energy_slope() const override { return slope_by_nodes(energy_, trial_h_); }
  [[nodiscard]] bool slope_to_leading_order() const override { return true; }
  [[nodiscard]] formula::SumSize energy_size() override {
    z_.displaced(0.5, delta_, point_);
    errors_ = 2.0 * (point_.cwiseAbs() + delta_.cwiseAbs());  // stages are rounded, and known to about an ε of δ
    return energy_size_(as_span(std::as_const(point_)), as_span(std::as_const(errors_)));
  }
  [[nodiscard]] int iterations() const override { return iterations_; }

  void accept() override {
    largest_ = largest_.cwiseMax(delta_.cwiseAbs());
    missed_ = last_h_ != 0.0 && near(trial_h_ / last_h_);
    if (missed_) {
      continue_last(trial_h_);
      miss_ = Y_ - base_;
    }
    take(lost_);
    std::swap(last_f_, f_);
    last_h_ = trial_h_;
    start_level();
  }
  void restart(std::span<const double> z) override {
    stand_at(Eigen::Map<const VectorXd>(z.data(), size_));
    largest_.setZero();
    last_h_ = newton_step_ = 0.0;
    newton_ = missed_ = false;
    start_level();
  }

  void save(StateWriter& state) const override {
    z_.save(state);
    for (const double value : {last_h_, static_cast<double>(newton_), newton_step_, static_cast<double>(missed_)}) {
      state.write(value);
    }
    state.write(as_span(largest_));
    for (const Rows* rows : {&last_f_, &miss_}) {
      state.write({rows->data(), static_cast<std::size_t>(rows->size())});
    }
  }
  void restore(StateReader& state) override {
    restore_state(state);
    state.read(last_h_);
    state.read(newton_);
    state.read(newton_step_);
    state.read(missed_);
    state.read(as_span(largest_));
    for (Rows* rows : {&last_f_, &miss_}) {
      state.read(std::span<double>(rows->data(), static_cast<std::size_t>(rows->size())));
    }
    start_level();
  }

private:
  [[nodiscard]] LevelNode node_at(const VectorXd& z) override {
    return {evaluator_.value(z.data()), std::numeric_limits<double>::quiet_NaN()};
  }

  void start_level() {
    known_ = replaced_ = 0;
    contraction_ = std::numeric_limits<double>::infinity();
    factored_h_ = 0.0;
    iterations_ = 0;
  }

  /// The stages to begin with: by the trials already made at this level, by the last step's polynomial, or on the
  /// tangent. \return whether by what was made before
  bool start(double h) {
    if (known_ > 0 && near(h / trials_[0].h)) {
      tableau_.continuation(tableau_.from_start, h / trials_[0].h, weights_);
      base_ = trials_[0].h * trial_f_.lazyProduct(weights_.transpose());
      Y_ = base_;
      add_gap(h);
    } else if (last_h_ != 0.0 && near(h / last_h_)) {
      continue_last(h);
      Y_ = base_;
      if (missed_) {
        Y_ += std::pow(h / last_h_, static_cast<int>(m_) + 1) * miss_;
      }
    } else {
      start_on_tangent(h);
      return false;
    }
    return true;
  }
  /// The collocation polynomial of the last step, at the stages of one that follows it.
  void continue_last(double h) {
    if (const double ratio = h / last_h_; ratio != end_ratio_) {  // equal steps have one
      tableau_.continuation(tableau_.from_end, ratio, end_weights_);
      end_ratio_ = ratio;
    }
    base_ = last_h_ * last_f_.lazyProduct(end_weights_.transpose());
  }
  /// What the polynomial of the first trial leaves of the stages of a step of length h: by Lagrange's interpolation
  /// over the trials, of which the first leaves nothing.
  void add_gap(double h) {
    std::array<double, most_trials> factors{};
    double largest = 0.0;
    for (std::size_t i = 1; i < known_; ++i) {
      factors[i] = 1.0;
      for (std::size_t j = 0; j < known_; ++j) {
        if (j != i) {
          factors[i] *= (h - trials_[j].h) / (trials_[i].h - trials_[j].h);
        }
      }
      largest = std::max(largest, std::abs(factors[i]));
    }
    for (std::size_t i = 1; i < known_ && largest < farthest_extrapolation; ++i) {
      Y_ += factors[i] * trials_[i].gap;
    }
  }
  /// Keeps the trial for others at this level; its stages are those with the last correction.
  void remember(double h) {
    if (known_ == 0) {
      trial_f_ = f_;
      trials_[0].h = h;
      known_ = 1;
      return;
    }
    const auto same = std::find_if(trials_.begin(), trials_.begin() + static_cast<std::ptrdiff_t>(known_),
                                   [h](const Trial& trial) { return trial.h == h; });
    if (same != trials_.begin() + static_cast<std::ptrdiff_t>(known_) || !near(h / trials_[0].h)) {
      return;
    }
    const std::size_t place = known_ < most_trials ? known_++ : 1 + replaced_++ % (most_trials - 1);
    tableau_.continuation(tableau_.from_start, h / trials_[0].h, weights_);
    trials_[place].h = h;
    trials_[place].gap = Y_ - trials_[0].h * trial_f_.lazyProduct(weights_.transpose());
  }
  void start_on_tangent(double h) {
    evaluator_.gradient(z_.value().data(), gradient_.data());
    apply_j(gradient_, point_);
    Y_.noalias() = h * point_ * tableau_.c.transpose();
  }
  [[nodiscard]] static bool near(double ratio) {
    return ratio > 1.0 / longest_continuation && ratio < longest_continuation;
  }

  [[nodiscard]] Status iterate(double h, double accuracy) {
    if (newton_ && !factor(h)) {
      return Status::undefined;
    }
    StagnationTest test(std::min(accuracy, loosest));
    const double leftover = accuracy > 0.0 ? loose_leftover : newton_ ? least_leftover : 0.0;
    double last = std::numeric_limits<double>::infinity(), last_residual = last, rate = slowest_contraction;
    for (int iteration = 0; iteration < most_gauss_iterations; ++iteration) {
      sweep(h);
      const double residual = relative_size();
      if (newton_) {
        stage_newton_->solve(correction_);
      }
      const double size = newton_ ? relative_size() : residual;
      if (!std::isfinite(size) || !energies_.allFinite()) {
        return Status::undefined;
      }
      Y_ += correction_;
      if (last < 1.0 && size > measurable) {
        contraction_ = std::max(size / last, residual / last_residual);
      }
      const double outdated = newton_ ? std::abs(h - factored_h_) / std::abs(h) : 0.0;
      if (std::max(contraction_, outdated) * size <= leftover) {
        return Status::success;
      }
      if (size > visible) {
        rate = size / last;
      }
      const auto verdict = test.judge(size, residual);
      if (verdict == StagnationTest::Verdict::done || (verdict == StagnationTest::Verdict::stalled && is_rounding(h))) {
        if (!newton_ && accuracy == 0.0) {
          settle(h, std::min(rate, slowest_contraction));
        }
        return Status::success;
      }
      if (!newton_ && iteration > 1 && size > slow_ * last && verdict != StagnationTest::Verdict::again) {
        return Status::not_converged;
      }
      if (newton_ && verdict == StagnationTest::Verdict::slow && iteration > most_gauss_iterations / 2) {
        return Status::not_converged;
      }
      last = size;
      last_residual = residual;
    }
    return Status::not_converged;
  }

  /// What the stages Y_ leave of their equations, as next_ and correction_.
  void sweep(double h) {
    for (Index i = 0; i < m_; ++i) {
      z_.displaced(1.0, Y_.col(i), point_);
      Z_.col(i) = point_;
    }
    stages_(Z_, f_, energies_);
    ++iterations_;
    next_ = f_.lazyProduct(tableau_.a_rest.transpose());
    next_ += f_.lazyProduct(tableau_.a_short.transpose());
    next_ = h * next_ - Y_;
    correction_ = next_;
  }

  /// Corrections that are lost in rounding may still have one sign in many steps, and where they shrink slowly what is
  /// left of them is not much less. Further sweeps leave next to nothing of it.
  void settle(double h, double rate) {
    for (double left = rate * lost_correction; left > least_leftover; left *= rate) {
      sweep(h);
      Y_ += correction_;
    }
  }

  /// Corrections relative to the increments, each component in units of its own. A component that is 0 with slope 0 at
  /// the start has no unit but its first correction.
  [[nodiscard]] double relative_size() const {
    double result = 0.0;
    for (Index r = 0; r < size_; ++r) {
      const double scale =
          std::max({Y_.row(r).cwiseAbs().maxCoeff(), largest_[r], correction_.row(r).cwiseAbs().maxCoeff(),
                    std::numeric_limits<double>::epsilon() * std::abs(z_.value()[r])});
      const double correction = correction_.row(r).cwiseAbs().sum();
      result = larger(result, correction == 0.0 ? 0.0 : correction / scale);
    }
    return result;
  }

  /// Whether what the last corrections mended is no more than what the evaluation of the stages rounds at.
  [[nodiscard]] bool is_rounding(double h) {
    constexpr double unit = 0.5 * std::numeric_limits<double>::epsilon();
    const Index n = size_ / 2;
    for (Index i = 0; i < m_; ++i) {
      point_ = Z_.col(i);
      errors_ = point_.cwiseAbs() + Y_.col(i).cwiseAbs();
      rounding_.run(as_span(std::as_const(point_)), as_span(std::as_const(errors_)));
      for (Index r = 0; r < size_; ++r) {
        bounds_(r, i) = rounding_.bound(static_cast<std::size_t>(1 + (r < n ? n + r : r - n)));
      }
    }
    for (Index i = 0; i < m_; ++i) {
      for (Index r = 0; r < size_; ++r) {
        const double slopes = tableau_.a.row(i).cwiseAbs().dot(bounds_.row(r));
        if (!(std::abs(next_(r, i)) <= 2.0 * unit * (std::abs(h) * slopes + 4.0 * std::abs(Y_(r, i))))) {
          return false;
        }
      }
    }
    return true;
  }

  /// The contraction at which as many operations lead to the last digit by either iteration.
  [[nodiscard]] double contraction_worth_newton(const Hamiltonian& hamiltonian) const {
    const auto instructions = [](const formula::Bytecode& code) {
      return operations_of_instruction * static_cast<double>(code.instructions().size());
    };
    const double products = 4.0 * static_cast<double>(m_ * m_ * size_);
    const double sweep = instructions(hamiltonian.gradient_code()) + products;
    const double newton = instructions(hamiltonian.hessian_code()) + stage_newton_->factor_operations() +
                          newton_corrections * (sweep + stage_newton_->solve_operations());
    return std::clamp(std::pow(10.0, -digits_to_go * sweep / newton), slow_contraction, slowest_contraction);
  }

  /// Factors what Newton's corrections take, H_zz in the middle of the stages to begin with.
  [[nodiscard]] bool factor(double h) {
    if (std::abs(h - factored_h_) <= refactor_ratio * std::abs(h)) {
      return true;
    }
    const VectorXd& b = tableau_.b;
    delta_ = Y_.lazyProduct(b);
    z_.displaced(1.0, delta_, point_);
    evaluator_.hessian(point_.data(), gradient_.data(), hessian_.data());
    ++iterations_;
    if (stage_newton_->factor(h, hessian_) != Status::success) {
      return false;
    }
    factored_h_ = h;
    return true;
  }

  /// δ with what its rounding loses, and E, from the stages last evaluated.
  void finish(double h) {
    for (Index r = 0; r < size_; ++r) {
      long double sum = 0.0L;
      for (Index i = 0; i < m_; ++i) {
        sum += (static_cast<long double>(tableau_.b_short[i]) + static_cast<long double>(tableau_.b_rest[i])) *
               static_cast<long double>(f_(r, i));
      }
      sum *= static_cast<long double>(h);
      if (newton_) {
        // f at the corrected stages, to first order: what A of it mends is the correction less the residual.
        for (Index i = 0; i < m_; ++i) {
          sum += static_cast<long double>(of_stages_[i] * (correction_(r, i) - next_(r, i)));
        }
      }
      delta_[r] = static_cast<double>(sum);
      lost_[r] = static_cast<double>(sum - static_cast<long double>(delta_[r]));
    }
    long double energy = 0.0L;
    for (Index i = 0; i < m_; ++i) {
      energy += (static_cast<long double>(tableau_.b_short[i]) + static_cast<long double>(tableau_.b_rest[i])) *
                static_cast<long double>(energies_[i]);
    }
    // To first order at the corrected stages; ∇H = -Jf.
    const Index n = size_ / 2;
    for (Index i = 0; i < m_; ++i) {
      energy += static_cast<long double>(tableau_.b[i]) *
                static_cast<long double>(f_.col(i).head(n).dot(correction_.col(i).tail(n)) -
                                         f_.col(i).tail(n).dot(correction_.col(i).head(n)));
    }
    energy_ = static_cast<double>(energy);
  }

  GaussTableau tableau_;
  StageEvaluator stages_;
  formula::SumSizeEvaluator energy_size_;
  formula::RoundingEvaluator rounding_;
  Index m_, size_;
  Rows Y_, Z_, f_, last_f_;  ///< Z_i - z_k, Z_i, J∇H(Z_i), and that of the last step
  Rows base_, miss_;         ///< Y by a polynomial continued; what the last step's left of the present one's
  bool missed_ = false;      ///< whether miss_ is known
  struct Trial {
    double h = 0.0;
    Rows gap;  ///< Y less what the polynomial of the first trial makes of it
  };
  std::array<Trial, most_trials> trials_;  ///< at this level; the first always stays
  Rows trial_f_;                           ///< J∇H at the stages of the first
  std::size_t known_ = 0, replaced_ = 0;
  Rows next_, correction_, bounds_;  ///< what the stages leave of their equations, what corrects it, and rounding
  VectorXd energies_;
  VectorXd of_stages_;  ///< A⁻ᵀb: δ = Σ (A⁻ᵀb)_i Y_i
  VectorXd lost_, largest_, point_, gradient_, errors_;
  MatrixXd weights_, hessian_;
  MatrixXd end_weights_;  ///< of a continuation from the end of a step to one end_ratio_ times as long
  double end_ratio_ = 0.0;
  std::optional<StageNewton> stage_newton_;
  double slow_ = slowest_contraction;
  double contraction_ = std::numeric_limits<double>::infinity();  ///< of corrections at this level, where it was seen
  bool newton_ = false;
  double newton_step_ = 0.0;  ///< |h| at which fixed-point iteration was too slow
  double trial_h_ = 0.0, last_h_ = 0.0, factored_h_ = 0.0;
  double energy_ = 0.0;
  int iterations_ = 0;
};

}  // namespace

std::unique_ptr<OneStepScheme> make_gauss_scheme(const Hamiltonian& hamiltonian, int stages,
                                                 std::span<const double> z_0) {
  check_initial_state(hamiltonian, z_0);
  return std::make_unique<GaussScheme>(hamiltonian, stages, z_0);
}

}  // namespace rubato
