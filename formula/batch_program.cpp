#include <rubato/formula/batch_program.hpp>

#include <algorithm>
#include <bit>
#include <utility>

#include <rubato/formula/assemble.hpp>
#include <rubato/formula/machine_code.hpp>

namespace rubato::formula {

std::shared_ptr<const BatchProgram> BatchProgram::compile(const Bytecode& code, int lanes) {
  const auto instructions = code.instructions();
  if (instructions.size() > longest_machine_code) {
    return nullptr;
  }
  std::vector<Stretch> stretches;
  for (std::size_t i = 0; i < instructions.size(); ++i) {
    const bool compiled = is_arithmetic(instructions[i].code);
    if (stretches.empty() || stretches.back().offset.has_value() != compiled) {
      stretches.push_back({i, i, compiled ? std::optional<std::size_t>(0) : std::nullopt});
    }
    stretches.back().last = i + 1;
  }
  if (stretches.size() > most_stretches ||
      std::ranges::none_of(stretches, [](const Stretch& s) { return s.offset.has_value(); })) {
    return nullptr;
  }
  const SingleAssignment assigned = single_assignment(code);
  std::vector<std::byte> bytes;
  std::size_t work_size = 0;
  for (Stretch& stretch : stretches) {
    if (stretch.offset) {
      const auto assembled = assemble_lanes(code, assigned, stretch.first, stretch.last, lanes);
      if (!assembled) {
        return nullptr;
      }
      constexpr std::size_t alignment = 64;
      bytes.resize((bytes.size() + alignment - 1) / alignment * alignment);
      stretch.offset = bytes.size();
      bytes.insert(bytes.end(), assembled->bytes.begin(), assembled->bytes.end());
      work_size = std::max(work_size, assembled->work_size * static_cast<std::size_t>(lanes));
    }
  }
  std::optional<ExecutableMemory> memory = ExecutableMemory::with(bytes);
  if (!memory) {
    return nullptr;
  }
  const std::shared_ptr<BatchProgram> program(new BatchProgram(std::move(*memory)));
  program->stretches_ = std::move(stretches);
  program->work_size_ = work_size;
  program->bytes_ = bytes.size();
  return program;
}

void BatchProgram::run(const batch::Block& block, batch::Kernel kernel, double* work) const {
  for (const Stretch& stretch : stretches_) {
    if (stretch.offset) {
      const auto function = std::bit_cast<Function>(static_cast<std::byte*>(memory_.begin()) + *stretch.offset);
      // Inputs are read alone, all others are where they are written.
      function(const_cast<double* const*>(block.read), work, block.points * sizeof(double));
    } else {
      kernel({block.points, block.begin + stretch.first, block.begin + stretch.last, block.read, block.write});
    }
  }
}

}  // namespace rubato::formula
