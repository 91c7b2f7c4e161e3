#include <rubato/pde/random_points.hpp>

#include <cmath>
#include <random>
#include <span>

#include <rubato/formula/bytecode.hpp>

namespace rubato {

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
  formula::ScalarEvaluator gradient(system.gradient_code()), source(system.source_code());
  std::vector<PotentialSample> samples;
  std::vector<double> outputs(static_cast<std::size_t>(d) + 1), sources(static_cast<std::size_t>(coordinates));
  for (Index attempt = 0; static_cast<Index>(samples.size()) < wanted && attempt < 4 * wanted; ++attempt) {
    PotentialSample one;
    one.point = VectorXd::NullaryExpr(static_cast<Index>(system.variables().size()), [&] { return value(random); });
    if (attempt >= 2 * wanted) {
      one.point = one.point.cwiseAbs().eval();
    }
    one.point.head(d).array() *= sizes.array();
    const std::span<const double> at(one.point.data(), static_cast<std::size_t>(one.point.size()));
    gradient(at, outputs);
    one.S = outputs[0];
    one.gradient = Eigen::Map<const VectorXd>(outputs.data() + 1, d);
    one.sources = VectorXd::Zero(coordinates);
    if (coordinates > 0) {
      source(at, sources);
      one.sources = Eigen::Map<const VectorXd>(sources.data(), coordinates);
    }
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
