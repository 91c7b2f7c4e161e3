#include <rubato/pde/row_rounding.hpp>

#include <algorithm>
#include <cmath>

#include <rubato/base/larger.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/grids/whole.hpp>
#include <rubato/pde/natural_sizes.hpp>
#include <rubato/pde/shared_slopes.hpp>

namespace rubato {

void LargestRounding::operator()(std::size_t nodes, std::span<const double* const> inputs, std::span<double> largest) {
  const grids::Slab* const slab = grids::Slab::of(nodes);
  const std::size_t first = slab == nullptr ? 0 : slab->first_node();
  const std::size_t end = slab == nullptr ? nodes : first + slab->owned();
  for (std::size_t n = first; n < end; ++n) {
    for (std::size_t i = 0; i < point_.size(); ++i) {
      point_[i] = inputs[i][n];
      error_[i] = 2.0 * std::abs(point_[i]);
    }
    evaluator_.run(point_, error_);
    for (std::size_t i = 0; i < largest.size(); ++i) {
      largest[i] = larger(largest[i], evaluator_.bound(i));
    }
  }
  if (slab != nullptr) {
    slab->reduce({}, {}, largest);
  }
}

RowRounding::RowRounding(const MultisymplecticSystem& system, const grids::Grid& grid)
    : fields_(system.fields().size()),
      M_(system.M().cwiseAbs()),
      along_(system.K(0).cwiseAbs()),
      constant_(system.constant_hessian().cwiseAbs()),
      varying_(system.varying_hessian()),
      gradient_(system.gradient_code()),
      places_(system, grid, Within::node) {
  for (int a = 0; a < system.directions(); ++a) {
    constant_ += 2.0 / grid.spacing(a) * system.K(a).cwiseAbs();
  }
}

void RowRounding::measure_gradient(const grids::FieldSet& point, Values& values) {
  std::array<double, 1 + MultisymplecticSystem::most_fields> largest{};  // of S, too
  gradient_(point.size(), places_.after(point.pointers(), inputs_), std::span(largest).first(1 + fields_));
  std::copy_n(largest.begin() + 1, fields_, values.gradient.begin());
}

RowRounding::Sizes RowRounding::of_constraints(const LatticeLevel& level, const grids::Grid& grid,
                                               const grids::FieldSet& hessian) {
  Values values;
  for (std::size_t i = 0; i < fields_; ++i) {
    values.point[i] = grids::max_abs(level.fields.field(static_cast<int>(i)));
    values.slope[i] = largest_slope(level.slopes, i, grid);
  }
  measure_gradient(level.fields, values);
  return (*this)(values, 0.0, hessian);
}

RowRounding::Sizes RowRounding::operator()(const Values& values, double inverse_h,
                                           const grids::FieldSet& hessian) const {
  constexpr std::size_t most = MultisymplecticSystem::most_fields;
  const double rate = std::abs(inverse_h);
  std::array<std::array<double, most>, most> B;
  for (std::size_t i = 0; i < fields_; ++i) {
    for (std::size_t j = 0; j < fields_; ++j) {
      B[i][j] = constant_(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j));
    }
  }
  for (std::size_t e = 0; e < varying_.size(); ++e) {
    const auto row = static_cast<std::size_t>(varying_[e].row), column = static_cast<std::size_t>(varying_[e].column);
    const double entry = grids::max_abs(hessian.field(static_cast<int>(e)));
    B[row][column] += entry;
    B[column][row] += row == column ? 0.0 : entry;
  }
  Sizes terms = values.gradient, carried{};  // t and X
  const auto M_over_h = [&](std::size_t i, std::size_t j) {
    return rate * M_(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j));
  };
  for (std::size_t i = 0; i < fields_; ++i) {
    for (std::size_t j = 0; j < fields_; ++j) {
      terms[i] += M_over_h(i, j) * values.increment[j] + B[i][j] * values.point[j] +
                  along_(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) * values.slope[j];
    }
    for (std::size_t j = 0; j < fields_; ++j) {
      if (const double coefficient = 2.0 * M_over_h(i, j) + B[i][j]; coefficient > 0.0) {
        carried[j] = std::max(carried[j], terms[i] / coefficient);
      }
    }
  }
  Eigen::MatrixXd A(fields_, fields_);
  for (std::size_t i = 0; i < fields_; ++i) {
    for (std::size_t j = 0; j < fields_; ++j) {
      A(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) = 2.0 * M_over_h(i, j) + B[i][j];
    }
  }
  const std::vector<double> natural = natural_sizes(A);
  const double largest = largest_in(natural, carried);
  Sizes bounds = terms;
  for (std::size_t j = 0; j < fields_; ++j) {
    const double of_others = natural[j] * largest;
    const double carries = carried[j] < rounding_beside_others * of_others ? of_others : carried[j];
    for (std::size_t i = 0; i < fields_; ++i) {
      bounds[i] += A(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) * carries;
    }
  }
  return bounds;
}

}  // namespace rubato
