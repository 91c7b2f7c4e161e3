#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/single_assignment.hpp>

namespace rubato::formula {

/// Straight-line code rolled up again: what it computes of inputs i, i + 1, … it often computes of i + 1, i + 2, … as
/// well, as of the springs of a chain. Such values are a run; loops over several at a time make them, and what is left
/// over, ends of chains and the last few terms of sums, is done one by one. Loops of a phase do not wait for each
/// other, and its single instructions only for those of this phase and of earlier ones.
struct RolledCode {
  static constexpr std::uint32_t none = std::numeric_limits<std::uint32_t>::max();

  struct Store {  ///< member k of a run is the output first + k stride
    std::uint32_t value, first, stride;
  };
  struct Loop {
    std::vector<std::uint32_t> body;  ///< the instructions for the first members
    std::uint32_t length = 0;         ///< members of each run that it makes
    std::vector<Store> stores;        ///< by the value of the first member
  };
  struct Phase {
    std::vector<Loop> loops;
    std::vector<std::uint32_t> single;  ///< instructions, ascending
  };
  struct Copy {  ///< outputs to, to + 1, … are inputs from, from + 1, …
    std::uint32_t from, to, count;
  };

  std::vector<Phase> phases;
  std::vector<bool> common;          ///< by input: the same number for all members of a run
  std::vector<std::uint32_t> place;  ///< by value: where it is kept for others; those of a run follow each other
  std::size_t places = 0;
  std::vector<Copy> copies;
  /// Values that are outputs and are not written by the caller that makes them: inputs, and runs in no order.
  std::vector<std::uint32_t> late;
};

/// None where less than half of the code would go in loops of `lanes` at a time.
[[nodiscard]] std::optional<RolledCode> roll(const Bytecode& code, const SingleAssignment& assigned, int lanes);

}  // namespace rubato::formula
