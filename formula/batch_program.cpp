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
  // Where the code of the instructions begins.
  const auto append = [&](std::size_t first, std::size_t last, int width) -> std::optional<std::size_t> {
    const auto assembled = assemble_lanes(code, assigned, first, last, width);
    if (!assembled) {
      return std::nullopt;
    }
    constexpr std::size_t alignment = 64;
    bytes.resize((bytes.size() + alignment - 1) / alignment * alignment);
    const std::size_t offset = bytes.size();
    bytes.insert(bytes.end(), assembled->bytes.begin(), assembled->bytes.end());
    work_size = std::max(work_size, assembled->work_size * static_cast<std::size_t>(width));
    return offset;
  };
  for (Stretch& stretch : stretches) {
    if (stretch.offset) {
      stretch.offset = append(stretch.first, stretch.last, lanes);
      if (!stretch.offset) {
        return nullptr;
      }
    }
  }
  std::vector<Narrow> narrow;
  if (stretches.size() == 1 && instructions.size() <= longest_for_any_number) {
    for (int width = lanes / 2; width >= 1; width /= 2) {
      const auto offset = append(0, instructions.size(), width);
      if (!offset) {
        return nullptr;
      }
      narrow.push_back({static_cast<std::size_t>(width), *offset});
    }
  }
  std::optional<ExecutableMemory> memory = ExecutableMemory::with(bytes);
  if (!memory) {
    return nullptr;
  }
  const std::shared_ptr<BatchProgram> program(new BatchProgram(std::move(*memory)));
  program->stretches_ = std::move(stretches);
  program->narrow_ = std::move(narrow);
  program->lanes_ = static_cast<std::size_t>(lanes);
  program->work_size_ = work_size;
  program->bytes_ = bytes.size();
  return program;
}

BatchProgram::Function BatchProgram::at(std::size_t offset) const {
  return std::bit_cast<Function>(memory_.begin() + offset);
}

BatchProgram::Function BatchProgram::in_one_go(std::size_t points) const {
  if (stretches_.size() != 1 || points == 0) {
    return nullptr;
  }
  if (points % lanes_ == 0) {
    return at(*stretches_.front().offset);
  }
  const auto narrow = std::ranges::find(narrow_, points, &Narrow::lanes);
  return narrow == narrow_.end() ? nullptr : at(narrow->offset);
}

void BatchProgram::run(const batch::Block& block, batch::Kernel kernel, double* work) const {
  // Inputs are read alone, all others are where they are written.
  double* const* const registers = const_cast<double* const*>(block.read);
  if (takes_any_number()) {
    std::size_t done = block.points / lanes_ * lanes_;
    if (done > 0) {
      at (*stretches_.front().offset)(registers, work, 0, done * sizeof(double));
    }
    for (const Narrow& narrow : narrow_) {
      if (done + narrow.lanes <= block.points) {
        at(narrow.offset)(registers, work, done * sizeof(double), (done + narrow.lanes) * sizeof(double));
        done += narrow.lanes;
      }
    }
    return;
  }
  for (const Stretch& stretch : stretches_) {
    if (stretch.offset) {
      at (*stretch.offset)(registers, work, 0, block.points * sizeof(double));
    } else {
      kernel({block.points, block.begin + stretch.first, block.begin + stretch.last, block.read, block.write});
    }
  }
}

}  // namespace rubato::formula
