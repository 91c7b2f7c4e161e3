#include <rubato/pde/natural_sizes.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

#include <Eigen/Core>

#include <rubato/grids/reductions.hpp>
#include <rubato/grids/whole.hpp>
#include <rubato/solve/small_matrices.hpp>

namespace rubato {

namespace {

/// ln D by least squares, of least norm where the weights leave it open: ln W_fg + ln D_f + ln D_g = 0 for every
/// weight.
Eigen::VectorXd logarithms(const Eigen::MatrixXd& weights) {
  Eigen::MatrixXd rows = Eigen::MatrixXd::Zero(weights.size(), weights.rows());
  Eigen::VectorXd values = Eigen::VectorXd::Zero(weights.size());
  for (Eigen::Index f = 0; f < weights.rows(); ++f) {
    for (Eigen::Index g = 0; g < weights.cols(); ++g) {
      if (weights(f, g) > 0.0 && std::isfinite(weights(f, g))) {
        const Eigen::Index row = f * weights.cols() + g;
        rows(row, f) += 1.0;
        rows(row, g) += 1.0;
        values(row) = -std::log(weights(f, g));
      }
    }
  }
  return solve::least_squares(rows, values);
}

/// Divided by what the rows are off by, again and again. An iteration halves the logarithms of that.
Eigen::VectorXd equilibrated(const Eigen::MatrixXd& weights, Eigen::VectorXd sizes) {
  constexpr int iterations = 40;
  for (int i = 0; i < iterations; ++i) {
    const Eigen::MatrixXd scaled = sizes.asDiagonal() * weights * sizes.asDiagonal();
    for (Eigen::Index f = 0; f < sizes.size(); ++f) {
      const double largest = scaled.row(f).maxCoeff();
      sizes(f) /= largest > 0.0 && std::isfinite(largest) ? std::sqrt(largest) : 1.0;
    }
  }
  return sizes;
}

}  // namespace

std::vector<double> natural_sizes(const Eigen::MatrixXd& weights) {
  // A weight that is next to nothing beside the others, as exp(u) far below 0, would count by its logarithm.
  constexpr double counts = 1e-3;
  Eigen::VectorXd sizes = equilibrated(weights, logarithms(weights).array().exp());
  const Eigen::ArrayXXd scaled = sizes.asDiagonal() * weights * sizes.asDiagonal();
  const Eigen::MatrixXd counted = (scaled >= counts).select(weights, 0.0);
  sizes = equilibrated(weights, logarithms(counted).array().exp());
  return {sizes.begin(), sizes.end()};
}

std::vector<double> natural_sizes(const MultisymplecticSystem& system, const grids::Grid& grid,
                                  const Eigen::MatrixXd& hessian) {
  Eigen::MatrixXd weights = hessian.cwiseAbs();
  for (int axis = 0; axis < system.directions(); ++axis) {
    weights += 2.0 * std::numbers::pi / grids::whole_of(grid).axis(axis).length() * system.K(axis).cwiseAbs();
  }
  return natural_sizes(weights);
}

double largest_in(std::span<const double> natural, std::span<const double> sizes) {
  double largest = 0.0;
  for (std::size_t f = 0; f < natural.size(); ++f) {
    largest = std::max(largest, std::abs(sizes[f]) / natural[f]);
  }
  return largest;
}

Eigen::MatrixXd hessian_of_sizes(const MultisymplecticSystem& system, const grids::Grid& grid,
                                 std::span<const double> sizes) {
  std::vector<double> point(sizes.begin(), sizes.end());
  for (const int axis : system.coordinates()) {
    point.push_back(0.5 * (grid.axis(axis).from + grid.axis(axis).to));
  }
  const Eigen::MatrixXd hessian = system.hessian(point);
  return hessian.allFinite() ? hessian : system.constant_hessian();
}

EnergyFloor::EnergyFloor(const MultisymplecticSystem& system, const grids::Grid& grid) : system_(system), grid_(grid) {}

void EnergyFloor::raise(formula::SumSize& size, std::span<const double* const> fields) const {
  const std::size_t nodes = grid_.size();
  const auto count = static_cast<double>(grids::whole_count(nodes));
  std::vector<double> sizes, waves;  // root mean squares, of the fields with the sign of the mean and of their waves
  for (const double* const values : fields) {
    if (values == nullptr) {
      sizes.push_back(0.0);
      waves.push_back(0.0);
      continue;
    }
    const double mean = grids::sum_of(nodes, [values](std::size_t i) { return values[i]; }) / count;
    const double squares = grids::sum_of(nodes,
                                         [values, mean](std::size_t i) {
                                           const double deviation = values[i] - mean;
                                           return deviation * deviation;
                                         }) /
                           count;
    sizes.push_back(std::copysign(std::sqrt(mean * mean + squares), mean));
    waves.push_back(std::sqrt(squares));
  }
  const double largest = largest_in(natural_sizes(system_, grid_, hessian_of_sizes(system_, grid_, sizes)), waves);
  if (const double floor = rounding_beside_others * grids::whole_of(grid_).volume() * largest * largest;
      size.magnitudes < floor) {
    size.rounding = std::max(size.rounding, floor);
  }
}

}  // namespace rubato
