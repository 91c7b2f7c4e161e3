#include <rubato/pde/wave_splitting.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <random>
#include <ranges>

#include <fmt/format.h>

#include <rubato/base/compensated_sum.hpp>
#include <rubato/formula/branches.hpp>
#include <rubato/grids/slab.hpp>
#include <rubato/grids/transposition.hpp>
#include <rubato/grids/whole.hpp>
#include <rubato/pde/lattice_scheme.hpp>
#include <rubato/pde/potential_rest.hpp>
#include <rubato/pde/shared_slopes.hpp>

namespace rubato {

namespace {

using Eigen::MatrixXd, Eigen::VectorXd;
using formula::Expression;

}  // namespace

WaveSplitting::WaveSplitting(const MultisymplecticSystem& system, const grids::Grid& grid, Collocation collocation)
    : system_(system),
      grid_(grid),
      fourier_(grid, transformed_at_once(grid, system.field_count())),
      waves_(system, grid, collocation, fourier_),
      propagators_(waves_),
      places_(system, grid, Within::node) {
  compile_rest();
  classify();
  find_pairs();
  const std::size_t waves = waves_.count(), nodes = grid.size();
  for (WaveRows* const rows : {&x_, &before_, &moved_, &next_, &work_}) {  // no copies: those write, and take memory
    *rows = WaveRows(waves_.size(), waves);
  }
  const int n = static_cast<int>(varying_.size());
  rest_rows_ = WaveRows(n, waves);
  first_kick_ = WaveRows(n, waves);
  values_ = grids::FieldSet(n + 1, nodes);
  inputs_ = places_.after(std::as_const(values_).pointers().first(varying_.size()));
  inputs_.push_back(std::as_const(values_).field(n).data());
  outputs_ = grids::FieldSet(n, nodes);
  turned_ = grids::FieldSet(n, nodes);
  moved_begins_with_varying_ = std::ranges::equal(varying_, std::views::iota(0, n));
}

void WaveSplitting::check(const Composition& composition) const {
  if (composition.of_quadratic_kinetic_energy && flow_ == Flow::turn) {
    throw SchemeRefusal(
        fmt::format("the composition {} is of order {} beside kicks alone, and the rest of S turns pairs of fields: "
                    "use {}",
                    composition.name, composition.order, composition_of_order(composition.order).name));
  }
}

/// N = S - ½ zᵀLz at the fields that S'' varies with, or that S has a linear term of; the others 0.
void WaveSplitting::compile_rest() {
  const std::vector<double> slope = potential_slopes_at_zero(system_);
  const auto varies = [&](int f) {
    return is_in_rest(system_, f) || slope[static_cast<std::size_t>(f)] != waves_.slope()[static_cast<std::size_t>(f)];
  };
  for (const int f : waves_.others()) {
    if (varies(f)) {
      throw SchemeRefusal(
          fmt::format("splitting needs a rest of S that depends on fields with an equation of motion alone, and beyond "
                      "its quadratic terms with constant coefficients S depends on {}{}",
                      system_.fields()[static_cast<std::size_t>(f)], splitting_remedy));
    }
  }
  std::vector<int> fields;
  for (int p = 0; p < waves_.size(); ++p) {
    const int f = waves_.evolving()[static_cast<std::size_t>(p)];
    if (varies(f)) {
      varying_.push_back(p);
      fields.push_back(f);
    }
  }
  if (fields.empty() && !system_.coordinates().empty()) {  // S has a term of the coordinates alone
    varying_.push_back(0);
    fields.push_back(waves_.evolving().front());
  }
  if (fields.empty()) {  // S is quadratic but for a constant
    const Expression N = rest_of_potential(system_, waves_.L(), fields).value;
    const grids::Slab* const slab = grids::Slab::of(grid_);
    const std::size_t nodes = slab != nullptr ? slab->whole().size() : grid_.size();
    constant_rest_ = N.is_constant() ? grid_.cell_volume() * static_cast<double>(nodes) * N.constant_value() : 0.0;
    return;
  }
  const auto [graph, varying, arguments, N] = rest_of_potential(system_, waves_.L(), fields);
  std::vector<Expression> outputs = {N};
  const std::vector<Expression> first = formula::gradient(N, varying);
  outputs.insert(outputs.end(), first.begin(), first.end());
  rest_ = formula::BatchEvaluator(formula::Bytecode(outputs, arguments));

  // Where each varying field has one partner, the turn by the angle θ = μτ (p ∂_pN + q ∂_qN)/(p² + q²).
  const Expression tau = graph->variable("the time of a turn");
  std::vector<Expression> turned = {N}, inputs = arguments;
  inputs.push_back(tau);
  for (std::size_t i = 0; i < varying.size(); ++i) {
    const auto is_partner = [&](int place) { return waves_.inverse_M()(varying_[i], place) != 0.0; };
    if (std::ranges::none_of(varying_, is_partner)) {
      kicking_.push_back(i);
      turned.push_back(varying[i]);
    }
    for (std::size_t j = 0; j < varying.size(); ++j) {
      const double mu = waves_.inverse_M()(varying_[i], varying_[j]);
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
      moves_itself = moves_itself || waves_.inverse_M()(i, j) != 0.0;
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
      system_.fields()[static_cast<std::size_t>(waves_.evolving()[static_cast<std::size_t>(varying_.front())])],
      splitting_remedy));
}

/// Whether p ∂_qN = q ∂_pN for all pairs: N depends on p² + q² alone.
bool WaveSplitting::is_turn() const {
  constexpr int points = 32;
  std::vector<int> fields;
  std::ranges::transform(varying_, std::back_inserter(fields),
                         [this](int i) { return waves_.evolving()[static_cast<std::size_t>(i)]; });
  const PotentialRest rest = rest_of_potential(system_, waves_.L(), fields);
  const std::vector<Expression> slopes = formula::gradient(rest.value, rest.variables);
  const auto n = static_cast<int>(varying_.size());
  for (formula::ScalarEvaluator& evaluate : formula::evaluators_on_branches(slopes, rest.inputs)) {
    std::mt19937_64 random(20);
    std::uniform_real_distribution<double> value(-1.3, 1.3);
    MatrixXd at(evaluate.code().input_count(), points), values(n, points);
    std::ranges::generate(at.reshaped(), [&] { return value(random); });
    for (int x = 0; x < points; ++x) {
      evaluate({at.col(x).data(), rest.inputs.size()}, {values.col(x).data(), slopes.size()});
    }
    for (int i = 0; i < n; ++i) {
      for (int j = 0; j < n; ++j) {
        if (waves_.inverse_M()(varying_[static_cast<std::size_t>(i)], varying_[static_cast<std::size_t>(j)]) == 0.0) {
          continue;
        }
        const VectorXd left = at.row(i).cwiseProduct(values.row(j)), right = at.row(j).cwiseProduct(values.row(i));
        if (!((left - right).cwiseAbs().maxCoeff<Eigen::PropagateNaN>() <= 1e-10 * left.cwiseAbs().maxCoeff())) {
          return false;
        }
      }
    }
  }
  return true;
}

void WaveSplitting::stand(const LatticeLevel& level) {
  for (std::size_t f = 0; f < level.slopes.of_field.size(); ++f) {
    if (has_slope(level.slopes, f, grid_)) {
      throw SchemeRefusal(fmt::format("splitting takes no potential with a mean slope, and {} has one{}",
                                      system_.fields()[f], splitting_remedy));
    }
  }
  std::array<const double*, MultisymplecticSystem::most_fields> from{};
  for (int p = 0; p < waves_.size(); ++p) {
    from[static_cast<std::size_t>(p)] = level.fields.field(waves_.evolving()[static_cast<std::size_t>(p)]).data();
  }
  from_grid(std::span(from).first(waves_.evolving().size()), fourier_, x_);
  forget();
}

/// After x_ has changed.
void WaveSplitting::forget() {
  rest_at_ = At::nowhere;
  rest_energy_is_known_ = rest_rows_are_known_ = first_kick_is_known_ = first_energy_is_known_ = false;
}

void WaveSplitting::accept() {
  if (keeps_before_) {
    std::swap(before_, x_);
  }
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

void WaveSplitting::give_back() {
  for (grids::FieldSet* const fields :
       {&moved_.re, &moved_.im, &next_.re, &next_.im, &rest_rows_.re, &rest_rows_.im, &values_, &outputs_, &turned_}) {
    for (int f = 0; f < fields->fields(); ++f) {
      fields->forget(f);
    }
  }
  rest_at_ = At::nowhere;
  rest_rows_are_known_ = false;
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

/// Real pairs whose kick, energy and turn are one pass: where all groups are such, and the energy has no other terms.
void WaveSplitting::find_pairs() {
  const bool splits =
      waves_.has_real_pairs() &&
      std::ranges::all_of(waves_.groups(), [](const auto& group) { return group.size() == 2; }) &&
      std::ranges::all_of(waves_.real_forms(), [](const auto& form) { return form.first == form.second; }) &&
      !waves_.real_forms().empty() && std::ranges::all_of(waves_.slope(), [](double slope) { return slope == 0.0; });
  if (!splits) {
    return;
  }
  for (const std::vector<int>& group : waves_.groups()) {
    pairs_.push_back({.x = group.front(), .y = group.back()});
  }
  for (std::size_t v = 0; v < varying_.size() && flow_ == Flow::kick; ++v) {
    for (int p = 0; p < waves_.size(); ++p) {
      const double rate = waves_.inverse_M()(p, varying_[v]);
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
}

/// What code has beside N, at all nodes. \return ΔV Σ N over the nodes of all ranks, of which few are in memory at once
double WaveSplitting::evaluate(formula::BatchEvaluator& code, std::span<const double* const> inputs,
                               grids::FieldSet& outputs) const {
  constexpr std::size_t most = 2048;  // nodes whose N stays in the cache
  alignas(64) std::array<double, most> N;
  std::array<const double*, MultisymplecticSystem::most_fields + 4> in{};
  std::array<double*, MultisymplecticSystem::most_fields + 1> out{};
  const grids::Slab* const slab = grids::Slab::of(grid_);
  const std::size_t first = slab == nullptr ? 0 : slab->first_node(),
                    end = slab == nullptr ? grid_.size() : first + slab->owned();
  CompensatedSum sum;
  for (std::size_t begin = 0; begin < grid_.size(); begin += most) {
    const std::size_t count = std::min(most, grid_.size() - begin);
    std::ranges::transform(inputs, in.begin(), [begin](const double* input) { return input + begin; });
    out[0] = N.data();
    std::ranges::transform(outputs.pointers(), out.begin() + 1, [begin](double* output) { return output + begin; });
    code(count, std::span(in).first(inputs.size()), std::span(out).first(outputs.pointers().size() + 1));
    const std::size_t from = std::max(begin, first), to = std::min(begin + count, end);
    if (from < to) {
      grids::LaneSum of_these;
      of_these.add(std::span<const double>(N).subspan(from - begin, to - from));
      sum.add(of_these.total());
    }
  }
  double total = sum.value();
  if (slab != nullptr) {
    slab->reduce(std::span(&sum, 1), std::span(&total, 1), {});
  }
  return grid_.cell_volume() * total;
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
  rest_energy_ = evaluate(rest_, std::span(inputs_).first(inputs_.size() - 1), outputs_);
  return std::isfinite(rest_energy_);
}

/// A kick, X_1 and a turn of all pairs in one pass over the waves.
double WaveSplitting::turn_pairs(WavePropagators::Propagator& E, bool with_energy) {
  const auto form_of = [this](int place) {
    return waves_.energy_form().re.field(place * waves_.size() + place).data();
  };
  const std::span<double*const> re = moved_.re.pointers(), im = moved_.im.pointers();
  const auto sum = sum_of_pieces(moved_.waves(), [&](std::size_t begin, std::size_t end, CompensatedSum& into) {
    for (std::size_t i = 0; i < pairs_.size(); ++i) {
      const Pair& pair = pairs_[i];
      const auto x = static_cast<std::size_t>(pair.x), y = static_cast<std::size_t>(pair.y);
      const PairMatrices turns = propagators_.turns(E, pair.x, pair.y);
      for (std::size_t w = begin; w < end; w += wave_block) {
        BeforeTurn before;
        if (kicking_rows_ != nullptr && pair.kicked_by >= 0) {
          before = {.kick = kicking_tau_ * pair.rate,
                    .re = kicking_rows_->re.field(pair.kicked_by).data() + w,
                    .im = kicking_rows_->im.field(pair.kicked_by).data() + w};
        }
        if (with_energy) {
          before.of_x = form_of(pair.x) + w;
          before.of_y = form_of(pair.y) + w;
          before.weights = waves_.parseval().data() + w;
        }
        into.add(turn_pair({turns.a + w, turns.b + w, turns.c + w, turns.d + w, turns.mend + w}, before,
                           std::min(wave_block, end - w), {re[x] + w, im[x] + w, re[y] + w, im[y] + w}));
      }
    }
  });
  kicking_rows_ = nullptr;
  return with_energy ? 0.5 * grid_.cell_volume() * waves_.sum_over_ranks(sum.value()) : 0.0;
}

/// moved_ goes along the flow of the waves, and of what is linear in S. \return X_1, if it is asked for
double WaveSplitting::drift(WavePropagators::Propagator& E, bool with_energy) {
  rest_at_ = At::nowhere;
  rest_energy_is_known_ = rest_rows_are_known_ = false;
  if (!pairs_.empty()) {
    return turn_pairs(E, with_energy);
  }
  const double energy = with_energy ? waves_.energy(moved_) : 0.0;
  if (waves_.has_real_pairs()) {
    for (const std::vector<int>& group : waves_.groups()) {
      const int x = group.front(), y = group.back();
      if (group.size() == 2) {
        turn_pair(propagators_.turns(E, x, y), {}, moved_.waves(),
                  {moved_.re.field(x).data(), moved_.im.field(x).data(), moved_.re.field(y).data(),
                   moved_.im.field(y).data()});
        continue;
      }
      const double* const factor = std::as_const(E.entries.re).field(x * waves_.size() + x).data();
      for (std::size_t w = 0; w < moved_.waves(); ++w) {
        moved_.re.field(x)[w] *= factor[w];
        moved_.im.field(x)[w] *= factor[w];
      }
    }
  } else {
    waves_.multiply(E.entries, moved_, next_);
    std::swap(moved_, next_);
  }
  for (std::size_t p = 0; p < waves_.translation().size() && waves_.has_mean(); ++p) {
    moved_.re.field(static_cast<int>(p))[0] +=
        E.tau * waves_.translation()[p] * static_cast<double>(grids::whole_of(grid_).size());
  }
  return energy;
}

/// The fields that varying field v kicks, by the waves of ∂_vN.
void WaveSplitting::kick_by(std::size_t v, const WaveRows& slopes, double tau) {
  const auto row = static_cast<int>(v);
  for (int p = 0; p < waves_.size(); ++p) {
    if (const double rate = waves_.inverse_M()(p, varying_[v]); rate != 0.0) {
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
    from_grid(std::as_const(outputs_).pointers(), fourier_, first_kick_);
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
    from_grid(std::as_const(outputs_).pointers(), fourier_, rest_rows_);
    rest_rows_are_known_ = true;
    kick_before_turn(rest_rows_, tau);
  } else if (flow_ == Flow::turn) {
    rest_at_ = At::nowhere;  // but for its energy, which a turn keeps
    rubato::fill(tau, grid_.size(), values_.field(static_cast<int>(n)).data());
    rest_energy_ = evaluate(turns_, inputs_, turned_);
    rest_energy_is_known_ = true;
    if (!std::isfinite(rest_energy_)) {
      return false;
    }
    if (moved_begins_with_varying_) {
      from_grid(std::as_const(turned_).pointers(), fourier_, moved_);
    } else {
      from_grid(std::as_const(turned_).pointers(), fourier_, rest_rows_);
      for (std::size_t v = 0; v < n; ++v) {
        const auto row = static_cast<int>(v);
        std::ranges::copy(std::as_const(rest_rows_.re).field(row), moved_.re.field(varying_[v]).begin());
        std::ranges::copy(std::as_const(rest_rows_.im).field(row), moved_.im.field(varying_[v]).begin());
      }
    }
    if (!kicking_.empty()) {  // along a turn, ∂N of what is not turned is constant
      from_grid(std::as_const(outputs_).pointers(), fourier_, rest_rows_);
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
  propagators_.make(composition, h);
  CompensatedSum K;
  for (std::size_t i = 0; i < composition.parts.size(); ++i) {
    const Composition::Part& part = composition.parts[i];
    if (part.drift) {
      const double energy = drift(propagators_.of_part(i), with_generator);
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
             ? waves_.energy(moved_) + rest_energy_
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
  return waves_.energy(x_) + first_energy_;
}

/// Rows number `which` into fields number `to`.
void WaveSplitting::to_fields(const WaveRows& rows, std::span<const int> which, std::span<const int> to,
                              grids::FieldSet& fields) {
  std::array<double*, MultisymplecticSystem::most_fields> arrays{};
  std::ranges::transform(to, arrays.begin(), [&fields](int f) { return fields.field(f).data(); });
  to_grid(rows, which, fourier_, std::span(arrays).first(to.size()));
}

void WaveSplitting::write(const WaveRows& rows, At at, grids::FieldSet& fields) {
  std::array<int, MultisymplecticSystem::most_fields> unseen{}, which{};
  std::size_t count = 0;  // a kick has seen the varying fields at the nodes
  for (int p = 0; p < waves_.size(); ++p) {
    const int f = waves_.evolving()[static_cast<std::size_t>(p)];
    const auto seen = std::ranges::find(varying_, p);
    if (at != At::nowhere && rest_at_ == at && seen != varying_.end()) {
      std::ranges::copy(std::as_const(values_).field(static_cast<int>(seen - varying_.begin())),
                        fields.field(f).begin());
    } else {
      unseen[count] = p;
      which[count++] = f;
    }
  }
  to_fields(rows, std::span(unseen).first(count), std::span(which).first(count), fields);
  write_others(rows, fields);
}

void WaveSplitting::write_others(const WaveRows& rows, grids::FieldSet& fields) {
  for (std::size_t o = 0; o < waves_.others().size(); ++o) {
    double *const re = work_.re.field(0).data(), *const im = work_.im.field(0).data();
    std::fill_n(re, rows.waves(), 0.0);
    std::fill_n(im, rows.waves(), 0.0);
    for (int p = 0; p < waves_.size(); ++p) {
      const int entry = static_cast<int>(o) * waves_.size() + p;
      add_product(std::as_const(waves_.slaves().re).field(entry).data(),
                  std::as_const(waves_.slaves().im).field(entry).data(), rows.re.field(p).data(),
                  rows.im.field(p).data(), rows.waves(), re, im);
    }
    to_fields(work_, std::array{0}, std::array{waves_.others()[o]}, fields);
  }
  if (!keeps_before_) {  // few levels are asked for
    work_.re.forget(0);
    work_.im.forget(0);
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
  for (int p = 0; p < waves_.size(); ++p) {
    const int f = waves_.evolving()[static_cast<std::size_t>(p)];
    if (asked.empty() || asked[static_cast<std::size_t>(f)]) {
      which[count] = p;
      to[count++] = rates.field(f).data();
      kicked = kicked || std::ranges::any_of(varying_, [&](int v) { return waves_.inverse_M()(p, v) != 0.0; });
    }
  }
  waves_.rates(rows, work_);
  for (std::size_t p = 0; p < waves_.translation().size() && waves_.has_mean(); ++p) {
    work_.re.field(static_cast<int>(p))[0] +=
        waves_.translation()[p] * static_cast<double>(grids::whole_of(grid_).size());
  }
  if (kicked) {
    static_cast<void>(evaluate_rest(rows, at));
    from_grid(std::as_const(outputs_).pointers(), fourier_, rest_rows_);
  }
  for (std::size_t v = 0; v < varying_.size() && kicked; ++v) {
    for (int p = 0; p < waves_.size(); ++p) {
      const auto row = static_cast<int>(v);
      add(waves_.inverse_M()(p, varying_[v]), std::as_const(rest_rows_.re).field(row).data(),
          std::as_const(rest_rows_.im).field(row).data(), rows.waves(), work_.re.field(p).data(),
          work_.im.field(p).data());
    }
  }
  to_grid(work_, std::span(which).first(count), fourier_, std::span(to).first(count));
  grids::refresh_ghosts(rates);
}

}  // namespace rubato
