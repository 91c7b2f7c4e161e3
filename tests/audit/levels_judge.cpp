#include "audit/levels_judge.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>

#include <fmt/format.h>

namespace audit {

namespace {

/// Values above it come from squares and products of several terms that pass the range of double.
constexpr long double most_in_double = 1e290L;

}  // namespace

LevelsJudge::LevelsJudge(const LevelRules& rules, const Stored& record, const Json& reported, Disagreements& findings)
    : rules_(rules), record_(record), reported_(reported), findings_(findings) {}

void LevelsJudge::add_scale(long double value) {
  roundings_.scale = std::isfinite(value) ? std::max(roundings_.scale, std::abs(value)) : roundings_.scale;
}

bool LevelsJudge::judge_levels() {
  t_ = record_["/levels/t"];
  h_ = record_["/levels/h"];
  off_law_ = record_["/levels/off_law"];
  energies_ = record_["/levels/energy"];
  if (t_.size() != h_.size() + 1 || off_law_.size() != h_.size() || energies_.size() != h_.size()) {
    findings_.add("shape", fmt::format("{} levels, {} steps", t_.size(), h_.size()));
    return false;
  }
  const double direction = rules_.until < rules_.start ? -1.0 : 1.0;
  if (t_[0] != rules_.start) {
    findings_.add("times", fmt::format("t_0 = {}", t_[0]));
  }
  for (std::size_t k = 0; k < h_.size(); ++k) {
    if (!(direction * h_[k] > 0)) {
      findings_.add("sign of h", fmt::format("step {}: h = {}", k, h_[k]));
    }
    const long double gap = static_cast<long double>(t_[k + 1]) - t_[k] - h_[k];
    // t and h are rounded, each level once; fixed levels are sums of the start and a multiple of the step.
    const long double terms = rules_.fixed ? std::abs(rules_.start) + std::abs(t_[k + 1] - rules_.start) : 0.0L;
    const long double rounding = unit_roundoff * (std::abs(t_[k + 1]) + std::abs(t_[k]) + std::abs(h_[k]) + terms);
    findings_.within("times", std::abs(gap), 2 * rounding,
                     [&] { return fmt::format("t_{} is off t + h by {}", k + 1, static_cast<double>(gap)); });
    if (rules_.fixed) {
      const long double step = rules_.step != 0.0 ? rules_.step : h_[0];
      const long double level = rules_.start + static_cast<long double>(k + 1) * step;
      findings_.within("fixed levels", std::abs(level - t_[k + 1]), 4 * rounding,
                       [&] { return fmt::format("t_{} = {}", k + 1, t_[k + 1]); });
    }
  }
  const std::vector<double>& times = record_["/states/t"];
  for (const double level : record_["/states/level"]) {
    levels_.push_back(static_cast<std::size_t>(level));
    if (levels_.back() >= t_.size() || times.at(levels_.size() - 1) != t_[levels_.back()]) {
      findings_.add("stored levels", fmt::format("row {} is not at the time of its level", levels_.size() - 1));
      return false;
    }
  }
  // Every n-th, the first and the last.
  for (std::size_t row = 0; row + 1 < levels_.size(); ++row) {
    if (levels_[row] != row * rules_.every) {
      findings_.add("stored levels", fmt::format("row {} is level {}", row, levels_[row]));
      return false;
    }
  }
  if (levels_.empty() || levels_.back() != h_.size()) {
    findings_.add("stored levels", "the last level is not stored");
    return false;
  }
  return judge_potential();
}

/// f'(h) = strength·(|h|/length)^p: one power law for all steps. Its exponent, which no dataset shows, follows from the
/// longest and the shortest of them, to what their rounding leaves.
bool LevelsJudge::judge_potential() {
  constexpr const char* path = "/levels/step_potential";
  if (record_.has(path) != rules_.potential) {
    findings_.add("step potential", rules_.potential ? "there is none" : "there is one that nobody asked for");
    return false;
  }
  if (!rules_.potential || h_.empty()) {
    return true;
  }
  potential_ = record_[path];
  if (potential_.size() == h_.size() && std::ranges::all_of(potential_, [](double part) { return part == 0.0; })) {
    return false;  // K does not depend on the step: f' is 0
  }
  if (potential_.size() != h_.size() || potential_[0] == 0.0) {
    findings_.add("step potential", fmt::format("{} values for {} steps", potential_.size(), h_.size()));
    return false;
  }
  const auto length = [this](std::size_t k) { return std::abs(static_cast<long double>(h_[k])); };
  std::size_t shortest = 0, longest = 0;
  for (std::size_t k = 0; k < h_.size(); ++k) {
    shortest = length(k) < length(shortest) ? k : shortest;
    longest = length(k) > length(longest) ? k : longest;
  }
  exponent_ = rules_.exponent;
  if (rules_.exponent == 0.0 && shortest != longest) {
    const long double span = std::log(length(longest) / length(shortest));
    const long double rise =
        std::log(static_cast<long double>(potential_[longest]) / static_cast<long double>(potential_[shortest]));
    exponent_ = rise / span;
    // Both ends are rounded by two or three units; a rounded exponent serves where it is one.
    const long double uncertain = 8 * unit_roundoff * (1 + std::abs(exponent_)) / span;
    if (std::abs(exponent_ - std::round(exponent_)) <= uncertain) {
      exponent_ = std::round(exponent_);
    }
    findings_.within("exponent of the step potential", rules_.order, exponent_ + uncertain, [&] {
      return fmt::format("{} of a scheme of order {}", static_cast<double>(exponent_), rules_.order);
    });
  }
  for (std::size_t k = 0; k < h_.size(); ++k) {
    const Bounded expected = potential_of(k);
    findings_.within("step potential", std::abs(potential_[k] - expected.value), expected.error, [&] {
      return fmt::format("step {}: f'({}) = {} in place of {}", k, h_[k], potential_[k],
                         static_cast<double>(expected.value));
    });
  }
  return true;
}

/// From that of the first step.
Bounded LevelsJudge::potential_of(std::size_t k) const {
  if (!rules_.potential) {
    return {};
  }
  const long double ratio = std::abs(static_cast<long double>(h_[k]) / h_[0]);
  const long double value = potential_[0] * std::pow(ratio, exponent_);
  // Of each of both: the quotient |h|/length, raised to p, which is p - 1 products or pow(), and one more product.
  const long double roundings = exponent_ + std::max(exponent_ - 1.0L, 3.0L) + 1.0L;
  return {value, 2 * roundings * unit_roundoff * std::abs(value)};
}

void LevelsJudge::judge_strength(const Bounded& size, long double part, long double terms) {
  if (rules_.kappa == 0.0 || potential_.empty()) {
    return;
  }
  // Where η vanishes the potential is to be seen beside the terms of K all the same.
  constexpr long double seen = 1e-6L;
  const long double reported = potential_[0] * std::pow(static_cast<long double>(rules_.kappa), exponent_);
  const long double expected = std::abs(size.value);
  const long double limit = part * expected + evaluations * size.error + seen * terms;
  findings_.within("strength of the step potential", std::abs(std::abs(reported) - expected), limit, [&] {
    return fmt::format("{:.6g} in place of {:.6g} ± {:.2g}", static_cast<double>(reported),
                       static_cast<double>(size.value), static_cast<double>(limit));
  });
  if (expected > limit && reported * size.value < 0) {
    findings_.add("strength of the step potential", "it has the wrong sign");
  }
}

void LevelsJudge::compare(const std::string& kind, double value, const Bounded& right, std::size_t at,
                          long double& largest) {
  if (!(std::abs(right.value) <= most_in_double) && !std::isfinite(value)) {
    return;  // what leads to it is beyond what double holds: undefined, and reported to be
  }
  largest = std::max(largest, evaluations * right.error);
  findings_.within(kind, std::abs(value - right.value), evaluations * right.error, [&] {
    return fmt::format("at {}: {} in place of {} ± {:.2g}", at, value, static_cast<double>(right.value),
                       static_cast<double>(right.error));
  });
}

void LevelsJudge::judge_energy(std::size_t k, const Bounded& energy_of_scheme) {
  const Bounded energy = rules_.potential ? energy_of_scheme + potential_of(k) : energy_of_scheme;
  compare("stored energy", energies_[k], energy, k, roundings_.energy);
  if (rules_.fixed || !reported_.has("discrete_energy.value") || off_law_[k] != 0.0) {
    return;
  }
  const long double target = reported_["discrete_energy.value"];
  const long double off = std::abs(energy.value - target);
  // What one unit in the last place of h does, from the step condition (|E_k - E| + rounding)/|h dE/dh|.
  const long double condition = record_["/levels/step_condition"][k];
  const long double met = rules_.tolerance * roundings_.scale + evaluations * energy.error;
  const long double last_place = condition > 0 ? 2 * unit_roundoff * met / condition : 0.0L;
  const long double limit = met + std::min(last_place, met);
  findings_.within("energy law", off, limit, [&] {
    return fmt::format("step {} of {}, not flagged, has E_k - E = {:.3g} in place of {:.3g} (E = {}, h = {})", k,
                       h_.size(), static_cast<double>(off), static_cast<double>(limit), static_cast<double>(target),
                       h_[k]);
  });
}

void LevelsJudge::judge_equation(const std::vector<Bounded>& rows, std::size_t k) {
  for (std::size_t row = 0; row < rows.size(); ++row) {
    findings_.within("step equation", std::abs(rows[row].value), evaluations * rows[row].error, [&] {
      return fmt::format("step {} of {}{}, h = {}, row {}: {:.3g} in place of {:.3g}", k, h_.size(),
                         off_law_[k] != 0.0 ? " (flagged)" : "", h_[k], row, static_cast<double>(rows[row].value),
                         static_cast<double>(evaluations * rows[row].error));
    });
  }
}

void LevelsJudge::judge_error(const std::string& name, const std::vector<Bounded>& differences) {
  long double largest = 0.0L, squares = 0.0L, rounding = 0.0L;
  for (const Bounded& difference : differences) {
    largest = std::max(largest, std::abs(difference.value));
    squares += difference.value * difference.value;
    rounding = std::max(rounding, evaluations * difference.error);
  }
  const long double rms = std::sqrt(squares / static_cast<long double>(differences.size()));
  for (const auto& [word, value] : {std::pair{".max", largest}, {".rms", rms}}) {
    const std::string key = "error." + name + word;
    const double reported = reported_.has(key) ? reported_[key] : std::nan("");
    findings_.within("told error", std::abs(reported - value), rounding,
                     [&] { return fmt::format("{}: {} in place of {}", key, reported, static_cast<double>(value)); });
  }
  roundings_.errors[name] = std::max(roundings_.errors[name], 2 * rounding);
}

void LevelsJudge::judge_told() {
  exactly("steps", static_cast<double>(h_.size()));
  exactly("t", t_.back());
  if (h_.empty()) {
    return;
  }
  exactly("h.min", *std::ranges::min_element(h_));
  exactly("h.max", *std::ranges::max_element(h_));
  if (!rules_.fixed) {
    exactly("off_law.steps", static_cast<double>(std::ranges::count(off_law_, 1.0)));
  }
  if (rules_.potential) {
    const auto [least, greatest] = std::ranges::minmax(potential_);
    exactly("step_potential.from", least);
    exactly("step_potential.to", greatest);
    exactly("step_potential.max", std::max(-least, greatest));
    if (rules_.kappa > 0.0) {
      exactly("step_potential.p", rules_.exponent);
      const double reported = reported_["step_potential.kappa"];
      findings_.within("told step_potential", std::abs(reported - rules_.kappa), 1e-15 * rules_.kappa,  // (κ h_0) / h_0
                       [&] { return fmt::format("kappa is {} in place of {}", reported, rules_.kappa); });
    }
  } else if (reported_.has("step_potential.max")) {
    findings_.add("told step_potential", "there is none");
  }
  const std::vector<double>& node_energies = record_["/levels/node_energy"];
  exactly("node_energy.initial", node_energies[0]);
  double deviation = 0.0, undefined = 0.0;
  for (const double energy : node_energies) {
    const double off = std::abs(energy - node_energies[0]);
    deviation = std::isfinite(off) ? std::max(deviation, off) : deviation;
    undefined += std::isfinite(energy) ? 0.0 : 1.0;
  }
  exactly("node_energy.max_deviation", deviation);
  if (undefined > 0.0) {
    exactly("node_energy.undefined", undefined);
  }
  const std::vector<double>& gammas = record_["/levels/gamma"];
  if (reported_.has("gamma.min")) {
    std::vector<double> defined;
    std::ranges::copy_if(gammas, std::back_inserter(defined), [](double gamma) { return std::isfinite(gamma); });
    exactly("gamma.min", *std::ranges::min_element(defined));
    exactly("gamma.max", *std::ranges::max_element(defined));
    if (defined.size() < gammas.size()) {
      exactly("gamma.undefined", static_cast<double>(gammas.size() - defined.size()));
    }
  }
  if (!reported_.has("discrete_energy.value")) {
    return;
  }
  const double target = reported_["discrete_energy.value"];
  long double off[2] = {0.0L, 0.0L};
  for (std::size_t k = 0; k < h_.size(); ++k) {
    long double& largest = off[off_law_[k] != 0.0 ? 1 : 0];
    largest = std::max(largest, std::abs(static_cast<long double>(energies_[k]) - target));
  }
  deviation_told("discrete_energy.max_relative_deviation", off[0]);
  deviation_told("off_law.max_deviation", off[1]);
}

void LevelsJudge::exactly(const std::string& key, double value) {
  if (!reported_.has(key) || reported_[key] != value) {
    findings_.add("told " + key,
                  fmt::format("{} in place of {}", reported_.has(key) ? reported_[key] : std::nan(""), value));
  }
}

/// Relative to a scale between the largest |H| and the largest sum of its terms' magnitudes.
void LevelsJudge::deviation_told(const std::string& key, long double off) {
  if (!reported_.has(key)) {
    return;
  }
  long double smallest = std::abs(static_cast<long double>(reported_["discrete_energy.value"]));
  for (const double energy : record_["/levels/node_energy"]) {
    smallest = !std::isfinite(energy) ? smallest : std::max(smallest, std::abs(static_cast<long double>(energy)));
  }
  const long double most = smallest > 0 ? off / smallest : 1.0L;
  const long double least = roundings_.scale > 0 ? off / roundings_.scale : 0.0L;
  const double value = reported_[key];
  const auto [low, high] = std::minmax(least, most);
  if (!(value <= high * (1 + 1e-6L) + 4 * unit_roundoff) || !(value >= low / 4 - 4 * unit_roundoff)) {
    findings_.add("told " + key, fmt::format("{:.3g} where it lies between {:.3g} and {:.3g}", value,
                                             static_cast<double>(low), static_cast<double>(high)));
  }
}

}  // namespace audit
