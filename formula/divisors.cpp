#include <rubato/formula/divisors.hpp>

#include <algorithm>
#include <array>
#include <cmath>

#include <rubato/formula/reachable.hpp>

namespace rubato::formula {

namespace {

class DivisorSearch {
public:
  explicit DivisorSearch(Graph& graph) : graph_(graph) {}

  /// Takes what the node divides by.
  void look_at(NodeIndex index) {
    const Node node = graph_.node(index);
    switch (node.operation) {
      case Operation::divide: add_factors(node.b); break;
      case Operation::power:
        if (const Node& exponent = graph_.node(node.b);
            exponent.operation == Operation::constant && exponent.value < 0) {
          add_factors(node.a);
        }
        break;
      case Operation::tan: add_factors(cos(Expression(&graph_, node.a)).index()); break;
      case Operation::csch: add_factors(node.a); break;
      default: break;
    }
  }

  [[nodiscard]] std::vector<Expression> found() && { return std::move(found_); }

private:
  void add_factors(NodeIndex index) {
    const Node node = graph_.node(index);
    switch (node.operation) {
      case Operation::negate:
      case Operation::abs:
      case Operation::sqrt:
      case Operation::cbrt:
      case Operation::power: add_factors(node.a); break;
      case Operation::multiply:
        add_factors(node.a);
        add_factors(node.b);
        break;
      case Operation::divide: add_factors(node.a); break;
      default: add(index);
    }
  }

  void add(NodeIndex index) {
    const Expression divisor(&graph_, index);
    if (!keeps_its_sign(index) && std::ranges::find(found_, divisor) == found_.end()) {
      found_.push_back(divisor);
    }
  }

  /// True if the node is nowhere negative by its form.
  [[nodiscard]] bool keeps_its_sign(NodeIndex index) const {
    const Node& node = graph_.node(index);
    switch (node.operation) {
      case Operation::constant: return node.value >= 0.0;
      case Operation::abs:
      case Operation::sqrt:
      case Operation::exp:
      case Operation::cosh:
      case Operation::sech: return true;
      case Operation::power: {
        const Node& exponent = graph_.node(node.b);
        const bool is_constant = exponent.operation == Operation::constant;
        return !is_constant || std::fmod(exponent.value, 2.0) == 0.0 || exponent.value != std::floor(exponent.value) ||
               keeps_its_sign(node.a);
      }
      case Operation::multiply: return node.a == node.b || (keeps_its_sign(node.a) && keeps_its_sign(node.b));
      case Operation::add:
      case Operation::divide: return keeps_its_sign(node.a) && keeps_its_sign(node.b);
      default: return false;
    }
  }

  Graph& graph_;
  std::vector<Expression> found_;
};

}  // namespace

std::vector<Expression> divisors_of(Expression formula) {
  DivisorSearch search(*formula.graph());
  for (const NodeIndex index : reachable(std::array{formula})) {
    search.look_at(index);
  }
  std::vector<Expression> found = std::move(search).found();
  std::erase_if(found, [](Expression divisor) { return variables_of(divisor).empty(); });
  return found;
}

}  // namespace rubato::formula
