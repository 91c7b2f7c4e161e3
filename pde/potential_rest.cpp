#include <rubato/pde/potential_rest.hpp>

#include <array>

#include <rubato/formula/bytecode.hpp>

namespace rubato {

PotentialRest rest_of_potential(const MultisymplecticSystem& system, const Eigen::MatrixXd& L,
                                std::span<const int> fields) {
  PotentialRest rest{std::make_shared<formula::Graph>(), {}, {}};
  std::vector<formula::Expression> to(system.fields().size(), rest.graph->constant(0.0));
  for (const int f : fields) {
    const auto number = static_cast<std::size_t>(f);
    rest.variables.push_back(to[number] = rest.graph->variable(system.fields()[number]));
  }
  rest.value = formula::substitute(std::array{system.expression()}, *rest.graph, system.variables(), to).front();
  for (std::size_t i = 0; i < fields.size(); ++i) {
    for (std::size_t j = 0; j <= i; ++j) {
      if (const double entry = L(fields[i], fields[j]); entry != 0.0) {
        rest.value = rest.value - (i == j ? 0.5 * entry : entry) * (rest.variables[i] * rest.variables[j]);
      }
    }
  }
  return rest;
}

std::vector<double> potential_slopes_at_zero(const MultisymplecticSystem& system) {
  formula::ScalarEvaluator gradient(system.gradient_code());
  const std::vector<double> zero(system.fields().size(), 0.0);
  std::vector<double> outputs(zero.size() + 1);
  gradient(zero, outputs);
  return {outputs.begin() + 1, outputs.end()};
}

}  // namespace rubato
