// One level of sine-Gordon by box, in one and two dimensions, per cell: beside one streaming pass (read z_k, write
// z_{k+1}), beside the same Newton iteration with Eigen's SparseLU, and with KLU where that is there, and beside a code
// that has PETSc's SNES solve the same step.
#include <benchmark/benchmark.h>
#include <omp.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#if RUBATO_HAS_KLU
#include <klu.h>

#include <Eigen/SparseCore>
#endif
#if RUBATO_HAS_PETSC
#include "peers/snes.hpp"
#endif

#include <rubato/grids/field_set.hpp>
#include <rubato/pde/cell_solver.hpp>
#include <rubato/pde/cell_sweep.hpp>
#include <rubato/pde/lattice_scheme.hpp>
#include <rubato/solve/cyclic_sparse.hpp>
#include <rubato/variation/time_levels.hpp>

namespace {

using namespace rubato;

constexpr double step = 0.05;
constexpr double period = 40.0;

MultisymplecticSystem sine_gordon(int dimensions) {
  const int d = 2 + dimensions;
  Eigen::MatrixXd M = Eigen::MatrixXd::Zero(d, d);
  M(0, 1) = -1;
  M(1, 0) = 1;
  std::vector<Eigen::MatrixXd> K;
  for (int a = 0; a < dimensions; ++a) {
    Eigen::MatrixXd matrix = Eigen::MatrixXd::Zero(d, d);
    matrix(0, 2 + a) = 1;
    matrix(2 + a, 0) = -1;
    K.push_back(matrix);
  }
  return dimensions == 1 ? MultisymplecticSystem({"u", "v", "w"}, M, K, "(v^2 - w^2)/2 + 1 - cos(u)")
                         : MultisymplecticSystem({"u", "v", "a", "b"}, M, K, "(v^2 - a^2 - b^2)/2 + 1 - cos(u)");
}

grids::Grid make_grid(int dimensions, std::size_t cells) {
  std::vector<grids::Axis> axes{{"x", -period / 2, period / 2, cells}};
  if (dimensions == 2) {
    axes.push_back({"y", -period / 2, period / 2, cells});
  }
  return grids::Grid(axes);
}

/// The breather's data in one dimension, a round bump in two.
LatticeLevel first_level(const MultisymplecticSystem& system, const grids::Grid& grid) {
  std::vector<double> u(grid.size(), 0.0);
  std::vector<double> v(grid.size());
  const double width = std::sqrt(0.75);
  for (std::size_t i = 0; i < v.size(); ++i) {
    const double x = grid.axis(0).node(i % grid.cells(0));
    const double y = grid.dimensions() == 2 ? grid.axis(1).node(i / grid.cells(0)) : 0.0;
    v[i] = 4 * width / std::cosh(width * std::hypot(x, y));
  }
  InitialFields initial{u, v};
  initial.resize(system.fields().size());
  return initial_level(system, grid, initial);
}

void count_cells(benchmark::State& state, std::size_t cells) {
  state.counters["ns/cell"] = benchmark::Counter(
      1e-9 * static_cast<double>(cells), benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}

constexpr int warm_ups = 5;  ///< until the predictors have their history

/// range(0): cells along an axis; range(1): threads.
template <int dimensions, Levels kind>
void one_level(benchmark::State& state) {
  omp_set_num_threads(static_cast<int>(state.range(1)));
  const auto system = sine_gordon(dimensions);
  const auto grid = make_grid(dimensions, static_cast<std::size_t>(state.range(0)));
  const auto scheme = make_box_scheme(system, grid, first_level(system, grid), step);
  TimeLevels levels(*scheme, {.levels = kind, .on_singular = OnSingular::stop, .tolerance = 1e-12}, 0.0, step);
  for (int warm_up = 0; warm_up < warm_ups; ++warm_up) {
    if (levels.step().status != Status::success) {
      state.SkipWithError("the step failed");
      return;
    }
  }
  for (auto _ : state) {
    if (levels.step().status != Status::success) {
      state.SkipWithError("the step failed");
      return;
    }
  }
  count_cells(state, grid.size());
}

/// z_{k+1} = z_k + 1 for three fields, nothing else.
void streaming_pass(benchmark::State& state) {
  omp_set_num_threads(static_cast<int>(state.range(1)));
  const auto cells = static_cast<std::size_t>(state.range(0));
  const grids::FieldSet from(3, cells);
  grids::FieldSet to(3, cells);
  for (auto _ : state) {
    for (int f = 0; f < 3; ++f) {
      const double* in = from.field(f).data();
      double* out = to.field(f).data();
      grids::for_each_block(cells, 4096, [=](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
          out[i] = in[i] + 1.0;
        }
      });
    }
    benchmark::DoNotOptimize(to.field(0).data());
    benchmark::ClobberMemory();
  }
  count_cells(state, cells);
}

/// How many Newton iterations, a sweep and a solve each, the scheme makes for a level, on average over ten.
int iterations_of_a_level(const MultisymplecticSystem& system, const grids::Grid& grid) {
  constexpr int steps = 10;
  const auto scheme = make_box_scheme(system, grid, first_level(system, grid), step);
  TimeLevels levels(*scheme, {.on_singular = OnSingular::stop, .tolerance = 1e-12}, 0.0, step);
  int iterations = 0;
  for (int k = 0; k < warm_ups + steps; ++k) {
    const StepReport report = levels.step();
    iterations += k < warm_ups ? 0 : report.iterations;
  }
  return (iterations + steps / 2) / steps;
}

/// What the Newton iterations of a level on a line solve.
struct Equations {
  explicit Equations(std::size_t cells) : grid(make_grid(1, cells)) {
    const double difference = 1.0 / grid.spacing(0);
    for (const double sign : {-1.0, 1.0}) {
      const Eigen::MatrixXd block =
          system.M() / step + sign * difference * system.K(0) - 0.5 * system.constant_hessian();
      auto& side = sign < 0 ? matrix.left : matrix.right;
      for (int i = 0; i < 9; ++i) {
        side.push_back(block(i / 3, i % 3));
      }
    }
    matrix.entries = {{0, 0, -0.5, -0.5, hessian.field(0).data()}};
  }
  void evaluate() {
    benchmark::DoNotOptimize(sweep(level.fields.pointers(), level.slopes, level.fields.pointers(), 1.0 / step,
                                   residual.pointers(), hessian.pointers()));
  }

  /// The largest of what solution(cell, field) leaves of the equations, beside their right side.
  template <typename Solution>
  [[nodiscard]] double left_by(const Solution& solution) const {
    double left = 0.0, scale = 0.0;
    for (std::size_t i = 0; i < grid.size(); ++i) {
      const std::size_t next = i + 1 == grid.size() ? 0 : i + 1;
      for (std::size_t r = 0; r < 3; ++r) {
        const double right = residual.field(static_cast<int>(r))[i];
        double sum = -right;
        for (std::size_t c = 0; c < 3; ++c) {
          const double varying = r == 0 && c == 0 ? -0.5 * hessian.field(0)[i] : 0.0;
          sum += (matrix.left[3 * r + c] + varying) * solution(i, c) +
                 (matrix.right[3 * r + c] + varying) * solution(next, c);
        }
        left = std::max(left, std::abs(sum));
        scale = std::max(scale, std::abs(right));
      }
    }
    return left / scale;
  }

  MultisymplecticSystem system = sine_gordon(1);
  grids::Grid grid;
  LatticeLevel level = first_level(system, grid);
  CellSweep sweep{system, grid};
  grids::FieldSet residual{3, grid.size()}, hessian{1, grid.size()};
  solve::CyclicBidiagonal matrix{3, grid.size(), {}, {}, {}};
};

/// The Newton iterations of a level, as many as the scheme makes, with a solver for matrices of any pattern.
template <typename Solver>
void one_level_with(benchmark::State& state) {
  omp_set_num_threads(static_cast<int>(state.range(1)));
  Equations equations(static_cast<std::size_t>(state.range(0)));
  equations.evaluate();
  Solver solver(equations);
  const int iterations = iterations_of_a_level(equations.system, equations.grid);
  for (auto _ : state) {
    for (int iteration = 0; iteration < iterations; ++iteration) {
      equations.evaluate();
      if (!solver(equations)) {
        state.SkipWithError("the solver failed");
        return;
      }
    }
  }
  if (equations.left_by([&](std::size_t i, std::size_t f) { return solver.solution(i, f); }) > 1e-9) {
    state.SkipWithError("the solver solves something else");
  }
  count_cells(state, equations.grid.size());
}

class SparseLu {
public:
  explicit SparseLu(const Equations& equations) : solution_(3, equations.grid.size()) {}
  bool operator()(const Equations& equations) {
    return solve::solve_cyclic_by_sparse_lu(equations.matrix, {}, equations.residual.pointers(), {},
                                            solution_.pointers(), {}) == Status::success;
  }
  [[nodiscard]] double solution(std::size_t i, std::size_t f) const { return solution_.field(static_cast<int>(f))[i]; }

private:
  grids::FieldSet solution_;
};

#if RUBATO_HAS_KLU
/// Pattern and pivots once, as a code for one equation would: an iteration fills in what varies, factors again and
/// solves.
class Klu {
public:
  explicit Klu(const Equations& equations) : right_(3 * equations.grid.size()) {
    const auto cells = static_cast<int>(equations.grid.size());
    const auto& [block, count, left, right, entries] = equations.matrix;
    std::vector<Eigen::Triplet<double, int>> triplets;
    for (int i = 0; i < cells; ++i) {
      const int next = i + 1 == cells ? 0 : i + 1;
      for (int r = 0; r < 3; ++r) {
        for (int c = 0; c < 3; ++c) {
          const auto at = static_cast<std::size_t>(3 * r + c);
          const bool varies = r == 0 && c == 0;
          if (varies || left[at] != 0.0) {
            triplets.emplace_back(3 * i + r, 3 * i + c, left[at]);
          }
          if (varies || right[at] != 0.0) {
            triplets.emplace_back(3 * i + r, 3 * next + c, right[at]);
          }
        }
      }
    }
    matrix_.resize(3 * cells, 3 * cells);
    matrix_.setFromTriplets(triplets.begin(), triplets.end());
    constant_.assign(matrix_.valuePtr(), matrix_.valuePtr() + matrix_.nonZeros());
    for (int i = 0; i < cells; ++i) {
      const int next = i + 1 == cells ? 0 : i + 1;
      places_.push_back(static_cast<std::size_t>(&matrix_.coeffRef(3 * i, 3 * i) - matrix_.valuePtr()));
      places_.push_back(static_cast<std::size_t>(&matrix_.coeffRef(3 * i, 3 * next) - matrix_.valuePtr()));
    }
    klu_defaults(&common_);
    symbolic_ = klu_analyze(3 * cells, matrix_.outerIndexPtr(), matrix_.innerIndexPtr(), &common_);
    fill(equations);
    numeric_ = klu_factor(matrix_.outerIndexPtr(), matrix_.innerIndexPtr(), matrix_.valuePtr(), symbolic_, &common_);
  }
  Klu(const Klu&) = delete;
  Klu& operator=(const Klu&) = delete;
  ~Klu() {
    klu_free_numeric(&numeric_, &common_);
    klu_free_symbolic(&symbolic_, &common_);
  }
  bool operator()(const Equations& equations) {
    fill(equations);
    for (int f = 0; f < 3; ++f) {
      const auto row = std::as_const(equations.residual).field(f);
      for (std::size_t i = 0; i < row.size(); ++i) {
        right_[3 * i + static_cast<std::size_t>(f)] = row[i];
      }
    }
    return klu_refactor(matrix_.outerIndexPtr(), matrix_.innerIndexPtr(), matrix_.valuePtr(), symbolic_, numeric_,
                        &common_) == 1 &&
           klu_solve(symbolic_, numeric_, static_cast<int>(right_.size()), 1, right_.data(), &common_) == 1;
  }
  [[nodiscard]] double solution(std::size_t i, std::size_t f) const { return right_[3 * i + f]; }

private:
  void fill(const Equations& equations) {
    std::ranges::copy(constant_, matrix_.valuePtr());
    const auto hessian = std::as_const(equations.hessian).field(0);
    for (std::size_t i = 0; i < hessian.size(); ++i) {
      matrix_.valuePtr()[places_[2 * i]] -= 0.5 * hessian[i];
      matrix_.valuePtr()[places_[2 * i + 1]] -= 0.5 * hessian[i];
    }
  }

  Eigen::SparseMatrix<double> matrix_;  ///< by columns
  std::vector<double> constant_, right_;
  std::vector<std::size_t> places_;
  klu_common common_{};
  klu_symbolic* symbolic_ = nullptr;
  klu_numeric* numeric_ = nullptr;
};
#endif

#if RUBATO_HAS_PETSC
/// Equal steps of the same scheme from the same start, and to the same u.
void one_level_with_snes(benchmark::State& state) {
  const auto cells = static_cast<std::size_t>(state.range(0));
  const auto system = sine_gordon(1);
  const auto grid = make_grid(1, cells);
  const double width = std::sqrt(0.75);
  peers::SnesBox peer(
      {-period / 2, period, cells}, [](double) { return 0.0; },
      [width](double x) { return 4 * width / std::cosh(width * x); }, step);
  const auto scheme = make_box_scheme(system, grid, first_level(system, grid), step);
  TimeLevels levels(*scheme, {.levels = Levels::fixed, .on_singular = OnSingular::stop, .tolerance = 1e-12}, 0.0, step);
  double apart = 0.0;
  for (int warm_up = 0; warm_up < warm_ups; ++warm_up) {
    if (!peer.step() || levels.step().status != Status::success) {
      state.SkipWithError("the step failed");
      return;
    }
    const auto u = scheme->level().fields.field(0);
    for (std::size_t i = 0; i < cells; ++i) {
      apart = std::max(apart, std::abs(u[i] - peer.u()[i]));
    }
  }
  // Rounding of second differences in space, which each of a few steps is solved to, of a u of a few units.
  if (!(apart < 1e-9)) {
    state.SkipWithError("the peer solves something else");
    return;
  }
  const int before = peer.iterations();
  for (auto _ : state) {
    if (!peer.step()) {
      state.SkipWithError("the step failed");
      return;
    }
  }
  state.counters["iterations"] =
      benchmark::Counter(static_cast<double>(peer.iterations() - before), benchmark::Counter::kAvgIterations);
  count_cells(state, cells);
}
#endif

BENCHMARK(streaming_pass)->ArgNames({"cells", "threads"})->Args({1'000'001, 1})->Args({10'000'001, 1})->UseRealTime();
BENCHMARK(one_level<1, Levels::variable>)
    ->Name("one_level")
    ->ArgNames({"cells", "threads"})
    ->Args({100'001, 1})
    ->Args({1'000'001, 1})
    ->Args({1'000'001, 2})
    ->Args({10'000'001, 1})
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);
void on_one_thread(benchmark::internal::Benchmark* run, long cells) {
  run->ArgNames({"cells", "threads"})->Args({cells, 1})->UseRealTime()->Unit(benchmark::kMillisecond);
}
void on_a_long_line(benchmark::internal::Benchmark* run) {
  on_one_thread(run, 100'001);
}
constexpr int same_levels = 60;  ///< to t = 3.25: what a level takes changes as the breather moves
BENCHMARK(one_level<1, Levels::fixed>)->Name("one_fixed_level")->Apply(on_a_long_line)->Iterations(same_levels);
BENCHMARK(one_level_with<SparseLu>)->Name("one_level_with_sparse_lu")->Apply(on_a_long_line);
#if RUBATO_HAS_KLU
BENCHMARK(one_level_with<Klu>)->Name("one_level_with_klu")->Apply(on_a_long_line);
#endif
#if RUBATO_HAS_PETSC
BENCHMARK(one_level_with_snes)->Apply(on_a_long_line)->Iterations(same_levels);
#endif
BENCHMARK(one_level<2, Levels::variable>)->Name("one_level_2d")->Apply([](auto* run) { on_one_thread(run, 525); });

}  // namespace

BENCHMARK_MAIN();
