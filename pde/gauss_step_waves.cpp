#include <algorithm>
#include <array>
#include <complex>
#include <utility>

#include <rubato/grids/slab.hpp>
#include <rubato/grids/whole.hpp>
#include <rubato/pde/gauss_step.hpp>

/// \file
/// The linear equations of each wave of a GaussStep: its matrices, and the stages of all fields from the rests R̂.

namespace rubato {

/// Calls use(e, r, c, entry, begin, count) for the entries of the resolvent at each eigenvalue for steps of length
/// reference_h_, on a block of waves: row and column are the r-th and the c-th of `fields`. Those that are 0 are left
/// out.
template <typename Use>
void GaussStep::for_each_entry(std::span<const int> fields, const Use& use) {
  for_each_wave_block(level_.waves(), [&](std::size_t begin, std::size_t end) {
    const std::size_t count = end - begin;
    WaveBlock entry, inverse;
    for (int e = 0; e < m_; ++e) {
      const std::complex<double> mu = eigenvalues_[e] / reference_h_;
      resolvent_->inverse(mu, begin, count, inverse);
      for (std::size_t r = 0; r < fields.size(); ++r) {
        for (std::size_t c = 0; c < fields.size(); ++c) {
          if (!resolvent_->is_zero(fields[r], fields[c])) {
            resolvent_->entry(fields[r], fields[c], mu, begin, count, entry);
            multiply(inverse.re, inverse.im, count, entry.re, entry.im);
            use(e, static_cast<int>(r), static_cast<int>(c), entry, begin, count);
          }
        }
      }
    }
  });
}

/// b ↦ Y and N' ↦ Y for steps of length reference_h_: what complete() does otherwise with the entries of the resolvent.
void GaussStep::make_maps() {
  maps_h_ = reference_h_;
  base_map_.clear();
  rest_map_.clear();
  for (PackedMatrices& resolvent : resolvents_) {
    resolvent.clear();
  }
  for_each_entry(kept_, [this](int e, int r, int c, const WaveBlock& entry, std::size_t begin, std::size_t count) {
    resolvents_[static_cast<std::size_t>(e)].add(r, c, 1.0, entry.re, entry.im, begin, count);
    const auto g = std::ranges::find(F_, kept_[static_cast<std::size_t>(c)]) - F_.begin();
    for (int i = 0; i < m_; ++i) {
      base_map_.add(r * m_ + i, c, V_(i, e) * ones_[e], entry.re, entry.im, begin, count);
      for (int j = 0; g < std::ssize(F_) && j < m_; ++j) {
        rest_map_.add(r * m_ + i, varying(static_cast<int>(g), j), V_(i, e) * V_inverse_(e, j), entry.re, entry.im,
                      begin, count);
      }
    }
  });
}

/// N' ↦ Y_F for steps of length reference_h_.
void GaussStep::make_transfer() {
  transfer_.clear();
  for_each_entry(F_, [this](int e, int f, int g, const WaveBlock& entry, std::size_t begin, std::size_t count) {
    for (int i = 0; i < m_; ++i) {
      for (int j = 0; j < m_; ++j) {
        transfer_.add(varying(f, i), varying(g, j), V_(i, e) * V_inverse_(e, j), entry.re, entry.im, begin, count);
      }
    }
  });
}

/// base_F_ and transfer_ for steps of length h, or one near by: what these miss is mended by refine(), with the h that
/// is meant.
void GaussStep::invert(double h) {
  if (m_ == 1 || !are_near(h, reference_h_)) {
    reference_h_ = h;
  }
  h_ = h;
  refined_ = false;
  if (std::exchange(inverted_h_, reference_h_) != reference_h_) {
    make_transfer();
  }
  if (!by_maps()) {
    base_F_.re.fill(0.0);
    base_F_.im.fill(0.0);
    solve_on_waves([this](auto&&... of) { add_base(of...); }, F_, base_F_);
    return;
  }
  if (reference_h_ != maps_h_) {
    make_maps();
  }
  for_each_wave_block(level_.waves(), [&](std::size_t begin, std::size_t end) {
    for (const int c : kept_) {
      write_base(c, begin, end - begin, right_.re.field(row_of(c)).data() + begin,
                 right_.im.field(row_of(c)).data() + begin);
    }
    base_map_.apply(right_, nullptr, begin, end - begin, base_Y_);
  });
  take_base_of_varying();
}

/// Calls add_term(a, factor, c) for the terms factor ∂_a z_c that value z_f is, of a derived field, but for a constant.
template <typename Add>
void GaussStep::add_derived(double value, int field, const Add& add_term) const {
  for (std::size_t a = 0; a < K_.size(); ++a) {
    for (const MatrixTerm& term : K_[a]) {
      if (term.row == field) {
        add_term(a, value * term.value / whole_(field, field), term.column);
      }
    }
  }
}

/// Adds value ẑ_k of a field on some waves.
void GaussStep::add_level(double value, int field, std::size_t begin, std::size_t count, double* re, double* im) const {
  const auto part = [begin](const grids::FieldSet& rows, int row) { return rows.field(row).data() + begin; };
  if (!is_derived(field)) {
    add(value, part(level_.re, row_of(field)), part(level_.im, row_of(field)), count, re, im);
    return;
  }
  add_derived(value, field, [&](std::size_t a, double factor, int c) {
    add_derivative(factor, space_.derivatives()[a].data() + begin, part(level_.re, row_of(c)),
                   part(level_.im, row_of(c)), count, re, im);
    if (a == 0 && slopes_.rows() > 0) {
      add(factor, part(slopes_.re, c), part(slopes_.im, c), count, re, im);
    }
  });
  if (begin == 0 && !tangent_ && has_mean()) {
    re[0] -= value * linear_[field] / whole_(field, field) * static_cast<double>(grids::whole_of(grid_).size());
  }
}

/// Adds value Ŷ_i of a field.
void GaussStep::add_stage(double value, int field, int stage, std::size_t begin, std::size_t count, double* re,
                          double* im) const {
  const auto part = [begin](const grids::FieldSet& rows, int row) { return rows.field(row).data() + begin; };
  if (!is_derived(field)) {
    add(value, part(Y_.re, row_of(field, stage)), part(Y_.im, row_of(field, stage)), count, re, im);
    return;
  }
  add_derived(value, field, [&](std::size_t a, double factor, int c) {
    add_derivative(factor, space_.derivatives()[a].data() + begin, part(Y_.re, row_of(c, stage)),
                   part(Y_.im, row_of(c, stage)), count, re, im);
  });
}

void GaussStep::write_derived(grids::FieldSet& level) {
  const auto sum_re = scratch_.re.field(0), sum_im = scratch_.im.field(0);
  const auto of_re = scratch_.re.field(1), of_im = scratch_.im.field(1);
  const std::size_t waves = scratch_.waves();
  int known = -1;  // the field whose waves are in `of`
  for (int f = 0; f < d_; ++f) {
    if (!is_derived(f)) {
      continue;
    }
    std::ranges::fill(sum_re, 0.0);
    std::ranges::fill(sum_im, 0.0);
    add_derived(1.0, f, [&](std::size_t a, double factor, int c) {
      if (std::exchange(known, c) != c) {
        from_grid(std::array<const double*, 2>{nullptr, level.field(c).data()}, fourier_all_, scratch_);
      }
      add_derivative(factor, space_.derivatives()[a].data(), of_re.data(), of_im.data(), waves, sum_re.data(),
                     sum_im.data());
      if (a == 0 && slopes_.rows() > 0) {
        add(factor, slopes_.re.field(c).data(), slopes_.im.field(c).data(), waves, sum_re.data(), sum_im.data());
      }
    });
    if (!tangent_ && has_mean()) {
      sum_re[0] -= linear_[f] / whole_(f, f) * static_cast<double>(grids::whole_of(grid_).size());
    }
    to_grid(scratch_, std::array{0}, fourier_all_, std::array{level.field(f).data()});
    grids::refresh_ghosts(level, std::array{f});
  }
}

/// b = (L - Σ ik_a K_a) ẑ - K_x slope + the linear terms of S.
void GaussStep::write_base(int field, std::size_t begin, std::size_t count, double* re, double* im) const {
  std::fill_n(re, count, 0.0);
  std::fill_n(im, count, 0.0);
  for (const MatrixTerm& term : L_terms_) {
    if (term.row == field) {
      add_level(term.value, term.column, begin, count, re, im);
    }
  }
  WaveBlock of;
  for (std::size_t a = 0; a < K_.size(); ++a) {
    for (const MatrixTerm& term : K_[a]) {
      if (term.row != field) {
        continue;
      }
      of.clear(count);
      add_level(1.0, term.column, begin, count, of.re, of.im);
      add_derivative(-term.value, space_.derivatives()[a].data() + begin, of.re, of.im, count, re, im);
      if (a == 0 && slopes_.rows() > 0) {
        add(-term.value, slopes_.re.field(term.column).data() + begin, slopes_.im.field(term.column).data() + begin,
            count, re, im);
      }
    }
  }
  if (begin == 0 && !tangent_ && has_mean()) {
    re[0] += linear_[field] * static_cast<double>(grids::whole_of(grid_).size());
  }
}

/// Ŷ of all fields at all stages.
void GaussStep::complete() {
  if (std::exchange(complete_, true)) {
    return;
  }
  stages_of_rests();
}

void GaussStep::stages_of_rests() {
  if (by_maps()) {
    for_each_wave_block(level_.waves(), [&](std::size_t begin, std::size_t end) {
      rest_map_.apply(rest_, &base_Y_, begin, end - begin, Y_);
    });
    return;
  }
  Y_.re.fill(0.0);
  Y_.im.fill(0.0);
  const auto add_all = [this](int e, int c, std::size_t begin, std::size_t count, WaveBlock& right) {
    add_base(e, c, begin, count, right);
    const auto f = std::ranges::find(F_, c) - F_.begin();
    if (f < std::ssize(F_)) {
      add_stages(e, rest_, varying(static_cast<int>(f), 0), begin, count, right);
    }
    if (refined_ && m_ > 1) {
      add_stages(e, left_, row_of(c, 0), begin, count, right);
    }
  };
  solve_on_waves(add_all, kept_, Y_);
}

/// right += row e of V⁻¹ times b of field c at all stages.
void GaussStep::add_base(int e, int c, std::size_t begin, std::size_t count, WaveBlock& right) const {
  WaveBlock base;
  write_base(c, begin, count, base.re, base.im);
  add(ones_[e], base.re, base.im, count, right.re, right.im);
}

/// The same of rows from `first` on.
void GaussStep::add_stages(int e, const WaveRows& rows, int first, std::size_t begin, std::size_t count,
                           WaveBlock& right) const {
  for (int j = 0; j < m_; ++j) {
    add(V_inverse_(e, j), rows.re.field(first + j).data() + begin, rows.im.field(first + j).data() + begin, count,
        right.re, right.im);
  }
}

/// Solves (A⁻¹/h ⊗ M + I ⊗ (Σ ik_a K_a - L - L̄)) x = r, with VΛV⁻¹ for A⁻¹, where r is 0 in rows of derived fields, and
/// adds x of these fields to the rows.
/// \param add_right (e, c, begin, count, block): adds row e of V⁻¹ times the stages of r of field c
template <typename AddRight>
void GaussStep::solve_on_waves(const AddRight& add_right, std::span<const int> fields, WaveRows& x) {
  for_each_wave_block(level_.waves(), [&](std::size_t begin, std::size_t end) {
    const std::size_t count = end - begin;
    WaveBlock entry, solution, inverse;
    std::array<WaveBlock, MultisymplecticSystem::most_fields> right;
    for (int e = 0; e < m_; ++e) {
      const std::complex<double> mu = eigenvalues_[e] / inverted_h_;
      resolvent_->inverse(mu, begin, count, inverse);
      for (const int c : kept_) {
        WaveBlock& of = right[static_cast<std::size_t>(c)];
        of.clear(count);
        add_right(e, c, begin, count, of);
      }
      for (std::size_t f = 0; f < fields.size(); ++f) {
        const int r = fields[f];
        solution.clear(count);
        for (const int c : kept_) {
          if (!resolvent_->is_zero(r, c)) {
            const WaveBlock& of = right[static_cast<std::size_t>(c)];
            resolvent_->entry(r, c, mu, begin, count, entry);
            add_product(entry.re, entry.im, of.re, of.im, count, solution.re, solution.im);
          }
        }
        multiply(inverse.re, inverse.im, count, solution.re, solution.im);
        for (int i = 0; i < m_; ++i) {
          const std::size_t to = f * static_cast<std::size_t>(m_) + static_cast<std::size_t>(i);
          add(V_(i, e), solution.re, solution.im, count, x.re.pointers()[to] + begin, x.im.pointers()[to] + begin);
        }
      }
    }
  });
}

/// left_ = b + R - (A⁻¹/h ⊗ M + I ⊗ (Σ ik_a K_a - L - L̄)) Y, with A⁻¹ beyond double precision.
void GaussStep::evaluate_left(std::size_t begin, std::size_t count) {
  const auto re = [&](WaveRows& rows, int row) { return rows.re.field(row).data() + begin; };
  const auto im = [&](WaveRows& rows, int row) { return rows.im.field(row).data() + begin; };
  WaveBlock of;
  for (int i = 0; i < m_; ++i) {
    for (const int c : kept_) {
      write_base(c, begin, count, re(left_, row_of(c, i)), im(left_, row_of(c, i)));
    }
    for (std::size_t f = 0; f < F_.size(); ++f) {
      const int row = varying(static_cast<int>(f), i), to = row_of(F_[f], i);
      add(1.0, re(rest_, row), im(rest_, row), count, re(left_, to), im(left_, to));
    }
    for (const MatrixTerm& term : whole_terms_) {
      if (!is_derived(term.row)) {
        const int to = row_of(term.row, i);
        add_stage(term.value, term.column, i, begin, count, re(left_, to), im(left_, to));
      }
    }
    for (std::size_t a = 0; a < K_.size(); ++a) {
      for (const MatrixTerm& term : K_[a]) {
        if (is_derived(term.row)) {
          continue;
        }
        const int to = row_of(term.row, i);
        of.clear(count);
        add_stage(1.0, term.column, i, begin, count, of.re, of.im);
        add_derivative(-term.value, space_.derivatives()[a].data() + begin, of.re, of.im, count, re(left_, to),
                       im(left_, to));
      }
    }
  }
  const std::size_t waves = Y_.waves();
  const Strided<double> rates = {rate_.re.all().data() + begin, rate_.im.all().data() + begin, waves};
  for (const int c : kept_) {
    if (std::ranges::none_of(M_, [c](const MatrixTerm& term) { return term.column == c; })) {
      continue;
    }
    const Strided<const double> from = {re(Y_, row_of(c, 0)), im(Y_, row_of(c, 0)), waves};
    mix(m_, m_, a_inverse_high_.data(), from, count, rates);
    add_mixed(m_, m_, a_inverse_low_.data(), from, count, rates);
    for (const MatrixTerm& term : M_) {
      for (int i = 0; term.column == c && i < m_; ++i) {
        const int to = row_of(term.row, i);
        add(-term.value / h_, re(rate_, i), im(rate_, i), count, re(left_, to), im(left_, to));
      }
    }
  }
}

/// base_Y_ += what left_ makes of Y, by the resolvents of the maps.
void GaussStep::add_left_to_base() {
  const std::size_t waves = level_.waves(), d = kept_.size();
  const auto from = [waves](const WaveRows& rows, std::size_t row, std::size_t begin, std::size_t stride) {
    const std::size_t at = row * waves + begin;
    return Strided<const double>{rows.re.all().data() + at, rows.im.all().data() + at, stride * waves};
  };
  const auto to = [waves](WaveRows& rows, std::size_t row, std::size_t begin, std::size_t stride) {
    const std::size_t at = row * waves + begin;
    return Strided<double>{rows.re.all().data() + at, rows.im.all().data() + at, stride * waves};
  };
  const auto m = static_cast<std::size_t>(m_);
  for_each_wave_block(waves, [&](std::size_t begin, std::size_t end) {
    const std::size_t count = end - begin;
    for (std::size_t c = 0; c < d; ++c) {
      mix(m_, m_, V_inverse_by_rows_.data(), from(left_, c * m, begin, 1), count, to(right_, c, begin, d));
    }
    for (int e = 0; e < m_; ++e) {
      const int rows = static_cast<int>(d);
      resolvents_[static_cast<std::size_t>(e)].apply_to(0, rows, right_, nullptr, e * rows, begin, count, resolved_,
                                                        e * rows);
    }
    for (std::size_t r = 0; r < d; ++r) {
      add_mixed(m_, m_, V_by_rows_.data(), from(resolved_, r, begin, d), count, to(base_Y_, r * m, begin, 1));
    }
  });
}

/// What the stages of these rests lack, which is the same for others near by.
void GaussStep::refine() {
  if (m_ > 1) {  // of one A⁻¹ is 2
    stages_of_rests();
    for_each_wave_block(level_.waves(), [&](std::size_t begin, std::size_t end) { evaluate_left(begin, end - begin); });
    if (by_maps()) {
      add_left_to_base();
      take_base_of_varying();
    } else {
      const auto add_left = [this](int e, int c, std::size_t begin, std::size_t count, WaveBlock& right) {
        add_stages(e, left_, row_of(c, 0), begin, count, right);
      };
      solve_on_waves(add_left, F_, base_F_);
    }
  }
  refined_ = true;
}

/// base_F_ of base_Y_.
void GaussStep::take_base_of_varying() {
  for (int f = 0; f < static_cast<int>(F_.size()); ++f) {
    for (int i = 0; i < m_; ++i) {
      const int row = row_of(F_[static_cast<std::size_t>(f)], i);
      std::ranges::copy(std::as_const(base_Y_.re).field(row), base_F_.re.field(varying(f, i)).begin());
      std::ranges::copy(std::as_const(base_Y_.im).field(row), base_F_.im.field(varying(f, i)).begin());
    }
  }
}

}  // namespace rubato
