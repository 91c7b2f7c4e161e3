#include <rubato/formula/bytecode.hpp>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>
#include <stdexcept>
#include <unordered_map>
#include <utility>

#include <fmt/format.h>

#include <rubato/formula/lazy_machine_code.hpp>
#include <rubato/formula/loop.hpp>
#include <rubato/formula/loop_program.hpp>
#include <rubato/formula/operations.hpp>
#include <rubato/formula/reachable.hpp>

namespace rubato::formula {

int operand_count(OpCode code) {
  switch (code) {
    case OpCode::add:
    case OpCode::subtract:
    case OpCode::multiply:
    case OpCode::divide:
    case OpCode::power:
    case OpCode::where_positive:
    case OpCode::where_negative: return 2;
    case OpCode::multiply_add:
    case OpCode::multiply_subtract:
    case OpCode::negative_multiply_add:
      return 3;
// clang-format off
#define RUBATO_FUNCTION(id, name, form, ...) case OpCode::id: return arity_of(Form::form);
#include <rubato/formula/operations.inc>
      // clang-format on
    default: return 1;
  }
}

Form form_of(OpCode code) {
  switch (code) {
// clang-format off
#define RUBATO_FUNCTION(id, name, form, ...) case OpCode::id: return Form::form;
#include <rubato/formula/operations.inc>
      // clang-format on
    default: return operand_count(code) == 1 ? Form::one : Form::two;
  }
}

namespace {

using ValueId = std::uint32_t;
constexpr ValueId no_value = std::numeric_limits<ValueId>::max();

/// The code before registers are given out: value i is an input, a constant or the result of one operation on earlier
/// values. Lowered operations that occur twice are made once.
class Lowering {
public:
  enum class Kind : std::uint8_t { input, constant, operation };
  struct Value {
    Kind kind;
    OpCode code = OpCode::add;  ///< of an operation
    ValueId a = 0, b = 0, c = 0;
    double number = 0.0;  ///< of a constant
    std::uint32_t uses = 0;
    bool absorbed = false;  ///< a product that lives inside the sum using it
  };

  /// Of about so many values.
  explicit Lowering(std::size_t count) : operations_(count) { values_.reserve(count); }

  ValueId input(std::uint32_t number) {
    values_.push_back({.kind = Kind::input, .a = number});
    return last();
  }

  ValueId constant(double number) {
    const auto [entry, is_new] = constants_.try_emplace(std::bit_cast<std::uint64_t>(number), 0);
    if (is_new) {
      values_.push_back({.kind = Kind::constant, .number = number});
      entry->second = last();
    }
    return entry->second;
  }

  ValueId operation(OpCode code, ValueId a, ValueId b = 0) {
    const auto [entry, is_new] = operations_.try_emplace(Key{code, a, b}, 0);
    if (is_new) {
      values_.push_back({.kind = Kind::operation, .code = code, .a = a, .b = b});
      entry->second = last();
    }
    return entry->second;
  }

  ValueId divide(ValueId a, ValueId b) {
    if (values_[b].kind == Kind::constant) {
      // The reciprocal of a power of two is exact, and so is multiplying by it.
      const double reciprocal = 1.0 / values_[b].number;
      int exponent = 0;
      if (std::isfinite(reciprocal) && std::abs(std::frexp(values_[b].number, &exponent)) == 0.5) {
        return operation(OpCode::multiply, constant(reciprocal), a);
      }
    }
    return operation(OpCode::divide, a, b);
  }

  ValueId power(ValueId x, ValueId exponent) {
    if (values_[exponent].kind == Kind::constant) {
      const double n = values_[exponent].number;
      if (n == std::trunc(n) && std::abs(n) <= largest_integer_power && n != 0.0) {
        return integer_power(x, static_cast<std::int32_t>(n));
      }
      if (const auto half = half_power(x, n)) {
        return *half;
      }
    }
    return operation(OpCode::power, x, exponent);
  }

  [[nodiscard]] std::vector<Value>& values() { return values_; }

private:
  /// Beyond this, the error n·ε/2 of repeated squaring is no longer small beside that of pow.
  static constexpr double largest_integer_power = 64.0;
  static constexpr std::int32_t largest_product = 8;

  struct Key {
    OpCode code;
    ValueId a, b;
    bool operator==(const Key&) const = default;
  };
  struct KeyHash {
    std::size_t operator()(const Key& key) const {
      const std::uint64_t pair = (std::uint64_t{key.a} << 32U) | key.b;
      return static_cast<std::size_t>((pair + static_cast<std::uint64_t>(key.code)) * 0x9e3779b97f4a7c15U >> 16U);
    }
  };

  [[nodiscard]] ValueId last() const { return static_cast<ValueId>(values_.size() - 1); }

  /// Small powers as products that share their parts; large ones as one instruction.
  ValueId integer_power(ValueId x, std::int32_t n) {
    if (n == 1) {
      return x;
    }
    if (n == -1) {
      return operation(OpCode::divide, constant(1.0), x);
    }
    if (n < -1 && n >= -largest_product) {
      return integer_power(integer_power(x, -1), -n);
    }
    if (n > largest_product || n < 0) {
      return operation(OpCode::integer_power, x, static_cast<ValueId>(n));
    }
    if (n % 2 == 0) {
      return operation(OpCode::square, integer_power(x, n / 2));
    }
    const ValueId smaller = integer_power(x, n / 2);
    const ValueId larger = integer_power(x, n / 2 + 1);
    return operation(OpCode::multiply, smaller, larger);
  }

  /// x^{±1/2}, x^{±3/2}, x^{±5/2} by square roots, which are much cheaper than pow and agree with it for 0 <= x < inf.
  std::optional<ValueId> half_power(ValueId x, double n) {
    if (std::abs(n) != 0.5 && std::abs(n) != 1.5 && std::abs(n) != 2.5) {
      return std::nullopt;
    }
    const ValueId root = operation(OpCode::sqrt, x);
    if (n < 0.0) {
      return integer_power(integer_power(root, -1), static_cast<std::int32_t>(-2.0 * n));
    }
    return n == 0.5 ? root : operation(OpCode::multiply, root, integer_power(x, static_cast<std::int32_t>(n - 0.5)));
  }

  std::vector<Value> values_;
  std::unordered_map<std::uint64_t, ValueId> constants_;
  std::unordered_map<Key, ValueId, KeyHash> operations_;
};

OpCode code_of(Operation operation) {
  switch (operation) {
    case Operation::add: return OpCode::add;
    case Operation::subtract: return OpCode::subtract;
    case Operation::multiply: return OpCode::multiply;
    case Operation::negate:
      return OpCode::negate;
// clang-format off
#define RUBATO_FUNCTION(id, ...) case Operation::id: return OpCode::id;
#include <rubato/formula/operations.inc>
      // clang-format on
    case Operation::where_positive: return OpCode::where_positive;
    case Operation::where_negative: return OpCode::where_negative;
    case Operation::constant:
    case Operation::variable:
    case Operation::divide:
    case Operation::power:  // lowered before this is asked
    case Operation::list:
    case Operation::loop:
    case Operation::component: break;  // cut out before
  }
  throw std::logic_error("code_of: operation without an op code");
}

void for_each_operand(const Lowering::Value& value, auto&& visit) {
  if (value.kind == Lowering::Kind::operation) {
    const int operands = operand_count(value.code);
    visit(value.a);
    if (operands >= 2) {
      visit(value.b);
    }
    if (operands == 3) {
      visit(value.c);
    }
  }
}

void count_uses(std::vector<Lowering::Value>& values, std::span<const ValueId> outputs) {
  // Only values that reach an output count: lowering may leave steps that nothing needs.
  for (const ValueId output : outputs) {
    ++values[output].uses;
  }
  for (std::size_t i = values.size(); i-- > 0;) {
    if (values[i].uses > 0) {
      for_each_operand(values[i], [&](ValueId operand) { ++values[operand].uses; });
    }
  }
}

/// Sums with a product used nowhere else become one instruction.
void fuse_products(std::vector<Lowering::Value>& values) {
  const auto absorbable = [&](ValueId id) {
    const Lowering::Value& value = values[id];
    return value.kind == Lowering::Kind::operation && value.uses == 1 &&
           (value.code == OpCode::multiply || value.code == OpCode::square);
  };
  for (Lowering::Value& value : values) {
    if (value.kind != Lowering::Kind::operation || value.uses == 0 ||
        (value.code != OpCode::add && value.code != OpCode::subtract)) {
      continue;
    }
    const bool is_sum = value.code == OpCode::add;
    ValueId product = no_value;
    if (absorbable(value.b)) {
      product = value.b;
      value.c = value.a;
      value.code = is_sum ? OpCode::multiply_add : OpCode::negative_multiply_add;
    } else if (absorbable(value.a)) {
      product = value.a;
      value.c = value.b;
      value.code = is_sum ? OpCode::multiply_add : OpCode::multiply_subtract;
    } else {
      continue;
    }
    values[product].absorbed = true;
    value.a = values[product].a;
    value.b = values[product].code == OpCode::square ? value.a : values[product].b;
  }
}

/// sin and cos of one argument: for each sin its cos, and the other way round.
std::vector<ValueId> pair_sines_and_cosines(const std::vector<Lowering::Value>& values) {
  std::vector<ValueId> partner(values.size(), no_value);
  std::unordered_map<ValueId, ValueId> sine_of;
  const auto is = [&](ValueId i, OpCode code) {
    return values[i].kind == Lowering::Kind::operation && values[i].uses > 0 && values[i].code == code;
  };
  for (ValueId i = 0; i < values.size(); ++i) {
    if (is(i, OpCode::sin)) {
      sine_of.emplace(values[i].a, i);
    }
  }
  for (ValueId i = 0; i < values.size(); ++i) {
    if (is(i, OpCode::cos)) {
      if (const auto sine = sine_of.find(values[i].a); sine != sine_of.end()) {
        partner[i] = sine->second;
        partner[sine->second] = i;
      }
    }
  }
  return partner;
}

}  // namespace

Bytecode::Bytecode(std::span<const Expression> outputs, std::span<const Expression> inputs, bool reuse_registers)
    : input_count_(inputs.size()) {
  const bool loops = has_loops(outputs);
  if (loops && reuse_registers) {
    loops_ = LoopProgram::of(outputs, inputs);
    outputs_.resize(outputs.size());
    std::iota(outputs_.begin(), outputs_.end(), static_cast<std::uint32_t>(input_count_));
    register_count_ = input_count_ + outputs_.size();
    return;
  }
  machine_code_ = std::make_shared<LazyMachineCode>();
  if (loops) {
    Graph own;
    compile(unrolled(substitute(outputs, own, {}, {})), substitute(inputs, own, {}, {}), reuse_registers);
  } else {
    compile(outputs, inputs, reuse_registers);
  }
}

void Bytecode::compile(std::span<const Expression> outputs, std::span<const Expression> inputs, bool reuse_registers) {
  const std::vector<NodeIndex> order = reachable(outputs);
  NodeIndex last = order.empty() ? 0 : order.back();
  for (const Expression input : inputs) {
    last = std::max(last, input.valid() ? input.index() : 0);
  }
  std::vector<ValueId> id_of(last + 1, no_value);  // by node
  Lowering lowering(inputs.size() + order.size());
  std::uint32_t next_input = 0;
  for (const Expression input : inputs) {
    const bool is_variable = input.valid() && input.graph()->node(input.index()).operation == Operation::variable &&
                             (outputs.empty() || input.graph() == outputs.front().graph());
    if (!is_variable) {
      throw std::invalid_argument(
          fmt::format("compiling a formula: the input '{}' is not a variable of its graph", to_string(input)));
    }
    if (std::exchange(id_of[input.index()], lowering.input(next_input++)) != no_value) {
      throw std::invalid_argument(fmt::format("compiling a formula: the input '{}' is given twice", to_string(input)));
    }
  }

  for (const NodeIndex index : order) {
    const Graph& graph = *outputs.front().graph();
    const Node& node = graph.node(index);
    if (node.operation == Operation::variable) {
      if (id_of[index] == no_value) {
        throw std::invalid_argument(
            fmt::format("compiling a formula: it depends on '{}', which is not an input", graph.variable_name(node.a)));
      }
      continue;
    }
    ValueId id = no_value;
    switch (node.operation) {
      case Operation::constant: id = lowering.constant(node.value); break;
      case Operation::divide: id = lowering.divide(id_of[node.a], id_of[node.b]); break;
      case Operation::power: id = lowering.power(id_of[node.a], id_of[node.b]); break;
      default:
        id = arity(node.operation) == 1 ? lowering.operation(code_of(node.operation), id_of[node.a])
                                        : lowering.operation(code_of(node.operation), id_of[node.a], id_of[node.b]);
        break;
    }
    id_of[index] = id;
  }

  std::vector<ValueId> output_ids;
  output_ids.reserve(outputs.size());
  for (const Expression output : outputs) {
    output_ids.push_back(id_of[output.index()]);
  }
  std::vector<Lowering::Value>& values = lowering.values();
  count_uses(values, output_ids);
  fuse_products(values);
  const std::vector<ValueId> partner = pair_sines_and_cosines(values);

  // Inputs, then the constants that are used, hold their registers for good; so do the outputs.
  std::vector<std::uint32_t> register_of(values.size(), 0);
  std::vector<std::uint32_t> uses_left(values.size(), 0);
  for (ValueId id = 0; id < values.size(); ++id) {
    Lowering::Value& value = values[id];
    if (value.kind == Lowering::Kind::input) {
      register_of[id] = value.a;
    } else if (value.kind == Lowering::Kind::constant && value.uses > 0) {
      register_of[id] = static_cast<std::uint32_t>(input_count_ + constants_.size());
      constants_.push_back(value.number);
    }
    if (value.uses > 0 && !value.absorbed) {
      for_each_operand(value, [&](ValueId operand) { ++uses_left[operand]; });
    }
  }
  constexpr std::uint32_t forever = std::numeric_limits<std::uint32_t>::max();
  for (const ValueId id : output_ids) {
    uses_left[id] = forever;
  }

  register_count_ = input_count_ + constants_.size();
  std::vector<std::uint32_t> free;
  const auto take = [&](ValueId id) {
    if (free.empty()) {
      register_of[id] = static_cast<std::uint32_t>(register_count_++);
    } else {
      register_of[id] = free.back();
      free.pop_back();
    }
    return register_of[id];
  };
  const auto release = [&](ValueId operand) {
    if (reuse_registers && values[operand].kind == Lowering::Kind::operation && uses_left[operand] != forever &&
        --uses_left[operand] == 0) {
      free.push_back(register_of[operand]);
    }
  };
  std::vector<bool> done(values.size(), false);
  for (ValueId id = 0; id < values.size(); ++id) {
    const Lowering::Value& value = values[id];
    if (value.kind != Lowering::Kind::operation || value.uses == 0 || value.absorbed || done[id]) {
      continue;
    }
    Instruction instruction{.code = value.code, .a = register_of[value.a]};
    const int operands = operand_count(value.code);
    if (operands >= 2) {
      instruction.b = register_of[value.b];
    } else if (value.code == OpCode::integer_power) {
      instruction.b = value.b;
    }
    if (operands == 3) {
      instruction.c = register_of[value.c];
    }
    for_each_operand(value, release);  // a target may be the register of an operand that ends here
    if (partner[id] != no_value) {
      const ValueId other = partner[id];
      release(values[other].a);
      done[other] = true;
      const ValueId sine = value.code == OpCode::sin ? id : other;
      instruction.code = OpCode::sincos;
      instruction.target = take(sine);
      instruction.b = take(partner[sine]);
    } else {
      instruction.target = take(id);
    }
    instructions_.push_back(instruction);
  }

  outputs_.reserve(output_ids.size());
  for (const ValueId id : output_ids) {
    outputs_.push_back(register_of[id]);
  }
}

}  // namespace rubato::formula
