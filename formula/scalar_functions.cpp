#include <rubato/formula/scalar_functions.hpp>

#include <bit>
#include <cmath>

#include <rubato/formula/arithmetic.hpp>
#include <rubato/formula/special.hpp>

namespace rubato::formula {

namespace {

using OfOne = double (*)(double);
using OfTwo = double (*)(double, double);

OfOne function_of_one(OpCode code) {
  switch (code) {
    case OpCode::sin: return std::sin;
    case OpCode::cos: return std::cos;
    case OpCode::tan: return std::tan;
    case OpCode::asin: return std::asin;
    case OpCode::acos: return std::acos;
    case OpCode::atan: return std::atan;
    case OpCode::sinh: return std::sinh;
    case OpCode::cosh: return std::cosh;
    case OpCode::tanh: return std::tanh;
    case OpCode::asinh: return std::asinh;
    case OpCode::acosh: return std::acosh;
    case OpCode::atanh: return std::atanh;
    case OpCode::exp: return std::exp;
    case OpCode::log: return std::log;
    case OpCode::cbrt: return std::cbrt;
    case OpCode::erf: return std::erf;
    case OpCode::sech: return sech;
    case OpCode::csch: return csch;
    default: return nullptr;
  }
}

OfTwo function_of_two(OpCode code) {
  switch (code) {
    case OpCode::power: return std::pow;
    case OpCode::atan2: return std::atan2;
    case OpCode::bessel_j: return bessel_j;
    case OpCode::bessel_y: return bessel_y;
    case OpCode::bessel_i: return bessel_i;
    case OpCode::bessel_k: return bessel_k;
    case OpCode::jacobi_sn: return [](double u, double m) { return jacobi(u, m).sn; };
    case OpCode::jacobi_cn: return [](double u, double m) { return jacobi(u, m).cn; };
    case OpCode::jacobi_dn: return [](double u, double m) { return jacobi(u, m).dn; };
    default: return nullptr;
  }
}

}  // namespace

bool is_called(OpCode code) {
  return function_of_one(code) != nullptr || function_of_two(code) != nullptr;
}

const void* scalar_function(OpCode code) {
  return operand_count(code) == 1 ? std::bit_cast<const void*>(function_of_one(code))
                                  : std::bit_cast<const void*>(function_of_two(code));
}

const void* sincos_function() {
  return std::bit_cast<const void*>(static_cast<void (*)(double, double*, double*)>(::sincos));
}

}  // namespace rubato::formula
