// Value, gradient and Hessian of Hamiltonians: compiled formulas beside code written by hand for the same outputs.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

#include <benchmark/benchmark.h>
#include <fmt/format.h>

#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/parse.hpp>

namespace {

using namespace rubato::formula;

/// Outputs in the order value, gradient, upper triangle of the Hessian row by row.
struct Problem {
  Graph graph;
  std::vector<Expression> variables;
  Expression formula;

  Problem(const std::string& text, const std::vector<std::string>& names) {
    for (const std::string& name : names) {
      variables.push_back(graph.variable(name));
    }
    formula = parse(text, graph, names);
  }

  Bytecode first() {
    std::vector<Expression> outputs = gradient(formula, variables);
    return Bytecode(outputs, variables);
  }

  Bytecode all() {
    std::vector<Expression> outputs{formula};
    for (const auto& part : {gradient(formula, variables), hessian_upper(formula, variables)}) {
      outputs.insert(outputs.end(), part.begin(), part.end());
    }
    return Bytecode(outputs, variables);
  }
};

std::vector<double> sample_point(std::size_t size) {
  std::vector<double> point(size);
  for (std::size_t i = 0; i < size; ++i) {
    point[i] = std::sin(1.0 + 7.3 * static_cast<double>(i * i)) + 0.1 * static_cast<double>(i);
  }
  return point;
}

void run_compiled(benchmark::State& state, const Bytecode& code) {
  ScalarEvaluator evaluate(code);
  std::vector<double> point = sample_point(code.input_count());
  std::vector<double> outputs(code.output_count());
  for (auto _ : state) {
    benchmark::DoNotOptimize(point.data());
    evaluate(point, outputs);
    benchmark::DoNotOptimize(outputs.data());
    benchmark::ClobberMemory();
  }
  state.counters["instructions"] = static_cast<double>(code.instructions().size());
}

void run_by_hand(benchmark::State& state, std::size_t inputs, std::size_t outputs,
                 void (*function)(const double*, double*)) {
  std::vector<double> point = sample_point(inputs);
  std::vector<double> result(outputs);
  for (auto _ : state) {
    benchmark::DoNotOptimize(point.data());
    function(point.data(), result.data());
    benchmark::DoNotOptimize(result.data());
    benchmark::ClobberMemory();
  }
}

// ---- pendulum -------------------------------------------------------------------------------------------------------

Problem& pendulum() {
  static Problem problem("p^2/2 - cos(q)", {"q", "p"});
  return problem;
}

[[gnu::noinline]] void pendulum_by_hand(const double* z, double* out) {
  const double s = std::sin(z[0]);
  const double c = std::cos(z[0]);
  out[0] = z[1] * z[1] * 0.5 - c;
  out[1] = s;
  out[2] = z[1];
  out[3] = c;
  out[4] = 0.0;
  out[5] = 1.0;
}

// ---- Kepler ---------------------------------------------------------------------------------------------------------

Problem& kepler() {
  static Problem problem("(px^2 + py^2)/2 - 1/sqrt(x^2 + y^2)", {"x", "y", "px", "py"});
  return problem;
}

[[gnu::noinline]] void kepler_by_hand(const double* z, double* out) {
  const double x = z[0], y = z[1], px = z[2], py = z[3];
  const double inverse = 1.0 / std::sqrt(x * x + y * y);
  const double inverse2 = inverse * inverse;
  const double w = inverse * inverse2;
  const double w3 = 3.0 * w * inverse2;
  out[0] = 0.5 * (px * px + py * py) - inverse;
  out[1] = x * w;
  out[2] = y * w;
  out[3] = px;
  out[4] = py;
  out[5] = w - w3 * x * x;
  out[6] = -w3 * x * y;
  out[7] = 0.0;
  out[8] = 0.0;
  out[9] = w - w3 * y * y;
  out[10] = 0.0;
  out[11] = 0.0;
  out[12] = 1.0;
  out[13] = 0.0;
  out[14] = 1.0;
}

// ---- Hénon–Heiles ---------------------------------------------------------------------------------------------------

Problem& henon_heiles() {
  static Problem problem("(px^2 + py^2)/2 + (x^2 + y^2)/2 + x^2*y - y^3/3", {"x", "y", "px", "py"});
  return problem;
}

[[gnu::noinline]] void henon_heiles_gradient_by_hand(const double* z, double* out) {
  const double x = z[0], y = z[1];
  out[0] = x + 2.0 * x * y;
  out[1] = y + x * x - y * y;
  out[2] = z[2];
  out[3] = z[3];
}

[[gnu::noinline]] void henon_heiles_by_hand(const double* z, double* out) {
  const double x = z[0], y = z[1], px = z[2], py = z[3];
  out[0] = 0.5 * (px * px + py * py) + 0.5 * (x * x + y * y) + x * x * y - y * y * y / 3.0;
  out[1] = x + 2.0 * x * y;
  out[2] = y + x * x - y * y;
  out[3] = px;
  out[4] = py;
  out[5] = 1.0 + 2.0 * y;
  out[6] = 2.0 * x;
  out[7] = 0.0;
  out[8] = 0.0;
  out[9] = 1.0 - 2.0 * y;
  out[10] = 0.0;
  out[11] = 0.0;
  out[12] = 1.0;
  out[13] = 0.0;
  out[14] = 1.0;
}

// ---- five bodies in space -------------------------------------------------------------------------------------------

constexpr std::size_t bodies = 5;
constexpr std::size_t coordinates = 3 * bodies;
constexpr std::size_t phase_space = 2 * coordinates;
constexpr std::array<double, bodies> masses{1.0, 0.7, 1.3, 0.4, 2.1};

Problem& five_bodies() {
  static Problem problem = [] {
    const auto name = [](const char* kind, std::size_t body, std::size_t axis) {
      return fmt::format("{}{}", kind, 3 * body + axis);
    };
    std::vector<std::string> names;
    for (const char* const kind : {"q", "p"}) {
      for (std::size_t i = 0; i < coordinates; ++i) {
        names.push_back(fmt::format("{}{}", kind, i));
      }
    }
    std::string text = "0";
    for (std::size_t i = 0; i < bodies; ++i) {
      text +=
          fmt::format(" + ({}^2 + {}^2 + {}^2)/{}", name("p", i, 0), name("p", i, 1), name("p", i, 2), 2.0 * masses[i]);
      for (std::size_t j = 0; j < i; ++j) {
        text +=
            fmt::format(" - {}/sqrt(({} - {})^2 + ({} - {})^2 + ({} - {})^2)", masses[i] * masses[j], name("q", i, 0),
                        name("q", j, 0), name("q", i, 1), name("q", j, 1), name("q", i, 2), name("q", j, 2));
      }
    }
    return Problem(text, names);
  }();
  return problem;
}

constexpr std::size_t upper(std::size_t i, std::size_t j) {
  return i * phase_space - i * (i + 1) / 2 + j;
}

[[gnu::noinline]] void five_bodies_by_hand(const double* z, double* out) {
  const double* const p = z + coordinates;
  double* const g = out + 1;
  double* const h = out + 1 + phase_space;
  std::fill(out, h + phase_space * (phase_space + 1) / 2, 0.0);
  double value = 0.0;
  for (std::size_t i = 0; i < bodies; ++i) {
    const double inverse_mass = 1.0 / masses[i];
    for (std::size_t k = 3 * i; k < 3 * i + 3; ++k) {
      value += 0.5 * inverse_mass * p[k] * p[k];
      g[coordinates + k] = inverse_mass * p[k];
      h[upper(coordinates + k, coordinates + k)] = inverse_mass;
    }
  }
  for (std::size_t i = 0; i < bodies; ++i) {
    for (std::size_t j = i + 1; j < bodies; ++j) {
      const double d[3] = {z[3 * j] - z[3 * i], z[3 * j + 1] - z[3 * i + 1], z[3 * j + 2] - z[3 * i + 2]};
      const double inverse = 1.0 / std::sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
      const double inverse2 = inverse * inverse;
      const double potential = masses[i] * masses[j] * inverse;
      const double w = potential * inverse2;
      const double w3 = 3.0 * w * inverse2;
      value -= potential;
      for (std::size_t a = 0; a < 3; ++a) {
        g[3 * i + a] -= w * d[a];
        g[3 * j + a] += w * d[a];
        const double scaled = w3 * d[a];
        for (std::size_t b = a; b < 3; ++b) {
          const double block = (a == b ? w : 0.0) - scaled * d[b];
          h[upper(3 * i + a, 3 * i + b)] += block;
          h[upper(3 * j + a, 3 * j + b)] += block;
          h[upper(3 * i + a, 3 * j + b)] = -block;
          h[upper(3 * i + b, 3 * j + a)] = -block;
        }
      }
    }
  }
  out[0] = value;
}

// NOLINTBEGIN: registration
BENCHMARK_CAPTURE(run_compiled, henon_heiles_gradient, henon_heiles().first());
BENCHMARK_CAPTURE(run_by_hand, henon_heiles_gradient, 4, 4, &henon_heiles_gradient_by_hand);
BENCHMARK_CAPTURE(run_compiled, pendulum, pendulum().all());
BENCHMARK_CAPTURE(run_by_hand, pendulum, 2, 6, &pendulum_by_hand);
BENCHMARK_CAPTURE(run_compiled, kepler, kepler().all());
BENCHMARK_CAPTURE(run_by_hand, kepler, 4, 15, &kepler_by_hand);
BENCHMARK_CAPTURE(run_compiled, henon_heiles, henon_heiles().all());
BENCHMARK_CAPTURE(run_by_hand, henon_heiles, 4, 15, &henon_heiles_by_hand);
BENCHMARK_CAPTURE(run_compiled, five_bodies, five_bodies().all());
BENCHMARK_CAPTURE(run_by_hand, five_bodies, 30, 496, &five_bodies_by_hand);
// NOLINTEND

}  // namespace

BENCHMARK_MAIN();
