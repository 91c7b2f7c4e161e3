#include <rubato/pde/periodicity.hpp>

#include <algorithm>
#include <cmath>
#include <vector>

#include <fmt/format.h>

#include <rubato/grids/reductions.hpp>
#include <rubato/grids/whole.hpp>
#include <rubato/pde/tuning.hpp>

namespace rubato {

namespace {

using namespace tuning::periodicity;

/// One line of values, round its period.
class Line {
public:
  explicit Line(std::size_t cells) : values_(cells), reach_(std::min(farthest, cells / 2 - 1)) {}

  void take(std::span<const double> values) { std::ranges::copy(values, values_.begin()); }

  [[nodiscard]] double at(std::size_t i) const { return values_[i % values_.size()]; }
  [[nodiscard]] double second(std::size_t i) const {
    return std::abs(at(i + values_.size() - 1) - 2.0 * at(i) + at(i + 1));
  }
  [[nodiscard]] double fourth(std::size_t i) const {
    const std::size_t n = values_.size();
    return std::abs(at(i + n - 2) - 4.0 * at(i + n - 1) + 6.0 * at(i) - 4.0 * at(i + 1) + at(i + 2));
  }
  [[nodiscard]] bool at_seam(std::size_t i) const { return i < 2 || i + 2 >= values_.size(); }

  /// By how much a node stands out among those around it; what the seam does to them is not looked at.
  [[nodiscard]] double standing_out_at(std::size_t i) const {
    const std::size_t n = values_.size();
    const double own = fourth(i);
    double around = 0.0;
    for (std::size_t away = nearest; away <= reach_ && own > standing_out * around; ++away) {
      for (const std::size_t j : {(i + away) % n, (i + n - away) % n}) {
        around = at_seam(j) ? around : std::max(around, fourth(j));
      }
    }
    return own - standing_out * around;
  }

  /// The same of the seam.
  [[nodiscard]] double seam() const {
    const std::size_t n = values_.size();
    return std::max({standing_out_at(0), standing_out_at(1), standing_out_at(n - 2), standing_out_at(n - 1)});
  }

  [[nodiscard]] const std::vector<double>& values() const { return values_; }

private:
  std::vector<double> values_;
  std::size_t reach_;
};

/// What kind of break the line has.
SeamBreak classify(const std::vector<double>& line, int axis, std::size_t node, double spacing) {
  const std::size_t n = line.size();
  const auto step = [&](std::size_t i) { return line[(i + 1) % n] - line[i % n]; };  // from node i to the next
  // The jump between two nodes is what the steps before and after it do not lead on to.
  const auto jump = [&](std::size_t i) { return step(i) - 0.5 * (step(i + n - 1) + step(i + 1)); };
  const auto kink = [&](std::size_t i) { return (step(i) - step(i + n - 1)) / spacing; };  // at node i
  // Second differences on both sides of a jump are opposite and alike; at a kink they are not.
  const double left = step(n - 1) - step(n - 2);
  const double right = step(n) - step(n - 1);
  SeamBreak result{axis, node,
                   left * right < 0.0 &&
                       std::min(std::abs(left), std::abs(right)) > 0.3 * std::max(std::abs(left), std::abs(right))};
  result.across = result.jump ? jump(n - 1) : std::abs(left) > std::abs(right) ? kink(n - 1) : kink(0);
  for (std::size_t i = 1; i + 2 < n; ++i) {
    result.inside = std::max(result.inside, std::abs(result.jump ? jump(i) : kink(i)));
  }
  return result;
}

}  // namespace

std::optional<SeamBreak> find_seam_break(const grids::Grid& grid, std::span<const double> values) {
  std::vector<double> line;
  return find_seam_break(grid, grids::max_abs(values), [&](int axis, const UseOfLine& use) {
    line.resize(grids::whole_of(grid).cells(axis));
    grids::for_each_line(grid, axis, values, [&](const double* array, const grids::Line& at, std::size_t first) {
      at.read(array, line);
      use(line, first);
    });
  });
}

std::optional<SeamBreak> find_seam_break(const grids::Grid& grid, double largest,
                                         const std::function<void(int axis, const UseOfLine& use)>& for_each_line) {
  std::optional<SeamBreak> worst;
  double most = rounding_of_values * largest;
  for (int a = 0; a < grid.dimensions(); ++a) {
    const std::size_t n = grids::whole_of(grid).cells(a);
    if (n < shortest_line || grid.axis(a).ghosts > 0) {
      continue;
    }
    Line line(n), shown(n);
    std::size_t first = 0;
    double seam = 0.0;
    for_each_line(a, [&](std::span<const double> values, std::size_t node) {
      line.take(values);
      if (const double out = line.seam(); out > seam) {
        seam = out;
        shown = line;
        first = node;
      }
    });
    if (!grids::agreed(grid, seam > most)) {
      continue;
    }
    double inside = 0.0;
    double second = 0.0;
    for_each_line(a, [&](std::span<const double> values, std::size_t) {
      line.take(values);
      for (std::size_t i = 2; i + 2 < n; ++i) {
        inside = std::max(inside, line.standing_out_at(i));
        second = std::max(second, line.second(i));
      }
    });
    if (seam > beyond_inside * inside && seam > 3.0 * of_second_difference * second) {
      most = seam;
      worst = classify(shown.values(), a, first, grid.spacing(a));
    }
  }
  return worst;
}

std::string describe_break(const SeamBreak& broken, const grids::Grid& grid, const std::string& what) {
  const grids::Axis& axis = grid.axis(broken.axis);
  std::string where;
  const auto place = grid.place(broken.node);
  for (int a = 0; a < grid.dimensions(); ++a) {
    if (a != broken.axis) {
      where += fmt::format("{}{} = {:.6g}", where.empty() ? " (at " : ", ", grid.axis(a).name,
                           grid.axis(a).node(place[static_cast<std::size_t>(a)]));
    }
  }
  where += where.empty() ? "" : ")";
  return fmt::format(
      "across the seam, where {0} = {1:.6g} is {0} = {2:.6g} again{3}, {4} jumps by {5:.3g} (inside, by {6:.2g} at "
      "most "
      "between neighbours)",
      axis.name, axis.to, axis.from, where, what, broken.across, broken.inside);
}

std::string describe(const SeamBreak& broken, const grids::Grid& grid, const std::string& field) {
  const grids::Axis& axis = grid.axis(broken.axis);
  return fmt::format(
      "the initial {0} is not periodic in {1}: {2}, and the scheme takes the {3} for a part of the solution. Give data "
      "that repeat with the period {4:.6g}, or widen the grid until they do",
      field, axis.name, describe_break(broken, grid, broken.jump ? "it" : "its slope"), broken.jump ? "jump" : "kink",
      axis.length());
}

}  // namespace rubato
