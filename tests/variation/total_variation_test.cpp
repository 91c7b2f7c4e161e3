// The discrete total variation on actions small enough to vary by hand, a segment and a cell.

#include <catch2/catch.hpp>

#include <memory>
#include <string>
#include <vector>

#include <fmt/format.h>

#include <rubato/formula/expression.hpp>
#include <rubato/variation/formula_action.hpp>

#include "variation/conformance.hpp"

using namespace rubato;
using conformance::failures;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

std::vector<formula::Expression> variables(formula::Graph& graph, std::size_t count) {
  std::vector<formula::Expression> result;
  for (std::size_t i = 0; i < count; ++i) {
    result.push_back(graph.variable(fmt::format("c{}", i)));
  }
  return result;
}

/// A free particle's A = (q_1 - q_0)²/(2h), on (t_0, q_0, t_1, q_1).
FormulaAction free_particle() {
  auto graph = std::make_shared<formula::Graph>();
  const auto c = variables(*graph, 4);
  const auto dq = c[3] - c[1];
  return {graph, dq * dq / (2.0 * (c[2] - c[0])), c, Element{.corners = 2, .coordinates = 1, .values = 1}};
}

/// On a cell with 4 corners, 2 coordinates and 1 value: twice its area by the diagonals, times u_0 u_1 u_2 u_3.
FormulaAction weighted_area() {
  auto graph = std::make_shared<formula::Graph>();
  const auto c = variables(*graph, 12);
  const auto t = [&](std::size_t corner) { return c[3 * corner]; };
  const auto x = [&](std::size_t corner) { return c[3 * corner + 1]; };
  const auto u = [&](std::size_t corner) { return c[3 * corner + 2]; };
  const auto area = (t(3) - t(0)) * (x(2) - x(1)) - (t(2) - t(1)) * (x(3) - x(0));
  return {graph, area * u(0) * u(1) * u(2) * u(3), c, Element{.corners = 4, .coordinates = 2, .values = 1}};
}

}  // namespace

TEST_CASE("the variations of a free particle are those found by hand") {
  FormulaAction action = free_particle();
  // Velocities 2 and 3 on steps of 0.5 and 0.25.
  const std::vector<double> first = {1.0, 0.0, 1.5, 1.0};
  const std::vector<double> second = {1.5, 1.0, 1.75, 1.75};
  const Incidence node[] = {{first, 1}, {second, 0}};
  // ∂A/∂q_1 = v, ∂A/∂q_0 = -v; ∂A/∂t_1 = -v²/2, ∂A/∂t_0 = v²/2. All numbers are exact in binary.
  CHECK(value_variation(action, node)[0] == 2.0 - 3.0);
  CHECK(coordinate_variation(action, node, 0) == -2.0 + 4.5);
  CHECK(boundary_one_form(action, first, 0) == VectorXd{{2.0, -2.0, 0.0, 0.0}});
  CHECK(boundary_one_form(action, first, 1) == VectorXd{{0.0, 0.0, -2.0, 2.0}});
  // Mixed second derivatives, h = 1/2: ∂t_0∂t_1: -v²/h = -8, ∂t_0∂q_1 = v/h = 4, ∂q_0∂t_1 = v/h = 4, ∂q_0∂q_1 = -1/h =
  // -2.
  const MatrixXd form = two_form(action, first);
  const Eigen::Matrix2d mixed{{-8.0, 4.0}, {4.0, -2.0}};
  CHECK(form.topRightCorner(2, 2) == mixed);
  CHECK(form.bottomLeftCorner(2, 2) == -mixed.transpose());
  CHECK(form.topLeftCorner(2, 2).isZero(0.0));
  CHECK(form.bottomRightCorner(2, 2).isZero(0.0));
}

TEST_CASE("actions on segments and cells conform") {
  FormulaAction segment = free_particle();
  CHECK(failures(segment, VectorXd{{0.1, 0.2, 0.9, -0.4}}) == std::vector<std::string>{});
  FormulaAction cell = weighted_area();
  const VectorXd corners{{0.0, 0.1, 1.0, 0.1, 1.2, 0.8, 0.9, 0.0, 1.1, 1.0, 1.1, 0.9}};
  CHECK(failures(cell, corners) == std::vector<std::string>{});
  CHECK(failures(cell, corners, {.autonomous = false}) == std::vector<std::string>{"autonomy"});
}

TEST_CASE("two-forms and tangents of a two-step map belong to segments") {
  FormulaAction cell = weighted_area();
  const std::vector<double> corners(12, 0.5);
  CHECK_THROWS_AS(two_form(cell, corners), std::invalid_argument);
  CHECK_THROWS_AS(two_step_tangent(cell, corners, corners), std::invalid_argument);
  auto graph = std::make_shared<formula::Graph>();
  const auto c = variables(*graph, 3);
  CHECK_THROWS_WITH(FormulaAction(graph, c[0] * c[1], c, Element{.corners = 2, .coordinates = 1, .values = 1}),
                    Catch::Contains("4 variables, got 3"));
}
