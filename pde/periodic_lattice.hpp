#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/SparseCore>

#include <rubato/pde/lattice.hpp>
#include <rubato/pde/periodic_step.hpp>
#include <rubato/solve/damped_least_squares.hpp>
#include <rubato/solve/damped_newton.hpp>
#include <rubato/solve/sparse_factors.hpp>

namespace rubato {

/// The levels of a lattice over one period, at equal distances: the level after the last one is the first. Of a field
/// in ker M a level holds the value in the middle of the step that follows, which is all that the equations have of it.
struct PeriodOfLattice {
  std::vector<grids::FieldSet> levels;
  PotentialSlopes slopes;
  double period = 0.0;

  [[nodiscard]] std::size_t steps() const { return levels.size(); }
  [[nodiscard]] double step() const { return period / static_cast<double>(levels.size()); }
};

/// The equations of a periodic orbit of a line of cells, for a scheme with the step R (PeriodicStep):
///
///     R(x_k, y_k, x_{k+1}, h) = 0   in every cell, or at every node, of every step,
///     z_N = z_0,   N h = T,
///     T = T*                                             if the period T* is given,
///     Σ E_k / N = E*                                     if the energy E* is given,
///
/// in the unknowns x_k (the fields that have an equation of motion), y_k (those in ker M, in the middle of steps) and
/// T. Translations in time and space leave a null space, and so does a period that is not given: see
/// solve::find_zero().
///
/// Linearised, a step is a map from δx_k and δT to δx_{k+1} and δy_k. Their composition leaves a dense system in δx_0
/// and δT, of which the solution of least norm is taken; the other levels follow.
///
/// Unknowns are scaled by the largest value of each field on the guess, rows by the size of their terms there.
class PeriodicLattice final : public solve::Equations {
public:
  struct Targets {
    std::optional<double> period, energy;
  };
  /// \param step of the same system and grid; guess for the scales. The system has to live as long as this.
  /// \throws std::invalid_argument for a guess without levels, for a field that S does not name, and where ker M has a
  /// combination of fields that is none of them
  PeriodicLattice(const MultisymplecticSystem& system, const grids::Grid& grid, std::unique_ptr<PeriodicStep> step,
                  Targets targets, const PeriodOfLattice& guess);

  [[nodiscard]] Eigen::VectorXd pack(const PeriodOfLattice& orbit) const;
  [[nodiscard]] PeriodOfLattice unpack(const Eigen::VectorXd& u) const;

  Status evaluate(const Eigen::VectorXd& u, Eigen::VectorXd& residual, bool with_derivatives) override;
  Status factor(double damping) override;
  Status solve(const Eigen::VectorXd& r, Eigen::VectorXd& x) override;
  [[nodiscard]] std::string describe(Eigen::Index row) const override;
  [[nodiscard]] std::string describe_failure() const override;
  /// E_k of the steps that were evaluated last.
  [[nodiscard]] const std::vector<double>& energies() const { return energies_; }
  /// The derivatives that were kept last, as one matrix.
  [[nodiscard]] Eigen::SparseMatrix<double> jacobian() const;

private:
  using Sparse = Eigen::SparseMatrix<double>;
  /// Of scaled rows by scaled unknowns, and by T in place of h.
  struct Step : LinearisedStep {
    solve::SparseFactors factors;  ///< of `after`
  };

  [[nodiscard]] Status compose();
  void find_scales(const PeriodOfLattice& guess);
  void scale(Step& step) const;
  [[nodiscard]] Eigen::Index nodes() const { return place_.nodes(); }
  [[nodiscard]] Eigen::Index moving() const { return place_.moving(); }  ///< numbers in x_k
  [[nodiscard]] Eigen::Index level_size() const { return place_.size(); }
  [[nodiscard]] Eigen::Index period_place() const { return static_cast<Eigen::Index>(steps_.size()) * level_size(); }
  [[nodiscard]] Eigen::Index rows() const {
    return period_place() + (targets_.period ? 1 : 0) + (targets_.energy ? 1 : 0);
  }
  /// Levels from x_0 and T, `r` on the right. \return x_N, and what the mean energy changes by
  void follow(const Eigen::VectorXd& r, Eigen::VectorXd& x, Eigen::VectorXd& last, double& energy) const;

  const MultisymplecticSystem& system_;
  grids::Grid grid_;
  std::unique_ptr<PeriodicStep> step_;
  Targets targets_;
  PotentialSlopes slopes_;
  LevelPlaces place_;
  grids::FieldSet rows_of_step_;
  Eigen::VectorXd scales_, row_scales_;  ///< of each field, and of each row
  double period_scale_, energy_scale_ = 1.0;
  std::vector<double> energies_;
  std::vector<Step> steps_;
  Eigen::MatrixXd closing_;  ///< x_N - x_0 and the targets by x_0 and T; empty where it is to be made
  solve::DampedLeastSquares closing_factors_;
  std::size_t failed_ = 0;
};

struct PeriodicLatticeOptions {
  std::optional<double> period = std::nullopt, energy = std::nullopt;  ///< absent: free
  double tolerance = 1e-12;                                            ///< of the largest scaled residual
  std::size_t most_iterations = 100;
};

/// A periodic orbit, or how far the search came.
struct PeriodicLatticeSolution {
  PeriodOfLattice orbit;
  double mean_energy = 0.0;
  solve::NewtonSearch search;
  std::vector<solve::NewtonIteration> history;

  [[nodiscard]] bool found() const { return search.status == Status::success; }
};

/// A guess by `steps` steps of an integrator at fixed levels.
/// \return as far as the scheme came, with fewer levels where it failed
[[nodiscard]] PeriodOfLattice period_by_integrating(LatticeIntegrator& lattice, std::size_t steps);

/// Newton's method on all levels and the period of a lattice at once. \throws std::invalid_argument as PeriodicLattice
[[nodiscard]] PeriodicLatticeSolution solve_periodic_lattice(const MultisymplecticSystem& system,
                                                             const grids::Grid& grid,
                                                             std::unique_ptr<PeriodicStep> step,
                                                             const PeriodOfLattice& guess,
                                                             const PeriodicLatticeOptions& options);

}  // namespace rubato
