#pragma once

#include <array>
#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include <rubato/figures/verdict.hpp>
#include <rubato/grids/fourier.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/grids/lines.hpp>
#include <rubato/pde/initial_level.hpp>
#include <rubato/pde/mirrors.hpp>
#include <rubato/pde/multisymplectic_system.hpp>
#include <rubato/pde/node_formula.hpp>
#include <rubato/problem/problem.hpp>

namespace rubato {

/// What a level of a lattice shows for the verdict: how full the spectrum is, whether the steps resolve its waves,
/// whether the data close on the period, and how large the wave is at the seam.
///
/// Only fields with an equation of motion are looked at, and of these not the ones that are rounding errors: a field's
/// part in the energy is bounded by e_f = Σ_g (|S''_fg| + |K_fg| k_g) |z_f| |z_g|, a number that no unit changes.
class LatticeMeter {
public:
  /// \param first the level at the start \param mirrors of a grid with walls, between which levels are; looked at is
  /// the ring on which they go on
  LatticeMeter(const Problem& problem, const MultisymplecticSystem& system, const grids::Grid& grid,
               const LatticeLevel& first, const Mirrors* mirrors);

  /// \param magnitudes of each field, the largest number that its values are sums of: a ramp that the level is without
  /// leaves its rounding there
  /// \param number of the level; the steps are compared with the waves where it is a power of two, which is enough to
  /// see waves come up \param h of the step that led to the level; 0 at the start \param before of a moving frame the
  /// level before, so that waves count by what they change: there those of a travelling wave rest
  void measure(const LatticeLevel& level, std::span<const double> magnitudes, std::size_t number, double t, double h,
               figures::Measures& measures, const LatticeLevel* before = nullptr);

private:
  /// The power of a field's waves.
  struct Spectrum {
    double sum = 0.0;    ///< over the nodes
    double power = 0.0;  ///< of all waves but the constant
    /// Of those in the last third along some axis, and of those that alternate along one. In more dimensions by the
    /// shares along each, as if these were independent.
    double last = 0.0, alternating = 0.0;
    std::vector<std::vector<double>> along;  ///< for each axis by |k|
  };
  [[nodiscard]] const grids::Grid& own_grid() const { return mirrors_ == nullptr ? grid_ : mirrors_->grid(); }
  void read_line(int field, std::span<const double> values, int axis, const grids::Line& at,
                 std::span<double> line) const;
  [[nodiscard]] Spectrum spectrum_of(int field, std::span<const double> values);
  [[nodiscard]] std::vector<double> powers_along(int axis, int field, std::span<const double> values);
  void remove_rounding(std::vector<Spectrum>& spectra, std::span<const double> magnitudes) const;
  [[nodiscard]] Eigen::MatrixXd hessian_of(const std::vector<Spectrum>& spectra) const;
  [[nodiscard]] std::vector<Spectrum> moving_part(const std::vector<Spectrum>& spectra, const LatticeLevel& level,
                                                  const LatticeLevel& before);
  void measure_turn(const std::vector<Spectrum>& spectra, const std::vector<Spectrum>& moving,
                    const Eigen::MatrixXd& hessian, const std::vector<double>& energies, double t, double h,
                    figures::Measures& measures) const;
  void measure_period(const LatticeLevel& level, const std::vector<bool>& counts, double t, bool is_start,
                      figures::Measures& measures);
  void measure_seam(const LatticeLevel& level, const std::vector<bool>& counts, double t, bool is_start,
                    figures::Measures& measures) const;

  const MultisymplecticSystem& system_;
  const Mirrors* mirrors_;
  const grids::Grid& grid_;                         ///< the ring
  std::vector<bool> moves_;                         ///< the fields with an equation of motion, at levels
  std::optional<NodeFormula> gradient_;             ///< ∇S, where S names a coordinate
  bool is_driven_ = false;                          ///< by walls
  double action_ = figures::Measures::none;         ///< Measures::action
  bool rough_ = false;                              ///< Measures::rough
  double between_nodes_ = figures::Measures::none;  ///< Measures::between_nodes
  bool freezes_alternating_ = false;  ///< the scheme's derivative of the shortest wave of an even number is 0
  bool moves_waves_exactly_ = false;
  std::array<std::optional<grids::Fourier>, 3> waves_;  ///< of a line along each axis
};

}  // namespace rubato
