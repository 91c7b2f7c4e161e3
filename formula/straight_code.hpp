#pragma once

#if defined(RUBATO_ASMJIT) && defined(__x86_64__)  // asmjit is not needed where the library is used

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <utility>
#include <vector>

#include <asmjit/x86.h>

#include <rubato/formula/assemble.hpp>
#include <rubato/formula/single_assignment.hpp>

/// What assembling code for one point and for several side by side have in common; of no use elsewhere.
namespace rubato::formula {

/// Straight-line code, one instruction after the other: each value stands in a register until the one whose next use is
/// farthest has to give way (L. A. Belady, IBM Systems J. 5 (1966) 78), and is stored then unless it has a home. The
/// time is linear in the length of the code.
class StraightCode {
protected:
  using ValueNumber = std::uint32_t;
  using Arithmetic = asmjit::x86::Inst::Id;
  using Vec = asmjit::x86::Vec;
  using Mem = asmjit::x86::Mem;
  static constexpr std::uint32_t never = std::numeric_limits<std::uint32_t>::max();
  static constexpr int no_register = -1;

  /// The machine's instructions for doubles, one or several at a time.
  struct Shape {
    int lanes, registers;
    Arithmetic move, add, subtract, multiply, divide;
  };
  static Shape shape(int lanes) {
    if (lanes == 1) {
      return {1,
              16,
              Arithmetic::kIdVmovsd,
              Arithmetic::kIdVaddsd,
              Arithmetic::kIdVsubsd,
              Arithmetic::kIdVmulsd,
              Arithmetic::kIdVdivsd};
    }
    return {lanes,
            lanes == 8 ? 32 : 16,
            Arithmetic::kIdVmovupd,
            Arithmetic::kIdVaddpd,
            Arithmetic::kIdVsubpd,
            Arithmetic::kIdVmulpd,
            Arithmetic::kIdVdivpd};
  }

  /// Where a value can be read again once its register has been given to another: `work` is given to others when it is
  /// read no more, `common` and `kept` are not.
  struct Home {
    enum class Place : std::uint8_t { nowhere, input, constant, output, work, common, kept } place = Place::nowhere;
    std::uint32_t index = 0;
  };
  struct Value {
    std::uint32_t next = 0, last = 0;  ///< its uses still to come, in uses_
    std::uint32_t first_output = never;
    std::int8_t reg = no_register;
    Home home;
  };

  /// Of the instructions first … last - 1, or in another order, if there is one, of those at these places of it.
  StraightCode(const Bytecode& code, const SingleAssignment& assigned, std::span<const std::uint32_t> order,
               std::size_t first, std::size_t last, int lanes);
  ~StraightCode() = default;
  StraightCode(const StraightCode&) = delete;
  StraightCode& operator=(const StraightCode&) = delete;

  [[nodiscard]] virtual Mem memory(Home home) const = 0;
  /// The value has just come to be, in a register.
  virtual void write_outputs(ValueNumber v, int reg) = 0;

  [[nodiscard]] std::size_t fixed() const { return code_.input_count() + code_.constants().size(); }
  /// The first use after the instruction at hand.
  [[nodiscard]] std::uint32_t next_use(ValueNumber v);

  [[nodiscard]] Vec vec(int number) const;
  [[nodiscard]] Home work_place();
  void store(ValueNumber v);
  void pin(int reg) { pinned_ |= 1U << static_cast<unsigned>(reg); }
  void unpin(int reg) { pinned_ &= ~(1U << static_cast<unsigned>(reg)); }
  [[nodiscard]] bool is_pinned(int reg) const { return (pinned_ >> static_cast<unsigned>(reg) & 1U) != 0; }
  void let_go(int reg);
  [[nodiscard]] int free_register() const;
  /// A register for a new value, pinned until the end of the instruction.
  [[nodiscard]] int take_register();
  void put(ValueNumber v, int reg);
  /// The value in a register, pinned.
  int load(ValueNumber v);
  /// Loads it if it will be wanted again and there is room.
  void load_if_cheap(ValueNumber v);
  /// The register of an operand that is not used again is free from here on, its place once it has been read.
  ///@{
  void release_register(ValueNumber v);
  void release(ValueNumber v);
  ///@}
  /// The value is in the register: keeps it, and writes it where it is an output.
  void finish(ValueNumber v, int reg);

  /// Begins an instruction, and translates it if it is one of arithmetic.
  bool arithmetic(std::size_t i);
  [[nodiscard]] std::size_t at(std::size_t i) const { return order_.empty() ? i : order_[i]; }
  [[nodiscard]] const Instruction& instruction(std::size_t i) const { return code_.instructions()[at(i)]; }
  [[nodiscard]] const SingleAssignment::Step& step(std::size_t i) const { return assigned_.steps[at(i)]; }

  /// Masks, constants, and what follows them; their places, from the label pool_.
  ///@{
  void embed_pool();
  [[nodiscard]] Mem sign_bit() const;
  [[nodiscard]] Mem other_bits() const;
  [[nodiscard]] std::int32_t constant_offset(std::size_t index) const;
  [[nodiscard]] Mem one() const;
  [[nodiscard]] std::int32_t end_of_pool() const { return constant_offset(code_.constants().size() + 1); }
  ///@}
  /// What has been assembled, if all could be said.
  [[nodiscard]] std::optional<Assembled> result() const;

  asmjit::x86::Assembler& emitter() { return a_; }

  const Bytecode& code_;
  const SingleAssignment& assigned_;
  const std::span<const std::uint32_t> order_;
  const std::size_t first_, last_;
  const Shape shape_;
  asmjit::Label pool_;
  std::vector<Value> values_;
  std::vector<ValueNumber> holds_;  ///< by register
  std::uint32_t pinned_ = 0;
  std::uint32_t now_ = 0;
  std::size_t work_size_ = 0;

private:
  /// Notes that something could not be said in machine code.
  class Errors final : public asmjit::ErrorHandler {
  public:
    void handleError(asmjit::Error, const char*, asmjit::BaseEmitter*) override { any = true; }
    bool any = false;
  };

  void list_uses();
  /// Loads the first operand, which the machine wants in a register; of two that may change places the one that stands
  /// there.
  void load_first(ValueNumber& a, ValueNumber& b, bool commutes);
  /// target = a ∘ b, where b stands in a register or at home.
  void emit(Arithmetic what, int target, int a, int b, Home home);
  void binary(Arithmetic what, bool commutes, const SingleAssignment::Step& values);
  /// ±a b ± c, the product rounded.
  void fused(OpCode code, const SingleAssignment::Step& values);
  /// One operand, in a register; `body` gets the numbers of the target and of the operand's register, perhaps the same.
  template <typename Body>
  void unary(const SingleAssignment::Step& values, Body body);
  /// As in arithmetic.hpp: by repeated squaring from the lowest bit.
  void integer_power(const SingleAssignment::Step& values);
  [[nodiscard]] std::size_t mask_size() const { return shape_.lanes == 1 ? 16 : shape_.lanes * sizeof(double); }

  asmjit::CodeHolder list_;
  asmjit::x86::Assembler a_;
  Errors errors_;
  std::vector<std::uint32_t> uses_;  ///< instructions that use each value, ascending
  std::vector<std::uint32_t> free_places_;
};

}  // namespace rubato::formula

#endif
