#include <algorithm>
#include <array>
#include <utility>

#include <rubato/pde/gauss_step.hpp>

/// \file
/// The stages of all fields of a GaussStep from the rests R̂: the linear equations of each wave.

namespace rubato {

/// Ŷ of all fields at all stages.
void GaussStep::complete() {
  if (std::exchange(complete_, true)) {
    return;
  }
  stages_of_rests();
  if (refined_ && m_ > 1 && !by_maps()) {
    for (int row = 0; row < Y_.rows(); ++row) {
      add(1.0, std::as_const(refinement_.re).field(row).data(), std::as_const(refinement_.im).field(row).data(),
          Y_.waves(), Y_.re.field(row).data(), Y_.im.field(row).data());
    }
  }
}

void GaussStep::stages_of_rests() {
  if (by_maps()) {
    for_each_wave_block(level_.waves(), [&](std::size_t begin, std::size_t end) {
      rest_map_.apply(rest_, &base_Y_, begin, end - begin, Y_);
    });
    return;
  }
  const auto right_side = [this](int e, int c, std::size_t begin, std::size_t count, WaveBlock& right) {
    add(ones_[e], std::as_const(base_.re).field(c).data() + begin, std::as_const(base_.im).field(c).data() + begin,
        count, right.re, right.im);
    const auto f = std::ranges::find(F_, c) - F_.begin();
    for (int j = 0; f < std::ssize(F_) && j < m_; ++j) {
      const int row = varying(static_cast<int>(f), j);
      add(V_inverse_(e, j), std::as_const(rest_.re).field(row).data() + begin,
          std::as_const(rest_.im).field(row).data() + begin, count, right.re, right.im);
    }
  };
  solve_on_waves(right_side, Y_);
}

/// Solves (A⁻¹/h ⊗ M + I ⊗ (Σ ik_a K_a - L - L̄)) x = r, with VΛV⁻¹ for A⁻¹.
/// \param right_side (e, c, begin, count, block): adds row e of V⁻¹ times the stages of r of field c
template <typename RightSide>
void GaussStep::solve_on_waves(const RightSide& right_side, WaveRows& x) {
  x.re.fill(0.0);
  x.im.fill(0.0);
  for_each_wave_block(level_.waves(), [&](std::size_t begin, std::size_t end) {
    const std::size_t count = end - begin;
    WaveBlock entry, solution;
    std::array<WaveBlock, MultisymplecticSystem::most_fields> right;
    for (int e = 0; e < m_; ++e) {
      for (int c = 0; c < d_; ++c) {
        WaveBlock& of = right[static_cast<std::size_t>(c)];
        of.clear(count);
        right_side(e, c, begin, count, of);
      }
      for (int r = 0; r < d_; ++r) {
        solution.clear(count);
        for (int c = 0; c < d_; ++c) {
          if (!resolvent_->is_zero(r, c)) {
            const WaveBlock& of = right[static_cast<std::size_t>(c)];
            resolvent_->entry(r, c, eigenvalues_[e] / inverted_h_, inverse_[static_cast<std::size_t>(e)], begin, count,
                              entry.re, entry.im);
            add_product(entry.re, entry.im, of.re, of.im, count, solution.re, solution.im);
          }
        }
        for (int i = 0; i < m_; ++i) {
          const auto to = static_cast<std::size_t>(r * m_ + i);
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
  for (int i = 0; i < m_; ++i) {
    for (int c = 0; c < d_; ++c) {
      std::copy_n(re(base_, c), count, re(left_, c * m_ + i));
      std::copy_n(im(base_, c), count, im(left_, c * m_ + i));
    }
    for (std::size_t f = 0; f < F_.size(); ++f) {
      const int row = varying(static_cast<int>(f), i), to = F_[f] * m_ + i;
      add(1.0, re(rest_, row), im(rest_, row), count, re(left_, to), im(left_, to));
    }
    for (const MatrixTerm& term : whole_terms_) {
      const int from = term.column * m_ + i, to = term.row * m_ + i;
      add(term.value, re(Y_, from), im(Y_, from), count, re(left_, to), im(left_, to));
    }
    for (std::size_t a = 0; a < K_.size(); ++a) {
      for (const MatrixTerm& term : K_[a]) {
        const double *y_re = re(Y_, term.column * m_ + i), *y_im = im(Y_, term.column * m_ + i);
        double *left_re = re(left_, term.row * m_ + i), *left_im = im(left_, term.row * m_ + i);
        for (std::size_t w = 0; w < count; ++w) {
          const double k = term.value * space_.derivatives()[a][begin + w];
          left_re[w] += k * y_im[w];
          left_im[w] -= k * y_re[w];
        }
      }
    }
  }
  const std::size_t waves = Y_.waves();
  const Strided<double> rates = {rate_.re.all().data() + begin, rate_.im.all().data() + begin, waves};
  for (int c = 0; c < d_; ++c) {
    if (std::ranges::none_of(M_, [c](const MatrixTerm& term) { return term.column == c; })) {
      continue;
    }
    const Strided<const double> of = {re(Y_, c * m_), im(Y_, c * m_), waves};
    mix(m_, m_, a_inverse_high_.data(), of, count, rates);
    add_mixed(m_, m_, a_inverse_low_.data(), of, count, rates);
    for (const MatrixTerm& term : M_) {
      for (int i = 0; term.column == c && i < m_; ++i) {
        const int to = term.row * m_ + i;
        add(-term.value / h_, re(rate_, i), im(rate_, i), count, re(left_, to), im(left_, to));
      }
    }
  }
}

/// refinement_ = what solve_on_waves() makes of left_, by the resolvents of the maps.
void GaussStep::resolve_left() {
  const std::size_t waves = level_.waves(), d = static_cast<std::size_t>(d_);
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
      resolvents_[static_cast<std::size_t>(e)].apply_to(0, d_, right_, nullptr, e * d_, begin, count, resolved_,
                                                        e * d_);
    }
    for (std::size_t r = 0; r < d; ++r) {
      mix(m_, m_, V_by_rows_.data(), from(resolved_, r, begin, d), count, to(refinement_, r * m, begin, 1));
    }
  });
}

/// What the stages of these rests lack, which is the same for others near by.
void GaussStep::refine() {
  refined_ = true;
  if (m_ == 1) {
    return;  // A⁻¹ is 2
  }
  stages_of_rests();
  for_each_wave_block(level_.waves(), [&](std::size_t begin, std::size_t end) { evaluate_left(begin, end - begin); });
  const auto right_side = [this](int e, int c, std::size_t begin, std::size_t count, WaveBlock& right) {
    for (int j = 0; j < m_; ++j) {
      add(V_inverse_(e, j), std::as_const(left_.re).field(c * m_ + j).data() + begin,
          std::as_const(left_.im).field(c * m_ + j).data() + begin, count, right.re, right.im);
    }
  };
  if (by_maps()) {
    resolve_left();
    for (int row = 0; row < base_Y_.rows(); ++row) {
      add(1.0, std::as_const(refinement_.re).field(row).data(), std::as_const(refinement_.im).field(row).data(),
          base_Y_.waves(), base_Y_.re.field(row).data(), base_Y_.im.field(row).data());
    }
    take_base_of_varying();
    return;
  }
  solve_on_waves(right_side, refinement_);
  for (int f = 0; f < static_cast<int>(F_.size()); ++f) {
    for (int i = 0; i < m_; ++i) {
      const int row = F_[static_cast<std::size_t>(f)] * m_ + i;
      add(1.0, std::as_const(refinement_.re).field(row).data(), std::as_const(refinement_.im).field(row).data(),
          refinement_.waves(), base_F_.re.field(varying(f, i)).data(), base_F_.im.field(varying(f, i)).data());
    }
  }
}

/// base_F_ of base_Y_.
void GaussStep::take_base_of_varying() {
  for (int f = 0; f < static_cast<int>(F_.size()); ++f) {
    for (int i = 0; i < m_; ++i) {
      const int row = F_[static_cast<std::size_t>(f)] * m_ + i;
      std::ranges::copy(std::as_const(base_Y_.re).field(row), base_F_.re.field(varying(f, i)).begin());
      std::ranges::copy(std::as_const(base_Y_.im).field(row), base_F_.im.field(varying(f, i)).begin());
    }
  }
}

}  // namespace rubato
