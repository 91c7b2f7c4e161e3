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
  /// `registers`: one array of the block for each register of the code. `bytes` is a multiple of the vectors' width.
  using Function = void (*)(double* const* registers, double* work, std::size_t bytes);

  /// None where nothing is gained (most_stretches), or MachineCode::compile() would give none.
  [[nodiscard]] static std::shared_ptr<const BatchProgram> compile(const Bytecode& code, int lanes);

  void run(const batch::Block& block, batch::Kernel kernel, double* work) const;
  [[nodiscard]] std::size_t work_size() const { return work_size_; }  ///< numbers
  [[nodiscard]] std::size_t bytes() const { return bytes_; }

  /// More stretches than these are left to the kernel: it takes as long to compile each as there are instructions.
  static constexpr std::size_t most_stretches = 64;

private:
  struct Stretch {
    std::size_t first, last;            ///< instructions
    std::optional<std::size_t> offset;  ///< of machine code; without, the kernel's
  };
  explicit BatchProgram(ExecutableMemory memory) : memory_(std::move(memory)) {}

  ExecutableMemory memory_;
  std::vector<Stretch> stretches_;
  std::size_t work_size_ = 0, bytes_ = 0;
};

}  // namespace rubato::formula
