#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include <rubato/formula/bytecode.hpp>

namespace rubato::formula {

/// Code whose registers are written once: value i is an input, then a constant, then a result, in the order of the
/// instructions. What reuses registers in the code is distinguished.
struct SingleAssignment {
  struct Step {
    std::array<std::uint32_t, 3> operands{};  ///< values; of integer_power the second is its exponent
    std::uint32_t first_result = 0;           ///< of sincos the sine; the cosine is the next one
  };
  std::vector<Step> steps;             ///< one for each instruction
  std::vector<std::uint32_t> maker;    ///< the instruction that makes each result
  std::vector<std::uint32_t> outputs;  ///< the value of each output
};

[[nodiscard]] SingleAssignment single_assignment(const Bytecode& code);

/// The instructions in another order, in which what can be done with a new value is done at once: values of long sums
/// are used up where they are made.
[[nodiscard]] std::vector<std::uint32_t> eager_order(const Bytecode& code, const SingleAssignment& assigned);

}  // namespace rubato::formula
