#pragma once

#include <array>
#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include <rubato/base/status.hpp>
#include <rubato/ode/hamiltonian.hpp>
#include <rubato/solve/dense_solver.hpp>
#include <rubato/variation/gauss_tableau.hpp>

namespace rubato {

/// The tangent of a step of Gauss collocation, from its stages Z_i: the same method for the linearised equation,
///
///     F_i = JH_zz(Z_i) V_i,   V_i = V_0 + h Σ a_ij F_j,   V_1 = V_0 + h Σ b_i F_i.
///
/// It preserves dp∧dq for any symmetric H_zz, since b_i a_ij + b_j a_ji = b_i b_j: stages that are not those of the
/// step make a wrong derivative, and still a symplectic one. The V_i are iterated to stagnation with the entries of
/// H_zz that do not vanish, momenta and coordinates in turn; where that does not contract, as in stiff problems, they
/// come from one dense matrix.
class StageTangent {
public:
  using Stages = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

  /// Keeps a reference to `tableau`.
  StageTangent(const Hamiltonian& hamiltonian, const GaussTableau& tableau);

  /// Replaces each of the columns V_0 by V_1. \param Z the stages, one in each column; columns beyond are not read
  [[nodiscard]] Status operator()(HamiltonianEvaluator& hamiltonian, const Stages& Z, double h,
                                  std::span<double> columns);

private:
  /// F_to += sign H_zz[entry] V_from
  struct Term {
    std::size_t to, from, entry;
    double sign;
  };
  /// With the number of places for stages known to the compiler.
  ///@{
  template <std::size_t M>
  [[nodiscard]] bool iterate(double h);
  template <std::size_t M>
  void multiply(const std::vector<Term>& terms, std::size_t first_row);
  ///@}
  [[nodiscard]] Status solve(double h);
  [[nodiscard]] std::size_t place(std::size_t row, std::size_t column, std::size_t stage) const {
    return (row * count_ + column) * lanes_ + stage;
  }

  const GaussTableau& tableau_;
  std::size_t m_, lanes_, size_, entry_count_;  ///< lanes_: places for stages, the next power of 2; others have 0
  std::array<std::vector<Term>, 2> terms_;      ///< of the rates of q, and of p
  std::vector<double> entries_;                 ///< of H_zz, each at all stages
  std::size_t count_ = 0;                       ///< of columns
  std::vector<double> start_, V_, F_;           ///< V_0, row after row; V_i and F_i, likewise, each at all stages
  std::vector<double> point_;
  std::optional<solve::DenseSolver> factors_;  ///< of the equations of all stages, where they were ever needed
};

}  // namespace rubato
