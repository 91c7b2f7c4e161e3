#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/loop.hpp>

namespace rubato::formula {

/// Code of loops with the same iterations and arguments: their terms as one straight code.
struct LoopCode {
  std::shared_ptr<const Iterations> iterations;
  std::vector<Loop::Place> slots, targets;
  Bytecode body;  ///< from the slots to the terms
  std::size_t output_count = 0;
};

/// What a Bytecode with loops does: the arguments of loops, the loops, further such stages where loops need the results
/// of others, and the outputs. Each part reads the inputs, and behind them the results of all loops before.
struct LoopProgram {
  struct Stage {
    Bytecode arguments;  ///< of its loops, one after the other
    std::vector<LoopCode> loops;
  };
  std::vector<Stage> stages;
  Bytecode rest;
  std::size_t value_count = 0;  ///< inputs, and results of loops

  [[nodiscard]] static std::shared_ptr<const LoopProgram> of(std::span<const Expression> outputs,
                                                             std::span<const Expression> inputs);
};

}  // namespace rubato::formula
