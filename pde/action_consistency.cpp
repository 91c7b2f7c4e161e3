#include <rubato/pde/action_consistency.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <span>
#include <utility>

#include <Eigen/Core>

#include <rubato/formula/bytecode.hpp>
#include <rubato/pde/action_rows.hpp>
#include <rubato/solve/small_matrices.hpp>

namespace rubato {

namespace {

using formula::Expression;
/// A time and a place.
using Event = std::array<double, 4>;

/// Where rows are looked at.
constexpr Event centre = {0.3, 0.7, -0.4, 0.2};
/// Of differences of fourth order, 1e-9 of a derivative off.
constexpr double width = 4e-3;
/// Halving steps and cells takes a half of an error of the first order; less than a quarter off does not count. They
/// are halved three times: where the errors of two orders cancel at one size, the next one is larger, and three
/// quarters of that are left at the one after it.
constexpr double falls = 0.7;
/// Of the terms of a row: what is smaller is the error of the differences.
constexpr double nothing = 1e-5;

/// Smooth fields; those that L does not name from rows of the equation that read none but known ones.
class SmoothFields {
public:
  SmoothFields(const MultisymplecticSystem& system, const StatedAction& stated, std::vector<double> centres,
               double size)
      : system_(system),
        gradient_(system.gradient_code()),
        centres_(std::move(centres)),
        size_(size),
        group_of_(system.fields().size(), unknown) {
    std::vector<bool> used;
    for (int f = 0; f < system.field_count(); ++f) {
      used.push_back(stated.names(f));
      group_of_[static_cast<std::size_t>(f)] = stated.names(f) ? smooth : unknown;
    }
    while (find_group(used, true) || find_group(used, false)) {
    }
  }

  /// True if every field has a value.
  [[nodiscard]] bool are_known() const { return std::ranges::find(group_of_, unknown) == group_of_.end(); }

  /// Not a number where the rows have no solution near 0 or 1.
  [[nodiscard]] double value(int f, const Event& at) const {
    const int group = group_of_[static_cast<std::size_t>(f)];
    if (group == smooth) {
      double phase = 0.4 + 1.3 * f;
      for (std::size_t a = 0; a < at.size(); ++a) {
        phase += (0.9 - 0.13 * static_cast<double>(a) + 0.05 * f) * at[a];
      }
      return centres_[static_cast<std::size_t>(f)] + size_ * std::sin(phase);
    }
    const Group& rows = groups_[static_cast<std::size_t>(group)];
    return solve(rows, at)(std::ranges::find(rows.fields, f) - rows.fields.begin());
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
  /// The fields, then the coordinates that S names.
  [[nodiscard]] std::vector<double> point(const Event& at) const {
    std::vector<double> values;
    for (int f = 0; f < system_.field_count(); ++f) {
      values.push_back(value(f, at));
    }
    for (const int axis : system_.coordinates()) {
      values.push_back(at[static_cast<std::size_t>(1 + axis)]);
    }
    return values;
  }
  /// ∂S/∂z_f at such a point.
  [[nodiscard]] double forced(int f, std::span<const double> point) const {
    std::vector<double> outputs(1 + system_.fields().size());
    gradient_(point, outputs);
    return outputs[static_cast<std::size_t>(1 + f)];
  }

private:
  static constexpr int smooth = -1, unknown = -2;
  /// As many rows as fields that they give.
  struct Group {
    std::vector<int> rows, fields;
  };

  [[nodiscard]] bool is_known(int f) const { return group_of_[static_cast<std::size_t>(f)] != unknown; }
  /// Whether unused rows whose derivatives are of known fields give as many others: one row alone, or all of them.
  [[nodiscard]] bool find_group(std::vector<bool>& used, bool alone) {
    Group all;
    for (int row = 0; row < system_.field_count(); ++row) {
      if (used[static_cast<std::size_t>(row)] || !moves_known(row)) {
        continue;
      }
      Group group = alone ? Group() : all;
      group.rows.push_back(row);
      for (int f = 0; f < system_.field_count(); ++f) {
        if (!is_known(f) && reads(row, f) && std::ranges::find(group.fields, f) == group.fields.end()) {
          group.fields.push_back(f);
        }
      }
      if (group.fields.size() == group.rows.size()) {
        for (const int one : group.rows) {
          used[static_cast<std::size_t>(one)] = true;
        }
        for (const int f : group.fields) {
          group_of_[static_cast<std::size_t>(f)] = static_cast<int>(groups_.size());
        }
        groups_.push_back(group);
        return true;
      }
      all = alone ? all : group;
    }
    return false;
  }
  [[nodiscard]] bool moves_known(int row) const {
    for (int f = 0; f < system_.field_count(); ++f) {
      bool reads_it = system_.M()(row, f) != 0.0;
      for (int a = 0; a < system_.directions(); ++a) {
        reads_it = reads_it || system_.K(a)(row, f) != 0.0;
      }
      if (reads_it && !is_known(f)) {
        return false;
      }
    }
    return true;
  }
  [[nodiscard]] bool reads(int row, int f) const {
    return system_.constant_hessian()(row, f) != 0.0 ||
           std::ranges::any_of(system_.varying_hessian(), [&](const HessianEntry& e) {
             return (e.row == row && e.column == f) || (e.row == f && e.column == row);
           });
  }

  /// Newton's method, from where these fields are 0 or, if that fails, 1.
  [[nodiscard]] Eigen::VectorXd solve(const Group& group, const Event& at) const {
    constexpr int most = 50;
    constexpr double enough = 1e-10;  // the next change would be of its square
    std::vector<double> point(system_.variables().size(), 0.0);
    for (int f = 0; f < system_.field_count(); ++f) {
      const bool is_read = std::ranges::any_of(group.rows, [&](int row) { return reads(row, f); });
      if (is_read && std::ranges::find(group.fields, f) == group.fields.end()) {
        point[static_cast<std::size_t>(f)] = value(f, at);
      }
    }
    for (std::size_t c = 0; c < system_.coordinates().size(); ++c) {
      point[system_.fields().size() + c] = at[static_cast<std::size_t>(1 + system_.coordinates()[c])];
    }
    const auto count = static_cast<Eigen::Index>(group.rows.size());
    Eigen::VectorXd moving(count), values(count), misses(count);
    for (Eigen::Index i = 0; i < count; ++i) {
      moving(i) = moved(group.rows[static_cast<std::size_t>(i)], at);
    }
    for (const double start : {0.0, 1.0}) {
      values.setConstant(start);
      for (int turn = 0; turn < most; ++turn) {
        for (Eigen::Index i = 0; i < count; ++i) {
          point[static_cast<std::size_t>(group.fields[static_cast<std::size_t>(i)])] = values(i);
        }
        for (Eigen::Index i = 0; i < count; ++i) {
          misses(i) = forced(group.rows[static_cast<std::size_t>(i)], point) - moving(i);
        }
        const Eigen::MatrixXd slopes = system_.hessian(point)(group.rows, group.fields);
        const Eigen::VectorXd change = solve::least_squares(slopes, misses);
        values -= change;
        if (!values.allFinite()) {
          break;
        }
        if (change.norm() <= enough * (1.0 + values.norm())) {
          return values;
        }
      }
    }
    return Eigen::VectorXd::Constant(count, std::numeric_limits<double>::quiet_NaN());
  }

  [[nodiscard]] double slope(int f, std::size_t rho, const Event& at) const {
    const auto off = [&](double by) {
      Event there = at;
      there[rho] += by * width;
      return value(f, there);
    };
    return (8.0 * (off(1.0) - off(-1.0)) - (off(2.0) - off(-2.0))) / (12.0 * width);
  }

  const MultisymplecticSystem& system_;
  mutable formula::ScalarEvaluator gradient_;
  std::vector<double> centres_;
  double size_;
  std::vector<Group> groups_;
  std::vector<int> group_of_;  ///< of each field: which group gives it
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

ActionConsistency consistency_near(const MultisymplecticSystem& system, const StatedAction& stated,
                                   const std::vector<double>& centres, double size) {
  ActionConsistency result;
  const SmoothFields fields(system, stated, centres, size);
  if (!fields.are_known()) {
    return result;
  }
  const std::vector<double> point = fields.point(centre);
  constexpr double coarse = 1.0 / 16.0;
  std::array<std::vector<double>, 4> sizes;
  for (std::size_t halvings = 0; halvings < sizes.size(); ++halvings) {
    sizes[halvings] = rows_at(system, stated, fields, std::ldexp(coarse, -static_cast<int>(halvings)));
  }
  result.is_tested = true;
  std::size_t row = 0;
  for (int f = 0; f < system.field_count(); ++f) {
    if (!stated.names(f)) {
      continue;
    }
    const double moved = fields.moved(f, centre), forced = fields.forced(f, point);
    const auto error = [&](std::size_t of) { return std::abs(sizes[of][row] - (moved - forced)); };
    const double terms = std::abs(moved) + std::abs(forced);
    bool is_defined = true, stays = true;
    for (std::size_t of = 0; of < sizes.size(); ++of) {
      is_defined = is_defined && std::isfinite(error(of));
      stays = stays && (of == 0 || error(of) > falls * error(of - 1));
    }
    const double least = error(sizes.size() - 1);
    if (!is_defined) {
      result.is_tested = false;
    } else if (stays && least > nothing * terms) {
      result.wrong.push_back(system.fields()[static_cast<std::size_t>(f)]);
      result.off = std::max(result.off, least / terms);
    }
    ++row;
  }
  return result;
}

}  // namespace

ActionConsistency consistency_of(const MultisymplecticSystem& system, const StatedAction& stated) {
  const std::vector<double> middles(system.fields().size(), 0.7);
  constexpr double large = 0.25, small = 0.05;
  ActionConsistency found = consistency_near(system, stated, middles, large);
  if (!found.is_tested) {
    found = consistency_near(system, stated, middles, small);
  }
  if (!found.is_tested && !stated.typical.empty()) {
    found = consistency_near(system, stated, stated.typical, small);
  }
  return found;
}

}  // namespace rubato
