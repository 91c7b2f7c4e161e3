#include <rubato/formula/single_assignment.hpp>

#include <algorithm>

namespace rubato::formula {

SingleAssignment single_assignment(const Bytecode& code) {
  const auto instructions = code.instructions();
  const std::size_t fixed = code.input_count() + code.constants().size();
  std::vector<std::uint32_t> holder(code.register_count());  // the value that a register of the code has at the moment
  for (std::uint32_t i = 0; i < fixed; ++i) {
    holder[i] = i;
  }
  SingleAssignment result;
  result.steps.resize(instructions.size());
  result.maker.reserve(instructions.size());
  for (std::size_t i = 0; i < instructions.size(); ++i) {
    const Instruction& instruction = instructions[i];
    SingleAssignment::Step& step = result.steps[i];
    const std::array registers{instruction.a, instruction.b, instruction.c};
    const int operands = operand_count(instruction.code);
    for (int k = 0; k < operands; ++k) {
      step.operands[k] = holder[registers[k]];
    }
    if (instruction.code == OpCode::integer_power) {
      step.operands[1] = instruction.b;
    }
    step.first_result = static_cast<std::uint32_t>(fixed + result.maker.size());
    holder[instruction.target] = step.first_result;
    result.maker.push_back(static_cast<std::uint32_t>(i));
    if (instruction.code == OpCode::sincos) {
      holder[instruction.b] = step.first_result + 1;
      result.maker.push_back(static_cast<std::uint32_t>(i));
    }
  }
  result.outputs.reserve(code.output_count());
  for (const std::uint32_t output : code.outputs()) {
    result.outputs.push_back(holder[output]);
  }
  return result;
}

std::vector<std::uint32_t> eager_order(const Bytecode& code, const SingleAssignment& assigned) {
  const auto instructions = code.instructions();
  const std::size_t fixed = code.input_count() + code.constants().size();
  const auto count = static_cast<std::uint32_t>(instructions.size());
  const auto for_each_dependence = [&](auto&& visit) {
    for (std::uint32_t i = 0; i < count; ++i) {
      for (int k = 0; k < operand_count(instructions[i].code); ++k) {
        if (const std::uint32_t operand = assigned.steps[i].operands[static_cast<std::size_t>(k)]; operand >= fixed) {
          visit(assigned.maker[operand - fixed], i);
        }
      }
    }
  };
  std::vector<std::uint32_t> waits_for(count, 0), first_user(count + 1, 0);
  for_each_dependence([&](std::uint32_t made, std::uint32_t user) {
    ++waits_for[user];
    ++first_user[made + 1];
  });
  for (std::uint32_t i = 0; i < count; ++i) {
    first_user[i + 1] += first_user[i];
  }
  std::vector<std::uint32_t> users(first_user.back()), place(first_user.begin(), first_user.end() - 1);
  for_each_dependence([&](std::uint32_t made, std::uint32_t user) { users[place[made]++] = user; });

  std::vector<std::uint32_t> order, ready;
  order.reserve(count);
  for (std::uint32_t start = 0; start < count; ++start) {
    const auto operands = static_cast<std::size_t>(operand_count(instructions[start].code));
    if (std::any_of(assigned.steps[start].operands.begin(), assigned.steps[start].operands.begin() + operands,
                    [&](std::uint32_t operand) { return operand >= fixed; })) {
      continue;
    }
    ready.push_back(start);
    while (!ready.empty()) {
      const std::uint32_t i = ready.back();
      ready.pop_back();
      order.push_back(i);
      for (std::uint32_t u = first_user[i + 1]; u-- > first_user[i];) {
        if (--waits_for[users[u]] == 0) {
          ready.push_back(users[u]);
        }
      }
    }
  }
  return order;
}

}  // namespace rubato::formula
