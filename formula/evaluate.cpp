#include <cassert>
#include <cmath>

#include <rubato/formula/arithmetic.hpp>
#include <rubato/formula/bytecode.hpp>

namespace rubato::formula {

ScalarEvaluator::ScalarEvaluator(const Bytecode& code) : code_(code), registers_(code.register_count(), 0.0) {
  std::copy(code.constants().begin(), code.constants().end(),
            registers_.begin() + static_cast<std::ptrdiff_t>(code.input_count()));
}

void ScalarEvaluator::run() {
  double* const r = registers_.data();
  for (const Instruction& i : code_.instructions()) {
    switch (i.code) {
      case OpCode::add: r[i.target] = r[i.a] + r[i.b]; break;
      case OpCode::subtract: r[i.target] = r[i.a] - r[i.b]; break;
      case OpCode::multiply: r[i.target] = r[i.a] * r[i.b]; break;
      case OpCode::divide: r[i.target] = r[i.a] / r[i.b]; break;
      case OpCode::negate: r[i.target] = -r[i.a]; break;
      case OpCode::multiply_add: r[i.target] = r[i.a] * r[i.b] + r[i.c]; break;
      case OpCode::multiply_subtract: r[i.target] = r[i.a] * r[i.b] - r[i.c]; break;
      case OpCode::negative_multiply_add: r[i.target] = r[i.c] - r[i.a] * r[i.b]; break;
      case OpCode::square: r[i.target] = r[i.a] * r[i.a]; break;
      case OpCode::integer_power: r[i.target] = integer_power(r[i.a], static_cast<std::int32_t>(i.b)); break;
      case OpCode::power: r[i.target] = std::pow(r[i.a], r[i.b]); break;
      case OpCode::sin: r[i.target] = std::sin(r[i.a]); break;
      case OpCode::cos: r[i.target] = std::cos(r[i.a]); break;
      case OpCode::sincos: {
        const double x = r[i.a];
        r[i.target] = std::sin(x);
        r[i.b] = std::cos(x);
        break;
      }
      case OpCode::tan: r[i.target] = std::tan(r[i.a]); break;
      case OpCode::asin: r[i.target] = std::asin(r[i.a]); break;
      case OpCode::acos: r[i.target] = std::acos(r[i.a]); break;
      case OpCode::atan: r[i.target] = std::atan(r[i.a]); break;
      case OpCode::atan2: r[i.target] = std::atan2(r[i.a], r[i.b]); break;
      case OpCode::sinh: r[i.target] = std::sinh(r[i.a]); break;
      case OpCode::cosh: r[i.target] = std::cosh(r[i.a]); break;
      case OpCode::tanh: r[i.target] = std::tanh(r[i.a]); break;
      case OpCode::asinh: r[i.target] = std::asinh(r[i.a]); break;
      case OpCode::acosh: r[i.target] = std::acosh(r[i.a]); break;
      case OpCode::atanh: r[i.target] = std::atanh(r[i.a]); break;
      case OpCode::exp: r[i.target] = std::exp(r[i.a]); break;
      case OpCode::log: r[i.target] = std::log(r[i.a]); break;
      case OpCode::sqrt: r[i.target] = std::sqrt(r[i.a]); break;
      case OpCode::cbrt: r[i.target] = std::cbrt(r[i.a]); break;
      case OpCode::abs: r[i.target] = std::abs(r[i.a]); break;
      case OpCode::sech: r[i.target] = sech(r[i.a]); break;
      case OpCode::csch: r[i.target] = csch(r[i.a]); break;
      case OpCode::sign: r[i.target] = sign(r[i.a]); break;
      case OpCode::min: r[i.target] = minimum(r[i.a], r[i.b]); break;
      case OpCode::max: r[i.target] = maximum(r[i.a], r[i.b]); break;
    }
  }
}

void ScalarEvaluator::operator()(std::span<const double> inputs, std::span<double> outputs) {
  assert(inputs.size() == code_.input_count() && outputs.size() == code_.output_count());
  std::copy(inputs.begin(), inputs.end(), registers_.begin());
  run();
  for (std::size_t i = 0; i < outputs.size(); ++i) {
    outputs[i] = output(i);
  }
}

}  // namespace rubato::formula
