#include <rubato/solve/cyclic_block.hpp>

#include <omp.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string_view>

#include <fmt/core.h>
#include <rubato/base/compensated_sum.hpp>
#include <rubato/base/lanes.hpp>
#include <rubato/base/limits.hpp>
#include <rubato/grids/buffer.hpp>
#include <rubato/grids/largest.hpp>
#include <rubato/grids/parallel.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/grids/slab.hpp>
#include <rubato/solve/block_qr_reduction.hpp>
#include <rubato/solve/cyclic_parts.hpp>
#include <rubato/solve/cyclic_residual.hpp>
#include <rubato/solve/cyclic_sparse.hpp>
#include <rubato/solve/dense_solver.hpp>
#include <rubato/solve/tuning.hpp>

namespace rubato::solve {
namespace {

using namespace tuning::cyclic_block;
using residuals::for_each_residual;

/// max |values[i]|; infinity if one of them is not finite.
double largest_in_block(const double* values, std::size_t count) {
  double poison = 0.0;
  const double largest = grids::largest_magnitude(values, count, poison);
  return poison == 0.0 ? largest : std::numeric_limits<double>::infinity();
}

double largest_of(const double* values, std::size_t count) {
  const auto blocks = static_cast<std::ptrdiff_t>((count + 4095) / 4096);
  if (blocks <= 8) {
    return largest_in_block(values, count);
  }
  double result = 0.0;
#pragma omp parallel for schedule(static) reduction(max : result)
  for (std::ptrdiff_t block = 0; block < blocks; ++block) {
    const std::size_t begin = static_cast<std::size_t>(block) * 4096;
    result = std::max(result, largest_in_block(values + begin, std::min<std::size_t>(4096, count - begin)));
  }
  return result;
}

double largest_of(const CyclicCoefficient& c, std::size_t count) {
  return std::abs(c.constant) + (c.values != nullptr ? largest_of(c.values, count) : 0.0);
}

/// Adds Σ_i (constant + values[i]) z[i].
void add_product(const CyclicCoefficient& c, const double* z, std::size_t count, CompensatedSum& sum) {
  const auto term = [&](std::size_t i) { return (c.constant + (c.values != nullptr ? c.values[i] : 0.0)) * z[i]; };
  grids::LaneSum product;
  grids::detail::add_terms(product, 0, count, term);
  sum.add(product.total());
}

/// What one field adds to a border's row; most add nothing.
bool is_zero(const CyclicCoefficient& c) {
  return c.constant == 0.0 && c.values == nullptr;
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
    chunks::Part here;  ///< of what ranks eliminate on their own, what this one does
    std::size_t cells_here = 0;
    grids::Buffer records;   ///< of this level's cells; none at level 0, which reads the user's matrix
    grids::Buffer solution;  ///< at this level's nodes; none at level 0, which writes the user's arrays
    grids::Buffer before;    ///< of a part, the record before the first, as far as it is known
  };

  chunks::Shape largest;       ///< what memory is there for
  std::size_t cells = 0;       ///< here
  int lanes = vector_lanes();  ///< chunks that are eliminated side by side
  std::vector<Level> levels;
  grids::Buffer last_record;
  grids::Buffer last_solution;
  std::vector<grids::Buffer> workspaces;  ///< one for each thread
  std::size_t workspace = 0;
  DenseSolver dense{1};
  std::vector<double> dense_matrix;
  std::vector<double> dense_rhs;
  // Of ranks that share the cells.
  const grids::Slab* slab = nullptr;
  std::size_t shared = 0;                                 ///< so many levels are eliminated by each rank
  std::vector<std::size_t> separators;                    ///< of each rank: its first cell at level `shared`
  std::vector<std::vector<double>> to_rank_0, at_rank_0;  ///< records of that level
  std::vector<std::vector<double>> from_rank_0, here;     ///< status, rcond, y, and the solution there
  // For refinement, made when first needed.
  grids::Buffer residual;
  grids::Buffer correction;
  // For the residual.
  std::vector<double> row_scales;
  std::vector<double> largest_residuals;
  std::vector<double> all_sizes;
  std::vector<CompensatedSum> products;
  std::vector<double> product_values;

  void prepare_workspaces() {
    const auto threads = static_cast<std::size_t>(omp_get_max_threads());
    while (workspaces.size() < threads) {
      workspaces.emplace_back(workspace);
    }
  }

  void share(const grids::Slab& with, const CyclicParts& parts);
  [[nodiscard]] bool leads() const { return slab == nullptr || slab->leads(); }
  [[nodiscard]] std::size_t whole_cells() const { return levels.front().cells; }
  [[nodiscard]] bool agreed(bool said) const {
    return slab == nullptr ? said : slab->largest_over_ranks(said ? 0.0 : 1.0) == 0.0;
  }

  /// One solve: its arguments, and the systems of the levels.
  struct Task {
    const CyclicBidiagonal& matrix;
    const CyclicBorder& border;
    std::span<const double* const> rhs;
    const double* border_rhs;
    std::span<double* const> solution;
    double* border_solution;
    int columns;
    chunks::Shape shape;
  };
  [[nodiscard]] chunks::System system_of(const Task& task, std::size_t t) const;
  /// Calls work(first chunk, workspace) for all chunks of a level that are here, in parallel.
  template <class Work>
  void for_each_group(const Task& task, const chunks::System& system, Work&& work);
  void reduce(const Task& task, std::size_t t, double* reduced);
  void expand(const Task& task, std::size_t t, const double* from);
  /// The elimination of all levels from `t` on, the last system, and the way back to level t.
  Status solve_from(const Task& task, std::size_t t, double& rcond);
  Status solve_last(const Task& task, double& rcond);
  Status solve_shared(const Task& task, double& rcond);

  /// One elimination and one way back, without any check of the result.
  Status solve_once(const CyclicBidiagonal& matrix, const CyclicBorder& border, std::span<const double* const> rhs,
                    const double* border_rhs, std::span<double* const> solution, double* border_solution, int columns,
                    double& rcond);
  /// The largest residual in units of row scales; sets `undefined` if an input is not finite.
  void add_products(const CyclicBorder& border, const double* const* z, std::span<double> sizes);
  double backward_error(const CyclicBidiagonal& matrix, const CyclicBorder& border, const double* const* rhs,
                        const double* border_rhs, const double* const* z, const double* y, bool& undefined);
};

/// Where the records of level t + 1 go, and its solution comes from.
chunks::System CyclicBlockSolver::Storage::system_of(const Task& task, std::size_t t) const {
  const Level& level = levels[t];
  chunks::System system{task.shape, level.cells, level.chunks, nullptr, nullptr, {}, level.records.data()};
  if (t == 0) {
    system.matrix = &task.matrix;
    system.border = &task.border;
    system.rhs = task.rhs;
  }
  if (t < shared) {
    system.part = &level.here;
  }
  return system;
}

template <class Work>
void CyclicBlockSolver::Storage::for_each_group(const Task& task, const chunks::System& system, Work&& work) {
  const std::size_t first = system.first_chunk(), count = system.end_chunk() - first;
  const std::size_t groups = (count + lanes - 1) / lanes;
  // Below some 0.1 ms of work the threads cost more than they save, much more so where something else runs as well.
  grids::for_each_index(groups, task.matrix.cells >= 4096 && groups > 4, [&](std::size_t group, std::size_t thread) {
    work(first + group * lanes, workspaces[thread].data());
  });
}

void CyclicBlockSolver::Storage::reduce(const Task& task, std::size_t t, double* reduced) {
  const chunks::System system = system_of(task, t);
  for_each_group(task, system,
                 [&](std::size_t first, double* space) { chunks::reduce(lanes, system, first, space, reduced); });
}

void CyclicBlockSolver::Storage::expand(const Task& task, std::size_t t, const double* from) {
  const chunks::System system = system_of(task, t);
  chunks::Solution to;
  to.separators = from;
  to.border = task.border_solution;
  if (t == 0) {
    to.fields = task.solution;
  } else {
    to.nodes = levels[t].solution.data();
  }
  for_each_group(task, system,
                 [&](std::size_t first, double* space) { chunks::expand(lanes, system, first, space, to); });
}

Status CyclicBlockSolver::Storage::solve_once(const CyclicBidiagonal& matrix, const CyclicBorder& border,
                                              std::span<const double* const> rhs, const double* border_rhs,
                                              std::span<double* const> solution, double* border_solution, int columns,
                                              double& rcond) {
  const Task task{matrix,   border,          rhs,     border_rhs,
                  solution, border_solution, columns, {largest.d, border.count, columns}};
  return slab == nullptr ? solve_from(task, 0, rcond) : solve_shared(task, rcond);
}

Status CyclicBlockSolver::Storage::solve_from(const Task& task, std::size_t t, double& rcond) {
  const auto next = [this](std::size_t level, auto&& array, double* last) {
    return level + 1 < levels.size() ? array(levels[level + 1]) : last;
  };
  for (std::size_t level = t; level < levels.size(); ++level) {
    reduce(task, level,
           next(
               level, [](Level& l) { return l.records.data(); }, last_record.data()));
  }
  if (const Status status = solve_last(task, rcond); status != Status::success) {
    return status;
  }
  for (std::size_t level = levels.size(); level-- > t;) {
    expand(task, level,
           next(
               level, [](Level& l) { return l.solution.data(); }, last_solution.data()));
  }
  return Status::success;
}

/// Each rank eliminates its chunks of the first levels; the records that are left go to rank 0, and the nodes that they
/// are of come from there.
Status CyclicBlockSolver::Storage::solve_shared(const Task& task, double& rcond) {
  const chunks::Shape& shape = task.shape;
  const auto record = static_cast<std::size_t>(shape.record()),
             per_node = static_cast<std::size_t>(shape.columns * shape.d),
             rows = static_cast<std::size_t>(shape.borders * shape.d),
             head = 2 + static_cast<std::size_t>(shape.borders * shape.columns);
  const auto count_of = [this](std::size_t rank) { return separators[rank + 1] - separators[rank]; };
  const std::size_t count = count_of(static_cast<std::size_t>(slab->rank()));
  const std::size_t ranks = leads() ? separators.size() - 1 : 0;  // that this one hears of
  to_rank_0.front().resize(count * record);
  for (std::size_t t = 0; t < shared; ++t) {
    Level& level = levels[t];
    if (t > 0 && rows > 0) {
      const double* const last = level.records.data() + (level.cells_here - 1) * record + shape.last_row();
      slab->pass_on({last, rows}, {level.before.data() + shape.last_row(), rows});
    }
    reduce(task, t, t + 1 < shared ? levels[t + 1].records.data() : to_rank_0.front().data());
  }
  for (std::size_t rank = 0; rank < ranks; ++rank) {
    at_rank_0[rank].resize(count_of(rank) * record);
  }
  slab->exchange_all(to_rank_0, at_rank_0);
  for (std::size_t rank = 0; rank < ranks; ++rank) {
    std::ranges::copy(at_rank_0[rank], levels[shared].records.data() + separators[rank] * record);
  }
  const Status found = leads() ? solve_from(task, shared, rcond) : Status::success;
  for (std::size_t rank = 0; rank < ranks; ++rank) {
    const double* const solved = levels[shared].solution.data();
    std::vector<double>& out = from_rank_0[rank];
    out.resize(head + (count_of(rank) + 1) * per_node);
    out[0] = static_cast<double>(static_cast<int>(found));
    out[1] = rcond;
    std::copy_n(task.border_solution, head - 2, out.begin() + 2);
    double* const nodes = out.data() + head;
    std::copy_n(solved + separators[rank] * per_node, count_of(rank) * per_node, nodes);
    const std::size_t behind = rank + 1 == ranks ? 0 : separators[rank + 1];
    std::copy_n(solved + behind * per_node, per_node, nodes + count_of(rank) * per_node);
  }
  std::vector<double>& mine = here.front();
  mine.resize(head + (count + 1) * per_node);
  slab->exchange_all(from_rank_0, here);
  rcond = mine[1];
  if (const auto status = static_cast<Status>(static_cast<int>(mine[0])); status != Status::success) {
    return status;
  }
  std::copy_n(mine.begin() + 2, head - 2, task.border_solution);
  const double* const behind = mine.data() + head + count * per_node;
  for (std::size_t t = shared; t-- > 0;) {
    expand(task, t, t + 1 < shared ? levels[t + 1].solution.data() : mine.data() + head);
    if (t > 0) {
      std::copy_n(behind, per_node, levels[t].solution.data() + levels[t].cells_here * per_node);
    }
  }
  for (std::size_t j = 0; j < per_node; ++j) {
    task.solution[j][cells] = behind[j];
  }
  return Status::success;
}

Status CyclicBlockSolver::Storage::solve_last(const Task& task, double& rcond) {
  const chunks::Shape& shape = task.shape;
  const CyclicBorder& border = task.border;
  const double* const border_rhs = task.border_rhs;
  double* const border_solution = task.border_solution;
  const int columns = task.columns;
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
  return Status::success;
}

/// C z over all cells, as product_values, and of all ranks the largest of `sizes`.
void CyclicBlockSolver::Storage::add_products(const CyclicBorder& border, const double* const* z,
                                              std::span<double> sizes) {
  const auto d = static_cast<std::size_t>(largest.d);
  products.assign(static_cast<std::size_t>(border.count), {});
  for (std::size_t j = 0; j < border.rows.size(); ++j) {
    if (!is_zero(border.rows[j])) {
      add_product(border.rows[j], z[j % d], cells, products[j / d]);
    }
  }
  product_values.resize(products.size());
  if (slab != nullptr) {
    slab->reduce(products, product_values, sizes);
  } else {
    std::ranges::transform(products, product_values.begin(), [](const CompensatedSum& sum) { return sum.value(); });
  }
}

double CyclicBlockSolver::Storage::backward_error(const CyclicBidiagonal& a, const CyclicBorder& border,
                                                  const double* const* rhs, const double* border_rhs,
                                                  const double* const* z, const double* y, bool& undefined) {
  const auto d = static_cast<std::size_t>(a.block), borders = static_cast<std::size_t>(border.count);
  const std::size_t blocks = (cells + residual_block - 1) / residual_block;
  largest_residuals.assign(blocks * d, 0.0);
  for_each_residual(
      a, border, rhs, z, y, slab == nullptr, [&](std::size_t begin, std::size_t count, int row, const double* out) {
        largest_residuals[begin / residual_block * d + static_cast<std::size_t>(row)] = largest_in_block(out, count);
      });
  // Over all cells: of z, rhs and residual of each field, then of what borders and entries have.
  std::vector<double>& sizes = all_sizes;
  sizes.clear();
  for (std::size_t c = 0; c < d; ++c) {
    sizes.push_back(largest_of(z[c], cells));
  }
  for (std::size_t r = 0; r < d; ++r) {
    sizes.push_back(largest_of(rhs[r], cells));
  }
  for (std::size_t r = 0; r < d; ++r) {
    double& worst = sizes.emplace_back(0.0);
    for (std::size_t j = r; j < largest_residuals.size(); j += d) {
      worst = std::max(worst, largest_residuals[j]);
    }
  }
  for (const CyclicEntry& e : a.entries) {
    sizes.push_back(largest_of(e.values, cells));
  }
  for (const auto* coefficients : {&border.columns, &border.rows}) {
    for (const CyclicCoefficient& c : *coefficients) {
      sizes.push_back(largest_of(c, cells));
    }
  }
  add_products(border, z, sizes);

  bool finite = true;
  const auto seen = [&](double value) {
    finite = finite && std::isfinite(value);
    return value;
  };
  const double size = *std::max_element(sizes.begin(), sizes.begin() + a.block);  // rounding in one field spreads
  const double* const of_rhs = sizes.data() + d;
  const double* const of_residual = of_rhs + d;
  const double* const of_entry = of_residual + d;
  const double* const of_column = of_entry + a.entries.size();
  const double* const of_row = of_column + border.columns.size();
  row_scales.assign(d, 0.0);
  for (std::size_t r = 0; r < d; ++r) {
    row_scales[r] = seen(of_rhs[r]);
    for (std::size_t c = 0; c < d; ++c) {
      row_scales[r] += seen(std::abs(a.left[r * d + c]) + std::abs(a.right[r * d + c])) * size;
      if (a.closes()) {
        row_scales[r] += seen(std::abs(a.last_left[r * d + c]) + std::abs(a.last_right[r * d + c])) * size;
      }
    }
    for (std::size_t b = 0; b < borders; ++b) {
      row_scales[r] += seen(of_column[b * d + r]) * std::abs(y[b]);
    }
  }
  for (std::size_t e = 0; e < a.entries.size(); ++e) {
    const CyclicEntry& entry = a.entries[e];
    row_scales[static_cast<std::size_t>(entry.row)] +=
        seen(of_entry[e]) * (std::abs(entry.left) + std::abs(entry.right)) * size;
  }
  double result = 0.0;
  for (std::size_t r = 0; r < d; ++r) {
    if (of_residual[r] > 0.0) {
      const double relative = of_residual[r] / row_scales[r];
      result = std::isfinite(relative) ? std::max(result, relative) : infinity;
    }
  }
  for (std::size_t b = 0; b < borders; ++b) {
    CompensatedSum sum(border_rhs[b]);
    double scale = std::abs(border_rhs[b]);
    for (std::size_t c = 0; c < d; ++c) {
      scale += seen(of_row[b * d + c]) * size * static_cast<double>(whole_cells());
    }
    sum.add(-product_values[b]);
    for (std::size_t j = 0; j < borders; ++j) {
      sum.add(-border.corner[b * borders + j] * y[j]);
      scale += std::abs(border.corner[b * borders + j] * y[j]);
    }
    if (sum.value() != 0.0) {
      const double relative = std::abs(sum.value()) / scale;
      result = std::isfinite(relative) ? std::max(result, relative) : infinity;
    }
  }
  undefined = !finite;
  return result;
}

/// What this rank has of the levels that ranks eliminate each.
void CyclicBlockSolver::Storage::share(const grids::Slab& with, const CyclicParts& parts) {
  const auto rank = static_cast<std::size_t>(with.rank()), ranks = static_cast<std::size_t>(with.ranks());
  for (std::size_t r = 0; r <= ranks; ++r) {
    if (with.first_plane(static_cast<int>(r)) != parts.first_cells.front()[r]) {
      throw std::logic_error("CyclicBlockSolver: the parts of ranks do not end where chunks do");
    }
  }
  slab = &with;
  shared = parts.shared;
  cells = with.owned();
  separators = parts.first_cells[shared];
  for (std::size_t t = 0; t < shared; ++t) {
    const auto& first = parts.first_cells[t];
    const auto& chunk = parts.first_cells[t + 1];
    levels[t].cells_here = first[rank + 1] - first[rank];
    levels[t].here = {chunk[rank], chunk[rank + 1] - chunk[rank], first[rank], nullptr};
  }
  for (auto* numbers : {&to_rank_0, &at_rank_0, &from_rank_0, &here}) {
    numbers->resize(ranks);
  }
}

CyclicBlockSolver::CyclicBlockSolver(int block, std::size_t cells, int borders, int max_columns,
                                     const grids::Slab* slab)
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
  for (const std::size_t n : cyclic_levels(block, cells)) {
    if (!s.levels.empty()) {
      s.levels.back().chunks = n;
    }
    Storage::Level& level = s.levels.emplace_back();
    level.cells = level.cells_here = n;
    level.chunks = 1;
  }
  if (slab != nullptr) {
    s.share(*slab, cyclic_parts(block, cells, slab->ranks()));
  }
  for (std::size_t t = 1; t < s.levels.size(); ++t) {
    Storage::Level& level = s.levels[t];
    if (t >= s.shared && !s.leads()) {
      break;
    }
    level.records = grids::Buffer(level.cells_here * s.largest.record());
    level.solution = grids::Buffer((level.cells_here + (t < s.shared ? 1 : 0)) * max_columns * block);
    if (t < s.shared) {
      level.before = grids::Buffer(s.largest.record());
      level.here.before = level.before.data();
    }
  }
  s.last_record = grids::Buffer(s.largest.record());
  s.last_solution = grids::Buffer(static_cast<std::size_t>(max_columns) * block);
  s.workspace = chunks::workspace_size(s.largest, 2 * cells_per_chunk(block));
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
  require(matrix.last_left.size() == matrix.last_right.size() &&
              (!matrix.closes() || (s.slab == nullptr && matrix.last_left.size() == matrix.left.size())),
          "the size of the last cell's blocks", static_cast<long long>(matrix.last_left.size()), d * d);
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
      // Solutions of a part have one node more.
      const std::size_t room = s.cells + 1, nodes = s.slab == nullptr ? s.cells : room, size = rhs.size() * room;
      if (s.residual.size() < size) {
        s.residual = grids::Buffer(size);
        s.correction = grids::Buffer(size);
      }
      std::vector<const double*> residuals(rhs.size());
      std::vector<double*> corrections(rhs.size());
      std::vector<double> border_residual(border_size);
      std::vector<double> border_correction(border_size);
      for (std::size_t j = 0; j < rhs.size(); ++j) {
        residuals[j] = s.residual.data() + j * room;
        corrections[j] = s.correction.data() + j * room;
      }
      for (int c = 0; c < columns; ++c) {
        for_each_residual(matrix, border, &rhs[c * d], &solution[c * d], border_solution.data() + c * k,
                          s.slab == nullptr, [&](std::size_t begin, std::size_t count, int row, const double* out) {
                            std::copy_n(out, count, s.residual.data() + (c * d + row) * room + begin);
                          });
        s.add_products(border, &solution[c * d], {});
        for (int b = 0; b < k; ++b) {
          CompensatedSum product(s.product_values[b]);
          for (int j = 0; j < k; ++j) {
            product.add(border.corner[b * k + j] * border_solution[c * k + j]);
          }
          border_residual[c * k + b] = border_rhs[c * k + b] - product.value();
        }
      }
      outcome.status = s.solve_once(matrix, border, residuals, border_residual.data(), corrections,
                                    border_correction.data(), columns, outcome.rcond_estimate);
      for (std::size_t j = 0; j < rhs.size(); ++j) {
        for (std::size_t i = 0; i < nodes; ++i) {
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

  if (!s.agreed(cyclic_is_finite(matrix, border, rhs, border_rhs))) {
    outcome.status = Status::undefined;
    return outcome;
  }
  if (k == 0) {
    // Orthogonal elimination is backward stable: if its result is no solution, the matrix is singular to rounding.
    outcome.status = Status::singular;
    return outcome;
  }
  if (s.slab != nullptr) {
    outcome.status = Status::ill_conditioned;
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

}  // namespace rubato::solve
