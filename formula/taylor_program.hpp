#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <rubato/formula/bytecode.hpp>

/// Between TaylorEvaluator and its kernels; of no use elsewhere.
namespace rubato::formula::taylor {

enum class Kind : std::uint8_t {
  fill,  // target = value, a number
  add,
  subtract,
  affine,            // value + factor·a
  divide_by_number,  // a / value
  multiply,
  square,
  divide,
  reciprocal,
  square_root,
  power,              // factor·a^value
  exponential,        // c = D a, here and in the next two
  quotient_integral,  // D target = factor·(D a)/b
  circular,           // target = sin a, b = cos a
  hyperbolic,         // target = sinh a, b = cosh a
  tangent,            // target = tan a; b = 1 + target²
  secant,             // target = sech a, b = tanh a (factor 1); csch a, coth a (factor -1); c = target·b, d = target²
  argument,           // atan2(a, b); c = a² + b²
  absolute,
  sign,
  minimum,
  maximum,
  function,  // code's function of a with the parameter `factor`; c … c + d - 1: its derivatives there, over 1!, 2!, …
  choice,    // b where factor·a > 0, by order 0, else 0
};
inline constexpr std::size_t kind_count = static_cast<std::size_t>(Kind::choice) + 1;

/// A step on series: what an instruction is lowered to.
struct Step {
  Kind kind{};
  OpCode code{};  ///< of the instruction it stems from
  std::uint32_t target = 0, a = 0, b = 0, c = 0, d = 0;
  std::uint32_t culprit = 0;  ///< the argument to be named if there is no expansion
  double value = 0.0, factor = 1.0;
  bool positive = false;  ///< power: whether a_0 has to be positive, not only different from 0
};

/// Which series a step reads, and which it makes, among a, b, c, d and its target.
struct Series {
  std::uint32_t index[4];
  std::size_t count;
};
[[nodiscard]] Series read_by(const Step& step);
[[nodiscard]] Series made_by(const Step& step);

/// Steps first … first + count - 1 of `scheduled`, none of which waits for another.
struct Group {
  Kind kind;
  std::uint32_t first, count;
};

/// Code lowered to steps. Series are numbered: inputs, constants, then results.
///
/// What the code computes from powers of one base (1/r, 1/r³, … from r² by a root, quotients and products) becomes one
/// step for each power that something else reads; what nothing reads any more is left out.
struct Program {
  std::vector<Step> steps;      ///< in the order of the code
  std::vector<Step> scheduled;  ///< the same so that those of one kind that do not wait for each other stand together
  std::vector<Group> groups;
  std::vector<std::uint32_t> outputs;
  std::vector<double> constants;
  std::size_t input_count = 0;
  std::size_t series_count = 0;
};
/// `order`: the highest. \throws std::invalid_argument if `code` was compiled with reuse of registers
[[nodiscard]] Program lower(const Bytecode& code, int order);

}  // namespace rubato::formula::taylor
