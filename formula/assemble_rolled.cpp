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

/// A loop of rolled code, as a MachineCode::Function: the first members of its runs, then as many further ones at a
/// time as there are lanes. Where the length is no multiple of these the last ones overlap: what is computed twice is
/// the same.
class RolledLoop final : StraightCode {
public:
  RolledLoop(const Bytecode& code, const SingleAssignment& assigned, const RolledCode& rolled,
             const RolledCode::Loop& loop, int lanes)
      : StraightCode(code, assigned, loop.body, 0, loop.body.size(), lanes), rolled_(rolled), loop_(loop) {
    std::vector<ValueNumber> made;
    for (const std::uint32_t i : loop.body) {
      made.push_back(assigned.steps[i].first_result);
    }
    for (const std::uint32_t i : loop.body) {
      for (int k = 0; k < operand_count(code.instructions()[i].code); ++k) {
        const ValueNumber v = assigned.steps[i].operands[static_cast<std::size_t>(k)];
        if (v >= fixed() && std::ranges::find(made, v) == made.end()) {
          values_[v].home = {Home::Place::kept, rolled.place[v]};
        }
        if (v < code.input_count() && rolled.common[v] && std::ranges::find(common_, v) == common_.end()) {
          values_[v].home = {Home::Place::common, static_cast<std::uint32_t>(work_size_++)};
          common_.push_back(v);
        }
      }
    }
    for (const RolledCode::Store& store : loop.stores) {
      if (scale_of(store.stride) == unscaled && std::ranges::find(strides_, store.stride) == strides_.end()) {
        strides_.push_back(store.stride);
      }
    }
  }

  std::optional<Assembled> run() {
    if (strides_.size() > scaled.size()) {
      return std::nullopt;
    }
    const auto last = static_cast<std::int32_t>(loop_.length * sizeof(double)) - width();
    a_.xor_(index_.r32(), index_.r32());
    const asmjit::Label again = a_.newLabel(), done = a_.newLabel();
    if (last > 0) {
      a_.mov(last_index_, last);
    }
    for (const ValueNumber v : common_) {
      spread(v);
    }
    a_.bind(again);
    for (std::size_t k = 0; k < strides_.size(); ++k) {
      a_.imul(scaled[k], index_, static_cast<std::int32_t>(strides_[k]));
    }
    for (std::size_t i = first_; i < last_; ++i) {
      arithmetic(i);
    }
    if (last > 0) {
      a_.cmp(index_, last_index_);
      a_.je(done);
      a_.add(index_, width());
      a_.cmp(index_, last_index_);
      a_.cmova(index_, last_index_);
      a_.jmp(again);
    }
    a_.bind(done);
    if (shape_.lanes > 2) {
      a_.vzeroupper();
    }
    a_.ret();
    embed_pool();
    std::optional<Assembled> assembled = result();
    if (assembled) {
      assembled->work_size *= static_cast<std::size_t>(shape_.lanes);
    }
    return assembled;
  }

private:
  static constexpr int unscaled = -1;
  static constexpr std::array<Gp, 3> scaled{asmjit::x86::r8, asmjit::x86::r9, asmjit::x86::r10};

  /// The stride as an address has it, in powers of two.
  static int scale_of(std::uint32_t stride) {
    return stride == 1 ? 0 : stride == 2 ? 1 : stride == 4 ? 2 : stride == 8 ? 3 : unscaled;
  }
  /// An input, once for each lane, to where the loop reads it.
  void spread(ValueNumber v) {
    const Mem from = asmjit::x86::qword_ptr(inputs_, static_cast<std::int32_t>(v * sizeof(double)));
    a_.emit(shape_.lanes == 2 ? Arithmetic::kIdVmovddup : Arithmetic::kIdVbroadcastsd, vec(0), from);
    a_.emit(shape_.move, memory(values_[v].home), vec(0));
  }
  [[nodiscard]] int width() const { return shape_.lanes * static_cast<int>(sizeof(double)); }

  [[nodiscard]] Mem memory(Home home) const override {
    const auto size = static_cast<std::uint32_t>(width());
    const auto offset = static_cast<std::int32_t>(home.index * sizeof(double));
    switch (home.place) {
      case Home::Place::input: return asmjit::x86::ptr(inputs_, index_, 0, offset, size);
      case Home::Place::kept: return asmjit::x86::ptr(work_, index_, 0, offset, size);
      case Home::Place::work:
      case Home::Place::common:
        return asmjit::x86::ptr(work_,
                                static_cast<std::int32_t>(rolled_.places * sizeof(double)) +
                                    static_cast<std::int32_t>(home.index) * width(),
                                size);
      default: return asmjit::x86::ptr(pool_, constant_offset(home.index), size);
    }
  }

  void write_outputs(ValueNumber v, int reg) override {
    Value& value = values_[v];
    if (const std::uint32_t place = rolled_.place[v]; place != RolledCode::none) {
      value.home = {Home::Place::kept, place};
      a_.emit(shape_.move, memory(value.home), vec(reg));
    }
    for (const RolledCode::Store& store : loop_.stores) {
      if (store.value != v) {
        continue;
      }
      const auto offset = static_cast<std::int32_t>(store.first * sizeof(double));
      if (store.stride == 1) {
        a_.emit(shape_.move, asmjit::x86::ptr(outputs_, index_, 0, offset, static_cast<std::uint32_t>(width())),
                vec(reg));
        continue;
      }
      if (value.home.place == Home::Place::nowhere) {
        this->store(v);
      }
      // One by one, from where they stand.
      const Mem from = memory(value.home);
      const int scale = scale_of(store.stride);
      const auto which = static_cast<std::size_t>(std::ranges::find(strides_, store.stride) - strides_.begin());
      for (int lane = 0; lane < shape_.lanes; ++lane) {
        const std::int32_t further =
            offset + lane * static_cast<std::int32_t>(store.stride) * static_cast<std::int32_t>(sizeof(double));
        Mem number = from.cloneAdjusted(static_cast<std::int64_t>(lane) * static_cast<std::int64_t>(sizeof(double)));
        number.setSize(sizeof(double));
        a_.mov(scratch_, number);
        a_.mov(scale == unscaled ? asmjit::x86::qword_ptr(outputs_, scaled[which], 0, further)
                                 : asmjit::x86::qword_ptr(outputs_, index_, static_cast<std::uint32_t>(scale), further),
               scratch_);
      }
    }
  }

  asmjit::x86::Assembler& a_ = emitter();
  const Gp inputs_ = asmjit::x86::rdi, outputs_ = asmjit::x86::rsi, work_ = asmjit::x86::rdx;
  const Gp index_ = asmjit::x86::rax, last_index_ = asmjit::x86::rcx;
  const Gp scratch_ = asmjit::x86::r11;
  const RolledCode& rolled_;
  const RolledCode::Loop& loop_;
  std::vector<std::uint32_t> strides_;  ///< that addresses do not have
  std::vector<ValueNumber> common_;     ///< inputs that are the same for all members
};

/// Calls the parts one after the other, all with the same arguments; copies in between.
class Sequence {
public:
  Sequence() {
    list_.init(asmjit::Environment::host());
    list_.attach(&a_);
    for (const Gp& reg : saved) {
      a_.push(reg);
    }
    a_.mov(saved[0], asmjit::x86::rdi);
    a_.mov(saved[1], asmjit::x86::rsi);
    // Work space begins with a line of the cache.
    a_.lea(saved[2], asmjit::x86::ptr(asmjit::x86::rdx, line - 1));
    a_.and_(saved[2], -line);
  }

  void call(Assembled part) {
    work_size_ = std::max(work_size_, part.work_size);
    a_.mov(asmjit::x86::rdi, saved[0]);
    a_.mov(asmjit::x86::rsi, saved[1]);
    a_.mov(asmjit::x86::rdx, saved[2]);
    parts_.emplace_back(a_.newLabel(), std::move(part.bytes));
    a_.call(parts_.back().first);
  }

  void copy(const RolledCode::Copy& copy) {
    constexpr auto size = static_cast<std::int32_t>(sizeof(double));
    a_.lea(asmjit::x86::rdi, asmjit::x86::ptr(saved[1], static_cast<std::int32_t>(copy.to) * size));
    a_.lea(asmjit::x86::rsi, asmjit::x86::ptr(saved[0], static_cast<std::int32_t>(copy.from) * size));
    a_.mov(asmjit::x86::ecx, copy.count);
    a_.rep().movsq();
  }

  std::optional<Assembled> result(const Bytecode& code, std::size_t places) {
    for (std::size_t k = saved.size(); k-- > 0;) {
      a_.pop(saved[k]);
    }
    a_.ret();
    for (const auto& [label, bytes] : parts_) {
      a_.align(asmjit::AlignMode::kCode, line);
      a_.bind(label);
      a_.embed(bytes.data(), bytes.size());
    }
    const auto is_constant = [&](std::uint32_t v) {
      return v >= code.input_count() && v < code.input_count() + code.constants().size();
    };
    const asmjit::CodeBuffer& buffer = list_.textSection()->buffer();
    const auto* const first = reinterpret_cast<const std::byte*>(buffer.data());
    return Assembled{.bytes = {first, first + buffer.size()},
                     .entry = 0,
                     .writes_constants = std::ranges::none_of(code.outputs(), is_constant),
                     .work_size = places + work_size_ + line / sizeof(double),
                     .in_loops = true};
  }

private:
  static constexpr int line = 64;
  /// Preserved by calls; three pushes align the stack for these.
  static constexpr std::array<Gp, 3> saved{asmjit::x86::rbp, asmjit::x86::r14, asmjit::x86::r15};

  asmjit::CodeHolder list_;
  asmjit::x86::Assembler a_;
  std::vector<std::pair<asmjit::Label, std::vector<std::byte>>> parts_;
  std::size_t work_size_ = 0;
};

}  // namespace

std::optional<Assembled> assemble_rolled(const Bytecode& code, const SingleAssignment& assigned, int lanes) {
  const std::optional<RolledCode> rolled = roll(code, assigned, lanes);
  if (!rolled) {
    return std::nullopt;
  }
  Sequence sequence;
  for (const RolledCode::Phase& phase : rolled->phases) {
    for (const RolledCode::Loop& loop : phase.loops) {
      std::optional<Assembled> part = RolledLoop(code, assigned, *rolled, loop, lanes).run();
      if (!part) {
        return std::nullopt;
      }
      sequence.call(std::move(*part));
    }
    const bool is_last = &phase == &rolled->phases.back();
    if (!phase.single.empty() || (is_last && !rolled->late.empty())) {
      std::optional<Assembled> part =
          assemble_single(code, assigned, *rolled, phase.single,
                          is_last ? std::span<const std::uint32_t>(rolled->late) : std::span<const std::uint32_t>());
      if (!part) {
        return std::nullopt;
      }
      sequence.call(std::move(*part));
    }
  }
  for (const RolledCode::Copy& copy : rolled->copies) {
    sequence.copy(copy);
  }
  return sequence.result(code, rolled->places);
}

}  // namespace rubato::formula

#else

namespace rubato::formula {

std::optional<Assembled> assemble_rolled(const Bytecode&, const SingleAssignment&, int) {
  return std::nullopt;
}

}  // namespace rubato::formula

#endif
