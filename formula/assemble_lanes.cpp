#include <rubato/formula/assemble.hpp>

#if defined(RUBATO_ASMJIT) && defined(__x86_64__)

#include <algorithm>
#include <array>
#include <cstdint>
#include <utility>

#include <rubato/formula/straight_code.hpp>

namespace rubato::formula {

namespace {

using asmjit::x86::Gp;

/// A loop over the points of a block. `input` and `output` places are registers of the code, each an array of the block
/// behind a pointer; those used oftenest have their pointers in the machine's registers.
class LaneCode final : StraightCode {
public:
  LaneCode(const Bytecode& code, const SingleAssignment& assigned, std::size_t first, std::size_t last, int lanes)
      : StraightCode(code, assigned, {}, first, last, lanes) {
    find_places();
    choose_pointers();
  }

  std::optional<Assembled> run() {
    for (std::size_t k = 0; k < saved_; ++k) {
      a_.push(pointers[first_saved + k]);
    }
    for (std::size_t k = 0; k < pointer_of_.size(); ++k) {
      if (pointer_of_[k] != none) {
        a_.mov(pointers[pointer_of_[k]], table(static_cast<std::uint32_t>(k)));
      }
    }
    const asmjit::Label again = a_.newLabel();
    a_.bind(again);
    for (std::size_t i = first_; i < last_; ++i) {
      arithmetic(i);
    }
    a_.add(index_, width());
    a_.cmp(index_, end_);
    a_.jb(again);
    if (shape_.lanes > 2) {
      a_.vzeroupper();
    }
    for (std::size_t k = saved_; k-- > 0;) {
      a_.pop(pointers[first_saved + k]);
    }
    a_.ret();
    embed_pool();
    return result();
  }

private:
  static constexpr std::uint8_t none = 0xff;
  static constexpr std::size_t first_saved = 4;
  static constexpr std::array<Gp, 10> pointers{asmjit::x86::r8,  asmjit::x86::r9,  asmjit::x86::r10, asmjit::x86::r11,
                                               asmjit::x86::rbx, asmjit::x86::rbp, asmjit::x86::r12, asmjit::x86::r13,
                                               asmjit::x86::r14, asmjit::x86::r15};

  [[nodiscard]] int width() const { return shape_.lanes * static_cast<int>(sizeof(double)); }
  [[nodiscard]] Mem table(std::uint32_t place) const {
    return asmjit::x86::qword_ptr(table_, static_cast<std::int32_t>(place * sizeof(double*)));
  }

  /// Where values of before stand, and where those go that are needed after: as instructions, or as outputs.
  void find_places() {
    const auto instructions = code_.instructions();
    std::vector<std::uint32_t> place(values_.size());
    for (std::uint32_t v = 0; v < fixed(); ++v) {
      place[v] = v;
    }
    for (std::size_t i = 0; i < instructions.size(); ++i) {
      const std::uint32_t result = assigned_.steps[i].first_result;
      place[result] = instructions[i].target;
      if (instructions[i].code == OpCode::sincos) {
        place[result + 1] = instructions[i].b;
      }
    }
    const auto made_here = [&](ValueNumber v) {
      return v >= fixed() && assigned_.maker[v - fixed()] >= first_ && assigned_.maker[v - fixed()] < last_;
    };
    for (ValueNumber v = static_cast<ValueNumber>(fixed()); v < values_.size(); ++v) {
      if (assigned_.maker[v - fixed()] < first_) {
        values_[v].home = {Home::Place::input, place[v]};
      }
    }
    const auto needed = [&](ValueNumber v) {
      if (made_here(v)) {
        values_[v].first_output = place[v];
      }
    };
    for (std::size_t i = last_; i < instructions.size(); ++i) {
      for (int k = 0; k < operand_count(instructions[i].code); ++k) {
        needed(assigned_.steps[i].operands[static_cast<std::size_t>(k)]);
      }
    }
    for (const ValueNumber v : assigned_.outputs) {
      needed(v);
    }
  }

  void choose_pointers() {
    std::vector<std::pair<std::uint32_t, std::uint32_t>> uses(code_.register_count());
    for (std::uint32_t k = 0; k < uses.size(); ++k) {
      uses[k] = {0, k};
    }
    for (const Value& value : values_) {
      if (value.home.place == Home::Place::input) {
        uses[value.home.index].first += value.last - value.next;
      } else if (value.first_output != never) {
        uses[value.first_output].first += 1;
      }
    }
    pointer_of_.assign(uses.size(), none);
    std::ranges::sort(uses, [](const auto& x, const auto& y) {
      return x.first != y.first ? x.first > y.first : x.second < y.second;
    });
    std::size_t chosen = 0;
    for (; chosen < std::min(uses.size(), pointers.size()) && uses[chosen].first > 0; ++chosen) {
      pointer_of_[uses[chosen].second] = static_cast<std::uint8_t>(chosen);
    }
    saved_ = chosen > first_saved ? chosen - first_saved : 0;
  }

  [[nodiscard]] Mem memory(Home home) const override {
    const auto size = static_cast<std::uint32_t>(width());
    if (home.place == Home::Place::constant) {
      return asmjit::x86::ptr(pool_, constant_offset(home.index), size);
    }
    if (home.place == Home::Place::work) {
      return asmjit::x86::ptr(work_, static_cast<std::int32_t>(home.index) * width(), size);
    }
    if (pointer_of_[home.index] != none) {
      return asmjit::x86::ptr(pointers[pointer_of_[home.index]], index_, 0, 0, size);
    }
    a_.mov(scratch_, table(home.index));
    return asmjit::x86::ptr(scratch_, index_, 0, 0, size);
  }

  void write_outputs(ValueNumber v, int reg) override {
    Value& value = values_[v];
    if (value.first_output != never) {
      value.home = {Home::Place::output, value.first_output};
      a_.emit(shape_.move, memory(value.home), vec(reg));
    }
  }

  asmjit::x86::Assembler& a_ = emitter();
  const Gp table_ = asmjit::x86::rdi, work_ = asmjit::x86::rsi, index_ = asmjit::x86::rdx, end_ = asmjit::x86::rcx;
  const Gp scratch_ = asmjit::x86::rax;
  std::vector<std::uint8_t> pointer_of_;  ///< by register of the code
  std::size_t saved_ = 0;
};

}  // namespace

bool is_arithmetic(OpCode code) {
  return code <= OpCode::integer_power || code == OpCode::abs || code == OpCode::sqrt;
}

std::optional<Assembled> assemble_lanes(const Bytecode& code, const SingleAssignment& assigned, std::size_t first,
                                        std::size_t last, int lanes) {
  static const bool has_avx = asmjit::CpuInfo::host().features().x86().hasAVX();
  return has_avx ? LaneCode(code, assigned, first, last, lanes).run() : std::nullopt;
}

}  // namespace rubato::formula

#else

namespace rubato::formula {

bool is_arithmetic(OpCode) {
  return false;
}

std::optional<Assembled> assemble_lanes(const Bytecode&, const SingleAssignment&, std::size_t, std::size_t, int) {
  return std::nullopt;
}

}  // namespace rubato::formula

#endif
