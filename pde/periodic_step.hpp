#pragma once

#include <memory>
#include <vector>

#include <Eigen/SparseCore>

#include <rubato/grids/field_set.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/pde/cell_sweep.hpp>
#include <rubato/pde/multisymplectic_system.hpp>
#include <rubato/variation/composition.hpp>

namespace rubato {

/// Where the values of a level are in a vector: x, the fields that have an equation of motion, node by node, and then
/// y, those in ker M, which are of the step that follows. Rows have the same places.
class LevelPlaces {
public:
  /// \throws std::invalid_argument where ker M has a combination of fields that is none of them
  LevelPlaces(const MultisymplecticSystem& system, const grids::Grid& grid);

  [[nodiscard]] Eigen::Index nodes() const { return nodes_; }
  [[nodiscard]] Eigen::Index fields() const { return static_cast<Eigen::Index>(places_.size()); }
  [[nodiscard]] Eigen::Index moving() const { return evolving_ * nodes_; }  ///< numbers in x
  [[nodiscard]] Eigen::Index size() const { return fields() * nodes_; }
  [[nodiscard]] bool in_kernel(int field) const { return places_[static_cast<std::size_t>(field)] >= evolving_; }
  [[nodiscard]] Eigen::Index operator()(int field, Eigen::Index node) const {
    const Eigen::Index which = places_[static_cast<std::size_t>(field)];
    return in_kernel(field) ? moving() + node * (fields() - evolving_) + which - evolving_ : node * evolving_ + which;
  }

private:
  Eigen::Index nodes_, evolving_ = 0;  ///< fields in x
  std::vector<Eigen::Index> places_;   ///< of each field, those in y after the others
};

/// Derivatives of a step's rows and of its discrete energy: by x_k, by x_{k+1} and y_k, and by h.
struct LinearisedStep {
  Eigen::SparseMatrix<double> before, after;
  Eigen::VectorXd by_h, energy_before, energy_after;
  double energy_by_h = 0.0;
};

/// The equations R(x_k, y_k, x_{k+1}, h) = 0 of one step of a scheme on a periodic line.
class PeriodicStep {
public:
  virtual ~PeriodicStep() = default;

  /// R, one row for each field at each node, and E_k of the step. \return false if a value is not finite
  [[nodiscard]] virtual bool evaluate(const grids::FieldSet& before, const grids::FieldSet& after, double h,
                                      const PotentialSlopes& slopes, grids::FieldSet& rows, double& energy) = 0;
  /// Derivatives of what evaluate() had last. \param scales of each field, for differences
  virtual void linearise(const Eigen::VectorXd& scales, LinearisedStep& step) = 0;
};

/// Of the box scheme and the Fourier scheme of one stage, by the formulas of S'': M A δ_t z + K D z̄ - ∇S(z̄).
/// \throws std::invalid_argument for more than one dimension, for walls, at Collocation::corners or elements
[[nodiscard]] std::unique_ptr<PeriodicStep> make_swept_step(const MultisymplecticSystem& system,
                                                            const grids::Grid& grid, Collocation collocation);
/// Of a splitting: x_{k+1} - Φ_h(x_k), and y_k less its mean over both ends. Derivatives are differences of fourth
/// order of the step, exact to about 1e-12 of their size: kicks and turns alike. \throws SchemeRefusal as WaveSplitting
[[nodiscard]] std::unique_ptr<PeriodicStep> make_split_step(const MultisymplecticSystem& system,
                                                            const grids::Grid& grid, const Composition& composition,
                                                            Collocation collocation);

}  // namespace rubato
