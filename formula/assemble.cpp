#include <rubato/formula/assemble.hpp>

#if defined(RUBATO_ASMJIT) && defined(__x86_64__)

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <numeric>
#include <utility>

#include <rubato/base/lanes.hpp>
#include <rubato/formula/scalar_functions.hpp>
#include <rubato/formula/straight_code.hpp>

namespace rubato::formula {

namespace {

using asmjit::x86::Gp;
using asmjit::x86::Xmm;

constexpr std::size_t most_constant_stores = 512;
/// Predicates of vcmpsd, ordered and quiet but the last.
constexpr int less = 0x11, less_or_equal = 0x12, unordered = 0x03;

/// A MachineCode: all instructions, at one point. Calls lose all registers.
class PointCode final : StraightCode {
public:
  PointCode(const Bytecode& code, const SingleAssignment& assigned, std::span<const std::uint32_t> order)
      : PointCode(code, assigned, order, assigned.steps.size()) {}

  /// The part of rolled code that these instructions are.
  PointCode(const Bytecode& code, const SingleAssignment& assigned, std::span<const std::uint32_t> order,
            const RolledCode& rolled)
      : PointCode(code, assigned, order, order.size()) {
    rolled_ = &rolled;
    std::vector<bool> here(assigned.steps.size(), false);
    for (const std::uint32_t i : order) {
      here[i] = true;
    }
    for (auto v = static_cast<ValueNumber>(fixed()); v < values_.size(); ++v) {
      if (rolled.place[v] != never && !here[assigned.maker[v - fixed()]]) {
        values_[v].home = {Home::Place::kept, rolled.place[v]};
      }
    }
  }

  std::optional<Assembled> run_single(std::span<const std::uint32_t> late) {
    begin(late);
    body();
    end();
    return result();
  }
  std::optional<Assembled> run() {
    const bool writes_constants = write_constants();
    const std::size_t entry = a_.offset();
    std::vector<std::uint32_t> inputs(code_.input_count());
    std::iota(inputs.begin(), inputs.end(), 0U);
    begin(inputs);
    body();
    end();
    std::optional<Assembled> assembled = result();
    if (assembled) {
      assembled->entry = entry;
      assembled->writes_constants = writes_constants;
    }
    return assembled;
  }

private:
  PointCode(const Bytecode& code, const SingleAssignment& assigned, std::span<const std::uint32_t> order,
            std::size_t count)
      : StraightCode(code, assigned, order, 0, count, 1) {
    next_output_.assign(assigned_.outputs.size(), never);
    for (std::size_t j = assigned_.outputs.size(); j-- > 0;) {
      Value& value = values_[assigned_.outputs[j]];
      next_output_[j] = std::exchange(value.first_output, static_cast<std::uint32_t>(j));
    }
    calls_ = std::ranges::any_of(code.instructions(),
                                 [](const Instruction& i) { return is_called(i.code) || i.code == OpCode::sincos; });
  }

  [[nodiscard]] static Xmm xmm(int number) { return Xmm(static_cast<std::uint32_t>(number)); }

  [[nodiscard]] Mem memory(Home home) const override {
    const auto offset = static_cast<std::int32_t>(home.index * sizeof(double));
    switch (home.place) {
      case Home::Place::input: return asmjit::x86::qword_ptr(inputs_, offset);
      case Home::Place::output: return asmjit::x86::qword_ptr(outputs_, offset);
      case Home::Place::kept: return asmjit::x86::qword_ptr(work_, offset);
      case Home::Place::work:
        return asmjit::x86::qword_ptr(
            work_, offset + static_cast<std::int32_t>(rolled_ == nullptr ? 0 : rolled_->places * sizeof(double)));
      default: return asmjit::x86::qword_ptr(pool_, constant_offset(home.index));
    }
  }

  void write_outputs(ValueNumber v, int reg) override {
    Value& value = values_[v];
    if (const std::uint32_t place = kept_at(v); place != never && value.home.place == Home::Place::nowhere) {
      value.home = {Home::Place::kept, place};
      a_.vmovsd(memory(value.home), xmm(reg));
    }
    for (std::uint32_t j = value.first_output; j != never; j = next_output_[j]) {
      const Home home{Home::Place::output, j};
      if (value.home.place == Home::Place::nowhere) {
        value.home = home;
      }
      a_.vmovsd(memory(home), xmm(reg));
    }
  }

  /// Two operands in registers, a target that is neither, and room for a mask.
  template <typename Body>
  void choice(const SingleAssignment::Step& values, Body body) {
    const ValueNumber a = values.operands[0], b = values.operands[1];
    if (values_[b].reg != no_register) {
      pin(values_[b].reg);
    }
    const int first = load(a);
    const int second = load(b);
    const int target = take_register();
    const int mask = take_register();
    body(xmm(target), xmm(mask), xmm(first), xmm(second));
    release(a);
    release(b);
    finish(values.first_result, target);
  }

  /// min(a, b) of the machine is b where one is NaN: a where that is NaN.
  void extremum(Arithmetic what, const SingleAssignment::Step& values) {
    choice(values, [&](Xmm target, Xmm mask, Xmm a, Xmm b) {
      a_.emit(what, target, a, b);
      a_.vcmpsd(mask, a, a, unordered);
      a_.vblendvpd(target, target, a, mask);
    });
  }

  /// b where a > 0 (a <= 0), 0 where not, a where it is NaN.
  void where(bool positive, const SingleAssignment::Step& values) {
    choice(values, [&](Xmm target, Xmm mask, Xmm a, Xmm b) {
      a_.vxorpd(mask, mask, mask);
      if (positive) {
        a_.vcmpsd(target, mask, a, less);
      } else {
        a_.vcmpsd(target, a, mask, less_or_equal);
      }
      a_.vandpd(target, target, b);
      a_.vcmpsd(mask, a, a, unordered);
      a_.vblendvpd(target, target, a, mask);
    });
  }

  /// 1 or -1 where a > 0 or a < 0, else a.
  void sign(const SingleAssignment::Step& values) {
    const ValueNumber a = values.operands[0];
    const Xmm from = xmm(load(a));
    const int target = take_register();
    const Xmm result = xmm(target), mask = xmm(take_register()), unit = xmm(take_register());
    a_.vmovsd(unit, one());
    a_.vxorpd(mask, mask, mask);
    a_.vcmpsd(result, mask, from, less);
    a_.vcmpsd(mask, from, mask, less);
    a_.vblendvpd(result, from, unit, result);
    a_.vxorpd(unit, unit, sign_bit());
    a_.vblendvpd(result, result, unit, mask);
    release(a);
    finish(values.first_result, target);
  }

  // ---- calls, to which all registers are lost

  void store_registers() {
    for (int reg = 0; reg < shape_.registers; ++reg) {
      const ValueNumber v = holds_[static_cast<std::size_t>(reg)];
      if (v != never && next_use(v) != never) {
        store(v);
      }
    }
  }
  void forget_registers() {
    for (int reg = 0; reg < shape_.registers; ++reg) {
      let_go(reg);
    }
  }
  void move(int to, ValueNumber v) {
    if (values_[v].reg == no_register) {
      a_.vmovsd(xmm(to), memory(values_[v].home));
    } else if (values_[v].reg != to) {
      a_.vmovapd(xmm(to), xmm(values_[v].reg));
    }
  }
  void call(const void* function) {
    const auto found = std::ranges::find(functions_, function);
    const auto index = static_cast<std::size_t>(found - functions_.begin());
    if (found == functions_.end()) {
      functions_.push_back(function);
    }
    a_.call(asmjit::x86::qword_ptr(pool_, end_of_pool() + static_cast<std::int32_t>(index * sizeof(function))));
  }

  void call(OpCode code, const SingleAssignment::Step& values) {
    const ValueNumber a = values.operands[0], b = values.operands[1];
    const bool two = operand_count(code) == 2;
    store_registers();
    if (two && values_[a].reg == 1 && values_[b].reg == 0) {
      a_.vmovapd(xmm(2), xmm(0));
      a_.vmovapd(xmm(0), xmm(1));
      a_.vmovapd(xmm(1), xmm(2));
    } else if (two && values_[a].reg == 1) {
      move(0, a);
      move(1, b);
    } else {
      if (two) {
        move(1, b);
      }
      move(0, a);
    }
    forget_registers();
    release(a);
    if (two) {
      release(b);
    }
    call(std::bit_cast<const void*>(scalar_function(code)));
    finish(values.first_result, 0);
  }

  void sine_and_cosine(const SingleAssignment::Step& values) {
    const ValueNumber a = values.operands[0];
    store_registers();
    move(0, a);
    forget_registers();
    release(a);
    std::array<Home, 2> homes;
    for (std::uint32_t k = 0; k < 2; ++k) {
      const std::uint32_t output = values_[values.first_result + k].first_output;
      const std::uint32_t place = kept_at(values.first_result + k);
      homes[k] = place != never    ? Home{Home::Place::kept, place}
                 : output != never ? Home{Home::Place::output, output}
                                   : work_place();
      values_[values.first_result + k].home = homes[k];
    }
    a_.lea(asmjit::x86::rdi, memory(homes[0]));
    a_.lea(asmjit::x86::rsi, memory(homes[1]));
    call(std::bit_cast<const void*>(sincos_function()));
    for (std::uint32_t k = 0; k < 2; ++k) {
      const ValueNumber v = values.first_result + k;
      const std::uint32_t written = values_[v].first_output;
      const bool is_written = homes[k].place == Home::Place::output;
      if (const std::uint32_t first = is_written ? next_output_[written] : written; first != never) {
        pinned_ = 0;
        const int reg = load(v);
        for (std::uint32_t j = first; j != never; j = next_output_[j]) {
          a_.vmovsd(memory({Home::Place::output, j}), xmm(reg));
        }
      }
      release(v);
    }
  }

  void translate(OpCode code, const SingleAssignment::Step& values) {
    switch (code) {
      case OpCode::sign: return sign(values);
      case OpCode::min: return extremum(Arithmetic::kIdVminsd, values);
      case OpCode::max: return extremum(Arithmetic::kIdVmaxsd, values);
      case OpCode::where_positive: return where(true, values);
      case OpCode::where_negative: return where(false, values);
      case OpCode::sincos: return sine_and_cosine(values);
      default: return call(code, values);
    }
  }

  // ---- the whole

  /// Writes the outputs that are constants, in pairs where they follow each other; false if they are too many.
  bool write_constants() {
    const auto constant = [&](std::size_t j) {
      const ValueNumber v = j < assigned_.outputs.size() ? assigned_.outputs[j] : never;
      return v >= code_.input_count() && v < fixed() ? v : never;
    };
    std::vector<std::pair<std::size_t, std::size_t>> stores;  // first output, how many
    for (std::size_t j = 0; j < assigned_.outputs.size(); ++j) {
      if (constant(j) != never) {
        if (stores.size() == most_constant_stores) {
          return false;
        }
        const std::size_t count = constant(j + 1) == constant(j) ? 2 : 1;
        stores.emplace_back(j, count);
        j += count - 1;
      }
    }
    ValueNumber loaded = never;
    for (const auto& [j, count] : stores) {
      if (std::exchange(loaded, constant(j)) != constant(j)) {
        a_.vmovddup(xmm(0), memory(values_[loaded].home));
      }
      const auto offset = static_cast<std::int32_t>(j * sizeof(double));
      if (count == 2) {
        a_.vmovupd(asmjit::x86::xmmword_ptr(outputs_, offset), xmm(0));
      } else {
        a_.vmovsd(asmjit::x86::qword_ptr(outputs_, offset), xmm(0));
      }
    }
    return true;
  }

  /// Arguments in registers that calls preserve, if there are calls; three pushes align the stack for them.
  void begin(std::span<const std::uint32_t> late) {
    if (calls_) {
      const std::array saved{asmjit::x86::rbx, asmjit::x86::r14, asmjit::x86::r15};
      for (const Gp& reg : saved) {
        a_.push(reg);
      }
      a_.mov(saved[0], inputs_);
      a_.mov(saved[1], outputs_);
      a_.mov(saved[2], work_);
      inputs_ = saved[0];
      outputs_ = saved[1];
      work_ = saved[2];
    }
    // Outputs that are inputs, or were there before; constants are the caller's.
    for (const ValueNumber v : late) {
      if (values_[v].first_output != never) {
        const int reg = free_register() != no_register ? free_register() : 0;
        let_go(reg);
        a_.vmovsd(xmm(reg), memory(values_[v].home));
        write_outputs(v, reg);
        if (values_[v].next != values_[v].last) {
          put(v, reg);
        }
      }
    }
  }

  void body() {
    for (std::size_t i = first_; i < last_; ++i) {
      if (!arithmetic(i)) {
        translate(instruction(i).code, step(i));
      }
    }
  }

  void end() {
    if (calls_) {
      a_.pop(work_);
      a_.pop(outputs_);
      a_.pop(inputs_);
    }
    a_.ret();
    embed_pool();
    a_.embed(functions_.data(), functions_.size() * sizeof(void*));
  }

  asmjit::x86::Assembler& a_ = emitter();
  Gp inputs_ = asmjit::x86::rdi, outputs_ = asmjit::x86::rsi, work_ = asmjit::x86::rdx;
  /// Where a value is kept for other parts of rolled code.
  [[nodiscard]] std::uint32_t kept_at(ValueNumber v) const {
    return rolled_ == nullptr || v < fixed() ? never : rolled_->place[v];
  }

  const RolledCode* rolled_ = nullptr;
  std::vector<std::uint32_t> next_output_;  ///< of the same value
  std::vector<const void*> functions_;
  bool calls_ = false;
};

/// As many as the kernels of batches take (base/lanes.hpp).
int lanes_of_machine() {
  const auto& features = asmjit::CpuInfo::host().features().x86();
  const int most = features.hasAVX512_F() && features.hasAVX512_DQ() ? 8 : 4;
  return lanes_asked_for() == 0 ? most : std::min(most, lanes_asked_for());
}

}  // namespace

std::optional<Assembled> assemble(const Bytecode& code) {
  static const bool has_avx = asmjit::CpuInfo::host().features().x86().hasAVX();
  if (!has_avx) {
    return std::nullopt;
  }
  const SingleAssignment assigned = single_assignment(code);
  if (std::optional<Assembled> rolled = assemble_rolled(code, assigned, lanes_of_machine())) {
    return rolled;
  }
  std::optional<Assembled> assembled = PointCode(code, assigned, {}).run();
  if (assembled && assembled->work_size > 0) {
    // The shorter code has fewer values to store and to load again.
    std::optional<Assembled> eager = PointCode(code, assigned, eager_order(code, assigned)).run();
    if (eager && eager->bytes.size() < assembled->bytes.size()) {
      return eager;
    }
  }
  return assembled;
}

std::optional<Assembled> assemble_single(const Bytecode& code, const SingleAssignment& assigned,
                                         const RolledCode& rolled, std::span<const std::uint32_t> single,
                                         std::span<const std::uint32_t> late) {
  return PointCode(code, assigned, single, rolled).run_single(late);
}

}  // namespace rubato::formula

#else

namespace rubato::formula {

std::optional<Assembled> assemble(const Bytecode&) {
  return std::nullopt;
}

std::optional<Assembled> assemble_single(const Bytecode&, const SingleAssignment&, const RolledCode&,
                                         std::span<const std::uint32_t>, std::span<const std::uint32_t>) {
  return std::nullopt;
}

}  // namespace rubato::formula

#endif
