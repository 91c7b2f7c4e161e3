#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

#include <rubato/formula/arithmetic.hpp>
#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/loop_evaluator.hpp>
#include <rubato/formula/machine_code.hpp>
#include <rubato/formula/operations.hpp>
#include <rubato/formula/single_assignment.hpp>
#include <rubato/formula/special.hpp>

namespace rubato::formula {

namespace {

constexpr auto code_count = static_cast<std::uint32_t>(OpCode::where_negative) + 1;

// A word of the stream says what a group computes: an OpCode where its length follows, or one of the frequent codes for
// a single instruction, or the end.
constexpr std::uint32_t many(OpCode code) {
  return static_cast<std::uint32_t>(code);
}
constexpr std::uint32_t single(OpCode code) {
  return code_count + many(code);
}
constexpr std::uint32_t end_of_stream = single(OpCode::square) + 1;
constexpr bool has_single_form(OpCode code) {
  return code <= OpCode::square;
}

/// How many numbers an instruction keeps in the stream.
std::size_t operand_words(OpCode code) {
  return code == OpCode::integer_power ? 2 : static_cast<std::size_t>(operand_count(code));
}

/// Where a run has come to: the registers r, the next word of the stream, the register of the next result.
struct Machine {
  double* r;
  const std::uint32_t* word;
  double* target;

  /// Computes one result from the next N operands.
  template <int N, typename F>
  void one(F f) {
    if constexpr (N == 1) {
      *target = f(r[word[0]]);
    } else if constexpr (N == 2) {
      *target = f(r[word[0]], r[word[1]]);
    } else {
      *target = f(r[word[0]], r[word[1]], r[word[2]]);
    }
    word += N;
    ++target;
  }

  /// A group: its instructions do not wait for each other, so the processor overlaps them.
  template <int N, typename F>
  void group(F f) {
    Machine machine = *this;
    const std::uint32_t* const end = word + 1 + std::size_t{N} * *word;
    ++machine.word;
    do {
      machine.one<N>(f);
    } while (machine.word != end);
    *this = machine;
  }
};

}  // namespace

ScalarEvaluator::ScalarEvaluator(const Bytecode& code, Engine engine)
    : code_(code), first_output_(code.input_count()), memory_(code.input_count() + code.output_count()) {
  if (code_.loops() != nullptr) {
    loops_ = Copied(LoopEvaluator(code_.loops(), engine));
    return;
  }
  const MachineCode* const machine = engine == Engine::automatic ? code_.machine_code() : nullptr;
  if (machine != nullptr) {
    run_ = machine->function();
    whole_ = machine->whole();
    work_.resize(machine->work_size());
    plan_outputs(code_.outputs());
  } else {
    schedule();
  }
  for (const Fill& fill : fills_) {
    std::fill_n(memory_.data() + first_output_ + fill.first, fill.count, fill.value);
  }
}

void ScalarEvaluator::schedule() {
  const std::span<const Instruction> instructions = code_.instructions();
  const std::size_t fixed = code_.input_count() + code_.constants().size();
  const SingleAssignment assigned = single_assignment(code_);
  const std::vector<std::uint32_t>& maker = assigned.maker;
  struct Step {
    std::array<std::uint32_t, 3> operands{};
    std::uint32_t first_result = 0;
    std::uint32_t waits_for = 0;
  };
  std::vector<Step> steps(instructions.size());
  for (std::size_t i = 0; i < instructions.size(); ++i) {
    steps[i] = {.operands = assigned.steps[i].operands, .first_result = assigned.steps[i].first_result};
    for (int k = 0; k < operand_count(instructions[i].code); ++k) {
      steps[i].waits_for += steps[i].operands[k] >= fixed ? 1 : 0;
    }
  }

  // Who waits for each step.
  std::vector<std::uint32_t> first_waiter(instructions.size() + 1, 0);
  const auto for_each_dependence = [&](auto&& visit) {
    for (std::uint32_t i = 0; i < steps.size(); ++i) {
      for (int k = 0; k < operand_count(instructions[i].code); ++k) {
        if (steps[i].operands[k] >= fixed) {
          visit(maker[steps[i].operands[k] - fixed], i);
        }
      }
    }
  };
  for_each_dependence([&](std::uint32_t made, std::uint32_t) { ++first_waiter[made + 1]; });
  for (std::size_t i = 0; i < steps.size(); ++i) {
    first_waiter[i + 1] += first_waiter[i];
  }
  std::vector<std::uint32_t> waiters(first_waiter.back());
  std::vector<std::uint32_t> place(first_waiter.begin(), first_waiter.end() - 1);
  for_each_dependence([&](std::uint32_t made, std::uint32_t waiter) { waiters[place[made]++] = waiter; });

  // Greedily the kind of which most are ready.
  std::array<std::vector<std::uint32_t>, code_count> ready;
  for (std::uint32_t i = 0; i < steps.size(); ++i) {
    if (steps[i].waits_for == 0) {
      ready[static_cast<std::size_t>(instructions[i].code)].push_back(i);
    }
  }
  std::vector<std::uint32_t> new_register(fixed + maker.size());
  for (std::uint32_t i = 0; i < fixed; ++i) {
    new_register[i] = i;
  }
  auto next_register = static_cast<std::uint32_t>(fixed);
  while (true) {
    auto most =
        std::max_element(ready.begin(), ready.end(), [](const auto& x, const auto& y) { return x.size() < y.size(); });
    if (most->empty()) {
      break;
    }
    const std::vector<std::uint32_t> group = std::move(*most);
    most->clear();
    const OpCode code = instructions[group.front()].code;
    if (group.size() == 1 && has_single_form(code)) {
      stream_.push_back(single(code));
    } else {
      stream_.insert(stream_.end(), {many(code), static_cast<std::uint32_t>(group.size())});
    }
    for (const std::uint32_t i : group) {
      const auto registers = static_cast<std::size_t>(operand_count(code));
      for (std::size_t k = 0; k < operand_words(code); ++k) {
        stream_.push_back(k < registers ? new_register[steps[i].operands[k]] : steps[i].operands[k]);
      }
      new_register[steps[i].first_result] = next_register++;
      if (code == OpCode::sincos) {
        new_register[steps[i].first_result + 1] = next_register++;
      }
    }
    for (const std::uint32_t i : group) {
      for (std::uint32_t w = first_waiter[i]; w < first_waiter[i + 1]; ++w) {
        if (--steps[waiters[w]].waits_for == 0) {
          ready[static_cast<std::size_t>(instructions[waiters[w]].code)].push_back(waiters[w]);
        }
      }
    }
  }
  stream_.push_back(end_of_stream);

  work_.assign(next_register, 0.0);
  std::copy(code_.constants().begin(), code_.constants().end(),
            work_.begin() + static_cast<std::ptrdiff_t>(code_.input_count()));
  std::vector<std::uint32_t> output_registers;
  output_registers.reserve(code_.output_count());
  for (const std::uint32_t output : assigned.outputs) {
    output_registers.push_back(new_register[output]);
  }
  plan_outputs(output_registers);
}

/// Runs of one constant, as the zeros of a sparse Hessian, are filled; the rest is copied one by one.
void ScalarEvaluator::plan_outputs(std::span<const std::uint32_t> registers) {
  const std::size_t inputs = code_.input_count();
  const auto is_constant = [&](std::uint32_t source) {
    return source >= inputs && source < inputs + code_.constants().size();
  };
  const auto count = static_cast<std::uint32_t>(registers.size());
  for (std::uint32_t first = 0; first < count;) {
    const std::uint32_t source = registers[first];
    std::uint32_t last = first + 1;
    while (last < count && registers[last] == source) {
      ++last;
    }
    if (is_constant(source)) {
      fills_.push_back({first, last - first, code_.constants()[source - inputs]});
    } else if (run_ == nullptr) {
      for (std::uint32_t i = first; i < last; ++i) {
        copies_.push_back({i, source});
      }
    }
    first = last;
  }
}

void ScalarEvaluator::interpret(const double* point) {
  if (loops_) {
    (*loops_)(point, memory_.data() + first_output_);
    return;
  }
  if (stream_.empty()) {
    return;
  }
  double* const r = work_.data();
  std::copy_n(point, code_.input_count(), r);
  run_stream();
  double* const outputs = memory_.data() + first_output_;
  for (const Copy& copy : copies_) {
    outputs[copy.output] = r[copy.source];
  }
}

void ScalarEvaluator::run_stream() {
  constexpr auto add = [](double a, double b) { return a + b; };
  constexpr auto subtract = [](double a, double b) { return a - b; };
  constexpr auto multiply = [](double a, double b) { return a * b; };
  constexpr auto divide = [](double a, double b) { return a / b; };
  constexpr auto negate = [](double a) { return -a; };
  constexpr auto multiply_add = [](double a, double b, double c) { return a * b + c; };
  constexpr auto multiply_subtract = [](double a, double b, double c) { return a * b - c; };
  constexpr auto negative_multiply_add = [](double a, double b, double c) { return c - a * b; };
  constexpr auto square = [](double a) { return a * a; };
  double* const r = work_.data();
  Machine machine{r, stream_.data(), r + code_.input_count() + code_.constants().size()};
  while (true) {
    switch (*machine.word++) {
      case end_of_stream: return;
      case single(OpCode::add): machine.one<2>(add); break;
      case single(OpCode::subtract): machine.one<2>(subtract); break;
      case single(OpCode::multiply): machine.one<2>(multiply); break;
      case single(OpCode::divide): machine.one<2>(divide); break;
      case single(OpCode::negate): machine.one<1>(negate); break;
      case single(OpCode::multiply_add): machine.one<3>(multiply_add); break;
      case single(OpCode::multiply_subtract): machine.one<3>(multiply_subtract); break;
      case single(OpCode::negative_multiply_add): machine.one<3>(negative_multiply_add); break;
      case single(OpCode::square): machine.one<1>(square); break;
      case many(OpCode::add): machine.group<2>(add); break;
      case many(OpCode::subtract): machine.group<2>(subtract); break;
      case many(OpCode::multiply): machine.group<2>(multiply); break;
      case many(OpCode::divide): machine.group<2>(divide); break;
      case many(OpCode::negate): machine.group<1>(negate); break;
      case many(OpCode::multiply_add): machine.group<3>(multiply_add); break;
      case many(OpCode::multiply_subtract): machine.group<3>(multiply_subtract); break;
      case many(OpCode::negative_multiply_add): machine.group<3>(negative_multiply_add); break;
      case many(OpCode::square): machine.group<1>(square); break;
      case many(OpCode::integer_power):
        for (std::uint32_t left = *machine.word++; left > 0; --left, machine.word += 2) {
          *machine.target++ = integer_power(r[machine.word[0]], static_cast<std::int32_t>(machine.word[1]));
        }
        break;
      case many(OpCode::sincos):
        for (std::uint32_t left = *machine.word++; left > 0; --left, ++machine.word) {
          const double x = r[*machine.word];
          *machine.target++ = std::sin(x);
          *machine.target++ = std::cos(x);
        }
        break;
      case many(OpCode::power): machine.group<2>([](double a, double b) { return std::pow(a, b); }); break;
#define RUBATO_FUNCTION(id, name, form, is, symmetry, value, ...)                                         \
  case many(OpCode::id):                                                                                  \
    machine.group<arity_of(Form::form)>([](double a, [[maybe_unused]] double b = 0.0) { return value; }); \
    break;
#include <rubato/formula/operations.inc>
      case many(OpCode::where_positive): machine.group<2>(where_positive); break;
      case many(OpCode::where_negative): machine.group<2>(where_negative); break;
      default: __builtin_unreachable();
    }
  }
}

void ScalarEvaluator::by_copy(const double* point, std::span<double> outputs) {
  std::copy_n(at(point), outputs.size(), outputs.data());
}

}  // namespace rubato::formula
