#include <rubato/pde/euler_box_formulas.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <span>
#include <utility>

#include <fmt/format.h>

#include <rubato/formula/sum.hpp>
#include <rubato/pde/lattice_scheme.hpp>
#include <rubato/pde/matrix_terms.hpp>
#include <rubato/pde/mirrors.hpp>
#include <rubato/pde/placed_coordinates.hpp>

namespace rubato {

namespace {

using formula::Expression;
using grids::SpaceOperator;

/// The uniform number of the code.
constexpr int number_of_factor = 0;

}  // namespace

EulerBoxFormulas::EulerBoxFormulas(const MultisymplecticSystem& system, const grids::Grid& grid,
                                   std::vector<int> derived)
    : system_(system),
      grid_(grid),
      formulas_(grid),
      derived_(std::move(derived)),
      gradient_(formula::gradient(system.expression(),
                                  std::span(system.variables()).first(static_cast<std::size_t>(system.field_count())))),
      coordinates_(PlacedCoordinates(system, grid, Within::node).values()) {
  if (grid.has_ghosts()) {
    mirrors_.emplace(system, grid, Collocation::corners);
    check_walls();
  }
}

/// In a mirror a difference of nodes becomes minus the one on the other side: it has its place in the middle between
/// them, where the field that K joins with it has to be, and no term of S may join values of different places.
void EulerBoxFormulas::check_walls() const {
  const int d = system_.field_count();
  const auto name = [&](int f) { return system_.fields()[static_cast<std::size_t>(f)]; };
  for (int a = 0; a < grid_.dimensions(); ++a) {
    if (grid_.axis(a).ghosts == 0) {
      continue;
    }
    const std::string remedy =
        fmt::format("take lagrangian = \"fourier\", or leave left and right of {} out", grid_.axis(a).name);
    for (const MatrixTerm& term : terms_of(system_.structure().K_plus[static_cast<std::size_t>(a)])) {
      if (mirrors_->offset(a, term.row) - mirrors_->offset(a, term.column) != 1) {
        throw SchemeRefusal(
            fmt::format("euler-box has walls where K joins each field that has no equation of motion with fields that "
                        "have one, and along {} it joins {} with {}: {}",
                        grid_.axis(a).name, name(term.row), name(term.column), remedy));
      }
    }
    std::vector<int> signs(static_cast<std::size_t>(d), 1);
    for (int f = 0; f < d; ++f) {
      const bool turns = mirrors_->sign(a, f, grid_.axis(a).left) < 0 || mirrors_->sign(a, f, grid_.axis(a).right) < 0;
      signs[static_cast<std::size_t>(f)] = mirrors_->offset(a, f) != 0 && turns ? -1 : 1;
    }
    if (const auto changed = find_changed_term(system_, signs, std::vector<double>(signs.size(), 0.0))) {
      throw SchemeRefusal(
          fmt::format("a free wall of euler-box needs an S that is the same in a mirror, and its term {} "
                      "changes: {}",
                      changed->term, remedy));
    }
    for (const Expression& term : formula::terms_of(system_.expression(), formula::Products::expanded)) {
      const auto reads = [&](const Expression& variable) {
        return std::ranges::binary_search(formula::variables_of(term), formula::variables_of(variable).front());
      };
      const std::span<const Expression> variables = system_.variables();
      std::optional<int> place;
      for (std::size_t v = 0; v < variables.size(); ++v) {
        if (reads(variables[v])) {
          const int here = static_cast<int>(v) < d ? mirrors_->offset(a, static_cast<int>(v)) : 0;
          if (place.value_or(here) != here) {
            throw SchemeRefusal(
                fmt::format("euler-box has its derivatives along {} between nodes, and no wall where a "
                            "term of S, {}, joins them with values at nodes: {}",
                            grid_.axis(a).name, formula::to_string(term), remedy));
          }
          place = here;
        }
      }
    }
  }
}

Expression EulerBoxFormulas::where_loose(int field, Expression change) {
  if (mirrors_) {
    for (const PlaceNumbers& numbers : mirrors_->loose(grid_, field)) {
      change = formulas_.along_axis(numbers) * change;
    }
  }
  return change;
}

bool EulerBoxFormulas::is_derived(int field) const {
  return std::ranges::find(derived_, field) != derived_.end();
}

EulerBoxFormulas::FieldAt EulerBoxFormulas::of(Level level) {
  const int first = level == Level::before ? 0 : system_.field_count();
  return [this, first](int field, const std::array<int, 3>& offset) {
    const auto stored = [&](int f, const std::array<int, 3>& at) { return formulas_.node(first + f, at); };
    if (!is_derived(field)) {
      return stored(field, offset);
    }
    return constraint(field, field,
                      [&](int f, const std::array<int, 3>& further) { return stored(f, shifted(offset, further)); });
  };
}

Expression EulerBoxFormulas::difference(const FieldAt& z, int field, const SpaceOperator& op) {
  Expression sum;
  double scale = 1.0;
  for (const auto& [offset, weight] : formulas_.weights(op)) {
    scale = std::abs(weight);  // of both nodes: a difference of equal values is exactly 0
    add_weighted(sum, weight / scale, z(field, offset));
  }
  return scale * sum;
}

Expression EulerBoxFormulas::in_place_of_fields(Expression formula, const FieldAt& z) {
  std::vector<Expression> values;
  for (int f = 0; f < system_.field_count(); ++f) {
    values.push_back(z(f, {}));
  }
  for (int c = 0; c < coordinates_.fields(); ++c) {
    values.push_back(formulas_.node(2 * system_.field_count() + c));
  }
  return formula::substitute(std::array{formula}, formulas_.graph(), system_.variables(), values).front();
}

Expression EulerBoxFormulas::row(int number, const FieldAt& z) {
  Expression sum = in_place_of_fields(gradient_[static_cast<std::size_t>(number)], z);
  for (int a = 0; a < system_.directions(); ++a) {
    for (const MatrixTerm& term : terms_of(system_.structure().K_plus[static_cast<std::size_t>(a)])) {
      if (term.row == number) {
        add_weighted(sum, -term.value, difference(z, term.column, SpaceOperator::forward_difference(a)));
      }
      if (term.column == number) {
        add_weighted(sum, term.value, difference(z, term.row, SpaceOperator::backward_difference(a)));
      }
    }
  }
  return sum;
}

Expression EulerBoxFormulas::constraint(int number, int field, const FieldAt& z) {
  const Expression rest = row(number, [&](int f, const std::array<int, 3>& offset) {
    return f == field ? formulas_.graph().constant(0.0) : z(f, offset);
  });
  return rest / -system_.constant_hessian()(number, field);
}

NodeCode EulerBoxFormulas::kick(int number, int column) {
  const FieldAt before = of(Level::before);
  return formulas_.code(
      std::array{before(column, {}) + where_loose(column, formulas_.uniform(number_of_factor)) * row(number, before)});
}

NodeCode EulerBoxFormulas::solve(int number, int field) {
  const FieldAt before = of(Level::before), after = of(Level::after);
  const Expression at_first = row(number, [&](int f, const std::array<int, 3>& offset) {
    return f == field ? before(f, offset) : after(f, offset);
  });
  return formulas_.code(
      std::array{before(field, {}) - where_loose(field, formulas_.uniform(number_of_factor)) * at_first});
}

NodeCode EulerBoxFormulas::constraint(int number, int field) {
  return formulas_.code(std::array{constraint(number, field, of(Level::after))});
}

NodeCode EulerBoxFormulas::energy() {
  const FieldAt z = of(Level::after);
  Expression density = in_place_of_fields(system_.expression(), z);
  for (int a = 0; a < system_.directions(); ++a) {
    for (const MatrixTerm& term : terms_of(system_.structure().K_plus[static_cast<std::size_t>(a)])) {
      if (mirrors_ && mirrors_->offset(a, term.column) < 0) {
        // Summed by parts: with differences of the field at nodes no term is left on a wall.
        add_weighted(density, term.value,
                     difference(z, term.row, SpaceOperator::backward_difference(a)) * z(term.column, {}));
      } else {
        add_weighted(density, -term.value,
                     z(term.row, {}) * difference(z, term.column, SpaceOperator::forward_difference(a)));
      }
    }
  }
  Expression none = formulas_.graph().constant(0.0);
  for (int f = 0; f < system_.field_count(); ++f) {
    if (!is_derived(f)) {
      none = none + 0.0 * z(f, {});
    }
  }
  if (mirrors_) {
    density = formulas_.between_walls(density, [this](const NodeInput& input) {
      std::array<int, 3> twice{};
      for (int a = 0; a < grid_.dimensions() && input.number < 2 * system_.field_count(); ++a) {
        twice[static_cast<std::size_t>(a)] =
            grid_.axis(a).ghosts > 0 ? mirrors_->offset(a, input.number % system_.field_count()) : 0;
      }
      return twice;
    });
  }
  return formulas_.code(std::array{density, none});
}

void EulerBoxFormulas::read(NodeCode& code, double factor, const grids::FieldSet& lower,
                            const grids::FieldSet& upper) const {
  static const PotentialSlopes none;
  code.read({&lower, &upper, &coordinates_}, std::array{factor}, none);
}

}  // namespace rubato
