#include <rubato/formula/straight_code.hpp>

#if defined(RUBATO_ASMJIT) && defined(__x86_64__)

namespace rubato::formula {

StraightCode::StraightCode(const Bytecode& code, const SingleAssignment& assigned, std::span<const std::uint32_t> order,
                           std::size_t first, std::size_t last, int lanes)
    : code_(code),
      assigned_(assigned),
      order_(order),
      first_(first),
      last_(last),
      shape_(shape(lanes)),
      values_(fixed() + assigned.maker.size()),
      holds_(static_cast<std::size_t>(shape_.registers), never) {
  list_.init(asmjit::Environment::host());
  list_.setErrorHandler(&errors_);
  list_.attach(&a_);
  pool_ = a_.newLabel();
  for (ValueNumber v = 0; v < fixed(); ++v) {
    const auto inputs = static_cast<std::uint32_t>(code.input_count());
    values_[v].home = v < inputs ? Home{Home::Place::input, v} : Home{Home::Place::constant, v - inputs};
  }
  list_uses();
}

// ---- what is needed when

void StraightCode::list_uses() {
  const auto for_each_use = [&](auto&& visit) {
    for (std::size_t i = first_; i < last_; ++i) {
      for (int k = 0; k < operand_count(instruction(i).code); ++k) {
        visit(step(i).operands[static_cast<std::size_t>(k)], static_cast<std::uint32_t>(i));
      }
    }
  };
  for_each_use([&](ValueNumber v, std::uint32_t) { ++values_[v].last; });
  std::uint32_t begin = 0;
  for (Value& value : values_) {
    const std::uint32_t count = value.last;
    value.next = value.last = begin;
    begin += count;
  }
  uses_.resize(begin);
  for_each_use([&](ValueNumber v, std::uint32_t i) { uses_[values_[v].last++] = i; });
}

std::uint32_t StraightCode::next_use(ValueNumber v) {
  Value& value = values_[v];
  while (value.next != value.last && uses_[value.next] <= now_) {
    ++value.next;
  }
  return value.next == value.last ? never : uses_[value.next];
}

// ---- places

StraightCode::Vec StraightCode::vec(int number) const {
  const auto n = static_cast<std::uint32_t>(number);
  return shape_.lanes == 8   ? Vec(asmjit::x86::Zmm(n))
         : shape_.lanes == 4 ? Vec(asmjit::x86::Ymm(n))
                             : Vec(asmjit::x86::Xmm(n));
}

StraightCode::Home StraightCode::work_place() {
  if (!free_places_.empty()) {
    const std::uint32_t place = free_places_.back();
    free_places_.pop_back();
    return {Home::Place::work, place};
  }
  return {Home::Place::work, static_cast<std::uint32_t>(work_size_++)};
}

void StraightCode::store(ValueNumber v) {
  Value& value = values_[v];
  if (value.home.place == Home::Place::nowhere) {
    value.home = work_place();
    a_.emit(shape_.move, memory(value.home), vec(value.reg));
  }
}

void StraightCode::let_go(int reg) {
  ValueNumber& held = holds_[static_cast<std::size_t>(reg)];
  if (held != never) {
    values_[held].reg = no_register;
    held = never;
  }
}

int StraightCode::free_register() const {
  for (int reg = 0; reg < shape_.registers; ++reg) {
    if (holds_[static_cast<std::size_t>(reg)] == never && !is_pinned(reg)) {
      return reg;
    }
  }
  return no_register;
}

int StraightCode::take_register() {
  int best = free_register();
  if (best == no_register) {
    std::uint32_t farthest = 0;
    for (int reg = 0; reg < shape_.registers; ++reg) {
      if (!is_pinned(reg)) {
        const std::uint32_t use = next_use(holds_[static_cast<std::size_t>(reg)]);
        if (best == no_register || use > farthest) {
          best = reg;
          farthest = use;
        }
      }
    }
    if (farthest != never) {
      store(holds_[static_cast<std::size_t>(best)]);
    }
    let_go(best);
  }
  pin(best);
  return best;
}

void StraightCode::put(ValueNumber v, int reg) {
  values_[v].reg = static_cast<std::int8_t>(reg);
  holds_[static_cast<std::size_t>(reg)] = v;
}

int StraightCode::load(ValueNumber v) {
  if (values_[v].reg == no_register) {
    const int reg = take_register();
    a_.emit(shape_.move, vec(reg), memory(values_[v].home));
    put(v, reg);
  }
  pin(values_[v].reg);
  return values_[v].reg;
}

void StraightCode::load_if_cheap(ValueNumber v) {
  if (values_[v].reg == no_register && next_use(v) != never && free_register() != no_register) {
    load(v);
  }
  if (values_[v].reg != no_register) {
    pin(values_[v].reg);
  }
}

void StraightCode::release_register(ValueNumber v) {
  if (const int reg = values_[v].reg; reg != no_register && next_use(v) == never) {
    let_go(reg);
    unpin(reg);
  }
}

void StraightCode::release(ValueNumber v) {
  release_register(v);
  if (values_[v].home.place == Home::Place::work && next_use(v) == never) {
    free_places_.push_back(std::exchange(values_[v].home, {}).index);
  }
}

void StraightCode::finish(ValueNumber v, int reg) {
  put(v, reg);
  write_outputs(v, reg);
  if (next_use(v) == never) {
    let_go(reg);
  }
}

// ---- instructions

void StraightCode::emit(Arithmetic what, int target, int a, int b, Home home) {
  if (b != no_register) {
    a_.emit(what, vec(target), vec(a), vec(b));
  } else {
    a_.emit(what, vec(target), vec(a), memory(home));
  }
}

void StraightCode::load_first(ValueNumber& a, ValueNumber& b, bool commutes) {
  if (commutes && values_[a].reg == no_register && values_[b].reg != no_register) {
    std::swap(a, b);
  }
  if (values_[b].reg != no_register) {
    pin(values_[b].reg);
  }
  load(a);
  load_if_cheap(b);
}

void StraightCode::binary(Arithmetic what, bool commutes, const SingleAssignment::Step& values) {
  auto [a, b, c] = values.operands;
  load_first(a, b, commutes);
  const int first = values_[a].reg, second = values_[b].reg;
  release_register(a);
  release_register(b);
  const int target = take_register();
  emit(what, target, first, second, values_[b].home);
  release(a);
  release(b);
  finish(values.first_result, target);
}

void StraightCode::fused(OpCode code, const SingleAssignment::Step& values) {
  auto [a, b, c] = values.operands;
  if (values_[c].reg != no_register) {
    pin(values_[c].reg);
  }
  load_first(a, b, true);
  if (code == OpCode::negative_multiply_add) {
    load(c);
  } else {
    load_if_cheap(c);
  }
  // The product takes the register of a factor that ends here, never that of c.
  const int first = values_[a].reg, second = values_[b].reg;
  for (const ValueNumber factor : {a, b}) {
    if (factor != c) {
      release_register(factor);
    }
  }
  const int target = take_register();
  emit(shape_.multiply, target, first, second, values_[b].home);
  if (code == OpCode::negative_multiply_add) {
    a_.emit(shape_.subtract, vec(target), vec(values_[c].reg), vec(target));
  } else {
    emit(code == OpCode::multiply_add ? shape_.add : shape_.subtract, target, target, values_[c].reg, values_[c].home);
  }
  for (const ValueNumber v : {a, b, c}) {
    release(v);
  }
  finish(values.first_result, target);
}

template <typename Body>
void StraightCode::unary(const SingleAssignment::Step& values, Body body) {
  const ValueNumber a = values.operands[0];
  const int from = load(a);
  release(a);
  const int target = take_register();
  body(target, from);
  finish(values.first_result, target);
}

void StraightCode::integer_power(const SingleAssignment::Step& values) {
  const auto exponent = static_cast<std::int32_t>(values.operands[1]);
  auto rest = exponent < 0 ? 0U - static_cast<std::uint32_t>(exponent) : static_cast<std::uint32_t>(exponent);
  const ValueNumber a = values.operands[0];
  int power = load(a);  // never written to
  const int result = take_register();
  const int square = take_register();
  bool first = true;
  for (; rest != 0; rest >>= 1U) {
    if ((rest & 1U) != 0) {
      if (first) {
        a_.emit(Arithmetic::kIdVmovapd, vec(result), vec(power));
      } else {
        a_.emit(shape_.multiply, vec(result), vec(result), vec(power));
      }
      first = false;
    }
    if (rest > 1) {
      a_.emit(shape_.multiply, vec(square), vec(power), vec(power));
      power = square;
    }
  }
  if (exponent < 0) {
    a_.emit(shape_.move, vec(square), one());
    a_.emit(shape_.divide, vec(result), vec(square), vec(result));
  }
  release(a);
  finish(values.first_result, result);
}

bool StraightCode::arithmetic(std::size_t i) {
  now_ = static_cast<std::uint32_t>(i);
  pinned_ = 0;
  const OpCode code = instruction(i).code;
  const SingleAssignment::Step& values = step(i);
  switch (code) {
    case OpCode::add: binary(shape_.add, true, values); return true;
    case OpCode::subtract: binary(shape_.subtract, false, values); return true;
    case OpCode::multiply: binary(shape_.multiply, true, values); return true;
    case OpCode::divide: binary(shape_.divide, false, values); return true;
    case OpCode::multiply_add:
    case OpCode::multiply_subtract:
    case OpCode::negative_multiply_add: fused(code, values); return true;
    case OpCode::negate:
      unary(values, [&](int to, int x) { a_.emit(Arithmetic::kIdVxorpd, vec(to), vec(x), sign_bit()); });
      return true;
    case OpCode::abs:
      unary(values, [&](int to, int x) { a_.emit(Arithmetic::kIdVandpd, vec(to), vec(x), other_bits()); });
      return true;
    case OpCode::square:
      unary(values, [&](int to, int x) { a_.emit(shape_.multiply, vec(to), vec(x), vec(x)); });
      return true;
    case OpCode::sqrt:
      unary(values, [&](int to, int x) {
        if (shape_.lanes == 1) {
          a_.emit(Arithmetic::kIdVsqrtsd, vec(to), vec(x), vec(x));
        } else {
          a_.emit(Arithmetic::kIdVsqrtpd, vec(to), vec(x));
        }
      });
      return true;
    case OpCode::integer_power: integer_power(values); return true;
    default: return false;
  }
}

// ---- constants

StraightCode::Mem StraightCode::sign_bit() const {
  return asmjit::x86::ptr(pool_, 0, static_cast<std::uint32_t>(mask_size()));
}
StraightCode::Mem StraightCode::other_bits() const {
  return asmjit::x86::ptr(pool_, static_cast<std::int32_t>(mask_size()), static_cast<std::uint32_t>(mask_size()));
}
std::int32_t StraightCode::constant_offset(std::size_t index) const {
  return static_cast<std::int32_t>(2 * mask_size() + index * static_cast<std::size_t>(shape_.lanes) * sizeof(double));
}
StraightCode::Mem StraightCode::one() const {
  return asmjit::x86::ptr(pool_, constant_offset(code_.constants().size()),
                          static_cast<std::uint32_t>(shape_.lanes * sizeof(double)));
}

void StraightCode::embed_pool() {
  a_.align(asmjit::AlignMode::kData, 64);
  a_.bind(pool_);
  constexpr std::uint64_t sign = 0x8000000000000000U;
  for (const std::uint64_t mask : {sign, ~sign}) {
    for (std::size_t k = 0; k < mask_size() / sizeof(mask); ++k) {
      a_.embed(&mask, sizeof(mask));
    }
  }
  const auto embed = [&](double number) {
    for (int k = 0; k < shape_.lanes; ++k) {
      a_.embed(&number, sizeof(number));
    }
  };
  for (const double constant : code_.constants()) {
    embed(constant);
  }
  embed(1.0);
}

std::optional<Assembled> StraightCode::result() const {
  if (errors_.any) {
    return std::nullopt;
  }
  const asmjit::CodeBuffer& buffer = list_.textSection()->buffer();
  const auto* const first = reinterpret_cast<const std::byte*>(buffer.data());
  return Assembled{.bytes = {first, first + buffer.size()}, .work_size = work_size_};
}

}  // namespace rubato::formula

#endif
