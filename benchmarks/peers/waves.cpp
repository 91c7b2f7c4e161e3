// Work against accuracy on lattices: Rubato's schemes of high order beside pseudospectral codes written by hand for one
// equation each, with FFTW at its best settings. Peers have no laws and no records, so that ours run without them
// first, then with their local laws at every level, then with variable levels. One thread.
//
//     build/benchmarks/benchmark_waves [repeats]
//
// For each of the errors asked for, the cheapest run of each method that reaches it: CPU time, median of the repeats,
// which are taken in turn so that all see the same machine.
#include <fftw3.h>
#include <omp.h>
#include <time.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include <rubato/formula/batch.hpp>
#include <rubato/pde/lattice.hpp>
#include <rubato/variation/composition.hpp>

namespace {

using namespace rubato;
using Complex = std::complex<double>;
using Values = std::vector<double>;

double cpu_seconds() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

/// A real transform of one length, planned by measurement.
class Transform {
public:
  explicit Transform(std::size_t n) : n_(n), real_(fftw_alloc_real(n)), modes_(fftw_alloc_complex(n / 2 + 1)) {
    forward_ = fftw_plan_dft_r2c_1d(static_cast<int>(n), real_, modes_, FFTW_PATIENT);
    inverse_ = fftw_plan_dft_c2r_1d(static_cast<int>(n), modes_, real_, FFTW_PATIENT);
  }
  Transform(const Transform&) = delete;
  Transform& operator=(const Transform&) = delete;
  ~Transform() {
    fftw_destroy_plan(forward_);
    fftw_destroy_plan(inverse_);
    fftw_free(real_);
    fftw_free(modes_);
  }
  [[nodiscard]] std::size_t modes() const { return n_ / 2 + 1; }
  [[nodiscard]] double* real() { return real_; }
  void forward(Complex* out) {
    fftw_execute(forward_);
    const auto* from = reinterpret_cast<const Complex*>(modes_);
    std::copy(from, from + modes(), out);
  }
  /// Into real(), with the factor 1/n.
  void inverse(const Complex* in) {
    auto* to = reinterpret_cast<Complex*>(modes_);
    for (std::size_t k = 0; k < modes(); ++k) {
      to[k] = in[k] / static_cast<double>(n_);
    }
    fftw_execute(inverse_);
  }

private:
  std::size_t n_;
  double* real_;
  fftw_complex* modes_;
  fftw_plan forward_, inverse_;
};

struct Run {
  Values u;
  double seconds = 0.0;
};
/// A method: a run with so many steps.
struct Method {
  std::string name;
  std::vector<int> steps;
  std::function<Run(int)> run;
};

struct Equation {
  std::string name;
  MultisymplecticSystem system;
  grids::Grid grid;
  InitialFields initial;
  double until;
  int field;  ///< that is compared
  std::vector<Method> methods;
  Values reference;
};

Eigen::MatrixXd skew(int size, std::initializer_list<std::tuple<int, int, double>> entries) {
  Eigen::MatrixXd matrix = Eigen::MatrixXd::Zero(size, size);
  for (const auto& [row, column, value] : entries) {
    matrix(row, column) = value;
    matrix(column, row) = -value;
  }
  return matrix;
}

Values sampled(const grids::Grid& grid, const std::function<double(double)>& f) {
  Values values(grid.size());
  for (std::size_t i = 0; i < values.size(); ++i) {
    values[i] = f(grid.axis(0).node(i));
  }
  return values;
}

enum class Laws { none, all };

Method ours(const Equation& equation, LatticeOptions options, std::vector<int> steps, Laws laws = Laws::none) {
  std::string name =
      options.lagrangian == "splitting" ? options.composition : "gauss " + std::to_string(options.stages);
  name = "rubato " + name + (options.levels == Levels::variable ? ", levels" : laws == Laws::all ? ", laws" : "");
  return {name, std::move(steps), [&equation, options, laws](int count) {
            LatticeOptions own = options;
            own.until = equation.until;
            own.step = equation.until / count;
            LatticeIntegrator lattice(equation.system, equation.grid, equation.initial, own);
            const double start = cpu_seconds();
            while (!lattice.finished()) {
              if (lattice.step().status != Status::success) {
                return Run{};
              }
              if (laws == Laws::all) {
                static_cast<void>(lattice.residuals());
              }
            }
            // Errors are those of the last level, wherever variable levels put it: told for equal ones only.
            const auto u = lattice.field(equation.field);
            return Run{{u.begin(), u.end()}, cpu_seconds() - start};
          }};
}

// ---- u_tt = u_xx - sin u: the waves of u_tt = u_xx - u exactly, kicks by u - sin u
// ------------------------------------

Method kick_and_waves(const Equation& equation, const char* name, std::vector<int> steps) {
  return {std::string("peer ") + name, std::move(steps), [&equation, name](int count) {
            const std::size_t n = equation.grid.size();
            Transform transform(n);
            const std::size_t modes = transform.modes();
            std::vector<Complex> u(modes), v(modes), g(modes);
            formula::Graph graph;
            const formula::Expression z = graph.variable("u");
            const formula::Expression formula = z - sin(z);
            formula::BatchEvaluator rest(formula::Bytecode(std::span(&formula, 1), std::span(&z, 1)));
            Values kicked(n);
            std::ranges::copy(*equation.initial[0], transform.real());
            transform.forward(u.data());
            std::ranges::copy(*equation.initial[1], transform.real());
            transform.forward(v.data());
            const double h = equation.until / count, length = equation.grid.axis(0).to - equation.grid.axis(0).from;
            const Composition& parts = composition(name);
            std::vector<std::vector<double>> cosine, sine, omega_sine;
            for (const Composition::Part& part : parts.parts) {
              auto& c = cosine.emplace_back(modes);
              auto& s = sine.emplace_back(modes);
              auto& o = omega_sine.emplace_back(modes);
              for (std::size_t k = 0; k < modes; ++k) {
                const double omega = std::sqrt(1 + std::pow(2 * std::numbers::pi * static_cast<double>(k) / length, 2));
                c[k] = std::cos(omega * part.length * h);
                s[k] = std::sin(omega * part.length * h) / omega;
                o[k] = -std::sin(omega * part.length * h) * omega;
              }
            }
            const double start = cpu_seconds();
            for (int step = 0; step < count; ++step) {
              for (std::size_t p = 0; p < parts.parts.size(); ++p) {
                if (parts.parts[p].drift) {
                  for (std::size_t k = 0; k < modes; ++k) {
                    const Complex old = u[k];
                    u[k] = cosine[p][k] * old + sine[p][k] * v[k];
                    v[k] = omega_sine[p][k] * old + cosine[p][k] * v[k];
                  }
                } else {
                  transform.inverse(u.data());
                  double* x = transform.real();
                  const double* const in[] = {x};
                  double* const out[] = {kicked.data()};
                  rest(n, in, out);  // vectorised
                  std::ranges::copy(kicked, x);
                  transform.forward(g.data());
                  for (std::size_t k = 0; k < modes; ++k) {
                    v[k] += parts.parts[p].length * h * g[k];
                  }
                }
              }
            }
            transform.inverse(u.data());
            const double seconds = cpu_seconds() - start;
            return Run{{transform.real(), transform.real() + n}, seconds};
          }};
}

// ---- u_t + 6 u u_x + u_xxx = 0 with an integrating factor and the classical Runge-Kutta method
// ------------------------

Method integrating_factor(const Equation& equation, std::vector<int> steps) {
  return {"peer IFRK4", std::move(steps), [&equation](int count) {
            const std::size_t n = equation.grid.size();
            Transform transform(n);
            const std::size_t modes = transform.modes();
            std::vector<Complex> u(modes), a(modes), b(modes), c(modes), d(modes), stage(modes), half(modes),
                full(modes);
            std::vector<double> derivative(modes);
            const double h = equation.until / count, length = equation.grid.axis(0).to - equation.grid.axis(0).from;
            for (std::size_t k = 0; k < modes; ++k) {
              const double kappa = 2 * std::numbers::pi * static_cast<double>(k) / length;
              half[k] = std::polar(1.0, kappa * kappa * kappa * h / 2);
              full[k] = half[k] * half[k];
              derivative[k] = 2 * k == n ? 0.0 : -3 * kappa * h;
            }
            std::ranges::copy(*equation.initial[1], transform.real());
            transform.forward(u.data());
            const auto rest = [&](const std::vector<Complex>& at, std::vector<Complex>& out) {
              transform.inverse(at.data());
              double* x = transform.real();
              for (std::size_t i = 0; i < n; ++i) {
                x[i] *= x[i];
              }
              transform.forward(out.data());
              for (std::size_t k = 0; k < modes; ++k) {
                out[k] = {-derivative[k] * out[k].imag(), derivative[k] * out[k].real()};
              }
            };
            const double start = cpu_seconds();
            for (int step = 0; step < count; ++step) {
              rest(u, a);
              for (std::size_t k = 0; k < modes; ++k) {
                stage[k] = half[k] * (u[k] + 0.5 * a[k]);
              }
              rest(stage, b);
              for (std::size_t k = 0; k < modes; ++k) {
                stage[k] = half[k] * u[k] + 0.5 * b[k];
              }
              rest(stage, c);
              for (std::size_t k = 0; k < modes; ++k) {
                stage[k] = full[k] * u[k] + half[k] * c[k];
              }
              rest(stage, d);
              for (std::size_t k = 0; k < modes; ++k) {
                u[k] = full[k] * (u[k] + a[k] / 6.0) + half[k] * (b[k] + c[k]) / 3.0 + d[k] / 6.0;
              }
            }
            transform.inverse(u.data());
            const double seconds = cpu_seconds() - start;
            return Run{{transform.real(), transform.real() + n}, seconds};
          }};
}

double error_of(const Values& u, const Values& reference) {
  double error = u.size() == reference.size() ? 0.0 : std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < u.size() && i < reference.size(); ++i) {
    error = std::max(error, std::abs(u[i] - reference[i]));
  }
  return std::isnan(error) ? std::numeric_limits<double>::infinity() : error;
}

void report(Equation& equation, int repeats) {
  struct Point {
    double error, seconds;
  };
  std::vector<std::vector<Point>> points(equation.methods.size());
  std::vector<std::vector<Values>> times(equation.methods.size());
  for (int repeat = 0; repeat < repeats; ++repeat) {
    for (std::size_t m = 0; m < equation.methods.size(); ++m) {
      const Method& method = equation.methods[m];
      points[m].resize(method.steps.size());
      times[m].resize(method.steps.size());
      for (std::size_t s = 0; s < method.steps.size(); ++s) {
        const Run run = method.run(method.steps[s]);
        points[m][s].error = error_of(run.u, equation.reference);
        times[m][s].push_back(run.seconds);
      }
    }
  }
  std::printf("\n%s, t = %g, %zu nodes: milliseconds for an error of\n%-32s", equation.name.c_str(), equation.until,
              equation.grid.size(), "");
  const double targets[] = {1e-2, 1e-4, 1e-6, 1e-9};
  for (const double target : targets) {
    std::printf("%12.0e", target);
  }
  std::printf("\n");
  for (std::size_t m = 0; m < equation.methods.size(); ++m) {
    std::printf("%-32s", equation.methods[m].name.c_str());
    for (const double target : targets) {
      double best = std::numeric_limits<double>::infinity();
      for (std::size_t s = 0; s < points[m].size(); ++s) {
        std::ranges::sort(times[m][s]);
        if (points[m][s].error <= target) {
          best = std::min(best, times[m][s][times[m][s].size() / 2]);
        }
      }
      std::isfinite(best) ? std::printf("%12.3f", 1e3 * best) : std::printf("%12s", "-");
    }
    std::printf("\n");
  }
}

std::vector<int> doubling(int from, int count) {
  std::vector<int> steps;
  double value = from;
  for (int i = 0; i < count; ++i, value *= std::numbers::sqrt2) {
    steps.push_back(static_cast<int>(std::lround(value)));
  }
  return steps;
}

void sine_gordon(int repeats) {
  const grids::Grid grid({{"x", -20, 20, 160}});
  const double gamma = std::sqrt(0.75);
  Equation equation{"sine-Gordon breather",
                    MultisymplecticSystem({"u", "v", "w"}, skew(3, {{0, 1, -1}}), {skew(3, {{0, 2, 1}})},
                                          "(v^2 - w^2)/2 + 1 - cos(u)"),
                    grid,
                    {Values(grid.size(), 0.0),
                     sampled(grid, [=](double x) { return 4 * gamma / std::cosh(gamma * x); }), std::nullopt},
                    12.0,
                    0,
                    {},
                    {}};
  equation.reference = kick_and_waves(equation, "kahan-li-8", {}).run(4000).u;
  for (const char* name : {"verlet", "blanes-moan-4", "kahan-li-6", "kahan-li-8"}) {
    const int first = std::string(name) == "verlet" ? 100 : 20;
    equation.methods.push_back(
        kick_and_waves(equation, name, doubling(first, std::string(name) == "verlet" ? 18 : 12)));
  }
  for (const char* name : {"blanes-moan-4", "kahan-li-6", "kahan-li-8"}) {
    equation.methods.push_back(
        ours(equation, {.lagrangian = "splitting", .composition = name, .levels = Levels::fixed}, doubling(20, 12)));
  }
  for (const int stages : {3, 4, 6}) {
    equation.methods.push_back(
        ours(equation, {.lagrangian = "fourier", .stages = stages, .levels = Levels::fixed}, doubling(10, 10)));
  }
  equation.methods.push_back(ours(equation,
                                  {.lagrangian = "splitting", .composition = "kahan-li-8", .levels = Levels::fixed},
                                  doubling(20, 12), Laws::all));
  report(equation, repeats);
}

void korteweg_de_vries(int repeats) {
  const grids::Grid grid({{"x", -15, 15, 192}});
  Equation equation{
      "KdV soliton",
      MultisymplecticSystem({"phi", "u", "v", "w"}, skew(4, {{0, 1, 0.5}}), {skew(4, {{0, 3, 1}, {1, 2, -1}})},
                            "v^2/2 - u*w + u^3"),
      grid,
      {std::nullopt, sampled(grid, [](double x) { return 2 / std::pow(std::cosh(x), 2); }), std::nullopt, std::nullopt},
      10.0,
      1,
      {},
      {}};
  equation.reference = integrating_factor(equation, {}).run(200000).u;
  equation.methods.push_back(integrating_factor(equation, doubling(2000, 14)));
  for (const int stages : {3, 4, 5, 6}) {
    equation.methods.push_back(
        ours(equation, {.lagrangian = "fourier", .stages = stages, .levels = Levels::fixed}, doubling(100, 9)));
  }
  equation.methods.push_back(
      ours(equation, {.lagrangian = "fourier", .stages = 5, .levels = Levels::fixed}, doubling(100, 9), Laws::all));
  report(equation, repeats);
}

}  // namespace

int main(int argc, char** argv) {
  omp_set_num_threads(1);
  const int repeats = argc > 1 ? std::max(1, std::atoi(argv[1])) : 3;
  sine_gordon(repeats);
  korteweg_de_vries(repeats);
}
