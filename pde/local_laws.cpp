#include <rubato/pde/local_laws.hpp>

#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>

#include <rubato/pde/law_evaluator.hpp>
#include <rubato/pde/random_points.hpp>
#include <rubato/solve/small_matrices.hpp>

namespace rubato {

void check_symmetry(const MultisymplecticSystem& system, const LinearSymmetry& symmetry) {
  const auto d = static_cast<Eigen::Index>(system.field_count());
  const std::string& name = symmetry.name;
  const Eigen::MatrixXd& B = symmetry.B;
  if (B.rows() != d || B.cols() != d) {
    throw std::invalid_argument(
        fmt::format("the symmetry {} is {} by {}, but there are {} fields", name, B.rows(), B.cols(), d));
  }
  const auto check_symmetric = [&](const Eigen::MatrixXd& matrix, const std::string& what) {
    const Eigen::MatrixXd product = solve::product(matrix, B);
    for (Eigen::Index i = 0; i < d; ++i) {
      for (Eigen::Index j = 0; j < i; ++j) {
        if (std::abs(product(i, j) - product(j, i)) > 1e-12 * product.cwiseAbs().maxCoeff()) {
          throw std::invalid_argument(fmt::format(
              "{} is not a symmetry: {}B has to be symmetric, but [{}, {}] is {} and [{}, {}] is {}", name, what,
              system.fields()[static_cast<std::size_t>(j)], system.fields()[static_cast<std::size_t>(i)], product(j, i),
              system.fields()[static_cast<std::size_t>(i)], system.fields()[static_cast<std::size_t>(j)],
              product(i, j)));
        }
      }
    }
  };
  check_symmetric(system.M(), "M ");
  for (int a = 0; a < system.directions(); ++a) {
    check_symmetric(system.K(a), fmt::format("K.{} ", "xyz"[a]));
  }
  std::mt19937_64 random(50);
  std::uniform_real_distribution<double> value(0.1, 1.4);
  std::vector<formula::ScalarEvaluator> potentials = potentials_on_branches(system);
  Eigen::VectorXd point(static_cast<Eigen::Index>(system.variables().size()));
  std::vector<double> outputs(1 + system.fields().size() + system.coordinates().size());
  for (int attempt = 0; attempt < 10; ++attempt) {
    for (double& component : point) {
      component = value(random);
    }
    potentials[static_cast<std::size_t>(attempt) % potentials.size()](
        {point.data(), static_cast<std::size_t>(point.size())}, outputs);
    const Eigen::VectorXd z = point.head(d);
    const Eigen::Map<const Eigen::VectorXd> gradient(outputs.data() + 1, d);
    const Eigen::VectorXd direction = solve::product(B, z);
    const double derivative = gradient.dot(direction);
    if (std::abs(derivative) > 1e-11 * gradient.norm() * direction.norm()) {
      throw std::invalid_argument(
          fmt::format("{} is not a symmetry of S: grad S . Bz is {:.3g} at a random z", name, derivative));
    }
  }
}

LocalLaws::LocalLaws(std::vector<std::string> names, std::function<std::unique_ptr<LawEvaluator>()> make)
    : names_(std::move(names)), make_(std::move(make)) {}
LocalLaws::~LocalLaws() = default;
LocalLaws::LocalLaws(LocalLaws&&) noexcept = default;
LocalLaws& LocalLaws::operator=(LocalLaws&&) noexcept = default;

void LocalLaws::share(std::shared_ptr<StageSource> stages) {
  if (stages != nullptr) {
    ++asked_;
    if (engine_ == nullptr) {
      stages_ = std::move(stages);
    } else {
      engine_->share(std::move(stages));
    }
  }
}

LawEvaluator& LocalLaws::engine() {
  if (engine_ == nullptr) {
    engine_ = std::exchange(make_, nullptr)();
    if (stages_ != nullptr) {
      engine_->share(std::exchange(stages_, nullptr));
    }
  }
  return *engine_;
}

std::vector<Spread> LocalLaws::residuals(const LatticeLevel& before, const LatticeLevel& after, double h,
                                         std::span<double* const> residuals, Question earlier) {
  const bool follows = earlier != none && earlier == asked_;
  ++asked_;
  return follows ? engine().next_residuals(before, after, h, residuals)
                 : engine().residuals(before, after, h, residuals);
}

std::vector<double> LocalLaws::totals(const LatticeLevel& level) {
  ++asked_;
  return engine().totals(level);
}

std::vector<double> LocalLaws::totals_after(const LatticeLevel& after) {
  return engine().totals_after(after);
}

Spread LocalLaws::multisymplectic_residual(const TangentLevels& u, const TangentLevels& v, double h, double* residual) {
  return engine().multisymplectic_residual(u, v, h, residual);
}

}  // namespace rubato
