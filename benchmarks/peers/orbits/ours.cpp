#include "ours.hpp"

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <limits>
#include <memory>

#include <rubato/ode/integrate.hpp>
#include <rubato/problem/orbit_problem.hpp>
#include <rubato/problem/problem.hpp>

namespace orbits {

namespace {

/// What ours can be asked for: a discretisation, levels, and how the latter are had.
struct Choice {
  std::string name;
  rubato::SegmentLagrangian lagrangian;
  rubato::Levels levels = rubato::Levels::fixed;
  rubato::StepPotentialChoice potential = {.kind = rubato::StepPotentialChoice::Kind::usual};
  std::string time_scale = {};  ///< dt/ds, a formula, if levels are of fictitious time
};

/// Coordinates up to which implicit schemes are run: their matrices are dense, and beyond a step takes seconds.
constexpr std::size_t most_implicit = 128;
constexpr double none = std::numeric_limits<double>::infinity();

/// Where a method's runs start, made once: what reads and compiles formulas.
struct Start {
  rubato::Hamiltonian hamiltonian;
  rubato::InitialState initial;
  bool fictitious = false;
};

Start start_of(const Ours& problem, const std::string& time_scale) {
  std::vector<std::string> settings = problem.settings;
  if (!time_scale.empty()) {
    settings.push_back("hamiltonian.time_scale=" + time_scale);
  }
  const auto read = rubato::read_problem(problem.name, settings);
  Start start{rubato::make_hamiltonian(read), {problem.q, problem.p, 0.0}, !time_scale.empty()};
  if (start.fictitious) {  // with the time and its momentum -H
    start.initial.q.push_back(0.0);
    rubato::HamiltonianEvaluator plain(rubato::make_hamiltonian(rubato::read_problem(problem.name, problem.settings)));
    std::vector<double> z = problem.q;
    z.insert(z.end(), problem.p.begin(), problem.p.end());
    start.initial.p.push_back(-plain.value(z.data()));
  }
  return start;
}

Method our_method(const Ours& problem, const Choice& choice, int first) {
  const Class kind = choice.levels == rubato::Levels::fixed ? Class::ours : Class::with_levels;
  const auto start = std::make_shared<Start>(start_of(problem, choice.time_scale));
  return {
      choice.name, kind, 0, first, [problem, choice, start](int effort, bool timed_only) {
        rubato::IntegrationOptions options;
        options.lagrangian = choice.lagrangian;
        options.levels = choice.levels;
        options.potential = choice.potential;
        options.step = problem.until / effort;
        options.until = start->fictitious ? 1e6 * problem.until : problem.until;
        const std::size_t n = problem.q.size();
        const auto run = [&](bool watched, Outcome& outcome) {
          rubato::OrbitIntegrator orbit(start->hamiltonian, start->initial, options);
          double worst = 0.0;
          const double begin = peers::cpu_seconds();
          const auto time = [&] { return start->fictitious ? orbit.q()[n] : orbit.t(); };
          while (start->fictitious ? time() < problem.until : !orbit.finished()) {
            if (orbit.step().status != rubato::Status::success || ++outcome.steps > 20'000'000) {
              return false;
            }
            if (outcome.steps == 1) {
              outcome.before = peers::cpu_seconds() - begin;
            }
            if (watched) {
              const double error = problem.energy_error(orbit.q().data(), orbit.p().data());
              worst = error <= worst ? worst : error;
              if (outcome.steps % 1024 == 0 && peers::cpu_seconds() - begin > problem.longest) {
                return false;
              }
            }
          }
          outcome.seconds = peers::cpu_seconds() - begin;
          if (watched) {
            outcome.errors = {std::isfinite(worst) ? worst : none, problem.position_error(orbit.q().data(), time())};
          }
          return true;
        };
        Outcome outcome, timed;
        if ((!timed_only && !run(true, outcome)) || !run(false, timed)) {
          outcome.errors.fill(none);
          outcome.seconds = none;
          return outcome;
        }
        timed.errors = outcome.errors;
        return timed;
      }};
}

Choice gauss_of(int stages) {
  return {"Gauss " + std::to_string(stages), rubato::Gauss{stages}};
}
Choice in_time(Choice choice, const TimeScales::value_type& scale) {
  choice.name += ", dt/ds = " + scale.first;
  choice.time_scale = scale.second;
  return choice;
}

/// With such levels; with variable ones, each with a look-ahead, every other number of stages is enough, and Verlet's
/// method, whose levels break down, is none.
void add_choices(const std::vector<Choice>& choices, rubato::Levels levels, const Ours& problem, int first,
                 std::vector<Method>& methods) {
  for (Choice choice : choices) {
    if (levels == rubato::Levels::variable &&
        (choice.name == "Gauss 3" || choice.name == "Gauss 6" || choice.name == "verlet")) {
      continue;
    }
    choice.levels = levels;
    // In a time of its own an orbit takes fewer steps.
    methods.push_back(our_method(problem, choice, choice.time_scale.empty() ? first : std::max(first / 4, 1)));
  }
}
void add_choices(const std::vector<Choice>& choices, const Ours& problem, int first, std::vector<Method>& methods) {
  for (const rubato::Levels levels : {rubato::Levels::fixed, rubato::Levels::variable}) {
    add_choices(choices, levels, problem, first, methods);
  }
}

std::vector<Choice> splittings() {
  std::vector<Choice> choices;
  for (const char* name : {"verlet", "golden", "blanes-moan-4", "kahan-li-6", "kahan-li-8", "blanes-moan-rkn-6"}) {
    choices.push_back({name, rubato::Splitting{name}});
  }
  return choices;
}
void add_stages(std::vector<Choice>& choices) {
  choices.push_back({"midpoint", rubato::Midpoint{}});
  for (const int stages : {2, 3, 4, 6, 8}) {
    choices.push_back(gauss_of(stages));
  }
}
void add_in_times(const TimeScales& time_scales, std::initializer_list<int> all_stages, std::vector<Choice>& choices) {
  for (const auto& scale : time_scales) {
    for (const int stages : all_stages) {
      choices.push_back(in_time(gauss_of(stages), scale));
    }
  }
}

}  // namespace

void add_ours(const Ours& problem, bool separable, const TimeScales& time_scales, int first,
              std::vector<Method>& methods) {
  std::vector<Choice> choices = separable ? splittings() : std::vector<Choice>();
  if (problem.q.size() <= most_implicit) {
    add_stages(choices);
  }
  add_in_times(time_scales, {2, 4, 8}, choices);
  add_choices(choices, problem, first, methods);
}

void add_ours_in(const TimeScales& time_scales, const Ours& problem, int first, std::vector<Method>& methods) {
  std::vector<Choice> choices;
  add_in_times(time_scales, {6, 8}, choices);
  add_choices(choices, problem, first, methods);
}

void add_ours_eccentric(const Ours& problem, const TimeScales& time_scales, int first, std::vector<Method>& methods) {
  std::vector<Choice> choices = splittings();
  add_stages(choices);
  add_choices(choices, rubato::Levels::fixed, problem, first, methods);
  choices.clear();
  add_in_times(time_scales, {2, 4, 8}, choices);
  add_choices(choices, rubato::Levels::variable, problem, first / 5, methods);
}

}  // namespace orbits
