#include <rubato/ode/gauss_scheme.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

#include <rubato/ode/increment.hpp>
#include <rubato/ode/one_step_state.hpp>
#include <rubato/ode/stage_kernels.hpp>
#include <rubato/ode/stage_newton.hpp>
#include <rubato/ode/stage_slopes.hpp>
#include <rubato/ode/stage_tangent.hpp>
#include <rubato/ode/tuning.hpp>
#include <rubato/solve/small_matrices.hpp>
#include <rubato/variation/gauss_tableau.hpp>

namespace rubato {

namespace {

using namespace tuning::gauss;

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Rows = StageSlopes::Rows;

class GaussScheme final : public OneStepState<VectorXd> {
public:
  GaussScheme(const Hamiltonian& hamiltonian, int stages, std::span<const double> z_0)
      : OneStepState(hamiltonian, z_0),
        tableau_(stages),
        m_(stages),
        size_(static_cast<Index>(z_0.size())),
        Z_(zero_rows(size_)),
        f_(zero_rows(size_)),
        slopes_(hamiltonian, Z_, f_),
        tangent_(hamiltonian, tableau_),
        energy_size_(hamiltonian.size_code()),
        rounding_(hamiltonian.gradient_code()) {
    for (Rows* rows : {&Y_, &last_f_, &trial_f_, &base_, &miss_, &next_, &correction_, &bounds_, &next_bounds_}) {
      *rows = zero_rows(size_);
    }
    for (Trial& trial : trials_) {
      trial.gap = zero_rows(size_);
    }
    for (Rows* table : {&first_, &second_, &end_table_, &trial_table_, &from_start_, &from_end_, &powers_,
                        &square_first_, &square_second_}) {
      *table = zero_rows(m_);
    }
    nodes_ = zero_rows(1);
    first_.leftCols(m_) = tableau_.a_rest.transpose();
    second_.leftCols(m_) = tableau_.a_short.transpose();
    if (slopes_.has_linear_velocities()) {
      const GaussTableau::Square square = tableau_.square();
      square_first_.leftCols(m_) = square.a_rest.transpose();
      square_second_.leftCols(m_) = square.a_short.transpose();
      node_short_ = square.c_short;
      node_rest_ = square.c_rest;
      carried_ = carried_rest_ = zero_rows(size_ / 2);
    }
    for (VectorXd* vector : {&lost_, &largest_, &floor_, &point_, &gradient_, &errors_}) {
      vector->setZero(size_);
    }
    for (Index i = 0; i < m_; ++i) {
      b_[static_cast<std::size_t>(i)] =
          static_cast<long double>(tableau_.b_short[i]) + static_cast<long double>(tableau_.b_rest[i]);
    }
    of_stages_ = solve::quotient(tableau_.a.transpose(), tableau_.b).value();
    from_start_.leftCols(m_) = tableau_.from_start.transpose();
    from_end_.leftCols(m_) = tableau_.from_end.transpose();
    nodes_.leftCols(m_) = tableau_.c.transpose();
    stage_newton_ = StageNewton::of(tableau_, hamiltonian);
    if (stage_newton_) {
      slow_ = contraction_worth_newton(hamiltonian);
    }
    start_level();
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
      if (status != Status::success && accuracy == 0.0) {
        status = approach(h);
      }
    }
    return end_trial(status, h);
  }

  [[nodiscard]] Status advance_to(std::span<const double> z_1, double h) override {
    forget_trial();
    Status status = Status::not_converged;
    for (const bool newton : {false, true}) {
      if (status != Status::success && (!newton || stage_newton_.has_value())) {
        newton_ = newton;
        newton_step_ = std::abs(h);
        start_on_cubic(z_1, h);
        status = iterate(h, 0.0);
      }
    }
    return end_trial(status, h);
  }

  [[nodiscard]] Status tangent(std::span<double> columns) override {
    place_stages(0, size_);
    return tangent_(evaluator_, Z_, trial_h_, columns);
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
    steps_by_newton_ = newton_ ? steps_by_newton_ + 1 : 0;
    if (steps_by_newton_ >= most_by_newton) {
      newton_ = false;  // it may contract here
      steps_by_newton_ = 0;
    }
    largest_ = largest_.cwiseMax(delta_.cwiseAbs());
    missed_ = last_h_ != 0.0 && near(trial_h_ / last_h_);
    if (missed_) {
      continue_last(trial_h_);
      miss_.topRows(begun()) = Y_.topRows(begun()) - base_.topRows(begun());
      miss_.bottomRows(size_ - begun()).setZero();
    }
    take(lost_);
    last_f_ = f_;
    last_h_ = trial_h_;
    base_h_ = 0.0;
    start_level();
  }
  void restart(std::span<const double> z) override {
    stand_at(Eigen::Map<const VectorXd>(z.data(), size_));
    largest_.setZero();
    last_h_ = newton_step_ = base_h_ = 0.0;
    newton_ = missed_ = false;
    steps_by_newton_ = 0;
    start_level();
  }

  void save(StateWriter& state) const override {
    z_.save(state);
    for (const double value : {last_h_, static_cast<double>(newton_), newton_step_,
                               static_cast<double>(steps_by_newton_), static_cast<double>(missed_)}) {
      state.write(value);
    }
    state.write(as_span(largest_));
    for (const Rows* rows : {&last_f_, &miss_}) {
      for (Index r = 0; r < size_; ++r) {
        state.write({rows->row(r).data(), static_cast<std::size_t>(m_)});
      }
    }
  }
  void restore(StateReader& state) override {
    restore_state(state);
    state.read(last_h_);
    state.read(newton_);
    state.read(newton_step_);
    state.read(steps_by_newton_);
    state.read(missed_);
    state.read(as_span(largest_));
    for (Rows* rows : {&last_f_, &miss_}) {
      for (Index r = 0; r < size_; ++r) {
        state.read(std::span<double>(rows->row(r).data(), static_cast<std::size_t>(m_)));
      }
    }
    base_h_ = 0.0;
    start_level();
  }

private:
  [[nodiscard]] NodeEnergy node_at(const VectorXd& z) override {
    return {evaluator_.value(z.data()), std::numeric_limits<double>::quiet_NaN()};
  }

  /// What the iteration found, as the trial.
  [[nodiscard]] Status end_trial(Status status, double h) {
    trial_h_ = h;
    if (status != Status::success) {
      return status;
    }
    finish(h);
    remember(h);
    return std::isfinite(energy_) ? status : Status::undefined;
  }

  void start_level() {
    known_ = replaced_ = 0;
    contraction_ = std::numeric_limits<double>::infinity();
    factored_h_ = 0.0;
    iterations_ = 0;
    floor_ = largest_.cwiseMax(std::numeric_limits<double>::epsilon() * z_.value().cwiseAbs());
  }

  /// Rows for so many components, or stages.
  [[nodiscard]] Rows zero_rows(Index count) const {
    return Rows::Zero(count, stages::row_length(static_cast<int>(m_)));
  }
  /// Whether stages of q alone are iterated, with those of p between: H = T(p) + V(q), by fixed-point iteration, which
  /// then contracts by the square of what it does else.
  [[nodiscard]] bool by_halves() const { return slopes_.has_halves() && !newton_; }
  /// The components that are iterated.
  [[nodiscard]] Index iterated() const { return by_halves() ? size_ / 2 : size_; }
  /// Whether of these T is a quadratic form, M⁻¹ = T_pp, so that stages of p can be left out until those of q are
  /// found: Q_i = q + h M⁻¹(c_i p + h Σ_j (A²)_ij p'_j).
  [[nodiscard]] bool at_once() const { return slopes_.has_linear_velocities() && !newton_; }
  /// Components whose stages are begun from those of the last step.
  [[nodiscard]] Index begun() const { return at_once() ? size_ / 2 : size_; }
  /// What mends Y.
  [[nodiscard]] const Rows& mending() const { return newton_ ? correction_ : next_; }

  /// to_r = factor Σ_j from_rj table_j, of the first `rows` rows.
  void combine(Index rows, const Rows& from, const Rows& table, double factor, Rows& to) const {
    stages::combine(static_cast<std::size_t>(rows), static_cast<int>(m_), from.data(), table.data(), nullptr, factor,
                    to.data());
  }
  /// h A f of `rows` rows from the one numbered `first`.
  void collocate(Index first, Index rows, double h, Rows& to) {
    stages::combine(static_cast<std::size_t>(rows), static_cast<int>(m_), f_.row(first).data(), first_.data(),
                    second_.data(), h, to.row(first).data());
  }
  void place_stages(Index first, Index rows) {
    stages::place(static_cast<std::size_t>(rows), static_cast<int>(m_), z_.value().data() + first,
                  z_.low().data() + first, Y_.row(first).data(), Z_.row(first).data());
  }
  [[nodiscard]] double relative_size(const Rows& correction) const {
    return stages::relative_size(static_cast<std::size_t>(iterated()), static_cast<int>(m_), Y_.data(),
                                 correction.data(), floor_.data());
  }

  /// The stages to begin with: by the trials already made at this level, by the last step's polynomial, or on the
  /// tangent. \return whether by what was made before
  bool start(double h) {
    if (known_ > 0 && near(h / trials_[0].h)) {
      tabulate_trial(h / trials_[0].h);
      combine(size_, trial_f_, trial_table_, trials_[0].h, Y_);
      add_gap(h);
    } else if (last_h_ != 0.0 && near(h / last_h_)) {
      const double ratio = h / last_h_;
      continue_last(h, !missed_ ? 0.0 : ratio == 1.0 ? 1.0 : std::pow(ratio, static_cast<int>(m_) + 1));
    } else {
      start_on_tangent(h);
      return false;
    }
    return true;
  }
  /// Weights of stage slopes by which the collocation polynomial leads to the stages of a step `ratio` times as long:
  /// column i has ∫_o^{o+θc_i} ℓ_j, from the powers of θc_i.
  void tabulate(const Rows& about, double ratio, Rows& table) {
    const Index lanes = stages::row_length(static_cast<int>(m_));
    double* power = powers_.data();
    for (Index i = 0; i < lanes; ++i) {
      power[i] = ratio * nodes_(0, i);
    }
    for (Index k = 1; k < m_; ++k, power += lanes) {
      for (Index i = 0; i < lanes; ++i) {
        power[lanes + i] = power[i] * powers_(0, i);
      }
    }
    combine(m_, about, powers_, 1.0, table);
  }
  /// About the start, of what is begun and kept with the same weights.
  void tabulate_trial(double ratio) {
    if (ratio != trial_ratio_) {
      tabulate(from_start_, ratio, trial_table_);
      trial_ratio_ = ratio;
    }
  }
  /// base_, the collocation polynomial of the last step at the stages of one that follows it.
  void continue_last(double h) {
    if (h == base_h_ && base_rows_ >= begun()) {
      return;
    }
    tabulate_end(h);
    combine(begun(), last_f_, end_table_, last_h_, base_);
    base_h_ = h;
    base_rows_ = begun();
  }
  /// And Y_, with so many times what that left of the last step's.
  void continue_last(double h, double weight) {
    tabulate_end(h);
    stages::begin(static_cast<std::size_t>(begun()), static_cast<int>(m_), last_f_.data(), end_table_.data(), last_h_,
                  miss_.data(), weight, base_.data(), Y_.data());
    base_h_ = h;
    base_rows_ = begun();
  }
  void tabulate_end(double h) {
    if (const double ratio = h / last_h_; ratio != end_ratio_) {  // equal steps have one
      tabulate(from_end_, ratio, end_table_);
      end_ratio_ = ratio;
    }
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
    tabulate_trial(h / trials_[0].h);
    trials_[place].h = h;
    combine(size_, trial_f_, trial_table_, trials_[0].h, trials_[place].gap);
    trials_[place].gap = Y_ - trials_[place].gap;
  }
  void start_on_tangent(double h) {
    evaluator_.gradient(z_.value().data(), gradient_.data());
    apply_j(gradient_, point_);
    Y_.setZero();  // also where there are no stages: an iteration may have left anything there
    Y_.leftCols(m_).noalias() = h * point_ * tableau_.c.transpose();
  }
  /// Hermite's, with J∇H at both ends.
  void start_on_cubic(std::span<const double> z_1, double h) {
    evaluator_.gradient(z_1.data(), gradient_.data());
    apply_j(gradient_, errors_);
    evaluator_.gradient(z_.value().data(), gradient_.data());
    apply_j(gradient_, point_);
    Y_.setZero();
    for (Index r = 0; r < size_; ++r) {
      const double change = z_1[static_cast<std::size_t>(r)] - z_.value()[r];
      for (Index i = 0; i < m_; ++i) {
        const double c = tableau_.c[i], rest = 1.0 - c;
        Y_(r, i) = c * (change + rest * (rest * (h * point_[r] - change) - c * (h * errors_[r] - change)));
      }
    }
  }
  /// A step that is found from nowhere else, through steps that double, of which the polynomial of each begins the
  /// next: along those solutions that begin at h = 0.
  [[nodiscard]] Status approach(double h) {
    double part = h / shortest_approach;
    start_on_tangent(part);
    Status status = iterate(part, tuning::loosest_trial);
    tabulate_trial(2.0);
    while (status == Status::success && part != h) {
      combine(size_, f_, trial_table_, part, Y_);
      part *= 2.0;
      status = iterate(part, part == h ? 0.0 : tuning::loosest_trial);
    }
    return status;
  }
  [[nodiscard]] static bool near(double ratio) {
    return ratio > 1.0 / tuning::longest_continuation && ratio < tuning::longest_continuation;
  }

  /// Solves for the stages from where they are begun, and evaluates what is left out of sweeps.
  [[nodiscard]] Status iterate(double h, double accuracy) {
    if (at_once()) {
      carry_momenta();
    }
    place_stages(0, iterated());
    const Status status = solve(h, accuracy);
    if (status == Status::success && at_once()) {
      find_momenta(h);
      slopes_.evaluate_velocities();
    }
    return status;
  }
  /// The stages of p, by the slopes last evaluated.
  void find_momenta(double h) {
    collocate(size_ / 2, size_ / 2, h, Y_);
    place_stages(size_ / 2, size_ / 2);
  }
  /// c_i p, in two parts.
  void carry_momenta() {
    const Index n = size_ / 2;
    for (Index r = 0; r < n; ++r) {
      const double high = z_.value()[n + r], low = z_.low()[n + r];
      for (Index i = 0; i < m_; ++i) {
        carried_(r, i) = node_short_[i] * high;
        carried_rest_(r, i) = node_rest_[i] * high + node_short_[i] * low;
      }
    }
  }

  [[nodiscard]] Status solve(double h, double accuracy) {
    if (newton_ && !factor(h)) {
      return Status::undefined;
    }
    StagnationTest test(std::min(accuracy, tuning::loosest_trial));
    const double leftover = accuracy > 0.0 ? loose_leftover : tuning::least_leftover;
    double last = std::numeric_limits<double>::infinity(), last_residual = last;
    double rate = std::min(contraction_, slowest_contraction);  // of another trial at this level, if there was one
    double expected = std::numeric_limits<double>::infinity();  // the size of the correction, beneath rounding too
    std::array<double, 2> before_last{last, last};              // newest first
    for (int iteration = 0; iteration < most_gauss_iterations; ++iteration) {
      double residual = sweep(h), size = residual;
      if (newton_) {
        correction_ = next_;
        stage_newton_->solve(correction_);
        size = relative_size(correction_);
        Y_ += correction_;
      }
      if (!std::isfinite(size)) {
        return Status::undefined;
      }
      const double ratio = size / last;
      if (last < 1.0 && size > measurable) {
        contraction_ = newton_ ? std::max(ratio, residual / last_residual) : ratio;
      }
      if (size > visible) {
        rate = ratio;
      }
      // Of what shrinks most slowly a little is seen at last, at any size.
      const double seen = newton_ ? contraction_ : std::max(contraction_, rate);
      expected = size > visible || newton_ || std::isinf(seen) ? size : seen * expected;
      const double outdated = newton_ ? std::abs(h - factored_h_) / std::abs(h) : 0.0;
      if (leaves_at_most(leftover, std::max(seen, outdated), expected)) {
        return Status::success;
      }
      const auto verdict = test.judge(size, residual);
      // Newton's corrections that shrink slowly may be rounding errors of a component that is 0 but for them.
      const bool may_be_rounding =
          verdict == StagnationTest::Verdict::stalled || (newton_ && verdict == StagnationTest::Verdict::slow);
      if (verdict == StagnationTest::Verdict::done || (may_be_rounding && is_rounding(h))) {
        if (!newton_ && accuracy == 0.0) {
          settle(h, std::min(rate, slowest_contraction), std::min(expected, lost_correction));
        }
        return Status::success;
      }
      // Corrections that turn while they shrink may hardly shrink once or twice, and much at the next time.
      const bool is_slow =
          size > slow_ * last && size > slow_ * slow_ * before_last[0] && size > slow_ * slow_ * slow_ * before_last[1];
      if (!newton_ && iteration > 1 && is_slow && verdict != StagnationTest::Verdict::again) {
        return is_rounding(h) ? Status::success : Status::not_converged;
      }
      before_last = {last, before_last[0]};
      if (newton_ && verdict == StagnationTest::Verdict::slow && iteration > most_gauss_iterations / 2) {
        return Status::not_converged;
      }
      last = size;
      last_residual = residual;
    }
    return Status::not_converged;
  }

  /// What is left of a correction in the increment that the sweep before it reported. Of q and p taken in turn the
  /// slopes of p were given by the uncorrected q: they know as much as half a sweep more would.
  [[nodiscard]] double left_after(double contraction) const {
    return by_halves() ? std::sqrt(contraction) : contraction;
  }
  /// left_after(contraction) size <= leftover, without a root.
  [[nodiscard]] bool leaves_at_most(double leftover, double contraction, double size) const {
    return by_halves() ? contraction * (size * size) <= leftover * leftover : contraction * size <= leftover;
  }

  /// What the stages Y_ leave of their equations, as next_, which is added to them unless Newton's correction is to be.
  /// \return its relative size
  double sweep(double h) {
    ++iterations_;
    const auto correct = [&](Index rows) {
      return stages::correct(static_cast<std::size_t>(rows), static_cast<int>(m_), f_.data(), first_.data(),
                             second_.data(), h, floor_.data(), z_.value().data(), z_.low().data(), Y_.data(),
                             next_.data(), Z_.data());
    };
    if (at_once()) {
      const auto n = static_cast<std::size_t>(size_ / 2);
      slopes_.evaluate_forces();
      stages::gather(n, static_cast<int>(m_), f_.row(size_ / 2).data(), square_first_.data(), square_second_.data(), h,
                     carried_.data(), carried_rest_.data(), slopes_.momenta().data());
      slopes_.evaluate_linear_velocities();
      return stages::mend(n, static_cast<int>(m_), slopes_.velocities().data(), h, floor_.data(), z_.value().data(),
                          z_.low().data(), Y_.data(), next_.data(), Z_.data());
    }
    if (by_halves()) {
      slopes_.evaluate_forces();
      find_momenta(h);
      slopes_.evaluate_velocities();
      return correct(size_ / 2);
    }
    if (newton_) {
      place_stages(0, size_);
    }
    slopes_.evaluate();
    if (!newton_) {
      return correct(size_);
    }
    collocate(0, size_, h, next_);
    next_ -= Y_;
    return relative_size(next_);
  }

  /// Corrections that are lost in rounding may still have one sign in many steps, and where they shrink slowly what is
  /// left of them is not much less. Further sweeps leave next to nothing of it.
  void settle(double h, double rate, double size) {
    for (double left = left_after(rate) * size; left > tuning::least_leftover; left *= rate) {
      static_cast<void>(sweep(h));
    }
  }

  /// Whether what the last corrections mended is no more than what the evaluation of the stages rounds at.
  [[nodiscard]] bool is_rounding(double h) {
    constexpr double unit = 0.5 * std::numeric_limits<double>::epsilon();
    const auto collected = [&](Index r, Index i) {
      return std::abs(h) * tableau_.a.row(i).cwiseAbs().dot(bounds_.row(r).head(m_));
    };
    if (at_once()) {
      find_momenta(h);
    }
    bound_slopes([](Index, Index) { return 0.0; });
    if (by_halves()) {  // stages of p have the rounding of the slopes that they were made of
      bound_slopes([&](Index r, Index i) { return r < size_ / 2 ? 0.0 : collected(r, i); });
    }
    for (Index i = 0; i < m_; ++i) {
      for (Index r = 0; r < iterated(); ++r) {
        const double allowed = 2.0 * unit * (collected(r, i) + 4.0 * std::abs(Y_(r, i)));
        if (!std::isfinite(allowed) || !(std::abs(next_(r, i)) <= allowed)) {
          return false;
        }
      }
    }
    return true;
  }
  /// bounds_, of the rounding of f at the stages. \param more (component, stage) ↦ what the stage errs by besides its
  /// own rounding and that of its increment; of p it may depend on the bounds for p'
  template <typename More>
  void bound_slopes(const More& more) {
    const Index n = size_ / 2;
    Rows& bounds = next_bounds_;
    for (Index i = 0; i < m_; ++i) {
      point_ = Z_.col(i);
      for (Index r = 0; r < size_; ++r) {
        errors_[r] = std::abs(point_[r]) + std::abs(Y_(r, i)) + more(r, i);
      }
      rounding_.run(as_span(std::as_const(point_)), as_span(std::as_const(errors_)));
      for (Index r = 0; r < size_; ++r) {
        bounds(r, i) = rounding_.bound(static_cast<std::size_t>(1 + (r < n ? n + r : r - n)));
      }
    }
    std::swap(bounds_, next_bounds_);
  }

  /// The contraction at which as many operations lead to the last digit by either iteration.
  [[nodiscard]] double contraction_worth_newton(const Hamiltonian& hamiltonian) const {
    const double sweep = cost_of_sweep + cost_of_instruction * static_cast<double>(slopes_.instructions()) +
                         cost_of_row * static_cast<double>(size_);
    const double parts = static_cast<double>((m_ + 1) / 2);
    const double newton = cost_of_instruction * static_cast<double>(hamiltonian.hessian_code().instructions().size()) +
                          (newton_corrections + 1.0) * parts * cost_of_part +
                          cost_of_operation * (stage_newton_->factor_operations() +
                                               newton_corrections * stage_newton_->solve_operations());
    return std::min(std::pow(10.0, -digits_to_go * sweep / (newton + newton_corrections * sweep)), slowest_contraction);
  }

  /// Factors what Newton's corrections take, H_zz in the middle of the stages to begin with.
  [[nodiscard]] bool factor(double h) {
    if (std::abs(h - factored_h_) <= refactor_ratio * std::abs(h)) {
      return true;
    }
    const VectorXd& b = tableau_.b;
    delta_ = Y_.leftCols(m_).lazyProduct(b);
    z_.displaced(1.0, delta_, point_);
    ++iterations_;
    if (stage_newton_->factor(evaluator_, point_.data(), h) != Status::success) {
      return false;
    }
    factored_h_ = h;
    return true;
  }

  /// δ with what its rounding loses, and E, from the stages last evaluated.
  void finish(double h) {
    for (Index r = 0; r < size_; ++r) {
      const double* const slopes = f_.row(r).data();
      long double sum = 0.0L;
      for (Index i = 0; i < m_; ++i) {
        sum += b_[static_cast<std::size_t>(i)] * static_cast<long double>(slopes[i]);
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
    const Index n = size_ / 2;
    for (Index i = 0; i < m_; ++i) {
      // To first order at the corrected stages; ∇H = -Jf.
      double mended = 0.0;
      for (Index r = 0; r < iterated(); ++r) {
        mended += (r < n ? -f_(r + n, i) : f_(r - n, i)) * mending()(r, i);
      }
      energy += b_[static_cast<std::size_t>(i)] *
                (static_cast<long double>(slopes_.energy(i, by_halves())) + static_cast<long double>(mended));
    }
    energy_ = static_cast<double>(energy);
  }

  GaussTableau tableau_;
  Index m_, size_;
  Rows Z_, f_;  ///< z_k + Y_i and J∇H there
  StageSlopes slopes_;
  StageTangent tangent_;
  formula::SumSizeEvaluator energy_size_;
  formula::RoundingEvaluator rounding_;
  Rows Y_, last_f_;      ///< Z_i - z_k; J∇H at the stages of the last step
  Rows base_, miss_;     ///< Y by a polynomial continued; what the last step's left of the present one's
  double base_h_ = 0.0;  ///< the step that base_ is of, by the last step; 0 for none
  Index base_rows_ = 0;  ///< how many of it
  bool missed_ = false;  ///< whether miss_ is known
  struct Trial {
    double h = 0.0;
    Rows gap;  ///< Y less what the polynomial of the first trial makes of it
  };
  std::array<Trial, most_trials> trials_;  ///< at this level; the first always stays
  Rows trial_f_;                           ///< J∇H at the stages of the first
  std::size_t known_ = 0, replaced_ = 0;
  Rows next_, correction_, bounds_,
      next_bounds_;                    ///< what the stages leave of their equations, Newton's correction, and rounding
  Rows first_, second_;                ///< A in two parts: rows of the weights of f_j
  Rows square_first_, square_second_;  ///< A² in two parts, likewise
  VectorXd node_short_, node_rest_;    ///< c in two parts
  Rows carried_, carried_rest_;        ///< c_i p in two parts
  Rows end_table_, trial_table_;       ///< weights of continuations, which are so many times as long
  double end_ratio_ = 0.0, trial_ratio_ = 0.0;
  std::array<long double, GaussTableau::most_stages> b_{};
  VectorXd of_stages_;  ///< A⁻ᵀb: δ = Σ (A⁻ᵀb)_i Y_i
  VectorXd lost_, largest_, point_, gradient_, errors_;
  VectorXd floor_;              ///< of a component, how large its increments are at least
  Rows from_start_, from_end_;  ///< collocation polynomials about both ends: row j, of f_j, by powers of the time
  Rows nodes_, powers_;         ///< c, and its powers for a table
  std::optional<StageNewton> stage_newton_;
  double slow_ = slowest_contraction;
  double contraction_ = std::numeric_limits<double>::infinity();  ///< of corrections at this level, where it was seen
  bool newton_ = false;
  double newton_step_ = 0.0;  ///< |h| at which fixed-point iteration was too slow
  int steps_by_newton_ = 0;
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
