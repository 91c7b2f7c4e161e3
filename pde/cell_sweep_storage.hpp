#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include <rubato/formula/batch.hpp>
#include <rubato/formula/rounding.hpp>
#include <rubato/grids/buffer.hpp>
#include <rubato/grids/parallel.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/pde/box_gather.hpp>
#include <rubato/pde/cell_blocks.hpp>
#include <rubato/pde/cell_sweep.hpp>
#include <rubato/pde/matrix_terms.hpp>
#include <rubato/pde/node_derivative.hpp>
#include <rubato/pde/placed_coordinates.hpp>
#include <rubato/pde/space_collocation.hpp>
#include <rubato/pde/tuning.hpp>

namespace rubato {

/// What a sweep works with: the terms of the equation, the blocks of cells, and each thread's arrays of a block.
struct CellSweep::Storage {
  static constexpr std::size_t block_size = CellBlocks::most;
  static constexpr int rows_by_node = tuning::cell_sweep::rows_by_node;
  /// Of the sum of a block: its eight partial sums, and that of the cells at its end that do not fill eight.
  static constexpr std::size_t lane_sums = 9;

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

  MultisymplecticSystem system;
  SharedCellBlocks blocks;
  BoxGather gather;
  int d, dimensions;
  std::size_t nodes;
  double volume;
  double inverse_spacing[3] = {};
  std::size_t cells[3] = {1, 1, 1};
  bool at_corners;
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
  /// With spectral derivatives and in elements: what is made of point and rate before the blocks are run.
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

  Storage(const MultisymplecticSystem& s, const grids::Grid& grid, Collocation collocation);

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
  [[nodiscard]] double sum_or_keep(std::size_t block, std::size_t row, const double* values);
  /// Adds the terms of a piece to those before, as sum() does.
  [[nodiscard]] double go_on_in_lanes(std::size_t block, std::size_t row, std::span<double> partial);

  [[nodiscard]] bool sums_by_node() const { return by_node.fields() > 0; }
  /// The same of the sizes of energies, and of their terms: alone, block by block, they need no arrays.
  [[nodiscard]] bool sizes_by_node() const { return sums_by_node() && grids::Slab::of(by_node.size()) != nullptr; }
  /// Σ over the grid of the rows of by_node.
  [[nodiscard]] std::array<double, rows_by_node> sums_of_nodes() const {
    std::array<double, rows_by_node> sums{};
    grids::sums_of(
        by_node.size(), [this](std::size_t row, std::size_t i) { return by_node.pointers()[row][i]; }, sums);
    return sums;
  }

  /// \param wanted of each field, which derivatives
  void make(std::span<const double* const> fields, const std::vector<std::array<bool, 3>>& wanted, Made& made) const;

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
    if (at_corners) {
      std::copy_n(field + offset, count, mean);
      for (int a = 0; a < dimensions; ++a) {
        if (double* const out = difference[static_cast<std::size_t>(a)]; out != nullptr) {
          take_backward_difference(field, a, block, out);
        }
      }
      return;
    }
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

  /// δ⁻ along an axis.
  void take_backward_difference(const double* field, int axis, const CellBlocks::Block& block, double* out) const;

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

  [[nodiscard]] std::unique_ptr<Workspace> make_workspace() const;

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

}  // namespace rubato
