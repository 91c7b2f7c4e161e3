#include <rubato/pde/wave_splitting.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <complex>
#include <cstdint>
#include <limits>
#include <numbers>
#include <numeric>
#include <random>
#include <ranges>

#include <fmt/format.h>

#include <rubato/base/compensated_sum.hpp>
#include <rubato/base/larger.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/grids/slab.hpp>
#include <rubato/grids/transposition.hpp>
#include <rubato/grids/whole.hpp>
#include <rubato/pde/lattice_scheme.hpp>
#include <rubato/pde/potential_rest.hpp>
#include <rubato/pde/shared_slopes.hpp>
#include <rubato/pde/tuning.hpp>
#include <rubato/solve/small_matrices.hpp>

namespace rubato {

namespace {

using namespace tuning::wave_splitting;

using Complex = std::complex<double>;
using Eigen::Index;
using Eigen::MatrixXcd;
using Eigen::MatrixXd;
using formula::Expression;

constexpr const char* remedy = "; take lagrangian = \"fourier\" with stages";

/// sinh(√δ τ)/√δ and cosh(√δ τ).
struct Waves {
  Complex sine, cosine;
};
Waves waves_of(Complex delta, double tau) {
  if (std::abs(delta.imag()) <= 1e-14 * std::abs(delta.real()) && delta.real() < 0.0) {
    const double omega = std::sqrt(-delta.real());
    return {std::sin(omega * tau) / omega, std::cos(omega * tau)};
  }
  const Complex root = std::sqrt(delta);
  const Complex x = root * tau;
  const Complex sine = std::abs(x) < 1e-4 ? tau * (1.0 + x * x / 6.0) : std::sinh(x) / root;
  return {sine, std::cosh(x)};
}

/// Of arrays that are no grid's: a slab has no say in it.
double largest_here(std::span<const double> values) {
  const grids::Slab::Shared alone(nullptr);
  return grids::max_abs(values);
}

bool are_same_bits(double a, double b) {
  return std::bit_cast<std::uint64_t>(a) == std::bit_cast<std::uint64_t>(b);
}

/// How many lengths a composition's drifts have.
std::size_t different_drifts(const Composition& composition) {
  std::vector<double> lengths;
  for (const Composition::Part& part : composition.parts) {
    if (part.drift) {
      lengths.push_back(part.length);
    }
  }
  std::ranges::sort(lengths);
  return static_cast<std::size_t>(std::ranges::unique(lengths).begin() - lengths.begin());
}

/// Into rows of zeros: those that stay zero take no memory.
void set_wave(const MatrixXcd& values, std::size_t wave, WaveRows& rows) {
  const auto set = [wave](double value, double* row) {
    if (value != 0.0) {
      row[wave] = value;
    }
  };
  for (Index r = 0; r < values.rows(); ++r) {
    for (Index c = 0; c < values.cols(); ++c) {
      const auto row = static_cast<std::size_t>(r * values.cols() + c);
      set(values(r, c).real(), rows.re.pointers()[row]);
      set(values(r, c).imag(), rows.im.pointers()[row]);
    }
  }
}

/// Sums that are the same for every number of threads: of what add(begin, end, sum) adds for pieces of `count` numbers.
template <typename Add>
CompensatedSum sum_of_pieces(std::size_t count, const Add& add) {
  const grids::ReductionBlocks pieces(count);
  if (pieces.blocks <= 1) {
    CompensatedSum sum;
    add(0, count, sum);
    return CompensatedSum(sum.value());
  }
  std::array<double, grids::ReductionBlocks::most> partial;  // each is set below, and most are never used
  grids::for_each_block(count, pieces.block, [&](std::size_t begin, std::size_t end) {
    CompensatedSum sum;
    add(begin, end, sum);
    partial[begin / pieces.block] = sum.value();
  });
  CompensatedSum sum;
  for (std::size_t b = 0; b < pieces.blocks; ++b) {
    sum.add(partial[b]);
  }
  return sum;
}

}  // namespace

WaveSplitting::WaveSplitting(const MultisymplecticSystem& system, const grids::Grid& grid, Collocation collocation)
    : system_(system),
      grid_(grid),
      collocation_(collocation),
      whole_size_(grids::whole_of(grid).size()),
      cell_volume_(grid.cell_volume()),
      fourier_(grid, transformed_at_once(grid, system.field_count())),
      has_mean_(fourier_.modes() > 0 && fourier_.wave(0) == std::array<std::ptrdiff_t, 3>{}),
      places_(system, grid, Within::node) {
  split_fields();
  L_ = mean_hessian(system, grid, grids::FieldSet(system.field_count(), grid.size()));
  find_translation();
  reduce();
  group_waves();
  compile_rest();
  classify();
  parseval_ = parseval_weights(fourier_, grid);
  find_real_forms();
  find_frequencies();
  find_pairs();
  const std::size_t waves = fourier_.modes(), nodes = grid.size();
  for (WaveRows* const rows : {&x_, &before_, &moved_, &next_, &work_}) {  // no copies: those write, and take memory
    *rows = WaveRows(size(), waves);
  }
  const int n = static_cast<int>(varying_.size());
  rest_rows_ = WaveRows(n, waves);
  first_kick_ = WaveRows(n, waves);
  values_ = grids::FieldSet(n + 1, nodes);
  inputs_ = places_.after(std::as_const(values_).pointers().first(varying_.size()));
  inputs_.push_back(std::as_const(values_).field(n).data());
  outputs_ = grids::FieldSet(n + 1, nodes);
  turned_ = grids::FieldSet(n + 1, nodes);
  moved_begins_with_varying_ = std::ranges::equal(varying_, std::views::iota(0, n));
  propagators_.resize(waves > many_waves ? propagators_of_many_waves : most_propagators);
}

void WaveSplitting::check(const Composition& composition) const {
  if (composition.of_quadratic_kinetic_energy && flow_ == Flow::turn) {
    throw SchemeRefusal(
        fmt::format("the composition {} is of order {} beside kicks alone, and the rest of S turns pairs of fields: "
                    "use {}",
                    composition.name, composition.order, composition_of_order(composition.order).name));
  }
}

void WaveSplitting::split_fields() {
  for (int f = 0; f < system_.field_count(); ++f) {
    const auto& name = system_.fields()[static_cast<std::size_t>(f)];
    if (system_.structure().at_midpoints(f)) {
      throw SchemeRefusal(
          fmt::format("splitting needs a linear part that can be solved for all fields without an equation of motion, "
                      "and {} has none: only a whole step determines it{}",
                      name, remedy));
    }
    (system_.structure().algebraic[static_cast<std::size_t>(f)] ? others_ : evolving_).push_back(f);
  }
  MatrixXd M(size(), size());
  for (int r = 0; r < size(); ++r) {
    for (int c = 0; c < size(); ++c) {
      M(r, c) = system_.M()(evolving_[static_cast<std::size_t>(r)], evolving_[static_cast<std::size_t>(c)]);
    }
  }
  if (rank(M.cast<Complex>()) != M.rows()) {
    throw SchemeRefusal(
        fmt::format("splitting needs as many equations of motion as there are fields with one, and M has rank {} on {} "
                    "fields{}",
                    rank(M.cast<Complex>()), M.rows(), remedy));
  }
  inverse_M_ = solve::quotient(M, MatrixXd::Identity(size(), size())).value();
}

/// A linear term c·x of S moves x by M⁻¹c at a constant rate. Where S'' has no constant entry of what is moved, the
/// waves can be kept from it, and the two flows commute.
void WaveSplitting::find_translation() {
  slope_.assign(system_.fields().size(), 0.0);
  translation_.assign(evolving_.size(), 0.0);
  const std::vector<double> slopes = potential_slopes_at_zero(system_);
  for (int p = 0; p < size(); ++p) {
    const int f = evolving_[static_cast<std::size_t>(p)];
    const double slope = slopes[static_cast<std::size_t>(f)];
    if (is_in_rest(system_, f) || slope == 0.0 || !L_.row(f).isZero(0.0)) {
      continue;
    }
    std::vector<int> moved;
    for (int q = 0; q < size(); ++q) {
      if (inverse_M_(q, p) != 0.0) {
        moved.push_back(evolving_[static_cast<std::size_t>(q)]);
      }
    }
    const auto in_waves = [&](int g) {
      bool any = !system_.constant_hessian().row(g).isZero(0.0);
      for (int a = 0; a < grid_.dimensions(); ++a) {
        any = any || !system_.K(a).row(g).isZero(0.0);
      }
      return any;
    };
    if (std::ranges::any_of(moved, in_waves)) {
      continue;
    }
    slope_[static_cast<std::size_t>(f)] = slope;
    for (const int g : moved) {
      L_.row(g).setZero();
      L_.col(g).setZero();
    }
    for (int q = 0; q < size(); ++q) {
      translation_[static_cast<std::size_t>(q)] += inverse_M_(q, p) * slope;
    }
  }
}

/// Σ ik_a K_a, or what differences make of it: δ⁻ is -(δ⁺)ᵀ, with minus the conjugate symbol.
MatrixXcd WaveSplitting::derivatives_on_wave(std::size_t wave) const {
  const auto k = fourier_.wave(wave);
  MatrixXcd sum = MatrixXcd::Zero(system_.field_count(), system_.field_count());
  for (int a = 0; a < grid_.dimensions(); ++a) {
    const grids::Axis& axis = grids::whole_of(grid_).axis(a);
    const auto number = k[static_cast<std::size_t>(a)];
    if (collocation_ == Collocation::nodes) {
      sum += grids::derivative_symbol(number, axis) * system_.K(a).cast<Complex>();
    } else {
      const double theta = 2.0 * std::numbers::pi * static_cast<double>(number) / static_cast<double>(axis.cells);
      const Complex forward = grids::difference_symbol(theta, axis.spacing());
      const MatrixXcd plus = system_.structure().K_plus[static_cast<std::size_t>(a)].cast<Complex>();
      sum += forward * plus + std::conj(forward) * plus.transpose();
    }
  }
  return sum;
}

/// With x the evolving fields and y the others, B = Σ ik_a K_a - L:  ŷ = -B₂₂⁻¹B₂₁ x̂,  M x̂_t = -(B₁₁ - B₁₂B₂₂⁻¹B₂₁) x̂.
void WaveSplitting::reduce() {
  const Index r = size(), o = static_cast<Index>(others_.size());
  const std::size_t waves = fourier_.modes();
  energy_form_ = WaveRows(static_cast<int>(r * r), waves);
  generator_form_ = WaveRows(static_cast<int>(r * r), waves);
  slaves_ = WaveRows(static_cast<int>(o * r), waves);
  const auto part = [](const MatrixXcd& B, const std::vector<int>& rows, const std::vector<int>& columns) {
    MatrixXcd result(static_cast<Index>(rows.size()), static_cast<Index>(columns.size()));
    for (std::size_t i = 0; i < rows.size(); ++i) {
      for (std::size_t j = 0; j < columns.size(); ++j) {
        result(static_cast<Index>(i), static_cast<Index>(j)) = B(rows[i], columns[j]);
      }
    }
    return result;
  };
  constexpr std::ptrdiff_t none = std::numeric_limits<std::ptrdiff_t>::min();
  std::ptrdiff_t unsolved = none;  // the first wave that is
  for (std::size_t w = 0; w < waves; ++w) {
    const MatrixXcd B = derivatives_on_wave(w) - L_.cast<Complex>();
    MatrixXcd G = -part(B, evolving_, evolving_);
    if (o > 0) {
      const MatrixXcd B22 = part(B, others_, others_);
      const solve::Inverse inverse = solve::equilibrated_inverse_of(B22);
      if (!(inverse.smallest_pivot > 1e-12 * (1.0 + inverse.largest_pivot))) {
        unsolved = fourier_.wave(w)[0];
        break;
      }
      const MatrixXcd C = -solve::product(inverse.matrix, part(B, others_, evolving_));
      G -= solve::product(part(B, evolving_, others_), C);
      set_wave(C, w, slaves_);
    }
    set_wave(G, w, energy_form_);
    set_wave(solve::product(inverse_M_.cast<Complex>(), G), w, generator_form_);
  }
  if (const grids::Transposition* const shared = fourier_.transposition()) {  // all ranks refuse, or none
    const double largest = -std::numeric_limits<double>::max();
    const double wave =
        shared->slab().largest_over_ranks(unsolved == none ? largest : -std::abs(static_cast<double>(unsolved)));
    unsolved = wave == largest ? none : static_cast<std::ptrdiff_t>(-wave);
  }
  if (unsolved != none) {
    throw SchemeRefusal(
        fmt::format("splitting needs a linear part that can be solved for the fields without an equation of motion "
                    "({}, …) wave by wave, and on the wave number {} it cannot{}",
                    system_.fields()[static_cast<std::size_t>(others_.front())], unsolved, remedy));
  }
}

/// Of waves, those of other ranks as well.
double WaveSplitting::largest_of_waves(std::span<const double> values) const {
  const double here = largest_here(values);
  const grids::Transposition* const shared = fourier_.transposition();
  return shared == nullptr ? here : shared->slab().largest_over_ranks(here);
}

double WaveSplitting::sum_of_waves(double here) const {
  const grids::Transposition* const shared = fourier_.transposition();
  return shared == nullptr ? here : shared->slab().sum_over_ranks(here);
}

void WaveSplitting::group_waves() {
  std::vector<int> group(static_cast<std::size_t>(size()));
  std::iota(group.begin(), group.end(), 0);
  for (int r = 0; r < size(); ++r) {
    for (int c = 0; c < size(); ++c) {
      const int row = r * size() + c;
      const bool any = largest_of_waves(std::as_const(generator_form_.re).field(row)) > 0.0 ||
                       largest_of_waves(std::as_const(generator_form_.im).field(row)) > 0.0;
      const int from = group[static_cast<std::size_t>(c)], to = group[static_cast<std::size_t>(r)];
      if (any && from != to) {
        std::ranges::replace(group, from, to);
      }
    }
  }
  for (int g = 0; g < size(); ++g) {
    std::vector<int> members;
    for (int f = 0; f < size(); ++f) {
      if (group[static_cast<std::size_t>(f)] == g) {
        members.push_back(f);
      }
    }
    for (const int a : members) {
      for (const int b : members) {
        coupled_.emplace_back(a, b);
      }
    }
    if (!members.empty()) {
      groups_.push_back(std::move(members));
    }
  }
}

/// Wave equations and Schrödinger's have real A and G: half of the work, and G is symmetric.
void WaveSplitting::find_real_forms() {
  real_pairs_ = largest_of_waves(std::as_const(generator_form_.im).all()) == 0.0 &&
                std::ranges::all_of(groups_, [](const auto& group) { return group.size() <= 2; });
  if (largest_of_waves(std::as_const(energy_form_.im).all()) > 0.0) {
    return;
  }
  for (const auto& [row, column] : coupled_) {
    if (row <= column && largest_of_waves(std::as_const(energy_form_.re).field(row * size() + column)) > 0.0) {
      real_forms_.emplace_back(row, column);
    }
  }
  real_form_weights_ = grids::FieldSet(static_cast<int>(real_forms_.size()) + 1, fourier_.modes());
  for (std::size_t f = 0; f < real_forms_.size(); ++f) {
    const auto [row, column] = real_forms_[f];
    const auto weights = real_form_weights_.field(static_cast<int>(f));
    const auto G = std::as_const(energy_form_.re).field(row * size() + column);
    for (std::size_t w = 0; w < weights.size(); ++w) {
      weights[w] = (row == column ? 0.5 : 1.0) * parseval_[w] * G[w];
    }
  }
  if (!real_forms_.empty()) {
    energy_form_ = WaveRows();
  }
}

/// N = S - ½ zᵀLz at the fields that S'' varies with, or that S has a linear term of; the others 0.
void WaveSplitting::compile_rest() {
  const std::vector<double> slope = potential_slopes_at_zero(system_);
  const auto varies = [&](int f) {
    return is_in_rest(system_, f) || slope[static_cast<std::size_t>(f)] != slope_[static_cast<std::size_t>(f)];
  };
  for (const int f : others_) {
    if (varies(f)) {
      throw SchemeRefusal(
          fmt::format("splitting needs a rest of S that depends on fields with an equation of motion alone, and beyond "
                      "its quadratic terms with constant coefficients S depends on {}{}",
                      system_.fields()[static_cast<std::size_t>(f)], remedy));
    }
  }
  std::vector<int> fields;
  for (int p = 0; p < size(); ++p) {
    const int f = evolving_[static_cast<std::size_t>(p)];
    if (varies(f)) {
      varying_.push_back(p);
      fields.push_back(f);
    }
  }
  if (fields.empty() && !system_.coordinates().empty()) {  // S has a term of the coordinates alone
    varying_.push_back(0);
    fields.push_back(evolving_.front());
  }
  if (fields.empty()) {  // S is quadratic but for a constant
    const Expression N = rest_of_potential(system_, L_, fields).value;
    const grids::Slab* const slab = grids::Slab::of(grid_);
    const std::size_t nodes = slab != nullptr ? slab->whole().size() : grid_.size();
    constant_rest_ = N.is_constant() ? cell_volume_ * static_cast<double>(nodes) * N.constant_value() : 0.0;
    return;
  }
  const auto [graph, varying, arguments, N] = rest_of_potential(system_, L_, fields);
  std::vector<Expression> outputs = {N};
  const std::vector<Expression> first = formula::gradient(N, varying);
  outputs.insert(outputs.end(), first.begin(), first.end());
  rest_ = formula::BatchEvaluator(formula::Bytecode(outputs, arguments));

  // Where each varying field has one partner, the turn by the angle θ = μτ (p ∂_pN + q ∂_qN)/(p² + q²).
  const Expression tau = graph->variable("the time of a turn");
  std::vector<Expression> turned = {N}, inputs = arguments;
  inputs.push_back(tau);
  for (std::size_t i = 0; i < varying.size(); ++i) {
    const auto is_partner = [&](int place) { return inverse_M_(varying_[i], place) != 0.0; };
    if (std::ranges::none_of(varying_, is_partner)) {
      kicking_.push_back(i);
      turned.push_back(varying[i]);
    }
    for (std::size_t j = 0; j < varying.size(); ++j) {
      const double mu = inverse_M_(varying_[i], varying_[j]);
      if (mu != 0.0) {
        // At 0 nothing is there to turn: the smallest numbers keep the quotient defined.
        const Expression square = varying[i] * varying[i] + varying[j] * varying[j] + 1e-300;
        const Expression theta = mu * tau * ((varying[i] * first[i] + varying[j] * first[j]) / square);
        turned.push_back(varying[i] * cos(theta) + varying[j] * sin(theta));
      }
    }
  }
  if (turned.size() == varying.size() + 1) {
    turns_ = formula::BatchEvaluator(formula::Bytecode(turned, inputs));
    flow_ = Flow::turn;
  }
}

void WaveSplitting::classify() {
  if (varying_.empty()) {
    return;
  }
  bool moves_itself = false;
  for (const int i : varying_) {
    for (const int j : varying_) {
      moves_itself = moves_itself || inverse_M_(i, j) != 0.0;
    }
  }
  if (!moves_itself) {
    flow_ = Flow::kick;
    return;
  }
  if (flow_ == Flow::turn && is_turn()) {
    return;
  }
  throw SchemeRefusal(fmt::format(
      "splitting needs a rest of S whose flow at a node is known: kicks, as of V(u) in a wave equation, or "
      "turns of pairs, as of V(p^2 + q^2); the rest here, in {} and others, is neither{}",
      system_.fields()[static_cast<std::size_t>(evolving_[static_cast<std::size_t>(varying_.front())])], remedy));
}

/// Whether p ∂_qN = q ∂_pN for all pairs: N depends on p² + q² alone.
bool WaveSplitting::is_turn() const {
  constexpr std::size_t points = 32;
  std::mt19937_64 random(20);
  std::uniform_real_distribution<double> value(-1.3, 1.3);
  const auto n = static_cast<int>(varying_.size());
  grids::FieldSet at(n + static_cast<int>(places_.count()), points), outputs(n + 1, points);
  for (double& component : at.all()) {
    component = value(random);
  }
  formula::BatchEvaluator evaluate = rest_;
  evaluate(points, std::as_const(at).pointers(), outputs.pointers());
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) {
      if (inverse_M_(varying_[static_cast<std::size_t>(i)], varying_[static_cast<std::size_t>(j)]) == 0.0) {
        continue;
      }
      double difference = 0.0, size = 0.0;
      for (std::size_t x = 0; x < points; ++x) {
        const double left = at.field(i)[x] * outputs.field(1 + j)[x], right = at.field(j)[x] * outputs.field(1 + i)[x];
        difference = larger(difference, std::abs(left - right));
        size = std::max(size, std::abs(left));
      }
      if (!(difference <= 1e-10 * size)) {
        return false;
      }
    }
  }
  return true;
}

void WaveSplitting::stand(const LatticeLevel& level) {
  for (std::size_t f = 0; f < level.slopes.of_field.size(); ++f) {
    if (has_slope(level.slopes, f, grid_)) {
      throw SchemeRefusal(
          fmt::format("splitting takes no potential with a mean slope, and {} has one{}", system_.fields()[f], remedy));
    }
  }
  std::array<const double*, MultisymplecticSystem::most_fields> from{};
  for (int p = 0; p < size(); ++p) {
    from[static_cast<std::size_t>(p)] = level.fields.field(evolving_[static_cast<std::size_t>(p)]).data();
  }
  from_grid(std::span(from).first(evolving_.size()), fourier_, x_);
  forget();
}

/// After x_ has changed.
void WaveSplitting::forget() {
  rest_at_ = At::nowhere;
  rest_energy_is_known_ = rest_rows_are_known_ = first_kick_is_known_ = first_energy_is_known_ = false;
}

void WaveSplitting::accept() {
  std::swap(before_, x_);
  std::swap(x_, moved_);
  first_kick_is_known_ = rest_rows_are_known_;
  if (rest_rows_are_known_) {  // the fields that N depends on are not moved by a kick
    std::swap(first_kick_, rest_rows_);
  }
  first_energy_is_known_ = rest_energy_is_known_;
  first_energy_ = rest_energy_;
  rest_at_ = rest_at_ == At::led ? At::here : At::nowhere;
  rest_energy_is_known_ = rest_rows_are_known_ = false;
}

void WaveSplitting::save(StateWriter& state) const {
  save_waves(state, fourier_, std::as_const(x_.re));
  save_waves(state, fourier_, std::as_const(x_.im));
  state.write(first_energy_is_known_ ? 1.0 : 0.0);
  state.write(first_energy_is_known_ ? first_energy_ : 0.0);
}
void WaveSplitting::restore(StateReader& state) {
  restore_waves(state, fourier_, x_.re);
  restore_waves(state, fourier_, x_.im);
  forget();
  state.read(first_energy_is_known_);
  state.read(first_energy_);
}

/// Groups of two fields that turn into each other with a frequency for each wave: sines and cosines in vectors.
void WaveSplitting::find_frequencies() {
  const auto A = [&](int row, int column) { return std::as_const(generator_form_.re).field(row * size() + column); };
  frequencies_ = grids::FieldSet();
  if (!real_pairs_ || fourier_.modes() > many_waves) {  // these are filled in several threads
    return;
  }
  grids::FieldSet frequencies(static_cast<int>(groups_.size()), fourier_.modes());
  for (std::size_t g = 0; g < groups_.size(); ++g) {
    const int x = groups_[g].front(), y = groups_[g].back();
    if (x == y || largest_here(A(x, x)) > 0.0 || largest_here(A(y, y)) > 0.0) {
      return;
    }
    for (std::size_t w = 0; w < frequencies.size(); ++w) {
      const double squared = -A(x, y)[w] * A(y, x)[w];
      if (!(squared >= 0.0)) {
        return;
      }
      frequencies.field(static_cast<int>(g))[w] = std::sqrt(squared);
    }
  }
  const std::size_t waves = fourier_.modes();
  grids::FieldSet of_sines(2 * frequencies.fields(), waves);
  for (std::size_t g = 0; g < groups_.size(); ++g) {
    const int x = groups_[g].front(), y = groups_[g].back(), row = 2 * static_cast<int>(g);
    for (std::size_t w = 0; w < waves; ++w) {
      const double omega = std::as_const(frequencies).field(static_cast<int>(g))[w];
      of_sines.field(row)[w] = omega == 0.0 ? A(x, y)[w] : A(x, y)[w] / omega;
      of_sines.field(row + 1)[w] = omega == 0.0 ? A(y, x)[w] : A(y, x)[w] / omega;
    }
  }
  formula::Graph graph;
  const Expression angle = graph.variable("angle");
  turn_ = formula::BatchEvaluator(formula::Bytecode(std::array{cos(angle), sin(angle)}, std::array{angle}));
  frequencies_ = std::move(frequencies);
  of_sines_ = std::move(of_sines);
  at_once_ = std::clamp<std::size_t>(angles_at_once / std::max<std::size_t>(1, waves), 1, most_drifts);
  angles_ = grids::FieldSet(3, (at_once_ * waves + 7) / 8 * 8);  // whole vectors
}

void WaveSplitting::fill_by_frequencies(std::span<const std::size_t> places) {
  const std::size_t waves = fourier_.modes();
  double* const angle = angles_.field(0).data();
  const double *const cosine = std::as_const(angles_).field(1).data(), *const sine =
                                                                           std::as_const(angles_).field(2).data();
  for (std::size_t first = 0; first < places.size(); first += at_once_) {
    const auto some = places.subspan(first, std::min(at_once_, places.size() - first));
    for (std::size_t g = 0; g < groups_.size(); ++g) {
      const double* const omega = std::as_const(frequencies_).field(static_cast<int>(g)).data();
      for (std::size_t i = 0; i < some.size(); ++i) {
        rubato::multiply(propagators_[some[i]].tau, omega, waves, angle + i * waves);
      }
      const double* const in[] = {angle};
      double* const out[] = {angles_.field(1).data(), angles_.field(2).data()};
      turn_((some.size() * waves + 7) / 8 * 8, in, out);
      const int row = 2 * static_cast<int>(g);
      for (std::size_t i = 0; i < some.size(); ++i) {
        Propagator& E = propagators_[some[i]];
        const int x = groups_[g].front(), y = groups_[g].back();
        make_turns(E.tau, omega, cosine + i * waves, sine + i * waves, std::as_const(of_sines_).field(row).data(),
                   std::as_const(of_sines_).field(row + 1).data(), waves, turns(E.entries.re, x, y),
                   turns(E.rests, x, y));
      }
    }
  }
}

void WaveSplitting::fill(double tau, WaveRows& entries) {
  for_each_wave_block(fourier_.modes(), [&](std::size_t begin, std::size_t end) {
    for (const std::vector<int>& members : groups_) {
      const auto n = static_cast<Index>(members.size());
      MatrixXcd A(n, n), E(n, n);
      for (std::size_t w = begin; w < end; ++w) {
        for (Index i = 0; i < n; ++i) {
          for (Index j = 0; j < n; ++j) {
            const int row = members[static_cast<std::size_t>(i)] * size() + members[static_cast<std::size_t>(j)];
            A(i, j) = {generator_form_.re.field(row)[w], generator_form_.im.field(row)[w]};
          }
        }
        if (n == 2) {
          const Complex mean = 0.5 * (A(0, 0) + A(1, 1)), half = 0.5 * (A(0, 0) - A(1, 1));
          const Waves waves = waves_of(half * half + A(0, 1) * A(1, 0), tau);
          const Complex factor = mean == 0.0 ? 1.0 : std::exp(mean * tau);
          E(0, 0) = factor * (waves.cosine + waves.sine * half);
          E(1, 1) = factor * (waves.cosine - waves.sine * half);
          E(0, 1) = factor * waves.sine * A(0, 1);
          E(1, 0) = factor * waves.sine * A(1, 0);
        } else {
          E = solve::exponential_of(tau * A);
        }
        for (Index i = 0; i < n; ++i) {
          for (Index j = 0; j < n; ++j) {
            const auto row = static_cast<std::size_t>(members[static_cast<std::size_t>(i)] * size() +
                                                      members[static_cast<std::size_t>(j)]);
            entries.re.pointers()[row][w] = E(i, j).real();
            if (!real_pairs_) {
              entries.im.pointers()[row][w] = E(i, j).imag();
            }
          }
        }
      }
    }
  });
}

/// With frequencies the two cosines are one row.
PairMatrices WaveSplitting::turns(grids::FieldSet& entries, int x, int y) const {
  const int z = frequencies_.fields() > 0 ? std::min(x, y) : y;
  const int first = frequencies_.fields() > 0 ? z : x;
  const auto entry = [&](int row, int column) {
    return entries.pointers()[static_cast<std::size_t>(row * size() + column)];
  };
  return {entry(first, first), entry(x, y), entry(y, x), entry(z, z)};
}

/// Real pairs whose kick, energy and turn are one pass: where all groups are such, and the energy has no other terms.
void WaveSplitting::find_pairs() {
  const bool splits = real_pairs_ &&
                      std::ranges::all_of(groups_, [](const auto& group) { return group.size() == 2; }) &&
                      std::ranges::all_of(real_forms_, [](const auto& form) { return form.first == form.second; }) &&
                      !real_forms_.empty() && std::ranges::all_of(slope_, [](double slope) { return slope == 0.0; });
  if (!splits) {
    return;
  }
  for (const std::vector<int>& group : groups_) {
    pairs_.push_back({.x = group.front(), .y = group.back()});
  }
  for (std::size_t v = 0; v < varying_.size() && flow_ == Flow::kick; ++v) {
    for (int p = 0; p < size(); ++p) {
      const double rate = inverse_M_(p, varying_[v]);
      if (rate == 0.0) {
        continue;
      }
      const auto pair = std::ranges::find_if(pairs_, [p](const Pair& one) { return one.x == p || one.y == p; });
      if (pair->kicked_by >= 0) {
        loose_kicks_.push_back({p, v, rate});
        continue;
      }
      if (pair->x == p) {
        std::swap(pair->x, pair->y);
      }
      pair->kicked_by = static_cast<int>(v);
      pair->rate = rate;
    }
  }
  const auto weight_of = [this](int place) {  // the last row is zero
    return static_cast<int>(std::ranges::find(real_forms_, std::pair(place, place)) - real_forms_.begin());
  };
  for (Pair& pair : pairs_) {
    pair.weight_of_x = weight_of(pair.x);
    pair.weight_of_y = weight_of(pair.y);
  }
}

void WaveSplitting::make_room(Propagator& propagator) const {
  if (propagator.entries.re.fields() == 0) {
    propagator.entries.re = grids::FieldSet(size() * size(), fourier_.modes());
    propagator.entries.im = grids::FieldSet(real_pairs_ ? 0 : size() * size(), fourier_.modes());
    propagator.rests = grids::FieldSet(real_pairs_ ? size() * size() : 0, fourier_.modes());
  }
}

/// Of the one for this τ, known or to be filled. None that the step under way has found is given away.
std::size_t WaveSplitting::place_of_propagator(double tau) {
  const std::size_t room = propagators_.size();
  for (std::size_t back = 1; back <= room; ++back) {  // the newest first
    const std::size_t place = (replaced_ + room - back) % room;
    if (Propagator& known = propagators_[place]; known.used > 0 && are_same_bits(known.tau, tau)) {
      known.used = steps_prepared_;
      return place;
    }
  }
  std::size_t place = room, passed = 0;
  while (passed < room && propagators_[replaced_ % room].used == steps_prepared_) {
    ++replaced_;
    ++passed;
  }
  if (passed < room) {
    place = replaced_++ % room;
  } else {
    propagators_.emplace_back();
  }
  Propagator& anew = propagators_[place];
  make_room(anew);
  anew.tau = tau;
  anew.used = steps_prepared_;
  missing_.push_back(place);
  return place;
}

void WaveSplitting::fill_missing() {
  if (frequencies_.fields() > 0) {
    fill_by_frequencies(missing_);
  } else {
    for (const std::size_t place : missing_) {
      Propagator& E = propagators_[place];
      fill(E.tau, E.entries);
      for (const std::vector<int>& group : groups_) {
        if (real_pairs_ && group.size() == 2) {
          split_turns(fourier_.modes(), turns(E.entries.re, group.front(), group.back()),
                      turns(E.rests, group.front(), group.back()));
        }
      }
    }
  }
  missing_.clear();
}

/// Products of one length with h have the same bits, be they numbers or not.
void WaveSplitting::make_propagators(const Composition& composition, double h) {
  const std::size_t parts = composition.parts.size();
  bool known = of_parts_.size() == parts;
  for (std::size_t i = 0; i < parts && known; ++i) {
    const Composition::Part& part = composition.parts[i];
    known = !part.drift || are_same_bits(propagators_[of_parts_[i]].tau, part.length * h);
  }
  if (known) {
    return;
  }
  of_parts_.resize(parts);
  missing_.reserve(parts);
  ++steps_prepared_;
  for (std::size_t i = 0; i < parts; ++i) {
    const Composition::Part& part = composition.parts[i];
    of_parts_[i] = part.drift ? place_of_propagator(part.length * h) : 0;
  }
  fill_missing();
}

void WaveSplitting::prepare(const Composition& composition, double h) {
  // Those of a step and, where they are short, of the one tried before it; a step looks for no others.
  propagators_.resize((fourier_.modes() > many_waves ? 1 : 2) * different_drifts(composition));
  for (Propagator& propagator : propagators_) {
    make_room(propagator);
  }
  of_parts_.clear();
  make_propagators(composition, h);
}

/// out = matrix·in, over the coupled pairs.
void WaveSplitting::multiply(const WaveRows& matrix, const WaveRows& in, WaveRows& out) const {
  for_each_wave_block(in.waves(), [&](std::size_t begin, std::size_t end) {
    for (int p = 0; p < size(); ++p) {
      std::fill(out.re.pointers()[static_cast<std::size_t>(p)] + begin,
                out.re.pointers()[static_cast<std::size_t>(p)] + end, 0.0);
      std::fill(out.im.pointers()[static_cast<std::size_t>(p)] + begin,
                out.im.pointers()[static_cast<std::size_t>(p)] + end, 0.0);
    }
    for (const auto& [row, column] : coupled_) {
      const int entry = row * size() + column;
      add_product(matrix.re.field(entry).data() + begin, matrix.im.field(entry).data() + begin,
                  in.re.field(column).data() + begin, in.im.field(column).data() + begin, end - begin,
                  out.re.pointers()[static_cast<std::size_t>(row)] + begin,
                  out.im.pointers()[static_cast<std::size_t>(row)] + begin);
    }
  });
}

/// X_1.
double WaveSplitting::wave_energy(const WaveRows& rows) const {
  CompensatedSum sum = sum_of_pieces(rows.waves(), [&](std::size_t begin, std::size_t end, CompensatedSum& into) {
    alignas(64) std::array<double, wave_block> terms;
    for (std::size_t first = begin; first < end; first += wave_block) {
      const std::size_t count = std::min(wave_block, end - first);
      for (std::size_t f = 0; f < real_forms_.size(); ++f) {
        const auto [row, column] = real_forms_[f];
        into.add(sum_form(real_form_weights_.field(static_cast<int>(f)).data() + first,
                          rows.re.field(row).data() + first, rows.im.field(row).data() + first,
                          rows.re.field(column).data() + first, rows.im.field(column).data() + first, count));
      }
      if (!real_forms_.empty()) {
        continue;
      }
      terms.fill(0.0);
      for (const auto& [row, column] : coupled_) {
        const int entry = row * size() + column;
        const double* g_re = energy_form_.re.field(entry).data() + first;
        const double* g_im = energy_form_.im.field(entry).data() + first;
        const double* l_re = rows.re.field(row).data() + first;
        const double* l_im = rows.im.field(row).data() + first;
        const double* r_re = rows.re.field(column).data() + first;
        const double* r_im = rows.im.field(column).data() + first;
        add_form(g_re, g_im, l_re, l_im, r_re, r_im, count, terms.data());
      }
      into.add(weighted_sum(parseval_.data() + first, terms.data(), count));
    }
  });
  for (int p = 0; p < size(); ++p) {
    const double slope = slope_[static_cast<std::size_t>(evolving_[static_cast<std::size_t>(p)])];
    if (slope != 0.0 && has_mean_) {
      sum.add(slope * rows.re.field(p)[0]);  // Σ x over the nodes
    }
  }
  return cell_volume_ * sum_of_waves(sum.value());
}

/// ΔV Σ N over the nodes. Where ranks share the lattice their sums have the same bits for every number of them; alone
/// it is as exact, in a third of the time: a splitting promises no more than rounding between the two.
double WaveSplitting::node_energy(std::span<const double> N) const {
  if (fourier_.transposition() != nullptr) {
    return cell_volume_ * grids::sum(N);
  }
  const CompensatedSum sum = sum_of_pieces(N.size(), [N](std::size_t begin, std::size_t end, CompensatedSum& into) {
    for (std::size_t first = begin; first < end; first += wave_block) {
      into.add(sum_of_values(N.data() + first, std::min(wave_block, end - first)));
    }
  });
  return cell_volume_ * sum.value();
}

/// N and ∇N of these rows.
bool WaveSplitting::evaluate_rest(const WaveRows& rows, At at) {
  if (varying_.empty()) {
    rest_energy_ = constant_rest_;
    return true;
  }
  if (rest_at_ == at) {
    return std::isfinite(rest_energy_);
  }
  rest_at_ = at;
  rest_energy_is_known_ = at == At::led;
  rest_rows_are_known_ = false;
  const std::size_t n = varying_.size();
  to_grid(rows, varying_, fourier_, values_.pointers().first(n));
  rest_(grid_.size(), std::span(inputs_).first(inputs_.size() - 1), outputs_.pointers());
  rest_energy_ = node_energy(std::as_const(outputs_).field(0));
  return std::isfinite(rest_energy_);
}

/// A kick, X_1 and a turn of all pairs in one pass over the waves.
double WaveSplitting::turn_pairs(const Propagator& E, bool with_energy) {
  // What turns is not written to.
  auto& entries = const_cast<grids::FieldSet&>(E.entries.re);
  auto& rests = const_cast<grids::FieldSet&>(E.rests);
  const std::span<double*const> re = moved_.re.pointers(), im = moved_.im.pointers();
  const auto sum = sum_of_pieces(moved_.waves(), [&](std::size_t begin, std::size_t end, CompensatedSum& into) {
    for (std::size_t i = 0; i < pairs_.size(); ++i) {
      const Pair& pair = pairs_[i];
      const auto x = static_cast<std::size_t>(pair.x), y = static_cast<std::size_t>(pair.y);
      PairMatrices first = turns(entries, pair.x, pair.y), rest = turns(rests, pair.x, pair.y);
      for (std::size_t w = begin; w < end; w += wave_block) {
        BeforeTurn before;
        if (kicking_rows_ != nullptr && pair.kicked_by >= 0) {
          before = {.kick = kicking_tau_ * pair.rate,
                    .re = kicking_rows_->re.field(pair.kicked_by).data() + w,
                    .im = kicking_rows_->im.field(pair.kicked_by).data() + w};
        }
        if (with_energy) {
          before.of_x = std::as_const(real_form_weights_).field(pair.weight_of_x).data() + w;
          before.of_y = std::as_const(real_form_weights_).field(pair.weight_of_y).data() + w;
        }
        into.add(turn_pair({first.a + w, first.b + w, first.c + w, first.d + w},
                           {rest.a + w, rest.b + w, rest.c + w, rest.d + w}, before, std::min(wave_block, end - w),
                           {re[x] + w, im[x] + w, re[y] + w, im[y] + w}));
      }
    }
  });
  kicking_rows_ = nullptr;
  return with_energy ? cell_volume_ * sum_of_waves(sum.value()) : 0.0;
}

/// moved_ goes along the flow of the waves, and of what is linear in S. \return X_1, if it is asked for
double WaveSplitting::drift(const Propagator& E, bool with_energy) {
  rest_at_ = At::nowhere;
  rest_energy_is_known_ = rest_rows_are_known_ = false;
  if (!pairs_.empty()) {
    return turn_pairs(E, with_energy);
  }
  const double energy = with_energy ? wave_energy(moved_) : 0.0;
  if (real_pairs_) {
    auto& all = const_cast<grids::FieldSet&>(E.entries.re);
    auto& rests = const_cast<grids::FieldSet&>(E.rests);
    for (const std::vector<int>& group : groups_) {
      const int x = group.front(), y = group.back();
      if (group.size() == 2) {
        turn_pair(turns(all, x, y), turns(rests, x, y), {}, moved_.waves(),
                  {moved_.re.field(x).data(), moved_.im.field(x).data(), moved_.re.field(y).data(),
                   moved_.im.field(y).data()});
        continue;
      }
      const double* const factor = E.entries.re.field(x * size() + x).data();
      for (std::size_t w = 0; w < moved_.waves(); ++w) {
        moved_.re.field(x)[w] *= factor[w];
        moved_.im.field(x)[w] *= factor[w];
      }
    }
  } else {
    multiply(E.entries, moved_, next_);
    std::swap(moved_, next_);
  }
  for (std::size_t p = 0; p < translation_.size() && has_mean_; ++p) {
    moved_.re.field(static_cast<int>(p))[0] += E.tau * translation_[p] * static_cast<double>(whole_size_);
  }
  return energy;
}

/// The fields that varying field v kicks, by the waves of ∂_vN.
void WaveSplitting::kick_by(std::size_t v, const WaveRows& slopes, double tau) {
  const auto row = static_cast<int>(v);
  for (int p = 0; p < size(); ++p) {
    if (const double rate = inverse_M_(p, varying_[v]); rate != 0.0) {
      add(tau * rate, slopes.re.field(row).data(), slopes.im.field(row).data(), moved_.waves(),
          moved_.re.field(p).data(), moved_.im.field(p).data());
    }
  }
}

/// All of a kick, at once or, where turns take kicks along, in part with the turn that comes next.
void WaveSplitting::kick_before_turn(const WaveRows& slopes, double tau) {
  if (pairs_.empty()) {
    for (std::size_t v = 0; v < varying_.size(); ++v) {
      kick_by(v, slopes, tau);
    }
    return;
  }
  kicking_rows_ = &slopes;
  kicking_tau_ = tau;
  for (const Kick& kick : loose_kicks_) {
    const auto row = static_cast<int>(kick.v);
    add(tau * kick.rate, slopes.re.field(row).data(), slopes.im.field(row).data(), moved_.waves(),
        moved_.re.field(kick.p).data(), moved_.im.field(kick.p).data());
  }
}

/// What of the last kick no turn has taken along.
void WaveSplitting::finish_kick() {
  if (kicking_rows_ == nullptr) {
    return;
  }
  for (const Pair& pair : pairs_) {
    if (pair.kicked_by >= 0) {
      add(kicking_tau_ * pair.rate, kicking_rows_->re.field(pair.kicked_by).data(),
          kicking_rows_->im.field(pair.kicked_by).data(), moved_.waves(), moved_.re.field(pair.y).data(),
          moved_.im.field(pair.y).data());
    }
  }
  kicking_rows_ = nullptr;
}

/// A kick of x_, which moved_ is; leaves rest_energy_.
bool WaveSplitting::kick_from_here(double tau) {
  if (!first_kick_is_known_) {
    if (!evaluate_rest(x_, At::here)) {
      return false;
    }
    from_grid(std::as_const(outputs_).pointers().subspan(1), fourier_, first_kick_);
    first_energy_ = rest_energy_;
    first_kick_is_known_ = first_energy_is_known_ = true;
  }
  kick_before_turn(first_kick_, tau);
  rest_energy_ = first_energy_;
  return true;
}

/// moved_ goes along the flow of N for a time τ; leaves rest_energy_.
bool WaveSplitting::kick(double tau) {
  const std::size_t n = varying_.size();
  if (flow_ == Flow::turn && kicking_.empty()) {  // no gradient is wanted
    to_grid(moved_, varying_, fourier_, values_.pointers().first(n));
  } else if (!evaluate_rest(moved_, At::led)) {
    return false;
  }
  if (flow_ == Flow::kick) {
    from_grid(std::as_const(outputs_).pointers().subspan(1), fourier_, rest_rows_);
    rest_rows_are_known_ = true;
    kick_before_turn(rest_rows_, tau);
  } else if (flow_ == Flow::turn) {
    rest_at_ = At::nowhere;  // but for its energy, which a turn keeps
    rubato::fill(tau, grid_.size(), values_.field(static_cast<int>(n)).data());
    turns_(grid_.size(), inputs_, turned_.pointers());
    rest_energy_ = node_energy(std::as_const(turned_).field(0));
    rest_energy_is_known_ = true;
    if (!std::isfinite(rest_energy_)) {
      return false;
    }
    if (moved_begins_with_varying_) {
      from_grid(std::as_const(turned_).pointers().subspan(1), fourier_, moved_);
    } else {
      from_grid(std::as_const(turned_).pointers().subspan(1), fourier_, rest_rows_);
      for (std::size_t v = 0; v < n; ++v) {
        const auto row = static_cast<int>(v);
        std::ranges::copy(std::as_const(rest_rows_.re).field(row), moved_.re.field(varying_[v]).begin());
        std::ranges::copy(std::as_const(rest_rows_.im).field(row), moved_.im.field(varying_[v]).begin());
      }
    }
    if (!kicking_.empty()) {  // along a turn, ∂N of what is not turned is constant
      from_grid(std::as_const(outputs_).pointers().subspan(1), fourier_, rest_rows_);
      for (const std::size_t v : kicking_) {
        kick_by(v, rest_rows_, tau);
      }
    }
  }
  return true;
}

bool WaveSplitting::step(const Composition& composition, double h, bool with_generator) {
  std::ranges::copy(std::as_const(x_.re).all(), moved_.re.all().begin());
  std::ranges::copy(std::as_const(x_.im).all(), moved_.im.all().begin());
  rest_at_ = rest_at_ == At::here ? At::here : At::nowhere;
  rest_energy_is_known_ = rest_rows_are_known_ = false;
  kicking_rows_ = nullptr;
  make_propagators(composition, h);
  CompensatedSum K;
  for (std::size_t i = 0; i < composition.parts.size(); ++i) {
    const Composition::Part& part = composition.parts[i];
    if (part.drift) {
      const double energy = drift(propagators_[of_parts_[i]], with_generator);
      if (with_generator) {
        K.add(part.length * energy);
      }
    } else {
      finish_kick();
      if (!(flow_ == Flow::kick && i == 0 ? kick_from_here(part.length * h) : kick(part.length * h))) {
        return false;
      }
      K.add(part.length * rest_energy_);
    }
  }
  finish_kick();
  generator_ = K.value();
  return std::isfinite(generator_);
}

double WaveSplitting::energy() {
  return (rest_energy_is_known_ || evaluate_rest(moved_, At::led)) && std::isfinite(rest_energy_)
             ? wave_energy(moved_) + rest_energy_
             : std::numeric_limits<double>::quiet_NaN();
}

double WaveSplitting::energy_here() {
  if (!first_energy_is_known_) {
    if (!evaluate_rest(x_, At::here)) {
      return std::numeric_limits<double>::quiet_NaN();
    }
    first_energy_ = rest_energy_;
    first_energy_is_known_ = true;
  }
  return wave_energy(x_) + first_energy_;
}

void WaveSplitting::write(const WaveRows& rows, At at, grids::FieldSet& fields) {
  const auto transform = [this, &fields](const WaveRows& from, const std::vector<int>& which,
                                         const std::vector<int>& to) {
    std::array<double*, MultisymplecticSystem::most_fields> arrays{};
    std::ranges::transform(to, arrays.begin(), [&fields](int f) { return fields.field(f).data(); });
    to_grid(from, which, fourier_, std::span(arrays).first(to.size()));
  };
  std::vector<int> unseen, which;  // a kick has seen the varying fields at the nodes
  for (int p = 0; p < size(); ++p) {
    const int f = evolving_[static_cast<std::size_t>(p)];
    const auto seen = std::ranges::find(varying_, p);
    if (at != At::nowhere && rest_at_ == at && seen != varying_.end()) {
      std::ranges::copy(std::as_const(values_).field(static_cast<int>(seen - varying_.begin())),
                        fields.field(f).begin());
    } else {
      unseen.push_back(p);
      which.push_back(f);
    }
  }
  transform(rows, unseen, which);
  for (std::size_t o = 0; o < others_.size(); ++o) {
    double *const re = work_.re.field(0).data(), *const im = work_.im.field(0).data();
    std::fill_n(re, rows.waves(), 0.0);
    std::fill_n(im, rows.waves(), 0.0);
    for (int p = 0; p < size(); ++p) {
      const int entry = static_cast<int>(o) * size() + p;
      add_product(std::as_const(slaves_.re).field(entry).data(), std::as_const(slaves_.im).field(entry).data(),
                  rows.re.field(p).data(), rows.im.field(p).data(), rows.waves(), re, im);
    }
    transform(work_, {0}, {others_[o]});
  }
  grids::refresh_ghosts(fields);
}

/// x_t = A x + M⁻¹∇N.
void WaveSplitting::write_rates(const WaveRows& rows, At at, grids::FieldSet& rates, const std::vector<bool>& asked) {
  std::array<int, MultisymplecticSystem::most_fields> which{};
  std::array<double*, MultisymplecticSystem::most_fields> to{};
  std::size_t count = 0;
  bool kicked = false;
  rates.fill(0.0);
  for (int p = 0; p < size(); ++p) {
    const int f = evolving_[static_cast<std::size_t>(p)];
    if (asked.empty() || asked[static_cast<std::size_t>(f)]) {
      which[count] = p;
      to[count++] = rates.field(f).data();
      kicked = kicked || std::ranges::any_of(varying_, [&](int v) { return inverse_M_(p, v) != 0.0; });
    }
  }
  multiply(generator_form_, rows, work_);
  for (std::size_t p = 0; p < translation_.size() && has_mean_; ++p) {
    work_.re.field(static_cast<int>(p))[0] += translation_[p] * static_cast<double>(whole_size_);
  }
  if (kicked) {
    static_cast<void>(evaluate_rest(rows, at));
    from_grid(std::as_const(outputs_).pointers().subspan(1), fourier_, rest_rows_);
  }
  for (std::size_t v = 0; v < varying_.size() && kicked; ++v) {
    for (int p = 0; p < size(); ++p) {
      const auto row = static_cast<int>(v);
      add(inverse_M_(p, varying_[v]), std::as_const(rest_rows_.re).field(row).data(),
          std::as_const(rest_rows_.im).field(row).data(), rows.waves(), work_.re.field(p).data(),
          work_.im.field(p).data());
    }
  }
  to_grid(work_, std::span(which).first(count), fourier_, std::span(to).first(count));
  grids::refresh_ghosts(rates);
}

}  // namespace rubato
