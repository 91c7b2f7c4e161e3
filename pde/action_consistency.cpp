#include <rubato/pde/action_consistency.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>

#include <rubato/formula/bytecode.hpp>
#include <rubato/pde/action_rows.hpp>
#include <rubato/pde/static_condensation.hpp>

namespace rubato {

namespace {

using formula::Expression;
/// A time and a place.
using Event = std::array<double, 4>;

/// Where rows are looked at.
constexpr Event centre = {0.3, 0.7, -0.4, 0.2};
/// Of differences of fourth order, 1e-9 of a derivative off.
constexpr double width = 4e-3;
/// Halving steps and cells takes a half of an error of the first order; less than a quarter off does not count. It is
/// halved twice: the errors of two orders cancel at one size and make the next one larger.
constexpr double falls = 0.7;
/// Of the terms of a row: what is smaller is the error of the differences.
constexpr double nothing = 1e-5;

/// Smooth fields; those that L does not name from their rows, which are linear in them.
class SmoothFields {
public:
  SmoothFields(const MultisymplecticSystem& system, const StatedAction& stated) : system_(system) {
    for (int f = 0; f < system.field_count(); ++f) {
      rows_.push_back(stated.names(f) ? std::nullopt : linear_row(system, f));
      known_.push_back(stated.names(f));
    }
  }

  /// True if every field has a value.
  [[nodiscard]] bool are_known() const {
    for (int f = 0; f < system_.field_count(); ++f) {
      const auto i = static_cast<std::size_t>(f);
      if (known_[i]) {
        continue;
      }
      for (int g = 0; g < system_.field_count(); ++g) {
        bool reads = system_.M()(f, g) != 0.0;
        for (int a = 0; a < system_.directions(); ++a) {
          reads = reads || system_.K(a)(f, g) != 0.0;
        }
        if (!rows_[i] || (reads && !known_[static_cast<std::size_t>(g)])) {
          return false;
        }
      }
    }
    return true;
  }

  [[nodiscard]] double value(int f, const Event& at) const {
    const auto i = static_cast<std::size_t>(f);
    if (known_[i]) {
      double phase = 0.4 + 1.3 * f;
      for (std::size_t a = 0; a < at.size(); ++a) {
        phase += (0.9 - 0.13 * static_cast<double>(a) + 0.05 * f) * at[a];
      }
      return 0.7 + 0.25 * std::sin(phase);
    }
    return (moved(f, at) - rows_[i]->b) / rows_[i]->a;
  }
  /// (M z_t + Σ K_a z_{x_a})_f.
  [[nodiscard]] double moved(int f, const Event& at) const {
    double sum = 0.0;
    for (int g = 0; g < system_.field_count(); ++g) {
      for (int rho = 0; rho <= system_.directions(); ++rho) {
        if (const double entry = rho == 0 ? system_.M()(f, g) : system_.K(rho - 1)(f, g); entry != 0.0) {
          sum += entry * slope(g, static_cast<std::size_t>(rho), at);
        }
      }
    }
    return sum;
  }

private:
  [[nodiscard]] double slope(int f, std::size_t rho, const Event& at) const {
    const auto off = [&](double by) {
      Event there = at;
      there[rho] += by * width;
      return value(f, there);
    };
    return (8.0 * (off(1.0) - off(-1.0)) - (off(2.0) - off(-2.0))) / (12.0 * width);
  }

  const MultisymplecticSystem& system_;
  std::vector<std::optional<LinearRow>> rows_;
  std::vector<bool> known_;
};

/// Rows of the variation at the centre for steps and cells of about this size, field by field.
std::vector<double> rows_at(const MultisymplecticSystem& system, const StatedAction& stated, const SmoothFields& fields,
                            double size) {
  std::vector<grids::Axis> axes;
  constexpr std::array names = {"x", "y", "z"};
  constexpr std::size_t cells = 5;
  for (std::size_t a = 0; a < static_cast<std::size_t>(system.directions()); ++a) {
    axes.push_back({names[a], 0.0, static_cast<double>(cells) * size * (0.8 - 0.1 * static_cast<double>(a)), cells});
  }
  const grids::Grid grid(axes);
  const ActionRows rows(system, grid, stated);
  std::vector<Expression> formulas;
  for (const ActionRows::Row& row : rows.rows()) {
    formulas.insert(formulas.end(), {row.lower, row.upper});
  }
  const int d = system.field_count();
  const std::vector<LatticeAction::Place>& places = stated.action.places;
  const auto of_slab = [&](double begin) {
    return rows.values(formulas, [&](const NodeInput& input) {
      if (input.kind == NodeInput::Kind::uniform) {
        return input.number == NodeVariation::number_of_h ? size : 1.0 / size;
      }
      if (input.kind == NodeInput::Kind::slope) {
        return 0.0;
      }
      Event at = centre;
      for (int a = 0; a < grid.dimensions(); ++a) {
        at[static_cast<std::size_t>(1 + a)] += grid.spacing(a) * input.offset[static_cast<std::size_t>(a)];
      }
      if (input.number >= 2 * d) {
        return at[static_cast<std::size_t>(1 + places[static_cast<std::size_t>(input.number - 2 * d)].axis)];
      }
      const bool in_slab = system.structure().at_midpoints(input.number % d);
      at[0] += begin + (in_slab ? 0.5 : input.number < d ? 0.0 : 1.0) * size;
      return fields.value(input.number % d, at);
    });
  };
  const std::vector<double> before = of_slab(-size), after = of_slab(0.0);
  std::vector<double> found;
  for (std::size_t i = 0; i < rows.rows().size(); ++i) {
    const double upper = before[2 * i + 1];
    found.push_back((upper + (rows.rows()[i].in_slab ? 0.0 : after[2 * i])) / size);
  }
  return found;
}

}  // namespace

std::vector<std::string> inconsistent_rows(const MultisymplecticSystem& system, const StatedAction& stated) {
  const SmoothFields fields(system, stated);
  if (!fields.are_known()) {
    return {};
  }
  std::vector<double> point, gradient(1 + system.fields().size());
  for (int f = 0; f < system.field_count(); ++f) {
    point.push_back(fields.value(f, centre));
  }
  for (const int axis : system.coordinates()) {
    point.push_back(centre[static_cast<std::size_t>(1 + axis)]);
  }
  formula::ScalarEvaluator(system.gradient_code())(point, gradient);
  constexpr double coarse = 1.0 / 16.0;
  const std::array sizes = {rows_at(system, stated, fields, coarse), rows_at(system, stated, fields, 0.5 * coarse),
                            rows_at(system, stated, fields, 0.25 * coarse)};
  std::vector<std::string> wrong;
  std::size_t row = 0;
  for (int f = 0; f < system.field_count(); ++f) {
    if (!stated.names(f)) {
      continue;
    }
    const double moved = fields.moved(f, centre), forced = gradient[static_cast<std::size_t>(1 + f)];
    const auto error = [&](std::size_t size) { return std::abs(sizes[size][row] - (moved - forced)); };
    if (std::isfinite(error(0)) && std::isfinite(error(1)) && error(1) > falls * error(0) &&
        error(2) > falls * error(1) && error(2) > nothing * (std::abs(moved) + std::abs(forced))) {
      wrong.push_back(system.fields()[static_cast<std::size_t>(f)]);
    }
    ++row;
  }
  return wrong;
}

}  // namespace rubato
