#include <rubato/pde/cell_sweep.hpp>

#include <algorithm>
#include <array>
#include <cmath>

#include <rubato/base/wide_vectors.hpp>
#include <rubato/pde/cell_sweep_storage.hpp>

namespace rubato {

namespace {

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

double CellSweep::Storage::sum_or_keep(std::size_t block, std::size_t row, const double* values) {
  const CellBlocks::Block at = blocks[block];
  if (!at.is_piece()) {
    return sum(values, at.count);
  }
  std::copy_n(values, at.count, piece(block).terms[row].begin());
  return 0.0;
}

double CellSweep::Storage::go_on_in_lanes(std::size_t block, std::size_t row, std::span<double> partial) {
  add_in_lanes(piece(block).terms[row].data(), blocks[block], partial);
  return sum_of_lanes(partial);
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
  s.for_each_block([&](std::size_t block, Storage::Workspace& work) {
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
  s.for_each_block([&](std::size_t block, Storage::Workspace& work) {
    s.energy_change(block, work, rate, inverse_h, residual, correction);
  });
  const auto go_on = [&s](std::size_t block, std::span<double> carried) {
    std::array<double, 3> sums;
    for (std::size_t row = 0; row < sums.size(); ++row) {
      sums[row] = s.go_on_in_lanes(block, row, carried.subspan(row * Storage::lane_sums, Storage::lane_sums));
    }
    Storage::change(sums[0], sums[1], sums[2], s.results[block]);
  };
  const auto [energy, quadratic] = s.totals(0, 3 * Storage::lane_sums, go_on).sums;
  return {s.volume * energy, s.volume * quadratic};
}

}  // namespace rubato
