#include <rubato/ode/taylor_code.hpp>

#include <algorithm>
#include <iterator>
#include <memory>
#include <string>

namespace rubato {

namespace {

using formula::Expression;

/// H in a graph of its own, so that taking derivatives leaves the Hamiltonian's untouched.
struct OwnGraph {
  explicit OwnGraph(const Hamiltonian& hamiltonian) {
    const std::size_t n = hamiltonian.degrees_of_freedom();
    for (std::size_t i = 0; i < 2 * n; ++i) {
      const auto& names = i < n ? hamiltonian.q_names() : hamiltonian.p_names();
      z.push_back(graph.variable(names[i % n]));
    }
    const Expression originals[] = {hamiltonian.expression()};
    H = formula::substitute(originals, graph, hamiltonian.variables(), z).front();
  }

  /// J g
  [[nodiscard]] std::vector<Expression> rotated(const std::vector<Expression>& g) const {
    const auto half = g.begin() + static_cast<std::ptrdiff_t>(g.size() / 2);
    std::vector<Expression> f(half, g.end());
    std::transform(g.begin(), half, std::back_inserter(f), [](Expression x) { return -x; });
    return f;
  }

  formula::Graph graph;
  std::vector<Expression> z;
  Expression H;
};

}  // namespace

formula::Bytecode flow_code(const Hamiltonian& hamiltonian) {
  const OwnGraph own(hamiltonian);
  return formula::Bytecode(own.rotated(formula::gradient(own.H, own.z)), own.z, false);
}

formula::Bytecode tangent_flow_code(const Hamiltonian& hamiltonian) {
  OwnGraph own(hamiltonian);
  const std::vector<Expression> gradient = formula::gradient(own.H, own.z);
  std::vector<Expression> inputs = own.z;
  Expression directional = own.graph.constant(0.0);  // v·∇H, whose gradient in z is H_zz v
  for (std::size_t i = 0; i < gradient.size(); ++i) {
    // No user's name contains a space.
    inputs.push_back(own.graph.variable("tangent " + std::to_string(i)));
    directional += gradient[i] * inputs.back();
  }
  std::vector<Expression> outputs = own.rotated(gradient);
  std::ranges::copy(own.rotated(formula::gradient(directional, own.z)), std::back_inserter(outputs));
  return formula::Bytecode(outputs, inputs, false);
}

formula::Bytecode energy_code(const Hamiltonian& hamiltonian) {
  const OwnGraph own(hamiltonian);
  const Expression outputs[] = {own.H};
  return formula::Bytecode(outputs, own.z, false);
}

}  // namespace rubato
