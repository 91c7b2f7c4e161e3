// Polynomials through the nodes next to a place, on axes between walls.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <vector>

#include <rubato/grids/local_polynomial.hpp>
#include <rubato/grids/weights.hpp>

using namespace rubato::grids;

namespace {

Axis between_walls(std::size_t cells) {
  return {.name = "x", .from = -1.0, .to = 2.0, .cells = cells + 1, .left = End::fixed, .right = End::free};
}

double value_at(const Axis& axis, double x, bool of_derivative, double (*f)(double)) {
  const LocalWeights weights = local_weights(axis, x, of_derivative);
  double sum = 0.0;
  for (std::size_t i = 0; i < weights.of.size(); ++i) {
    sum += weights.of[i] * f(axis.node(weights.first + i));
  }
  return sum;
}

}  // namespace

TEST_CASE("local polynomials have the powers that their nodes determine, and no more") {
  const auto ninth = [](double x) { return std::pow(x, 9) - x; };
  const auto tenth = [](double x) { return std::pow(x, 10); };
  const Axis axis = between_walls(12);
  for (const double x : {-1.0, -0.93, 0.1, 0.5, 1.99, 2.0}) {
    // Weights near walls are up to 1e3, of values up to 512.
    CHECK(value_at(axis, x, false, ninth) == Approx(ninth(x)).margin(1e-9));
    CHECK(value_at(axis, x, true, ninth) == Approx(9.0 * std::pow(x, 8) - 1.0).margin(1e-8));
  }
  CHECK(std::abs(value_at(axis, -0.93, false, tenth) - tenth(-0.93)) > 1e-6);
}

TEST_CASE("derivatives between walls err by the ninth power of the spacing, and only along their axis") {
  const auto error = [](std::size_t cells) {
    const Grid grid({{"y", 0.0, 1.0, 3}, between_walls(cells)});
    std::vector<double> values(grid.size()), derivative(grid.size());
    for (std::size_t node = 0; node < grid.size(); ++node) {
      const auto [i, j, k] = grid.place(node);
      values[node] = static_cast<double>(i) + std::sin(3.0 * grid.axis(1).node(j));
    }
    local_derivative(grid, 1, values.data(), derivative.data());
    double largest = 0.0;
    for (std::size_t node = 0; node < grid.size(); ++node) {
      const double x = grid.axis(1).node(grid.place(node)[1]);
      largest = std::max(largest, std::abs(derivative[node] - 3.0 * std::cos(3.0 * x)));
    }
    return largest;
  };
  CHECK(std::log2(error(24) / error(48)) == Approx(9.0).margin(0.6));
  CHECK(std::log2(error(32) / error(64)) == Approx(9.0).margin(0.6));
}

TEST_CASE("a grid between walls has both ends, and its weights add up to its volume") {
  const Grid grid({between_walls(6), {"y", 0.0, 1.0, 4}});
  CHECK(grid.size() == 28);
  CHECK(grid.spacing(0) == 0.5);
  CHECK(grid.axis(0).node(6) == 2.0);
  CHECK(grid.volume() == Approx(3.0));
  double sum = 0.0;
  for (std::size_t node = 0; node < grid.size(); ++node) {
    sum += grid.weight(node) * grid.cell_volume();
  }
  CHECK(sum == Approx(3.0));
  // Of any nodes that follow each other, with ghosts beyond the walls as well.
  Axis with_ghosts = between_walls(6);
  with_ghosts.cells += 4;
  with_ghosts.ghosts = 2;
  for (const Grid& some : {grid, Grid({with_ghosts, {"y", 0.0, 1.0, 4}}), Grid({{"y", 0.0, 1.0, 4}, with_ghosts})}) {
    for (std::size_t first = 0; first < some.size(); ++first) {
      std::vector<double> values(some.size() - first, 3.0);
      weigh(some, first, values);
      for (std::size_t i = 0; i < values.size(); ++i) {
        CHECK(values[i] == 3.0 * some.weight(first + i));
      }
    }
  }
  CHECK_THROWS_AS(Grid({{.name = "x", .from = 0.0, .to = 1.0, .cells = 9, .left = End::fixed}}), std::invalid_argument);
}
