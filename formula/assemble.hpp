#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/rolled_code.hpp>
#include <rubato/formula/single_assignment.hpp>

/// Between MachineCode and the assembler; of no use elsewhere.
namespace rubato::formula {

struct Assembled {
  std::vector<std::byte> bytes;   ///< runs wherever it stands
  std::size_t entry = 0;          ///< of the function that leaves out the constants
  bool writes_constants = false;  ///< true if the beginning is a function that writes them and goes on at the entry
  std::size_t work_size = 0;
  bool in_loops = false;
};

/// Nothing where the processor is no x86-64 with AVX, or there is no assembler.
[[nodiscard]] std::optional<Assembled> assemble(const Bytecode& code);

/// For `lanes` points side by side (1, 2, 4 or 8): a BatchProgram::Function of the instructions first … last - 1, all
/// of which is_arithmetic(). Values that others need go where the code has its registers.
[[nodiscard]] std::optional<Assembled> assemble_lanes(const Bytecode& code, const SingleAssignment& assigned,
                                                      std::size_t first, std::size_t last, int lanes);

/// The same as assemble(), in loops; nothing where there are none that are worth it.
[[nodiscard]] std::optional<Assembled> assemble_rolled(const Bytecode& code, const SingleAssignment& assigned,
                                                       int lanes);

/// Single instructions of rolled code, at one point; and the outputs of `late`. Values from before, and those for
/// others, stand at their places of the work space.
[[nodiscard]] std::optional<Assembled> assemble_single(const Bytecode& code, const SingleAssignment& assigned,
                                                       const RolledCode& rolled, std::span<const std::uint32_t> single,
                                                       std::span<const std::uint32_t> late);

/// What machine code for several points does itself: sums, products, quotients, powers, roots, signs.
[[nodiscard]] bool is_arithmetic(OpCode code);

}  // namespace rubato::formula
