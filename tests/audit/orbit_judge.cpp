#include "audit/orbit_judge.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "audit/levels_judge.hpp"

namespace audit {

namespace {

/// Above it an orbit's steps are judged in part: the series of high orders in three degrees of freedom take long.
constexpr double most_cost = 2e8;

class OrbitJudge {
public:
  OrbitJudge(const OrbitProblem& problem, const Stored& record, const Json& reported, Disagreements& findings)
      : problem_(problem), record_(record), oracle_(problem), levels_(problem.rules(), record, reported, findings) {}

  Roundings judge() {
    if (levels_.judge_levels()) {
      read_states();
      judge_nodes();
      judge_steps();
      judge_exact();
      levels_.judge_told();
    }
    return levels_.roundings();
  }

private:
  struct Pair {
    std::size_t step;
    std::vector<double> z_0, z_1;
  };

  [[nodiscard]] std::vector<double> state(const std::string& group, std::size_t row) const {
    std::vector<double> z = record_.row(group + "/q", row);
    const std::vector<double> p = record_.row(group + "/p", row);
    z.insert(z.end(), p.begin(), p.end());
    if (problem_.is_stated_by_L()) {
      // Levels before stored ones are kept without velocities: those of the stored one are near.
      const bool has = record_.has(group + "/q_dot");
      const std::vector<double> v = record_.row((has ? group : std::string("/states")) + "/q_dot", row);
      z.insert(z.end(), v.begin(), v.end());
    }
    return z;
  }

  void read_states() {
    const auto& levels = levels_.stored_levels();
    for (std::size_t row = 0; row < levels.size(); ++row) {
      states_.push_back(state("/states", row));
      if (row > 0) {
        const bool sparse = problem_.every > 1;
        pairs_.push_back({levels[row] - 1, sparse ? state("/states/previous", row) : states_[row - 1], states_[row]});
      }
    }
  }

  void judge_nodes() {
    const std::vector<double>& node_energies = record_["/levels/node_energy"];
    const std::vector<double>& gammas = record_["/levels/gamma"];
    const std::size_t stride = stride_for(states_.size());
    Roundings& roundings = levels_.roundings();
    for (std::size_t row = 0; row < states_.size(); ++row) {
      const std::size_t level = levels_.stored_levels()[row];
      const Bounded energy = oracle_.node_energy(states_[row]);
      levels_.compare("node energy", node_energies[level], energy, level, roundings.node_energy);
      levels_.add_scale(oracle_.scale(states_[row]));
      if (row % stride == 0) {
        if (const auto gamma = oracle_.gamma(states_[row])) {
          levels_.compare("gamma", gammas[level], *gamma, level, roundings.gamma);
        }
      }
      judge_velocities(row, level);
      const std::vector<Bounded> invariants = oracle_.invariants(states_[row]);
      for (std::size_t i = 0; i < invariants.size(); ++i) {
        const std::string& name = problem_.invariants[i].first;
        levels_.compare("invariant", record_["/laws/" + name][level], invariants[i], level, roundings.invariants[name]);
      }
    }
  }

  /// ∂L/∂q̇ = p. Momenta are sums, whose rounding is that of the largest, and velocities are found to that.
  void judge_velocities(std::size_t row, std::size_t level) {
    const std::size_t n = problem_.degrees_of_freedom();
    const std::vector<Bounded> defects = oracle_.momentum_defect(states_[row]);
    for (std::size_t i = 0; i < defects.size(); ++i) {
      long double largest = 0.0L;
      for (const std::vector<double>& state : states_) {
        largest = std::max(largest, std::abs(static_cast<long double>(state[n + i])));
      }
      const long double limit = evaluations * (defects[i].error + 4 * unit_roundoff * largest);
      levels_.findings().within("velocities", std::abs(defects[i].value), limit, [&] {
        return fmt::format("level {}: dL/dq_dot is off p by {:.2g} in place of {:.2g}", level,
                           static_cast<double>(defects[i].value), static_cast<double>(limit));
      });
    }
  }

  void judge_exact() {
    for (std::size_t row = 0; problem_.exact && row < states_.size(); ++row) {
      const double t = levels_.t(levels_.stored_levels()[row]);
      const std::vector<Bounded> time = {Bounded::stored(t)};
      const Bounded exact = (*problem_.exact)(std::span<const Bounded>(time));
      long double& rounding = levels_.roundings().errors[problem_.names[0]];
      levels_.compare("exact solution", record_["/exact/" + problem_.names[0]][row], exact, row, rounding);
      if (row + 1 == states_.size()) {
        levels_.judge_error(problem_.names[0], {Bounded::stored(states_[row][0]) - exact});
      }
    }
  }

  [[nodiscard]] std::size_t stride_for(std::size_t count) const {
    return 1 + static_cast<std::size_t>(oracle_.cost() * static_cast<double>(count) / most_cost);
  }

  void judge_steps() {
    const std::size_t stride = stride_for(pairs_.size());
    const double added_constant =
        problem_.is_stated_by_L() ? -problem_.L.added_constant() : problem_.H.added_constant();
    std::optional<OrbitStep> last;
    std::size_t last_step = 0;
    for (std::size_t i = 0; i < pairs_.size(); ++i) {
      const auto& [k, z_0, z_1] = pairs_[i];
      if (i % stride > 1 && !levels_.flagged(k)) {
        continue;
      }
      const OrbitStep step =
          oracle_.step(z_0, z_1, levels_.h(k), unit_roundoff * std::abs(static_cast<long double>(levels_.t(k + 1))));
      levels_.add_scale(step.energy.value - static_cast<long double>(added_constant));
      levels_.judge_energy(k, step.energy);
      if (k == 0 && problem_.every == 1) {
        judge_strength(step, z_0, z_1);
      }
      if (!problem_.is_two_step() || (k == 0 && problem_.next.empty() && !step.defect.empty())) {
        levels_.judge_equation(step.defect, k);
      } else if (last && last_step + 1 == k) {
        std::vector<Bounded> sum;
        for (std::size_t row = 0; row < step.first.size(); ++row) {
          sum.push_back(step.first[row] + last->second[row]);
        }
        levels_.judge_equation(sum, k);
      }
      last = step;
      last_step = k;
    }
  }

  /// (s+1) η h^s, by the slope dK/dh = s(s+1) η h^(s-1) where it can be had, else by K - H to leading order, as the
  /// families know it.
  void judge_strength(const OrbitStep& step, const std::vector<double>& z_0, const std::vector<double>& z_1) {
    const Bounded mean = Bounded(0.5L) * (oracle_.node_energy(z_0) + oracle_.node_energy(z_1));
    const Bounded leading = step.energy - mean;
    // A look-ahead solves its steps to 1e-5.
    constexpr long double solved_to = 1e-3L;
    const long double terms = std::max(oracle_.scale(z_0), oracle_.scale(z_1)) / (problem_.every > 1 ? 1.0L : 0.03L);
    if (problem_.is_family()) {
      levels_.judge_strength(leading, solved_to, terms);
    } else if (const auto slope = oracle_.slope(z_0, z_1, levels_.h(0))) {
      const long double size = *slope * levels_.h(0) / problem_.order_of_scheme();
      // η in terms of Γ is that to leading order: what the next order makes of it is what both forms differ by. Near a
      // zero of Γ what a loosely solved step is off shows in it.
      const long double next_order = std::abs(size - leading.value) + solved_to * std::abs(leading.value);
      levels_.judge_strength(Bounded(size, next_order), solved_to, terms);
    }
  }

  const OrbitProblem& problem_;
  const Stored& record_;
  OrbitOracle oracle_;
  LevelsJudge levels_;
  std::vector<std::vector<double>> states_;
  std::vector<Pair> pairs_;
};

}  // namespace

Roundings judge_orbit(const OrbitProblem& problem, const Stored& record, const Json& reported,
                      Disagreements& findings) {
  return OrbitJudge(problem, record, reported, findings).judge();
}

}  // namespace audit
