#include <rubato/ode/segment_equation.hpp>

#include <stdexcept>

#include <fmt/format.h>

#include <rubato/ode/darboux.hpp>
#include <rubato/ode/discrete_lagrangian.hpp>
#include <rubato/ode/gauss_function.hpp>
#include <rubato/ode/generating_action.hpp>
#include <rubato/solve/small_matrices.hpp>
#include <rubato/variation/composition.hpp>

namespace rubato {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

using Point = Eigen::Map<const VectorXd>;

Point point(std::span<const double> z) {
  return {z.data(), static_cast<Index>(z.size())};
}

/// The derivatives of Φ that the rows need, at (w, h).
struct SecondVariation {
  double rate = 0.0, second_rate = 0.0;  ///< ∂_hΦ, ∂²_hΦ
  VectorXd gradient, gradient_rate;      ///< ∇Φ, ∂_h∇Φ
  MatrixXd hessian;                      ///< Φ_ww
};

/// The rows of type F = 0 or any other, of the derivatives of Φ.
class Family : public SegmentEquation {
public:
  explicit Family(const MatrixXd& F) : J_(symplectic_unit(F.rows() / 2)), weight_(0.5 * turned(F)) {
    const MatrixXd half = 0.5 * MatrixXd::Identity(F.rows(), F.rows());
    w_by_0_ = half - weight_;
    w_by_1_ = half + weight_;
  }

  Status evaluate(std::span<const double> z_0, std::span<const double> z_1, double h, SegmentRows& rows) final {
    const VectorXd delta = point(z_1) - point(z_0);
    const VectorXd w = 0.5 * (point(z_0) + point(z_1)) + weight_ * delta;
    if (const Status status = expand({w.data(), z_0.size()}, h); status != Status::success) {
      return status;
    }
    const SecondVariation& phi = variation_;
    rows.value = J_ * delta - phi.gradient;
    rows.by_0 = -J_ - phi.hessian.lazyProduct(w_by_0_);
    rows.by_1 = J_ - phi.hessian.lazyProduct(w_by_1_);
    rows.by_h = -phi.gradient_rate;
    rows.energy = -phi.rate;
    rows.energy_by_0 = -(w_by_0_.transpose() * phi.gradient_rate);
    rows.energy_by_1 = -(w_by_1_.transpose() * phi.gradient_rate);
    rows.energy_by_h = -phi.second_rate;
    const bool finite = rows.value.allFinite() && rows.by_0.allFinite() && rows.by_1.allFinite() &&
                        rows.by_h.allFinite() && std::isfinite(rows.energy) && std::isfinite(rows.energy_by_h);
    return finite ? Status::success : Status::undefined;
  }

protected:
  /// Fills in variation_.
  virtual Status expand(std::span<const double> w, double h) = 0;

  SecondVariation variation_;

private:
  MatrixXd J_, weight_, w_by_0_, w_by_1_;  ///< weight_ = ½JF = ∂w/∂δ
};

MatrixXd no_shift(const Hamiltonian& hamiltonian) {
  const auto size = static_cast<Index>(2 * hamiltonian.degrees_of_freedom());
  return MatrixXd::Zero(size, size);
}

/// Φ = -hH(w).
class MidpointFamily final : public Family {
public:
  explicit MidpointFamily(const Hamiltonian& hamiltonian) : Family(no_shift(hamiltonian)), evaluator_(hamiltonian) {
    const auto size = static_cast<Index>(evaluator_.dimension());
    variation_.gradient_rate.resize(size);
    variation_.hessian.resize(size, size);
  }
  [[nodiscard]] int order() const override { return 2; }

private:
  Status expand(std::span<const double> w, double h) override {
    variation_.rate =
        -evaluator_.hessian(w.data(), variation_.gradient_rate.data(), variation_.hessian.data());  // ∇H, H_zz
    variation_.second_rate = 0.0;
    variation_.gradient_rate *= -1.0;
    variation_.gradient = h * variation_.gradient_rate;
    variation_.hessian *= -h;
    return Status::success;
  }

  HamiltonianEvaluator evaluator_;
};

class GaussFamily final : public Family {
public:
  GaussFamily(const Hamiltonian& hamiltonian, int stages)
      : Family(no_shift(hamiltonian)), function_(hamiltonian, stages), order_(2 * stages) {}
  [[nodiscard]] int order() const override { return order_; }

private:
  Status expand(std::span<const double> w, double h) override {
    if (const Status status = function_.expand(w, h); status != Status::success) {
      return status;
    }
    variation_.rate = function_.rate();
    variation_.gradient = function_.gradient();
    return function_.second_variation(variation_.second_rate, variation_.gradient_rate, variation_.hessian);
  }

  GaussFunction function_;
  int order_;
};

class GeneratingFamily final : public Family {
public:
  GeneratingFamily(const Hamiltonian& hamiltonian, const MatrixXd& F, int order)
      : Family(F), order_(generating_order(order, F)), function_(hamiltonian, F, order_.terms) {
    variation_.gradient.resize(F.rows());
    variation_.gradient_rate.resize(F.rows());
    variation_.hessian.resize(F.rows(), F.rows());
  }
  [[nodiscard]] int order() const override { return order_.order; }

private:
  Status expand(std::span<const double> w, double h) override {
    if (const Status status = function_.expand(w); status != Status::success) {
      return status;
    }
    const int terms = order_.terms;
    variation_.rate = function_.sum_rate(h, terms);
    variation_.second_rate = function_.sum_second_rate(h, terms);
    function_.gradient_sum(h, terms, variation_.gradient);
    function_.gradient_sum_rate(h, terms, variation_.gradient_rate);
    return function_.hessian_sum(w, h, terms, variation_.hessian);
  }

  GeneratingOrder order_;
  GeneratingFunction function_;
};

/// Of an action, whose first and second variation are formulas.
class ActionRows final : public SegmentEquation {
public:
  explicit ActionRows(std::unique_ptr<DiscreteAction> action) : action_(std::move(action)) {
    const auto size = static_cast<Index>(action_->element().size());
    gradient_.resize(size);
    hessian_.resize(size, size);
    corners_.resize(action_->element().size());
  }
  [[nodiscard]] bool is_action() const override { return true; }
  [[nodiscard]] int order() const override { return 2; }

  Status evaluate(std::span<const double> z_0, std::span<const double> z_1, double h, SegmentRows& rows) override {
    const auto size = static_cast<Index>(z_0.size());
    std::copy(z_0.begin(), z_0.end(), corners_.begin() + 1);
    std::copy(z_1.begin(), z_1.end(), corners_.begin() + size + 2);
    corners_[0] = 0.0;
    corners_[z_0.size() + 1] = h;
    action_->gradient(corners_, gradient_);
    action_->hessian(corners_, hessian_);
    if (!gradient_.allFinite() || !hessian_.allFinite()) {
      return Status::undefined;
    }
    const Index first = 1, t_1 = size + 1, second = size + 2;
    rows.value.resize(2 * size);
    rows.value << gradient_.segment(first, size), gradient_.segment(second, size);
    const auto columns = [&](Index place, MatrixXd& block) {
      block.resize(2 * size, size);
      block << hessian_.block(first, place, size, size), hessian_.block(second, place, size, size);
    };
    columns(first, rows.by_0);
    columns(second, rows.by_1);
    rows.by_h.resize(2 * size);
    rows.by_h << hessian_.col(t_1).segment(first, size), hessian_.col(t_1).segment(second, size);
    rows.energy = -gradient_[t_1];
    rows.energy_by_0 = -hessian_.col(t_1).segment(first, size);
    rows.energy_by_1 = -hessian_.col(t_1).segment(second, size);
    rows.energy_by_h = -hessian_(t_1, t_1);
    return Status::success;
  }

private:
  std::unique_ptr<DiscreteAction> action_;
  VectorXd gradient_;
  MatrixXd hessian_;
  std::vector<double> corners_;
};

/// Of a one-step map, as the defect d = J(z_1 - ψ_h(z_0)). With constraints ψ_h leads to states that satisfy them from
/// wherever it begins, so that they need be stated at the first node alone.
class MapRows final : public SegmentEquation {
public:
  MapRows(const Hamiltonian& hamiltonian, const SegmentLagrangian& lagrangian)
      : hamiltonian_(hamiltonian),
        lagrangian_(lagrangian),
        J_(symplectic_unit(static_cast<Index>(hamiltonian.degrees_of_freedom()))) {
    columns_.resize(J_.rows(), J_.rows() + 1);
    energies_.resize(J_.rows() + 1);
  }
  [[nodiscard]] int order() const override {
    const auto* splitting = std::get_if<Splitting>(&lagrangian_);
    return splitting == nullptr ? 2 : composition(splitting->composition).order;
  }

  Status evaluate(std::span<const double> z_0, std::span<const double> z_1, double h, SegmentRows& rows) override {
    const Index size = J_.rows();
    if (!map_) {
      const VectorXd start = constrained_near(z_0);
      map_ = make_one_step_scheme(hamiltonian_, lagrangian_, {start.data(), z_0.size()});
    }
    map_->restart(z_0);
    if (const Status status = map_->advance(h, 0.0); status != Status::success) {
      return status;
    }
    columns_.setIdentity();
    const Status status = map_->linearise({columns_.data(), static_cast<std::size_t>(columns_.size())},
                                          {energies_.data(), static_cast<std::size_t>(energies_.size())});
    if (status != Status::success) {
      return status;
    }
    rows.energy = map_->discrete_energy();
    map_->accept();
    rows.value = J_.lazyProduct(point(z_1) - point(map_->state()));
    rows.by_0 = -J_.lazyProduct(columns_.leftCols(size));
    rows.by_1 = J_;
    rows.by_h = -J_.lazyProduct(columns_.col(size));
    rows.energy_by_0 = energies_.head(size);
    rows.energy_by_1 = VectorXd::Zero(size);
    rows.energy_by_h = energies_[size];
    return Status::success;
  }

private:
  /// A state that satisfies the constraints to rounding. \throws std::invalid_argument, with the sizes, if there is
  /// none near z
  [[nodiscard]] VectorXd constrained_near(std::span<const double> z) const {
    const Constraints& constraints = hamiltonian_.constraints();
    ConstraintEvaluator at(constraints);
    const Index size = J_.rows(), n = size / 2;
    VectorXd q = point(z).head(n), state = point(z);
    static_cast<void>(approach_constraints(at, q));  // or the scheme refuses it
    state.head(n) = q;
    HamiltonianEvaluator evaluator(hamiltonian_);
    VectorXd gradient(size);
    MatrixXd hessian(size, size);
    for (int iteration = 0; iteration < projections; ++iteration) {
      evaluator.hessian(state.data(), gradient.data(), hessian.data());
      const MatrixXd along = solve::product(hessian.bottomRightCorner(n, n), at.G().transpose());
      const auto nu = solve::quotient(solve::product(at.G(), along), at.G().lazyProduct(gradient.tail(n)));
      if (!nu) {
        break;
      }
      state.tail(n) -= at.G().transpose().lazyProduct(nu->col(0));
    }
    return state;
  }
  /// Newton's method for the momenta; of a kinetic energy of degree two the first leaves rounding errors.
  static constexpr int projections = 8;

  const Hamiltonian hamiltonian_;
  const SegmentLagrangian lagrangian_;
  MatrixXd J_, columns_;
  VectorXd energies_;
  std::unique_ptr<OneStepScheme> map_;
};

/// A point at which to ask whether an action knows t: none that a formula is likely to single out.
std::vector<double> some_corners(std::size_t size) {
  std::vector<double> corners;
  for (std::size_t i = 0; i < size; ++i) {
    corners.push_back(0.31 + 0.07 * static_cast<double>(i % 11));
  }
  return corners;
}

}  // namespace

std::optional<MatrixXd> SegmentEquation::tangent(const SegmentRows& rows) {
  return solve::quotient(rows.by_1, -rows.by_0);
}

std::unique_ptr<SegmentEquation> make_segment_equation(const Hamiltonian& hamiltonian,
                                                       const SegmentLagrangian& lagrangian) {
  if (!hamiltonian.constraints().none()) {
    require_constrained(hamiltonian, lagrangian);
    return std::make_unique<MapRows>(hamiltonian, lagrangian);
  }
  if (std::holds_alternative<Midpoint>(lagrangian)) {
    return std::make_unique<MidpointFamily>(hamiltonian);
  }
  if (const auto* gauss = std::get_if<Gauss>(&lagrangian)) {
    return std::make_unique<GaussFamily>(hamiltonian, gauss->stages);
  }
  if (const auto* generating = std::get_if<Generating>(&lagrangian)) {
    return std::make_unique<GeneratingFamily>(hamiltonian, generating->F(hamiltonian.degrees_of_freedom()),
                                              generating->order);
  }
  if (method_of(lagrangian).action == nullptr) {
    throw std::invalid_argument(fmt::format(
        "boundary-value problems are not available for lagrangian = \"{}\": use gauss, midpoint, generating, "
        "forward or custom",
        method_of(lagrangian).name));
  }
  auto action = make_action(hamiltonian, lagrangian);
  if (!is_autonomous(*action, some_corners(action->element().size()))) {
    throw std::invalid_argument("boundary-value problems need an L that depends on t_0 and t_1 by t_1 - t_0 alone");
  }
  return std::make_unique<ActionRows>(std::move(action));
}

}  // namespace rubato
