#include <rubato/pde/gauss_step.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include <rubato/base/compensated_sum.hpp>
#include <rubato/base/larger.hpp>
#include <rubato/base/limits.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/grids/slab.hpp>
#include <rubato/grids/transposition.hpp>
#include <rubato/grids/whole.hpp>
#include <rubato/pde/level_fields.hpp>
#include <rubato/pde/potential_rest.hpp>
#include <rubato/pde/same_bits.hpp>
#include <rubato/pde/shared_slopes.hpp>
#include <rubato/pde/tuning.hpp>
#include <rubato/solve/small_matrices.hpp>
#include <rubato/variation/tuning.hpp>

namespace rubato {

namespace {

using namespace tuning::gauss_step;
constexpr double drift = drift_in_reach * WaveResolvent::reach;

using Complex = std::complex<double>;

}  // namespace

GaussStep::GaussStep(const MultisymplecticSystem& system, const grids::Grid& grid, int stages,
                     const LatticeLevel& first, SpaceRule space)
    : system_(system),
      grid_(grid),
      tableau_(stages),
      m_(stages),
      d_(system.field_count()),
      at_midpoints_(system.structure().at_midpoints()),
      linear_(Eigen::VectorXd::Zero(d_)),
      space_(grid, space),
      places_(space_.places(system, grid)),
      points_F_(space_, grid, 1),
      fourier_all_(grid, transformed_at_once(grid, d_)) {
  all_.resize(static_cast<std::size_t>(d_));
  std::iota(all_.begin(), all_.end(), 0);
  find_varying_fields();
  set_middle(first);
  compile();
  for (int a = 0; a < grid.dimensions(); ++a) {
    K_.push_back(terms_of(system_.K(a)));
    K_plus_.push_back(terms_of(system_.structure().K_plus[static_cast<std::size_t>(a)]));
  }
  parseval_ = parseval_weights(fourier_all_, grid_);

  M_ = terms_of(system_.M());
  a_inverse_ = tableau_.inverse();
  const GaussTableau::Eigenbasis& basis = tableau_.inverse_eigenbasis();
  eigenvalues_ = basis.values;
  V_ = basis.V;
  V_inverse_ = basis.V_inverse;
  for (int i = 0; i < m_; ++i) {
    for (int j = 0; j < m_; ++j) {
      a_inverse_high_.push_back(a_inverse_.value(i, j));
      a_inverse_low_.push_back(a_inverse_.rest(i, j));
      V_by_rows_.push_back(V_(i, j));
      V_inverse_by_rows_.push_back(V_inverse_(i, j));
    }
  }
  ones_.setZero(m_);
  for (int i = 0; i < m_; ++i) {
    for (int j = 0; j < m_; ++j) {
      ones_[i] += V_inverse_(i, j);
    }
  }
  at_middle_.resize(m_);
  for (int i = 0; i < m_; ++i) {
    at_middle_[i] = tableau_.lagrange(i, 0.5);
  }

  find_derived_fields();

  const std::size_t waves = fourier_all_.modes(), nodes = grid.size();
  const int n = static_cast<int>(F_.size()), kept = static_cast<int>(kept_.size());
  points_F_ = PointTransform(space_, grid, std::max(1, n * m_));
  // No copies: those write, and what is written takes memory.
  const auto fields = [nodes](int count, auto&... sets) { ((sets = grids::FieldSet(count, nodes)), ...); };
  const auto rows = [waves](int count, auto&... sets) { ((sets = WaveRows(count, waves)), ...); };
  fields(d_, high_);
  fields(fourier_all_.fields(), work_);
  fields(n, level_F_, low_F_);
  fields(n * m_, y_, y_last_, point_, rest_grid_);
  rows(kept, level_);
  rows(fourier_all_.fields() + 1, scratch_);
  rows(kept * m_, Y_);
  rows(n * m_, base_F_, rest_, Y_F_);
  rows_F_.resize(static_cast<std::size_t>(n * m_));
  std::iota(rows_F_.begin(), rows_F_.end(), 0);
  transfer_ = PackedMatrices(n * m_, n * m_, waves);
  if (static_cast<std::size_t>(kept * m_ * (kept + n * m_)) * waves <= most_entries_of_maps) {
    base_map_ = PackedMatrices(kept * m_, kept, waves);
    rest_map_ = PackedMatrices(kept * m_, n * m_, waves);
    for (int e = 0; e < m_; ++e) {
      resolvents_.emplace_back(kept, kept, waves);
    }
    rows(kept * m_, base_Y_, right_, resolved_);
  }
  if (m_ > 1) {
    rows(kept * m_, left_);
    rows(m_, rate_);
  }
  weights_.resize(static_cast<std::size_t>(m_ * m_));
}

/// Whether the first wave here is the one that is constant in space.
bool GaussStep::has_mean() const {
  return fourier_all_.modes() > 0 && fourier_all_.wave(0) == std::array<std::ptrdiff_t, 3>{};
}

/// Those of other ranks as well.
double GaussStep::sum_of_waves(double here) const {
  const grids::Transposition* const shared = fourier_all_.transposition();
  return shared == nullptr ? here : shared->slab().sum_over_ranks(here);
}

void GaussStep::find_varying_fields() {
  for (int f = 0; f < d_; ++f) {
    if (is_in_rest(system_, f)) {
      F_.push_back(f);
    }
  }
  if (F_.empty() && !system_.coordinates().empty()) {
    F_.push_back(0);  // S has a term of the coordinates alone
  }
}

/// Those whose row of the equation is Σ (K_a)_fc ∂_a z_c = L_ff z_f and a constant, with fields z_c that are kept.
void GaussStep::find_derived_fields() {
  rows_.assign(static_cast<std::size_t>(d_), 0);
  for (int f = 0; f < d_; ++f) {
    bool follows =
        !at_midpoints_[static_cast<std::size_t>(f)] && std::ranges::find(F_, f) == F_.end() && whole_(f, f) != 0.0;
    for (int c = 0; c < d_; ++c) {
      follows = follows && system_.M()(f, c) == 0.0 && (c == f || whole_(f, c) == 0.0);
      for (int a = 0; a < grid_.dimensions(); ++a) {
        follows = follows && (system_.K(a)(f, c) == 0.0 || !is_derived(c));
      }
    }
    if (follows) {
      rows_[static_cast<std::size_t>(f)] = -1;
    } else {
      rows_[static_cast<std::size_t>(f)] = static_cast<int>(kept_.size());
      kept_.push_back(f);
    }
  }
}

/// L: the constant entries of S''; L̄: of the others the middle of their values, where these are finite.
void GaussStep::set_middle(const LatticeLevel& first) {
  grids::FieldSet at = first.fields;
  copy_level(first.fields, at_midpoints_, at);
  whole_ = middle_hessian(system_, grid_, at);
  L_terms_ = terms_of(system_.constant_hessian());
  Eigen::MatrixXd middle = Eigen::MatrixXd::Zero(static_cast<int>(F_.size()), static_cast<int>(F_.size()));
  for (std::size_t f = 0; f < F_.size(); ++f) {
    for (std::size_t g = 0; g < F_.size(); ++g) {
      middle(static_cast<int>(f), static_cast<int>(g)) =
          whole_(F_[f], F_[g]) - system_.constant_hessian()(F_[f], F_[g]);
    }
  }
  middle_terms_ = terms_of(middle);
  whole_terms_ = terms_of(whole_);
}

/// N and its gradient at the varying fields, the others 0.
void GaussStep::compile() {
  if (!F_.empty()) {
    const PotentialRest rest = rest_of_potential(system_, system_.constant_hessian(), F_);
    rest_value_ = formula::BatchEvaluator(formula::Bytecode(std::array{rest.value}, rest.inputs));
    const formula::Bytecode gradient(formula::gradient(rest.value, rest.variables), rest.inputs);
    rest_gradient_ = formula::BatchEvaluator(gradient);
    rest_rounding_ = LargestRounding(gradient);
  }
  // ∂S/∂z_f of the other fields is linear in z.
  const std::vector<double> slopes = potential_slopes_at_zero(system_);
  for (int f = 0; f < d_; ++f) {
    if (std::ranges::find(F_, f) == F_.end()) {
      linear_[f] = slopes[static_cast<std::size_t>(f)];
    }
  }
}

void GaussStep::add_slopes(const PotentialSlopes& slopes) {
  if (!has_slope(slopes, grid_)) {
    slopes_ = WaveRows();
    return;
  }
  slopes_ = WaveRows(d_, level_.waves());
  grids::FieldSet values(d_, grid_.size());
  const std::size_t line = grid_.cells(0);
  for (int f = 0; f < d_; ++f) {
    for (std::size_t i = 0; i < grid_.size(); ++i) {
      values.field(f)[i] = slopes.at(f, i / line);
    }
  }
  from_grid(std::as_const(values).pointers(), fourier_all_, slopes_);  // those of lines of points
}

void GaussStep::stand(const grids::FieldSet& high, const grids::FieldSet* low, const PotentialSlopes& slopes) {
  ++stamp_;
  solved_ = complete_ = false;
  std::array<const double*, MultisymplecticSystem::most_fields> level{};
  for (const int f : kept_) {
    if (at_midpoints_[static_cast<std::size_t>(f)]) {
      continue;
    }
    level[static_cast<std::size_t>(row_of(f))] = high.field(f).data();
    if (keeps_level_) {
      std::ranges::copy(high.field(f), high_.field(f).begin());
    }
  }
  from_grid(std::span(level).first(kept_.size()), fourier_all_, level_);
  space_.from_nodes(level_);
  if (!space_.spectral() && !F_.empty()) {
    std::array<int, MultisymplecticSystem::most_fields> rows{};
    std::ranges::transform(F_, rows.begin(), [this](int f) { return row_of(f); });
    points_F_.to_points(level_, std::span(rows).first(F_.size()),
                        level_F_.pointers());  // what rounding leaves there is as much as `low` is
  }
  for (std::size_t f = 0; space_.spectral() && f < F_.size(); ++f) {
    const int field = F_[f];
    const bool midpoint = at_midpoints_[static_cast<std::size_t>(field)];
    const auto rest = low_F_.field(static_cast<int>(f));
    if (!midpoint) {  // 0 where it is
      std::ranges::copy(high.field(field), level_F_.field(static_cast<int>(f)).begin());
    }
    if (low == nullptr || midpoint) {
      std::ranges::fill(rest, 0.0);
    } else {
      std::ranges::copy(low->field(field), rest.begin());
    }
  }
  level_sizes_.resize(F_.size());
  changes_.resize(F_.size());
  for (std::size_t f = 0; f < F_.size(); ++f) {
    level_sizes_[f] = grids::max_abs(std::as_const(level_F_).field(static_cast<int>(f)));
  }
  if (stamp_ == 1) {
    add_slopes(slopes);  // no step changes them
  }
}

void GaussStep::linearise(const GaussStep& about) {
  tangent_ = true;
  solved_ = false;
  if (F_.empty()) {
    return;
  }
  compile_curvature();
  evaluate_curvature(about.point_);
}

void GaussStep::begin_at_level() {
  starts_solved_ = false;
  if (newton_) {
    newton_->any_start = false;
  }
  if (F_.empty()) {
    return;
  }
  if (tangent_) {
    y_.fill(0.0);
    static_cast<void>(place_stages({}));
    evaluate_rests();
    return;
  }
  rest_gradient_(grid_.size(), places_.after(std::as_const(level_F_).pointers(), inputs_),
                 rest_grid_.pointers().first(F_.size()));
  points_F_.from_points(std::as_const(rest_grid_).pointers().first(F_.size()), rest_);
  for (int f = static_cast<int>(F_.size()) - 1; f >= 0; --f) {
    for (int i = m_ - 1; i >= 0; --i) {
      if (varying(f, i) != f) {
        std::ranges::copy(std::as_const(rest_.re).field(f), rest_.re.field(varying(f, i)).begin());
        std::ranges::copy(std::as_const(rest_.im).field(f), rest_.im.field(varying(f, i)).begin());
      }
    }
  }
}

RestForecast GaussStep::make_forecast() const {
  return {tableau_, static_cast<int>(F_.size()), level_.waves()};
}

/// R as the polynomial through R of these stages, at those of a step `ratio` times as long.
void GaussStep::continue_rests(double ratio) {
  WaveRows& from = Y_F_;
  std::ranges::copy(std::as_const(rest_.re).all(), from.re.all().begin());
  std::ranges::copy(std::as_const(rest_.im).all(), from.im.all().begin());
  for (int i = 0; i < m_; ++i) {
    for (int j = 0; j < m_; ++j) {
      weights_[static_cast<std::size_t>(i * m_ + j)] = tableau_.lagrange(j, ratio * tableau_.c[i]);
    }
  }
  for (int f = 0; f < static_cast<int>(F_.size()); ++f) {
    const auto row = static_cast<std::size_t>(varying(f, 0));
    mix(m_, m_, weights_.data(), from.re.pointers()[row], rest_.waves(), rest_.re.pointers()[row]);
    mix(m_, m_, weights_.data(), from.im.pointers()[row], rest_.waves(), rest_.im.pointers()[row]);
  }
}

/// rests += factor L̄ ẑ_k at every stage: with -1 R becomes N' - L̄ Z, which names no level.
void GaussStep::add_middle_of_level(double factor, WaveRows& rests) const {
  for (const MatrixTerm& term : middle_terms_) {
    const int row = row_of(F_[static_cast<std::size_t>(term.column)]);
    for (int i = 0; i < m_; ++i) {
      add(factor * term.value, level_.re.field(row).data(), level_.im.field(row).data(), level_.waves(),
          rests.re.field(varying(term.row, i)).data(), rests.im.field(varying(term.row, i)).data());
    }
  }
}

bool GaussStep::begin(RestForecast& forecast, double h, double trial) {
  const auto is_near = [h](double other) {
    const double ratio = other != 0.0 ? h / other : 0.0;
    return ratio > 1.0 / tuning::longest_continuation && ratio < tuning::longest_continuation;
  };
  if (is_near(trial)) {
    continue_trial(h / trial);
  } else if (is_near(forecast.last_h())) {
    continue_from(forecast, h);
  } else {
    begin_at_level();
    return false;
  }
  return true;
}

void GaussStep::continue_trial(double ratio) {
  starts_solved_ = std::abs(ratio - 1.0) <= refined_at;
  if (newton_) {
    newton_->any_start = needs_newton();
    if (newton_->any_start) {
      continue_stages(y_, ratio, false, newton_->start);
    }
  }
  continue_rests(ratio);
}

void GaussStep::continue_from(RestForecast& forecast, double h) {
  starts_solved_ = false;
  const double ratio = h / forecast.last_h();
  if (newton_) {
    newton_->any_start = needs_newton() && newton_->any_kept;
    if (newton_->any_start) {
      continue_stages(newton_->kept, ratio, true, newton_->start);
    }
  }
  forecast.foresee(rest_);
  add_middle_of_level(1.0, rest_);
  if (ratio != 1.0) {
    continue_rests(ratio);
  }
}

bool GaussStep::prepare(double h) {
  const double size = eigenvalues_.cwiseAbs().mean() / std::abs(h);
  const bool is_far = size > drift * radius_ || size * drift < radius_;
  if (is_far) {
    // Without a past one of few, so that steps of nearly the same length take the same resolvent.
    radius_ = is_forgetful_ ? std::pow(drift, std::round(std::log(size) / std::log(drift))) : size;
  }
  if (!has_resolvent()) {
    take_last_resolvent();
    if (!has_resolvent()) {
      resolvent_.emplace(system_, space_.derivatives(), whole_, radius_, kept_);
    }
  }
  if (!is_solvable_) {
    is_solvable_ = grids::agreed_by_all(grid_, resolvent_->status() == Status::success);
  }
  return *is_solvable_;
}

bool GaussStep::has_resolvent() const {
  return resolvent_ && resolvent_->radius() == radius_;
}

void GaussStep::take_last_resolvent() {
  std::swap(resolvent_, last_resolvent_);
  is_solvable_.reset();
  inverted_h_ = maps_h_ = 0.0;
}

bool GaussStep::are_near(double h, double other) {
  return std::abs(h - other) <= nearby * std::abs(other);
}

/// Ŷ_F of the rests.
void GaussStep::iterate_waves() {
  for_each_wave_block(level_.waves(), [&](std::size_t begin, std::size_t end) {
    transfer_.apply(rest_, &base_F_, begin, end - begin, Y_F_);
  });
}

/// The stages z + y_, and y_ - y_last_, what the stages before left of their equation, beside the increments.
GaussStep::Correction GaussStep::place_stages(std::span<const double> largest) {
  const grids::ReductionBlocks pieces(grid_.size());
  std::array<double, grids::ReductionBlocks::most> moved_in, change_in;  // as in wave_energy()
  Correction result;
  std::array<double, 2 * MultisymplecticSystem::most_fields> found{};  // of each field how far it moved, and the change
  for (int f = 0; f < static_cast<int>(F_.size()); ++f) {
    grids::for_each_block(grid_.size(), pieces.block, [&](std::size_t begin, std::size_t end) {
      StageSizes of_block;
      for (int i = 0; i < m_; ++i) {
        const auto row = static_cast<std::size_t>(varying(f, i));
        const StageSizes sizes =
            place_stage(level_F_.field(f).data() + begin, low_F_.field(f).data() + begin, y_.pointers()[row] + begin,
                        y_last_.pointers()[row] + begin, end - begin, point_.pointers()[row] + begin);
        of_block.moved = larger(of_block.moved, sizes.moved);
        of_block.change = larger(of_block.change, sizes.change);
      }
      moved_in[begin / pieces.block] = of_block.moved;
      change_in[begin / pieces.block] = of_block.change;
    });
    double &moved = found[2 * static_cast<std::size_t>(f)], &change = found[2 * static_cast<std::size_t>(f) + 1];
    for (std::size_t b = 0; b < pieces.blocks; ++b) {
      moved = larger(moved, moved_in[b]);
      change = larger(change, change_in[b]);
    }
  }
  if (const grids::Slab* const slab = grids::Slab::of(grid_)) {
    slab->reduce({}, {}, std::span(found).first(2 * F_.size()));
  }
  for (std::size_t f = 0; f < F_.size(); ++f) {
    const double moved = found[2 * f], change = found[2 * f + 1];
    const int field = F_[f];
    const double last = std::exchange(changes_[f], change);
    if (!noise_.empty() && change > 0.5 * last &&
        change <= roundings * epsilon * (level_sizes_[f] + moved + noise_[f])) {
      changes_[f] = 0.0;  // from now on it is
      continue;           // no sign of what the others have to go
    }
    const double scale =
        std::max({largest.empty() ? 0.0 : largest[static_cast<std::size_t>(field)], epsilon * level_sizes_[f], moved});
    result.size = larger(result.size, change == 0.0 ? 0.0 : change / scale);
    if (scale > 0.0) {
      const double values = level_sizes_[f] + moved;
      result.rounding = std::max(result.rounding, roundings * epsilon * values / scale);
    }
  }
  return result;
}

/// rest_grid_ -= L̄ times rows as those of the stages.
void GaussStep::subtract_middle(std::span<const double* const> of) {
  for (const MatrixTerm& term : middle_terms_) {
    for (int i = 0; i < m_; ++i) {
      subtract(term.value, of[static_cast<std::size_t>(varying(term.column, i))], grid_.size(),
               rest_grid_.field(varying(term.row, i)).data());
    }
  }
}

/// R at the stages.
void GaussStep::evaluate_rests() {
  const std::size_t n = F_.size();
  std::array<const double*, MultisymplecticSystem::most_fields> in{};
  std::array<double*, MultisymplecticSystem::most_fields> out{};
  // Stages follow each other in memory; coordinates are those of one.
  const bool together = places_.count() == 0;
  if (tangent_) {
    multiply_by_curvature(std::as_const(point_).pointers());
  }
  for (int i = 0; !tangent_ && i < (together ? 1 : m_); ++i) {
    for (std::size_t f = 0; f < n; ++f) {
      const int row = varying(static_cast<int>(f), i);
      in[f] = std::as_const(point_).field(row).data();
      out[f] = rest_grid_.field(row).data();
    }
    rest_gradient_(together ? static_cast<std::size_t>(m_) * grid_.size() : grid_.size(),
                   places_.after(std::span(in).first(n), inputs_), std::span(out).first(n));
  }
  subtract_middle(std::as_const(y_).pointers());
  points_F_.from_points(std::as_const(rest_grid_).pointers(), rest_);
}

Status GaussStep::iterate_to_fixed_point(std::span<const double> largest) {
  double last = std::numeric_limits<double>::infinity(), before_last = last;
  int idle = 0;
  for (int iteration = 0;; ++iteration) {
    std::swap(y_, y_last_);
    iterate_waves();
    points_F_.to_points(Y_F_, rows_F_, y_.pointers());
    ++iterations_;
    const auto [size, rounding] = place_stages(largest);
    evaluate_rests();
    if (iteration == 0) {
      continue;
    }
    if (iteration > 1 && noise_.empty() && !tangent_ && size > no_contraction * last) {
      measure_noise();
    }
    if (!std::isfinite(size)) {
      // R at the stages before was not: at those that it began with, or the iterates have run away.
      return iteration == 1 ? Status::undefined : Status::not_converged;
    }
    const double contraction = size / last;
    // Of two corrections on average: near the end each has rounding of its own. A field that rounding alone moves can
    // make one of them large: what follows it is no sign.
    const double on_average =
        std::isfinite(before_last) ? std::max(contraction, std::sqrt(size / before_last)) : contraction;
    before_last = std::exchange(last, size);
    // The stages that the step is made of come from the rests of these: the next correction is in them.
    const double next = on_average * size;
    const bool done = size <= enough ||
                      (iteration > 1 && on_average < 1.0 && next <= nearly_enough && on_average * next <= enough) ||
                      (size <= rounding && contraction > 0.5);
    if (!refined_ && (done || size <= refined_at)) {
      refine();
    } else if (done) {
      return Status::success;
    }
    idle = contraction > no_contraction ? idle + 1 : 0;
    if (idle > patience || iteration == most_slab_iterations) {
      return Status::not_converged;
    }
  }
}

Status GaussStep::solve(double h, double accuracy, std::span<const double> largest, bool steady) {
  solved_ = complete_ = false;
  steady_ = steady;
  noise_.clear();
  const bool starts_solved = std::exchange(starts_solved_, false);
  if (!prepare(h)) {
    return Status::undefined;
  }
  invert(h);
  if (!F_.empty()) {
    const bool newton = std::abs(h) >= contracts_again * fixed_point_fails_at_ && since_fixed_point_ < newton_steps;
    Status status = Status::not_converged;
    if (!newton) {
      if (starts_solved) {
        refine();
      }
      status = iterate_to_fixed_point(largest);
      if (status == Status::not_converged) {
        fixed_point_fails_at_ = std::abs(h);
        invert(h);
        begin_at_level();
      } else if (status == Status::success) {
        fixed_point_fails_at_ = std::numeric_limits<double>::infinity();
      }
      since_fixed_point_ = 0;
    }
    if (status == Status::not_converged) {
      ++since_fixed_point_;
      status = solve_by_newton(h, accuracy, largest);
    }
    if (status != Status::success) {
      return status;
    }
  } else {
    refine();
  }
  if (!std::isfinite(grids::max_abs(std::as_const(rest_grid_).all()))) {
    return Status::undefined;
  }
  solved_ = true;
  return Status::success;
}

}  // namespace rubato
