#include "comparison.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <map>

namespace comparison {

namespace {

constexpr std::array targets = {1e-2, 1e-4, 1e-6, 1e-9};
constexpr double none = std::numeric_limits<double>::infinity();
/// Of each kind, so many of the cheapest runs for an error are measured again.
constexpr std::size_t finalists = 3;
/// Seconds that a method on one grid may search for; and of one run.
constexpr double longest_search = 2.0, longest_run = 1.0;

struct Candidate {
  const Method* method = nullptr;
  int steps = 0;
  double seconds = none;
  std::vector<double> times, befores;

  [[nodiscard]] static double median(std::vector<double> values) {
    std::ranges::sort(values);
    return values[values.size() / 2];
  }
  [[nodiscard]] double time() const { return median(times); }
  /// Half the distance of the quartiles, relative.
  [[nodiscard]] double spread() const {
    std::vector<double> sorted = times;
    std::ranges::sort(sorted);
    return 0.5 * (sorted[sorted.size() * 3 / 4] - sorted[sorted.size() / 4]) / time();
  }
};

/// For each error the run with the fewest steps that reaches it, to a few per cent of their number.
std::array<std::optional<Candidate>, targets.size()> search(const Method& method) {
  std::map<int, Outcome> runs;
  double spent = 0.0;
  const auto run = [&](int steps) {
    const auto known = runs.find(steps);
    if (known != runs.end()) {
      return known->second;
    }
    Outcome outcome = method.run(steps);
    spent += std::isfinite(outcome.seconds) ? outcome.seconds : 0.01;
    if (outcome.seconds < 0.05) {
      outcome.seconds = std::min(outcome.seconds, method.run(steps).seconds);
    }
    return runs[steps] = outcome;
  };
  double best = none;
  int idle = 0;
  for (double steps = method.first; spent < longest_search; steps *= std::sqrt(2.0)) {
    const Outcome outcome = run(static_cast<int>(std::lround(steps)));
    // Unstable steps grow worse first as they become shorter.
    idle = best < 1.0 && outcome.error > 0.8 * best ? idle + 1 : 0;
    best = std::min(best, outcome.error);
    if (best <= targets.back() || idle >= 3 || outcome.seconds > longest_run) {
      if (!std::isfinite(outcome.seconds) && idle < 3) {
        continue;
      }
      break;
    }
    if (steps > 1e7) {
      break;
    }
  }
  std::array<std::optional<Candidate>, targets.size()> result;
  for (std::size_t t = 0; t < targets.size(); ++t) {
    const auto reaches = [&](const auto& entry) { return entry.second.error <= targets[t]; };
    for (int refinement = 0; refinement < 3; ++refinement) {
      const auto found = std::ranges::find_if(runs, reaches);
      if (found == runs.end() || found == runs.begin()) {
        break;
      }
      run(static_cast<int>(std::lround(std::sqrt(static_cast<double>(found->first) * std::prev(found)->first))));
    }
    for (const auto& [steps, outcome] : runs) {
      if (outcome.error <= targets[t] && (!result[t] || outcome.seconds < result[t]->seconds)) {
        result[t] = Candidate{&method, steps, outcome.seconds, {}, {}};
      }
    }
  }
  return result;
}

const char* name_of(Class kind) {
  switch (kind) {
    case Class::peer: return "best by hand";
    case Class::ours: return "fixed levels, no laws";
    case Class::with_laws: return "fixed levels, laws";
    case Class::with_levels: return "variable levels";
  }
  return "";
}

}  // namespace

void report(const Problem& problem, const Reference& reference, const std::vector<Method>& methods, int repeats) {
  std::map<Class, std::array<std::vector<Candidate>, targets.size()>> best;
  std::printf("\n%s to t = %g; the solution compared with is known to %.1e\n", problem.name.c_str(), problem.until,
              reference.uncertainty());
  std::map<std::pair<Class, std::string>, std::array<std::optional<Candidate>, targets.size()>> by_name;
  const auto take = [&](const Method& method, std::size_t t, const Candidate& found) {
    best[method.kind][t].push_back(found);
    auto& of_name = by_name[{method.kind, method.name}][t];
    if (!of_name || found.seconds < of_name->seconds) {
      of_name = found;
    }
  };
  const auto search_and_take = [&](const Method& method) {
    const auto found = search(method);
    for (std::size_t t = 0; t < targets.size(); ++t) {
      if (found[t]) {
        take(method, t, *found[t]);
      }
    }
  };
  for (const Method& method : methods) {
    if (method.kind == Class::peer || method.kind == Class::ours) {
      search_and_take(method);
    }
  }
  // Laws change no level, and variable levels want the grids that equal ones do.
  for (const Method& method : methods) {
    const auto fixed = by_name.find({Class::ours, method.name});
    if (method.kind == Class::peer || method.kind == Class::ours || fixed == by_name.end()) {
      continue;
    }
    bool grid_is_wanted = false;
    for (std::size_t t = 0; t < targets.size(); ++t) {
      const auto& candidate = fixed->second[t];
      if (!candidate || candidate->method->nodes != method.nodes) {
        continue;
      }
      grid_is_wanted = true;
      if (method.kind == Class::with_laws) {
        take(method, t, {&method, candidate->steps, method.run(candidate->steps).seconds, {}, {}});
      }
    }
    if (method.kind == Class::with_levels && grid_is_wanted) {
      search_and_take(method);
    }
  }
  std::printf("  the search, ms (nodes, steps), each run at most twice:\n");
  for (const auto& [key, row] : by_name) {
    std::printf("    %-22s %-14s", name_of(key.first), key.second.c_str());
    for (const auto& entry : row) {
      if (entry) {
        std::printf(" %9.3f (%4zu,%7d)", 1e3 * entry->seconds, entry->method->nodes, entry->steps);
      } else {
        std::printf(" %9s %14s", "-", "");
      }
    }
    std::printf("\n");
  }
  for (auto& [kind, of_targets] : best) {
    for (auto& candidates : of_targets) {
      std::ranges::sort(candidates, {}, &Candidate::seconds);
      candidates.resize(std::min(candidates.size(), finalists));
    }
  }
  for (int repeat = 0; repeat < repeats; ++repeat) {
    for (auto& [kind, of_targets] : best) {
      for (auto& candidates : of_targets) {
        for (Candidate& one : candidates) {
          const Outcome outcome = one.method->run(one.steps);
          one.times.push_back(outcome.seconds);
          one.befores.push_back(outcome.before);
        }
      }
    }
  }
  std::printf("  medians of %d in turns, ms, for an error of\n%-24s", repeats, "");
  for (const double target : targets) {
    std::printf("%40.0e", target);
  }
  std::printf("\n");
  std::map<Class, std::array<double, targets.size()>> medians;
  for (auto& [kind, of_targets] : best) {
    std::printf("%-24s", name_of(kind));
    for (std::size_t t = 0; t < targets.size(); ++t) {
      medians[kind][t] = none;
      if (of_targets[t].empty()) {
        std::printf(" %39s", "-");
        continue;
      }
      const Candidate& first = *std::ranges::min_element(of_targets[t], {}, &Candidate::time);
      medians[kind][t] = first.time();
      char text[64];
      std::snprintf(text, sizeof text, "%.3f±%.0f%% %s/%zu/%d", 1e3 * first.time(), 100.0 * first.spread(),
                    first.method->name.c_str(), first.method->nodes, first.steps);
      std::printf(" %39s", text);
    }
    std::printf("\n");
  }
  if (best.contains(Class::with_levels)) {
    std::printf("%-24s", "  of it the scout");
    for (const auto& candidates : best[Class::with_levels]) {
      if (candidates.empty()) {
        std::printf(" %39s", "-");
      } else {
        const Candidate& first = *std::ranges::min_element(candidates, {}, &Candidate::time);
        std::printf("%40.3f", 1e3 * Candidate::median(first.befores));
      }
    }
    std::printf("\n");
  }
  const auto ratios = [&](const char* name, Class over, Class under) {
    if (!medians.contains(over) || !medians.contains(under)) {
      return;
    }
    std::printf("%-24s", name);
    for (std::size_t t = 0; t < targets.size(); ++t) {
      std::printf("%40.2f", medians[over][t] / medians[under][t]);
    }
    std::printf("\n");
  };
  ratios("fixed / best by hand", Class::ours, Class::peer);
  ratios("laws / fixed", Class::with_laws, Class::ours);
  ratios("variable / fixed", Class::with_levels, Class::ours);
  std::fflush(stdout);
}

}  // namespace comparison
