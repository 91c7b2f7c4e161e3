#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <rubato/pde/cell_sweep_storage.hpp>

/// \file
/// The terms of the energy of a sweep: their means, their size, and what rounding makes of their sum.

namespace rubato {

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
    if (sizes_by_node()) {
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

std::vector<double> CellSweep::mean_terms(std::span<const double* const> point, const PotentialSlopes& slopes) {
  Storage& s = *storage_;
  s.prepare_workspaces();
  s.make(point, s.in_energy, s.of_point);
  Storage::Workspace& work = *s.workspaces.front();
  std::vector<double> means(work.size.output_count() - 1, 0.0);
  if (s.sizes_by_node()) {
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
  s.for_each_block(
      [&](std::size_t block, Storage::Workspace& work) { s.energy_size(block, work, point, slopes, references); });
  std::array<double, Storage::rows_by_node> sums{};
  double pieces = static_cast<double>(s.blocks.whole_count());
  if (s.sizes_by_node()) {
    sums = s.sums_of_nodes();
    pieces = static_cast<double>(grids::whole_count(s.by_node.size())) / Storage::block_size;
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
    const std::span<double> all = s.blocks.add_up(sums.size(), Storage::rows_by_node, go_on, add_block);
    s.blocks.share(all);
    std::ranges::copy(all, sums.begin());
  }
  const auto& [terms, sum, squares, magnitudes] = sums;
  // A block is summed in eight lanes of up to 32 cells, whose partial sums are rounded, too.
  const double summing = std::numeric_limits<double>::epsilon() * magnitudes / std::sqrt(pieces);
  return {.terms = s.volume * terms,
          .cancelled = s.volume * terms,
          .rounding = s.volume * (std::min(sum, 4.0 * std::sqrt(squares)) + summing),
          .magnitudes = s.volume * magnitudes};
}

}  // namespace rubato
