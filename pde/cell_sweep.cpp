#include <rubato/pde/cell_sweep.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include <rubato/base/wide_vectors.hpp>
#include <rubato/grids/buffer.hpp>
#include <rubato/grids/parallel.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/pde/matrix_terms.hpp>
#include <rubato/pde/node_derivative.hpp>
#include <rubato/pde/placed_coordinates.hpp>
#include <rubato/pde/space_collocation.hpp>
#include <rubato/pde/tuning.hpp>

namespace rubato {

BoxGather::BoxGather(const grids::Grid& grid) : dimensions_(grid.dimensions()) {
  for (int a = 0; a < 3; ++a) {
    n_[a] = grid.cells(a);
    stride_[a] = a < dimensions_ ? grid.stride(a) : 0;
    inverse_spacing_[a] = a < dimensions_ ? 1.0 / grid.spacing(a) : 0.0;
  }
}

namespace {

using namespace tuning::cell_sweep;

constexpr std::size_t block_size = CellBlocks::most;
using Line = std::array<double, block_size + 1>;

/// Nodes begin … begin + count of a line (count + 1 of them), the last one cyclically.
template <typename Use>
void for_each_node(std::size_t begin, std::size_t count, std::size_t n, Use&& use) {
  const std::size_t inner = begin + count == n ? count : count + 1;
  for (std::size_t i = 0; i < inner; ++i) {
    use(i, begin + i);
  }
  if (inner == count) {
    use(count, 0);
  }
}

/// Means and differences, as far as wanted, of nodes and of the nodes after them.
RUBATO_WIDE_VECTORS void combine(const double* nodes, std::size_t count, double inverse_spacing, double* mean,
                                 double* difference) {
  if (mean != nullptr) {
    for (std::size_t i = 0; i < count; ++i) {
      mean[i] = 0.5 * (nodes[i] + nodes[i + 1]);
    }
  }
  if (difference != nullptr) {
    for (std::size_t i = 0; i < count; ++i) {
      difference[i] = (nodes[i + 1] - nodes[i]) * inverse_spacing;
    }
  }
}

/// The two lines of nodes beside a line of cells, and what makes of them the line's nodes across y.
RUBATO_WIDE_VECTORS void combine_lines(const double* r0, const double* r1, std::size_t begin, std::size_t count,
                                       std::size_t n, double scale, double* mean, double* difference) {
  for_each_node(begin, count, n, [=](std::size_t i, std::size_t node) { mean[i] = 0.5 * (r0[node] + r1[node]); });
  for_each_node(begin, count, n,
                [=](std::size_t i, std::size_t node) { difference[i] = (r1[node] - r0[node]) * scale; });
}

}  // namespace

void BoxGather::operator()(const double* field, std::size_t line, std::size_t begin, std::size_t count, double* mean,
                           double* const* difference) const {
  const std::size_t j = line % n_[1];
  const std::size_t k = line / n_[1];
  const double* r00 = field + j * stride_[1] + k * stride_[2];
  const double* r10 = field + (j + 1 == n_[1] ? 0 : j + 1) * stride_[1] + k * stride_[2];
  if (dimensions_ == 1) {
    const bool at_seam = begin + count == n_[0];
    const std::size_t inner = at_seam ? count - 1 : count;
    combine(r00 + begin, inner, inverse_spacing_[0], mean, difference[0]);
    if (at_seam) {
      const double nodes[2] = {r00[n_[0] - 1], r00[0]};
      combine(nodes, 1, inverse_spacing_[0], mean != nullptr ? mean + inner : nullptr,
              difference[0] != nullptr ? difference[0] + inner : nullptr);
    }
    return;
  }
  Line a, b, c;
  if (dimensions_ == 2) {
    combine_lines(r00, r10, begin, count, n_[0], inverse_spacing_[1], a.data(), b.data());
  } else {
    const std::size_t k_next = k + 1 == n_[2] ? 0 : k + 1;
    const double* r01 = field + j * stride_[1] + k_next * stride_[2];
    const double* r11 = field + (j + 1 == n_[1] ? 0 : j + 1) * stride_[1] + k_next * stride_[2];
    const double scale_y = 0.5 * inverse_spacing_[1];
    const double scale_z = 0.5 * inverse_spacing_[2];
    for_each_node(begin, count, n_[0], [&](std::size_t i, std::size_t node) {
      a[i] = 0.25 * ((r00[node] + r10[node]) + (r01[node] + r11[node]));
      b[i] = ((r10[node] - r00[node]) + (r11[node] - r01[node])) * scale_y;
      c[i] = ((r01[node] - r00[node]) + (r11[node] - r10[node])) * scale_z;
    });
  }
  combine(a.data(), count, inverse_spacing_[0], mean, difference[0]);
  combine(b.data(), count, 0.0, difference[1], nullptr);
  if (dimensions_ > 2) {
    combine(c.data(), count, 0.0, difference[2], nullptr);
  }
}

namespace {

/// What one block adds to the sums and maxima.
struct BlockResult {
  double energy = 0.0;
  double quadratic = 0.0;
  std::array<double, rows_by_node> size{};  ///< of energy_size()
  bool finite = true;
  std::array<double, MultisymplecticSystem::most_fields> residual{};  ///< max |R| of each row
  std::array<double, MultisymplecticSystem::most_fields> scale{};     ///< Σ of the largest terms of each row
  std::array<double, MultisymplecticSystem::most_fields>
      moved{};  ///< Σ of the largest |S''_rf| times the largest |z_f|
};

/// One thread's arrays of a block: per field A and D_a of the point, the same of the rate, ∇S, S and S''.
struct Workspace {
  grids::Buffer memory;
  formula::BatchEvaluator gradient, hessian;
  formula::RoundingEvaluator size;
  std::vector<double> cell, cell_error, sizes;
  std::vector<double*> mean, rate_mean, outputs;
  std::vector<std::array<double*, 3>> difference, rate_difference;
  std::vector<const double*> inputs;
};

/// max |values|, NaN left out; eight side by side so that it vectorises.
RUBATO_WIDE_VECTORS double largest(const double* values, std::size_t count) {
  double partial[8] = {};
  std::size_t i = 0;
  for (; i + 8 <= count; i += 8) {
    for (std::size_t l = 0; l < 8; ++l) {
      const double size = std::abs(values[i + l]);
      partial[l] = size > partial[l] ? size : partial[l];
    }
  }
  double result = 0.0;
  for (; i < count; ++i) {
    result = std::max(result, std::abs(values[i]));
  }
  for (const double part : partial) {
    result = std::max(result, part);
  }
  return result;
}

/// out += factor · values.
RUBATO_WIDE_VECTORS void add(double factor, const double* values, std::size_t count, double* out) {
  for (std::size_t i = 0; i < count; ++i) {
    out[i] += factor * values[i];
  }
}

/// out += factor · a · b · c.
RUBATO_WIDE_VECTORS void add(double factor, const double* a, const double* b, const double* c, std::size_t count,
                             double* out) {
  for (std::size_t i = 0; i < count; ++i) {
    out[i] += factor * a[i] * b[i] * c[i];
  }
}

/// out += factor · a · b.
RUBATO_WIDE_VECTORS void add(double factor, const double* a, const double* b, std::size_t count, double* out) {
  for (std::size_t i = 0; i < count; ++i) {
    out[i] += factor * a[i] * b[i];
  }
}

/// Of sum(): its eight partial sums, and that of the cells at the end of a block that do not fill eight.
constexpr std::size_t lane_sums = 9;

/// What sum() of a whole block comes to when cells of a piece of it are added to those before.
void add_in_lanes(const double* values, const CellBlocks::Block& at, std::span<double> partial) {
  const std::size_t rest = at.whole / 8 * 8;
  for (std::size_t i = 0; i < at.count; ++i) {
    const std::size_t place = at.place + i;
    partial[place < rest ? place % 8 : 8] += values[i];
  }
}
double sum_of_lanes(std::span<const double> partial) {
  double result = partial[8];
  for (const double part : partial.first(8)) {
    result += part;
  }
  return result;
}

/// Σ values, eight partial sums side by side so that it vectorises.
RUBATO_WIDE_VECTORS double sum(const double* values, std::size_t count) {
  double partial[8] = {};
  std::size_t i = 0;
  for (; i + 8 <= count; i += 8) {
    for (std::size_t l = 0; l < 8; ++l) {
      partial[l] += values[i + l];
    }
  }
  double result = 0.0;
  for (; i < count; ++i) {
    result += values[i];
  }
  for (const double part : partial) {
    result += part;
  }
  return result;
}

}  // namespace

struct CellSweep::Storage {
  MultisymplecticSystem system;
  SharedCellBlocks blocks;
  BoxGather gather;
  int d, dimensions;
  std::size_t nodes;
  double volume;
  double inverse_spacing[3] = {};
  MatrixTerms M, constant_hessian;
  PlacedCoordinates places;
  std::vector<MatrixTerms> K, K_plus;
  /// Of each field, along each direction: what the equation takes, and what the energy.
  std::vector<std::array<bool, 3>> differentiated, in_energy;
  std::vector<BlockResult> results;
  std::vector<std::unique_ptr<Workspace>> workspaces;
  /// Of a piece of a block, of a line that ranks share: what is summed up, cell by cell, and what run_block() finds.
  struct Piece {
    std::array<std::array<double, block_size>, rows_by_node> terms;
    std::vector<double> sizes;
  };
  std::vector<Piece> pieces;  ///< of the first and of the last block that are here
  /// At nodes and in elements: what is made of point and rate before the blocks are run.
  struct Made {
    std::vector<grids::FieldSet> derivative;  ///< along each axis
    grids::FieldSet mean;                     ///< in elements
  };
  /// At corners, and of a slab whose blocks are not those of the whole: what is summed over the grid, node by node, as
  /// ranks that share a lattice have to.
  grids::FieldSet by_node;
  std::unique_ptr<NodeDerivative> nodal;
  std::unique_ptr<ElementOperators> elements;
  Made of_point, of_rate;

  Storage(const MultisymplecticSystem& s, const grids::Grid& grid, Collocation collocation)
      : system(s),
        blocks(grid, collocation == Collocation::cells),
        gather(grid),
        d(s.field_count()),
        dimensions(grid.dimensions()),
        nodes(grid.size()),
        volume(grid.cell_volume()),
        M(terms_of(s.M())),
        constant_hessian(terms_of(s.constant_hessian())),
        places(s, grid, collocation.points == Collocation::Points::cells ? Within::centre : Within::node),
        differentiated(static_cast<std::size_t>(d)),
        in_energy(static_cast<std::size_t>(d)),
        results(blocks.count()) {
    for (int a = 0; a < dimensions; ++a) {
      inverse_spacing[a] = 1.0 / grid.spacing(a);
      K.push_back(terms_of(s.K(a)));
      K_plus.push_back(terms_of(s.structure().K_plus[static_cast<std::size_t>(a)]));
      for (const MatrixTerm& term : K.back()) {
        differentiated[static_cast<std::size_t>(term.column)][static_cast<std::size_t>(a)] = true;
      }
      for (const MatrixTerm& term : K_plus.back()) {
        in_energy[static_cast<std::size_t>(term.row)][static_cast<std::size_t>(a)] = true;
      }
    }
    if (collocation.has_elements()) {
      elements = std::make_unique<ElementOperators>(grid, collocation.stages);
      places = elements->space().places(s, grid);
    } else if (collocation != Collocation::cells) {
      nodal = std::make_unique<NodeDerivative>(grid, collocation);
    }
    if (collocation == Collocation::corners || (grids::Slab::of(grid) != nullptr && !blocks.are_of_whole())) {
      by_node = grids::FieldSet(rows_by_node, grid.size());
    }
    if (blocks.are_of_whole()) {
      pieces.assign(2, {.terms = {}, .sizes = std::vector<double>(size_count())});
    }
  }

  /// Of the sizes that a block's rows are judged by, largest absolute values, the places of those of ∇S, of the rate,
  /// of A z and D_a z of each field, and of each varying entry of S''.
  ///@{
  [[nodiscard]] std::size_t size_of_gradient(int f) const { return static_cast<std::size_t>(f); }
  [[nodiscard]] std::size_t size_of_rate(int f) const { return static_cast<std::size_t>(d + f); }
  [[nodiscard]] std::size_t size_of_mean(int f) const { return static_cast<std::size_t>(2 * d + f); }
  [[nodiscard]] std::size_t size_of_difference(int f, std::size_t a) const {
    return static_cast<std::size_t>(d) * (3 + a) + static_cast<std::size_t>(f);
  }
  [[nodiscard]] std::size_t size_of_entry(std::size_t e) const {
    return static_cast<std::size_t>(d) * (3 + static_cast<std::size_t>(dimensions)) + e;
  }
  [[nodiscard]] std::size_t size_count() const { return size_of_entry(system.varying_hessian().size()); }
  ///@}
  [[nodiscard]] Piece& piece(std::size_t block) { return pieces[block == 0 ? 0 : 1]; }
  /// The sum of a block's cells: of a piece's what it is made of, for later.
  [[nodiscard]] double sum_or_keep(std::size_t block, std::size_t row, const double* values) {
    const CellBlocks::Block at = blocks[block];
    if (!at.is_piece()) {
      return sum(values, at.count);
    }
    std::copy_n(values, at.count, piece(block).terms[row].begin());
    return 0.0;
  }
  /// Adds the terms of a piece to those before, as sum() does.
  [[nodiscard]] double go_on_in_lanes(std::size_t block, std::size_t row, std::span<double> partial) {
    add_in_lanes(piece(block).terms[row].data(), blocks[block], partial);
    return sum_of_lanes(partial);
  }

  [[nodiscard]] bool sums_by_node() const { return by_node.fields() > 0; }
  /// Σ over the grid of the rows of by_node.
  [[nodiscard]] std::array<double, rows_by_node> sums_of_nodes() const {
    std::array<double, rows_by_node> sums{};
    grids::sums_of(
        by_node.size(), [this](std::size_t row, std::size_t i) { return by_node.pointers()[row][i]; }, sums);
    return sums;
  }

  /// \param wanted of each field, which derivatives
  void make(std::span<const double* const> fields, const std::vector<std::array<bool, 3>>& wanted, Made& made) const {
    if (made.derivative.empty() && !fields.empty() && (nodal != nullptr || elements != nullptr)) {
      for (int a = 0; a < dimensions; ++a) {
        made.derivative.emplace_back(d, nodes);
      }
      made.mean = grids::FieldSet(elements != nullptr ? d : 0, nodes);
    }
    for (std::size_t f = 0; f < fields.size(); ++f) {
      if (fields[f] == nullptr) {
        continue;
      }
      const int field = static_cast<int>(f);
      if (elements != nullptr) {
        (*elements)(fields[f], made.mean.field(field).data(),
                    wanted[f][0] ? made.derivative[0].field(field).data() : nullptr);
      }
      for (std::size_t a = 0; nodal != nullptr && a < made.derivative.size(); ++a) {
        if (wanted[f][a]) {
          (*nodal)(static_cast<int>(a), fields[f], made.derivative[a].field(field).data());
        }
      }
    }
  }

  /// Of a cell in sums over the grid.
  [[nodiscard]] double weight_of(std::size_t cell) const {
    return elements == nullptr ? 1.0 : elements->space().weights()[cell];
  }
  void weigh(std::size_t offset, std::size_t count, double* values) const {
    for (std::size_t c = 0; elements != nullptr && c < count; ++c) {
      values[c] *= weight_of(offset + c);
    }
  }
  /// Σ of energy and of the quadratic form; where wanted, residuals, scales and what moves them, of each row, and
  /// whether a block has something that is not finite (1).
  struct Totals {
    std::array<double, 2> sums{};
    std::array<double, 1 + 3 * MultisymplecticSystem::most_fields> largest{};
  };
  template <class GoOn>
  [[nodiscard]] Totals totals(std::size_t maxima, std::size_t carried, const GoOn& go_on) const {
    Totals all;
    const auto rows = static_cast<std::size_t>(d);
    const auto sum_of = [this](std::size_t block, std::size_t r) {
      return r == 0 ? results[block].energy : results[block].quadratic;
    };
    const auto largest_of = [this, rows](std::size_t block, std::size_t r) {
      const BlockResult& result = results[block];
      if (r == 0) {
        return result.finite ? 0.0 : 1.0;
      }
      const std::size_t row = (r - 1) % rows;
      return r <= rows ? result.residual[row] : r <= 2 * rows ? result.scale[row] : result.moved[row];
    };
    blocks.total(carried, go_on, all.sums, sum_of, std::span(all.largest).first(maxima), largest_of);
    return all;
  }

  /// A and D_a of one field on a block.
  void take(const double* field, int f, const Made& made, const CellBlocks::Block& block, double* mean,
            const std::array<double*, 3>& difference) const {
    const std::size_t begin = block.begin, count = block.count, offset = block.offset;
    if (nodal == nullptr && elements == nullptr) {
      gather(field, block.line, begin, count, mean, difference.data());
      return;
    }
    std::copy_n((elements != nullptr ? made.mean.field(f).data() : field) + offset, count, mean);
    for (std::size_t a = 0; a < made.derivative.size(); ++a) {
      if (difference[a] != nullptr) {
        std::copy_n(made.derivative[a].field(f).data() + offset, count, difference[a]);
      }
    }
  }

  void prepare_workspaces() {
    while (workspaces.size() < static_cast<std::size_t>(grids::thread_count())) {
      workspaces.push_back(make_workspace());
    }
  }

  /// Calls use(block, workspace) for every block of cells, in parallel.
  template <class Use>
  void for_each_block(Use&& use) {
    prepare_workspaces();
    grids::for_each_index(blocks.count(), blocks.count() > 8,
                          [&](std::size_t block, std::size_t thread) { use(block, *workspaces[thread]); });
  }

  std::unique_ptr<Workspace> make_workspace() const {
    auto work = std::make_unique<Workspace>();
    const std::size_t varying = system.varying_hessian().size();
    const auto fields = static_cast<std::size_t>(d);
    const std::size_t arrays = 2 * fields * (1 + static_cast<std::size_t>(dimensions)) + 1 + fields + varying;
    work->memory = grids::Buffer(arrays * block_size);
    double* next = work->memory.data();
    const auto take = [&next] { return std::exchange(next, next + block_size); };
    for (std::size_t f = 0; f < fields; ++f) {
      work->mean.push_back(take());
      work->rate_mean.push_back(take());
      auto& difference = work->difference.emplace_back();
      auto& rate_difference = work->rate_difference.emplace_back();
      for (std::size_t a = 0; a < static_cast<std::size_t>(dimensions); ++a) {
        difference[a] = differentiated[f][a] ? take() : nullptr;
        rate_difference[a] = differentiated[f][a] ? take() : nullptr;
      }
      work->inputs.push_back(work->mean.back());
    }
    work->inputs.resize(fields + places.count());
    for (std::size_t j = 0; j < 1 + fields + varying; ++j) {
      work->outputs.push_back(take());
    }
    work->gradient = formula::BatchEvaluator(system.gradient_code());
    work->hessian = formula::BatchEvaluator(system.hessian_code());
    work->size = formula::RoundingEvaluator(system.size_code());
    work->cell.resize(work->inputs.size());
    work->cell_error.resize(work->inputs.size());
    work->sizes.resize(size_count());
    return work;
  }

  /// What a sweep has and shows.
  struct Wanted {
    bool rate, residual, hessian;
    double inverse_h;
  };
  void run_block(std::size_t block, Workspace& work, std::span<const double* const> point,
                 const PotentialSlopes& slopes, std::span<const double* const> rate, double inverse_h,
                 std::span<double* const> residual, std::span<double* const> hessian);
  void gather_point(std::size_t block, Workspace& work, std::span<const double* const> point,
                    const PotentialSlopes& slopes) const;
  void energy_size(std::size_t block, Workspace& work, std::span<const double* const> point,
                   const PotentialSlopes& slopes, std::span<const double> references);
  [[nodiscard]] std::vector<double> mean_terms_by_node(std::size_t terms, std::span<const double* const> point,
                                                       const PotentialSlopes& slopes);
  /// The terms of S in cell c of the block that was gathered last.
  static void evaluate_terms(Workspace& work, std::size_t c);
  void energy_change(std::size_t block, Workspace& work, std::span<const double* const> rate, double inverse_h,
                     std::span<const double* const> residual, std::span<const double* const> correction);
  /// Out of the sums Σ (A c)ᵀM A δ/h, -Σ (A c)ᵀR and -Σ (A δ)ᵀR of a block.
  static void change(double work_of_M, double work_of_R, double moved, BlockResult& result);
  void residual_row(int row, std::size_t count, bool with_rate, double inverse_h, const Workspace& work, double* out,
                    BlockResult& result) const;
  void take_sizes(std::size_t count, const Wanted& wanted, Workspace& work) const;
  /// Of a whole block's sizes: Σ of the largest terms of each row, and what the values' last digits change of it by way
  /// of ∇S, over ε.
  void judge_rows(std::span<const double> sizes, const Wanted& wanted, BlockResult& result) const;
  /// What run_block() left undone of a piece.
  void go_on(std::size_t block, const Wanted& wanted, std::span<double> carried);
  [[nodiscard]] std::size_t carried(const Wanted& wanted) const {
    return (wanted.rate ? 2 : 1) * lane_sums + (wanted.residual ? size_count() : 0);
  }
};

/// A and D_a of the point on a block, the potentials' slopes included, and where it is.
void CellSweep::Storage::gather_point(std::size_t block, Workspace& work, std::span<const double* const> point,
                                      const PotentialSlopes& slopes) const {
  const CellBlocks::Block at = blocks[block];
  places.put(at.offset, std::span(work.inputs).subspan(static_cast<std::size_t>(d)));
  for (int f = 0; f < d; ++f) {
    const auto i = static_cast<std::size_t>(f);
    take(point[i], f, of_point, at, work.mean[i], work.difference[i]);
    if (const double slope = slopes.at(f, at.line); slope != 0.0 && work.difference[i][0] != nullptr) {
      for (std::size_t c = 0; c < at.count; ++c) {
        work.difference[i][0][c] += slope;
      }
    }
  }
}

void CellSweep::Storage::run_block(std::size_t block, Workspace& work, std::span<const double* const> point,
                                   const PotentialSlopes& slopes, std::span<const double* const> rate, double inverse_h,
                                   std::span<double* const> residual, std::span<double* const> hessian) {
  const CellBlocks::Block at = blocks[block];
  const std::size_t count = at.count, offset = at.offset;
  BlockResult& result = results[block];
  result = {};

  gather_point(block, work, point, slopes);
  if (!rate.empty()) {
    for (int f = 0; f < d; ++f) {
      const auto i = static_cast<std::size_t>(f);
      if (rate[i] != nullptr) {
        take(rate[i], f, of_rate, at, work.rate_mean[i], work.rate_difference[i]);
      } else {
        std::fill_n(work.rate_mean[i], count, 0.0);
        for (double* difference : work.rate_difference[i]) {
          if (difference != nullptr) {
            std::fill_n(difference, count, 0.0);
          }
        }
      }
    }
  }

  const Wanted wanted = {!rate.empty(), !residual.empty(), !hessian.empty() || !rate.empty(), inverse_h};
  const std::size_t outputs = 1 + static_cast<std::size_t>(d) + (wanted.hessian ? system.varying_hessian().size() : 0);
  (wanted.hessian ? work.hessian : work.gradient)(count, work.inputs,
                                                  std::span<double* const>(work.outputs.data(), outputs));
  double* const* varying = work.outputs.data() + 1 + d;
  for (std::size_t e = 0; e < hessian.size(); ++e) {
    std::copy_n(varying[e], count, hessian[e] + offset);
  }

  if (!residual.empty()) {
    for (int row = 0; row < d; ++row) {
      residual_row(row, count, !rate.empty(), inverse_h, work, residual[static_cast<std::size_t>(row)] + offset,
                   result);
    }
    take_sizes(count, wanted, work);
    if (at.is_piece()) {
      std::ranges::copy(work.sizes, piece(block).sizes.begin());
    } else {
      judge_rows(work.sizes, wanted, result);
    }
  }

  double* density = work.outputs[0];
  for (std::size_t a = 0; a < K_plus.size(); ++a) {
    for (const MatrixTerm& term : K_plus[a]) {
      const double* difference = work.difference[static_cast<std::size_t>(term.row)][a];
      const double* mean = work.mean[static_cast<std::size_t>(term.column)];
      add(term.value, difference, mean, count, density);
    }
  }
  weigh(offset, count, density);
  if (sums_by_node()) {
    std::copy_n(density, count, by_node.field(0).data() + offset);
  } else {
    result.energy = sum_or_keep(block, 0, density);
    result.finite = result.finite && std::isfinite(result.energy);
  }

  if (!rate.empty()) {
    double* form = density;  // no longer needed
    std::fill_n(form, count, 0.0);
    const auto add_product = [&](int row, const double* column, double value) {
      add(value, work.rate_mean[static_cast<std::size_t>(row)], column, count, form);
    };
    for (std::size_t a = 0; a < K.size(); ++a) {
      for (const MatrixTerm& term : K[a]) {
        add_product(term.row, work.rate_difference[static_cast<std::size_t>(term.column)][a], term.value);
      }
    }
    for (const MatrixTerm& term : constant_hessian) {
      add_product(term.row, work.rate_mean[static_cast<std::size_t>(term.column)], -term.value);
    }
    for (std::size_t e = 0; e < system.varying_hessian().size(); ++e) {
      const auto [row, column] = system.varying_hessian()[e];
      const double* left = work.rate_mean[static_cast<std::size_t>(row)];
      const double* right = work.rate_mean[static_cast<std::size_t>(column)];
      const double factor = row == column ? -1.0 : -2.0;
      add(factor, varying[e], left, right, count, form);
    }
    weigh(offset, count, form);
    result.quadratic = sum_or_keep(block, 1, form);
  }
}

void CellSweep::Storage::go_on(std::size_t block, const Wanted& wanted, std::span<double> carried) {
  BlockResult& result = results[block];
  result.energy = go_on_in_lanes(block, 0, carried.first(lane_sums));
  if (wanted.rate) {
    result.quadratic = go_on_in_lanes(block, 1, carried.subspan(lane_sums, lane_sums));
  }
  const auto sizes = carried.last(wanted.residual ? size_count() : 0);
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    sizes[i] = std::max(sizes[i], piece(block).sizes[i]);
  }
  if (blocks[block].ends()) {
    result.finite = result.finite && std::isfinite(result.energy);
    if (wanted.residual) {
      judge_rows(sizes, wanted, result);
    }
  }
}

void CellSweep::Storage::residual_row(int row, std::size_t count, bool with_rate, double inverse_h,
                                      const Workspace& work, double* out, BlockResult& result) const {
  std::copy_n(work.outputs[1 + static_cast<std::size_t>(row)], count, out);
  if (with_rate) {
    for (const MatrixTerm& term : M) {
      if (term.row == row) {
        add(-inverse_h * term.value, work.rate_mean[static_cast<std::size_t>(term.column)], count, out);
      }
    }
  }
  for (std::size_t a = 0; a < K.size(); ++a) {
    for (const MatrixTerm& term : K[a]) {
      if (term.row == row) {
        add(-term.value, work.difference[static_cast<std::size_t>(term.column)][a], count, out);
      }
    }
  }
  result.residual[static_cast<std::size_t>(row)] = largest(out, count);
  result.finite = result.finite && std::isfinite(sum(out, count));
}

void CellSweep::Storage::take_sizes(std::size_t count, const Wanted& wanted, Workspace& work) const {
  for (int f = 0; f < d; ++f) {
    const auto i = static_cast<std::size_t>(f);
    work.sizes[size_of_gradient(f)] = largest(work.outputs[1 + i], count);
    work.sizes[size_of_rate(f)] = wanted.rate ? largest(work.rate_mean[i], count) : 0.0;
    work.sizes[size_of_mean(f)] = largest(work.mean[i], count);
    for (std::size_t a = 0; a < K.size(); ++a) {
      const double* difference = work.difference[i][a];
      work.sizes[size_of_difference(f, a)] = difference != nullptr ? largest(difference, count) : 0.0;
    }
  }
  for (std::size_t e = 0; e < system.varying_hessian().size(); ++e) {
    work.sizes[size_of_entry(e)] =
        wanted.hessian ? largest(work.outputs[1 + static_cast<std::size_t>(d) + e], count) : 0.0;
  }
}

void CellSweep::Storage::judge_rows(std::span<const double> sizes, const Wanted& wanted, BlockResult& result) const {
  for (int row = 0; row < d; ++row) {
    double scale = sizes[size_of_gradient(row)];
    for (const MatrixTerm& term : M) {
      if (wanted.rate && term.row == row) {
        scale += std::abs(wanted.inverse_h * term.value) * sizes[size_of_rate(term.column)];
      }
    }
    for (std::size_t a = 0; a < K.size(); ++a) {
      for (const MatrixTerm& term : K[a]) {
        if (term.row == row) {
          // The difference of two nearly equal values has the rounding error of the values.
          scale += std::abs(term.value) * (sizes[size_of_difference(term.column, a)] +
                                           2.0 * inverse_spacing[a] * sizes[size_of_mean(term.column)]);
        }
      }
    }
    result.scale[static_cast<std::size_t>(row)] = scale;
  }
  if (!wanted.hessian) {
    return;
  }
  const auto move = [&](int row, int column, double derivative) {
    result.moved[static_cast<std::size_t>(row)] += derivative * sizes[size_of_mean(column)];
  };
  for (const MatrixTerm& term : constant_hessian) {
    move(term.row, term.column, std::abs(term.value));
  }
  for (std::size_t e = 0; e < system.varying_hessian().size(); ++e) {
    const auto [row, column] = system.varying_hessian()[e];
    const double derivative = sizes[size_of_entry(e)];
    move(row, column, derivative);
    if (row != column) {
      move(column, row, derivative);
    }
  }
}

void CellSweep::Storage::evaluate_terms(Workspace& work, std::size_t c) {
  for (std::size_t f = 0; f < work.cell.size(); ++f) {
    work.cell[f] = work.inputs[f][c];
    work.cell_error[f] = 2.0 * std::abs(work.cell[f]);  // nodes are rounded, and so are their means
  }
  work.size.run(work.cell, work.cell_error);
}

std::vector<double> CellSweep::Storage::mean_terms_by_node(std::size_t terms, std::span<const double* const> point,
                                                           const PotentialSlopes& slopes) {
  Workspace& work = *workspaces.front();
  std::vector<double> means(terms);
  for (std::size_t first = 0; first < terms; first += rows_by_node) {
    for (std::size_t block = 0; block < blocks.count(); ++block) {
      gather_point(block, work, point, slopes);
      const CellBlocks::Block at = blocks[block];
      for (std::size_t c = 0; c < at.count; ++c) {
        evaluate_terms(work, c);
        for (std::size_t row = 0; row < rows_by_node; ++row) {
          by_node.pointers()[row][at.offset + c] = first + row < terms ? work.size.value(1 + first + row) : 0.0;
        }
      }
    }
    const auto sums = sums_of_nodes();
    for (std::size_t row = 0; row < rows_by_node && first + row < terms; ++row) {
      means[first + row] = sums[row] / static_cast<double>(grids::whole_count(by_node.size()));
    }
  }
  return means;
}

/// `size` becomes Σ |terms - references| of the block, the sum of the cells' errors, that of their squares, Σ |terms|.
void CellSweep::Storage::energy_size(std::size_t block, Workspace& work, std::span<const double* const> point,
                                     const PotentialSlopes& slopes, std::span<const double> references) {
  constexpr double unit = 0.5 * std::numeric_limits<double>::epsilon();
  const CellBlocks::Block at = blocks[block];
  BlockResult& result = results[block];
  result = {};
  if (!at.is_reported) {
    return;
  }
  gather_point(block, work, point, slopes);
  for (std::size_t c = 0; c < at.count; ++c) {
    evaluate_terms(work, c);
    formula::SumSize size;
    double magnitude = 0.0;
    for (std::size_t i = 0; i < references.size(); ++i) {
      size.terms += std::abs(work.size.value(1 + i) - references[i]);
      magnitude += std::abs(work.size.value(1 + i));
    }
    size.rounding = unit * (std::isfinite(work.size.bound(0)) ? work.size.bound(0) : magnitude);
    for (std::size_t a = 0; a < K_plus.size(); ++a) {
      for (const MatrixTerm& term : K_plus[a]) {
        const auto row = static_cast<std::size_t>(term.row);
        const double factor = std::abs(term.value * work.mean[static_cast<std::size_t>(term.column)][c]);
        const double product = factor * std::abs(work.difference[row][a][c]);
        size.terms += product;
        magnitude += product;
        size.rounding += unit * (4.0 * product + 2.0 * factor * inverse_spacing[a] * std::abs(work.mean[row][c]));
      }
    }
    if (sums_by_node()) {
      const std::array<double, rows_by_node> values = {size.terms, size.rounding, size.rounding * size.rounding,
                                                       magnitude};
      for (int row = 0; row < rows_by_node; ++row) {
        by_node.field(row)[at.offset + c] = values[static_cast<std::size_t>(row)];
      }
      continue;
    }
    const double weight = weight_of(at.offset + c);
    size.rounding *= weight;
    const std::array<double, rows_by_node> values = {weight * size.terms, size.rounding, size.rounding * size.rounding,
                                                     weight * magnitude};
    for (std::size_t row = 0; row < values.size(); ++row) {
      if (at.is_piece()) {
        piece(block).terms[row][c] = values[row];
      } else {
        result.size[row] += values[row];
      }
    }
  }
}

void CellSweep::Storage::energy_change(std::size_t block, Workspace& work, std::span<const double* const> rate,
                                       double inverse_h, std::span<const double* const> residual,
                                       std::span<const double* const> correction) {
  const CellBlocks::Block at = blocks[block];
  const std::size_t count = at.count, offset = at.offset;
  const std::array<double*, 3> none{};
  double* twisted = work.outputs[0];    // (A c)ᵀM A δ/h
  double* corrected = work.outputs[1];  // -(A c)ᵀR
  double* moved = work.outputs[2];      // -(A δ)ᵀR
  std::fill_n(twisted, count, 0.0);
  std::fill_n(corrected, count, 0.0);
  std::fill_n(moved, count, 0.0);
  for (int f = 0; f < d; ++f) {
    const auto i = static_cast<std::size_t>(f);
    const double* r = residual[i] + offset;  // -R
    take(correction[i], f, of_rate, at, work.mean[i], none);
    const double* c = work.mean[i];
    add(1.0, c, r, count, corrected);
    if (rate[i] != nullptr) {
      take(rate[i], f, of_rate, at, work.rate_mean[i], none);
      add(1.0, work.rate_mean[i], r, count, moved);
    }
  }
  for (const MatrixTerm& term : M) {
    if (rate[static_cast<std::size_t>(term.column)] != nullptr) {
      const double factor = inverse_h * term.value;
      const double* c = work.mean[static_cast<std::size_t>(term.row)];
      const double* delta = work.rate_mean[static_cast<std::size_t>(term.column)];
      add(factor, c, delta, count, twisted);
    }
  }
  change(sum_or_keep(block, 0, twisted), sum_or_keep(block, 1, corrected), sum_or_keep(block, 2, moved),
         results[block]);
}

void CellSweep::Storage::change(double work_of_M, double work_of_R, double moved, BlockResult& result) {
  result.energy = work_of_M + 0.5 * work_of_R;
  result.quadratic = 4.0 * ((moved - work_of_R) + 2.0 * work_of_M);
}

CellSweep::CellSweep(const MultisymplecticSystem& system, const grids::Grid& grid, Collocation collocation)
    : storage_(std::make_unique<Storage>(system, grid, collocation)) {}
CellSweep::~CellSweep() = default;

SweepResult CellSweep::operator()(std::span<const double* const> point, const PotentialSlopes& slopes,
                                  std::span<const double* const> rate, double inverse_h,
                                  std::span<double* const> residual, std::span<double* const> hessian) {
  Storage& s = *storage_;
  s.make(point, residual.empty() ? s.in_energy : s.differentiated, s.of_point);
  s.make(rate, s.differentiated, s.of_rate);
  s.for_each_block([&](std::size_t block, Workspace& work) {
    s.run_block(block, work, point, slopes, rate, inverse_h, residual, hessian);
  });

  SweepResult total;
  if (s.sums_by_node()) {
    total.energy = s.volume * grids::sum(std::as_const(s.by_node).field(0));
    if (residual.empty() && rate.empty()) {
      total.finite = std::isfinite(total.energy);
      return total;
    }
  }
  const auto rows = static_cast<std::size_t>(s.d);
  const Storage::Wanted wanted = {!rate.empty(), !residual.empty(), !hessian.empty() || !rate.empty(), inverse_h};
  const Storage::Totals totals =
      s.totals(wanted.residual ? 1 + 3 * rows : 1, s.carried(wanted),
               [&](std::size_t block, std::span<double> carried) { s.go_on(block, wanted, carried); });
  const auto residuals = std::span(totals.largest).subspan(1, rows),
             scales = std::span(totals.largest).subspan(1 + rows),
             moved = std::span(totals.largest).subspan(1 + 2 * rows);
  if (!s.sums_by_node()) {
    total.energy = s.volume * totals.sums[0];
  }
  total.finite = totals.largest[0] == 0.0 && std::isfinite(total.energy);
  total.quadratic = s.volume * totals.sums[1];
  for (std::size_t r = 0; r < rows; ++r) {
    if (residuals[r] > 0.0) {
      total.residual = std::max(total.residual, residuals[r] / scales[r]);
      total.backward_error = std::max(total.backward_error, residuals[r] / (scales[r] + moved[r]));
    }
  }
  return total;
}

EnergyChange CellSweep::energy_change(std::span<const double* const> rate, double inverse_h,
                                      std::span<const double* const> residual,
                                      std::span<const double* const> correction) {
  Storage& s = *storage_;
  s.for_each_block(
      [&](std::size_t block, Workspace& work) { s.energy_change(block, work, rate, inverse_h, residual, correction); });
  const auto go_on = [&s](std::size_t block, std::span<double> carried) {
    std::array<double, 3> sums;
    for (std::size_t row = 0; row < sums.size(); ++row) {
      sums[row] = s.go_on_in_lanes(block, row, carried.subspan(row * lane_sums, lane_sums));
    }
    Storage::change(sums[0], sums[1], sums[2], s.results[block]);
  };
  const auto [energy, quadratic] = s.totals(0, 3 * lane_sums, go_on).sums;
  return {s.volume * energy, s.volume * quadratic};
}

std::vector<double> CellSweep::mean_terms(std::span<const double* const> point, const PotentialSlopes& slopes) {
  Storage& s = *storage_;
  s.prepare_workspaces();
  s.make(point, s.in_energy, s.of_point);
  Workspace& work = *s.workspaces.front();
  std::vector<double> means(work.size.output_count() - 1, 0.0);
  if (s.sums_by_node()) {
    return s.mean_terms_by_node(means.size(), point, slopes);
  }
  // Ranks do what takes long side by side, and add up one after the other.
  std::vector<double> later;
  for (std::size_t block = 0; block < s.blocks.count(); ++block) {
    const CellBlocks::Block at = s.blocks[block];
    s.gather_point(block, work, point, slopes);
    for (std::size_t c = 0; c < at.count; ++c) {
      s.evaluate_terms(work, c);
      for (std::size_t i = 0; i < means.size(); ++i) {
        const double term = s.weight_of(at.offset + c) * work.size.value(1 + i);
        if (s.blocks.are_of_whole()) {
          later.push_back(term);
        } else {
          means[i] += term;
        }
      }
    }
  }
  s.blocks.in_turn(means, [&] {
    for (std::size_t i = 0; i < later.size(); ++i) {
      means[i % means.size()] += later[i];
    }
  });
  for (double& mean : means) {
    mean /= static_cast<double>(s.blocks.whole_cells());
  }
  return means;
}

formula::SumSize CellSweep::energy_size(std::span<const double* const> point, const PotentialSlopes& slopes,
                                        std::span<const double> references) {
  Storage& s = *storage_;
  s.make(point, s.in_energy, s.of_point);
  s.for_each_block([&](std::size_t block, Workspace& work) { s.energy_size(block, work, point, slopes, references); });
  std::array<double, rows_by_node> sums{};
  double pieces = static_cast<double>(s.blocks.whole_count());
  if (s.sums_by_node()) {
    sums = s.sums_of_nodes();
    pieces = static_cast<double>(grids::whole_count(s.by_node.size())) / block_size;
  } else {
    const auto go_on = [&s](std::size_t block, std::span<double> carried) {
      for (std::size_t row = 0; row < carried.size(); ++row) {
        for (std::size_t c = 0; c < s.blocks[block].count; ++c) {
          carried[row] += s.piece(block).terms[row][c];
        }
        s.results[block].size[row] = carried[row];
      }
    };
    const auto add_block = [&s](std::size_t block, std::span<double> to) {
      for (std::size_t row = 0; s.blocks[block].ends() && row < to.size(); ++row) {
        to[row] += s.results[block].size[row];
      }
    };
    const std::span<double> all = s.blocks.add_up(sums.size(), rows_by_node, go_on, add_block);
    s.blocks.share(all);
    std::ranges::copy(all, sums.begin());
  }
  const auto& [terms, sum, squares, magnitudes] = sums;
  // A block is summed in eight lanes of up to 32 cells, whose partial sums are rounded, too.
  const double summing = std::numeric_limits<double>::epsilon() * magnitudes / std::sqrt(pieces);
  return {.terms = s.volume * terms,
          .cancelled = s.volume * terms,
          .rounding = s.volume * (std::min(sum, 4.0 * std::sqrt(squares)) + summing)};
}

}  // namespace rubato
