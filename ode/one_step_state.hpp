#pragma once

#include <optional>
#include <span>
#include <utility>

#include <Eigen/Core>

#include <rubato/ode/hamiltonian.hpp>
#include <rubato/ode/increment.hpp>
#include <rubato/ode/segment_scheme.hpp>

namespace rubato {

/// What one-step schemes share: the state z_k, summed with compensation; the increment δ of the trial step; and what is
/// read of H at both levels, evaluated once where it is asked for.
template <typename Vector>
class OneStepState : public OneStepScheme {
public:
  [[nodiscard]] std::size_t dimension() const override { return static_cast<std::size_t>(delta_.size()); }
  [[nodiscard]] std::span<const double> state() const override { return as_span(z_.value()); }

  [[nodiscard]] NodeEnergy node() override {
    if (!here_.node) {
      here_.node = node_at(z_.value());
    }
    return *here_.node;
  }

protected:
  OneStepState(const Hamiltonian& hamiltonian, std::span<const double> z_0)
      : evaluator_(hamiltonian),
        z_(Vector(Eigen::Map<const Vector>(z_0.data(), static_cast<Eigen::Index>(z_0.size())))) {
    const auto size = static_cast<Eigen::Index>(z_0.size());
    delta_.setZero(size);
    end_.setZero(size);
  }

  /// What the levels read at z.
  [[nodiscard]] virtual NodeEnergy node_at(const Vector& z) = 0;

  /// H at both levels of the trial step.
  ///@{
  [[nodiscard]] double energy_here() const {
    if (!here_.energy) {
      here_.energy = evaluator_.value(z_.value().data());
    }
    return *here_.energy;
  }
  [[nodiscard]] double energy_there() const {
    if (!there_.energy) {
      there_.energy = evaluator_.value(end().data());
    }
    return *there_.energy;
  }
  ///@}

  /// dE/dh of a family from the node laws at both ends of the step, E - H = (s+1) h^s η + O(h^(s+1)) with signs that
  /// agree (theory, section 8): s (E - (H(z_k) + H(z_{k+1}))/2)/h (1 + O(h²)).
  [[nodiscard]] double slope_by_nodes(double energy, double h) const {
    return order() * (energy - 0.5 * (energy_here() + energy_there())) / h;
  }

  /// To be called where δ changes.
  void forget_trial() {
    there_ = {};
    end_known_ = false;
  }
  /// The trial level becomes the present one.
  ///@{
  void take() {
    z_.add(delta_);
    move();
  }
  void take(const Vector& lost) {  ///< with what δ lost when it was rounded
    z_.add(delta_, lost);
    move();
  }
  ///@}
  void stand_at(const Vector& z) {
    z_ = CompensatedState<Vector>(z);
    forget();
  }
  void restore_state(StateReader& state) {
    z_.restore(state);
    forget();
  }

  mutable HamiltonianEvaluator evaluator_;
  CompensatedState<Vector> z_;
  Vector delta_;

private:
  struct Readings {
    std::optional<double> energy;
    std::optional<NodeEnergy> node;
  };

  [[nodiscard]] const Vector& end() const {
    if (!end_known_) {
      z_.displaced(1.0, delta_, end_);
      end_known_ = true;
    }
    return end_;
  }
  void move() {
    // What is known of the trial level holds if the state is at that place to the last bit: a run goes on from a saved
    // state, for which all is evaluated anew, as if it had never stopped.
    const bool same = end_known_ && end_ == z_.value();
    here_ = same ? there_ : Readings{};
    forget_trial();
  }
  void forget() {
    here_ = {};
    forget_trial();
  }

  mutable Vector end_;  ///< z_{k+1}, rounded, of the trial step
  mutable bool end_known_ = false;
  mutable Readings here_, there_;
};

}  // namespace rubato
