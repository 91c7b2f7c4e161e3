#include <algorithm>
#include <array>
#include <utility>

#include <rubato/base/compensated_sum.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/grids/slab.hpp>
#include <rubato/grids/whole.hpp>
#include <rubato/pde/gauss_step.hpp>

/// \file
/// What a solved GaussStep leads to, and its energies.

namespace rubato {

/// Σ_i w_i of the quadratic and linear terms of the waves at the stages, or those at the end.
double GaussStep::wave_energy(std::span<const double> weights, bool at_end) const {
  const auto points = static_cast<int>(weights.size());
  const auto load_at = [&](int f, int i, std::size_t first, std::size_t count, WaveBlock& to) {
    to.clear(count);
    if (!at_end) {
      add_stage(1.0, f, i, first, count, to.re, to.im);
    } else if (!at_midpoints_[static_cast<std::size_t>(f)]) {
      write_change(f, first, count, to.re, to.im);
    }
    add_level(1.0, f, first, count, to.re, to.im);
  };
  const grids::ReductionBlocks pieces(level_.waves());
  std::array<double, grids::ReductionBlocks::most> partial;  // each is set below, and most are never used
  grids::for_each_block(level_.waves(), pieces.block, [&](std::size_t begin, std::size_t end) {
    WaveBlock left, right;
    CompensatedSum sum;
    std::array<double, wave_block> terms;
    for (std::size_t first = begin; first < end; first += wave_block) {
      const std::size_t count = std::min(wave_block, end - first);
      const auto load = [&](int f, int i, WaveBlock& to) { load_at(f, i, first, count, to); };
      terms.fill(0.0);
      for (int i = 0; i < points; ++i) {
        const double weight = weights[static_cast<std::size_t>(i)];
        for (const MatrixTerm& term : L_terms_) {
          load(term.row, i, left);
          if (term.column != term.row) {
            load(term.column, i, right);
          }
          const WaveBlock& other = term.column != term.row ? right : left;
          add_dot(0.5 * weight * term.value, left.re, left.im, other.re, other.im, count, terms.data());
        }
        for (std::size_t a = 0; a < K_plus_.size(); ++a) {
          const double* k = space_.derivatives()[a].data() + first;
          for (const MatrixTerm& term : K_plus_[a]) {
            load(term.row, i, left);
            load(term.column, i, right);
            add_cross(weight * term.value, k, left.re, left.im, right.re, right.im, count, terms.data());
            for (std::size_t w = 0; a == 0 && slopes_.rows() > 0 && w < count; ++w) {
              terms[w] += weight * term.value *
                          (slopes_.re.field(term.row)[first + w] * right.re[w] +
                           slopes_.im.field(term.row)[first + w] * right.im[w]);
            }
          }
        }
      }
      for (std::size_t w = 0; w < count; ++w) {
        sum.add(parseval_[first + w] * terms[w]);
      }
    }
    partial[begin / pieces.block] = sum.value();
  });
  CompensatedSum sum;
  for (std::size_t b = 0; b < pieces.blocks; ++b) {
    sum.add(partial[b]);
  }
  for (int f = 0; f < d_; ++f) {
    for (int i = 0; linear_[f] != 0.0 && has_mean() && i < points; ++i) {
      WaveBlock mean;
      load_at(f, i, 0, 1, mean);
      sum.add(weights[static_cast<std::size_t>(i)] * linear_[f] * mean.re[0]);
    }
  }
  return grid_.cell_volume() * sum_of_waves(sum.value());
}

double GaussStep::rest_energy(std::span<const double* const> fields) {
  if (F_.empty()) {
    return system_.constant() * grid_.cell_volume() * static_cast<double>(grids::whole_of(grid_).size());
  }
  double* const out[] = {work_.field(0).data()};
  rest_value_(grid_.size(), places_.after(fields, inputs_), out);
  for (std::size_t p = 0; p < space_.weights().size(); ++p) {
    out[0][p] *= space_.weights()[p];
  }
  return grid_.cell_volume() * grids::sum(std::as_const(work_).field(0));
}

double GaussStep::energy() {
  complete();
  CompensatedSum sum;
  sum.add(wave_energy({tableau_.b.data(), static_cast<std::size_t>(m_)}, false));
  for (int i = 0; i < m_; ++i) {
    std::array<const double*, MultisymplecticSystem::most_fields> in{};
    for (std::size_t f = 0; f < F_.size(); ++f) {
      in[f] = std::as_const(point_).field(varying(static_cast<int>(f), i)).data();
    }
    sum.add(tableau_.b[i] * rest_energy(std::span(in).first(F_.size())));
  }
  return sum.value();
}

/// ẑ_{k+1} - ẑ_k, and of fields at midpoints their value there.
void GaussStep::write_change(int field, std::size_t begin, std::size_t count, double* re, double* im) const {
  std::fill_n(re, count, 0.0);
  std::fill_n(im, count, 0.0);
  const bool midpoint = at_midpoints_[static_cast<std::size_t>(field)];
  for (int i = 0; i < m_; ++i) {
    for (const double weight :
         {midpoint ? at_middle_[i] : a_inverse_.end[i], midpoint ? 0.0 : a_inverse_.end_rest[i]}) {
      if (weight != 0.0) {
        add_stage(weight, field, i, begin, count, re, im);
      }
    }
  }
}

double GaussStep::energy_at_end() {
  complete();
  double energy = wave_energy(std::array{1.0}, true);
  if (F_.empty()) {
    return energy + rest_energy({});
  }
  const std::size_t n = F_.size();
  for_each_wave_block(level_.waves(), [&](std::size_t begin, std::size_t end) {
    for (std::size_t f = 0; f < n; ++f) {
      double *re = Y_F_.re.pointers()[f] + begin, *im = Y_F_.im.pointers()[f] + begin;
      if (at_midpoints_[static_cast<std::size_t>(F_[f])]) {
        std::fill_n(re, end - begin, 0.0);
        std::fill_n(im, end - begin, 0.0);
      } else {
        write_change(F_[f], begin, end - begin, re, im);
      }
    }
  });
  const std::span<double* const> at_end = rest_grid_.pointers().first(n);
  points_F_.to_points(Y_F_, std::span(rows_F_).first(n), at_end);
  for (std::size_t f = 0; f < n; ++f) {
    const auto high = std::as_const(level_F_).field(static_cast<int>(f)),
               low = std::as_const(low_F_).field(static_cast<int>(f));
    for (std::size_t x = 0; x < grid_.size(); ++x) {
      at_end[f][x] = high[x] + (low[x] + at_end[f][x]);
    }
  }
  return energy + rest_energy(std::as_const(rest_grid_).pointers().first(n));
}

/// The values of rows that `write` gives.
void GaussStep::to_nodes(std::span<const int> fields, const OfWaves& write, std::span<double* const> values) {
  const std::size_t most = static_cast<std::size_t>(fourier_all_.fields());
  for (std::size_t done = 0; done < fields.size(); done += most) {
    const std::size_t count = std::min(most, fields.size() - done);
    for_each_wave_block(level_.waves(), [&](std::size_t begin, std::size_t end) {
      for (std::size_t r = 0; r < count; ++r) {
        write(fields[done + r], begin, end - begin, scratch_.re.pointers()[r] + begin,
              scratch_.im.pointers()[r] + begin);
      }
    });
    space_.to_nodes(scratch_);
    to_grid(scratch_, std::span(all_).first(count), fourier_all_, values.subspan(done, count));
  }
}

void GaussStep::increments(std::span<const int> fields, const std::function<void(int, std::span<double>)>& use) {
  complete();
  const OfWaves write = [this](auto... of) { write_change(of...); };
  const std::size_t most = static_cast<std::size_t>(work_.fields());
  for (std::size_t done = 0; done < fields.size(); done += most) {
    const auto some = fields.subspan(done, std::min(most, fields.size() - done));
    to_nodes(some, write, work_.pointers().first(some.size()));
    grids::refresh_ghosts(work_, std::span<const int>(all_).first(some.size()));
    for (std::size_t r = 0; r < some.size(); ++r) {
      const auto change = work_.field(static_cast<int>(r));
      if (at_midpoints_[static_cast<std::size_t>(some[r])]) {
        std::ranges::transform(change, change.begin(), [](double value) { return 2.0 * value; });
      }
      use(some[r], change);
    }
  }
}

}  // namespace rubato
