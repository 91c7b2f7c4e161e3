#include "work.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <map>
#include <optional>
#include <utility>

#include "cpu_clock.hpp"

namespace comparison {

namespace {

constexpr double none = std::numeric_limits<double>::infinity();
/// Of each kind, so many of the cheapest runs for an error are measured again.
constexpr std::size_t finalists = 3;
/// Runs in a turn, at most.
constexpr double most_repeats = 1000.0;

/// A column: an error of a kind.
struct Goal {
  std::size_t measure = 0;
  double target = 0.0;
};

std::vector<Goal> goals_of(const Study& study) {
  std::vector<Goal> goals;
  for (std::size_t m = 0; m < study.measures.size(); ++m) {
    for (const double target : study.targets) {
      goals.push_back({m, target});
    }
  }
  return goals;
}

struct Candidate {
  const Method* method = nullptr;
  int effort = 0;
  long steps = 0;
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

/// For each goal the run with the least effort that reaches it, to a few per cent of its number.
std::vector<std::optional<Candidate>> search(const Study& study, const std::vector<Goal>& goals, const Method& method) {
  std::map<int, Outcome> runs;
  double spent = 0.0;
  const auto run = [&](int effort) {
    const auto known = runs.find(effort);
    if (known != runs.end()) {
      return known->second;
    }
    const double before = peers::cpu_seconds();
    Outcome outcome = method.run(effort, false);
    // A run that fails costs what it took until then.
    spent += std::isfinite(outcome.seconds) ? outcome.seconds : peers::cpu_seconds() - before + 0.01;
    if (outcome.seconds < 0.05) {
      outcome.seconds = std::min(outcome.seconds, method.run(effort, true).seconds);
    }
    return runs[effort] = outcome;
  };
  const std::size_t measures = study.measures.size();
  std::array<double, most_measures> best;
  best.fill(none);
  std::array<int, most_measures> idle = {};
  const double growth = method.kind == Class::with_levels ? study.growth_of_levels : std::sqrt(2.0);
  for (double effort = method.first; spent < study.longest_search; effort *= growth) {
    const Outcome outcome = run(static_cast<int>(std::lround(effort)));
    bool goes_on = false;
    for (std::size_t m = 0; m < measures; ++m) {
      // Unstable steps grow worse first as they become shorter.
      idle[m] = best[m] < 1.0 && !(outcome.errors[m] <= 0.8 * best[m]) ? idle[m] + 1 : 0;
      best[m] = std::min(best[m], outcome.errors[m]);
      goes_on = goes_on || (best[m] > study.targets.back() && idle[m] < 3);
    }
    if (!goes_on || (std::isfinite(outcome.seconds) && outcome.seconds > study.longest_run) || effort > 1e7) {
      break;
    }
  }
  std::vector<std::optional<Candidate>> result(goals.size());
  for (std::size_t g = 0; g < goals.size(); ++g) {
    const auto error = [&](const auto& entry) { return entry.second.errors[goals[g].measure]; };
    const auto reaches = [&](auto entry) {
      if (!(error(*entry) <= goals[g].target)) {
        return false;
      }
      return !study.steadily || ++entry == runs.end() || error(*entry) <= 2.0 * goals[g].target;
    };
    const auto first = [&] {
      auto entry = runs.begin();
      while (entry != runs.end() && !reaches(entry)) {
        ++entry;
      }
      return entry;
    };
    for (int refinement = 0; refinement < 3; ++refinement) {
      const auto found = first();
      if (found == runs.end() || found == runs.begin()) {
        break;
      }
      run(static_cast<int>(std::lround(std::sqrt(static_cast<double>(found->first) * std::prev(found)->first))));
    }
    for (auto entry = runs.begin(); entry != runs.end(); ++entry) {
      const auto& [effort, outcome] = *entry;
      if (reaches(entry) && (!result[g] || outcome.seconds < result[g]->seconds)) {
        result[g] = Candidate{&method, effort, outcome.steps, outcome.seconds, {}, {}};
      }
    }
  }
  return result;
}

std::string name_of(const Study& study, Class kind) {
  switch (kind) {
    case Class::peer: return study.by_hand;
    case Class::odeint: return "Boost.Odeint";
    case Class::sundials: return "SUNDIALS";
    case Class::ours: return "fixed levels";
    case Class::with_laws: return "fixed levels, laws";
    case Class::with_levels: return "variable levels";
  }
  return "";
}

/// Which method, on which grid, in how many steps.
std::string label(const Candidate& candidate) {
  std::string text = candidate.method->name;
  if (candidate.method->nodes != 0) {
    text += "/" + std::to_string(candidate.method->nodes);
  }
  return text + "/" + std::to_string(candidate.steps != 0 ? candidate.steps : candidate.effort);
}

Outcome measured(const Study& study, const Candidate& one) {
  Outcome sum = one.method->run(one.effort, true);
  const double wanted = std::min(study.shortest_measurement / sum.seconds, most_repeats);
  double runs = 1.0;
  for (; runs < wanted; runs += 1.0) {
    const Outcome again = one.method->run(one.effort, true);
    sum.seconds += again.seconds;
    sum.before += again.before;
  }
  sum.seconds /= runs;
  sum.before /= runs;
  return sum;
}

}  // namespace

void report(const Study& study, const std::vector<Method>& methods, int repeats) {
  const std::vector<Goal> goals = goals_of(study);
  using Row = std::vector<std::optional<Candidate>>;
  std::map<Class, std::vector<std::vector<Candidate>>> best;
  std::map<std::pair<Class, std::string>, Row> by_name;
  std::printf("\n%s\n", study.title.c_str());
  const auto take = [&](const Method& method, std::size_t g, const Candidate& found) {
    best[method.kind].resize(goals.size());
    best[method.kind][g].push_back(found);
    Row& row = by_name[{method.kind, method.name}];
    row.resize(goals.size());
    if (!row[g] || found.seconds < row[g]->seconds) {
      row[g] = found;
    }
  };
  const auto search_and_take = [&](const Method& method) {
    const auto found = search(study, goals, method);
    for (std::size_t g = 0; g < goals.size(); ++g) {
      if (found[g]) {
        take(method, g, *found[g]);
      }
    }
  };
  for (const Method& method : methods) {
    if (is_peer(method.kind) || method.kind == Class::ours) {
      search_and_take(method);
    }
  }
  // Laws change no level, and variable levels want the grids that equal ones do.
  for (const Method& method : methods) {
    if (is_peer(method.kind) || method.kind == Class::ours) {
      continue;
    }
    const auto fixed = by_name.find({Class::ours, method.name});
    bool grid_is_wanted = method.nodes == 0;
    for (std::size_t g = 0; fixed != by_name.end() && g < goals.size(); ++g) {
      const auto& candidate = fixed->second[g];
      if (!candidate || candidate->method->nodes != method.nodes) {
        continue;
      }
      grid_is_wanted = true;
      if (method.kind == Class::with_laws) {
        take(method, g, {&method, candidate->effort, 0, method.run(candidate->effort, true).seconds, {}, {}});
      }
    }
    if (method.kind == Class::with_levels && grid_is_wanted) {
      search_and_take(method);
    }
  }
  const auto columns = [&](std::size_t measure) {
    std::vector<std::size_t> result;
    for (std::size_t g = 0; g < goals.size(); ++g) {
      if (goals[g].measure == measure) {
        result.push_back(g);
      }
    }
    return result;
  };
  std::printf("  the search, ms (steps), each run at most twice:\n");
  for (std::size_t m = 0; m < study.measures.size(); ++m) {
    for (const auto& [key, row] : by_name) {
      std::printf("    %-10s %-18s %-34s", study.measures[m].c_str(), name_of(study, key.first).c_str(),
                  key.second.c_str());
      for (const std::size_t g : columns(m)) {
        if (const auto& entry = row[g]) {
          const long steps = entry->steps != 0 ? entry->steps : entry->effort;
          char place[48];
          std::snprintf(place, sizeof place, entry->method->nodes != 0 ? "(%zu, %ld)" : "(%.0zu%ld)",
                        entry->method->nodes, steps);
          std::printf(" %10.3f %-14s", 1e3 * entry->seconds, place);
        } else {
          std::printf(" %10s %-14s", "-", "");
        }
      }
      std::printf("\n");
    }
  }
  for (auto& [kind, of_goals] : best) {
    for (auto& candidates : of_goals) {
      std::ranges::sort(candidates, {}, &Candidate::seconds);
      candidates.resize(std::min(candidates.size(), finalists));
    }
  }
  for (int repeat = 0; repeat < repeats; ++repeat) {
    for (auto& [kind, of_goals] : best) {
      for (auto& candidates : of_goals) {
        for (Candidate& one : candidates) {
          const Outcome outcome = measured(study, one);
          one.times.push_back(outcome.seconds);
          one.befores.push_back(outcome.before);
        }
      }
    }
  }
  std::map<Class, std::vector<double>> medians;
  const auto least = [&](auto&& belongs, std::size_t g) {
    double result = none;
    for (const auto& [kind, times] : medians) {
      result = belongs(kind) ? std::min(result, times[g]) : result;
    }
    return result;
  };
  for (std::size_t m = 0; m < study.measures.size(); ++m) {
    std::printf("  medians of %d in turns, ms, for an error of the %s of\n%-24s", repeats, study.measures[m].c_str(),
                "");
    for (const double target : study.targets) {
      std::printf("%40.0e", target);
    }
    std::printf("\n");
    for (auto& [kind, of_goals] : best) {
      std::printf("%-24s", name_of(study, kind).c_str());
      medians[kind].resize(goals.size(), none);
      for (const std::size_t g : columns(m)) {
        if (of_goals[g].empty()) {
          std::printf(" %39s", "-");
          continue;
        }
        const Candidate& first = *std::ranges::min_element(of_goals[g], {}, &Candidate::time);
        medians[kind][g] = first.time();
        char text[96];
        std::snprintf(text, sizeof text, "%.3f±%.0f%% %s", 1e3 * first.time(), 100.0 * first.spread(),
                      label(first).c_str());
        std::printf(" %39s", text);
      }
      std::printf("\n");
    }
    if (best.contains(Class::with_levels)) {
      std::printf("%-24s", "  of it the look-ahead");
      for (const std::size_t g : columns(m)) {
        const auto& candidates = best[Class::with_levels][g];
        if (candidates.empty()) {
          std::printf(" %39s", "-");
        } else {
          const Candidate& first = *std::ranges::min_element(candidates, {}, &Candidate::time);
          std::printf("%40.3f", 1e3 * Candidate::median(first.befores));
        }
      }
      std::printf("\n");
    }
    const auto ratios = [&](const std::string& name, auto&& over, auto&& under) {
      const auto has = [&](auto&& belongs) {
        return std::ranges::any_of(medians, [&](const auto& entry) { return belongs(entry.first); });
      };
      if (!has(over) || !has(under)) {
        return;
      }
      std::printf("%-24s", name.c_str());
      for (const std::size_t g : columns(m)) {
        const double ratio = least(over, g) / least(under, g);
        if (std::isfinite(ratio)) {
          std::printf("%40.2f", ratio);
        } else {
          std::printf("%40s", "-");
        }
      }
      std::printf("\n");
    };
    const auto only = [](Class which) { return [which](Class kind) { return kind == which; }; };
    ratios("fixed / best peer", only(Class::ours), is_peer);
    ratios("laws / fixed", only(Class::with_laws), only(Class::ours));
    ratios("variable / fixed", only(Class::with_levels), only(Class::ours));
    ratios("variable / best peer", only(Class::with_levels), is_peer);
  }
  std::fflush(stdout);
}

}  // namespace comparison
