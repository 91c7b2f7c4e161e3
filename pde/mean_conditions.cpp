#include <rubato/pde/mean_conditions.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/grids/reductions.hpp>
#include <rubato/pde/cell_sweep.hpp>
#include <rubato/pde/random_points.hpp>
#include <rubato/pde/row_rounding.hpp>
#include <rubato/pde/shared_slopes.hpp>
#include <rubato/pde/tuning.hpp>
#include <rubato/solve/small_matrices.hpp>

namespace rubato {

namespace {

using namespace tuning::mean_conditions;

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Which means are looked at.
enum class Means { of_lines, of_grid };

void append(MatrixXd& columns, const VectorXd& column) {
  columns.conservativeResize(column.size(), columns.cols() + 1);
  columns.col(columns.cols() - 1) = column;
}

/// Finds the rows n of a system by linear algebra.
class RowSearch {
public:
  RowSearch(const MultisymplecticSystem& system, Means means) : system_(system), means_(means), held_(d(), 0) {
    std::mt19937_64 random(60);
    for (MatrixXd& hessian : hessians_) {
      hessian = generic_hessian(system, random);
    }
    for (Index c = 0; c < system.structure().kernel.cols(); ++c) {
      hold(system.structure().kernel.col(c));
    }
  }

  [[nodiscard]] MatrixXd rows() {
    MatrixXd found(d(), 0);
    for (Index last = -1; last != held_.cols();) {  // a condition may hold means of fields, which give further ones
      last = held_.cols();
      found = candidates();
      for (Index c = 0; c < found.cols(); ++c) {
        hold(found.col(c));
      }
    }
    MatrixXd wanted(d(), 0);
    for (Index c = 0; c < found.cols(); ++c) {
      if (says_something(found.col(c))) {
        append(wanted, found.col(c));
      }
    }
    return wanted;
  }

private:
  [[nodiscard]] Index d() const { return system_.field_count(); }

  /// Derivatives by y and z, which mean values along x keep.
  [[nodiscard]] std::vector<MatrixXd> other_derivatives() const {
    std::vector<MatrixXd> others;
    for (int a = 1; a < system_.directions() && means_ == Means::of_lines; ++a) {
      others.push_back(system_.K(a));
    }
    return others;
  }

  /// The mean of nᵀS''z never changes, if nᵀ∇S is linear with constant coefficients and the row holds nothing else.
  void hold(const VectorXd& n) {
    const VectorXd of_fields = system_.constant_hessian() * n;
    const bool varies = std::ranges::any_of(system_.varying_hessian(), [&n](const HessianEntry& entry) {
      return n[entry.row] != 0.0 || n[entry.column] != 0.0;
    });
    const auto others = other_derivatives();
    const bool is_alone = std::ranges::all_of(others, [&n](const MatrixXd& K) { return (K * n).isZero(0.0); });
    if (varies || !is_alone || sees_midpoints(of_fields) || of_fields.isZero(0.0)) {
      return;
    }
    MatrixXd more = held_;
    append(more, of_fields);
    if (null_space(more).cols() == 0) {
      held_ = std::move(more);
    }
  }
  [[nodiscard]] bool sees_midpoints(const VectorXd& of_fields) const {
    for (int f = 0; f < system_.field_count(); ++f) {
      if (of_fields[f] != 0.0 && system_.structure().at_midpoints(f)) {
        return true;
      }
    }
    return false;
  }

  /// n outside ker M with nᵀM of held fields alone, and nothing of fields that levels do not have.
  [[nodiscard]] MatrixXd candidates() const {
    const MatrixXd free = held_.cols() == 0 ? MatrixXd::Identity(d(), d()) : null_space(MatrixXd(held_.transpose()));
    MatrixXd conditions = free.transpose() * system_.M();
    std::vector<MatrixXd> operators(hessians_.begin(), hessians_.end());
    std::ranges::copy(other_derivatives(), std::back_inserter(operators));
    for (int f = 0; f < system_.field_count(); ++f) {
      if (system_.structure().at_midpoints(f)) {
        for (const MatrixXd& matrix : operators) {
          conditions.conservativeResize(conditions.rows() + 1, Eigen::NoChange);
          conditions.bottomRows(1) = matrix.row(f);
        }
      }
    }
    const MatrixXd all = column_echelon(null_space(conditions));
    MatrixXd outside(d(), 0);
    for (Index c = 0; c < all.cols(); ++c) {
      if (!(system_.M() * all.col(c)).isZero(tuning::field_structure::rank_threshold)) {
        append(outside, all.col(c));
      }
    }
    return outside;
  }
  [[nodiscard]] bool says_something(const VectorXd& n) const {
    const auto others = other_derivatives();
    constexpr double rounding = 1e-12;
    return std::ranges::any_of(others, [&n](const MatrixXd& K) { return !(K * n).isZero(0.0); }) ||
           std::ranges::any_of(samples_of(system_, 2), [&n](const PotentialSample& sample) {
             return std::abs(n.dot(sample.gradient)) > rounding * n.cwiseAbs().dot(sample.gradient.cwiseAbs());
           });
  }

  const MultisymplecticSystem& system_;
  Means means_;
  std::array<MatrixXd, 2> hessians_;
  MatrixXd held_;  ///< combinations of fields, in columns
};

/// True if nᵀ∇S depends on the field.
bool depends_on_field(const MultisymplecticSystem& system, const VectorXd& n, int field) {
  return system.constant_hessian().row(field).dot(n) != 0.0 ||
         std::ranges::any_of(system.varying_hessian(), [&](const HessianEntry& entry) {
           return (entry.row == field && n[entry.column] != 0.0) || (entry.column == field && n[entry.row] != 0.0);
         });
}
/// True if no derivative in space sees the field.
bool is_local(const MultisymplecticSystem& system, int field) {
  for (int a = 0; a < system.directions(); ++a) {
    if (!system.K(a).col(field).isZero(0.0)) {
      return false;
    }
  }
  return true;
}
/// \param but a field that does not count
bool depends_on_fields(const MultisymplecticSystem& system, const VectorXd& n, std::optional<int> but = std::nullopt) {
  for (int f = 0; f < system.field_count(); ++f) {
    if (f != but && depends_on_field(system, n, f)) {
      return true;
    }
  }
  return false;
}

/// The field that is the same at every node and grows by 1 in a unit of time, if there is one.
std::optional<int> clock_of(const MultisymplecticSystem& system) {
  for (int f = 0; f < system.field_count(); ++f) {
    const VectorXd row = system.M().row(f).transpose();
    Index partner = 0;
    if (row.cwiseAbs().maxCoeff(&partner) != 0.0 && (row.array() != 0.0).count() == 1 &&
        !depends_on_fields(system, VectorXd::Unit(row.size(), partner)) && is_local(system, f) &&
        is_local(system, static_cast<int>(partner))) {
      return f;
    }
  }
  return std::nullopt;
}

/// The first field that is given and that a row depends on, or has the name of.
std::optional<int> given_field_of(const MultisymplecticSystem& system, const InitialFields& given, const VectorXd& n) {
  for (int f = 0; f < system.field_count(); ++f) {
    if (given[static_cast<std::size_t>(f)] && (n[f] != 0.0 || depends_on_field(system, n, f))) {
      return f;
    }
  }
  return std::nullopt;
}

/// "dS/du + dS/dv", what the rows n add up to.
std::string text_of_row(const MultisymplecticSystem& system, const VectorXd& n) {
  std::vector<std::string> names;
  for (int f = 0; f < system.field_count(); ++f) {
    if (n[f] != 0.0) {
      names.push_back("dS/d" + system.fields()[static_cast<std::size_t>(f)]);
    }
  }
  return fmt::format("{}", fmt::join(names, " + "));
}

[[noreturn]] void refuse(std::optional<int> field, const std::string& message) {
  if (field) {
    throw InitialFieldError(*field, message);
  }
  throw std::invalid_argument(message);
}

/// " at y = 1", the place of a line along x.
std::string place_of_line(const grids::Grid& grid, std::size_t line) {
  std::vector<std::string> places;
  for (int a = 1; a < grid.dimensions(); ++a) {
    const auto place = grid.place(line * grid.cells(0))[static_cast<std::size_t>(a)];
    places.push_back(fmt::format("{} = {:.6g}", grid.axis(a).name, grid.axis(a).node(place)));
  }
  return places.empty() ? "" : fmt::format(" at {}", fmt::join(places, ", "));
}

/// The field that is the derivative of a potential by x, by the constraint of a level, if no other one has the
/// potential itself.
std::optional<int> derivative_of(const MultisymplecticSystem& system, int potential) {
  const MatrixXd& constraints = system.structure().level_constraints;
  std::mt19937_64 random(61);
  if (!solve::product(constraints.transpose(), MatrixXd(generic_hessian(system, random).col(potential))).isZero(0.0)) {
    return std::nullopt;
  }
  for (Index c = 0; c < constraints.cols(); ++c) {
    const VectorXd n = constraints.col(c), of_fields = system.constant_hessian() * n;
    for (int f = 0; f < system.field_count() && n.dot(system.K(0).col(potential)) != 0.0; ++f) {
      if (of_fields[f] != 0.0) {
        return f;
      }
    }
  }
  return std::nullopt;
}

/// The directions beyond x whose derivatives see a field.
std::vector<int> directions_of(const MultisymplecticSystem& system, int field) {
  std::vector<int> directions;
  for (int a = 1; a < system.directions(); ++a) {
    if (!system.K(a).col(field).isZero(0.0)) {
      directions.push_back(a);
    }
  }
  return directions;
}

/// The largest |D_x φ + slope| and a line's slope that is furthest from the one it has to have.
struct SlopeMiss {
  double size = 0.0, miss = 0.0;
  std::size_t line = 0;
};
SlopeMiss miss_of_slopes(const grids::Grid& grid, std::span<const double> potential, std::span<const double> slopes,
                         const std::vector<std::size_t>& reference) {
  SlopeMiss found;
  const std::size_t n = grid.cells(0);
  for (std::size_t line = 0; line < slopes.size(); ++line) {
    for (std::size_t i = 0; i < n; ++i) {
      const double difference = potential[line * n + (i + 1) % n] - potential[line * n + i];
      found.size = std::max(found.size, std::abs(difference / grid.spacing(0) + slopes[line]));
    }
    const double miss = reference.empty() ? slopes[line] : slopes[line] - slopes[reference[line]];
    if (std::abs(miss) > std::abs(found.miss)) {
      found.miss = miss;
      found.line = line;
    }
  }
  return found;
}

/// Means of nᵀ(Σ K_a D_a z - ∇S) at the nodes, where those of smooth data are those of the data themselves.
class RowMeans {
public:
  RowMeans(const MultisymplecticSystem& system, const grids::Grid& grid, const LatticeLevel& level)
      : grid_(grid), residual_(system.field_count(), grid.size()), rounding_(system.field_count()) {
    grids::FieldSet hessian(static_cast<int>(system.varying_hessian().size()), grid.size());
    CellSweep(system, grid, Collocation::nodes)(level.fields.pointers(), level.slopes, {}, 0.0, residual_.pointers(),
                                                hessian.pointers());
    const RowRounding::Sizes bounds = RowRounding(system, grid).of_constraints(level, grid, hessian);
    std::copy_n(bounds.begin(), rounding_.size(), rounding_.begin());
  }

  struct Miss {
    double mean = 0.0, size = 0.0, rounding = 0.0;  ///< size: of the largest value at a node
    std::size_t line = 0;
  };
  /// The largest mean over so many lines each.
  [[nodiscard]] Miss miss(const VectorXd& n, std::size_t lines) const {
    std::vector<double> row(grid_.size());
    for (Index f = 0; f < n.size(); ++f) {
      const auto values = residual_.field(static_cast<int>(f));  // of the opposite sign
      for (std::size_t i = 0; i < row.size() && n[f] != 0.0; ++i) {
        row[i] += n[f] * values[i];
      }
    }
    Miss found{.size = grids::max_abs(row), .rounding = tuning::initial_level::solved * n.cwiseAbs().dot(rounding_)};
    const std::size_t count = lines * grid_.cells(0);
    for (std::size_t first = 0; first < row.size(); first += count) {
      const double mean = grids::sum(std::span(row).subspan(first, count)) / static_cast<double>(count);
      if (std::abs(mean) > std::abs(found.mean)) {
        found.mean = mean;
        found.line = first / grid_.cells(0);
      }
    }
    return found;
  }

private:
  grids::Grid grid_;
  grids::FieldSet residual_;
  VectorXd rounding_;
};

}  // namespace

MeanConditions::MeanConditions(const MultisymplecticSystem& system)
    : system_(system),
      clock_(clock_of(system)),
      of_lines_(RowSearch(system, Means::of_lines).rows()),
      of_grid_(system.field_count(), 0) {
  if (system.directions() > 1) {
    of_grid_ = RowSearch(system, Means::of_grid).rows();
  }
}

bool MeanConditions::any(const std::vector<bool>& given) const {
  bool found = of_lines_.cols() + of_grid_.cols() > 0;
  for (int f = 0; f < system_.field_count(); ++f) {
    const auto i = static_cast<std::size_t>(f);
    found = found || (!given[i] && derivative_of(system_, f) &&
                      (!system_.structure().potential[i] || !directions_of(system_, f).empty()));
  }
  return found;
}

void MeanConditions::check(const grids::Grid& grid, const InitialFields& given, const LatticeLevel& level) const {
  check_slopes(grid, given, level);
  if (of_lines_.cols() + of_grid_.cols() > 0) {
    check_rows(grid, given, level);
  }
}

void MeanConditions::check_slopes(const grids::Grid& grid, const InitialFields& given,
                                  const LatticeLevel& level) const {
  for (int f = 0; f < system_.field_count(); ++f) {
    const auto i = static_cast<std::size_t>(f);
    const auto of = derivative_of(system_, f);
    if (i >= level.slopes.of_field.size() || level.slopes.of_field[i].empty() ||
        !of) {  // no field grows, or this one not
      continue;
    }
    const std::vector<double>& slopes = level.slopes.of_field[i];
    const auto blamed = given[static_cast<std::size_t>(*of)] ? of : std::nullopt;
    const std::string& name = system_.fields()[static_cast<std::size_t>(*of)];
    const auto potential = std::as_const(level.fields).field(f);
    if (depends_on_fields(system_, VectorXd::Unit(system_.field_count(), f), clock_)) {
      if (const SlopeMiss found = miss_of_slopes(grid, potential, slopes, {});
          std::abs(found.miss) > cut_tails * found.size) {
        refuse(blamed, fmt::format("the mean of the initial {0} along x is {1:.3g}{2} ({0} is up to {3:.3g}), and has "
                                   "to be 0: {4}, of which {0} is the derivative by x, is in the equation itself, and "
                                   "would grow along x; subtract the mean from {0}",
                                   name, found.miss, place_of_line(grid, found.line), found.size, system_.fields()[i]));
      }
    }
    for (const int a : directions_of(system_, f)) {
      std::vector<std::size_t> first(slopes.size());
      for (std::size_t line = 0; line < first.size(); ++line) {
        const std::size_t stride = grid.stride(a) / grid.cells(0);
        first[line] = line - line / stride % grid.cells(a) * stride;
      }
      if (const SlopeMiss found = miss_of_slopes(grid, potential, slopes, first);
          std::abs(found.miss) > cut_tails * found.size) {
        refuse(
            blamed,
            fmt::format("the mean of the initial {0} along x varies with {1}, by {2:.3g}{3} ({0} is up to {4:.3g}), "
                        "and has to be the same everywhere: the equation has the derivative by {1} of {5}, of which "
                        "{0} is the derivative by x, and that would grow along x; subtract the mean along x from {0}",
                        name, grid.axis(a).name, found.miss, place_of_line(grid, found.line), found.size,
                        system_.fields()[i]));
      }
    }
  }
}

void MeanConditions::check_rows(const grids::Grid& grid, const InitialFields& given, const LatticeLevel& level) const {
  const RowMeans means(system_, grid, level);
  const auto check = [&](const VectorXd& n, std::size_t lines) {
    const RowMeans::Miss found = means.miss(n, lines);
    if (!(std::abs(found.mean) > cut_tails * found.size + found.rounding)) {
      return;
    }
    bool has_others = false;
    for (int a = 1; a < system_.directions() && lines == 1; ++a) {
      has_others = has_others || !VectorXd(system_.K(a) * n).isZero(0.0);
    }
    const bool of_line = lines == 1;
    const std::string finding = fmt::format(
        "the mean {0} of {1}{2} has to be 0, as all else in that row is derivatives {3}; of the initial data it is "
        "{4:.3g}{5} (the largest value is {6:.3g})",
        of_line ? "along x" : "over the grid", text_of_row(system_, n),
        has_others ? " less the derivatives across x" : "", of_line ? "by x" : "in space", found.mean,
        of_line ? place_of_line(grid, found.line) : "", found.size);
    if (!has_others && !depends_on_fields(system_, n)) {
      throw std::invalid_argument(finding + ", as of any: the equation has no periodic solution. Add a term to it");
    }
    const auto blamed = given_field_of(system_, given, n);
    refuse(blamed,
           fmt::format("{}, and no step can mend that. Change the initial {} so that it vanishes, by a constant "
                       "for instance",
                       finding, blamed ? system_.fields()[static_cast<std::size_t>(*blamed)] : "fields"));
  };
  for (Index c = 0; c < of_lines_.cols(); ++c) {
    check(of_lines_.col(c), 1);
  }
  for (Index c = 0; c < of_grid_.cols(); ++c) {
    check(of_grid_.col(c), grid.size() / grid.cells(0));
  }
}

void MeanConditions::check_forces(const grids::Grid& grid, std::span<const double> times) const {
  if (!clock_ || of_lines_.cols() + of_grid_.cols() == 0) {
    return;
  }
  LatticeLevel level{grids::FieldSet(system_.field_count(), grid.size()), {}};
  for (const double t : times) {
    std::ranges::fill(level.fields.field(*clock_), t);
    std::optional<RowMeans> means;
    for (const auto* rows : {&of_lines_, &of_grid_}) {
      for (Index c = 0; c < rows->cols(); ++c) {
        const VectorXd n = rows->col(c);
        if (depends_on_fields(system_, n, clock_)) {
          continue;
        }
        if (!means) {
          means.emplace(system_, grid, level);
        }
        const RowMeans::Miss found = means->miss(n, rows == &of_lines_ ? 1 : grid.size() / grid.cells(0));
        if (std::abs(found.mean) > cut_tails * found.size + found.rounding) {
          throw std::invalid_argument(fmt::format(
              "the mean {} of {} has to be 0 at all times, as all else in that row is derivatives; at t = {:.6g} it is "
              "{:.3g} (the largest value is {:.3g}), whatever the fields: the equation has no periodic solution. "
              "Subtract the mean from this term",
              rows == &of_lines_ ? "along x" : "over the grid", text_of_row(system_, n), t, found.mean, found.size));
        }
      }
    }
  }
}

}  // namespace rubato
