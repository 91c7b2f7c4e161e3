// The cyclic block solver on the Newton matrix of the box scheme for sine-Gordon (d = 3) and on dense blocks of other
// sizes, with its residual check, against Eigen's SparseLU on the same systems, and against one
// streaming pass (read d fields, write d fields).
#include <benchmark/benchmark.h>
#include <omp.h>

#include <random>
#include <utility>
#include <vector>

#include <rubato/grids/field_set.hpp>
#include <rubato/solve/cyclic_block.hpp>
#include <rubato/solve/cyclic_sparse.hpp>
#include <rubato/solve/dense_solver.hpp>

namespace {

using rubato::Status;
using namespace rubato::solve;
using rubato::grids::FieldSet;

struct System {
  CyclicBidiagonal matrix;
  FieldSet values;
  FieldSet rhs;
  FieldSet solution;

  System(int d, std::size_t cells) : values(d == 3 ? 1 : 2 * d * d, cells), rhs(d, cells), solution(d, cells) {
    std::mt19937_64 engine(1);
    std::uniform_real_distribution<double> uniform(-1.0, 1.0);
    for (FieldSet* set : {&values, &rhs}) {
      for (double& v : set->all()) {
        v = uniform(engine);
      }
    }
    matrix = {d, cells, std::vector<double>(d * d), std::vector<double>(d * d), {}};
    if (d == 3) {
      sine_gordon();
      return;
    }
    for (int j = 0; j < d * d; ++j) {
      const double diagonal = j % (d + 1) == 0 ? 3.0 : 0.0;
      matrix.left[j] = j / d % 2 == 0 ? diagonal : 0.3 * diagonal;  // modes that grow and modes that decay
      matrix.right[j] = j / d % 2 == 0 ? 0.3 * diagonal : diagonal;
      matrix.entries.push_back({j / d, j % d, 1.0 / d, 0.0, values.field(2 * j).data()});
      matrix.entries.push_back({j / d, j % d, 0.0, 1.0 / d, values.field(2 * j + 1).data()});
    }
  }

  void sine_gordon() {
    const double h = 0.05;
    const double dx = 0.1;
    matrix.left = {0.0, -0.5 / h, -0.5 / dx, 0.5 / h, -0.25, 0.0, 0.5 / dx, 0.0, 0.25};
    matrix.right = {0.0, -0.5 / h, 0.5 / dx, 0.5 / h, -0.25, 0.0, -0.5 / dx, 0.0, 0.25};
    matrix.entries = {{0, 0, -0.25, -0.25, values.field(0).data()}};
  }
};

void per_cell(benchmark::State& state, std::size_t cells) {
  state.counters["ns/cell"] = benchmark::Counter(
      static_cast<double>(cells) * 1e-9, benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}

void cyclic_block(benchmark::State& state) {
  const auto d = static_cast<int>(state.range(0));
  const auto cells = static_cast<std::size_t>(state.range(1));
  const int threads = omp_get_max_threads();
  omp_set_num_threads(static_cast<int>(state.range(2)));
  System system(d, cells);
  CyclicBlockSolver solver(d, cells);
  CyclicOutcome outcome;
  for (auto _ : state) {
    outcome = solver.solve(system.matrix, std::as_const(system.rhs).pointers(), system.solution.pointers(),
                           state.range(3) != 0 ? CyclicCheck::every_solve : CyclicCheck::left_to_caller);
    if (outcome.status != Status::success) {
      state.SkipWithError("no solution");
    }
    benchmark::ClobberMemory();
  }
  per_cell(state, cells);
  state.counters["backward error"] = outcome.backward_error;
  state.counters["doubles/cell"] = solver.memory_per_cell();
  omp_set_num_threads(threads);
}

void sparse_lu(benchmark::State& state) {
  const auto d = static_cast<int>(state.range(0));
  const auto cells = static_cast<std::size_t>(state.range(1));
  System system(d, cells);
  for (auto _ : state) {
    if (solve_cyclic_by_sparse_lu(system.matrix, {}, std::as_const(system.rhs).pointers(), {},
                                  system.solution.pointers(), {}) != Status::success) {
      state.SkipWithError("no solution");
    }
  }
  per_cell(state, cells);
}

/// The unit of the comparison: read a level, write the next.
void streaming_pass(benchmark::State& state) {
  const auto d = static_cast<int>(state.range(0));
  const auto cells = static_cast<std::size_t>(state.range(1));
  const int threads = omp_get_max_threads();
  omp_set_num_threads(static_cast<int>(state.range(2)));
  FieldSet from(d, cells);
  FieldSet to(d, cells);
  for (auto _ : state) {
    to.copy_from(from);
    benchmark::ClobberMemory();
  }
  per_cell(state, cells);
  omp_set_num_threads(threads);
}

void dense(benchmark::State& state) {
  const auto n = static_cast<int>(state.range(0));
  std::mt19937_64 engine(1);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::vector<double> a(n * n);
  std::vector<double> b(n, 1.0);
  for (double& v : a) {
    v = uniform(engine);
  }
  DenseSolver solver(n);
  for (auto _ : state) {
    if (solver.factor(a.data()) != Status::success) {
      state.SkipWithError("singular");
    }
    solver.solve(b.data());
    b.assign(b.size(), 1.0);
    benchmark::ClobberMemory();
  }
}

void sizes(benchmark::internal::Benchmark* benchmark) {
  for (const int d : {2, 3, 4, 6}) {
    for (const int cells : {1'001, 10'001, 100'001, 1'000'001}) {
      benchmark->Args({d, cells, 1, 1});
    }
    benchmark->Args({d, 1'000'001, 1, 0});
    benchmark->Args({d, 1'000'001, 2, 0});
    benchmark->Args({d, 1'000'001, 2, 1});
  }
  benchmark->Args({3, 10'000'001, 1, 1});
  benchmark->ArgNames({"d", "cells", "threads", "check"})->UseRealTime()->Unit(benchmark::kMillisecond);
}

BENCHMARK(streaming_pass)
    ->Args({3, 1'000'001, 1})
    ->Args({3, 1'000'001, 2})
    ->Args({3, 10'000'001, 1})
    ->ArgNames({"d", "cells", "threads"})
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK(cyclic_block)->Apply(sizes);
BENCHMARK(sparse_lu)
    ->ArgsProduct({{2, 3, 4, 6}, {1'001, 10'001, 100'001}})
    ->ArgNames({"d", "cells"})
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK(dense)->Arg(1)->Arg(2)->Arg(3)->Arg(4)->Arg(6)->Arg(8)->Arg(12)->Arg(16)->Arg(32);

}  // namespace

BENCHMARK_MAIN();
