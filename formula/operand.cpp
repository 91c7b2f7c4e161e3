#include <rubato/formula/operand.hpp>

#include <fmt/format.h>

namespace rubato::formula {

std::string refusal(char symbol, const Operand& a, const Operand& b) {
  if (!a.is_vector() && !b.is_vector()) {
    return {};
  }
  if (symbol == '+' || symbol == '-') {
    if (a.is_vector() != b.is_vector()) {
      return fmt::format("{} stands between a vector and a number", symbol);
    }
    return a.vector.size() == b.vector.size() ? std::string()
                                              : fmt::format("{} stands between vectors with {} and {} components",
                                                            symbol, a.vector.size(), b.vector.size());
  }
  if (symbol != '^' && !b.is_vector()) {
    return {};
  }
  if (symbol == '*') {
    return a.is_vector() ? "a product of two vectors: write dot(r, s)" : "";
  }
  return fmt::format("{} does not take a vector here", symbol);
}

Expression scalar_product(std::span<const Expression> a, std::span<const Expression> b) {
  Expression sum = a[0] * b[0];
  for (std::size_t i = 1; i < a.size(); ++i) {
    sum += a[i] * b[i];
  }
  return sum;
}

}  // namespace rubato::formula
