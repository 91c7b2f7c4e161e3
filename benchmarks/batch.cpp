// Evaluation of formulas at many points: BatchEvaluator, with machine code and without, against ScalarEvaluator. The
// counter `per_point` is the time for one point, all outputs together. `stages` are four points, as Gauss's method of
// order 8 evaluates them.
#include <benchmark/benchmark.h>

#include <rubato/formula/batch.hpp>
#include <rubato/formula/expression.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace {

using namespace rubato::formula;

struct Formula {
  Bytecode code;
  std::vector<const double*> inputs;
  std::vector<double*> outputs;
  std::vector<std::vector<double>> storage;
};

Formula prepare(std::string_view name, std::size_t points) {
  Graph graph;
  std::vector<Expression> x;
  std::vector<Expression> f;
  if (name == "henon-heiles") {
    x = {graph.variable("q1"), graph.variable("q2"), graph.variable("p1"), graph.variable("p2")};
    const Expression h =
        (x[0] * x[0] + x[1] * x[1] + x[2] * x[2] + x[3] * x[3]) / 2 + x[0] * x[0] * x[1] - x[1] * x[1] * x[1] / 3;
    f = gradient(h, x);
  } else if (name == "sine-gordon") {
    x = {graph.variable("u"), graph.variable("v"), graph.variable("w")};
    f = gradient((x[1] * x[1] - x[2] * x[2]) / 2 + 1 - cos(x[0]), x);
  } else if (name == "kepler") {
    x = {graph.variable("x"), graph.variable("y"), graph.variable("u"), graph.variable("v")};
    const Expression h = (x[2] * x[2] + x[3] * x[3]) / 2 - 1 / sqrt(x[0] * x[0] + x[1] * x[1]);
    f = gradient(h, x);
    f.insert(f.begin(), h);
  } else if (name == "chain of 32") {
    for (int i = 0; i < 64; ++i)
      x.push_back(graph.variable("x" + std::to_string(i)));
    Expression h = graph.constant(0.0);
    for (std::size_t i = 0; i <= 32; ++i) {
      const Expression zero = graph.constant(0.0);
      const Expression d = (i < 32 ? x[i] : zero) - (i > 0 ? x[i - 1] : zero);
      h += d * d / 2 + d * d * d / 12;
      if (i < 32)
        h += x[32 + i] * x[32 + i] / 2;
    }
    f = gradient(h, x);
    f.insert(f.begin(), h);
  } else {  // one function of one variable
    x = {graph.variable("x")};
    if (name == "sin and cos")
      f = {sin(x[0]), cos(x[0])};
    else if (name == "exp")
      f = {exp(x[0])};
    else if (name == "log")
      f = {log(x[0])};
    else if (name == "tanh")
      f = {tanh(x[0])};
    else if (name == "sech")
      f = {sech(x[0])};
    else
      f = {pow(x[0], 1.7)};
  }
  Formula formula;
  formula.code = Bytecode(f, x);
  formula.storage.assign(f.size() + x.size(), std::vector<double>(points));
  for (std::size_t m = 0; m < x.size(); ++m) {
    for (std::size_t i = 0; i < points; ++i)
      formula.storage[m][i] =
          0.3 + 0.1 * static_cast<double>(m) + 2.0 * static_cast<double>(i) / static_cast<double>(points);
    formula.inputs.push_back(formula.storage[m].data());
  }
  for (std::size_t j = 0; j < f.size(); ++j)
    formula.outputs.push_back(formula.storage[x.size() + j].data());
  return formula;
}

void per_point(benchmark::State& state, std::size_t points) {
  state.counters["per_point"] = benchmark::Counter(
      static_cast<double>(points), benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}

void batch(benchmark::State& state, const char* name, std::size_t points, Engine engine) {
  Formula formula = prepare(name, points);
  BatchEvaluator evaluator(formula.code, engine);
  for ([[maybe_unused]] const auto iteration : state) {
    evaluator(points, formula.inputs, formula.outputs);
    benchmark::ClobberMemory();
  }
  state.SetLabel(std::string(simd_name()));
  per_point(state, points);
}

void scalar(benchmark::State& state, const char* name) {
  constexpr std::size_t points = 4096;
  Formula formula = prepare(name, points);
  ScalarEvaluator evaluator(formula.code);
  for ([[maybe_unused]] const auto iteration : state) {
    for (std::size_t i = 0; i < points; ++i) {
      for (std::size_t m = 0; m < formula.inputs.size(); ++m)
        evaluator.inputs()[m] = formula.inputs[m][i];
      evaluator.run();
      for (std::size_t j = 0; j < formula.outputs.size(); ++j)
        formula.outputs[j][i] = evaluator.output(j);
    }
    benchmark::ClobberMemory();
  }
  per_point(state, points);
}

constexpr const char* names[] = {"henon-heiles", "kepler", "chain of 32", "sine-gordon", "sin and cos",
                                 "exp",          "log",    "tanh",        "sech",        "power"};

const int registered = [] {
  for (const char* name : names) {
    for (const std::size_t points : {4, 256, 4096}) {
      const std::string which = (points == 4 ? "stages/" : "batch/") + std::string(name) + "/" + std::to_string(points);
      benchmark::RegisterBenchmark(("machine/" + which).c_str(), batch, name, points, Engine::automatic);
      benchmark::RegisterBenchmark(("interpreted/" + which).c_str(), batch, name, points, Engine::interpreter);
    }
    benchmark::RegisterBenchmark((std::string("scalar/") + name).c_str(), scalar, name);
  }
  return 0;
}();

}  // namespace

BENCHMARK_MAIN();
