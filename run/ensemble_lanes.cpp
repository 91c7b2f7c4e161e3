#include <rubato/run/ensemble_lanes.hpp>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

#include <fmt/format.h>
#include <omp.h>

#include <rubato/figures/text.hpp>
#include <rubato/ode/splitting_lanes.hpp>
#include <rubato/problem/orbit_problem.hpp>
#include <rubato/problem/reader.hpp>
#include <rubato/run/events.hpp>
#include <rubato/run/last_rows.hpp>
#include <rubato/run/orbit_levels.hpp>
#include <rubato/run/pole_watch.hpp>
#include <rubato/variation/run_span.hpp>

namespace rubato {

namespace {

/// As many as keep a step's numbers in the fastest cache.
constexpr std::size_t most_members_at_once = 128;

/// Fewer are run alone.
constexpr std::size_t least_members_at_once = 4;

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

/// Whether a run has nothing but levels on a splitting's equal steps, and crossings.
bool is_plain_splitting(const Problem& problem) {
  const HamiltonianProblem* const orbit = problem.hamiltonian();
  const Scheme& scheme = problem.scheme;
  return orbit != nullptr && !orbit->L && !orbit->next && !orbit->fictitious_time && !orbit->driven &&
         scheme.lagrangian == LagrangianName::splitting && scheme.levels == Levels::fixed && scheme.step &&
         !scheme.energy_tolerance && !scheme.tangents.any() && orbit->symmetries.empty() && !problem.output.any() &&
         orbit->exact.empty() && (problem.laws.every <= 1 || orbit->invariants.empty());
}

/// All that members side by side have to have in common, in words.
std::string signature_of(const Problem& problem) {
  const HamiltonianProblem& orbit = *problem.hamiltonian();
  formula::Graph graph;
  const auto built = [&](const FormulaText& text, const std::vector<std::string>& names) {
    return formula::to_string(problem.build(text, graph, names));
  };
  std::string signature = fmt::format("{}\n{} {} {}\n", built(orbit.H, orbit.names()), problem.scheme.composition,
                                      problem.laws.every, problem.scheme.max_steps);
  for (const NamedFormula& invariant : orbit.invariants) {
    signature += fmt::format("{} = {}\n", invariant.name, built(invariant.formula, orbit.formula_names()));
  }
  const std::vector<std::string> names = quantity_names(orbit, problem.parameters);
  for (const StatedEvent& event : problem.events) {
    std::vector<formula::Expression> none;
    signature +=
        fmt::format("{}: {} {} {} {}\n", event.name, formula::to_string(build_event(event, problem, graph, none)),
                    static_cast<int>(event.direction), event.stop_after, event.is_condition());
    for (const OutputQuantity& quantity : event.quantities) {
      signature += fmt::format("{} = {}\n", quantity.name, built(quantity.formula, names));
    }
  }
  return signature;
}

/// g of every event and dg/dfraction by h, as OrbitEvents has them: formulas of H's graph. Nothing where one depends on
/// t.
std::optional<std::vector<formula::Expression>> events_of_z(const Problem& problem, const Hamiltonian& hamiltonian) {
  const Hamiltonian& bare = hamiltonian.without_constant();
  const std::size_t n = bare.degrees_of_freedom();
  formula::Graph graph;
  std::vector<formula::Expression> variables;
  for (const std::string& name : quantity_names(*problem.hamiltonian(), problem.parameters)) {
    variables.push_back(graph.variable(name));
  }
  const auto slopes = formula::gradient(bare.expression(), bare.variables());
  std::vector<formula::Expression> result;
  for (const StatedEvent& event : problem.events) {
    std::vector<formula::Expression> none;
    std::vector<formula::Expression> outputs = {build_event(event, problem, graph, none)};
    const auto gradient = formula::gradient(outputs.front(), variables);
    outputs.insert(outputs.end(), gradient.begin(), gradient.end());
    for (std::size_t i = 2 * n; i < variables.size(); ++i) {
      if (std::ranges::count(formula::variables_of(outputs.front()), graph.node(variables[i].index()).a) > 0) {
        return std::nullopt;
      }
    }
    const auto of_z =
        formula::substitute(outputs, *bare.graph(), std::span(variables).first(2 * n), std::span(bare.variables()));
    formula::Expression rate = bare.graph()->constant(0.0);
    for (std::size_t i = 0; i < n; ++i) {
      rate += of_z[1 + i] * slopes[n + i] - of_z[1 + n + i] * slopes[i];
    }
    result.push_back(of_z.front());
    result.push_back(rate);
  }
  return result;
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
      std::ranges::transform(std::span(end.observed).first(values.size()), values.begin(),
                             [&](const Along& along) { return along.*which; });
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

struct MemberLanes::Own {
  std::vector<double> z;
  double t = 0.0, step = 0.0, until = 0.0;
};

class MemberLanes::Kind {
public:
  Kind(std::string signature, Problem problem, std::size_t width)
      : signature_(std::move(signature)), problem_(std::move(problem)) {
    const HamiltonianProblem& orbit = *problem_.hamiltonian();
    const Hamiltonian hamiltonian = make_hamiltonian(problem_);
    std::vector<formula::Expression> observed;
    for (const NamedFormula& invariant : orbit.invariants) {
      invariants_.push_back(invariant.name);
      if (!problem_.laws.none()) {
        observed.push_back(problem_.build(invariant.formula, *hamiltonian.graph(), orbit.formula_names()));
      }
    }
    reported_ = observed.size();
    const auto events = events_of_z(problem_, hamiltonian);
    if (events && !PoleWatch(problem_).looks()) {  // which is of every step
      observed.insert(observed.end(), events->begin(), events->end());
      lanes_ = SplittingLanes::make(hamiltonian, composition(problem_.scheme.composition), observed, width, true);
    }
    for (std::size_t m = 0; m < width && !problem_.events.empty(); ++m) {
      watched_.push_back(std::make_unique<Watched>(problem_));
    }
    from_.resize(problem_.events.size());
    to_.resize(problem_.events.size());
  }

  [[nodiscard]] const std::string& signature() const { return signature_; }

  /// \return whether it was not halted
  bool run(std::span<const Own> members, const std::vector<std::string>& figures, const MemberDesk& desk,
           std::span<std::optional<MemberResult>> results) {
    if (lanes_ == nullptr) {
      return true;
    }
    std::vector<SplittingLanes::Start> starts;
    for (const Own& own : members) {
      starts.push_back({.z = own.z, .t = own.t, .step = own.step, .until = own.until});
    }
    std::vector<SplittingLanes::End> ends(members.size());
    const SplittingLanes::Watch watch{.show = [this](const SplittingLanes::Step& step) { return follow(step); },
                                      .first_function = reported_,
                                      .functions = problem_.events.size()};
    if (!watched_.empty()) {
      for (std::size_t i = 0; i < members.size(); ++i) {
        watched_[i]->begin(members[i].z, members[i].t);
      }
    }
    if (!lanes_->run(
            starts, static_cast<std::size_t>(problem_.scheme.max_steps), ends, [&] { return desk.halted(); },
            watched_.empty() ? nullptr : &watch)) {
      return false;
    }
    for (std::size_t i = 0; i < members.size(); ++i) {
      if (!ends[i].alone && !(i < watched_.size() && watched_[i]->stopped_at_start)) {
        results[i] = result(i, starts[i], ends[i], figures);
      }
    }
    return true;
  }

private:
  /// What is found along one member.
  struct Watched {
    explicit Watched(const Problem& problem)
        : writer(problem), layout(described(writer)), rows(layout), names(writer.names()) {}

    static record::Layout described(EventWriter& writer) {
      record::Layout layout;
      writer.describe(layout);
      return layout;
    }
    void begin(std::span<const double> z, double t) {
      rows.clear();
      figures.clear();
      for (const std::string& name : names) {
        figures.push_back({name, {}});
      }
      writer.begin(rows, z, t, figures);
      stopped_at_start = stopped();
    }
    [[nodiscard]] bool stopped() const {
      return std::ranges::any_of(figures, [](const EventFigures& event) { return event.value.stops(); });
    }

    EventWriter writer;
    record::Layout layout;
    LastRows rows;
    std::vector<std::string> names;
    std::vector<EventFigures> figures;
    bool stopped_at_start = false;
  };

  SplittingLanes::Verdict follow(const SplittingLanes::Step& step) {
    Watched& watched = *watched_[step.lane];
    for (std::size_t i = 0; i < from_.size(); ++i) {
      // The sum that the rate is begins with 0.
      const auto sample = [&](std::span<const double> observed, double fraction) {
        const double rate = observed[reported_ + 2 * i + 1] + 0.0;
        return CrossingSearch::Sample{
            .fraction = fraction, .value = observed[reported_ + 2 * i], .rate = step.h * rate};
      };
      from_[i] = sample(step.observed_0, 0.0);
      to_[i] = sample(step.observed_1, 1.0);
    }
    try {
      watched.writer.append(watched.rows,
                            {.z_0 = step.z_0, .z_1 = step.z_1, .t_0 = step.t_0, .t_1 = step.t_1, .h = step.h}, from_,
                            to_, watched.figures);
    } catch (const record::NotFinite&) {
      return SplittingLanes::Verdict::alone;
    }
    return watched.stopped() ? SplittingLanes::Verdict::end : SplittingLanes::Verdict::go_on;
  }

  /// Nothing where the node energy strays so far, or a crossing was missed, that the run has to be judged by itself.
  [[nodiscard]] std::optional<MemberResult> result(std::size_t place, const SplittingLanes::Start& start,
                                                   const SplittingLanes::End& end,
                                                   const std::vector<std::string>& names) const {
    figures::Statistics statistics =
        statistics_of(start, end, lanes_->has_gamma(), static_cast<std::size_t>(problem_.laws.every), invariants_);
    constexpr double clearly_good = 1e-3;
    const std::optional<double> strays = statistics.relative(statistics.node_energy.max());
    const bool missed = !watched_.empty() && std::ranges::any_of(watched_[place]->figures, [](const auto& event) {
      return event.value.returned > 0;
    });
    if (!strays || !(*strays < clearly_good) || missed) {
      return std::nullopt;
    }
    MemberResult result;
    if (!watched_.empty()) {
      const Watched& watched = *watched_[place];
      statistics.events = watched.figures;
      for (std::size_t i = 0; i < watched.layout.datasets.size(); ++i) {
        if (is_kept_whole(watched.layout.datasets[i])) {
          result.series.push_back(watched.rows.kept(i));
        }
      }
    }
    result.warnings = statistics.undefined_quantities();
    figures::JsonObject reported;
    figures::add_figures(reported, statistics);
    for (const std::string& name : names) {
      result.figures.push_back(reported.find(name).value_or(std::numeric_limits<double>::quiet_NaN()));
    }
    const auto n = static_cast<std::ptrdiff_t>(end.z.size() / 2);
    result.states.emplace_back(end.z.begin(), end.z.begin() + n);
    result.states.emplace_back(end.z.begin() + n, end.z.end());
    return result;
  }

  std::string signature_;
  Problem problem_;
  std::vector<std::string> invariants_;
  std::size_t reported_ = 0;  ///< invariants among what is observed; the rest are events
  std::unique_ptr<SplittingLanes> lanes_;
  std::vector<std::unique_ptr<Watched>> watched_;
  std::vector<CrossingSearch::Sample> from_, to_;  ///< of every event, in one step of one member
};

MemberLanes::MemberLanes(const Problem& ensemble, const std::vector<std::string>& figures)
    : ensemble_(ensemble), figures_(figures) {}
MemberLanes::~MemberLanes() = default;

std::unique_ptr<MemberLanes> MemberLanes::make(const Problem& ensemble, const std::vector<std::string>& figures) {
  if (ensemble.hamiltonian() == nullptr || ensemble.ensemble->members() < 2) {
    return nullptr;
  }
  Problem first = member_problem(ensemble, 0);
  if (!is_plain_splitting(first)) {
    return nullptr;
  }
  std::unique_ptr<MemberLanes> lanes(new MemberLanes(ensemble, figures));
  const auto threads = static_cast<std::size_t>(omp_get_max_threads());
  lanes->width_ = std::clamp(ensemble.ensemble->members() / (2 * threads), std::size_t{8}, most_members_at_once);
  if (differ_in_starts_alone(ensemble)) {
    for (const std::string& path : ensemble.ensemble->paths) {
      lanes->places_.push_back(*place_of_start(*first.hamiltonian(), path));
    }
    lanes->first_ = std::move(first);
  }
  return lanes;
}

/// Nothing where it is to be run alone. \param signature what it has to have in common with others
std::optional<MemberLanes::Own> MemberLanes::read(std::size_t member, std::string& signature) const {
  const auto own = [](const Problem& problem) -> std::optional<Own> {
    const double t = problem.hamiltonian()->initial.t, step = *problem.scheme.step, until = problem.scheme.until;
    try {
      check_run_span(t, step, until, problem.scheme.tolerance);
    } catch (const std::invalid_argument&) {
      return std::nullopt;  // its own run shows why
    }
    return Own{.z = start_of(*problem.hamiltonian()), .t = t, .step = step, .until = until};
  };
  if (first_) {
    std::optional<Own> result = own(*first_);
    for (std::size_t k = 0; k < places_.size() && result; ++k) {
      result->z[places_[k]] = *plain_number(ensemble_.ensemble->values[member][k]);
    }
    return result;
  }
  const Problem problem = member_problem(ensemble_, member);
  if (!is_plain_splitting(problem)) {
    return std::nullopt;
  }
  signature = signature_of(problem);
  return own(problem);
}

std::vector<std::optional<MemberResult>> MemberLanes::run(std::span<const std::size_t> members,
                                                          const MemberDesk& desk) {
  std::vector<std::optional<MemberResult>> results(members.size());
  if (width_ == 1) {
    return results;
  }
  std::map<std::string, std::vector<std::size_t>> places;  // in `members`, by what they have in common
  std::vector<std::optional<Own>> own;
  for (std::size_t i = 0; i < members.size(); ++i) {
    std::string signature;
    own.push_back(read(members[i], signature));
    if (own.back()) {
      places[signature].push_back(i);
    }
  }
  bool any = false;
  for (const auto& [signature, of] : places) {
    if (kind_ == nullptr || kind_->signature() != signature) {
      if (of.size() < least_members_at_once) {
        continue;  // to compile for them takes longer
      }
      kind_ =
          std::make_unique<Kind>(signature, first_ ? *first_ : member_problem(ensemble_, members[of.front()]), width_);
    }
    any = true;
    std::vector<Own> together;
    for (const std::size_t place : of) {
      together.push_back(std::move(*own[place]));
    }
    std::vector<std::optional<MemberResult>> found(of.size());
    if (!kind_->run(together, figures_, desk, found)) {
      return std::vector<std::optional<MemberResult>>(members.size());
    }
    for (std::size_t i = 0; i < of.size(); ++i) {
      results[of[i]] = std::move(found[i]);
    }
  }
  width_ = any ? width_ : 1;  // no two have one H: to read them twice is for nothing
  return results;
}

}  // namespace rubato
