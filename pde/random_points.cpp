#include <rubato/pde/random_points.hpp>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <random>
#include <span>

#include <rubato/formula/branches.hpp>

namespace rubato {

std::vector<formula::ScalarEvaluator> potentials_on_branches(const MultisymplecticSystem& system) {
  const std::span<const formula::Expression> z(system.variables().data(), system.fields().size());
  std::vector<formula::Expression> outputs = {system.expression()};
  std::ranges::copy(formula::gradient(system.expression(), z), std::back_inserter(outputs));
  std::ranges::copy(system.sources(), std::back_inserter(outputs));
  return formula::evaluators_on_branches(outputs, system.variables());
}

std::vector<PotentialSample> samples_of(const MultisymplecticSystem& system, Eigen::Index wanted) {
  return samples_of(system, wanted, Eigen::VectorXd::Ones(system.field_count()));
}

std::vector<PotentialSample> samples_of(const MultisymplecticSystem& system, Eigen::Index wanted,
                                        const Eigen::VectorXd& sizes) {
  using Eigen::Index;
  using Eigen::VectorXd;
  std::mt19937_64 random(51);
  std::uniform_real_distribution<double> value(-1.4, 1.4);
  const Index d = system.field_count(), coordinates = static_cast<Index>(system.coordinates().size());
  std::vector<formula::ScalarEvaluator> potentials = potentials_on_branches(system);
  std::vector<PotentialSample> samples;
  std::vector<double> outputs(static_cast<std::size_t>(1 + d + coordinates));
  for (Index attempt = 0; static_cast<Index>(samples.size()) < wanted && attempt < 4 * wanted; ++attempt) {
    PotentialSample one;
    one.point = VectorXd::NullaryExpr(static_cast<Index>(system.variables().size()), [&] { return value(random); });
    if (attempt >= 2 * wanted) {
      one.point = one.point.cwiseAbs().eval();
    }
    one.point.head(d).array() *= sizes.array();
    const std::span<const double> at(one.point.data(), static_cast<std::size_t>(one.point.size()));
    potentials[static_cast<std::size_t>(attempt) % potentials.size()](at, outputs);
    one.S = outputs[0];
    one.gradient = Eigen::Map<const VectorXd>(outputs.data() + 1, d);
    one.sources = Eigen::Map<const VectorXd>(outputs.data() + 1 + d, coordinates);
    if (std::isfinite(one.S) && one.gradient.allFinite() && one.sources.allFinite()) {
      samples.push_back(std::move(one));
    }
  }
  return samples;
}

double nearest_twelfth(double x) {
  constexpr double parts = 12.0, rounding = 1e-9;
  const double near = std::round(x * parts) / parts;
  return std::abs(x - near) < rounding ? near + 0.0 : x;  // 0, not -0
}

}  // namespace rubato
