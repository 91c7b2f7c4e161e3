#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include <rubato/formula/bytecode.hpp>

namespace rubato::formula {

/// What a RoundingEvaluator does, by rolled code (rolled_code.hpp): several members of a run at a time, in loops that
/// the compiler makes of each operation. The same numbers, bit for bit, in a fraction of the time where there is much
/// to roll, as for chains; but NaN for the bound of what depends on something without an error where a function is
/// infinitely steep.
class RolledRounding {
public:
  /// Members of a run that are taken at once, and at least.
  static constexpr std::size_t many = 32, few = 8;

  /// None where too little of the code is in runs.
  [[nodiscard]] static std::optional<RolledRounding> of(const Bytecode& code);

  /// As RoundingEvaluator::run(). No allocation.
  void run(std::span<const double> inputs, std::span<const double> errors);
  [[nodiscard]] double value(std::size_t output) const { return values_.front().numbers[outputs_[output]]; }
  [[nodiscard]] double bound(std::size_t output) const { return bounds_.front().numbers[outputs_[output]]; }
  [[nodiscard]] std::size_t output_count() const { return outputs_.size(); }
  /// Σ|output| but for the first, of which there is one, as rounding_steps::sum_in_eights() adds up.
  [[nodiscard]] double terms() const;

private:
  class Planner;

  static constexpr std::uint32_t nowhere = std::numeric_limits<std::uint32_t>::max();

  struct alignas(64) Line {  ///< keeps vectors aligned when this is copied
    double numbers[few];
  };
  /// Where the number of a run's first member stands in values_ and bounds_, or that of all.
  struct Place {
    std::uint32_t first = 0;
    bool moves = false;
  };
  struct Step {
    Instruction instruction;  ///< whose registers are not looked at
    Place a = {}, b = {}, c = {}, target = {};
    std::uint32_t also = nowhere;  ///< where the results go, too
  };
  struct Loop {
    std::vector<Step> body;
    std::size_t length = 0;
  };
  struct Phase {
    std::vector<Loop> loops;
    std::vector<Instruction> single;  ///< whose registers are places
  };
  struct Spread {
    std::uint32_t input, to;
  };

  RolledRounding() = default;
  void run_loop(const Loop& loop);

  std::vector<Spread> common_;  ///< inputs that are the same for all members
  std::vector<Phase> phases_;
  std::vector<std::uint32_t> outputs_;  ///< where each stands
  std::vector<Line> values_, bounds_;   ///< the inputs first
};

}  // namespace rubato::formula
