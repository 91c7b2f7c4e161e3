#include <rubato/ode/step_matrix.hpp>

#include <utility>

namespace rubato {

BandStepMatrix::BandStepMatrix(HessianBand band)
    : band_(std::move(band)),
      factors_(static_cast<int>(band_.places.size()), band_.width, band_.width),
      ordered_(band_.places.size()),
      units_(band_.places.size()) {}

Status BandStepMatrix::factor(HamiltonianEvaluator& hamiltonian, const double* point, double h) {
  const std::span<const double> values = hamiltonian.hessian_entries(point);
  factors_.clear();
  units_.begin(1.0);
  units_.find([&](const auto& use) {
    for (const auto& [row, column, number, sign] : band_.entries) {
      use(row, column, values[number]);
    }
  });
  for (const auto& [row, column, number, sign] : band_.entries) {
    const double unit = units_.of_entry(static_cast<std::size_t>(row), static_cast<std::size_t>(column));
    factors_.entry(row, column) = -0.5 * h * sign * values[number] * unit;
  }
  double sum = 0.0;
  for (const auto& [row, column, number, sign] : band_.entries) {
    sum += std::abs(factors_.entry(row, column) * factors_.entry(column, row));
  }
  stiffness_ = std::sqrt(sum);
  for (int i = 0; i < factors_.size(); ++i) {
    factors_.entry(i, i) += 1.0;
  }
  return factors_.factor();
}

void BandStepMatrix::solve(double* rhs) {
  for (std::size_t i = 0; i < ordered_.size(); ++i) {
    const auto place = static_cast<std::size_t>(band_.places[i]);
    ordered_[place] = rhs[i] / units_[place];
  }
  factors_.solve(ordered_.data());
  for (std::size_t i = 0; i < ordered_.size(); ++i) {
    const auto place = static_cast<std::size_t>(band_.places[i]);
    rhs[i] = ordered_[place] * units_[place];
  }
}

}  // namespace rubato
