#include <rubato/variation/corner_density.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <optional>

#include <fmt/format.h>

#include <rubato/variation/corner_differences.hpp>
#include <rubato/variation/random_values.hpp>

namespace rubato {

namespace {

using formula::Expression;

constexpr std::array<const char*, 4> spacing_names = {"h", "dx", "dy", "dz"};
constexpr std::array<const char*, 3> place_names = {"x", "y", "z"};

bool depends_on(Expression formula, Expression variable) {
  const auto numbers = formula::variables_of(formula);
  return std::ranges::find(numbers, formula::variables_of(variable).front()) != numbers.end();
}

/// +1 at the upper of two corners along a direction, 0 for time, -1 at the lower.
double side(int corner, int direction, int dimensions) {
  const int bit = direction == 0 ? dimensions : direction - 1;
  return (corner >> bit & 1) != 0 ? 1.0 : -1.0;
}

}  // namespace

bool CornerDensity::names(int field) const {
  for (int c = 0; c < corner_count(); ++c) {
    if (depends_on(L, corner(field, c))) {
      return true;
    }
  }
  return false;
}

bool CornerDensity::names_place(int axis) const {
  return depends_on(L, places[static_cast<std::size_t>(axis)]);
}

bool CornerDensity::reads_middle(int field) const {
  const int half = corner_count() / 2;
  for (int c = 0; c < half; ++c) {
    const std::vector<Expression> both = formula::gradient(L, std::array{corner(field, c), corner(field, half + c)});
    if (!vanishes_at_random(both[0] - both[1], both)) {
      return false;
    }
  }
  return true;
}

bool CornerDensity::energy_reads_one_level() const {
  const Expression energy = L + spacings.front() * formula::derivative(L, spacings.front());
  const int half = corner_count() / 2;
  std::array<bool, 2> reads{};
  bool all_rows_join = true;
  for (int f = 0; f < fields; ++f) {
    bool has_row = false, joins = false;
    for (int c = 0; c < half; ++c) {
      reads[0] = reads[0] || depends_on(energy, corner(f, c));
      reads[1] = reads[1] || depends_on(energy, corner(f, half + c));
      const Expression row = formula::derivative(L, corner(f, c));
      has_row = has_row || !is_zero(row);
      for (int g = 0; g < fields; ++g) {
        for (int upper = half; upper < 2 * half; ++upper) {
          joins = joins || depends_on(row, corner(g, upper));
        }
      }
    }
    all_rows_join = all_rows_join && (joins || !has_row);
  }
  return !(reads[0] && reads[1]) || !all_rows_join;
}

std::vector<Expression> cell_equations(const CornerDensity& density) {
  const int n = density.dimensions, corners = density.corner_count(), d = density.fields;
  const std::vector<Expression> first = formula::gradient(density.L, density.corners);
  const auto of = [&](int field, int corner) { return first[static_cast<std::size_t>(field * corners + corner)]; };
  /// Σ_c s(c) term(c), s the product of the sides along some directions.
  const auto signed_sum = [&](int field, unsigned directions, const auto& term) {
    Expression sum;
    for (int c = 0; c < corners; ++c) {
      double sign = 1.0;
      for (int rho = 0; rho <= n; ++rho) {
        sign *= (directions >> rho & 1U) != 0 ? side(c, rho, n) : 1.0;
      }
      const Expression one = term(field, c);
      sum = !sum.valid() ? (sign > 0.0 ? one : -one) : sign > 0.0 ? sum + one : sum - one;
    }
    return sum;
  };
  const auto value = [&](int field, int corner) { return density.corner(field, corner); };
  const auto mean = [&](int field) { return signed_sum(field, 0, value) / static_cast<double>(corners); };
  std::vector<Expression> equations;
  for (int f = 0; f < d; ++f) {
    std::vector<Expression> terms;
    for (int c = 0; c < corners; ++c) {
      terms.push_back(of(f, c));
    }
    for (unsigned directions = 1; directions < 2U << n; ++directions) {
      if (!std::has_single_bit(directions) && !vanishes_at_random(signed_sum(f, directions, of), terms)) {
        return {};
      }
    }
    Expression equation = signed_sum(f, 0, of);
    for (int rho = 0; rho <= n; ++rho) {
      const Expression width = density.spacings[static_cast<std::size_t>(rho)];
      const Expression momentum = 0.5 * width * signed_sum(f, 1U << rho, of);
      std::vector<Expression> parts = {momentum};
      Expression rest = momentum;
      for (int g = 0; g < d; ++g) {
        const auto by_corner = [&](int field, int corner) {
          return formula::derivative(momentum, density.corner(field, corner));
        };
        const Expression slope = signed_sum(g, 0, by_corner);
        std::optional<double> constant;
        for (const double point : {0.37, 0.73}) {
          const double found = values_at(std::array{slope}, [&](std::size_t variable) {
                                 return point + 0.01 * std::sin(17.0 * static_cast<double>(variable));
                               }).front();
          if (!std::isfinite(found) || (constant && !(std::abs(found - *constant) <= 1e-12 * std::abs(found)))) {
            return {};
          }
          constant = found;
        }
        // Of numbers such as 1/2 and 1/4 that came by sums and quotients.
        const double rounded = std::ldexp(std::round(std::ldexp(*constant, 20)), -20);
        const double coefficient = std::abs(rounded - *constant) <= 1e-14 * std::abs(rounded) ? rounded : *constant;
        if (std::abs(coefficient) <= 1e-14) {
          continue;
        }
        rest = rest - coefficient * mean(g);
        parts.push_back(coefficient * mean(g));
        equation = equation - (coefficient / (0.5 * corners)) * (signed_sum(g, 1U << rho, value) / width);
      }
      if (!vanishes_at_random(rest, parts)) {
        return {};
      }
    }
    equations.push_back(equation);
  }
  return equations;
}

std::string corner_suffix(int number, int dimensions) {
  std::string digits;
  for (int bit = dimensions; bit >= 0; --bit) {
    digits += (number >> bit & 1) != 0 ? '1' : '0';
  }
  return digits;
}

std::vector<std::string> corner_names(const std::vector<std::string>& fields, int dimensions) {
  std::vector<std::string> names;
  for (const std::string& field : fields) {
    for (int c = 0; c < 2 << dimensions; ++c) {
      names.push_back(fmt::format("{}_{}", field, corner_suffix(c, dimensions)));
    }
  }
  names.insert(names.end(), spacing_names.begin(), spacing_names.begin() + 1 + dimensions);
  names.insert(names.end(), place_names.begin(), place_names.begin() + dimensions);
  return names;
}

CornerDensity corner_variables(const std::vector<std::string>& fields, int dimensions) {
  CornerDensity density{.graph = std::make_shared<formula::Graph>(),
                        .fields = static_cast<int>(fields.size()),
                        .dimensions = dimensions,
                        .corners = {},
                        .spacings = {},
                        .places = {},
                        .L = {}};
  const std::size_t corners = fields.size() * static_cast<std::size_t>(density.corner_count());
  for (const std::string& name : corner_names(fields, dimensions)) {
    auto& kind = density.corners.size() < corners                                     ? density.corners
                 : density.spacings.size() < static_cast<std::size_t>(1 + dimensions) ? density.spacings
                                                                                      : density.places;
    kind.push_back(density.graph->variable(name));
  }
  return density;
}

LatticeAction corner_action(const CornerDensity& stated, const std::vector<bool>& at_midpoints,
                            const std::vector<bool>& potential) {
  using grids::SpaceOperator;
  const CornerDensity density = by_differences(stated, potential);
  const int n = density.dimensions;
  LatticeAction action;
  action.graph = density.graph;
  action.fields = density.fields;
  action.dimensions = n;
  action.at_midpoints = at_midpoints;
  action.potential = potential;
  action.spacings = density.spacings;
  LatticeAction::Part part;
  part.density = density.L;
  action.operators.push_back({InTime::difference, SpaceOperator::average(n)});
  for (int a = 0; a < n; ++a) {
    action.operators.push_back({InTime::mean, SpaceOperator::box_difference(a, n)});
  }
  for (int rho = 0; rho <= n; ++rho) {
    part.derivatives.push_back(rho);
  }
  const int first_corner = static_cast<int>(action.operators.size());
  for (int c = 0; c < density.corner_count(); ++c) {
    StencilOperator corner{(c >> n & 1) != 0 ? InTime::after : InTime::before, {}};
    for (int a = 0; a < n; ++a) {
      if ((c >> a & 1) != 0) {
        corner.space.box[static_cast<std::size_t>(a)] = grids::Along::next;
      }
    }
    action.operators.push_back(corner);
  }
  std::vector<Expression> variables;
  for (int f = 0; f < density.fields; ++f) {
    for (int c = 0; density.names(f) && c < density.corner_count(); ++c) {
      action.values.push_back({f, first_corner + c, density.corner(f, c)});
      variables.push_back(density.corner(f, c));
    }
  }
  for (int a = 0; a < n; ++a) {
    if (density.names_place(a)) {
      action.places.push_back({a, first_corner, density.places[static_cast<std::size_t>(a)]});
    }
  }
  const std::vector<Expression> first = formula::gradient(density.L, variables);
  const double corners_of_face = density.corner_count() / 2;
  for (int nu = 0; nu <= n; ++nu) {
    const Expression width = density.spacings[static_cast<std::size_t>(nu)];
    for (int rho = 0; rho <= n; ++rho) {
      if (nu == rho) {
        part.currents.push_back(-(density.L + width * formula::derivative(density.L, width)));
        continue;
      }
      Expression sum = density.graph->constant(0.0);
      for (std::size_t j = 0; j < variables.size(); j += static_cast<std::size_t>(density.corner_count())) {
        Expression momentum, difference;
        for (int c = 0; c < density.corner_count(); ++c) {
          const std::size_t k = j + static_cast<std::size_t>(c);
          const auto add = [](Expression& to, double sign, Expression term) {
            to = !to.valid() ? (sign > 0.0 ? term : -term) : sign > 0.0 ? to + term : to - term;
          };
          add(momentum, side(c, rho, n), first[k]);
          add(difference, side(c, nu, n), variables[k]);
        }
        const Expression other = density.spacings[static_cast<std::size_t>(rho)];
        sum += (0.5 / corners_of_face) * (other * momentum) * (difference / width);
      }
      part.currents.push_back(sum);
    }
  }
  action.parts.push_back(std::move(part));
  return action;
}

}  // namespace rubato
