#pragma once

#include <cstddef>

#include <rubato/base/state.hpp>
#include <rubato/variation/time_levels.hpp>

namespace rubato {

/// Evidence for why steps of a run are off the law: each claim that is made of them rests on numbers kept here.
class OffLawCauses {
public:
  void add(const StepReport& step);

  [[nodiscard]] std::size_t steps() const { return steps_; }
  /// Steps before E was set: the first step could not set it.
  [[nodiscard]] std::size_t starting() const { return starting_; }
  /// Steps on which E_k depends on h by less than a hundred times its rounding error.
  [[nodiscard]] std::size_t flat() const { return flat_; }
  /// Steps over which Γ changes sign and neither end has a Γ much larger than the other.
  [[nodiscard]] std::size_t crossings() const { return crossings_; }
  /// The largest ratio of |Γ| at the two ends of a step, and those two Γ.
  [[nodiscard]] double ratio() const { return ratio_; }
  [[nodiscard]] double gamma_before() const { return before_; }
  [[nodiscard]] double gamma_after() const { return after_; }

  void save(StateWriter& state) const;
  void restore(StateReader& state);

private:
  std::size_t steps_ = 0, starting_ = 0, flat_ = 0, crossings_ = 0;
  double ratio_ = 0.0, before_ = 0.0, after_ = 0.0;
};

/// Γ at two levels one step apart, and what they say of the step between them or of the next one.
struct GammaTrend {
  double before = 0.0;
  double after = 0.0;

  /// |Γ| at one end is more than `changes_much` times what it is at the other, or changes sign to more than that: the
  /// step is too long for a law in which Γ is nearly constant over a step.
  static constexpr double changes_much = 4.0;
  [[nodiscard]] double ratio() const;
  [[nodiscard]] bool known() const;
  /// Γ changes sign between the two, or would soon, going on as it does.
  [[nodiscard]] bool meets_zero() const;
};

}  // namespace rubato
