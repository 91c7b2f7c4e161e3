#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

#include <rubato/grids/grid.hpp>
#include <rubato/pde/lattice_method.hpp>
#include <rubato/pde/step_equation.hpp>

namespace rubato {

/// Layers at ends of axes in which fields are damped (theory, section 11.2), z_t = -σz beside the equation, by
///
///     σ(x) = Σ_a strength_a/(1 + exp(1/s_a - 1/(1 - s_a))),
///
/// s_a from 0 at the inner edge of a layer to 1 at the end of the range: smooth everywhere. A run with it is not
/// Hamiltonian.
class Sponge {
public:
  struct Layer {
    int axis = 0;
    double from = 0.0, to = 0.0;  ///< the range of the axis
    double width = 0.0;           ///< of the layer at each end
    double strength = 0.0;        ///< a rate
    bool at_left = true, at_right = true;
  };
  explicit Sponge(std::vector<Layer> layers) : layers_(std::move(layers)) {}

  /// σ at the nodes of a grid.
  [[nodiscard]] std::vector<double> rates(const grids::Grid& grid) const;

private:
  std::vector<Layer> layers_;
};

/// The damping of levels: fields with an equation of motion times exp(-time σ), but for what walls hold, the others by
/// LatticeMethod::constrained_fields(). A step of length h with a sponge, in either direction of time:
///
///     z_{k+1} = D ψ_h(D z_k),   D = exp(-½|h|σ)
class SpongeDamping {
public:
  /// \param method the one of ψ_h
  SpongeDamping(const LatticeMethod& method, const MultisymplecticSystem& system, const grids::Grid& grid,
                const Sponge& sponge);

  /// \param time a negative one takes the damping back
  /// \throws std::invalid_argument if the constraints have no solution
  void operator()(const LatticeLevel& level, double time, LatticeLevel& damped);

private:
  /// exp(-time σ) where σ is not 0.
  struct Factors {
    double time = 0.0;
    std::vector<double> values;
  };
  [[nodiscard]] const std::vector<double>& factors(double time);

  std::unique_ptr<ConstrainedFields> constrained_;
  std::vector<int> damped_, at_midpoints_;         ///< fields
  std::vector<std::size_t> nodes_;                 ///< where σ is not 0
  std::vector<double> rates_;                      ///< there
  std::vector<std::pair<int, std::size_t>> held_;  ///< of the damped fields, by walls
  std::array<Factors, 2> factors_;  ///< of the last time that is not negative, and of the last negative one
};

/// A scheme that counts what damping takes.
class LosesEnergy {
public:
  virtual ~LosesEnergy() = default;
  /// The energy that all substeps of damping have taken so far.
  [[nodiscard]] virtual double energy_lost() const = 0;
};

/// What the damping takes from the energy in one step, by its two levels alone.
class SpongeLoss {
public:
  /// \param method the one of ψ_h \param first any level
  SpongeLoss(const LatticeMethod& method, const MultisymplecticSystem& system, const grids::Grid& grid,
             const Sponge& sponge, const LatticeLevel& first)
      : system_(system),
        damping_(method, system_, grid, sponge),
        equation_(method.equation(system_, grid, first, 0.0)),
        damped_(first) {}

  [[nodiscard]] double of_step(const LatticeLevel& before, const LatticeLevel& after, double h);

private:
  MultisymplecticSystem system_;
  SpongeDamping damping_;
  std::unique_ptr<StepEquation> equation_;
  LatticeLevel damped_;
};

/// A method with a sponge; `method` itself without one. Its scheme is LosesEnergy. E_k is the discrete energy of ψ_h
/// with what was lost before ψ_h, and the node energy is H(z_k) with what was lost so far: these are what variable
/// levels keep. Local laws and the equation of a step are those of ψ_h, from D z_k to D⁻¹ z_{k+1}; the equation's
/// energies have nothing of what earlier steps lost. Hypothesis: no field is a potential.
[[nodiscard]] std::unique_ptr<LatticeMethod> with_sponge(std::unique_ptr<LatticeMethod> method,
                                                         std::shared_ptr<const Sponge> sponge);

}  // namespace rubato
