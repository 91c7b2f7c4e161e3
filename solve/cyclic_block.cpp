#include <rubato/solve/cyclic_block.hpp>

#include <omp.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string_view>

#include <fmt/core.h>
#include <rubato/base/compensated_sum.hpp>
#include <rubato/base/limits.hpp>
#include <rubato/grids/buffer.hpp>
#include <rubato/grids/wide_vectors.hpp>
#include <rubato/solve/block_qr_reduction.hpp>
#include <rubato/solve/cyclic_sparse.hpp>
#include <rubato/solve/dense_solver.hpp>
#include <rubato/solve/tuning.hpp>

namespace rubato::solve {
namespace {

using namespace tuning::cyclic_block;

/// out[j] = rhs - (A z + B y) of equation `row` at cells begin + j, j < count, none of which is the last cell.
RUBATO_WIDE_VECTORS void residual_of_row(const CyclicBidiagonal& a, const CyclicBorder& border, const double* rhs,
                                         const double* const* z, const double* y, int row, std::size_t begin,
                                         std::size_t count, double* out) {
  const int d = a.block;
  for (std::size_t j = 0; j < count; ++j) {
    out[j] = rhs != nullptr ? rhs[begin + j] : 0.0;
  }
  for (int c = 0; c < d; ++c) {
    const double left = a.left[row * d + c];
    const double right = a.right[row * d + c];
    if (left != 0.0 || right != 0.0) {
      const double* zc = z[c] + begin;
      for (std::size_t j = 0; j < count; ++j) {
        out[j] -= left * zc[j] + right * zc[j + 1];
      }
    }
  }
  for (const CyclicEntry& e : a.entries) {
    if (e.row == row) {
      const double* zc = z[e.column] + begin;
      const double* v = e.values + begin;
      for (std::size_t j = 0; j < count; ++j) {
        out[j] -= v[j] * (e.left * zc[j] + e.right * zc[j + 1]);
      }
    }
  }
  for (int b = 0; b < border.count; ++b) {
    const CyclicCoefficient& column = border.columns[b * d + row];
    for (std::size_t j = 0; j < count; ++j) {
      out[j] -= (column.constant + (column.values != nullptr ? column.values[begin + j] : 0.0)) * y[b];
    }
  }
}

/// The same at the last cell, whose right node is node 0.
double residual_at_seam(const CyclicBidiagonal& a, const CyclicBorder& border, const double* rhs,
                        const double* const* z, const double* y, int row) {
  const int d = a.block;
  const std::size_t i = a.cells - 1;
  double out = rhs != nullptr ? rhs[i] : 0.0;
  for (int c = 0; c < d; ++c) {
    out -= a.left[row * d + c] * z[c][i] + a.right[row * d + c] * z[c][0];
  }
  for (const CyclicEntry& e : a.entries) {
    if (e.row == row) {
      out -= e.values[i] * (e.left * z[e.column][i] + e.right * z[e.column][0]);
    }
  }
  for (int b = 0; b < border.count; ++b) {
    const CyclicCoefficient& column = border.columns[b * d + row];
    out -= (column.constant + (column.values != nullptr ? column.values[i] : 0.0)) * y[b];
  }
  return out;
}

/// Calls use(begin, count, row, residuals) for every row of every block of cells, in parallel.
template <class Use>
void for_each_residual(const CyclicBidiagonal& a, const CyclicBorder& border, const double* const* rhs,
                       const double* const* z, const double* y, Use&& use) {
  const auto blocks = static_cast<std::ptrdiff_t>((a.cells + residual_block - 1) / residual_block);
#pragma omp parallel for schedule(static) if (blocks > 8)
  for (std::ptrdiff_t block = 0; block < blocks; ++block) {
    double out[residual_block];
    const std::size_t begin = static_cast<std::size_t>(block) * residual_block;
    const std::size_t end = std::min(begin + residual_block, a.cells);
    for (int row = 0; row < a.block; ++row) {
      const double* r = rhs != nullptr ? rhs[row] : nullptr;
      const std::size_t inner = end - begin - (end == a.cells ? 1 : 0);
      residual_of_row(a, border, r, z, y, row, begin, inner, out);
      if (end == a.cells) {
        out[inner] = residual_at_seam(a, border, r, z, y, row);
      }
      use(begin, end - begin, row, out);
    }
  }
}

/// max |values[i]|, eight side by side; infinity if one of them is not finite.
RUBATO_WIDE_VECTORS double largest_in_block(const double* values, std::size_t count) {
  constexpr std::size_t lanes = 8;
  double sizes[lanes] = {};
  double poison[lanes] = {};  // 0 · x is NaN when x is not finite
  const auto take = [&](std::size_t lane, double value) {
    const double size = std::abs(value);
    sizes[lane] = size > sizes[lane] ? size : sizes[lane];
    poison[lane] += 0.0 * size;
  };
  std::size_t i = 0;
  for (; i + lanes <= count; i += lanes) {
    for (std::size_t l = 0; l < lanes; ++l) {
      take(l, values[i + l]);
    }
  }
  for (; i < count; ++i) {
    take(0, values[i]);
  }
  double largest = 0.0;
  for (std::size_t l = 0; l < lanes; ++l) {
    largest = poison[l] == 0.0 ? std::max(largest, sizes[l]) : std::numeric_limits<double>::infinity();
  }
  return largest;
}

double largest_of(const double* values, std::size_t count) {
  const auto blocks = static_cast<std::ptrdiff_t>((count + 4095) / 4096);
  double result = 0.0;
#pragma omp parallel for schedule(static) reduction(max : result) if (blocks > 8)
  for (std::ptrdiff_t block = 0; block < blocks; ++block) {
    const std::size_t begin = static_cast<std::size_t>(block) * 4096;
    result = std::max(result, largest_in_block(values + begin, std::min<std::size_t>(4096, count - begin)));
  }
  return result;
}

double largest_of(const CyclicCoefficient& c, std::size_t count) {
  return std::abs(c.constant) + (c.values != nullptr ? largest_of(c.values, count) : 0.0);
}

/// Σ_i (constant + values[i]) z[i], compensated in blocks that do not depend on the number of threads.
void add_product(const CyclicCoefficient& c, const double* z, std::size_t count, CompensatedSum& sum) {
  if (c.constant == 0.0 && c.values == nullptr) {
    return;
  }
  for (std::size_t i = 0; i < count; ++i) {
    sum.add((c.constant + (c.values != nullptr ? c.values[i] : 0.0)) * z[i]);
  }
}

void require(bool condition, std::string_view what, long long got, long long wanted) {
  if (!condition) {
    throw std::invalid_argument(fmt::format("CyclicBlockSolver: {} is {}, expected {}", what, got, wanted));
  }
}

}  // namespace

struct CyclicBlockSolver::Storage {
  struct Level {
    std::size_t cells = 0;
    std::size_t chunks = 0;
    grids::Buffer records;   ///< of this level's cells; none at level 0, which reads the user's matrix
    grids::Buffer solution;  ///< at this level's nodes; none at level 0, which writes the user's arrays
  };

  chunks::Shape largest;  ///< what memory is there for
  std::size_t cells = 0;
  chunks::Kernels kernels;
  std::vector<Level> levels;
  grids::Buffer last_record;
  grids::Buffer last_solution;
  std::vector<grids::Buffer> workspaces;  ///< one for each thread
  std::size_t workspace = 0;
  DenseSolver dense{1};
  std::vector<double> dense_matrix;
  std::vector<double> dense_rhs;
  // For refinement, made when first needed.
  grids::Buffer residual;
  grids::Buffer correction;
  std::vector<double> row_scales;
  std::vector<double> largest_residuals;

  void prepare_workspaces() {
    const auto threads = static_cast<std::size_t>(omp_get_max_threads());
    while (workspaces.size() < threads) {
      workspaces.emplace_back(workspace);
    }
  }

  /// One elimination and one way back, without any check of the result.
  Status solve_once(const CyclicBidiagonal& matrix, const CyclicBorder& border, std::span<const double* const> rhs,
                    const double* border_rhs, std::span<double* const> solution, double* border_solution, int columns,
                    double& rcond);
  /// The largest residual in units of row scales; sets `undefined` if an input is not finite.
  double backward_error(const CyclicBidiagonal& matrix, const CyclicBorder& border, const double* const* rhs,
                        const double* border_rhs, const double* const* z, const double* y, bool& undefined);
};

Status CyclicBlockSolver::Storage::solve_once(const CyclicBidiagonal& matrix, const CyclicBorder& border,
                                              std::span<const double* const> rhs, const double* border_rhs,
                                              std::span<double* const> solution, double* border_solution, int columns,
                                              double& rcond) {
  const chunks::Shape shape{largest.d, border.count, columns};
  const auto system_of = [&](std::size_t t) {
    chunks::System system{shape, levels[t].cells, levels[t].chunks, nullptr, nullptr, {}, levels[t].records.data()};
    if (t == 0) {
      system.matrix = &matrix;
      system.border = &border;
      system.rhs = rhs;
    }
    return system;
  };
  const auto for_each_group = [&](std::size_t count, auto&& work) {
    const auto groups = static_cast<std::ptrdiff_t>((count + kernels.lanes - 1) / kernels.lanes);
    // Below some 0.1 ms of work the threads cost more than they save, much more so where something else runs as well.
#pragma omp parallel for schedule(static) if (matrix.cells >= 4096 && groups > 4)
    for (std::ptrdiff_t group = 0; group < groups; ++group) {
      work(static_cast<std::size_t>(group) * kernels.lanes, workspaces[omp_get_thread_num()].data());
    }
  };

  for (std::size_t t = 0; t < levels.size(); ++t) {
    const chunks::System system = system_of(t);
    double* reduced = t + 1 < levels.size() ? levels[t + 1].records.data() : last_record.data();
    for_each_group(system.chunks,
                   [&](std::size_t first, double* space) { kernels.reduce(system, first, space, reduced); });
  }

  // What is left: (L + R) z_0 + B y = r, C z_0 + D y = s.
  const int d = shape.d;
  const int n = d + shape.borders;
  const double* record = last_record.data();
  for (int c = 0; c < d; ++c) {
    for (int r = 0; r < d; ++r) {
      dense_matrix[r + c * n] = record[c * d + r] + record[shape.right() + c * d + r];
    }
    for (int b = 0; b < shape.borders; ++b) {
      dense_matrix[d + b + c * n] = record[shape.first_row() + b * d + c] + record[shape.last_row() + b * d + c];
    }
  }
  for (int c = 0; c < shape.extras(); ++c) {
    double* column = c < shape.borders ? &dense_matrix[(d + c) * n] : &dense_rhs[(c - shape.borders) * n];
    for (int r = 0; r < d; ++r) {
      column[r] = record[shape.extra() + c * d + r];
    }
    for (int b = 0; b < shape.borders; ++b) {
      const double own = c < shape.borders ? border.corner[b * shape.borders + c]
                                           : border_rhs[(c - shape.borders) * shape.borders + b];
      column[d + b] = own + record[shape.share() + b * shape.extras() + c];
    }
  }
  if (dense.size() != n) {
    dense = DenseSolver(n);
  }
  const Status status = dense.factor(dense_matrix.data());
  rcond = dense.rcond_estimate();
  if (status != Status::success) {
    return status;
  }
  dense.solve(dense_rhs.data(), columns);
  for (int c = 0; c < columns; ++c) {
    std::copy_n(&dense_rhs[c * n], d, &last_solution[c * d]);
    std::copy_n(&dense_rhs[c * n + d], shape.borders, border_solution + c * shape.borders);
  }

  for (std::size_t t = levels.size(); t-- > 0;) {
    const chunks::System system = system_of(t);
    chunks::Solution to;
    to.separators = t + 1 < levels.size() ? levels[t + 1].solution.data() : last_solution.data();
    to.border = border_solution;
    if (t == 0) {
      to.fields = solution;
    } else {
      to.nodes = levels[t].solution.data();
    }
    for_each_group(system.chunks, [&](std::size_t first, double* space) { kernels.expand(system, first, space, to); });
  }
  return Status::success;
}

double CyclicBlockSolver::Storage::backward_error(const CyclicBidiagonal& a, const CyclicBorder& border,
                                                  const double* const* rhs, const double* border_rhs,
                                                  const double* const* z, const double* y, bool& undefined) {
  const int d = a.block;
  bool finite = true;
  const auto seen = [&](double value) {
    finite = finite && std::isfinite(value);
    return value;
  };
  double size = 0.0;  // of the solution, all fields: rounding in one spreads to the others
  for (int c = 0; c < d; ++c) {
    size = std::max(size, largest_of(z[c], cells));
  }
  row_scales.assign(d, 0.0);
  for (int r = 0; r < d; ++r) {
    row_scales[r] = seen(largest_of(rhs[r], cells));
    for (int c = 0; c < d; ++c) {
      row_scales[r] += seen(std::abs(a.left[r * d + c]) + std::abs(a.right[r * d + c])) * size;
    }
    for (int b = 0; b < border.count; ++b) {
      row_scales[r] += seen(largest_of(border.columns[b * d + r], cells)) * std::abs(y[b]);
    }
  }
  for (const CyclicEntry& e : a.entries) {
    row_scales[e.row] += seen(largest_of(e.values, cells)) * (std::abs(e.left) + std::abs(e.right)) * size;
  }
  undefined = !finite;

  const std::size_t blocks = (cells + residual_block - 1) / residual_block;
  largest_residuals.assign(blocks * d, 0.0);
  for_each_residual(a, border, rhs, z, y, [&](std::size_t begin, std::size_t count, int row, const double* out) {
    largest_residuals[begin / residual_block * d + row] = largest_in_block(out, count);
  });
  double result = 0.0;
  for (std::size_t j = 0; j < largest_residuals.size(); ++j) {
    const double residual_size = largest_residuals[j];
    if (residual_size > 0.0) {
      const double relative = residual_size / row_scales[j % d];
      result = std::isfinite(relative) ? std::max(result, relative) : infinity;
    }
  }
  for (int b = 0; b < border.count; ++b) {
    CompensatedSum sum(border_rhs[b]);
    double scale = std::abs(border_rhs[b]);
    CompensatedSum product;
    for (int c = 0; c < d; ++c) {
      const CyclicCoefficient& row = border.rows[b * d + c];
      add_product(row, z[c], cells, product);
      scale += seen(largest_of(row, cells)) * size * static_cast<double>(cells);
    }
    sum.add(-product.value());
    for (int j = 0; j < border.count; ++j) {
      sum.add(-border.corner[b * border.count + j] * y[j]);
      scale += std::abs(border.corner[b * border.count + j] * y[j]);
    }
    if (sum.value() != 0.0) {
      const double relative = std::abs(sum.value()) / scale;
      result = std::isfinite(relative) ? std::max(result, relative) : infinity;
    }
  }
  undefined = !finite;
  return result;
}

CyclicBlockSolver::CyclicBlockSolver(int block, std::size_t cells, int borders, int max_columns)
    : storage_(std::make_unique<Storage>()) {
  if (block < 1 || block > 16 || cells < 2 || borders < 0 || borders > 8 || max_columns < 1 || max_columns > 16) {
    throw std::invalid_argument(
        fmt::format("CyclicBlockSolver: block {} must be in 1..16, cells {} at least 2, borders {} in 0..8, "
                    "right-hand sides {} in 1..16",
                    block, cells, borders, max_columns));
  }
  Storage& s = *storage_;
  s.largest = {block, borders, max_columns};
  s.cells = cells;
  s.kernels = chunks::kernels(block);
  // Longer chunks repeat less work, shorter ones keep a group of them in second-level cache: 8 lanes × 16 slots of
  // 4 d² doubles are 16 kB · d².
  const std::size_t per_chunk = block <= 4 ? 16 : 8;
  for (std::size_t n = cells;;) {
    Storage::Level& level = s.levels.emplace_back();
    level.cells = n;
    level.chunks = std::max<std::size_t>(1, n / per_chunk);
    if (s.levels.size() > 1) {
      level.records = grids::Buffer(n * s.largest.record());
      level.solution = grids::Buffer(n * max_columns * block);
    }
    if (level.chunks == 1) {
      break;
    }
    n = level.chunks;
  }
  s.last_record = grids::Buffer(s.largest.record());
  s.last_solution = grids::Buffer(static_cast<std::size_t>(max_columns) * block);
  s.workspace = chunks::workspace_size(s.largest, 2 * per_chunk);
  const int n = block + borders;
  s.dense = DenseSolver(n);
  s.dense_matrix.resize(static_cast<std::size_t>(n) * n);
  s.dense_rhs.resize(static_cast<std::size_t>(n) * max_columns);
  s.prepare_workspaces();
}

CyclicBlockSolver::~CyclicBlockSolver() = default;
CyclicBlockSolver::CyclicBlockSolver(CyclicBlockSolver&&) noexcept = default;
CyclicBlockSolver& CyclicBlockSolver::operator=(CyclicBlockSolver&&) noexcept = default;

CyclicOutcome CyclicBlockSolver::solve(const CyclicBidiagonal& matrix, std::span<const double* const> rhs,
                                       std::span<double* const> solution, CyclicCheck check) {
  return solve(matrix, CyclicBorder{}, rhs, {}, solution, {}, check);
}

CyclicOutcome CyclicBlockSolver::solve(const CyclicBidiagonal& matrix, const CyclicBorder& border,
                                       std::span<const double* const> rhs, std::span<const double> border_rhs,
                                       std::span<double* const> solution, std::span<double> border_solution,
                                       CyclicCheck check) {
  Storage& s = *storage_;
  const int d = s.largest.d;
  const int k = border.count;
  const auto columns = static_cast<int>(rhs.size() / d);
  require(matrix.block == d, "the block size", matrix.block, d);
  require(matrix.cells == s.cells, "the number of cells", static_cast<long long>(matrix.cells),
          static_cast<long long>(s.cells));
  require(matrix.left.size() == static_cast<std::size_t>(d) * d && matrix.right.size() == matrix.left.size(),
          "the size of the constant blocks", static_cast<long long>(std::min(matrix.left.size(), matrix.right.size())),
          d * d);
  require(k <= s.largest.borders, "the number of borders", k, s.largest.borders);
  require(columns >= 1 && columns <= s.largest.columns && rhs.size() == static_cast<std::size_t>(columns) * d,
          "the number of right-hand side arrays", static_cast<long long>(rhs.size()), s.largest.columns * d);
  require(solution.size() == rhs.size(), "the number of solution arrays", static_cast<long long>(solution.size()),
          static_cast<long long>(rhs.size()));
  const auto border_size = static_cast<std::size_t>(k) * columns;
  require(border_rhs.size() == border_size && border_solution.size() == border_size, "the size of the border's sides",
          static_cast<long long>(std::min(border_rhs.size(), border_solution.size())),
          static_cast<long long>(border_size));
  require(border.columns.size() == static_cast<std::size_t>(k) * d && border.rows.size() == border.columns.size() &&
              border.corner.size() == static_cast<std::size_t>(k) * k,
          "the size of the border", static_cast<long long>(border.columns.size()), k * d);
  for (const CyclicEntry& e : matrix.entries) {
    require(e.row >= 0 && e.row < d && e.column >= 0 && e.column < d && e.values != nullptr, "the row of an entry",
            e.row, d - 1);
  }

  s.prepare_workspaces();
  CyclicOutcome outcome;
  bool undefined = false;
  const auto worst_of = [&] {
    double worst = 0.0;
    for (int c = 0; c < columns; ++c) {
      worst = std::max(worst, s.backward_error(matrix, border, &rhs[c * d], border_rhs.data() + c * k, &solution[c * d],
                                               border_solution.data() + c * k, undefined));
      if (undefined) {
        break;
      }
    }
    return worst;
  };

  outcome.status = s.solve_once(matrix, border, rhs, border_rhs.data(), solution, border_solution.data(), columns,
                                outcome.rcond_estimate);
  if (outcome.status == Status::success) {
    if (check == CyclicCheck::left_to_caller) {
      return outcome;
    }
    outcome.backward_error = worst_of();
    if (undefined) {
      outcome.status = Status::undefined;
      return outcome;
    }
    if (std::isfinite(outcome.backward_error) && outcome.backward_error > refine_above) {
      outcome.refined = true;
      const std::size_t size = rhs.size() * s.cells;
      if (s.residual.size() < size) {
        s.residual = grids::Buffer(size);
        s.correction = grids::Buffer(size);
      }
      std::vector<const double*> residuals(rhs.size());
      std::vector<double*> corrections(rhs.size());
      std::vector<double> border_residual(border_size);
      std::vector<double> border_correction(border_size);
      for (std::size_t j = 0; j < rhs.size(); ++j) {
        residuals[j] = s.residual.data() + j * s.cells;
        corrections[j] = s.correction.data() + j * s.cells;
      }
      for (int c = 0; c < columns; ++c) {
        for_each_residual(matrix, border, &rhs[c * d], &solution[c * d], border_solution.data() + c * k,
                          [&](std::size_t begin, std::size_t count, int row, const double* out) {
                            std::copy_n(out, count, s.residual.data() + (c * d + row) * s.cells + begin);
                          });
        for (int b = 0; b < k; ++b) {
          CompensatedSum product;
          for (int f = 0; f < d; ++f) {
            add_product(border.rows[b * d + f], solution[c * d + f], s.cells, product);
          }
          for (int j = 0; j < k; ++j) {
            product.add(border.corner[b * k + j] * border_solution[c * k + j]);
          }
          border_residual[c * k + b] = border_rhs[c * k + b] - product.value();
        }
      }
      outcome.status = s.solve_once(matrix, border, residuals, border_residual.data(), corrections,
                                    border_correction.data(), columns, outcome.rcond_estimate);
      for (std::size_t j = 0; j < rhs.size(); ++j) {
        for (std::size_t i = 0; i < s.cells; ++i) {
          solution[j][i] += corrections[j][i];
        }
      }
      for (std::size_t j = 0; j < border_size; ++j) {
        border_solution[j] += border_correction[j];
      }
      outcome.backward_error = worst_of();
    }
    if (outcome.backward_error <= unacceptable_backward_error) {
      return outcome;
    }
  }

  if (!cyclic_is_finite(matrix, border, rhs, border_rhs)) {
    outcome.status = Status::undefined;
    return outcome;
  }
  if (k == 0) {
    // Orthogonal elimination is backward stable: if its result is no solution, the matrix is singular to rounding.
    outcome.status = Status::singular;
    return outcome;
  }
  outcome.fallback = true;
  outcome.status = solve_cyclic_by_sparse_lu(matrix, border, rhs, border_rhs, solution, border_solution);
  if (outcome.status == Status::success) {
    outcome.backward_error = worst_of();
    if (!(outcome.backward_error <= unacceptable_backward_error)) {
      outcome.status = Status::ill_conditioned;
    }
  }
  return outcome;
}

double CyclicBlockSolver::memory_per_cell() const {
  const Storage& s = *storage_;
  std::size_t total = s.residual.size() + s.correction.size();
  for (const Storage::Level& level : s.levels) {
    total += level.records.size() + level.solution.size();
  }
  total += s.workspaces.size() * s.workspace + s.largest_residuals.size();
  return static_cast<double>(total) / static_cast<double>(s.cells);
}

void cyclic_residual(const CyclicBidiagonal& matrix, const CyclicBorder& border, std::span<const double* const> rhs,
                     std::span<const double* const> z, std::span<const double> y, std::span<double* const> out) {
  for_each_residual(matrix, border, rhs.empty() ? nullptr : rhs.data(), z.data(), y.data(),
                    [&](std::size_t begin, std::size_t count, int row, const double* values) {
                      std::copy_n(values, count, out[row] + begin);
                    });
}

}  // namespace rubato::solve
