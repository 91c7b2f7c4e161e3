#include <rubato/ode/constrained_splitting.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/ode/constrained_state.hpp>
#include <rubato/ode/separable.hpp>
#include <rubato/ode/splitting_tangent.hpp>
#include <rubato/ode/tuning.hpp>

namespace rubato {

namespace {

using namespace tuning::constraints;

using Eigen::Index;
using Eigen::VectorXd;

/// V, its gradient and the entries of G at a level.
struct ConstrainedNode {
  VectorXd q, force, entries;  ///< force: ∇V
  double V = 0.0;
  bool known = false;
};

/// Its unknowns are the multipliers, count() of them for each drift.
class ConstrainedSplitting final : public ConstrainedState {
public:
  ConstrainedSplitting(const Hamiltonian& hamiltonian, const Separation& halves, const Composition& composition,
                       std::span<const double> z_0)
      : ConstrainedState(hamiltonian,
                         std::ranges::count_if(composition.parts, &Composition::Part::drift) *
                             static_cast<Index>(hamiltonian.constraints().count()),
                         z_0),
        composition_(composition),
        graph_(hamiltonian.graph()),
        T_(halves.T, std::span(hamiltonian.variables()).last(static_cast<std::size_t>(n_))),
        V_(halves.V, std::span(hamiltonian.variables()).first(static_cast<std::size_t>(n_))),
        potential_(V_.code),
        drift_(halves.T, hamiltonian.variables(), constraints_, ConstrainedKick::Then::drift) {
    rounding_magnitude_ = composition.magnitude();
    for (ConstrainedNode* node : {&here_, &there_}) {
      node->q.setZero(n_);
      node->force.setZero(n_);
      node->entries.setZero(static_cast<Index>(constraints_.places().size()));
    }
    kicked_.setZero(n_);
    mu_.setZero(c_);
  }

  [[nodiscard]] int order() const override { return composition_.order; }
  void accept() override {
    ConstrainedState::accept();
    std::swap(here_, there_);
    here_.known = here_.known && here_.q == z_.value().head(n_);
  }

private:
  void forget_level() override { here_.known = false; }
  void start_on_tangent(double) override { unknowns_.setZero(); }

  [[nodiscard]] Status step(double h) override {
    point_.stand_at(z_.value(), z_.low());
    if (!here_.known) {
      here_.q = z_.value().head(n_);
      evaluate_potential(here_);
      at_.evaluate(here_.q.data());
      here_.entries = at_.entries();
      here_.known = true;
    }
    point_.entries() = here_.entries;
    energy_ = 0.0;
    const ConstrainedNode* node = &here_;
    Index drift = 0;
    for (const Composition::Part& part : composition_.parts) {
      if (!part.drift) {
        point_.delta().tail(n_) -= part.length * h * node->force;
        energy_ += part.length * node->V;
        continue;
      }
      if (const Status status = drift_to_constraint(part.length * h, c_ * drift++); status != Status::success) {
        return status;
      }
      energy_ += part.length * drift_.energy();
      there_.q = drift_.there().head(n_);
      evaluate_potential(there_);
      node = &there_;
    }
    there_.entries = point_.entries();
    there_.known = true;
    return Status::success;
  }

  void evaluate_potential(ConstrainedNode& node) {
    const double* const outputs = potential_.at(node.q.data());
    node.V = outputs[0];
    std::copy_n(outputs + 1, n_, node.force.data());
  }

  /// p -= Gᵀμ and q += length ∇T(p), with g = 0 at its end, by Newton's method for μ; its matrix is kept as long as
  /// corrections shrink fast. \param first the place of μ in unknowns_
  [[nodiscard]] Status drift_to_constraint(double length, Index first) {
    point_.length() = length;
    auto mu = unknowns_.segment(first, c_);
    double last = std::numeric_limits<double>::infinity();
    bool factored = false;
    for (int iteration = 0; iteration < most_multiplier_iterations; ++iteration) {
      ++iterations_;
      point_.mu() = mu;
      drift_.evaluate(point_);
      const bool is_rounding = drift_.is_rounding(roundings_of_step);
      const double relative = is_rounding ? 0.0 : drift_.relative();
      if (is_rounding || (relative >= 0.5 * last && relative <= stagnant_constraint)) {
        point_.delta() = drift_.delta_there();
        point_.entries() = drift_.entries_there();
        return Status::success;
      }
      if (!std::isfinite(relative)) {
        return Status::undefined;
      }
      if (!factored || relative > slowest_multipliers * last) {
        if (const Status status = factor(drift_); status != Status::success) {
          return status;
        }
        factored = true;
      }
      last = relative;
      rates_ = drift_.values();
      solve_multipliers();
      mu += rates_;
    }
    return Status::not_converged;
  }

  /// A kick is -G_0ᵀδμ, and δμ what leads the drift after it to G δq = 0.
  [[nodiscard]] Status vary_step(Columns columns, double h, std::span<double> energies) override {
    if (!halves_) {
      halves_.emplace(Halves{.T = SplittingHalfTangent(T_), .V = SplittingHalfTangent(V_)});
    }
    auto& [T, V] = *halves_;
    const Index k = columns.cols(), by_h = energies.empty() ? k : k - 1;  // by_h: the column that h moves
    const auto size = static_cast<std::size_t>(n_);
    const auto add_energies = [&](double length, const SplittingHalfTangent& half, Index from) {
      const Eigen::Map<const VectorXd> gradient(half.gradient().data(), n_);
      for (std::size_t i = 0; i < energies.size(); ++i) {
        energies[i] += length * gradient.dot(columns.col(static_cast<Index>(i)).segment(from, n_));
      }
    };
    std::ranges::fill(energies, 0.0);
    point_.low().setZero();
    point_.delta().setZero();
    at_end_ = z_.value() + z_.low();
    at_.evaluate(at_end_.data());
    Index drift = 0;
    for (const Composition::Part& part : composition_.parts) {
      if (!part.drift) {
        V.evaluate({at_end_.data(), size});
        const Eigen::Map<const VectorXd> gradient(V.gradient().data(), n_);
        add_energies(part.length, V, 0);
        for (Index i = 0; i < k; ++i) {
          V.shear(-part.length * h, columns.col(i).data(), columns.col(i).data() + n_);
        }
        if (by_h < k) {
          columns.col(by_h).tail(n_) -= part.length * gradient;
        }
        at_end_.tail(n_) -= part.length * h * gradient;
        continue;
      }
      const double length = part.length * h;
      mu_ = unknowns_.segment(c_ * drift++, c_);
      vary_gradients(at_end_.data(), mu_, columns);
      point_.z() = at_end_;
      point_.entries() = at_.entries();
      point_.mu() = mu_;
      point_.length() = length;
      drift_.evaluate(point_);
      at_end_ = drift_.there();
      at_.evaluate(at_end_.data());
      T.evaluate({at_end_.data() + n_, size});
      for (Index i = 0; i < k; ++i) {
        T.shear(length, columns.col(i).data() + n_, columns.col(i).data());
      }
      if (by_h < k) {
        columns.col(by_h).head(n_) += part.length * Eigen::Map<const VectorXd>(T.gradient().data(), n_);
      }
      if (const Status status = factor(drift_); status != Status::success) {
        return status;
      }
      for (Index i = 0; i < k; ++i) {
        rates_.noalias() = at_.G().lazyProduct(columns.col(i).head(n_));
        solve_multipliers();
        kicked_.setZero();
        at_.kick(point_.entries(), rates_, kicked_.data());
        T.shear(length, kicked_.data(), columns.col(i).data());
        columns.col(i).tail(n_) += kicked_;
      }
      add_energies(part.length, T, n_);
    }
    return Status::success;
  }

  struct Halves {
    SplittingHalfTangent T, V;
  };

  const Composition& composition_;
  std::shared_ptr<const formula::Graph> graph_;  ///< of the formulas of T and V
  SplittingHalf T_, V_;
  formula::ScalarEvaluator potential_;
  std::optional<Halves> halves_;  ///< where tangents are asked for
  ConstrainedKick drift_;
  ConstrainedNode here_, there_;
  VectorXd mu_, kicked_;
};

}  // namespace

std::unique_ptr<OneStepScheme> make_constrained_splitting(const Hamiltonian& hamiltonian,
                                                          const Composition& composition, std::span<const double> z_0) {
  check_initial_state(hamiltonian, z_0);
  const Hamiltonian own = hamiltonian.with_own_graph();
  const Separation halves = separate(own);
  if (!halves.separable()) {
    throw std::invalid_argument(
        fmt::format("constraints need H = T(p) + V(q); the term {} depends on coordinates and momenta: state the "
                    "problem by its Lagrangian",
                    halves.mixed));
  }
  if (!composition.is_of_verlet_steps()) {
    throw std::invalid_argument(fmt::format(
        "composition = \"{}\" is made of exact flows of T(p), which constraints do not leave exact: use one "
        "of Verlet steps, {}",
        composition.name, fmt::join(compositions_of_verlet_steps(), ", ")));
  }
  check_constraints(hamiltonian.constraints(), hamiltonian.q_names(), z_0.first(z_0.size() / 2));
  auto scheme = std::make_unique<ConstrainedSplitting>(own, halves, composition, z_0);
  scheme->check_start(hamiltonian.p_names());
  return scheme;
}

}  // namespace rubato
