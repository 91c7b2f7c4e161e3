#include <rubato/ode/discrete_lagrangian.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <string>

#include <rubato/formula/parse.hpp>
#include <rubato/formula/sum.hpp>

namespace rubato {

namespace {

using formula::Expression;

/// The corner variables of a segment, in a graph of their own: t_0, z_0, t_1, z_1.
struct Segment {
  explicit Segment(const Hamiltonian& hamiltonian) : n(hamiltonian.degrees_of_freedom()) {
    for (const char* suffix : {"_0", "_1"}) {
      corners.push_back(graph->variable(std::string("t") + suffix));
      for (const auto* names : {&hamiltonian.q_names(), &hamiltonian.p_names()}) {
        for (const std::string& name : *names) {
          corners.push_back(graph->variable(name + suffix));
        }
      }
    }
  }

  [[nodiscard]] Expression t(std::size_t corner) const { return corners[corner * (2 * n + 1)]; }
  [[nodiscard]] Expression z(std::size_t corner, std::size_t i) const { return corners[corner * (2 * n + 1) + 1 + i]; }
  [[nodiscard]] Expression middle(std::size_t i) const { return 0.5 * (z(0, i) + z(1, i)); }
  [[nodiscard]] Expression h() const { return t(1) - t(0); }

  [[nodiscard]] Expression at_middle(const Hamiltonian& hamiltonian) const {
    std::vector<Expression> middles;
    for (std::size_t i = 0; i < 2 * n; ++i) {
      middles.push_back(middle(i));
    }
    const Expression H[] = {hamiltonian.expression()};
    return formula::substitute(H, *graph, hamiltonian.variables(), middles).front();
  }

  [[nodiscard]] FormulaAction action(Expression A) const {
    return FormulaAction(graph, A, corners, Element{.corners = 2, .coordinates = 1, .values = 2 * n});
  }

  std::size_t n;
  std::shared_ptr<formula::Graph> graph = std::make_shared<formula::Graph>();
  std::vector<Expression> corners;
};

/// Σ_i momentum_i (q_1 - q_0)_i - h H(z̄)
template <typename Momentum>
FormulaAction phase_space_action(const Hamiltonian& hamiltonian, Momentum momentum) {
  const Segment segment(hamiltonian);
  Expression A = -(segment.h() * segment.at_middle(hamiltonian));
  for (std::size_t i = 0; i < segment.n; ++i) {
    A += momentum(segment, segment.n + i) * (segment.z(1, i) - segment.z(0, i));
  }
  return segment.action(A);
}

Expression parse_lagrangian(const Segment& segment, std::string_view L, const Hamiltonian::Parameters& parameters) {
  std::vector<std::string> names;
  for (std::size_t i = 0; i < segment.graph->variable_count(); ++i) {
    names.push_back(segment.graph->variable_name(i));
  }
  const std::size_t variables = names.size();
  for (const auto& [name, value] : parameters) {
    names.push_back(name);
  }
  const formula::ParseContext context{
      .resolve = [&](std::string_view name) -> std::optional<Expression> {
        if (const auto found = parameters.find(std::string(name)); found != parameters.end()) {
          return segment.graph->constant(found->second);
        }
        const auto end = names.begin() + static_cast<std::ptrdiff_t>(variables);
        return std::find(names.begin(), end, name) == end ? std::nullopt : std::optional(segment.graph->variable(name));
      },
      .known_names = names};
  return formula::parse(L, *segment.graph, context);
}

}  // namespace

FormulaAction midpoint_action(const Hamiltonian& hamiltonian) {
  return phase_space_action(hamiltonian, [](const Segment& segment, std::size_t i) { return segment.middle(i); });
}

FormulaAction forward_action(const Hamiltonian& hamiltonian) {
  return phase_space_action(hamiltonian, [](const Segment& segment, std::size_t i) { return segment.z(0, i); });
}

FormulaAction lagrangian_action(const Hamiltonian& hamiltonian, std::string_view L,
                                const Hamiltonian::Parameters& parameters) {
  const Segment segment(hamiltonian);
  return segment.action(segment.h() * parse_lagrangian(segment, L, parameters));
}

ReducedAction reduced_lagrangian_action(const Hamiltonian& hamiltonian, std::string_view L,
                                        const Hamiltonian::Parameters& parameters) {
  const Segment segment(hamiltonian);
  const auto [rest, constant] = formula::separate_constant(parse_lagrangian(segment, L, parameters));
  return {segment.action(segment.h() * rest), constant};
}

bool is_autonomous(DiscreteAction& action, std::span<const double> corners) {
  const Element& element = action.element();
  Eigen::VectorXd gradient(static_cast<Eigen::Index>(element.size()));
  std::vector<double> point(corners.begin(), corners.end());
  const auto t_0 = static_cast<Eigen::Index>(element.coordinate(0, 0));
  const auto t_1 = static_cast<Eigen::Index>(element.coordinate(1, 0));
  // Shifting both times by incommensurate amounts moves any explicit dependence on t, whatever its period.
  const double h = corners[element.coordinate(1, 0)] - corners[element.coordinate(0, 0)];
  for (const double shift : {0.0, 0.31830988618, 1.41421356237, 2.71828182846, 5.19615242271, 17.3205080757}) {
    point[element.coordinate(0, 0)] = corners[element.coordinate(0, 0)] + shift;
    point[element.coordinate(1, 0)] = point[element.coordinate(0, 0)] + h;
    action.gradient(point, gradient);
    // Each entry carries rounding of order ε·|∂A/∂t|, and ε·t/h more from forming t_1 - t_0.
    const double scale = std::max(std::abs(gradient[t_0]), std::abs(gradient[t_1]));
    const double rounding =
        64.0 * std::numeric_limits<double>::epsilon() * (1.0 + std::abs(point[element.coordinate(1, 0)] / h));
    if (std::abs(gradient[t_0] + gradient[t_1]) > rounding * scale) {
      return false;
    }
  }
  return true;
}

}  // namespace rubato
