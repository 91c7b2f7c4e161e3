#include <rubato/pde/periodicity.hpp>

#include <algorithm>
#include <cmath>
#include <vector>

#include <fmt/format.h>

#include <rubato/grids/lines.hpp>
#include <rubato/grids/reductions.hpp>

namespace rubato {

namespace {

constexpr std::size_t shortest_line = 16;
constexpr std::size_t nearest = 4;  ///< a stencil of five nodes reaches 2 to each side of a break
constexpr std::size_t farthest = 10;
constexpr double standing_out = 10.0;
constexpr double beyond_inside = 4.5;  ///< a kink between two nodes gives a quarter of what one at a node gives
constexpr double of_second_difference = 0.02;
constexpr double rounding = 1e-12;

/// What one line says.
struct LineBreak {
  double seam = 0.0;    ///< by how much a node at the seam stands out
  double inside = 0.0;  ///< the same of nodes inside
  double fourth = 0.0;  ///< the largest |D⁴| at the seam
  double second = 0.0;  ///< the largest second difference inside
};

class LineReader {
public:
  explicit LineReader(std::size_t cells) : line_(cells), fourth_(cells) {}

  LineBreak operator()(const grids::Line& at, const double* values) {
    at.read(values, line_);
    const std::size_t n = line_.size();
    const auto z = [&](std::size_t i) { return line_[i % n]; };
    LineBreak result;
    for (std::size_t i = 0; i < n; ++i) {
      fourth_[i] = std::abs(z(i + n - 2) - 4.0 * z(i + n - 1) + 6.0 * z(i) - 4.0 * z(i + 1) + z(i + 2));
      if (i > 0 && i + 1 < n) {
        result.second = std::max(result.second, std::abs(z(i - 1) - 2.0 * z(i) + z(i + 1)));
      }
    }
    const std::size_t reach = std::min(farthest, n / 2 - nearest);
    for (std::size_t i = 0; i < n; ++i) {
      const bool at_seam = i < 2 || i + 2 >= n;
      if (!at_seam && (i < 2 + nearest || i + 2 + nearest >= n)) {
        continue;  // sees the seam itself
      }
      double around = 0.0;
      for (std::size_t away = nearest; away <= reach; ++away) {
        around = std::max({around, fourth_[(i + away) % n], fourth_[(i + n - away) % n]});
      }
      const double out = fourth_[i] - standing_out * around;
      (at_seam ? result.seam : result.inside) = std::max(at_seam ? result.seam : result.inside, out);
      result.fourth = at_seam ? std::max(result.fourth, fourth_[i]) : result.fourth;
    }
    return result;
  }

  [[nodiscard]] const std::vector<double>& line() const { return line_; }

private:
  std::vector<double> line_, fourth_;
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
  std::optional<SeamBreak> worst;
  double most = 0.0;
  const double size = grids::max_abs(values);
  for (int a = 0; a < grid.dimensions(); ++a) {
    if (grid.cells(a) < shortest_line) {
      continue;
    }
    LineReader read(grid.cells(a));
    LineBreak all;
    grids::Line shown;
    for (const grids::Line& at : grids::lines_along(grid, a)) {
      const LineBreak line = read(at, values.data());
      if (line.seam > all.seam) {
        all.seam = line.seam;
        all.fourth = line.fourth;
        shown = at;
      }
      all.inside = std::max(all.inside, line.inside);
      all.second = std::max(all.second, line.second);
    }
    if (all.seam > beyond_inside * all.inside && all.fourth / 3.0 > of_second_difference * all.second &&
        all.seam > rounding * size && all.seam > most) {
      most = all.seam;
      static_cast<void>(read(shown, values.data()));
      worst = classify(read.line(), a, shown.first, grid.spacing(a));
    }
  }
  return worst;
}

std::string describe(const SeamBreak& broken, const grids::Grid& grid, const std::string& field) {
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
      "the initial {0} is not periodic in {1}: across the seam, where {1} = {2:.6g} is {1} = {3:.6g} again{4}, {5} by "
      "{6:.3g} (inside, by {7:.2g} at most between neighbours), and the scheme takes the {8} for a part of the "
      "solution. "
      "Give data that repeat with the period {9:.6g}, or widen the grid until they do",
      field, axis.name, axis.to, axis.from, where, broken.jump ? "it jumps" : "its slope jumps", broken.across,
      broken.inside, broken.jump ? "jump" : "kink", axis.length());
}

}  // namespace rubato
