#pragma once

#include <functional>
#include <limits>
#include <vector>

#include <rubato/base/state.hpp>

namespace rubato {

/// Which way a function passes zero, in the direction of the run.
enum class Direction { down = -1, both = 0, up = 1 };

/// A zero that a function passes in a step, at a fraction of it.
struct Crossing {
  double fraction = 0.0;
  Direction direction = Direction::up;
  bool jump = false;  ///< the function passes zero without being near it: a pole, or a step of its own
};

/// Finds the zeros that a function g passes along a run, step by step.
///
/// Signs decide: g crosses where its sign becomes the opposite of the last one that it had. A zero at a level is hence
/// one crossing and belongs to the step after it, a zero that is only touched is none, and neither is the start. Each
/// crossing is located to rounding along the function that is given, between places where its signs are known
/// (T. R. Chandrupatla, A new hybrid quadratic/bisection algorithm for finding the zero of a nonlinear function without
/// using derivatives, Adv. Eng. Software 28, 1997).
///
/// Several crossings within one step are seen where the cubic through g and its rate at both ends turns between zeros,
/// or nearer to zero than a fourth of how much it varies in the step: there g is looked at itself, and so twice more
/// between the places found. Rates that are not given are those of the parabola through the last three levels. What is
/// missed are pairs of crossings in a step that is too long for the cubic to follow g as far as that: it is off by a
/// 384th of the fourth derivative by the fraction, the parabola by a 15th of the third.
///
/// A run that starts at a zero and leaves it, as a ball that has just bounced, may be back beyond it within the first
/// step: left_and_returned() where that crossing was not found.
class CrossingSearch {
public:
  struct Sample {
    double fraction, value;
    double rate = std::numeric_limits<double>::quiet_NaN();  ///< dg/dfraction; not a number where it is not known
  };
  using Function = std::function<Sample(double fraction)>;

  /// Crossings in the other direction than `wanted` are not located.
  explicit CrossingSearch(Direction wanted = Direction::both) : wanted_(wanted) {}

  /// g at the start of the run.
  void begin(double value);
  /// The crossings in the step of length h from `from`, at fraction 0, to `to`, at 1, in their order; g(fraction) is
  /// asked for in between. Valid until the next call.
  const std::vector<Crossing>& follow(double h, Sample from, Sample to, const Function& g);
  /// True if g was not a number somewhere in the last step: what crossings that has is not known.
  [[nodiscard]] bool undefined() const { return undefined_; }

  /// True if the last step was the first one, g left a zero at its start to one side and ends on the other, which is a
  /// wanted crossing, and none was found.
  [[nodiscard]] bool left_and_returned() const { return left_and_returned_; }

  void save(StateWriter& state) const;
  void restore(StateReader& state);

private:
  [[nodiscard]] bool leaves_and_returns(const Sample& from, const Sample& to) const;
  void set_rates(double h, Sample& from, Sample& to, const Function& g);
  void refine(const Sample& a, const Sample& b, int depth, const Function& g);
  void find_signs(const Function& g);
  /// Its fraction is not a number where g is not in between.
  [[nodiscard]] Crossing locate(const Sample& a, const Sample& b, const Function& g);

  Direction wanted_;
  int sign_ = 0;          ///< the last one that was not 0; 0 where none is known
  bool at_start_ = true;  ///< in the first step
  /// Of the step before, for rates.
  ///@{
  double previous_value_ = std::numeric_limits<double>::quiet_NaN(), previous_h_ = 0.0;
  ///@}
  bool undefined_ = false, left_and_returned_ = false;
  std::vector<Sample> samples_;
  std::vector<Crossing> crossings_;
};

}  // namespace rubato
