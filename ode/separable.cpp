#include <rubato/ode/separable.hpp>

#include <algorithm>
#include <unordered_map>
#include <vector>

#include <rubato/formula/branches.hpp>

namespace rubato {

namespace {

using formula::Expression;
using formula::Operation;

class Separator {
public:
  Separator(formula::Graph& graph, std::span<const Expression> variables) : graph_(graph) {
    for (std::size_t i = 0; i < variables.size(); ++i) {
      depends_on_[variables[i].index()] = i < variables.size() / 2 ? coordinates : momenta;
    }
    result_.T = graph_.constant(0.0);
    result_.V = graph_.constant(0.0);
  }

  Separation operator()(Expression H) {
    find_dependence(H.index());
    add(H, 1.0);
    return result_;
  }

private:
  enum Part : unsigned char { coordinates = 1, momenta = 2, both = 3 };

  /// Of all nodes up to this one; arguments stand before those who use them.
  void find_dependence(formula::NodeIndex last) {
    depends_.assign(last + 1, 0);
    for (formula::NodeIndex i = 0; i <= last; ++i) {
      const formula::Node& node = graph_.node(i);
      const int arguments = formula::arity(node.operation);
      if (const auto variable = depends_on_.find(i); variable != depends_on_.end()) {
        depends_[i] = variable->second;
      } else if (arguments >= 1) {
        depends_[i] = depends_[node.a] | (arguments == 2 ? depends_[node.b] : 0);
      }
    }
  }

  /// What depends on one of the two stays as it is: long sums keep their order.
  void add(Expression term, double factor) {
    if (const unsigned char part = depends_[term.index()]; part != both) {
      (part == momenta ? result_.T : result_.V) += factor * term;
      return;
    }
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
    if (result_.mixed.empty()) {
      result_.mixed = formula::to_string(term);
    }
  }

  formula::Graph& graph_;
  std::unordered_map<formula::NodeIndex, unsigned char> depends_on_;  ///< of variables
  std::vector<unsigned char> depends_;                                ///< Part, of each node
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
  return !formula::is_piecewise(T, momenta) &&
         std::ranges::all_of(formula::hessian_entries(T, momenta), [](const formula::HessianEntry& second) {
           return second.value.is_constant() || formula::variables_of(second.value).empty();
         });
}

}  // namespace rubato
