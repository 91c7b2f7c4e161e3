#include <omp.h>

#include <cmath>
#include <cstring>
#include <random>
#include <stdexcept>
#include <vector>

#include <catch2/catch.hpp>
#include <rubato/grids/box_operators.hpp>
#include <rubato/grids/field_set.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/grids/reductions.hpp>

using namespace rubato::grids;

namespace {

Grid grid_of(int dimensions, std::size_t nx = 7) {
  std::vector<Axis> axes{{"x", -1.0, 2.5, nx}, {"y", 0.0, 1.25, 5}, {"z", 3.0, 9.0, 4}};
  axes.resize(dimensions);
  return Grid(axes);
}

std::vector<double> random_values(std::size_t count, unsigned seed = 1) {
  std::mt19937_64 engine(seed);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::vector<double> values(count);
  for (double& v : values) {
    v = uniform(engine);
  }
  return values;
}

/// The definition, corner by corner and with modulo.
std::vector<double> by_definition(const Grid& g, const BoxOperator& op, const std::vector<double>& z) {
  std::vector<double> current = z;
  for (int a = 0; a < g.dimensions(); ++a) {
    std::vector<double> next(g.size());
    for (std::size_t node = 0; node < g.size(); ++node) {
      auto place = g.place(node);
      place[a] = (place[a] + 1) % g.cells(a);
      const double own = current[node];
      const double neighbour = current[g.index(place[0], place[1], place[2])];
      next[node] = op[a] == Along::identity  ? own
                   : op[a] == Along::next    ? neighbour
                   : op[a] == Along::average ? 0.5 * (own + neighbour)
                                             : (neighbour - own) / g.spacing(a);
    }
    current = next;
  }
  return current;
}

double distance(const std::vector<double>& a, const std::vector<double>& b) {
  return max_abs_of(a.size(), [&](std::size_t i) { return a[i] - b[i]; });
}

}  // namespace

TEST_CASE("axes that cannot be used are refused with their values") {
  const double infinity = std::numeric_limits<double>::infinity();
  CHECK_THROWS_WITH(Grid({{"x", 2.0, 1.0, 10}}), Catch::Contains("from = 2") && Catch::Contains("to = 1"));
  CHECK_THROWS_WITH(Grid({{"x", 1.0, 1.0, 10}}), Catch::Contains("from = 1"));
  CHECK_THROWS_WITH(Grid({{"x", 0.0, 1.0, 2}}), Catch::Contains("not 2"));
  CHECK_THROWS_WITH(Grid({{"y", 0.0, infinity, 5}}), Catch::Contains("axis y") && Catch::Contains("inf"));
  CHECK_THROWS_WITH(Grid({{"x", 0.0, std::nan(""), 5}}), Catch::Contains("nan"));
  CHECK_THROWS_WITH(Grid({{"x", 1e16, 1e16 + 2, 50}}), Catch::Contains("rounding"));
  CHECK_THROWS_WITH(Grid({{"x", 0.0, 1.0, 5}, {"x", 0.0, 1.0, 5}}), Catch::Contains("named x"));
  CHECK_THROWS_WITH(Grid({}), Catch::Contains("not 0"));
  const std::size_t many = 10'000'000;
  CHECK_THROWS_WITH(Grid({{"x", 0.0, 1.0, many}, {"y", 0.0, 1.0, many}, {"z", 0.0, 1.0, many}}),
                    Catch::Contains("GB of memory"));
  CHECK_NOTHROW(Grid({{"x", 0.0, 1.0, 3}}));
}

TEST_CASE("nodes are numbered with x fastest and lie at from + i dx") {
  const Grid g = grid_of(3);
  CHECK(g.size() == 7 * 5 * 4);
  CHECK(g.index(2, 3, 1) == 2 + 7 * (3 + 5 * 1));
  CHECK(g.place(g.index(6, 4, 3)) == std::array<std::size_t, 3>{6, 4, 3});
  CHECK(g.axis(0).node(0) == -1.0);
  CHECK(g.axis(0).node(7) == 2.5);
  CHECK(g.axis(0).centre(0) == -0.75);
  CHECK(g.cell_volume() == 0.5 * 0.25 * 1.5);
  CHECK(grid_of(1).stride(0) == 1);
  CHECK(g.stride(2) == 35);
}

TEST_CASE("box operators are what their definition says, in every dimension and across every seam") {
  const int dimensions = GENERATE(1, 2, 3);
  const std::size_t nx = GENERATE(3, 7, 4095, 4096, 4097, 9001);
  const Grid g = grid_of(dimensions, nx);
  const std::vector<double> z = random_values(g.size());
  for (int code = 0; code < (dimensions == 1 ? 4 : dimensions == 2 ? 16 : 64); ++code) {
    const BoxOperator op{static_cast<Along>(code % 4), static_cast<Along>(code / 4 % 4), static_cast<Along>(code / 16)};
    std::vector<double> out(g.size());
    apply(g, op, z.data(), out.data());
    const std::vector<double> expected = by_definition(g, op, z);
    // At most eight terms of size 1, scaled by at most Π 1/Δ.
    const double scale = 1.0 / (g.spacing(0) < 1.0 ? g.spacing(0) : 1.0) * 4.0;
    CHECK(distance(out, expected) < 1e-15 * 8 * scale);
    // Twin: the same without the cyclic neighbour at one end of x.
    if (op[0] != Along::identity) {
      out[nx - 1] = out[0];
      CHECK(distance(out, expected) > 1e-15 * 8 * scale);
    }
    // ⟨op z, r⟩ = ⟨z, opᵀ r⟩ by compensated sums: the error is that of the operators, ε of Σ |terms|.
    const std::vector<double> r = random_values(g.size(), 2);
    std::vector<double> back(g.size());
    apply(g, op, z.data(), out.data());
    apply_adjoint(g, op, r.data(), back.data());
    const double size = 1e-15 * scale * static_cast<double>(g.size());
    CHECK(std::abs(dot(out, r) - dot(z, back)) < size);
    // Twin: a difference's adjoint has the opposite sign to the difference of the node before.
    if (dimensions == 1 && op[0] == Along::difference) {
      CHECK(std::abs(dot(out, r) + dot(z, back)) > size);
    }
  }
}

TEST_CASE("differences of constants are exactly zero") {
  const Grid g = grid_of(2, 101);
  const std::vector<double> z(g.size(), 0.1);
  std::vector<double> out(g.size());
  apply(g, {Along::difference, Along::average, Along::identity}, z.data(), out.data());
  CHECK(max_abs(out) == 0.0);
  std::vector<double> spoiled = z;
  spoiled[50] = std::nextafter(0.1, 1.0);
  apply(g, {Along::difference, Along::average, Along::identity}, spoiled.data(), out.data());
  CHECK(max_abs(out) > 0.0);
}

TEST_CASE("operators beyond the grid's axes are refused") {
  const Grid g = grid_of(1);
  std::vector<double> z(g.size());
  CHECK_THROWS_AS(apply(g, {Along::average, Along::average, Along::identity}, z.data(), z.data()),
                  std::invalid_argument);
  CHECK_THROWS_AS(invert_average(g, 1, z.data(), z.data()), std::invalid_argument);
}

TEST_CASE("the inverse of the average is exact along every axis, and refused for even counts") {
  const std::size_t n = GENERATE(3, 5, 1001, 100001);
  const int axis = GENERATE(0, 1, 2);
  if (axis > 0 && n > 1001) {
    return;
  }
  std::vector<Axis> axes{{"x", 0.0, 1.0, 3}, {"y", 0.0, 1.0, 5}, {"z", 0.0, 1.0, 7}};
  axes[axis].cells = n;
  const Grid g(axes);
  std::vector<double> w = random_values(g.size());
  BoxOperator op{Along::identity, Along::identity, Along::identity};
  op[axis] = Along::average;
  std::vector<double> b(g.size());
  apply(g, op, w.data(), b.data());
  invert_average(g, axis, b.data(), b.data());
  // Each b carries a rounding ε/2 of its size ≤ 1; the worst sum of them is N ε, a typical one sqrt(N) ε. Allow ten of
  // those.
  CHECK(distance(b, w) < 10.0 * 1.2e-16 * std::sqrt(static_cast<double>(n)) + 5e-16);
  axes[axis].cells = n + 1;
  const Grid even(axes);
  std::vector<double> v(even.size());
  CHECK_THROWS_WITH(invert_average(even, axis, v.data(), v.data()),
                    Catch::Contains(std::to_string(n + 1)) && Catch::Contains("take " + std::to_string(n + 2)));
}

TEST_CASE("the inverse average adds one rounding only, where the plain recurrence adds them up") {
  // b with a large alternating part that the recurrence sums: exact w = (-1)^i S_i with prefix sums S_i of b.
  const std::size_t n = 200'001;
  const Grid g({{"x", 0.0, 1.0, n}});
  const std::vector<double> b = random_values(n, 3);
  std::vector<double> w(n);
  invert_average(g, 0, b.data(), w.data());
  std::vector<long double> exact(n + 1);
  long double start = 0.0L;
  for (std::size_t i = 0; i < n; ++i) {
    start += i % 2 == 0 ? static_cast<long double>(b[i]) : -static_cast<long double>(b[i]);
  }
  exact[0] = start;
  double plain = static_cast<double>(start);
  double worst = 0.0;
  double worst_plain = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    worst = std::max(worst, std::abs(static_cast<double>(w[i] - exact[i])) / (1.0 + std::abs(w[i])));
    worst_plain = std::max(worst_plain, std::abs(static_cast<double>(plain - exact[i])) / (1.0 + std::abs(w[i])));
    exact[i + 1] = 2.0L * b[i] - exact[i];
    plain = 2.0 * b[i] - plain;
  }
  CHECK(worst < 2.3e-16);
  CHECK(worst_plain > 2.3e-16);
}

TEST_CASE("reductions do not depend on the number of threads, and lose nothing to rounding") {
  const std::size_t n = 1'000'003;
  std::vector<double> v = random_values(n);
  // Huge terms that cancel: a plain sum keeps no digit of the rest.
  v[17] = 1e17;
  v[n - 5] = -1e17;
  long double exact = 0.0L;
  for (std::size_t i = 0; i < n; ++i) {
    exact += i == 17 || i == n - 5 ? 0.0L : static_cast<long double>(v[i]);
  }
  const int threads = omp_get_max_threads();
  omp_set_num_threads(1);
  const double one = sum(v);
  const double one_dot = dot(v, v);
  CHECK(std::abs(one - static_cast<double>(exact)) < 1e-12);
  double plain = 0.0;
  for (const double x : v) {
    plain += x;
  }
  CHECK_FALSE(std::abs(plain - static_cast<double>(exact)) < 1e-12);
  for (const int count : {2, 3, 5, 8}) {
    omp_set_num_threads(count);
    CHECK(sum(v) == one);
    CHECK(dot(v, v) == one_dot);
  }
  omp_set_num_threads(threads);
  CHECK(max_abs(v) == 1e17);
  CHECK(rms(std::vector<double>{3.0, -4.0, 0.0, 0.0}) == 2.5);
  CHECK(sum({}) == 0.0);
  CHECK(max_abs({}) == 0.0);
}

TEST_CASE("reductions let no undefined value pass") {
  for (const std::size_t place : {std::size_t{0}, std::size_t{5000}, std::size_t{20000}}) {
    std::vector<double> v = random_values(20001);
    v[place] = std::nan("");
    CHECK(std::isnan(sum(v)));
    CHECK(std::isnan(max_abs(v)));
    CHECK(std::isnan(rms(v)));
    v[place] = -std::numeric_limits<double>::infinity();
    CHECK(sum(v) == -std::numeric_limits<double>::infinity());
    CHECK(max_abs(v) == std::numeric_limits<double>::infinity());
  }
}

TEST_CASE("field sets are contiguous, start at zero and copy deeply") {
  FieldSet a(3, 5);
  CHECK(max_abs(a.all()) == 0.0);
  a.field(1)[2] = 7.0;
  CHECK(a.all()[7] == 7.0);
  CHECK(a.pointers()[1] == a.all().data() + 5);
  FieldSet b = a;
  b.field(1)[2] = 8.0;
  CHECK(a.field(1)[2] == 7.0);
  a = b;
  CHECK(a.field(1)[2] == 8.0);
  CHECK(a.pointers()[0] != b.pointers()[0]);
  CHECK(reinterpret_cast<std::uintptr_t>(a.all().data()) % 64 == 0);
}
