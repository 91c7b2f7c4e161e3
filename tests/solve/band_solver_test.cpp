#include <rubato/solve/band_solver.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <random>
#include <utility>
#include <vector>

#include <Eigen/Dense>
#include <catch2/catch.hpp>

using namespace rubato;
using solve::BandSolver;

namespace {

Eigen::MatrixXd random_band(int n, int lower, int upper, unsigned seed) {
  std::mt19937_64 engine(seed);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  return Eigen::MatrixXd::NullaryExpr(n, n, [&](Eigen::Index i, Eigen::Index j) {
    const double value = uniform(engine);
    return i - j <= lower && j - i <= upper ? value : 0.0;
  });
}

BandSolver with(const Eigen::MatrixXd& a, int lower, int upper) {
  const auto n = static_cast<int>(a.rows());
  BandSolver solver(n, lower, upper);
  solver.clear();
  for (int i = 0; i < n; ++i) {
    for (int j = std::max(0, i - lower); j <= std::min(n - 1, i + upper); ++j) {
      solver.entry(i, j) = a(i, j);
    }
  }
  return solver;
}

double backward_error(const Eigen::MatrixXd& a, const Eigen::VectorXd& x, const Eigen::VectorXd& b) {
  return (a * x - b).norm() / (a.norm() * x.norm());
}

}  // namespace

TEST_CASE("band matrices are solved backward stably, with exchanges of rows") {
  struct Shape {
    int n, lower, upper;
  };
  for (const auto& [n, lower, upper] : {Shape{1, 0, 0},
                                        {2, 1, 1},
                                        {5, 0, 2},
                                        {5, 2, 0},
                                        {40, 1, 1},
                                        {40, 3, 3},
                                        {41, 5, 2},
                                        {60, 2, 7},
                                        {12, 11, 11}}) {
    INFO(n << " rows, " << lower << " below, " << upper << " above");
    Eigen::MatrixXd a = random_band(n, lower, upper, 11u + static_cast<unsigned>(n));
    if (lower == 0 || upper == 0) {
      a.diagonal().array() +=
          4.0;  // elimination has nothing to exchange, and triangular matrices at random are singular
    } else {
      a.diagonal() *= 1e-17;  // without exchanges the growth is 1e17 and every digit is lost
    }
    const Eigen::VectorXd b = Eigen::VectorXd::LinSpaced(n, -1.0, 2.0);
    BandSolver solver = with(a, lower, upper);
    REQUIRE(solver.factor() == Status::success);
    Eigen::VectorXd x = b;
    solver.solve(x.data());
    // Partial pivoting grows entries of a band of width w by less than 4^w, of random ones by little: as in full ones.
    const double tolerance = 10.0 * std::pow(n, 5.0 / 3.0) * std::numeric_limits<double>::epsilon();
    CHECK(backward_error(a, x, b) < tolerance);
    a(n - 1, n - 1) += 1e-3;  // the twin: another entry
    CHECK(backward_error(a, x, b) > tolerance);
  }
}

TEST_CASE("band matrices that are singular or not finite are told, and the solver recovers") {
  const int n = 9;
  const Eigen::MatrixXd good = random_band(n, 2, 1, 5);
  BandSolver solver = with(good, 2, 1);
  solver.entry(4, 3) = solver.entry(4, 2) = solver.entry(4, 4) = solver.entry(4, 5) = 0.0;
  CHECK(solver.factor() == Status::singular);
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    solver = with(good, 2, 1);
    solver.entry(n - 2, n - 1) = bad;
    CHECK(solver.factor() == Status::undefined);
  }
  solver = with(good, 2, 1);
  CHECK(solver.factor() == Status::success);
  CHECK_THROWS_AS(BandSolver(0, 0, 0), std::invalid_argument);
  CHECK_THROWS_AS(BandSolver(3, 3, 0), std::invalid_argument);
  CHECK_THROWS_AS(BandSolver(3, 0, -1), std::invalid_argument);
}

TEST_CASE("vertices are numbered so that neighbours are close together") {
  const auto distance = [](const std::vector<int>& places, const std::vector<std::pair<int, int>>& edges) {
    int largest = 0;
    for (const auto& [a, b] : edges) {
      largest = std::max(largest, std::abs(places[static_cast<std::size_t>(a)] - places[static_cast<std::size_t>(b)]));
    }
    return largest;
  };
  const int n = 50;
  std::vector<int> names(n);
  std::iota(names.begin(), names.end(), 0);
  std::ranges::shuffle(names, std::mt19937(3));
  const auto edge = [&](int a, int b) {
    return std::pair(names[static_cast<std::size_t>(a)], names[static_cast<std::size_t>(b)]);
  };
  std::vector<std::pair<int, int>> chain, two_chains;
  for (int i = 0; i + 1 < n; ++i) {
    chain.push_back(edge(i, i + 1));
    if (i != 20) {
      two_chains.push_back(edge(i + 1, i));
    }
  }
  std::vector<std::pair<int, int>> ring = chain;
  ring.push_back(edge(0, n - 1));
  ring.push_back(edge(4, 4));
  std::vector<std::pair<int, int>> plane;  // 5 × 10
  for (int i = 0; i < n; ++i) {
    if (i % 5 != 4) {
      plane.push_back(edge(i, i + 1));
    }
    if (i + 5 < n) {
      plane.push_back(edge(i, i + 5));
    }
  }
  for (const auto& [edges, width] : {std::pair(chain, 1), {two_chains, 1}, {ring, 2}, {plane, 6}, {{}, 0}}) {
    std::vector<int> places = solve::reverse_cuthill_mckee(n, edges);
    CHECK(distance(places, edges) <= width);
    std::ranges::sort(places);
    for (int i = 0; i < n; ++i) {
      CHECK(places[static_cast<std::size_t>(i)] == i);  // each place once
    }
  }
  CHECK(distance(names, chain) > 2);  // the twin: as they were named
}
