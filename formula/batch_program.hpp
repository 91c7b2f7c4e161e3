#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include <rubato/formula/batch_kernel.hpp>
#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/executable_memory.hpp>

namespace rubato::formula {

/// A Bytecode for blocks of points: what is arithmetic in machine code, from one function of the kernel to the next,
/// each stretch one loop over the block in which values stand in vector registers. It does what the kernel would do,
/// rounding by rounding.
class BatchProgram {
public:
  /// `registers`: one array of the block for each register of the code, of which the bytes `begin` … `end` - 1 are
  /// done, at least one vector.
  using Function = void (*)(double* const* registers, double* work, std::size_t begin, std::size_t end);

  /// None where nothing is gained (most_stretches), or MachineCode::compile() would give none.
  [[nodiscard]] static std::shared_ptr<const BatchProgram> compile(const Bytecode& code, int lanes);

  /// True if a block may have any number of points, not just of whole vectors: where nothing is left to the kernel. The
  /// last points are then done by fours, by two and by one.
  [[nodiscard]] bool takes_any_number() const { return !narrow_.empty(); }

  void run(const batch::Block& block, batch::Kernel kernel, double* work) const;
  /// Machine code that does so many points by itself; null where it takes several, or the kernel.
  [[nodiscard]] Function in_one_go(std::size_t points) const;
  [[nodiscard]] std::size_t work_size() const { return work_size_; }  ///< numbers
  [[nodiscard]] std::size_t bytes() const { return bytes_; }

  /// More stretches than these are left to the kernel: it takes as long to compile each as there are instructions.
  static constexpr std::size_t most_stretches = 64;
  /// Longer code is not compiled several times.
  static constexpr std::size_t longest_for_any_number = 4096;

private:
  struct Stretch {
    std::size_t first, last;            ///< instructions
    std::optional<std::size_t> offset;  ///< of machine code; without, the kernel's
  };
  struct Narrow {
    std::size_t lanes, offset;
  };
  explicit BatchProgram(ExecutableMemory memory) : memory_(std::move(memory)) {}
  [[nodiscard]] Function at(std::size_t offset) const;

  ExecutableMemory memory_;
  std::vector<Stretch> stretches_;
  std::vector<Narrow> narrow_;  ///< the only stretch again with half as many lanes, and so on
  std::size_t lanes_ = 1;
  std::size_t work_size_ = 0, bytes_ = 0;
};

}  // namespace rubato::formula
