#include <rubato/ode/separable.hpp>

#include <algorithm>
#include <vector>

namespace rubato {

namespace {

using formula::Expression;
using formula::Operation;

class Separator {
public:
  Separator(formula::Graph& graph, std::span<const Expression> variables)
      : graph_(graph), first_momentum_(variables.size() / 2) {
    for (const Expression variable : variables) {
      numbers_.push_back(graph_.node(variable.index()).a);
    }
    result_.T = graph_.constant(0.0);
    result_.V = graph_.constant(0.0);
  }

  Separation operator()(Expression H) {
    add(H, 1.0);
    return result_;
  }

private:
  void add(Expression term, double factor) {
    const formula::Node node = graph_.node(term.index());
    const Expression a(&graph_, node.a);
    const Expression b(&graph_, node.b);
    switch (node.operation) {
      case Operation::add: add(a, factor), add(b, factor); return;
      case Operation::subtract: add(a, factor), add(b, -factor); return;
      case Operation::negate: add(a, -factor); return;
      case Operation::multiply:
        if (a.is_constant()) {
          return add(b, factor * a.constant_value());
        }
        if (b.is_constant()) {
          return add(a, factor * b.constant_value());
        }
        break;
      case Operation::divide:
        if (b.is_constant()) {
          return add(a, factor / b.constant_value());
        }
        break;
      default: break;
    }
    bool on_q = false, on_p = false;
    for (const std::size_t number : formula::variables_of(term)) {
      const auto place = static_cast<std::size_t>(std::ranges::find(numbers_, number) - numbers_.begin());
      (place < first_momentum_ ? on_q : on_p) = true;
    }
    if (on_q && on_p) {
      if (result_.mixed.empty()) {
        result_.mixed = formula::to_string(term);
      }
      return;
    }
    (on_p ? result_.T : result_.V) += factor * term;
  }

  formula::Graph& graph_;
  std::size_t first_momentum_;
  std::vector<std::size_t> numbers_;
  Separation result_;
};

}  // namespace

Separation separate(Expression H, std::span<const Expression> variables) {
  return Separator(*H.graph(), variables)(H);
}

Separation separate(const Hamiltonian& hamiltonian) {
  return separate(hamiltonian.expression(), hamiltonian.variables());
}

bool is_quadratic(Expression T, std::span<const Expression> momenta) {
  for (const Expression slope : formula::gradient(T, momenta)) {
    for (const Expression second : formula::gradient(slope, momenta)) {
      if (!formula::variables_of(second).empty()) {
        return false;
      }
    }
  }
  return true;
}

}  // namespace rubato
