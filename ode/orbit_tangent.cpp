#include <rubato/ode/orbit_tangent.hpp>

#include <algorithm>
#include <utility>
#include <vector>

#include <rubato/base/all_finite.hpp>
#include <rubato/ode/discrete_lagrangian.hpp>
#include <rubato/ode/tangent.hpp>
#include <rubato/solve/small_matrices.hpp>

namespace rubato {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;

class MapTangent final : public OrbitTangent {
public:
  explicit MapTangent(std::unique_ptr<OneStepScheme> map) : map_(std::move(map)) {}

  [[nodiscard]] std::size_t size() const override { return map_->dimension(); }
  [[nodiscard]] Status lift(std::span<const double> z_0, std::span<const double>, double, double,
                            std::span<const double> from, std::span<double> to) override {
    std::ranges::copy(from, to.begin());
    map_->restart(z_0);
    return map_->project_variations(to);
  }
  [[nodiscard]] Status step(std::span<const double> z_0, std::span<const double> z_1, double, double h,
                            std::span<double> columns) override {
    map_->restart(z_0);
    Status status = map_->advance_to(z_1, h);
    if (status != Status::success) {  // from nothing, and through a step of half the length
      map_->restart(z_0);
      status = map_->advance(0.5 * h, 0.0);
      status = status == Status::success ? map_->advance(h, 0.0) : status;
    }
    return status == Status::success ? map_->tangent(columns) : status;
  }

  void save(StateWriter& state) const override { map_->save_guesses(state); }
  void restore(StateReader& state) override { map_->restore_guesses(state); }

private:
  std::unique_ptr<OneStepScheme> map_;
};

class ActionTangent final : public OrbitTangent {
public:
  ActionTangent(std::unique_ptr<DiscreteAction> action, const Hamiltonian& hamiltonian)
      : action_(std::move(action)),
        hamiltonian_(hamiltonian),
        size_(action_->element().values),
        corners_(action_->element().size()),
        second_(static_cast<Index>(corners_.size()), static_cast<Index>(corners_.size())) {}

  [[nodiscard]] std::size_t size() const override { return 2 * size_; }

  [[nodiscard]] Status lift(std::span<const double> z_0, std::span<const double> z_1, double t_0, double h,
                            std::span<const double> from, std::span<double> to) override {
    vary(z_0, z_1, t_0, h);
    const auto rows = static_cast<Index>(size_), count = static_cast<Index>(from.size()) / rows;
    const Eigen::Map<const MatrixXd> variations(from.data(), rows, count);
    Eigen::Map<MatrixXd> lifted(to.data(), 2 * rows, count);
    MatrixXd step;
    try {
      step = fixed_level_tangent(hamiltonian_, z_0, z_1, h);
    } catch (const std::invalid_argument&) {
      return Status::singular;
    }
    lifted.topRows(rows) = variations;
    lifted.bottomRows(rows) = -(block(0, 0) + block(0, 1).lazyProduct(step)).lazyProduct(variations);
    return lifted.allFinite() ? Status::success : Status::undefined;
  }

  [[nodiscard]] Status step(std::span<const double> z_0, std::span<const double> z_1, double t_0, double h,
                            std::span<double> columns) override {
    vary(z_0, z_1, t_0, h);
    const auto rows = static_cast<Index>(size_), count = static_cast<Index>(columns.size()) / (2 * rows);
    Eigen::Map<MatrixXd> all(columns.data(), 2 * rows, count);
    const MatrixXd before = all.topRows(rows);
    const MatrixXd rhs = -all.bottomRows(rows) - block(0, 0).lazyProduct(before);
    const MatrixXd A = block(0, 1);
    // Coordinates and momenta have units of their own, which pivots should not be chosen by.
    const solve::Equilibration units = solve::equilibrate(A.cwiseAbs());
    const auto scaled =
        solve::quotient(units.rows.asDiagonal() * A * units.columns.asDiagonal(), units.rows.asDiagonal() * rhs);
    if (!scaled) {
      return Status::singular;
    }
    const MatrixXd after = units.columns.asDiagonal() * *scaled;
    all.topRows(rows) = after;
    all.bottomRows(rows) = block(1, 0).lazyProduct(before) + block(1, 1).lazyProduct(after);
    return all.allFinite() ? Status::success : Status::undefined;
  }

private:
  /// The second variation of the segment; where t does not matter it begins at 0, since t_0 + h would round h away.
  void vary(std::span<const double> z_0, std::span<const double> z_1, double t_0, double h) {
    const Element& element = action_->element();
    std::ranges::copy(z_0, corners_.begin() + static_cast<std::ptrdiff_t>(element.value(0, 0)));
    std::ranges::copy(z_1, corners_.begin() + static_cast<std::ptrdiff_t>(element.value(1, 0)));
    const auto begin_at = [&](double t) {
      corners_[element.coordinate(0, 0)] = t;
      corners_[element.coordinate(1, 0)] = t + h;
    };
    begin_at(t_0);
    if (!known_) {
      autonomous_ = is_autonomous(*action_, corners_);
      known_ = true;
    }
    begin_at(autonomous_ ? 0.0 : t_0);
    action_->hessian(corners_, second_);
  }
  [[nodiscard]] MatrixXd block(std::size_t row, std::size_t column) const {
    const Element& element = action_->element();
    return second_.block(static_cast<Index>(element.value(row, 0)), static_cast<Index>(element.value(column, 0)),
                         static_cast<Index>(size_), static_cast<Index>(size_));
  }

  std::unique_ptr<DiscreteAction> action_;
  HamiltonianEvaluator hamiltonian_;
  std::size_t size_;
  std::vector<double> corners_;
  MatrixXd second_;
  bool autonomous_ = false, known_ = false;
};

}  // namespace

std::unique_ptr<OrbitTangent> make_orbit_tangent(const Hamiltonian& hamiltonian, const SegmentLagrangian& lagrangian,
                                                 bool starting_pair, std::span<const double> z_0) {
  const Hamiltonian& reduced = hamiltonian.without_constant();
  if (method_of(lagrangian).scheme != nullptr && !starting_pair) {
    return make_orbit_tangent(make_one_step_scheme(reduced, lagrangian, z_0));
  }
  return std::make_unique<ActionTangent>(make_action(reduced, lagrangian), reduced);
}

std::unique_ptr<OrbitTangent> make_orbit_tangent(std::unique_ptr<OneStepScheme> map) {
  return std::make_unique<MapTangent>(std::move(map));
}

}  // namespace rubato
