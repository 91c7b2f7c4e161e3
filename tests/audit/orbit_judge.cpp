#include "audit/orbit_judge.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace audit {

namespace {

/// A solved equation is evaluated once more in double when its iteration stops, and a last correction is rounded: twice
/// the bound of one evaluation. Compilers and the library may sum in another order: twice that.
constexpr long double evaluations = 4.0L;
/// Above it an orbit's steps are judged in part: the series of high orders in three degrees of freedom take long.
constexpr double most_cost = 2e8;

class OrbitJudge {
public:
  OrbitJudge(const OrbitProblem& problem, const Stored& record, const Json& told, Findings& findings)
      : problem_(problem), record_(record), told_(told), findings_(findings), oracle_(problem) {}

  Roundings judge() {
    judge_all();
    return roundings_;
  }

private:
  void judge_all() {
    h_ = record_["/levels/h"];
    t_ = record_["/levels/t"];
    bridged_ = record_["/levels/bridged"];
    energies_ = record_["/levels/energy"];
    if (t_.size() != h_.size() + 1 || bridged_.size() != h_.size() || energies_.size() != h_.size()) {
      findings_.add("shape", fmt::format("{} levels, {} steps", t_.size(), h_.size()));
      return;
    }
    judge_levels();
    read_states();
    judge_nodes();
    judge_steps();
    judge_told();
    roundings_.scale = scale_;
  }

  struct Pair {
    std::size_t step;
    std::vector<double> z_0, z_1;
  };

  [[nodiscard]] std::vector<double> state(const std::string& group, std::size_t row) const {
    std::vector<double> z = record_.row(group + "/q", row);
    const std::vector<double> p = record_.row(group + "/p", row);
    z.insert(z.end(), p.begin(), p.end());
    return z;
  }

  void read_states() {
    const std::vector<double>& levels = record_["/states/level"];
    const bool sparse = problem_.every > 1;
    for (std::size_t row = 0; row < levels.size(); ++row) {
      states_.push_back(state("/states", row));
      levels_.push_back(static_cast<std::size_t>(levels[row]));
      if (row > 0) {
        pairs_.push_back({levels_[row] - 1, sparse ? state("/states/previous", row) : states_[row - 1], states_[row]});
      }
    }
    const std::vector<double>& times = record_["/states/t"];
    for (std::size_t row = 0; row < levels_.size(); ++row) {
      if (levels_[row] >= t_.size() || times.at(row) != t_[levels_[row]]) {
        findings_.add("stored levels", fmt::format("row {} is not at the time of level {}", row, levels_[row]));
      }
    }
    // Every n-th, the first and the last.
    for (std::size_t row = 0; row + 1 < levels_.size(); ++row) {
      if (levels_[row] != row * static_cast<std::size_t>(problem_.every)) {
        findings_.add("stored levels", fmt::format("row {} is level {}", row, levels_[row]));
        return;
      }
    }
    if (levels_.empty() || levels_.back() != h_.size()) {
      findings_.add("stored levels", "the last level is not stored");
    }
  }

  void judge_levels() {
    const double direction = problem_.until < problem_.start_time ? -1.0 : 1.0;
    findings_.within("start", std::abs(t_[0] - problem_.start_time), 0, [&] { return fmt::format("t_0 = {}", t_[0]); });
    for (std::size_t k = 0; k < h_.size(); ++k) {
      if (!(direction * h_[k] > 0)) {
        findings_.add("sign of h", fmt::format("step {}: h = {}", k, h_[k]));
      }
      const long double gap = static_cast<long double>(t_[k + 1]) - t_[k] - h_[k];
      // t and h are rounded, each level once.
      const long double rounding = unit_roundoff * (std::abs(t_[k + 1]) + std::abs(t_[k]) + std::abs(h_[k]));
      findings_.within("times", std::abs(gap), 2 * rounding,
                       [&] { return fmt::format("t_{} is off t + h by {}", k + 1, static_cast<double>(gap)); });
      if (problem_.fixed) {
        const long double level =
            problem_.start_time + static_cast<long double>(k + 1) * (told_fixed_step() ? problem_.step : h_[0]);
        findings_.within("fixed levels", std::abs(level - t_[k + 1]), 4 * rounding,
                         [&] { return fmt::format("t_{} = {}", k + 1, t_[k + 1]); });
      }
    }
  }
  [[nodiscard]] bool told_fixed_step() const { return !problem_.energy_tolerance && problem_.next.empty(); }

  void compare(const std::string& kind, double value, const Bounded& right, std::size_t at, long double& largest) {
    largest = std::max(largest, evaluations * right.error);
    findings_.within(kind, std::abs(value - right.value), evaluations * right.error, [&] {
      return fmt::format("at {}: {} in place of {} ± {:.2g}", at, value, static_cast<double>(right.value),
                         static_cast<double>(right.error));
    });
  }

  void judge_nodes() {
    const std::vector<double>& node_energies = record_["/levels/node_energy"];
    const std::vector<double>& gammas = record_["/levels/gamma"];
    const std::size_t stride = stride_for(states_.size());
    for (std::size_t row = 0; row < states_.size(); ++row) {
      const std::size_t level = levels_[row];
      const Bounded energy = oracle_.node_energy(states_[row]);
      compare("node energy", node_energies[level], energy, level, roundings_.node_energy);
      scale_ = std::max({scale_, std::abs(energy.value), oracle_.magnitude_of_terms(states_[row])});
      if (row % stride == 0) {
        if (const auto gamma = oracle_.gamma(states_[row])) {
          compare("gamma", gammas[level], *gamma, level, roundings_.gamma);
        }
      }
      const std::vector<Bounded> invariants = oracle_.invariants(states_[row]);
      for (std::size_t i = 0; i < invariants.size(); ++i) {
        const std::string& name = problem_.invariants[i].first;
        compare("invariant", record_["/laws/" + name][level], invariants[i], level, roundings_.invariants[name]);
      }
    }
    for (const double energy : node_energies) {
      scale_ = std::max(scale_, std::abs(static_cast<long double>(energy)));
    }
  }

  [[nodiscard]] std::size_t stride_for(std::size_t count) const {
    return 1 + static_cast<std::size_t>(oracle_.cost() * static_cast<double>(count) / most_cost);
  }

  void judge_steps() {
    const std::size_t stride = stride_for(pairs_.size());
    const bool has_target = told_.has("discrete_energy.value");
    const long double target = has_target ? told_["discrete_energy.value"] : 0.0L;
    std::optional<OrbitStep> last;
    std::size_t last_step = 0;
    for (std::size_t i = 0; i < pairs_.size(); ++i) {
      const auto& [k, z_0, z_1] = pairs_[i];
      if (i % stride != 0 && i % stride != 1 && bridged_[k] == 0.0) {
        continue;
      }
      const OrbitStep step =
          oracle_.step(z_0, z_1, h_[k], unit_roundoff * std::abs(static_cast<long double>(t_[k + 1])));
      compare("stored energy", energies_[k], step.energy, k, roundings_.energy);
      if (!problem_.is_two_step() || (k == 0 && problem_.next.empty() && !step.defect.empty())) {
        judge_equation(step.defect, k);
      } else if (last && last_step + 1 == k) {
        std::vector<Bounded> sum;
        for (std::size_t row = 0; row < step.first.size(); ++row) {
          sum.push_back(step.first[row] + last->second[row]);
        }
        judge_equation(sum, k);
      }
      if (!problem_.fixed && has_target && bridged_[k] == 0.0) {
        const long double off = std::abs(step.energy.value - target);
        const long double limit =
            problem_.tolerance * std::max(scale_, std::abs(target)) + evaluations * step.energy.error;
        findings_.within("energy law", off, limit, [&] {
          return fmt::format("step {} of {}, not flagged, has E_k - E = {:.3g} in place of {:.3g} (E = {}, h = {})", k,
                             h_.size(), static_cast<double>(off), static_cast<double>(limit),
                             static_cast<double>(target), h_[k]);
        });
      }
      last = step;
      last_step = k;
    }
  }

  void judge_equation(const std::vector<Bounded>& defect, std::size_t k) {
    for (std::size_t row = 0; row < defect.size(); ++row) {
      findings_.within("step equation", std::abs(defect[row].value), evaluations * defect[row].error, [&] {
        return fmt::format("step {} of {}{}, h = {}, row {}: {:.3g} in place of {:.3g}", k, h_.size(),
                           bridged_[k] != 0.0 ? " (flagged)" : "", h_[k], row, static_cast<double>(defect[row].value),
                           static_cast<double>(evaluations * defect[row].error));
      });
    }
  }

  /// The figures that the levels alone decide.
  void judge_told() {
    exactly("steps", static_cast<double>(h_.size()));
    exactly("t", t_.back());
    if (!h_.empty()) {
      exactly("h.min", *std::ranges::min_element(h_));
      exactly("h.max", *std::ranges::max_element(h_));
    }
    const auto& crossing = record_["/levels/crossing"];
    if (!problem_.fixed) {
      exactly("bridges.steps", static_cast<double>(std::ranges::count(bridged_, 1.0)));
      exactly("bridges.count", static_cast<double>(std::ranges::count(crossing, 1.0)));
    }
    const std::vector<double>& node_energies = record_["/levels/node_energy"];
    exactly("node_energy.initial", node_energies[0]);
    double deviation = 0.0;
    for (const double energy : node_energies) {
      deviation = std::max(deviation, std::abs(energy - node_energies[0]));
    }
    exactly("node_energy.max_deviation", deviation);
    const std::vector<double>& gammas = record_["/levels/gamma"];
    if (told_.has("gamma.min")) {
      exactly("gamma.min", *std::ranges::min_element(gammas));
      exactly("gamma.max", *std::ranges::max_element(gammas));
    }
    if (!told_.has("discrete_energy.value") || h_.empty()) {
      return;
    }
    const double target = told_["discrete_energy.value"];
    long double off = 0.0L, off_bridged = 0.0L;
    for (std::size_t k = 0; k < h_.size(); ++k) {
      (bridged_[k] != 0.0 ? off_bridged : off) =
          std::max(bridged_[k] != 0.0 ? off_bridged : off, std::abs(static_cast<long double>(energies_[k]) - target));
    }
    deviation_told("discrete_energy.max_relative_deviation", off);
    deviation_told("bridges.max_deviation", off_bridged);
  }

  void exactly(const std::string& key, double value) {
    if (!told_.has(key) || told_[key] != value) {
      findings_.add("told " + key, fmt::format("{} in place of {}", told_.has(key) ? told_[key] : std::nan(""), value));
    }
  }

  /// A deviation relative to a scale that lies between the largest |H| and the largest sum of its terms' magnitudes.
  void deviation_told(const std::string& key, long double off) {
    if (!told_.has(key)) {
      return;
    }
    long double smallest = std::abs(static_cast<long double>(told_["discrete_energy.value"]));
    for (const double energy : record_["/levels/node_energy"]) {
      smallest = std::max(smallest, std::abs(static_cast<long double>(energy)));
    }
    const long double most = smallest > 0 ? off / smallest : 0.0L, least = scale_ > 0 ? off / scale_ : 0.0L;
    const double value = told_[key];
    if (!(value <= most * (1 + 1e-6L) + 4 * unit_roundoff) || !(value >= least / 4 - 4 * unit_roundoff)) {
      findings_.add("told " + key, fmt::format("{:.3g} where it lies between {:.3g} and {:.3g}", value,
                                               static_cast<double>(least), static_cast<double>(most)));
    }
  }

  const OrbitProblem& problem_;
  const Stored& record_;
  const Json& told_;
  Findings& findings_;
  OrbitOracle oracle_;
  std::vector<double> h_, t_, bridged_, energies_;
  std::vector<std::vector<double>> states_;
  std::vector<std::size_t> levels_;
  std::vector<Pair> pairs_;
  long double scale_ = 0.0L;
  Roundings roundings_;
};

}  // namespace

Roundings judge_orbit(const OrbitProblem& problem, const Stored& record, const Json& told, Findings& findings) {
  return OrbitJudge(problem, record, told, findings).judge();
}

}  // namespace audit
