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

/// Σ_i w_i of the quadratic and linear terms of the waves at the level and row f·stages + i of each field.
double GaussStep::wave_energy(const WaveRows& rows, std::span<const double> weights) const {
  const auto stages = static_cast<int>(weights.size());
  const grids::ReductionBlocks pieces(rows.waves());
  std::array<double, grids::ReductionBlocks::most> partial;  // each is set below, and most are never used
  grids::for_each_block(rows.waves(), pieces.block, [&](std::size_t begin, std::size_t end) {
    WaveBlock left, right;
    CompensatedSum sum;
    std::array<double, wave_block> terms;
    for (std::size_t first = begin; first < end; first += wave_block) {
      const std::size_t count = std::min(wave_block, end - first);
      const auto load = [&](int f, int stage, WaveBlock& to) {
        const double* re = rows.re.field(f * stages + stage).data() + first;
        const double* im = rows.im.field(f * stages + stage).data() + first;
        const double* level_re = level_.re.field(f).data() + first;
        const double* level_im = level_.im.field(f).data() + first;
        add_pair(level_re, re, count, to.re);
        add_pair(level_im, im, count, to.im);
      };
      terms.fill(0.0);
      for (int i = 0; i < stages; ++i) {
        const double weight = weights[static_cast<std::size_t>(i)];
        for (const MatrixTerm& term : L_terms_) {
          load(term.row, i, left);
          load(term.column, i, right);
          add_dot(0.5 * weight * term.value, left.re, left.im, right.re, right.im, count, terms.data());
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
    for (int i = 0; linear_[f] != 0.0 && has_mean() && i < stages; ++i) {
      sum.add(weights[static_cast<std::size_t>(i)] * linear_[f] *
              (level_.re.field(f)[0] + rows.re.field(f * stages + i)[0]));
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
  sum.add(wave_energy(Y_, {tableau_.b.data(), static_cast<std::size_t>(m_)}));
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
void GaussStep::end_rows() {
  complete();
  if (std::exchange(end_known_, true)) {
    return;
  }
  end_.re.fill(0.0);
  end_.im.fill(0.0);
  for (int f = 0; f < d_; ++f) {
    for (int i = 0; i < m_; ++i) {
      const bool at_midpoint = at_midpoints_[static_cast<std::size_t>(f)];
      for (const double weight :
           {at_midpoint ? at_middle_[i] : a_inverse_.end[i], at_midpoint ? 0.0 : a_inverse_.end_rest[i]}) {
        add(weight, std::as_const(Y_.re).field(f * m_ + i).data(), std::as_const(Y_.im).field(f * m_ + i).data(),
            Y_.waves(), end_.re.field(f).data(), end_.im.field(f).data());
      }
    }
  }
}

/// ẑ_{k+1} - ẑ_k, 0 for fields at midpoints; in scratch_ where there are any.
const WaveRows& GaussStep::change_of_levels() {
  end_rows();
  if (std::ranges::find(at_midpoints_, true) == at_midpoints_.end()) {
    return end_;
  }
  WaveRows& change = scratch_;
  std::ranges::copy(std::as_const(end_.re).all(), change.re.all().begin());
  std::ranges::copy(std::as_const(end_.im).all(), change.im.all().begin());
  for (int f = 0; f < d_; ++f) {
    if (at_midpoints_[static_cast<std::size_t>(f)]) {
      std::ranges::fill(change.re.field(f), 0.0);
      std::ranges::fill(change.im.field(f), 0.0);
    }
  }
  return change;
}

double GaussStep::energy_at_end() {
  const WaveRows& level = change_of_levels();
  double energy = wave_energy(level, std::array{1.0});
  if (F_.empty()) {
    energy += rest_energy({});
  } else {
    grids::FieldSet& end = end_F_;
    points_F_.to_points(level, F_, end.pointers());
    for (int f = 0; f < end.fields(); ++f) {
      const auto high = std::as_const(level_F_).field(f), low = std::as_const(low_F_).field(f);
      const auto z = end.field(f);
      for (std::size_t x = 0; x < z.size(); ++x) {
        z[x] = high[x] + (low[x] + z[x]);
      }
    }
    energy += rest_energy(std::as_const(end).pointers());
  }
  return energy;
}

void GaussStep::increment(grids::FieldSet& delta) {
  if (m_ == 1 && space_.spectral()) {  // twice the stage, at the end as at midpoints
    complete();
    to_grid(Y_, all_, fourier_all_, delta.pointers());
    for (double& value : delta.all()) {
      value *= 2.0;
    }
    grids::refresh_ghosts(delta);
    return;
  }
  end_rows();
  if (!space_.spectral()) {
    std::ranges::copy(std::as_const(end_.re).all(), scratch_.re.all().begin());
    std::ranges::copy(std::as_const(end_.im).all(), scratch_.im.all().begin());
    space_.to_nodes(scratch_);
  }
  to_grid(space_.spectral() ? end_ : scratch_, all_, fourier_all_, delta.pointers());
  for (int f = 0; f < d_; ++f) {
    if (at_midpoints_[static_cast<std::size_t>(f)]) {
      for (double& value : delta.field(f)) {
        value *= 2.0;
      }
    }
  }
  grids::refresh_ghosts(delta);
}

}  // namespace rubato
