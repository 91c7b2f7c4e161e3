// What a step of order 2 … 20 costs, and work against accuracy beside Gauss collocation of the same order.
//
//   step/...      one step of the generating function's scheme (F = 0, fixed levels), in microseconds
//   gauss/...     one step of Gauss collocation of the same order: the stages by fixed-point iteration from the
//                 collocation polynomial of the step before, until the corrections stagnate; compensated summation
//   eccentric_... Kepler's orbits with variable levels beside Gauss collocation with equal steps, and with steps that
//                 its user adapts
//   energy_error  the largest in ten periods, relative; with the time of a step and their number it gives the curve
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <vector>

#include <Eigen/Dense>

#include <rubato/ode/generating_scheme.hpp>
#include <rubato/ode/increment.hpp>
#include <rubato/ode/integrate.hpp>
#include <rubato/problem/orbit_problem.hpp>

namespace {

using namespace rubato;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

struct System {
  Hamiltonian hamiltonian;
  std::vector<double> z;
  double period;  ///< of the fastest body
};

System system_from(const char* name, std::vector<std::string> settings, double period) {
  const rubato::Problem problem = rubato::read_problem(name, settings);
  const rubato::PhasePoint& start = problem.hamiltonian()->initial;
  std::vector<double> z = start.q;
  z.insert(z.end(), start.p.begin(), start.p.end());
  return {rubato::make_hamiltonian(problem), z, period};
}

/// Pendula in a ring, coupled by springs (Frenkel and Kontorova): as many sines as degrees of freedom, little else.
System pendulum_ring(int n) {
  const auto count = static_cast<std::size_t>(n);
  std::vector<double> z(2 * count, 0.0);
  for (std::size_t i = 0; i < count; ++i) {
    z[i] = 1.2 * std::sin(1.0 + 2.7 * static_cast<double>(i));
  }
  const Hamiltonian hamiltonian(n, [count](auto q, auto p) {
    auto energy = p[0] * p[0] / 2 - cos(q[0]) + pow(q[0] - q[count - 1], 2) / 8;
    for (std::size_t i = 1; i < count; ++i) {
      energy += p[i] * p[i] / 2 - cos(q[i]) + pow(q[i] - q[i - 1], 2) / 8;
    }
    return energy;
  });
  return {hamiltonian, z, 2 * std::numbers::pi};
}

/// A ring of groups that turn about a common axis: torsion potentials of three terms, as molecular force fields have
/// them, and an exponential repulsion of neighbours. Next to nothing but transcendental functions.
System torsion_ring(int n) {
  const auto count = static_cast<std::size_t>(n);
  std::vector<double> z(2 * count, 0.0);
  for (std::size_t i = 0; i < count; ++i) {
    z[i] = 0.8 * std::sin(1.0 + 2.7 * static_cast<double>(i));
  }
  const Hamiltonian hamiltonian(n, [count](auto q, auto p) {
    auto energy = p[0] * p[0] / 2;
    for (std::size_t i = 0; i < count; ++i) {
      const auto next = q[(i + 1) % count];
      energy += 0.4 * (1 - cos(q[i])) + 0.2 * (1 - cos(2 * q[i] + 0.3)) + 0.1 * (1 - cos(3 * q[i] - 0.2)) +
                0.1 * exp(0.5 * (q[i] - next));
      if (i > 0) {
        energy += p[i] * p[i] / 2;
      }
    }
    return energy;
  });
  return {hamiltonian, z, 2 * std::numbers::pi};
}

const System& system(Index number) {
  static const System systems[] = {system_from("kepler", {"parameters.e=0.3"}, 2 * std::numbers::pi),
                                   system_from("outer-solar-system", {}, 4332.6), pendulum_ring(16), torsion_ring(16)};
  return systems[number];
}

/// Gauss collocation with s stages, order 2s.
class Gauss {
public:
  Gauss(const Hamiltonian& hamiltonian, int stages, const std::vector<double>& z)
      : evaluator_(hamiltonian),
        s_(stages),
        z_(VectorXd(Eigen::Map<const VectorXd>(z.data(), static_cast<Index>(z.size())))),
        slopes_(MatrixXd::Zero(z_.value().size(), stages)),
        gradient_(z_.value()),
        point_(z_.value()),
        f_(z_.value()),
        increments_(slopes_),
        last_(slopes_) {
    // The nodes are the zeros of the Legendre polynomial: eigenvalues of its Jacobi matrix, polished. With the
    // interpolant expanded in Legendre polynomials, l_j = b_j Σ_l (2l+1) P_l(x_j) P_l, all coefficients are sums of
    // numbers of order 1, exact to rounding.
    MatrixXd jacobi = MatrixXd::Zero(s_, s_);
    for (int k = 1; k < s_; ++k) {
      jacobi(k, k - 1) = jacobi(k - 1, k) = k / std::sqrt(4.0 * k * k - 1.0);
    }
    const VectorXd eigenvalues = Eigen::SelfAdjointEigenSolver<MatrixXd>(jacobi).eigenvalues();
    std::vector<std::vector<long double>> p, ahead;
    a_.setZero(s_, s_);
    b_.setZero(s_);
    extrapolation_.setZero(s_, s_);
    std::vector<long double> b;
    for (const double start : eigenvalues) {
      long double x = start;
      long double slope = 0;
      for (int iteration = 0; iteration < 3; ++iteration) {
        const auto values = legendre(x);
        slope = s_ * (values[at(s_ - 1)] - x * values[at(s_)]) / (1 - x * x);
        x -= values[at(s_)] / slope;
      }
      b.push_back(1 / ((1 - x * x) * slope * slope));
      p.push_back(legendre(x));
      ahead.push_back(legendre(x + 2));
    }
    for (int j = 0; j < s_; ++j) {
      b_[j] = static_cast<double>(b[at(j)]);
      for (int i = 0; i < s_; ++i) {
        const auto& x = p[at(i)];
        long double integral = (x[1] + 1) / 2;
        long double value = 1;
        for (int l = 1; l < s_; ++l) {
          integral += p[at(j)][at(l)] * (x[at(l + 1)] - x[at(l - 1)]) / 2;
          value += (2 * l + 1) * p[at(j)][at(l)] * ahead[at(i)][at(l)];
        }
        a_(i, j) = static_cast<double>(b[at(j)] * integral);
        extrapolation_(i, j) = static_cast<double>(b[at(j)] * value);
      }
    }
    for (int i = 0; i < s_; ++i) {
      evaluate(z_.value(), i);
    }
  }

  int step(double h) {
    slopes_ = (slopes_ * extrapolation_.transpose()).eval();
    last_.setConstant(std::numeric_limits<double>::infinity());
    double previous = std::numeric_limits<double>::infinity();
    int iterations = 0;
    while (iterations < 50) {
      ++iterations;
      increments_.noalias() = h * slopes_ * a_.transpose();
      double change = 0.0;
      for (int i = 0; i < s_; ++i) {
        for (Index m = 0; m < point_.size(); ++m) {
          const double size = std::max(std::abs(increments_(m, i)), std::numeric_limits<double>::min());
          change = std::max(change, std::abs(increments_(m, i) - last_(m, i)) / size);
        }
        z_.displaced(1.0, increments_.col(i), point_);
        evaluate(point_, i);
      }
      last_ = increments_;
      if (change <= 0.5 * std::numeric_limits<double>::epsilon() || (change >= 0.5 * previous && change < 1e-10)) {
        break;
      }
      previous = change;
    }
    f_.noalias() = h * slopes_ * b_;
    z_.add(f_);
    return iterations;
  }

  [[nodiscard]] const VectorXd& state() const { return z_.value(); }

private:
  static std::size_t at(int i) { return static_cast<std::size_t>(i); }
  /// P_0(x) … P_s(x).
  [[nodiscard]] std::vector<long double> legendre(long double x) const {
    std::vector<long double> p{1, x};
    for (int l = 1; l < s_; ++l) {
      p.push_back(((2 * l + 1) * x * p[at(l)] - l * p[at(l - 1)]) / (l + 1));
    }
    return p;
  }
  void evaluate(const VectorXd& z, int stage) {
    evaluator_.gradient(z.data(), gradient_.data());
    const Index n = z.size() / 2;
    slopes_.col(stage).head(n) = gradient_.tail(n);
    slopes_.col(stage).tail(n) = -gradient_.head(n);
  }

  HamiltonianEvaluator evaluator_;
  int s_;
  CompensatedState<VectorXd> z_;
  VectorXd b_;
  MatrixXd a_, extrapolation_, slopes_;
  VectorXd gradient_, point_, f_;
  MatrixXd increments_, last_;
};

/// Steps over ten periods: the counters hold the largest relative energy error and the work that made it.
template <typename Step, typename State>
void follow(benchmark::State& state, const System& system, double h, Step step, State present) {
  HamiltonianEvaluator evaluator(system.hamiltonian);
  const double start = evaluator.value(system.z.data());
  const auto steps = static_cast<long>(10.0 * system.period / h);
  double worst = 0.0;
  for (long k = 0; k < steps; ++k) {
    step();
    worst = std::max(worst, std::abs(evaluator.value(present()) / start - 1.0));
  }
  for ([[maybe_unused]] const auto iteration : state) {
    step();
  }
  state.counters["energy_error"] = worst;
  state.counters["steps_per_period"] = system.period / h;
}

/// Arguments: system, order, steps per period.
void step(benchmark::State& state) {
  const System& s = system(state.range(0));
  const double h = s.period / static_cast<double>(state.range(2));
  const auto scheme = make_generating_scheme(
      s.hamiltonian, MatrixXd::Zero(static_cast<Index>(s.z.size()), static_cast<Index>(s.z.size())),
      static_cast<int>(state.range(1)), s.z);
  long iterations = 0;
  long steps = 0;
  bool failed = false;
  follow(
      state, s, h,
      [&] {
        failed = failed || scheme->advance(h, 0.0) != Status::success;
        if (failed) {
          return;
        }
        iterations += scheme->iterations();
        ++steps;
        scheme->accept();
      },
      [&] { return scheme->state().data(); });
  if (failed) {
    state.SkipWithError("the iteration does not converge at steps of this size");
  }
  state.counters["iterations"] = static_cast<double>(iterations) / static_cast<double>(steps);
}

void gauss(benchmark::State& state) {
  const System& s = system(state.range(0));
  const double h = s.period / static_cast<double>(state.range(2));
  Gauss method(s.hamiltonian, static_cast<int>(state.range(1)) / 2, s.z);
  long iterations = 0;
  long steps = 0;
  follow(
      state, s, h,
      [&] {
        iterations += method.step(h);
        ++steps;
      },
      [&] { return method.state().data(); });
  state.counters["iterations"] = static_cast<double>(iterations) / static_cast<double>(steps);
}

BENCHMARK(step)
    ->ArgsProduct({{0, 1, 2, 3}, {2, 4, 8, 12, 16, 20}, {5, 10, 20, 40, 80, 160}})
    ->Unit(benchmark::kMicrosecond);
BENCHMARK(gauss)
    ->ArgsProduct({{0, 1, 2, 3}, {2, 4, 8, 12, 16, 20}, {5, 10, 20, 40, 80, 160}})
    ->Unit(benchmark::kMicrosecond);

/// Kepler's orbit of that eccentricity, from its pericentre, followed for ten revolutions.
struct EccentricOrbit {
  explicit EccentricOrbit(double eccentricity)
      : e(eccentricity),
        system(system_from("kepler", {"parameters.e=" + std::to_string(e)}, 2 * std::numbers::pi)),
        evaluator(system.hamiltonian) {}

  double e;
  System system;
  HamiltonianEvaluator evaluator;
  long steps = 0;
  double worst = 0.0;

  void begin() {
    steps = 0;
    worst = 0.0;
  }
  void judge(const double* z) {
    ++steps;
    worst = std::max(worst, std::abs(evaluator.value(z) / -0.5 - 1.0));
  }
  void write(benchmark::State& state) const {
    state.counters["energy_error"] = worst;
    state.counters["steps_per_revolution"] = static_cast<double>(steps) / revolutions;
  }
  static constexpr int revolutions = 10;
};

/// Ten revolutions with variable levels: eccentricity in hundredths, order, first step in thousandths of the
/// pericentre's time scale (1 - e)^(3/2).
void eccentric_variable(benchmark::State& state) {
  EccentricOrbit orbit(0.01 * static_cast<double>(state.range(0)));
  const auto& z = orbit.system.z;
  const double step = 1e-3 * static_cast<double>(state.range(2)) * std::pow(1 - orbit.e, 1.5);
  for ([[maybe_unused]] const auto iteration : state) {
    OrbitIntegrator integrator(orbit.system.hamiltonian, {.q = {z[0], z[1]}, .p = {z[2], z[3]}},
                               {.lagrangian = Generating{.order = static_cast<int>(state.range(1))},
                                .step = step,
                                .until = EccentricOrbit::revolutions * orbit.system.period});
    orbit.begin();
    while (!integrator.finished()) {
      if (integrator.step().status != Status::success) {
        state.SkipWithError("the run did not reach its end");
        return;
      }
      orbit.judge(integrator.scheme().state().data());
    }
  }
  orbit.write(state);
}

/// The same by Gauss collocation with equal steps: eccentricity, order, steps a revolution.
void eccentric_gauss(benchmark::State& state) {
  EccentricOrbit orbit(0.01 * static_cast<double>(state.range(0)));
  for ([[maybe_unused]] const auto iteration : state) {
    Gauss method(orbit.system.hamiltonian, static_cast<int>(state.range(1)) / 2, orbit.system.z);
    orbit.begin();
    for (int k = 0; k < EccentricOrbit::revolutions * state.range(2); ++k) {
      method.step(orbit.system.period / static_cast<double>(state.range(2)));
      orbit.judge(method.state().data());
    }
  }
  orbit.write(state);
}

/// The same with steps of η r^(3/2), which the caller that knows Kepler's laws would choose: eccentricity, order, η in
/// thousandths. Neither symplectic nor reversible; the error of the energy after a thousand revolutions shows it.
void eccentric_gauss_adapted(benchmark::State& state) {
  EccentricOrbit orbit(0.01 * static_cast<double>(state.range(0)));
  const auto follow_for = [&](int revolutions) {
    Gauss method(orbit.system.hamiltonian, static_cast<int>(state.range(1)) / 2, orbit.system.z);
    orbit.begin();
    for (double t = 0.0; t < revolutions * orbit.system.period;) {
      const double h = 1e-3 * static_cast<double>(state.range(2)) * std::pow(method.state().head(2).norm(), 1.5);
      method.step(h);
      orbit.judge(method.state().data());
      t += h;
    }
  };
  for ([[maybe_unused]] const auto iteration : state) {
    follow_for(EccentricOrbit::revolutions);
  }
  orbit.write(state);
  follow_for(1000);
  state.counters["energy_error_after_1000"] = orbit.worst;
}

BENCHMARK(eccentric_variable)
    ->ArgsProduct({{60, 90, 99}, {2, 4, 6, 8}, {25, 50, 100, 200}})
    ->Unit(benchmark::kMicrosecond);
BENCHMARK(eccentric_gauss)
    ->ArgsProduct({{60, 90, 99}, {4, 8, 12, 20}, {50, 100, 200, 400, 800, 1600, 3200, 6400, 12800}})
    ->Unit(benchmark::kMicrosecond);
BENCHMARK(eccentric_gauss_adapted)
    ->ArgsProduct({{60, 90, 99}, {4, 8, 12}, {50, 100, 200}})
    ->Unit(benchmark::kMicrosecond);

}  // namespace

BENCHMARK_MAIN();
