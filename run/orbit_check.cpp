#include <rubato/run/orbit_check.hpp>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <ranges>
#include <span>
#include <utility>

#include <Eigen/Core>

#include <fmt/format.h>

#include <rubato/base/all_finite.hpp>
#include <rubato/base/interrupt.hpp>
#include <rubato/base/larger.hpp>
#include <rubato/formula/rounding.hpp>
#include <rubato/ode/discrete_lagrangian.hpp>
#include <rubato/ode/integrate.hpp>
#include <rubato/problem/formula_table.hpp>
#include <rubato/problem/orbit_problem.hpp>
#include <rubato/run/event_check.hpp>
#include <rubato/run/law.hpp>
#include <rubato/run/orbit_levels.hpp>
#include <rubato/run/output_check.hpp>
#include <rubato/run/tangent_check.hpp>
#include <rubato/variation/total_variation.hpp>

namespace rubato {

namespace {

using Eigen::Index;

/// The stored states of an orbit, row by row, each joined to (q, p).
class StoredStates {
public:
  StoredStates(const record::Reader& reader, const std::string& group, std::size_t degrees_of_freedom, std::size_t rows)
      : n_(degrees_of_freedom), q_(reader, group + "/q", n_), p_(reader, group + "/p", n_) {
    for (const StoredRows* part : {&q_, &p_}) {
      if (part->rows() != rows) {
        throw record::Error(reader.file(), fmt::format("{} has {} rows; {} stored levels do not fit together with that",
                                                       part->path(), part->rows(), rows));
      }
    }
  }

  [[nodiscard]] std::vector<double> z(std::size_t row) {
    const std::span<const double> q = q_.row(row);
    std::vector<double> state(q.begin(), q.end());
    const std::span<const double> p = p_.row(row);
    state.insert(state.end(), p.begin(), p.end());
    return state;
  }
  /// Where component i of z is stored.
  [[nodiscard]] const std::string& path(std::size_t i) const { return i < n_ ? q_.path() : p_.path(); }
  [[nodiscard]] std::size_t index(std::size_t i) const { return i % n_; }

private:
  std::size_t n_;
  StoredRows q_, p_;
};

class OrbitCheck {
public:
  OrbitCheck(const record::Reader& reader, const StoredLevels& levels, const Problem& problem, bool has_gamma,
             Disagreements& findings)
      : reader_(reader),
        levels_(levels),
        problem_(problem),
        has_gamma_(has_gamma),
        findings_(findings),
        orbit_(*problem.hamiltonian()),
        one_step_(!orbit_.next && !orbit_.L &&
                  (problem.scheme.lagrangian == LagrangianName::midpoint ||
                   problem.scheme.lagrangian == LagrangianName::generating)),
        n_(orbit_.q.size()),
        autonomous_(problem.scheme.lagrangian != LagrangianName::custom),
        invariants_(problem, orbit_.invariants, orbit_.formula_names()),
        exact_(problem, orbit_.exact, {"t"}),
        momentum_maps_(problem, momentum_maps_of(orbit_), orbit_.names()),
        constraints_(make_constraint_table(problem)),
        states_(reader, "/states", n_, levels.state_level.size()),
        size_(2 * n_, 0.0),
        scale_(2 * n_, 0.0),
        node_energy_(reader, "/levels/node_energy"),
        gamma_(reader, "/levels/gamma"),
        energy_(reader, "/levels/energy"),
        output_({nullptr, &reader}, levels, problem, 1, findings),
        events_({nullptr, &reader}, levels, problem, 1, findings),
        tangents_(reader, levels, problem, findings) {
    if (reader.has("/levels/rounding")) {  // records of earlier versions have none
      rounding_.emplace(reader, "/levels/rounding");
    }
    const SegmentLagrangian lagrangian = make_discretisation(problem);
    if (orbit_.L) {
      const Lagrangian L = make_lagrangian(problem);
      map_ = make_one_step_scheme(L, lagrangian, orbit_.initial.q, orbit_.initial.q_dot);
      energy_size_ = formula::SumSizeEvaluator(L.energy_size_code());
      velocities_.emplace(reader, "/states/q_dot", n_);
    } else {
      const Hamiltonian hamiltonian = make_hamiltonian(problem);
      gradient_size_.emplace(hamiltonian.gradient_code());
      energy_size_ = formula::SumSizeEvaluator(hamiltonian.size_code());
      law_.emplace(make_node_law(hamiltonian, lagrangian));
      if (method_of(lagrangian).is_map() || !orbit_.constraints.empty()) {
        map_ = make_one_step_scheme(hamiltonian, lagrangian, initial_state());
      } else {
        action_ = make_action(hamiltonian, lagrangian);
        gradient_.resize(static_cast<Index>(action_->element().size()));
      }
    }
    if (levels.sparse) {
      before_.emplace(reader, "/states/previous", n_, levels.state_level.size());
    }
    for (const std::string& name : invariants_.names()) {
      laws_.emplace_back(reader, "/laws/" + name);
    }
    for (const std::string& name : momentum_maps_.names()) {
      changes_.emplace_back(reader, Law(name).max_path());
      changes_.emplace_back(reader, Law(name).rms_path());
    }
    for (const std::string& name : constraint_laws(orbit_)) {
      constraint_columns_.emplace_back(reader, Law(name).max_path());
      constraint_columns_.emplace_back(reader, Law(name).rms_path());
    }
    for (const std::string& name : exact_.names()) {
      exacts_.emplace_back(reader, "/exact/" + name);
    }
  }

  Spread run() {
    find_scales();
    output_.check_times();
    std::vector<double> last;
    for (std::size_t row = 0; row < levels_.state_level.size(); ++row) {
      Interruptible::end_if_asked();
      const std::vector<double> z = states_.z(row);
      const bool whole = require_finite(states_, row, z);
      if (row == 0) {
        check_start(z);
      }
      std::vector<double> previous = before_ ? before_->z(row) : last;
      if (before_) {
        check_previous(row, previous, row == 0 ? z : last);
      }
      if (row > 0 && before_ && all_finite(previous)) {
        check_node(previous, levels_.state_level[row] - 1);
      }
      if (whole) {
        check_node(z, levels_.state_level[row]);
        check_velocities(z, row);
        output_.check_level(row, z);
        if (row == 0) {
          events_.begin(z);
          tangents_.begin();
        }
      }
      check_exact(row);
      if (row > 0 && whole && !previous.empty() && all_finite(previous)) {
        if (const auto step = levels_.step_to(row)) {
          check_momentum_maps(row, *step, previous, z);
          check_constraint_values(row, *step, z);
          map_ ? check_map(row, *step, previous, z) : check_step(row, *step, previous, z);
        }
        output_.check_step(row, previous, z);
        events_.check_step(row, previous, z);
        tangents_.check_step(row, previous, z);
      } else {
        last_corners_.clear();
      }
      last = z;
    }
    events_.finish();
    return equation_;
  }

private:
  /// The largest magnitude of each component, or of the terms that it changes by in a step where these cancel: no step
  /// determines a component better than their rounding error.
  void find_scales() {
    const auto enlarge = [this](std::size_t i, double value) {
      scale_[i] = std::isfinite(value) ? std::max(scale_[i], std::abs(value)) : scale_[i];
    };
    const std::vector<double> exact(2 * n_, 0.0);
    for (std::size_t row = 0; row < levels_.state_level.size(); ++row) {
      const std::vector<double> z = states_.z(row);
      for (std::size_t i = 0; i < z.size(); ++i) {
        size_[i] = std::isfinite(z[i]) ? std::max(size_[i], std::abs(z[i])) : size_[i];
        enlarge(i, z[i]);
      }
      if (gradient_size_ && row > 0) {
        const double h = levels_.state_t[row] - levels_.t_before(row);
        gradient_size_->run(z, exact);
        for (std::size_t i = 0; i < z.size(); ++i) {  // the bound is in units of 2⁻⁵³, half of epsilon
          enlarge(i, 0.5 * h * gradient_size_->bound(1 + (i < n_ ? i + n_ : i - n_)));
        }
      }
    }
  }

  bool require_finite(StoredStates& states, std::size_t row, const std::vector<double>& z) {
    for (std::size_t i = 0; i < z.size(); ++i) {
      if (!std::isfinite(z[i])) {
        findings_.add({.dataset = states.path(i),
                       .row = row,
                       .index = states.index(i),
                       .stored = z[i],
                       .reason = "a state is finite"});
      }
    }
    return all_finite(z);
  }

  [[nodiscard]] std::vector<double> initial_state() const {
    std::vector<double> start = orbit_.initial.q;
    start.insert(start.end(), orbit_.initial.p.begin(), orbit_.initial.p.end());
    return start;
  }

  void check_start(const std::vector<double>& z) {
    compare_states(states_, 0, z, initial_state(), "the initial state of the problem");
    if (orbit_.next && !levels_.sparse && levels_.state_level.size() > 1) {
      std::vector<double> next = orbit_.next->q;
      next.insert(next.end(), orbit_.next->p.begin(), orbit_.next->p.end());
      compare_states(states_, 1, states_.z(1), next, "[initial.next] of the problem");
    }
  }

  void compare_states(StoredStates& states, std::size_t row, const std::vector<double>& z,
                      const std::vector<double>& expected, const std::string& reason) {
    for (std::size_t i = 0; i < z.size(); ++i) {
      // What is read from a formula may differ by the rounding of a few operations from machine to machine.
      findings_.compare(
          states.path(i), row, states.index(i), z[i], expected[i],
          [&] { return Rounding::unit * std::abs(expected[i]); }, reason);
    }
  }

  void check_previous(std::size_t row, const std::vector<double>& previous, const std::vector<double>& neighbour) {
    require_finite(*before_, row, previous);
    if (row == 0 || levels_.follows(row)) {
      compare_states(*before_, row, previous, neighbour,
                     row == 0 ? "the first row repeats the start" : "the stored level before");
    }
  }

  /// H and Γ at z; of a problem stated by L, which has no formula for H, by its scheme. After that, formula_inputs().
  [[nodiscard]] NodeEnergy node_at(const std::vector<double>& z) {
    if (law_) {
      return (*law_)(z.data());
    }
    map_->restart(z);
    return map_->node();
  }
  /// What HamiltonianProblem::formula_names() names, at the z of node_at().
  [[nodiscard]] const std::vector<double>& formula_inputs(const std::vector<double>& z) {
    if (!orbit_.L) {
      return z;
    }
    const auto middle = z.begin() + static_cast<std::ptrdiff_t>(n_);
    inputs_.assign(z.begin(), middle);
    std::ranges::copy(map_->velocities(), std::back_inserter(inputs_));
    inputs_.insert(inputs_.end(), middle, z.end());
    return inputs_;
  }

  void check_velocities(const std::vector<double>& z, std::size_t row) {
    if (!velocities_) {
      return;
    }
    const auto evaluate = [this](const std::vector<double>& state, std::vector<double>& out) {
      static_cast<void>(node_at(state));
      std::ranges::copy(map_->velocities(), out.begin());
    };
    std::vector<double> found(n_), tolerances;
    evaluate(z, found);
    for (std::size_t i = 0; i < n_; ++i) {
      const auto tolerance = [&] {
        if (tolerances.empty()) {
          tolerances = Rounding::tolerances(z, scale_, {0}, n_, evaluate);
        }
        return tolerances[i];
      };
      findings_.compare(velocities_->path(), row, i, velocities_->row(row)[i], found[i], tolerance,
                        "from q and p of that level, by the Legendre transform");
    }
  }

  /// How far two evaluations of the node energy at z may differ, each by its rounding error: where terms of it cancel,
  /// that is more than displaced states show. Schemes evaluate it by other code than node_at().
  [[nodiscard]] double rounding_of_evaluations(const std::vector<double>& z) {
    if (orbit_.L) {
      static_cast<void>(node_at(z));
    }
    return 2.0 * energy_size_(std::span(formula_inputs(z)).first(2 * n_)).rounding;  // of (q, p), or (q, q̇)
  }

  /// H, Γ and the invariants at a level, where it has a row.
  void check_node(const std::vector<double>& z, std::size_t level) {
    const auto at = levels_.row_of(level);
    if (!at) {
      return;
    }
    const std::size_t outputs = 2 + laws_.size();
    const auto evaluate = [this](const std::vector<double>& state, std::vector<double>& out) {
      const NodeEnergy node = node_at(state);
      out[0] = node.energy;
      out[1] = law_ ? node.gamma / law_->gamma_factor() : node.gamma;
      std::ranges::copy(invariants_(formula_inputs(state)), out.begin() + 2);
    };
    std::vector<double> found(outputs), tolerances;
    evaluate(z, found);
    const auto tolerance = [&](std::size_t output) {
      return [&, output] {
        if (tolerances.empty()) {
          tolerances = Rounding::tolerances(z, scale_, {0}, outputs, evaluate);
        }
        return tolerances[output];
      };
    };
    const char* reason = "from the state at that level";
    findings_.compare(
        "/levels/node_energy", *at, {}, node_energy_.at(*at), found[0],
        [&] { return tolerance(0)() + rounding_of_evaluations(z); }, reason);
    if (has_gamma_) {
      findings_.compare("/levels/gamma", *at, {}, gamma_.at(*at), found[1], tolerance(1), reason);
    }
    const bool taken = problem_.laws.taken_at(level);
    for (std::size_t i = 0; i < laws_.size(); ++i) {
      findings_.compare(laws_[i].path(), *at, {}, laws_[i].at(*at),
                        taken ? found[2 + i] : std::numeric_limits<double>::quiet_NaN(), tolerance(2 + i),
                        taken ? reason : "[laws] every of the problem");
    }
  }

  /// By how much each momentum map changes in the step to a stored level.
  void check_momentum_maps(std::size_t row, std::size_t step, const std::vector<double>& z_0,
                           const std::vector<double>& z_1) {
    if (changes_.empty()) {
      return;
    }
    const std::size_t maps = changes_.size() / 2;
    const bool taken = problem_.laws.taken_at(levels_.state_level[row]);
    std::vector<double> inputs = z_0, scales = scale_, found(maps), tolerances;
    inputs.insert(inputs.end(), z_1.begin(), z_1.end());
    scales.insert(scales.end(), scale_.begin(), scale_.end());
    const auto evaluate = [&](const std::vector<double>& at, std::vector<double>& out) {
      const std::span<const double> values = momentum_maps_(std::span(at).first(2 * n_));
      std::ranges::copy(values, out.begin());
      const std::span<const double> after = momentum_maps_(std::span(at).last(2 * n_));
      for (std::size_t i = 0; i < maps; ++i) {
        out[i] = std::abs(after[i] - out[i]);
      }
    };
    evaluate(inputs, found);
    for (std::size_t i = 0; i < changes_.size(); ++i) {
      findings_.compare(
          changes_[i].path(), step, {}, changes_[i].at(step),
          taken ? found[i / 2] : std::numeric_limits<double>::quiet_NaN(),
          [&] {
            if (tolerances.empty()) {
              tolerances = Rounding::tolerances(inputs, scales, {0, 1}, maps, evaluate);
            }
            return tolerances[i / 2];
          },
          taken ? "from the states around the step" : "[laws] every of the problem");
    }
  }

  /// The constraints and their rates at a stored level.
  void check_constraint_values(std::size_t row, std::size_t step, const std::vector<double>& z) {
    const std::size_t values = constraint_columns_.size() / 2;
    if (values == 0) {
      return;
    }
    const bool taken = problem_.laws.taken_at(levels_.state_level[row]);
    const auto evaluate = [this](const std::vector<double>& state, std::vector<double>& out) {
      if (orbit_.L) {
        static_cast<void>(node_at(state));
      }
      std::ranges::transform(constraints_(formula_inputs(state)), out.begin(),
                             [](double value) { return std::abs(value); });
    };
    std::vector<double> found(values), tolerances;
    evaluate(z, found);
    for (std::size_t i = 0; i < constraint_columns_.size(); ++i) {
      findings_.compare(
          constraint_columns_[i].path(), step, {}, constraint_columns_[i].at(step),
          taken ? found[i / 2] : std::numeric_limits<double>::quiet_NaN(),
          [&] {
            if (tolerances.empty()) {
              tolerances = Rounding::tolerances(z, scale_, {0}, values, evaluate);
            }
            return tolerances[i / 2];
          },
          taken ? "from the state at that level" : "[laws] every of the problem");
    }
  }

  void check_exact(std::size_t row) {
    const double t = levels_.state_t[row];
    const std::span<const double> values = exact_({&t, 1});
    const std::vector<double> found(values.begin(), values.end());
    for (std::size_t i = 0; i < exacts_.size(); ++i) {
      findings_.compare(
          exacts_[i].path(), row, {}, exacts_[i].at(row), found[i],
          [&] {
            return Rounding::tolerances({t}, {std::abs(t)}, {0}, exacts_.size(),
                                        [this](const std::vector<double>& time, std::vector<double>& out) {
                                          std::ranges::copy(exact_(time), out.begin());
                                        })[i];
          },
          "[exact] of the problem");
    }
  }

  /// E_k, and after it what the two levels leave of Jδ - ∇Φ, in the order q, p: both from the first variation of the
  /// action, and from nothing else. With -½ z̄ᵀJδ before Φ the sum of its derivatives by both levels is ∇Φ - ½Jδ; the
  /// midpoint 𝕃 has p̄·(q_1 - q_0) in its place, whose sum is (0, δq).
  void evaluate_step(const std::vector<double>& corners, std::vector<double>& out) {
    const Element& element = action_->element();
    action_->gradient(corners, gradient_);
    out[0] = gradient_[static_cast<Index>(element.coordinate(0, 0))];
    if (!one_step_) {
      return;
    }
    const bool generating = problem_.scheme.lagrangian == LagrangianName::generating;
    for (std::size_t i = 0; i < 2 * n_; ++i) {
      const std::size_t other = i < n_ ? i + n_ : i - n_;
      const double delta = corners[element.value(1, other)] - corners[element.value(0, other)];
      const double share = i < n_ ? (generating ? -0.5 : -1.0) : (generating ? 0.5 : 0.0);
      out[1 + i] = gradient_[static_cast<Index>(element.value(0, i))] +
                   gradient_[static_cast<Index>(element.value(1, i))] + share * delta;
    }
  }

  /// A step that cannot be solved from nothing is approached from one of half the length, in ever smaller increments:
  /// the trials of a level begin where those before ended.
  [[nodiscard]] bool solve_from_nothing(double h) {
    constexpr int finest = 16;
    if (map_->advance(h, 0.0) == Status::success) {
      return true;
    }
    for (int parts = 1; parts <= finest; parts *= 2) {
      bool solved = true;
      for (int part = 0; part <= parts && solved; ++part) {
        const double share = 0.5 + 0.5 * static_cast<double>(part) / static_cast<double>(parts);
        solved = map_->advance(share * h, 0.0) == Status::success;
      }
      if (solved) {
        return true;
      }
    }
    return false;
  }

  /// E_k, and after it z_1 - ψ_h(z_0): the step of a one-step map taken again, begun with the cubic through both ends,
  /// and, where that does not lead to z_1, from nothing; not numbers where it cannot be taken.
  [[nodiscard]] std::vector<double> map_step(std::span<const double> z_0, std::span<const double> z_1, double h) {
    map_->restart(z_0);
    std::vector<double> joining = taken(map_->advance_to(z_1, h) == Status::success, z_1);
    if (distance(joining) <= elsewhere) {
      return joining;
    }
    map_->restart(z_0);
    std::vector<double> searched = taken(solve_from_nothing(h), z_1);
    return distance(searched) <= elsewhere || !std::isfinite(joining[0]) ? searched : joining;
  }
  [[nodiscard]] std::vector<double> taken(bool solved, std::span<const double> z_1) {
    std::vector<double> result(1 + 2 * n_, std::numeric_limits<double>::quiet_NaN());
    if (solved) {
      result[0] = map_->discrete_energy();
      map_->accept();
      std::ranges::transform(z_1, map_->state(), result.begin() + 1, std::minus());
    }
    return result;
  }
  /// The rounding error of E_k in the step of check_map()'s inputs, the more of both ways in which map_step() takes
  /// it.
  [[nodiscard]] double rounding_of_map(std::span<const double> inputs) {
    const std::size_t size = 2 * n_;
    const double h = inputs[size];
    double rounding = 0.0;
    for (const bool joins : {true, false}) {
      map_->restart(inputs.first(size));
      const bool solved =
          joins ? map_->advance_to(inputs.subspan(size + 1, size), h) == Status::success : solve_from_nothing(h);
      if (solved) {
        rounding = std::max(rounding, map_->energy_size().rounding);
      }
    }
    return rounding;
  }
  /// A long step may have several solutions. One that ends so far from the stored state, in units of each component's
  /// size, is another one.
  static constexpr double elsewhere = 1e-3;
  /// Of what check_map() finds, how far the step taken again is from the stored state; not a number where there is
  /// none.
  [[nodiscard]] double distance(const std::vector<double>& found) const {
    double largest = std::isfinite(found[0]) ? 0.0 : std::numeric_limits<double>::quiet_NaN();
    for (std::size_t i = 0; i < 2 * n_; ++i) {
      const double size = std::max({size_[i], Rounding::unit * scale_[i], std::numeric_limits<double>::min()});
      largest = larger(largest, std::abs(found[1 + i]) / size);
    }
    return largest;
  }

  /// The step of a one-step map: E_k, and z_1 - ψ_h(z_0). For its rounding error: z_0 and h, z_1 and nothing.
  /// \param step the row of the step
  void check_map(std::size_t row, std::size_t step, const std::vector<double>& z_0, const std::vector<double>& z_1) {
    const std::size_t size = 2 * n_;
    const double h = levels_.h[step];
    std::vector<double> inputs = z_0, scales = scale_;
    inputs.push_back(h);
    scales.push_back(std::abs(h));
    inputs.insert(inputs.end(), z_1.begin(), z_1.end());
    scales.insert(scales.end(), scale_.begin(), scale_.end());
    inputs.push_back(0.0);
    scales.push_back(0.0);
    const std::vector<double> sound = map_step(z_0, z_1, h);
    compare_step(row, step, inputs, scales, 1 + size, [&](const std::vector<double>& at, std::vector<double>& out) {
      const bool moved = !std::equal(at.begin(), at.begin() + static_cast<std::ptrdiff_t>(size) + 1, inputs.begin());
      if (moved) {
        out = map_step(std::span(at).first(size), std::span(at).subspan(size + 1, size), at[size]);
        return;
      }
      out = sound;
      for (std::size_t i = 0; i < size; ++i) {
        out[1 + i] += at[size + 1 + i] - z_1[i];
      }
    });
  }

  void check_step(std::size_t row, std::size_t step, const std::vector<double>& z_0, const std::vector<double>& z_1) {
    // Where t does not matter it is left out: t_{k+1} - t_k would lose digits of h.
    const double t = autonomous_ ? 0.0 : levels_.t_before(row), h = levels_.h[step];
    std::vector<double> corners = {t}, scales = {std::abs(t)};
    corners.insert(corners.end(), z_0.begin(), z_0.end());
    corners.push_back(t + h);
    corners.insert(corners.end(), z_1.begin(), z_1.end());
    scales.insert(scales.end(), scale_.begin(), scale_.end());
    scales.push_back(std::abs(t + h));
    scales.insert(scales.end(), scale_.begin(), scale_.end());
    if (!autonomous_ && !std::exchange(autonomous_known_, true) && is_autonomous(*action_, corners)) {
      autonomous_ = true;
      check_step(row, step, z_0, z_1);
      return;
    }
    compare_step(row, step, corners, scales, one_step_ ? 1 + 2 * n_ : 1,
                 [this](const std::vector<double>& at, std::vector<double>& out) { evaluate_step(at, out); });
    if (!one_step_ && levels_.complete()) {
      check_two_steps(row, corners, scales);
    }
    last_corners_ = corners;
  }

  /// E_k of the step to a stored level, and what it leaves of its equations: evaluate(inputs, outputs).
  template <typename Evaluate>
  void compare_step(std::size_t row, std::size_t step, const std::vector<double>& inputs,
                    const std::vector<double>& scales, std::size_t outputs, Evaluate&& evaluate) {
    std::vector<double> found(outputs), tolerances;
    evaluate(inputs, found);
    const auto tolerance = [&](std::size_t output) {
      return [&, output] {
        if (tolerances.empty()) {
          tolerances = Rounding::tolerances(inputs, scales, {0, 1}, outputs, evaluate);
          // Beside states that a blow-up came to those of an earlier step are nothing, and a step from one displaced by
          // a part of them is none.
          constexpr double most = 1 << 20;
          const std::size_t share = inputs.size() / 2;
          const auto near = [&](std::size_t i) {
            return most * std::max(std::abs(inputs[i % share]), std::abs(inputs[share + i % share]));
          };
          if (std::ranges::any_of(std::views::iota(std::size_t{0}, scales.size()),
                                  [&](std::size_t i) { return near(i) < scales[i]; })) {
            std::vector<double> capped = scales;
            for (std::size_t i = 0; i < capped.size(); ++i) {
              capped[i] = std::min(capped[i], near(i));
            }
            std::ranges::transform(tolerances, Rounding::tolerances(inputs, capped, {0, 1}, outputs, evaluate),
                                   tolerances.begin(), [](double a, double b) { return std::max(a, b); });
          }
        }
        return tolerances[output];
      };
    };
    const double potential = levels_.potential_of(step);
    if (map_ && !(distance(found) <= elsewhere)) {
      findings_.doubt(row);
      return;
    }
    // What rounding made of E_k when the step was taken may have grown inside H, where no displaced state shows it.
    findings_.compare(
        "/levels/energy", step, {}, energy_.at(step), found[0] + potential,
        [&] {
          return tolerance(0)() + Rounding::of_sum(found[0], potential) +
                 2.0 * std::max(rounding_ ? rounding_->at(step) : 0.0, map_ ? rounding_of_map(inputs) : 0.0);
        },
        "from the states around the step");
    for (std::size_t i = 0; i + 1 < outputs; ++i) {
      equation_.add(std::abs(found[1 + i]));
      // The equation of a coordinate is that of its rate, and its defect that of the momentum's row of Jδ; a map taken
      // again leaves the states themselves.
      const std::size_t component = map_ ? i : i < n_ ? i + n_ : i - n_;
      check_equation(row, component, found[1 + i], tolerance(1 + i));
    }
  }

  template <typename Tolerance>
  void check_equation(std::size_t row, std::size_t component, double defect, Tolerance&& tolerance) {
    findings_.count(1);
    const double allowed = defect == 0.0 ? 0.0 : tolerance();
    if (!(std::abs(defect) <= allowed)) {
      findings_.add({.dataset = states_.path(component),
                     .row = row,
                     .index = states_.index(component),
                     .stored = defect,
                     .recomputed = 0.0,
                     .tolerance = allowed,
                     .reason = "what the step from the level before leaves of its equation"});
    }
  }

  /// (3.3) of two steps that follow each other, at the level between.
  void check_two_steps(std::size_t row, const std::vector<double>& corners, const std::vector<double>& scales) {
    if (last_corners_.empty()) {
      return;
    }
    const std::size_t size = corners.size();
    std::vector<double> both = last_corners_, both_scales = scales;
    both.insert(both.end(), corners.begin(), corners.end());
    both_scales.insert(both_scales.end(), scales.begin(), scales.end());
    std::vector<double> found(2 * n_), tolerances;
    const auto evaluate = [this, size](const std::vector<double>& at, std::vector<double>& out) {
      const std::span<const double> all(at);
      const Incidence pair[] = {{all.first(size), 1}, {all.last(size), 0}};
      std::ranges::copy(value_variation(*action_, pair), out.begin());
    };
    evaluate(both, found);
    for (std::size_t i = 0; i < found.size(); ++i) {
      equation_.add(std::abs(found[i]));
      check_equation(row, i, found[i], [&] {
        if (tolerances.empty()) {
          tolerances = Rounding::tolerances(both, both_scales, {0, 1, 1, 2}, found.size(), evaluate);
        }
        return tolerances[i];
      });
    }
  }

  const record::Reader& reader_;
  const StoredLevels& levels_;
  const Problem& problem_;
  bool has_gamma_;
  Disagreements& findings_;
  const HamiltonianProblem& orbit_;
  std::optional<NodeLaw> law_;
  std::unique_ptr<DiscreteAction> action_;  ///< what a step is judged by: this, or
  std::unique_ptr<OneStepScheme> map_;      ///< the map itself
  bool one_step_;
  std::size_t n_;
  bool autonomous_;
  bool autonomous_known_ = false;
  Eigen::VectorXd gradient_;
  FormulaTable invariants_, exact_, momentum_maps_, constraints_;
  StoredStates states_;
  std::optional<StoredStates> before_;
  std::optional<StoredRows> velocities_;  ///< of a problem stated by L
  std::vector<double> inputs_;
  std::optional<formula::RoundingEvaluator> gradient_size_;  ///< of ∇H; of a problem stated by L none
  formula::SumSizeEvaluator energy_size_;                    ///< of the node energy
  std::vector<double> size_;                                 ///< the largest magnitude of each component
  std::vector<double> scale_;                                ///< of each component: see find_scales()
  StoredRows node_energy_, gamma_, energy_;
  std::optional<StoredRows> rounding_;
  std::vector<StoredRows> laws_, exacts_, changes_, constraint_columns_;
  std::vector<double> last_corners_;
  OutputCheck output_;
  EventCheck events_;
  TangentCheck tangents_;
  Spread equation_;
};

}  // namespace

Spread check_orbit(const record::Reader& reader, const StoredLevels& levels, const Problem& problem, bool has_gamma,
                   Disagreements& findings) {
  return OrbitCheck(reader, levels, problem, has_gamma, findings).run();
}

}  // namespace rubato
