#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/expression.hpp>
#include <rubato/formula/taylor.hpp>
#include <string>
#include <vector>

namespace {

using namespace rubato::formula;
using rubato::Status;
using Vector = std::vector<double>;
using Matrix = std::vector<Vector>;

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
void make_henon_heiles(System& s) {
  declare(s, {"x", "y", "u", "v"});
  const auto& [x, y, u, v] = std::tie(s.z[0], s.z[1], s.z[2], s.z[3]);
  s.h = (x * x + y * y + u * u + v * v) / 2 + x * x * y - y * y * y / 3;
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

Vector apply_j(const Vector& v) {
  const std::size_t n = v.size() / 2;
  Vector result(v.size());
  for (std::size_t m = 0; m < n; ++m) {
    result[m] = v[n + m];
    result[n + m] = -v[m];
  }
  return result;
}
Vector multiply(const Matrix& a, const Vector& v) {
  Vector result(v.size(), 0.0);
  for (std::size_t i = 0; i < v.size(); ++i)
    for (std::size_t j = 0; j < v.size(); ++j)
      result[i] += a[i][j] * v[j];
  return result;
}

/// φ(w,t) = Σ_j phi[j] t^j and its gradient, by theory, section 4: c(t) solves w = Ev(t;c) + JF·Od(t;c).
struct Generating {
  Vector phi;                    ///< phi[0] = 0
  std::vector<Vector> gradient;  ///< gradient[j] of phi[j]
};
Generating generating_function(const System& system, const Matrix& f, const Vector& w, int order) {
  const std::size_t dimension = w.size();
  TaylorFlowFamily family(system.field_code(), order);
  TaylorEvaluator energy(Bytecode(std::vector{system.h}, system.z, false), order);
  Generating result{Vector(static_cast<std::size_t>(order) + 1, 0.0), {Vector(dimension, 0.0)}};
  Vector c = w;
  for (int d = 0; d <= order; ++d) {
    REQUIRE(family.extend(c) == Status::success);
    for (std::size_t m = 0; m < dimension; ++m)
      energy.input(m, d)[0] = c[m];
    if (d == order)
      break;
    Vector even(dimension, 0.0);
    Vector odd(dimension, 0.0);
    for (std::size_t m = 0; m < dimension; ++m) {
      const auto part = family.part(m, d + 1);
      for (int i = 1; i <= d + 1; ++i)
        (i % 2 == 0 ? even : odd)[m] += part[static_cast<std::size_t>(d + 1 - i)] * std::pow(0.5, i);
    }
    const Vector twist = apply_j(multiply(f, odd));
    for (std::size_t m = 0; m < dimension; ++m)
      c[m] = -even[m] - twist[m];
    Vector g = apply_j(odd);
    for (double& x : g)
      x *= 2;
    result.gradient.push_back(g);
  }
  REQUIRE(energy() == Status::success);
  for (int j = 1; j <= order; ++j)
    result.phi[static_cast<std::size_t>(j)] = -energy.output(0, j - 1)[0] / j;
  return result;
}

Matrix zero_matrix(std::size_t size) {
  return Matrix(size, Vector(size, 0.0));
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
    CHECK(taylor.coefficients(0)[static_cast<std::size_t>(j)] == Approx(cosine).epsilon(20 * epsilon).margin(0));
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
  TaylorFlowFamily family(s.field_code(), 5);
  CHECK(family.extend(Vector{0, 0, 1, 1}) == Status::undefined);
  CHECK_FALSE(family.failure().empty());
  family.restart();
  CHECK(family.extend(Vector{1, 0, 1, 1}) == Status::success);
}

TEST_CASE("a family of flows is the flow from every point of its path") {
  System s;
  make_henon_heiles(s);
  constexpr int order = 16;
  const Matrix path = {{0.1, 0.2, -0.1, 0.3}, {1.0, -0.5, 0.3, 0.2}, {0.1, 0.4, -0.2, 0.7}};  // c(t), degree 2
  TaylorFlowFamily family(s.field_code(), order);
  for (int d = 0; d <= order; ++d)
    REQUIRE(family.extend(d < 3 ? path[static_cast<std::size_t>(d)] : Vector(4, 0.0)) == Status::success);
  const auto evaluate = [&](double time, double t) {
    Vector z(4, 0.0);
    for (std::size_t m = 0; m < 4; ++m)
      for (int d = order; d >= 0; --d)
        for (int i = 0; i <= d; ++i)
          z[m] += family.part(m, d)[static_cast<std::size_t>(i)] * std::pow(time, d - i) * std::pow(t, i);
    return z;
  };
  const auto start = [&](double t) {
    Vector z(4);
    for (std::size_t m = 0; m < 4; ++m)
      z[m] = path[0][m] + t * (path[1][m] + t * path[2][m]);
    return z;
  };
  // Terms of total degree 17 remain: coefficients of order 1 to 10 times 0.1^17.
  CHECK(distance(evaluate(0.06, 0.04), flow(s, start(0.04), 0.06, 30, 1)) <= 20 * epsilon);
  CHECK(distance(evaluate(-0.05, 0.05), flow(s, start(0.05), -0.05, 30, 1)) <= 20 * epsilon);
  CHECK(distance(evaluate(0.05, 0.05), flow(s, start(0.05), -0.05, 30, 1)) > 1e-3);
}

TEST_CASE("a family along an even path is the same at a quarter of the work") {
  System s;
  make_henon_heiles(s);
  constexpr int order = 11;
  const Matrix path = {
      {0.1, 0.2, -0.1, 0.3}, Vector(4, 0.0), {0.1, 0.4, -0.2, 0.7}, Vector(4, 0.0), {-0.3, 0.2, 0.5, 0.1}};
  TaylorFlowFamily family(s.field_code(), order);
  EvenTaylorFlowFamily even(s.field_code(), order);
  for (int d = 0; d <= order; ++d) {
    const Vector c = d < 5 ? path[static_cast<std::size_t>(d)] : Vector(4, 0.0);
    REQUIRE(family.extend(c) == Status::success);
    REQUIRE(even.extend(c) == Status::success);
  }
  double largest = 0.0;
  for (std::size_t m = 0; m < 4; ++m)
    for (int d = 0; d <= order; ++d)
      for (int i = 0; i <= d; ++i) {
        const double full = family.part(m, d)[static_cast<std::size_t>(i)];
        if (i % 2 == 1) {
          CHECK(full == 0.0);
        } else {
          CHECK(even.part(m, d)[static_cast<std::size_t>(i / 2)] == Approx(full).epsilon(1e-13).margin(1e-15));
          largest = i > 0 ? std::max(largest, std::abs(full)) : largest;
        }
      }
  CHECK(largest > 0.1);  // what is compared is not all 0
}

TEST_CASE("generating functions come out of a family of flows") {
  // Theory, section 4: φ¹ = -H, φ² = -¼ fᵀFf; for F = 0 even coefficients vanish and φ³ = -Γ/24 with Γ = fᵀ H_zz f.
  System s;
  make_henon_heiles(s);
  const Vector w = {0.2, -0.3, 0.4, 0.1};
  const std::vector<Expression> field = s.field();
  Vector f;
  for (const Expression& component : field)
    f.push_back(s.value(component, w));
  Expression gamma = s.graph.constant(0.0);
  const std::vector<Expression> g = gradient(s.h, s.z);
  for (std::size_t i = 0; i < 4; ++i)
    for (std::size_t j = 0; j < 4; ++j)
      gamma = gamma + field[i] * derivative(g[i], s.z[j]) * field[j];

  constexpr int order = 10;
  const Generating midpoint = generating_function(s, zero_matrix(4), w, order);
  CHECK(midpoint.phi[1] == Approx(-s.value(s.h, w)).epsilon(4 * epsilon));
  CHECK(midpoint.phi[3] == Approx(-s.value(gamma, w) / 24).epsilon(100 * epsilon));
  for (std::size_t j = 2; j <= order; j += 2)
    CHECK(std::abs(midpoint.phi[j]) <= 10 * epsilon);
  CHECK(std::abs(midpoint.phi[5]) > 1e-6);

  Matrix general = zero_matrix(4);
  for (std::size_t i = 0; i < 4; ++i)
    for (std::size_t j = 0; j < 4; ++j)
      general[i][j] = std::sin(1.0 + static_cast<double>((i + 1) * (j + 1)));
  const Generating other = generating_function(s, general, w, order);
  double quadratic = 0.0;
  for (std::size_t i = 0; i < 4; ++i)
    quadratic += f[i] * multiply(general, f)[i];
  CHECK(other.phi[2] == Approx(-quadratic / 4).epsilon(100 * epsilon));
  CHECK(std::abs(other.phi[4]) > 1e-6);

  // The gradient is that of the function, for both: central differences with step δ err by δ² times third derivatives
  // of order 10, and by ε/δ.
  const double step = 1e-4;
  for (const Matrix& darboux : {zero_matrix(4), general}) {
    const Generating here = generating_function(s, darboux, w, order);
    for (std::size_t m = 0; m < 4; ++m) {
      Vector ahead = w;
      Vector behind = w;
      ahead[m] += step;
      behind[m] -= step;
      const Vector up = generating_function(s, darboux, ahead, order).phi;
      const Vector down = generating_function(s, darboux, behind, order).phi;
      for (std::size_t j = 1; j <= order; ++j)
        CHECK((up[j] - down[j]) / (2 * step) == Approx(here.gradient[j][m]).margin(1e-6));
    }
  }
}

TEST_CASE("generating functions generate the exact flow") {
  // J(ẑ - z) = ∇φ(w, t), w = ½(ẑ + z) + ½JF(ẑ - z), summed to order 19 at t = 0.2: the rest is below (t/2)^20 times
  // coefficients of order 10.
  System s;
  make_henon_heiles(s);
  const double t = 0.2;
  const Vector z = {0.2, -0.3, 0.4, 0.1};
  const Vector next = flow(s, z, t, 30, 1);
  Vector jump(4);
  for (std::size_t m = 0; m < 4; ++m)
    jump[m] = next[m] - z[m];
  Matrix euler = zero_matrix(4);
  for (std::size_t m = 0; m < 2; ++m)
    euler[m][m + 2] = euler[m + 2][m] = 1.0;
  for (const Matrix& darboux : {zero_matrix(4), euler}) {
    const Vector twist = apply_j(multiply(darboux, jump));
    Vector w(4);
    for (std::size_t m = 0; m < 4; ++m)
      w[m] = 0.5 * (next[m] + z[m]) + 0.5 * twist[m];
    const auto defect = [&](int order) {
      const Generating g = generating_function(s, darboux, w, order);
      Vector sum(4, 0.0);
      for (std::size_t j = g.gradient.size(); j-- > 1;)
        for (std::size_t m = 0; m < 4; ++m)
          sum[m] = t * (sum[m] + g.gradient[j][m]);
      return distance(sum, apply_j(jump));
    };
    CHECK(defect(19) <= 20 * epsilon);
    CHECK(defect(3) > 1e-8);
  }
}
