// Value, gradient and Hessian of Hamiltonians: formulas in machine code and interpreted, beside code written by hand
// for the same outputs; and the time that it takes to make the machine code. What both compute is compared first.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <stdexcept>
#include <string>
#include <vector>

#include <benchmark/benchmark.h>
#include <fmt/format.h>

#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/machine_code.hpp>
#include <rubato/formula/parse.hpp>

namespace {

using namespace rubato::formula;

/// H and what is asked of it: `first`, H and ∇H; `all`, H, ∇H and the upper triangle of H_zz row by row; `second`, of
/// these the entries that do not vanish identically.
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

  Bytecode first() { return outputs(false, false); }
  Bytecode second() { return outputs(true, false); }
  Bytecode all() { return outputs(true, true); }

private:
  Bytecode outputs(bool hessian, bool zeros) {
    std::vector<Expression> outputs{formula};
    std::ranges::copy(gradient(formula, variables), std::back_inserter(outputs));
    if (hessian) {
      std::ranges::copy_if(hessian_upper(formula, variables), std::back_inserter(outputs),
                           [&](Expression entry) { return zeros || !entry.is_constant(0.0); });
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

using ByHand = void (*)(const double*, double*);

/// Both compute the same, or the benchmark ends here.
void compare(const std::string& name, const Bytecode& code, ByHand function) {
  ScalarEvaluator evaluate(code);
  const std::vector<double> point = sample_point(code.input_count());
  std::vector<double> outputs(code.output_count()), by_hand(code.output_count());
  evaluate(point, outputs);
  function(point.data(), by_hand.data());
  double size = 0.0;
  for (const double output : outputs) {
    size = std::max(size, std::abs(output));
  }
  for (std::size_t j = 0; j < outputs.size(); ++j) {
    if (!(std::abs(outputs[j] - by_hand[j]) <= 1e-12 * size)) {
      throw std::logic_error(fmt::format("{}: output {} is {} by hand, not {}", name, j, by_hand[j], outputs[j]));
    }
  }
}

/// As a step evaluates: the outputs stay in the evaluator.
void run_formula(benchmark::State& state, const Bytecode& code, Engine engine) {
  ScalarEvaluator evaluate(code, engine);
  std::vector<double> point = sample_point(code.input_count());
  for (auto _ : state) {
    benchmark::DoNotOptimize(point.data());
    benchmark::DoNotOptimize(evaluate.at(point.data()));
    benchmark::ClobberMemory();
  }
  state.counters["instructions"] = static_cast<double>(code.instructions().size());
}

void run_compiler(benchmark::State& state, const Bytecode& code) {
  double bytes = 0.0;
  for (auto _ : state) {
    const auto machine_code = MachineCode::compile(code);
    bytes = machine_code ? static_cast<double>(machine_code->bytes()) : 0.0;
  }
  state.counters["bytes"] = bytes;
}

void run_by_hand(benchmark::State& state, const Bytecode& code, ByHand function) {
  std::vector<double> point = sample_point(code.input_count());
  std::vector<double> result(code.output_count());
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

[[gnu::noinline]] void pendulum_gradient_by_hand(const double* z, double* out) {
  out[0] = z[1] * z[1] * 0.5 - std::cos(z[0]);
  out[1] = std::sin(z[0]);
  out[2] = z[1];
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

[[gnu::noinline]] void kepler_gradient_by_hand(const double* z, double* out) {
  const double x = z[0], y = z[1], px = z[2], py = z[3];
  const double inverse = 1.0 / std::sqrt(x * x + y * y);
  const double w = inverse * inverse * inverse;
  out[0] = 0.5 * (px * px + py * py) - inverse;
  out[1] = x * w;
  out[2] = y * w;
  out[3] = px;
  out[4] = py;
}

// ---- Hénon–Heiles ---------------------------------------------------------------------------------------------------

Problem& henon_heiles() {
  static Problem problem("(px^2 + py^2)/2 + (x^2 + y^2)/2 + x^2*y - y^3/3", {"x", "y", "px", "py"});
  return problem;
}

[[gnu::noinline]] void henon_heiles_gradient_by_hand(const double* z, double* out) {
  const double x = z[0], y = z[1], px = z[2], py = z[3];
  out[0] = 0.5 * (px * px + py * py) + 0.5 * (x * x + y * y) + x * x * y - y * y * y / 3.0;
  out[1] = x + 2.0 * x * y;
  out[2] = y + x * x - y * y;
  out[3] = px;
  out[4] = py;
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

// ---- not separable --------------------------------------------------------------------------------------------------

Problem& non_separable() {
  static Problem problem("(q^2 + 1)*(p^2 + 1)/2", {"q", "p"});
  return problem;
}

[[gnu::noinline]] void non_separable_gradient_by_hand(const double* z, double* out) {
  const double a = z[0] * z[0] + 1.0, b = z[1] * z[1] + 1.0;
  out[0] = 0.5 * a * b;
  out[1] = z[0] * b;
  out[2] = z[1] * a;
}

[[gnu::noinline]] void non_separable_by_hand(const double* z, double* out) {
  const double a = z[0] * z[0] + 1.0, b = z[1] * z[1] + 1.0;
  out[0] = 0.5 * a * b;
  out[1] = z[0] * b;
  out[2] = z[1] * a;
  out[3] = b;
  out[4] = 2.0 * z[0] * z[1];
  out[5] = a;
}

// ---- bodies in space ------------------------------------------------------------------------------------------------

constexpr std::array<double, 6> masses{1.0, 0.7, 1.3, 0.4, 2.1, 0.9};

template <std::size_t bodies>
Problem& n_bodies() {
  static Problem problem = [] {
    const auto name = [](const char* kind, std::size_t body, std::size_t axis) {
      return fmt::format("{}{}", kind, 3 * body + axis);
    };
    std::vector<std::string> names;
    for (const char* const kind : {"q", "p"}) {
      for (std::size_t i = 0; i < 3 * bodies; ++i) {
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

/// H and ∇H; then, where H_zz has to be whole, its upper triangle, else those entries that do not vanish.
enum class Part { gradient, curvature, hessian };

template <std::size_t bodies, Part part>
[[gnu::noinline]] void n_bodies_by_hand(const double* z, double* out) {
  constexpr std::size_t coordinates = 3 * bodies, size = 2 * coordinates;
  constexpr auto upper = [](std::size_t i, std::size_t j) {
    if (part == Part::hessian) {
      return i * size - i * (i + 1) / 2 + j;
    }
    return i < coordinates ? i * coordinates - i * (i + 1) / 2 + j
                           : coordinates * (coordinates + 1) / 2 + i - coordinates;
  };
  const double* const p = z + coordinates;
  double* const g = out + 1;
  double* const h = g + size;
  std::fill(out, part == Part::gradient ? h : h + upper(size - 1, size - 1) + 1, 0.0);
  double value = 0.0;
  for (std::size_t i = 0; i < bodies; ++i) {
    const double inverse_mass = 1.0 / masses[i];
    for (std::size_t k = 3 * i; k < 3 * i + 3; ++k) {
      value += 0.5 * inverse_mass * p[k] * p[k];
      g[coordinates + k] = inverse_mass * p[k];
      if (part != Part::gradient) {
        h[upper(coordinates + k, coordinates + k)] = inverse_mass;
      }
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
        if (part != Part::gradient) {
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
  }
  out[0] = value;
}

// ---- Fermi, Pasta, Ulam and Tsingou's chain -------------------------------------------------------------------------

constexpr double alpha = 0.25;

template <std::size_t N>
Problem& chain() {
  static Problem problem = [] {
    std::vector<std::string> names;
    for (const char* const kind : {"q", "p"}) {
      for (std::size_t i = 1; i <= N; ++i) {
        names.push_back(fmt::format("{}{}", kind, i));
      }
    }
    std::string text = "(p1^2";
    for (std::size_t i = 2; i <= N; ++i) {
      text += fmt::format(" + p{}^2", i);
    }
    text += ")/2";
    for (const auto& [factor, power] : {std::pair("1/2", 2), std::pair("1/12", 3)}) {
      text += fmt::format(" + {}*(q1^{}", factor, power);
      for (std::size_t i = 1; i < N; ++i) {
        text += fmt::format(" + (q{} - q{})^{}", i + 1, i, power);
      }
      text += fmt::format(" {} q{}^{})", power == 2 ? "+" : "-", N, power);
    }
    return Problem(text, names);
  }();
  return problem;
}

template <std::size_t N, Part part>
[[gnu::noinline]] void chain_by_hand(const double* z, double* out) {
  const double* const p = z + N;
  double* const g = out + 1;
  double* h = g + 2 * N;
  double value = 0.0;
  for (std::size_t i = 0; i < N; ++i) {
    value += 0.5 * p[i] * p[i];
    g[N + i] = p[i];
    if (part == Part::curvature) {
      h[2 * N - 1 + i] = 1.0;
    }
  }
  double last_force = 0.0, last_stiffness = 0.0;
  for (std::size_t i = 0; i <= N; ++i) {
    const double d = (i < N ? z[i] : 0.0) - (i > 0 ? z[i - 1] : 0.0);
    const double force = d + alpha * d * d;
    const double stiffness = 1.0 + 2.0 * alpha * d;
    value += d * d * (0.5 + alpha / 3.0 * d);
    if (i > 0) {
      g[i - 1] = last_force - force;
      if (part == Part::curvature) {
        *h++ = last_stiffness + stiffness;
        if (i < N) {
          *h++ = -stiffness;
        }
      }
    }
    last_force = force;
    last_stiffness = stiffness;
  }
  out[0] = value;
}

// ---- what is run ----------------------------------------------------------------------------------------------------

void add(const std::string& name, const Bytecode& code, ByHand function) {
  compare(name, code, function);
  benchmark::RegisterBenchmark(("machine/" + name).c_str(), run_formula, code, Engine::automatic);
  benchmark::RegisterBenchmark(("interpreted/" + name).c_str(), run_formula, code, Engine::interpreter);
  benchmark::RegisterBenchmark(("by_hand/" + name).c_str(), run_by_hand, code, function);
  benchmark::RegisterBenchmark(("compile/" + name).c_str(), run_compiler, code);
}

}  // namespace

int main(int argc, char** argv) {
  add("pendulum_gradient", pendulum().first(), pendulum_gradient_by_hand);
  add("pendulum", pendulum().all(), pendulum_by_hand);
  add("kepler_gradient", kepler().first(), kepler_gradient_by_hand);
  add("kepler", kepler().all(), kepler_by_hand);
  add("henon_heiles_gradient", henon_heiles().first(), henon_heiles_gradient_by_hand);
  add("henon_heiles", henon_heiles().all(), henon_heiles_by_hand);
  add("non_separable_gradient", non_separable().first(), non_separable_gradient_by_hand);
  add("non_separable", non_separable().all(), non_separable_by_hand);
  add("five_bodies", n_bodies<5>().all(), n_bodies_by_hand<5, Part::hessian>);
  add("six_bodies_gradient", n_bodies<6>().first(), n_bodies_by_hand<6, Part::gradient>);
  add("six_bodies_curvature", n_bodies<6>().second(), n_bodies_by_hand<6, Part::curvature>);
  add("chain_32_gradient", chain<32>().first(), chain_by_hand<32, Part::gradient>);
  add("chain_32_curvature", chain<32>().second(), chain_by_hand<32, Part::curvature>);
  add("chain_1024_gradient", chain<1024>().first(), chain_by_hand<1024, Part::gradient>);
  add("chain_1024_curvature", chain<1024>().second(), chain_by_hand<1024, Part::curvature>);
  benchmark::Initialize(&argc, argv);
  benchmark::RunSpecifiedBenchmarks();
}
