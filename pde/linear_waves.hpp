#pragma once

#include <complex>
#include <cstddef>
#include <span>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <rubato/grids/fourier.hpp>
#include <rubato/pde/cell_sweep.hpp>
#include <rubato/pde/multisymplectic_system.hpp>
#include <rubato/pde/wave_rows.hpp>

namespace rubato {

/// What a user can do where a splitting refuses.
inline constexpr const char* splitting_remedy = "; take lagrangian = \"fourier\" with stages";

/// The linear part M z_t + Σ_a K_a ∂_a z = Lz of a system on every wave, L = hessian_of_waves(): with x the
/// fields that have an equation of motion, and y the others,
///
///     x_t = A x,      ŷ = C x̂,      X_1 = ½ x̂ᴴ G x̂,      A = M⁻¹G.
///
/// A linear term of S goes with it where it moves fields that the waves leave alone.
class LinearWaves {
public:
  /// \param fourier has to outlive this
  /// \throws SchemeRefusal where the linear part cannot be solved for the fields without an equation of motion
  LinearWaves(const MultisymplecticSystem& system, const grids::Grid& grid, Collocation collocation,
              const grids::Fourier& fourier);
  LinearWaves(const LinearWaves&) = delete;
  LinearWaves& operator=(const LinearWaves&) = delete;

  [[nodiscard]] std::size_t count() const { return fourier_.modes(); }  ///< of waves
  [[nodiscard]] int size() const { return static_cast<int>(evolving_.size()); }
  /// Fields with an equation of motion, and without.
  ///@{
  [[nodiscard]] const std::vector<int>& evolving() const { return evolving_; }
  [[nodiscard]] const std::vector<int>& others() const { return others_; }
  ///@}
  /// M⁻¹ of the evolving fields.
  [[nodiscard]] const Eigen::MatrixXd& inverse_M() const { return inverse_M_; }
  [[nodiscard]] const Eigen::MatrixXd& L() const { return L_; }
  /// G, row·size + column.
  [[nodiscard]] const WaveRows& energy_form() const { return energy_form_; }
  /// A_row,column on a wave.
  [[nodiscard]] std::complex<double> generator(int row, int column, std::size_t wave) const;
  /// True if A has a diagonal entry for this field on some wave.
  [[nodiscard]] bool has_diagonal(int place) const { return largest_generator_(place, place) > 0.0; }
  /// C, row·size + column.
  [[nodiscard]] const WaveRows& slaves() const { return slaves_; }
  /// Places of evolving fields that A couples.
  [[nodiscard]] const std::vector<std::vector<int>>& groups() const { return groups_; }
  /// True if A is real, and its groups have two fields at most.
  [[nodiscard]] bool has_real_pairs() const { return real_pairs_; }
  /// Rows and columns, row ≤ column, of the entries of G, where it is real on every wave; empty where it is not.
  [[nodiscard]] const std::vector<std::pair<int, int>>& real_forms() const { return real_forms_; }
  /// See parseval_weights().
  [[nodiscard]] const std::vector<double>& parseval() const { return parseval_; }
  /// True if the first wave here is the one that is constant in space.
  [[nodiscard]] bool has_mean() const { return has_mean_; }
  /// Of S in the fields that it moves linearly, with the waves; 0 for the others.
  [[nodiscard]] const std::vector<double>& slope() const { return slope_; }
  /// Of evolving fields, M⁻¹ slope: their rate beside that of the waves.
  [[nodiscard]] const std::vector<double>& translation() const { return translation_; }

  /// out = matrix·in, over the coupled pairs.
  void multiply(const WaveRows& matrix, const WaveRows& in, WaveRows& out) const;
  /// out = A·in.
  void rates(const WaveRows& in, WaveRows& out) const;
  /// X_1.
  [[nodiscard]] double energy(const WaveRows& rows) const;
  [[nodiscard]] double sum_over_ranks(double here) const;

private:
  void split_fields();
  void find_translation();
  void reduce();
  void group();
  void find_real_forms();
  [[nodiscard]] Eigen::MatrixXcd derivatives_on_wave(std::size_t wave) const;
  [[nodiscard]] double largest(std::span<const double> values) const;

  MultisymplecticSystem system_;
  grids::Grid grid_;
  Collocation collocation_;
  const grids::Fourier& fourier_;
  bool has_mean_;
  std::vector<int> evolving_, others_;
  Eigen::MatrixXd inverse_M_, L_;
  WaveRows energy_form_, slaves_;      ///< see energy_form() and slaves()
  Eigen::MatrixXd largest_generator_;  ///< max |Re A|, |Im A| over all waves
  std::vector<std::vector<int>> groups_;
  std::vector<std::pair<int, int>> coupled_;  ///< pairs of places in one group
  bool real_pairs_ = false;
  std::vector<std::pair<int, int>> forms_, real_forms_;  ///< entries of G that are not zero
  std::vector<double> parseval_, slope_, translation_;
};

}  // namespace rubato
