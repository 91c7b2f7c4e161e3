#include <rubato/study/ensemble_lanes.hpp>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>

#include <omp.h>

#include <rubato/figures/text.hpp>
#include <rubato/study/orbit_levels.hpp>
#include <rubato/study/orbit_problem.hpp>
#include <rubato/study/scheme_options.hpp>

namespace rubato::study {

namespace {

/// As many as keep a step's numbers in the fastest cache.
constexpr std::size_t most_members_at_once = 128;

constexpr std::string_view start_prefix = "initial.";

/// Its coordinate or momentum, if the entry is the start of one.
std::optional<std::size_t> place_of_start(const HamiltonianProblem& orbit, std::string_view path) {
  if (!path.starts_with(start_prefix)) {
    return std::nullopt;
  }
  const std::vector<std::string> names = orbit.names();
  const auto found = std::ranges::find(names, path.substr(start_prefix.size()));
  return found == names.end() ? std::nullopt : std::optional(static_cast<std::size_t>(found - names.begin()));
}

/// Whether a run has nothing but levels on a splitting's equal steps, and nothing beside their figures is kept of it.
bool is_plain_splitting(const Problem& problem) {
  const HamiltonianProblem& orbit = *problem.hamiltonian();
  const Scheme& scheme = problem.scheme;
  const bool laws_are_plain = problem.laws.every <= 1 || orbit.invariants.empty();
  return scheme.lagrangian == Lagrangian::splitting && scheme.levels == Levels::fixed && scheme.step &&
         !scheme.energy_tolerance && problem.events.empty() && !problem.output.any() && orbit.exact.empty() &&
         laws_are_plain;
}

/// The figures of a run with equal steps, all of which come from extremes and first values.
figures::Statistics statistics_of(const SplittingLanes::Start& start, const SplittingLanes::End& end, bool has_gamma,
                                  std::size_t laws_every, const std::vector<std::string>& invariants) {
  using Along = SplittingLanes::Along;
  figures::Statistics statistics;
  statistics.name(invariants, {}, {}, {});
  statistics.laws_every = laws_every;
  std::vector<double> values(invariants.size());
  for (double Along::*const which : {&Along::first, &Along::least, &Along::greatest}) {
    figures::LevelFigures level{.t = which == &Along::first ? start.t : end.t, .node_energy = end.node_energy.*which};
    if (has_gamma) {
      level.gamma = end.gamma.*which;
    }
    statistics.add_level(level);
    if (laws_every > 0) {
      std::ranges::transform(end.observed, values.begin(), [&](const Along& along) { return along.*which; });
      statistics.add_laws(values, {});
    }
    if (end.steps > 0) {
      statistics.add_step({.h = start.step,
                           .energy = end.energy.*which,
                           .target = end.energy.first,
                           .rounding = end.rounding,
                           .iterations = 1.0});
    }
  }
  statistics.steps = end.steps;
  statistics.all_iterations = static_cast<double>(end.steps);
  return statistics;
}

}  // namespace

std::optional<double> plain_number(std::string_view text) {
  constexpr std::size_t exact_digits = 15;
  const bool negative = text.starts_with('-');
  const std::string_view digits = text.substr(negative ? 1 : 0);
  const std::size_t whole = std::min(digits.find_first_not_of("0123456789"), digits.size());
  const bool is_integer = whole == digits.size();
  if (whole == 0 || (whole > 1 && digits.front() == '0') ||
      (is_integer && (whole > exact_digits || (negative && digits == "0")))) {
    return std::nullopt;
  }
  std::string_view rest = digits.substr(whole);
  if (rest.starts_with('.') &&
      (rest.size() < 2 || std::string_view("0123456789").find(rest[1]) == std::string_view::npos)) {
    return std::nullopt;
  }
  double value = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  const bool is_number = error == std::errc() && end == text.data() + text.size() && std::isfinite(value);
  return is_number ? std::optional(value) : std::nullopt;
}

bool differ_in_starts_alone(const Problem& ensemble) {
  const HamiltonianProblem* orbit = ensemble.hamiltonian();
  if (orbit == nullptr || orbit->L || orbit->next || orbit->fictitious_time || orbit->driven) {
    return false;
  }
  const bool all_starts = std::ranges::all_of(
      ensemble.ensemble->paths, [&](const std::string& path) { return place_of_start(*orbit, path).has_value(); });
  return all_starts && std::ranges::all_of(ensemble.ensemble->values, [](const std::vector<std::string>& values) {
           return std::ranges::all_of(values, [](const std::string& text) { return plain_number(text).has_value(); });
         });
}

std::unique_ptr<MemberLanes> MemberLanes::make(const Problem& ensemble, const std::vector<std::string>& figures) {
  if (!differ_in_starts_alone(ensemble) || ensemble.ensemble->members() < 2) {
    return nullptr;
  }
  const Problem first = member_problem(ensemble, 0);
  if (!is_plain_splitting(first)) {
    return nullptr;
  }
  const HamiltonianProblem& orbit = *first.hamiltonian();
  const Hamiltonian hamiltonian = make_hamiltonian(first);
  std::vector<formula::Expression> observed;
  std::unique_ptr<MemberLanes> members(new MemberLanes(ensemble, figures));
  for (const NamedFormula& invariant : orbit.invariants) {
    members->invariants_.push_back(invariant.name);
    observed.push_back(first.build(invariant.formula, *hamiltonian.graph(), orbit.formula_names()));
  }
  if (first.laws.none()) {
    observed.clear();
  }
  const auto threads = static_cast<std::size_t>(omp_get_max_threads());
  const std::size_t share = ensemble.ensemble->members() / (2 * threads);
  members->lanes_ = SplittingLanes::make(hamiltonian, composition(first.scheme.composition), observed,
                                         std::clamp(share, std::size_t{8}, most_members_at_once), true);
  if (members->lanes_ == nullptr) {
    return nullptr;
  }
  members->z_ = start_of(orbit);
  members->t_ = orbit.initial.t;
  members->laws_every_ = static_cast<std::size_t>(first.laws.every);
  members->options_.max_steps = static_cast<std::size_t>(first.scheme.max_steps);
  set_run_options(first.scheme, members->options_);
  for (const std::string& path : ensemble.ensemble->paths) {
    members->places_.push_back(*place_of_start(orbit, path));
  }
  return members;
}

std::vector<std::optional<MemberResult>> MemberLanes::run(std::span<const std::size_t> members,
                                                          const MemberDesk& desk) {
  std::vector<std::vector<double>> states(members.size(), z_);
  std::vector<SplittingLanes::Start> starts;
  for (std::size_t i = 0; i < members.size(); ++i) {
    for (std::size_t k = 0; k < places_.size(); ++k) {
      states[i][places_[k]] = *plain_number(ensemble_.ensemble->values[members[i]][k]);
    }
    starts.push_back({.z = states[i], .t = t_, .step = options_.step, .until = options_.until});
  }
  std::vector<SplittingLanes::End> ends(members.size());
  std::vector<std::optional<MemberResult>> results(members.size());
  if (lanes_->run(starts, options_.max_steps, ends, [&] { return desk.halted(); })) {
    for (std::size_t i = 0; i < members.size(); ++i) {
      if (!ends[i].alone) {
        results[i] = result(starts[i], ends[i]);
      }
    }
  }
  return results;
}

MemberResult MemberLanes::result(const SplittingLanes::Start& start, const SplittingLanes::End& end) const {
  MemberResult result;
  figures::JsonObject told;
  figures::add_figures(told, statistics_of(start, end, lanes_->has_gamma(), laws_every_, invariants_));
  for (const std::string& name : figures_) {
    result.figures.push_back(told.find(name).value_or(std::numeric_limits<double>::quiet_NaN()));
  }
  const auto n = static_cast<std::ptrdiff_t>(end.z.size() / 2);
  result.states.emplace_back(end.z.begin(), end.z.begin() + n);
  result.states.emplace_back(end.z.begin() + n, end.z.end());
  return result;
}

}  // namespace rubato::study
