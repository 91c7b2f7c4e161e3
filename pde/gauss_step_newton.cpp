#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include <rubato/grids/reductions.hpp>
#include <rubato/grids/slab.hpp>
#include <rubato/pde/gauss_step.hpp>
#include <rubato/pde/potential_rest.hpp>
#include <rubato/pde/tuning.hpp>

/// \file
/// Newton's method for the stages of a GaussStep, for steps in which its fixed-point iteration does not contract.

namespace rubato {

namespace {

using namespace tuning::slab_newton;

}  // namespace

/// N'' as a function of F, by rows.
void GaussStep::compile_curvature() {
  if (curvature_.fields() > 0) {
    return;
  }
  const PotentialRest rest = rest_of_potential(system_, system_.constant_hessian(), F_);
  std::vector<formula::Expression> entries;
  for (const formula::Expression& slope : formula::gradient(rest.value, rest.variables)) {
    const auto row = formula::gradient(slope, rest.variables);
    entries.insert(entries.end(), row.begin(), row.end());
  }
  rest_curvature_ = formula::BatchEvaluator(formula::Bytecode(entries, rest.inputs));
  curvature_ = grids::FieldSet(static_cast<int>(entries.size()) * m_, grid_.size());
}

void GaussStep::evaluate_curvature(const grids::FieldSet& stages) {
  constexpr int most = MultisymplecticSystem::most_fields;
  std::array<const double*, most> in{};
  std::array<double*, most * most> out{};
  const auto n = static_cast<int>(F_.size());
  for (int i = 0; i < m_; ++i) {
    for (int f = 0; f < n; ++f) {
      in[static_cast<std::size_t>(f)] = stages.field(varying(f, i)).data();
    }
    for (int e = 0; e < n * n; ++e) {
      out[static_cast<std::size_t>(e)] = curvature_.field(e * m_ + i).data();
    }
    rest_curvature_(grid_.size(), places_.after(std::span(in).first(F_.size()), inputs_),
                    std::span(out).first(static_cast<std::size_t>(n * n)));
  }
}

/// rest_grid_ = N'' times rows as those of the stages.
void GaussStep::multiply_by_curvature(std::span<const double* const> of) {
  const int n = static_cast<int>(F_.size());
  rest_grid_.fill(0.0);
  for (int f = 0; f < n; ++f) {
    for (int g = 0; g < n; ++g) {
      for (int i = 0; i < m_; ++i) {
        const auto entry = std::as_const(curvature_).field((f * n + g) * m_ + i);
        const double* from = of[static_cast<std::size_t>(varying(g, i))];
        const auto to = rest_grid_.field(varying(f, i));
        for (std::size_t x = 0; x < to.size(); ++x) {
          to[x] += entry[x] * from[x];
        }
      }
    }
  }
}

/// T(b + R) - Y at the stages placed last, and its Euclidean norm.
double GaussStep::evaluate_residual() {
  evaluate_rests();
  iterate_waves();
  ++iterations_;
  grids::FieldSet& residual = newton_->residual;
  points_F_.to_points(Y_F_, rows_F_, residual.pointers());
  const auto y = std::as_const(y_).all();
  const auto r = residual.all();
  for (std::size_t i = 0; i < r.size(); ++i) {
    r[i] -= y[i];
  }
  return std::sqrt(grids::dot(std::as_const(residual).all(), std::as_const(residual).all()));
}

/// out = in - T (N'' - L̄) in.
void GaussStep::apply_newton_matrix(const double* in, double* out) {
  std::vector<const double*>& rows = newton_->rows;
  for (std::size_t r = 0; r < rows.size(); ++r) {
    rows[r] = in + r * grid_.size();
  }
  multiply_by_curvature(rows);
  subtract_middle(rows);
  points_F_.from_points(std::as_const(rest_grid_).pointers(), rest_);
  for_each_wave_block(level_.waves(), [&](std::size_t begin, std::size_t end) {
    transfer_.apply(rest_, nullptr, begin, end - begin, Y_F_);
  });
  ++iterations_;
  points_F_.to_points(Y_F_, rows_F_, newton_->image.pointers());
  const auto image = std::as_const(newton_->image).all();
  for (std::size_t i = 0; i < image.size(); ++i) {
    out[i] = in[i] - image[i];
  }
}

void GaussStep::make_newton() {
  if (newton_) {
    return;
  }
  if (!tangent_) {
    compile_curvature();
  }
  newton_.emplace(Newton{solve::Gmres(y_.all().size(), krylov_vectors), y_, y_, y_, y_, y_, false, false, {}});
  newton_->rows.resize(rows_F_.size());
}

void GaussStep::keep(RestForecast& forecast) {
  WaveRows& rests = forecast.next();
  rests.re.copy_from(rest_.re);
  rests.im.copy_from(rest_.im);
  add_middle_of_level(-1.0, rests);
  forecast.add(h_);
  if (newton_) {
    newton_->any_kept = needs_newton();
    if (newton_->any_kept) {
      newton_->kept.copy_from(y_);
    }
  }
}

/// The polynomial through 0 at 0 and the stages at c_i, at the stages of a step that begins where it begins, or ends:
/// there less what it comes to.
void GaussStep::continue_stages(const grids::FieldSet& from, double ratio, bool at_its_end, grids::FieldSet& to) {
  const auto basis = [&](int j, double at) { return tableau_.lagrange(j, at) * (at / tableau_.c[j]); };
  for (int i = 0; i < m_; ++i) {
    for (int j = 0; j < m_; ++j) {
      const double at = ratio * tableau_.c[i];
      weights_[static_cast<std::size_t>(i * m_ + j)] = at_its_end ? basis(j, 1.0 + at) - basis(j, 1.0) : basis(j, at);
    }
  }
  to.copy_from(from);
  for (int f = 0; f < static_cast<int>(F_.size()); ++f) {
    mix(m_, m_, weights_.data(), from.pointers()[static_cast<std::size_t>(varying(f, 0))], grid_.size(),
        to.pointers()[static_cast<std::size_t>(varying(f, 0))]);
  }
}

/// What rounding of N' at the stages placed last makes of each varying field: a field that is 0 but for that has no
/// other size, and its corrections never shrink.
void GaussStep::measure_noise() {
  std::array<double, MultisymplecticSystem::most_fields> of_rest{};
  std::array<const double*, MultisymplecticSystem::most_fields> in{};
  const std::size_t n = F_.size();
  for (int i = 0; i < m_; ++i) {
    for (std::size_t f = 0; f < n; ++f) {
      in[f] = std::as_const(point_).field(varying(static_cast<int>(f), i)).data();
    }
    rest_rounding_(grid_.size(), places_.after(std::span(in).first(n), inputs_), std::span(of_rest).first(n));
  }
  noise_.assign(n, 0.0);
  for (int f = 0; f < static_cast<int>(n); ++f) {
    double& sum = noise_[static_cast<std::size_t>(f)];
    for (int i = 0; i < m_; ++i) {
      double of_stage = 0.0;
      for (int g = 0; g < static_cast<int>(n); ++g) {
        for (int j = 0; j < m_; ++j) {
          of_stage += transfer_.largest(varying(f, i), varying(g, j)) * of_rest[static_cast<std::size_t>(g)];
        }
      }
      sum = std::max(sum, of_stage);
    }
    if (const grids::Slab* const slab = grids::Slab::of(grid_)) {
      sum = slab->largest_over_ranks(sum);
    }
  }
}

/// From what is known, or through steps from the same level that double until they are h: what a long step has for
/// stages is too far from the level for Newton's method, and the linear part alone says little of it.
Status GaussStep::solve_by_newton(double h, double accuracy, std::span<const double> largest) {
  make_newton();
  if (newton_->any_start) {
    y_.copy_from(newton_->start);
    const Status status = iterate_by_newton(accuracy, largest);
    if (status == Status::success) {
      return status;
    }
  }
  int doublings = 0;
  Status status = Status::not_converged;
  while (status != Status::success && doublings < most_doublings) {
    const double shorter = std::ldexp(h, -++doublings);
    if (!prepare(shorter)) {
      return Status::undefined;
    }
    invert(shorter);
    begin_at_level();
    status = iterate_to_fixed_point(largest);
  }
  while (status == Status::success && doublings > 0) {
    const double longer = std::ldexp(h, -(--doublings));
    if (!prepare(longer)) {
      return Status::undefined;
    }
    invert(longer);
    continue_stages(y_, 2.0, false, newton_->start);
    y_.copy_from(newton_->start);
    status = iterate_by_newton(accuracy, largest);
  }
  return status;
}

/// From the stages y_.
Status GaussStep::iterate_by_newton(double accuracy, std::span<const double> largest) {
  y_last_.copy_from(y_);
  static_cast<void>(place_stages(largest));
  double residual = evaluate_residual(), last = std::numeric_limits<double>::infinity();
  const auto matrix = [this](const double* in, double* out) { apply_newton_matrix(in, out); };
  bool done = false;
  for (int count = 0; count < most_slab_corrections; ++count) {
    if (!std::isfinite(residual)) {
      return Status::undefined;
    }
    if (!refined_ && (done || residual == 0.0 || last <= refined_at)) {
      refine();
      residual = evaluate_residual();
    }
    if (residual == 0.0) {
      return Status::success;
    }
    if (!tangent_) {
      evaluate_curvature(point_);
    }
    grids::FieldSet& correction = newton_->correction;
    correction.fill(0.0);
    const double tolerance = std::clamp(last, finest_solve, coarsest_solve);
    const solve::GmresOutcome solved =
        newton_->gmres.solve(matrix, std::as_const(newton_->residual).all(), correction.all(),
                             {.tolerance = tolerance, .acceptable = 0.5, .max_iterations = most_krylov_iterations});
    if (solved.status != Status::success) {
      return solved.status == Status::undefined ? solved.status : Status::not_converged;
    }
    y_last_.copy_from(y_);
    const double before = residual;
    Correction made;
    for (double part = 1.0;; part *= 0.5) {
      const auto y = y_.all();
      const auto from = std::as_const(y_last_).all(), by = std::as_const(correction).all();
      for (std::size_t i = 0; i < y.size(); ++i) {
        y[i] = from[i] + part * by[i];
      }
      made = place_stages(largest);
      residual = evaluate_residual();
      if (residual < before || made.size <= small_correction) {
        break;
      }
      if (part <= shortest_part) {
        return Status::not_converged;
      }
    }
    if (noise_.empty() && !tangent_ && made.size > 0.5 * last) {
      measure_noise();
    }
    // The next correction is as much smaller as what it is to mend, or as this was: what hardly makes a residual, as a
    // slow motion of all, is given by the second alone.
    const double next = made.size * std::max(residual / before, made.size / last);
    done = made.size <= newton_done || next <= std::max({newton_done, 1e-3 * accuracy, unfelt_part * made.rounding}) ||
           (made.size <= certainly_rounding && residual > 0.5 * before);
    if (done && refined_) {
      return Status::success;
    }
    last = made.size;
  }
  return Status::not_converged;
}

}  // namespace rubato
