// The conformance suite of variation/ for every discrete Lagrangian on a segment, and for actions that are wrong.

#include <catch2/catch.hpp>

#include <memory>
#include <random>

#include <rubato/ode/discrete_lagrangian.hpp>

#include "systems.hpp"
#include "variation/conformance.hpp"

using namespace rubato;
using conformance::failures;
using Eigen::VectorXd;

namespace {

using Names = std::vector<std::string>;

/// A corner vector (t_0, z_0, t_1, z_1) near a given state: identity (z_1 = z_0), close together, or random.
VectorXd corners_near(const std::vector<double>& z, double spread, double h, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(-spread, spread);
  const auto size = static_cast<Eigen::Index>(z.size());
  VectorXd corners(2 * size + 2);
  corners << 0.3, Eigen::Map<const VectorXd>(z.data(), size), 0.3 + h, Eigen::Map<const VectorXd>(z.data(), size);
  for (Eigen::Index i = 0; i < size; ++i) {
    corners[size + 2 + i] += uniform(random);
  }
  return corners;
}

/// An action that answers wrongly in one respect.
class Wrong final : public DiscreteAction {
public:
  enum class Fault { gradient, hessian, symmetry, size, value };
  Wrong(std::unique_ptr<DiscreteAction> right, Fault fault)
      : right_(std::move(right)), element_(right_->element()), fault_(fault) {
    element_.values += fault == Fault::size ? 1 : 0;
  }
  [[nodiscard]] const Element& element() const override { return element_; }
  [[nodiscard]] double value(std::span<const double> corners) override {
    return right_->value(corners) + (fault_ == Fault::value ? 1e-4 * corners[0] : 0.0);
  }
  void gradient(std::span<const double> corners, Eigen::Ref<VectorXd> result) override {
    right_->gradient(corners, result);
    result[1] += fault_ == Fault::gradient ? 1e-4 : 0.0;
  }
  void hessian(std::span<const double> corners, Eigen::Ref<Eigen::MatrixXd> result) override {
    right_->hessian(corners, result);
    const auto last = result.rows() - 1;
    result(1, last) += fault_ == Fault::hessian || fault_ == Fault::symmetry ? 1e-4 : 0.0;
    result(last, 1) += fault_ == Fault::hessian ? 1e-4 : 0.0;
  }
  [[nodiscard]] formula::SumSize energy_size(std::span<const double> corners) override {
    return right_->energy_size(corners);
  }

private:
  std::unique_ptr<DiscreteAction> right_;
  Element element_;
  Fault fault_;
};

const char* const driven = "(p_0 + p_1)/2*(q_1 - q_0)/(t_1 - t_0) - (p_0^2 + p_1^2)/4 + sin(t_0 + t_1)*q_0*q_1";
const char* const quartic = "p_0*(q_1 - q_0)/(t_1 - t_0) - p_1^2/2 - (t_1 - t_0)*q_0^2*q_1^2";

}  // namespace

TEST_CASE("every discrete Lagrangian on a segment conforms") {
  for (const auto& system : {systems::pendulum(), systems::henon_heiles(), systems::kepler(0.6), systems::double_well(),
                             systems::non_separable()}) {
    for (const SegmentLagrangian& lagrangian : {SegmentLagrangian{Midpoint{}}, SegmentLagrangian{Forward{}}}) {
      const auto action = make_action(system.hamiltonian, lagrangian);
      for (const double spread : {0.0, 1e-8, 0.1}) {
        for (const double h : {0.1, -0.2}) {
          INFO(system.name << ", lagrangian " << lagrangian.index() << ", spread " << spread << ", h " << h);
          CHECK(failures(*action, corners_near(systems::joined(system.initial), spread, h, 7)) == Names{});
        }
      }
    }
  }
  const auto system = systems::pendulum();
  for (const double spread : {0.0, 1e-8, 0.1}) {
    const VectorXd corners = corners_near({0.7, 1.9}, spread, 0.2, 11);
    CHECK(failures(*make_action(system.hamiltonian, Custom{quartic}), corners) == Names{});
    CHECK(failures(*make_action(system.hamiltonian, Custom{driven}), corners, {.autonomous = false}) == Names{});
  }
}

TEST_CASE("an action that is wrong does not conform, and the suite says in what") {
  const auto system = systems::pendulum();
  const VectorXd corners = corners_near({0.7, 1.9}, 0.1, 0.2, 3);
  const auto failed = [&](Wrong::Fault fault) {
    Wrong action(make_action(system.hamiltonian, Midpoint{}), fault);
    return failures(action, corners);
  };
  using Catch::VectorContains;
  CHECK_THAT(failed(Wrong::Fault::value), VectorContains(std::string("gradient")));
  CHECK_THAT(failed(Wrong::Fault::gradient), VectorContains(std::string("gradient")));
  CHECK_THAT(failed(Wrong::Fault::gradient), VectorContains(std::string("one-forms")));
  CHECK_THAT(failed(Wrong::Fault::hessian), VectorContains(std::string("hessian")));
  CHECK_THAT(failed(Wrong::Fault::hessian), VectorContains(std::string("two-form")));
  CHECK_THAT(failed(Wrong::Fault::symmetry), VectorContains(std::string("symmetry")));
  CHECK(failed(Wrong::Fault::size) == Names{"size"});
  const auto explicit_time = make_action(system.hamiltonian, Custom{driven});
  CHECK(failures(*explicit_time, corners) == Names{"autonomy"});
}
