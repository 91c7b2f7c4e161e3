#include <omp.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <random>
#include <stdexcept>
#include <vector>

#include <catch2/catch.hpp>
#include <rubato/base/lanes.hpp>
#include <rubato/grids/buffer.hpp>
#include <rubato/solve/block_qr_reduction.hpp>
#include <rubato/solve/cyclic_block.hpp>
#include <rubato/solve/cyclic_sparse.hpp>

using namespace rubato;
using namespace rubato::solve;

namespace {

using Field = std::vector<double>;

/// A system with everything it points to.
struct Problem {
  CyclicBidiagonal matrix;
  CyclicBorder border;
  std::vector<Field> entries;
  std::vector<Field> border_fields;
  std::vector<Field> exact;
  std::vector<double> exact_border;
  std::vector<Field> rhs;
  std::vector<double> border_rhs;
  std::vector<Field> solution;
  std::vector<double> border_solution;
  int columns = 1;

  Problem(int d, std::size_t cells, int n_columns = 1) : columns(n_columns) {
    matrix.block = d;
    matrix.cells = cells;
    matrix.left.assign(d * d, 0.0);
    matrix.right.assign(d * d, 0.0);
  }

  void add_entry(int row, int column, double left, double right, Field values) {
    entries.push_back(std::move(values));
    matrix.entries.push_back({row, column, left, right, nullptr});
  }

  static std::vector<const double*> pointers(const std::vector<Field>& fields) {
    std::vector<const double*> result;
    for (const Field& f : fields) {
      result.push_back(f.data());
    }
    return result;
  }

  /// Chooses a solution at random and computes its right-hand side.
  void manufacture(unsigned seed) {
    for (std::size_t e = 0; e < entries.size(); ++e) {
      matrix.entries[e].values = entries[e].data();
    }
    const int d = matrix.block;
    const int k = border.count;
    std::mt19937_64 engine(seed);
    std::uniform_real_distribution<double> uniform(-1.0, 1.0);
    exact.assign(d * columns, Field(matrix.cells));
    for (Field& f : exact) {
      std::generate(f.begin(), f.end(), [&] { return uniform(engine); });
    }
    exact_border.resize(k * columns);
    std::generate(exact_border.begin(), exact_border.end(), [&] { return uniform(engine); });
    rhs.assign(d * columns, Field(matrix.cells));
    border_rhs.assign(k * columns, 0.0);
    for (int c = 0; c < columns; ++c) {
      std::vector<const double*> z;
      std::vector<double*> out;
      for (int f = 0; f < d; ++f) {
        z.push_back(exact[c * d + f].data());
        out.push_back(rhs[c * d + f].data());
      }
      cyclic_residual(matrix, border, {}, z, {exact_border.data() + c * k, static_cast<std::size_t>(k)}, out);
      for (int f = 0; f < d; ++f) {
        for (double& r : rhs[c * d + f]) {
          r = -r;
        }
      }
      for (int b = 0; b < k; ++b) {
        for (int f = 0; f < d; ++f) {
          const CyclicCoefficient& row = border.rows[b * d + f];
          for (std::size_t i = 0; i < matrix.cells; ++i) {
            border_rhs[c * k + b] +=
                (row.constant + (row.values != nullptr ? row.values[i] : 0.0)) * exact[c * d + f][i];
          }
        }
        for (int j = 0; j < k; ++j) {
          border_rhs[c * k + b] += border.corner[b * k + j] * exact_border[c * k + j];
        }
      }
    }
    solution.assign(d * columns, Field(matrix.cells, std::numeric_limits<double>::quiet_NaN()));
    border_solution.assign(k * columns, std::numeric_limits<double>::quiet_NaN());
  }

  CyclicOutcome solve(CyclicBlockSolver& solver) {
    std::vector<double*> to;
    for (Field& f : solution) {
      to.push_back(f.data());
    }
    return solver.solve(matrix, border, pointers(rhs), border_rhs, to, border_solution);
  }
  CyclicOutcome solve() {
    CyclicBlockSolver solver(matrix.block, matrix.cells, border.count, columns);
    return solve(solver);
  }

  [[nodiscard]] double error() const {
    double worst = 0.0;
    const auto take = [&](double difference) {
      worst =
          std::isfinite(difference) ? std::max(worst, std::abs(difference)) : std::numeric_limits<double>::infinity();
    };
    for (std::size_t j = 0; j < exact.size(); ++j) {
      for (std::size_t i = 0; i < matrix.cells; ++i) {
        take(solution[j][i] - exact[j][i]);
      }
    }
    for (std::size_t j = 0; j < exact_border.size(); ++j) {
      take(border_solution[j] - exact_border[j]);
    }
    return worst;
  }
};

Field random_field(std::size_t cells, std::mt19937_64& engine, double from = -1.0, double to = 1.0) {
  std::uniform_real_distribution<double> uniform(from, to);
  Field f(cells);
  std::generate(f.begin(), f.end(), [&] { return uniform(engine); });
  return f;
}

/// The box scheme's Newton matrix of u_tt = u_xx - V'(u) in (u, v, w): with z averaged over
/// four corners, L = M/(2h) - K/(2Δx) - S''/4, R = M/(2h) + K/(2Δx) - S''/4; V'' varies from cell to cell. Its transfer
/// matrices have one growing, one decaying and one neutral (-1) mode.
Problem wave(std::size_t cells, double h, double dx, int columns = 1) {
  Problem p(3, cells, columns);
  std::mt19937_64 engine(11);
  const auto both = [&](int r, int c, double left, double right) {
    p.matrix.left[r * 3 + c] += left;
    p.matrix.right[r * 3 + c] += right;
  };
  both(0, 1, -0.5 / h, -0.5 / h);
  both(1, 0, 0.5 / h, 0.5 / h);
  both(0, 2, -0.5 / dx, 0.5 / dx);
  both(2, 0, 0.5 / dx, -0.5 / dx);
  both(1, 1, -0.25, -0.25);
  both(2, 2, 0.25, 0.25);
  p.add_entry(0, 0, -0.25, -0.25, random_field(cells, engine));
  return p;
}

/// Puts the blocks (row by row) of each cell into variable entries.
void set_blocks(Problem& p, const std::vector<std::vector<double>>& left,
                const std::vector<std::vector<double>>& right) {
  const int d = p.matrix.block;
  for (int j = 0; j < d * d; ++j) {
    Field l(p.matrix.cells);
    Field r(p.matrix.cells);
    for (std::size_t i = 0; i < p.matrix.cells; ++i) {
      l[i] = left[i][j];
      r[i] = right[i][j];
    }
    p.add_entry(j / d, j % d, 1.0, 0.0, std::move(l));
    p.add_entry(j / d, j % d, 0.0, 1.0, std::move(r));
  }
}

/// Every entry of every block uniform in [-1, 1]. For an odd block the middle Lyapunov exponent of the transfer
/// matrices is zero, and the condition grows like exp(√cells): solutions can be judged by their residuals alone.
Problem random_blocks(int d, std::size_t cells, int columns = 1) {
  Problem p(d, cells, columns);
  std::mt19937_64 engine(17 + d);
  std::vector<std::vector<double>> left;
  std::vector<std::vector<double>> right;
  for (std::size_t i = 0; i < cells; ++i) {
    left.push_back(random_field(d * d, engine));
    right.push_back(random_field(d * d, engine));
  }
  set_blocks(p, left, right);
  return p;
}

/// Rows of the two kinds 0.4 z_i + z_{i+1} and z_i + 0.4 z_{i+1}, alternating (modes that decay to the right and to the
/// left), perturbed by random blocks of norm about 0.15 each and then mixed in each cell by a random matrix: the
/// inverse is bounded by about 1 / (1 - 0.4 - 0.3) times that of the mixing.
Problem dichotomic_blocks(int d, std::size_t cells, int columns = 1) {
  Problem p(d, cells, columns);
  std::mt19937_64 engine(170 + d);
  std::vector<std::vector<double>> left(cells, std::vector<double>(d * d));
  std::vector<std::vector<double>> right = left;
  const double size = 0.13 / std::sqrt(d);
  for (std::size_t i = 0; i < cells; ++i) {
    Field l = random_field(d * d, engine, -size, size);
    Field r = random_field(d * d, engine, -size, size);
    for (int f = 0; f < d; ++f) {
      l[f * d + f] += f % 2 == 0 ? 0.4 : 1.0;
      r[f * d + f] += f % 2 == 0 ? 1.0 : 0.4;
    }
    Field mixing = random_field(d * d, engine, -1.0 / std::sqrt(d), 1.0 / std::sqrt(d));
    for (int f = 0; f < d; ++f) {
      mixing[f * d + f] += 2.0;
    }
    for (int a = 0; a < d; ++a) {
      for (int b = 0; b < d; ++b) {
        for (int c = 0; c < d; ++c) {
          left[i][a * d + c] += mixing[a * d + b] * l[b * d + c];
          right[i][a * d + c] += mixing[a * d + b] * r[b * d + c];
        }
      }
    }
  }
  set_blocks(p, left, right);
  return p;
}

/// The naive way with a scalar two-field system of growth 2 and decay 1/2 per cell: march from node 0 with the cyclic
/// closure solved at the end.
double error_of_marching(const Problem& p) {
  const std::size_t n = p.matrix.cells;
  std::vector<double> particular(n + 1, 0.0);
  std::vector<double> fundamental(n + 1, 1.0);
  double worst = 0.0;
  for (int f = 0; f < p.matrix.block; ++f) {
    const double left = p.matrix.left[f * p.matrix.block + f];
    const double right = p.matrix.right[f * p.matrix.block + f];
    for (std::size_t i = 0; i < n; ++i) {
      particular[i + 1] = (p.rhs[f][i] - left * particular[i]) / right;
      fundamental[i + 1] = -left / right * fundamental[i];
    }
    const double start = particular[n] / (1.0 - fundamental[n]);
    for (std::size_t i = 0; i < n; ++i) {
      worst = std::max(worst, std::abs(particular[i] + start * fundamental[i] - p.exact[f][i]));
    }
  }
  return worst;
}

bool same_bits(const std::vector<Field>& a, const std::vector<Field>& b) {
  for (std::size_t j = 0; j < a.size(); ++j) {
    if (std::memcmp(a[j].data(), b[j].data(), a[j].size() * sizeof(double)) != 0) {
      return false;
    }
  }
  return true;
}

}  // namespace

TEST_CASE("the last cell may have rows of its own, which are conditions at both ends of a line") {
  std::mt19937_64 engine(9);
  std::uniform_real_distribution<double> uniform(-0.2, 0.2);
  for (const int d : {1, 2, 3, 4, 6}) {
    for (const std::size_t cells : {2, 3, 15, 16, 17, 33, 250, 1000}) {
      INFO(d << " fields, " << cells << " cells");
      Problem p(d, cells);
      std::generate(p.matrix.left.begin(), p.matrix.left.end(), [&] { return uniform(engine); });
      std::generate(p.matrix.right.begin(), p.matrix.right.end(), [&] { return uniform(engine); });
      p.matrix.last_left.assign(d * d, 0.0);
      p.matrix.last_right.assign(d * d, 0.0);
      // Fields that decay to the right are given at the left end, the others at the right one.
      for (int f = 0; f < d; ++f) {
        (f % 2 == 0 ? p.matrix.right : p.matrix.left)[f * d + f] += 2.0;
        (f % 2 == 0 ? p.matrix.last_right : p.matrix.last_left)[f * d + f] = 1.0;
      }
      Field values(cells);
      std::generate(values.begin(), values.end(), [&] { return uniform(engine); });
      p.add_entry(0, d - 1, 0.5, 0.5, values);
      p.manufacture(static_cast<unsigned>(cells));
      for (int f = 0; f < d; ++f) {
        CHECK(p.rhs[f].back() == p.exact[f][f % 2 == 0 ? 0 : cells - 1]);
      }
      CyclicBlockSolver solver(d, cells);
      CHECK(p.solve(solver).status == Status::success);
      CHECK(p.error() < 1e-13);
      // The twin: as a cell like the others.
      p.matrix.last_left.clear();
      p.matrix.last_right.clear();
      static_cast<void>(p.solve(solver));
      CHECK(p.error() > 1e-3);
    }
  }
}

TEST_CASE("cyclic block systems of every block size and length are solved") {
  const int d = GENERATE(1, 2, 3, 4, 5, 6, 7, 12, 16);
  const std::size_t cells = GENERATE(2, 3, 15, 16, 17, 31, 32, 33, 255, 1001);
  const int columns = GENERATE(1, 2);
  CAPTURE(d, cells, columns);
  Problem p = dichotomic_blocks(d, cells, columns);
  p.manufacture(3);
  const CyclicOutcome outcome = p.solve();
  REQUIRE(outcome.status == Status::success);
  // Backward stability: a few ε per row and level of elimination; refinement is asked for above 1e-14 d.
  CHECK(outcome.backward_error < 1e-14 * d);
  CHECK_FALSE(outcome.refined);
  // ε times a condition below 100 and a few d.
  CHECK(p.error() < 1e-13 * d);
  // Twin: the check would see one entry of the solution off by 1e-11.
  p.solution[d - 1][cells / 2] += 1e-11;
  CHECK(p.error() > 1e-13 * d);
}

TEST_CASE("the residual is small even where the condition is not") {
  const int d = GENERATE(1, 2, 3, 5, 9);
  const std::size_t cells = GENERATE(101, 4001);
  CAPTURE(d, cells);
  Problem p = random_blocks(d, cells);
  p.manufacture(3);
  const CyclicOutcome outcome = p.solve();
  REQUIRE(outcome.status == Status::success);
  CHECK(outcome.backward_error < 1e-14 * d);
  // The same from this test's own arithmetic, relative to the largest term of any row.
  double largest = 0.0;
  double residual = 0.0;
  for (std::size_t i = 0; i < cells; ++i) {
    for (int r = 0; r < d; ++r) {
      double sum = -p.rhs[r][i];
      for (const CyclicEntry& e : p.matrix.entries) {
        if (e.row == r) {
          const Field& z = p.solution[e.column];
          const double term = e.values[i] * (e.left * z[i] + e.right * z[(i + 1) % cells]);
          largest = std::max(largest, std::abs(term));
          sum += term;
        }
      }
      residual = std::max(residual, std::abs(sum));
    }
  }
  CHECK(residual < 1e-14 * d * largest);
  // Twin: one value of the solution off by 1e-10 of the largest.
  p.solution[0][cells / 2] += 1e-10 * largest;
  double spoiled = 0.0;
  for (const CyclicEntry& e : p.matrix.entries) {
    if (e.column == 0 && e.left != 0.0) {
      spoiled = std::max(spoiled, std::abs(e.values[cells / 2] * 1e-10 * largest));
    }
  }
  CHECK(spoiled > 1e-14 * d * largest);
}

TEST_CASE("growing and decaying modes side by side do not spoil the solution, as they do by marching") {
  const std::size_t cells = GENERATE(101, 1001);
  Problem p(2, cells);
  p.matrix.left = {-2.0, 0.0, 0.0, -0.5};
  p.matrix.right = {1.0, 0.0, 0.0, 1.0};
  p.manufacture(5);
  REQUIRE(p.solve().status == Status::success);
  // ‖A⁻¹‖ ≤ Σ 2^-j = 2 in the maximum norm.
  CHECK(p.error() < 1e-13);
  CHECK_FALSE(error_of_marching(p) < 1e-3);
}

TEST_CASE("the box scheme of the wave equation is solved whatever h/Δx and the length") {
  const std::size_t cells = GENERATE(201, 401, 20001);
  const double h = GENERATE(0.01, 0.1, 1.0);
  Problem p = wave(cells, h, 40.0 / static_cast<double>(cells), 2);
  p.manufacture(7);
  const CyclicOutcome outcome = p.solve();
  REQUIRE(outcome.status == Status::success);
  CHECK_FALSE(outcome.refined);
  CHECK(outcome.backward_error < 1e-12);
  // The averaging operator's inverse makes the condition about N · max(1/h, 1/Δx) / 2 ≤ 1e4 · 500 (theory, section 5).
  CHECK(p.error() < 1e-16 * static_cast<double>(cells) * std::max(1.0 / h, static_cast<double>(cells) / 40.0) * 100);
}

TEST_CASE("results are the same bit by bit for every number of threads") {
  Problem p = wave(20003, 0.05, 0.1, 2);
  p.manufacture(9);
  const int threads = omp_get_max_threads();
  omp_set_num_threads(1);
  REQUIRE(p.solve().status == Status::success);
  const std::vector<Field> one = p.solution;
  for (const int count : {2, 3, 7}) {
    omp_set_num_threads(count);
    REQUIRE(p.solve().status == Status::success);
    CHECK(same_bits(one, p.solution));
  }
  omp_set_num_threads(threads);
  // Twin: the last bit of one number.
  p.solution[1][777] = std::nextafter(p.solution[1][777], 2.0);
  CHECK_FALSE(same_bits(one, p.solution));
}

namespace {

/// What the two passes with so many lanes make of a system: the reduced records, and the solution at all nodes.
std::vector<Field> passes(int lanes, const chunks::System& system, const Field& separators, const Field& border) {
  const chunks::Shape& shape = system.shape;
  const std::size_t per_node = static_cast<std::size_t>(shape.columns) * shape.d;
  grids::Buffer space(chunks::workspace_size(shape, system.cells / system.chunks + 1));
  std::vector<Field> result{Field(system.chunks * shape.record()), Field(system.cells * per_node)};
  chunks::Solution solution{separators.data(), border.data(), {}, result[1].data()};
  for (std::size_t first = 0; first < system.chunks; first += lanes) {
    chunks::reduce(lanes, system, first, space.data(), result[0].data());
    chunks::expand(lanes, system, first, space.data(), solution);
  }
  return result;
}

}  // namespace

TEST_CASE("what a chunk comes to does not depend on how many lanes carry it, nor on the chunks beside it") {
  const int d = GENERATE(1, 2, 3, 4, 5, 6, 7);
  const std::size_t chunk_count = GENERATE(1, 3, 17, 100);
  CAPTURE(d, chunk_count);
  const std::size_t cells = 317;
  const chunks::Shape shape{d, 1, 2};
  std::mt19937_64 engine(40 + d);
  Problem p(d, cells, shape.columns);
  p.matrix.left = random_field(static_cast<std::size_t>(d) * d, engine);
  p.matrix.right = random_field(static_cast<std::size_t>(d) * d, engine);
  p.add_entry(0, d - 1, 0.5, 0.25, random_field(cells, engine));
  p.border.count = shape.borders;
  p.border_fields = {random_field(cells, engine), random_field(cells, engine)};
  p.border.columns.assign(d, {0.5, p.border_fields[0].data()});
  p.border.rows.assign(d, {-0.25, p.border_fields[1].data()});
  p.border.corner = {0.0};
  p.manufacture(5);
  const auto rhs = Problem::pointers(p.rhs);
  const Field separators = random_field(chunk_count * shape.columns * d, engine);
  const Field border = random_field(shape.columns, engine);
  // The system of the user, and one that an earlier pass left: records of its cells.
  const Field records = random_field(cells * shape.record(), engine);
  const chunks::System first{shape, cells, chunk_count, &p.matrix, &p.border, rhs, nullptr};
  const chunks::System later{shape, cells, chunk_count, nullptr, nullptr, {}, records.data()};
  for (const chunks::System& system : {first, later}) {
    const std::vector<Field> expected = passes(2, system, separators, border);
    for (int lanes = 4; lanes <= vector_lanes(); lanes *= 2) {
      INFO(lanes << " lanes");
      CHECK(same_bits(expected, passes(lanes, system, separators, border)));
    }
    // Twin: a chunk that saw one more cell.
    chunks::System other = system;
    other.chunks = chunk_count + 1;
    Field more = separators;
    more.resize(other.chunks * shape.columns * d, 0.5);
    std::vector<Field> found = passes(2, other, more, border);
    found[0].resize(expected[0].size());
    CHECK_FALSE(same_bits(expected, found));
  }
}

TEST_CASE("a kernel is removed by a border, and reported as singular without") {
  const std::size_t cells = GENERATE(5, 33, 501, 5001);
  CAPTURE(cells);
  // z_{i+1} - z_i and a second field with growth: constants in the first field are the kernel, and the sum of the
  // first rows vanishes identically.
  Problem p(2, cells);
  p.matrix.left = {-1.0, 0.25, 0.0, -2.0};
  p.matrix.right = {1.0, -0.25, 0.0, 1.0};
  p.manufacture(1);
  const CyclicOutcome without = p.solve();
  CHECK((without.status == Status::singular || without.rcond_estimate < 1e-12));

  p.border.count = 1;
  p.border.columns = {{1.0, nullptr}, {0.0, nullptr}};
  p.border.rows = {{1.0 / static_cast<double>(cells), nullptr}, {0.0, nullptr}};
  p.border.corner = {0.0};
  p.manufacture(2);
  const CyclicOutcome outcome = p.solve();
  REQUIRE(outcome.status == Status::success);
  CHECK_FALSE(outcome.fallback);
  CHECK(outcome.rcond_estimate > 1e-9);
  // The inverse of the difference on means zero is bounded by N.
  CHECK(p.error() < 1e-14 * static_cast<double>(cells));
  // Twin: with a column inside the range of A (rows of sum zero) the bordered system stays singular.
  Field alternating(cells, 0.0);
  alternating[0] = 1.0;
  alternating[1] = -1.0;
  p.border.columns[0] = {0.0, alternating.data()};
  p.manufacture(2);
  const CyclicOutcome still = p.solve();
  CHECK((still.status != Status::success || !(p.error() < 1e-14 * static_cast<double>(cells))));
}

TEST_CASE("dense borders with variable coefficients and several columns are solved") {
  const int d = GENERATE(2, 3, 5);
  const int k = GENERATE(1, 2, 4);
  const std::size_t cells = GENERATE(7, 40, 333, 4001);
  CAPTURE(d, k, cells);
  Problem p = dichotomic_blocks(d, cells, 2);
  std::mt19937_64 engine(23);
  p.border.count = k;
  for (int j = 0; j < k * d; ++j) {
    p.border_fields.push_back(random_field(cells, engine));
    p.border_fields.push_back(random_field(cells, engine));
  }
  for (int j = 0; j < k * d; ++j) {
    p.border.columns.push_back({0.5, p.border_fields[2 * j].data()});
    p.border.rows.push_back({-0.25, p.border_fields[2 * j + 1].data()});
  }
  p.border.corner = random_field(k * k, engine);
  p.manufacture(29);
  const CyclicOutcome outcome = p.solve();
  REQUIRE(outcome.status == Status::success);
  CHECK_FALSE(outcome.fallback);
  CHECK(outcome.backward_error < 1e-13);
  CHECK(p.error() < 1e-9);
  p.border_solution[0] += 1e-8;
  CHECK(p.error() > 1e-9);
}

TEST_CASE("a kernel on one node needs the general method, and gets it") {
  const std::size_t cells = 65;
  Problem p = dichotomic_blocks(2, cells);
  // Field 0 of node 20 appears in no cell, only in the border's row; the border's column replaces the lost equation.
  for (std::size_t e = 0; e < p.entries.size(); ++e) {
    if (p.matrix.entries[e].column == 0) {
      p.entries[e][p.matrix.entries[e].left != 0.0 ? 20 : 19] = 0.0;
    }
  }
  Field column(cells, 0.0);
  Field row(cells, 0.0);
  column[20] = 1.0;
  row[20] = 1.0;
  p.border.count = 1;
  p.border.columns = {{0.0, column.data()}, {}};
  p.border.rows = {{0.0, row.data()}, {}};
  p.border.corner = {0.0};
  p.manufacture(4);
  const CyclicOutcome outcome = p.solve();
  CHECK(outcome.status == Status::success);
  CHECK(outcome.fallback);
  CHECK(p.error() < 1e-9);
  // Twin: without the row's entry nothing determines that value.
  row[20] = 0.0;
  p.manufacture(4);
  CHECK(p.solve().status != Status::success);
}

TEST_CASE("rows of very different size are put right by one refinement") {
  // An equation scaled by 1e-6 sees the rounding of the others a million times as large; solved again for its residual
  // it does not.
  Problem p = dichotomic_blocks(3, 501);
  for (std::size_t e = 0; e < p.entries.size(); ++e) {
    const int row = p.matrix.entries[e].row;
    for (double& v : p.entries[e]) {
      v *= row == 0 ? 1e-6 : row == 1 ? 1.0 : 1e3;
    }
  }
  p.manufacture(6);
  CyclicBlockSolver solver(3, 501);
  const CyclicOutcome outcome = p.solve(solver);
  REQUIRE(outcome.status == Status::success);
  CHECK(outcome.refined);
  CHECK(outcome.backward_error < 1e-14);
  CHECK(p.error() < 1e-12);
  // Twin: without it.
  std::vector<double*> to;
  for (Field& f : p.solution) {
    to.push_back(f.data());
  }
  const CyclicOutcome unchecked = solver.solve(p.matrix, Problem::pointers(p.rhs), to, CyclicCheck::left_to_caller);
  CHECK(unchecked.status == Status::success);
  CHECK_FALSE(unchecked.refined);
  CHECK_FALSE(p.error() < 1e-12);
}

TEST_CASE("values that are not finite are reported wherever they stand") {
  const std::size_t cells = 301;
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    for (const std::size_t place : {std::size_t{0}, std::size_t{150}, cells - 1}) {
      Problem p = wave(cells, 0.1, 0.2);
      p.manufacture(1);
      CHECK(p.solve().status == Status::success);
      p.rhs[2][place] = bad;
      CHECK(p.solve().status == Status::undefined);
      p = wave(cells, 0.1, 0.2);
      p.manufacture(1);
      p.entries[0][place] = bad;
      CHECK(p.solve().status == Status::undefined);
    }
  }
}

TEST_CASE("the general sparse solver agrees with the elimination") {
  Problem p = wave(301, 0.1, 0.2, 2);
  p.manufacture(2);
  std::vector<double*> to;
  for (Field& f : p.solution) {
    to.push_back(f.data());
  }
  REQUIRE(solve_cyclic_by_sparse_lu(p.matrix, p.border, Problem::pointers(p.rhs), p.border_rhs, to,
                                    p.border_solution) == Status::success);
  CHECK(p.error() < 1e-10);
}

TEST_CASE("wrong shapes are refused with their values") {
  CHECK_THROWS_WITH(CyclicBlockSolver(17, 10), Catch::Contains("block 17"));
  CHECK_THROWS_WITH(CyclicBlockSolver(3, 1), Catch::Contains("cells 1"));
  Problem p = wave(101, 0.1, 0.2);
  p.manufacture(1);
  CyclicBlockSolver other(3, 99);
  CHECK_THROWS_WITH(p.solve(other), Catch::Contains("101") && Catch::Contains("99"));
  CyclicBlockSolver narrow(2, 101);
  CHECK_THROWS_AS(p.solve(narrow), std::invalid_argument);
}

TEST_CASE("memory stays far below the limit of 60 doubles per field and cell") {
  for (const int d : {2, 3, 6, 12}) {
    CHECK(CyclicBlockSolver(d, 1'000'001, 1, 2).memory_per_cell() < 6.0 * d);
  }
}
