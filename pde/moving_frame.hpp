#pragma once

#include <array>
#include <optional>
#include <vector>

#include <Eigen/Core>

#include <rubato/grids/shift.hpp>
#include <rubato/pde/initial_level.hpp>
#include <rubato/pde/multisymplectic_system.hpp>

namespace rubato {

/// A frame that moves at a constant velocity c and turns with a linear symmetry B at a constant rate ω:
///
///     z(t, x) = exp(ω (t - t_0) B) z~(t, x - c (t - t_0)),
///     M z~_t + Σ_a (K_a - c_a M) z~_{x_a} = ∇(S(z~) - ½ ω z~ᵀ M B z~)
///
/// (theory, section 10). The energy of the equation in the frame is H + c·P - ωQ of the laboratory, P and Q the
/// momentum and the charge of B. A step's error vanishes on waves that rest in the frame.
struct MovingFrame {
  std::vector<double> velocity;  ///< c, one for each direction
  double rate = 0.0;             ///< ω
  Eigen::MatrixXd B = {};        ///< where the rate is not 0
  double start = 0.0;            ///< t_0: there frame and laboratory agree
  /// J_a of all fields, one vector for each direction; none where no field jumps from one period to the next.
  /// Hypothesis: B leaves fields that do alone.
  std::vector<Eigen::VectorXd> jumps = {};

  /// The equation in the frame. Hypotheses: S names no coordinate; B is a symmetry (check_symmetry()).
  /// \throws std::invalid_argument as MultisymplecticSystem, where a field is not determined in the frame
  [[nodiscard]] MultisymplecticSystem seen(const MultisymplecticSystem& laboratory) const;

  /// Where the origin of the frame is: c (t - t_0).
  [[nodiscard]] std::array<double, 3> shift(double t) const;
  /// ω (t - t_0).
  [[nodiscard]] double phase(double t) const { return rate * (t - start); }
  /// exp(ω (t - t_0) B).
  [[nodiscard]] Eigen::MatrixXd turn(double t) const;
  /// The fields at t turned into those of the laboratory, where they are.
  void turn(double t, grids::FieldSet& fields) const;
};

/// Levels of a frame as the laboratory has them at its nodes, by trigonometric interpolation. Potentials keep their
/// slopes and lose a constant; fields that exist in the middle of steps are moved as if they were at the level. Of a
/// field that jumps this is the periodic part in the laboratory, that without the ramp at its nodes.
class LaboratoryView {
public:
  LaboratoryView(MovingFrame frame, const grids::Grid& grid) : frame_(std::move(frame)), grid_(grid) {}

  /// Valid until the next call; `level` itself at the start. On the part of a slab collective.
  [[nodiscard]] const LatticeLevel& operator()(const LatticeLevel& level, double t);
  [[nodiscard]] const MovingFrame& frame() const { return frame_; }

private:
  void move_ramps(const std::array<double, 3>& by);

  MovingFrame frame_;
  grids::Grid grid_;
  std::optional<grids::Shift> shift_;
  std::optional<LatticeLevel> moved_;
};

/// Sets the velocity, the rate or both so that z_t = -Σ_a c_a z_{x_a} + ω B z holds best between two levels that are h
/// apart, by least squares over the nodes and the fields that have an equation of motion.
void fit_frame(const MultisymplecticSystem& system, const grids::Grid& grid, const LatticeLevel& before,
               const LatticeLevel& after, double h, bool fits_velocity, bool fits_rate, MovingFrame& frame);

}  // namespace rubato
