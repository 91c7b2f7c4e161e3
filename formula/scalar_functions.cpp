#include <rubato/formula/scalar_functions.hpp>

#include <cmath>

#include <rubato/formula/arithmetic.hpp>
#include <rubato/formula/special.hpp>

namespace rubato::formula {

ScalarFunction scalar_function(OpCode code) {
  enum class Is { called, machine };
  switch (code) {
    case OpCode::power: return [](double a, double b) { return std::pow(a, b); };
#define RUBATO_FUNCTION(id, name, form, is, symmetry, value, ...)       \
  case OpCode::id:                                                      \
    if constexpr (Is::is == Is::called) {                               \
      return [](double a, [[maybe_unused]] double b) { return value; }; \
    }                                                                   \
    return nullptr;
#include <rubato/formula/operations.inc>
    default: return nullptr;
  }
}

bool is_called(OpCode code) {
  return scalar_function(code) != nullptr;
}

SineAndCosine sincos_function() {
  return ::sincos;
}

}  // namespace rubato::formula
