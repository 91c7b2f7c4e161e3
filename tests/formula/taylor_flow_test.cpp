#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/expression.hpp>
#include <rubato/formula/taylor.hpp>
#include <vector>

namespace {

using namespace rubato::formula;
using rubato::Status;
using Vector = std::vector<double>;

constexpr double epsilon = std::numeric_limits<double>::epsilon();

/// A Hamiltonian with what its flow and its generating functions need; variables q then p.
struct System {
  Graph graph;
  std::vector<Expression> z;
  Expression h;

  [[nodiscard]] std::size_t half() const { return z.size() / 2; }
  /// J g for the gradient g: q' = H_p, p' = -H_q.
  [[nodiscard]] std::vector<Expression> field() const {
    std::vector<Expression> f = gradient(h, z);
    std::ranges::rotate(f, f.begin() + static_cast<std::ptrdiff_t>(half()));
    for (std::size_t m = half(); m < f.size(); ++m)
      f[m] = -f[m];
    return f;
  }
  [[nodiscard]] Bytecode field_code() const { return Bytecode(field(), z, false); }
  [[nodiscard]] double value(Expression e, const Vector& at) const {
    ScalarEvaluator evaluator(Bytecode(std::vector{e}, z));
    std::ranges::copy(at, evaluator.inputs().begin());
    evaluator.run();
    return evaluator.output(0);
  }
};

void declare(System& system, std::initializer_list<const char*> names) {
  for (const char* name : names)
    system.z.push_back(system.graph.variable(name));
}

void make_pendulum(System& s) {
  declare(s, {"q", "p"});
  s.h = s.z[1] * s.z[1] / 2 - cos(s.z[0]);
}
void make_kepler(System& s) {
  declare(s, {"x", "y", "u", "v"});
  s.h = (s.z[2] * s.z[2] + s.z[3] * s.z[3]) / 2 - 1 / sqrt(s.z[0] * s.z[0] + s.z[1] * s.z[1]);
}
Vector flow(const System& system, Vector z, double time, int order, int steps) {
  TaylorFlow taylor(system.field_code(), order);
  for (int k = 0; k < steps; ++k) {
    REQUIRE(taylor(z) == Status::success);
    taylor.evaluate(time / steps, z);
  }
  return z;
}

double distance(const Vector& a, const Vector& b) {
  double worst = 0.0;
  for (std::size_t m = 0; m < a.size(); ++m)
    worst = std::max(worst, std::abs(a[m] - b[m]));
  return worst;
}

}  // namespace

TEST_CASE("Taylor series of the harmonic oscillator") {
  System s;
  declare(s, {"q", "p"});
  s.h = (s.z[0] * s.z[0] + s.z[1] * s.z[1]) / 2;
  TaylorFlow taylor(s.field_code(), 20);
  REQUIRE(taylor(Vector{1.0, 0.0}) == Status::success);
  double factorial = 1.0;
  for (int j = 0; j <= 20; ++j) {
    // q = cos t, p = -sin t; one division a coefficient.
    const double cosine = j % 2 == 1 ? 0.0 : (j % 4 == 0 ? 1.0 : -1.0) / factorial;
    CHECK(taylor.coefficient(0, j) == Approx(cosine).epsilon(20 * epsilon).margin(0));
    factorial *= j + 1;
  }
  Vector z(2);
  taylor.evaluate(0.7, z);
  CHECK(distance(z, {std::cos(0.7), -std::sin(0.7)}) <= 4 * epsilon);
  taylor.evaluate(0.7 + 1e-14, z);
  CHECK(distance(z, {std::cos(0.7), -std::sin(0.7)}) > 4 * epsilon);
}

TEST_CASE("order 0 and 1 of a flow") {
  System s;
  make_pendulum(s);
  const Vector start = {0.3, 0.4};
  CHECK(flow(s, start, 0.1, 0, 1) == start);
  CHECK(distance(flow(s, start, 0.1, 1, 1), {0.3 + 0.1 * 0.4, 0.4 - 0.1 * std::sin(0.3)}) <= 2 * epsilon);
}

TEST_CASE("one long step of high order against many short ones") {
  System s;
  make_pendulum(s);
  const Vector start = {0.3, 1.2};
  // The series of the pendulum in t converges for |t| < 1.9 here (the nearest complex pole), so that order 30 leaves
  // (0.3/1.9)^31 = 2e-25 at t = 0.3, and order 12 in steps of 0.03 leaves less: rounding remains.
  const Vector fine = flow(s, start, 0.3, 12, 10);
  CHECK(distance(flow(s, start, 0.3, 30, 1), fine) <= 20 * epsilon);
  CHECK(distance(flow(s, start, 0.3, 5, 1), fine) > 1e-9);
  CHECK(std::abs(s.value(s.h, fine) - s.value(s.h, start)) <= 20 * epsilon);
}

TEST_CASE("Taylor steps along a Kepler orbit meet Kepler's equation") {
  System s;
  make_kepler(s);
  const double e = 0.6;
  const Vector start = {1 - e, 0, 0, std::sqrt((1 + e) / (1 - e))};
  const double time = 2.5;
  double anomaly = time;  // E - e sin E = t
  for (int k = 0; k < 50; ++k)
    anomaly -= (anomaly - e * std::sin(anomaly) - time) / (1 - e * std::cos(anomaly));
  const double r = 1 - e * std::cos(anomaly);
  const Vector exact = {std::cos(anomaly) - e, std::sqrt(1 - e * e) * std::sin(anomaly), -std::sin(anomaly) / r,
                        std::sqrt(1 - e * e) * std::cos(anomaly) / r};
  // The nearest singularity at perihelion is at |t| = arcosh(1/e) - sqrt(1-e²) ≈ 0.3 from the real axis; order 20 in
  // steps of 0.025 leaves (1/12)^21 a step. Rounding, amplified by the Kepler flow: 1e-13.
  CHECK(distance(flow(s, start, time, 20, 100), exact) <= 1e-13);
  CHECK(distance(flow(s, start, time, 4, 100), exact) > 1e-7);
}

TEST_CASE("a flow says why it cannot be expanded") {
  System s;
  make_kepler(s);
  TaylorFlow taylor(s.field_code(), 5);
  CHECK(taylor(Vector{0, 0, 1, 1}) == Status::undefined);
  CHECK_THAT(taylor.failure(), Catch::Contains("no Taylor expansion at 0"));
  CHECK(taylor(Vector{1, 0, 1, 1}) == Status::success);
  CHECK(taylor.failure().empty());
}

TEST_CASE("flows side by side are the flows one by one") {
  System s;
  make_kepler(s);
  constexpr int order = 12;
  const std::vector<Vector> starts = {{1, 0, 0, 1.1}, {0.7, 0.2, -0.1, 1}, {1, 0, 0, 1.1}};
  const std::vector<const double*> pointers = {starts[0].data(), starts[1].data(), starts[2].data()};
  TaylorFlow together(s.field_code(), order, 3);
  TaylorFlow alone(s.field_code(), order);
  REQUIRE(together(pointers) == Status::success);
  for (std::size_t lane = 0; lane < 3; ++lane) {
    REQUIRE(alone(starts[lane]) == Status::success);
    for (std::size_t m = 0; m < 4; ++m)
      for (int j = 0; j <= order; ++j)
        CHECK(together.coefficient(m, j, lane) == alone.coefficient(m, j));
  }
  CHECK(together.coefficient(0, 2, 0) != together.coefficient(0, 2, 1));
  Vector z(4);
  Vector expected(4);
  together.evaluate(0.1, z, 2);
  alone.evaluate(0.1, expected);
  CHECK(z == expected);
}
