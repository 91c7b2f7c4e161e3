#include <rubato/figures/members.hpp>

#include <algorithm>
#include <array>
#include <cmath>

#include <fmt/format.h>

namespace rubato::figures {

namespace {

/// The words of a run's table.
struct Labelled {
  std::string_view name, label;
};
constexpr std::array labelled = {
    Labelled{"steps", "steps"},
    Labelled{"t", "last level"},
    Labelled{"discrete_energy/max_relative_deviation", "discrete energy, relative deviation"},
    Labelled{"discrete_energy/max_deviation", "discrete energy, deviation"},
    Labelled{"node_energy/max_deviation", "node energy, deviation"},
    Labelled{"off_law/steps", "steps off the law"},
    Labelled{"step_condition/max", "step condition"},
    Labelled{"lyapunov/exponents/1", "largest Lyapunov exponent"},
    Labelled{"lyapunov/megno", "MEGNO"},
    Labelled{"symplecticity/max", "two-form, defect"},
    Labelled{"stopped/t", "ended by an event at"},
};

/// Names with something of the problem's in the middle.
struct Pattern {
  std::string_view before, after, label_before, label_after;
};
constexpr std::array patterns = {
    Pattern{"events/", "/count", "event ", ""},     Pattern{"events/", "/first", "", ", first"},
    Pattern{"residuals/", "/max", "residual ", ""}, Pattern{"constraints/", "/max", "constraint ", ""},
    Pattern{"error/", "/max", "error in ", ""},     Pattern{"invariants/", "/max_deviation", "", ", deviation"},
};

double quantile(std::span<const double> sorted, double part) {
  const double place = part * static_cast<double>(sorted.size() - 1);
  const auto below = static_cast<std::size_t>(place);
  const std::size_t above = std::min(below + 1, sorted.size() - 1);
  const double weight = place - static_cast<double>(below);
  return sorted[below] * (1.0 - weight) + sorted[above] * weight;
}

}  // namespace

Distribution distribution_of(std::span<const double> values) {
  Distribution result;
  std::vector<double> sorted;
  double sum = 0.0;
  for (std::size_t member = 0; member < values.size(); ++member) {
    const double value = values[member];
    if (!std::isfinite(value)) {
      ++result.undefined;
      continue;
    }
    if (sorted.empty() || value > result.max) {
      result.max = value;
      result.worst = member;
    }
    sorted.push_back(value);
    sum += value;
  }
  result.defined = sorted.size();
  if (!result.any()) {
    return result;
  }
  std::ranges::sort(sorted);
  result.min = sorted.front();
  result.lower = quantile(sorted, 0.25);
  result.median = quantile(sorted, 0.5);
  result.upper = quantile(sorted, 0.75);
  result.mean = sum / static_cast<double>(result.defined);
  return result;
}

std::string label_of_figure(const std::string& name) {
  const auto known = std::ranges::find(labelled, name, &Labelled::name);
  if (known != labelled.end()) {
    return std::string(known->label);
  }
  for (const Pattern& pattern : patterns) {
    if (name.starts_with(pattern.before) && name.ends_with(pattern.after)) {
      const std::size_t fixed = pattern.before.size() + pattern.after.size();
      return fmt::format("{}{}{}", pattern.label_before, name.substr(pattern.before.size(), name.size() - fixed),
                         pattern.label_after);
    }
  }
  return "";
}

std::size_t rank_of_figure(const std::string& name) {
  const auto known = std::ranges::find(labelled, name, &Labelled::name);
  const auto of = std::ranges::find_if(patterns, [&name](const Pattern& pattern) {
    return name.starts_with(pattern.before) && name.ends_with(pattern.after);
  });
  return known != labelled.end() ? static_cast<std::size_t>(known - labelled.begin())
                                 : labelled.size() + static_cast<std::size_t>(of - patterns.begin());
}

Line line_of(const std::string& label, const Distribution& distribution) {
  Line line{.label = label, .value = "", .remark = ""};
  line.value = distribution.min == distribution.max
                   ? fmt::format("{:.6g} in all", distribution.max)
                   : fmt::format("{:.3g} to {:.3g}, mean {:.3g}, half in {:.3g} to {:.3g}", distribution.min,
                                 distribution.max, distribution.mean, distribution.lower, distribution.upper);
  if (distribution.min != distribution.max) {
    line.remark = fmt::format("the largest in member {}", distribution.worst);
  }
  if (distribution.undefined > 0) {
    line.remark += fmt::format("{}none in {}", line.remark.empty() ? "" : "; ", distribution.undefined);
  }
  return line;
}

}  // namespace rubato::figures
