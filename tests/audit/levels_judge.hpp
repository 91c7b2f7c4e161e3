#pragma once

#include <string>
#include <vector>

#include "audit/accounts.hpp"
#include "audit/bounded.hpp"
#include "audit/findings.hpp"
#include "audit/level_rules.hpp"
#include "audit/program.hpp"
#include "audit/stored.hpp"

namespace audit {

/// A solved equation is evaluated once more in double when its iteration stops, and a last correction is rounded: twice
/// the bound of one evaluation. Compilers and the library may sum in another order: twice that.
inline constexpr long double evaluations = 4.0L;

/// Judges what orbits and lattices have in common: the levels, and what is reported on them.
class LevelsJudge {
public:
  LevelsJudge(const LevelRules& rules, const Stored& record, const Json& reported, Disagreements& findings);

  /// Times, steps and their direction, and which levels are stored. False if there is too little to go on with.
  bool judge_levels();
  /// E_k of a step, K_h of its scheme and the step potential's part, against what is stored, and against E if the step
  /// is not flagged.
  void judge_energy(std::size_t step, const Bounded& energy_of_scheme);
  /// (s+1) |η| h_0^s, which a potential that the problem gives is stated in, as the first step shows it: within a part
  /// of it. `terms` is the size of the terms of K.
  void judge_strength(const Bounded& size, long double part, long double terms);
  /// The figures that the levels alone decide.
  void judge_told();
  /// A stored value against what it should be; keeps the largest rounding in `largest`.
  void compare(const std::string& kind, double value, const Bounded& right, std::size_t at, long double& largest);
  /// What the run reports on the differences from [exact], at each node of the last level.
  void judge_error(const std::string& name, const std::vector<Bounded>& differences);
  /// All rows of an equation, each within the rounding of its terms.
  void judge_equation(const std::vector<Bounded>& rows, std::size_t step);

  /// Of each state in the record the number of its level.
  [[nodiscard]] const std::vector<std::size_t>& stored_levels() const { return levels_; }
  [[nodiscard]] double h(std::size_t step) const { return h_[step]; }
  [[nodiscard]] double t(std::size_t level) const { return t_[level]; }
  [[nodiscard]] bool flagged(std::size_t step) const { return off_law_[step] != 0.0; }
  [[nodiscard]] Disagreements& findings() { return findings_; }
  [[nodiscard]] Roundings& roundings() { return roundings_; }
  /// A scale of the energy that has been seen: |H|, or the magnitudes of its terms.
  void add_scale(long double value);

private:
  bool judge_potential();
  [[nodiscard]] Bounded potential_of(std::size_t step) const;
  void exactly(const std::string& key, double value);
  void deviation_told(const std::string& key, long double off);

  LevelRules rules_;
  const Stored& record_;
  const Json& reported_;
  Disagreements& findings_;
  Roundings roundings_;
  std::vector<double> t_, h_, off_law_, energies_, potential_;
  long double exponent_ = 0.0L;  ///< of the step potential
  std::vector<std::size_t> levels_;
};

}  // namespace audit
