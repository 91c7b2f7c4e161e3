#pragma once

#include <memory>

#include <rubato/pde/lattice_method.hpp>

namespace rubato {

/// The level of a lattice between two levels of a run: the scheme's own step over the fraction, ψ_{θh}(z_k), of the
/// order of the scheme and continuous from step to step. It reads two levels and h alone, so that what a run shows can
/// be recomputed from its record.
class LatticeBetween {
public:
  /// `first` and `first_step` are those of the run. \throws std::invalid_argument as LatticeMethod::scheme()
  LatticeBetween(const LatticeMethod& method, const MultisymplecticSystem& system, const grids::Grid& grid,
                 const LatticeLevel& first, double first_step);

  /// The level at t + fraction·h, `level` that at t and `next` that at t + h, which level() then holds; of a field that
  /// exists at midpoints only its value at t + fraction·h/2. On failure level() is not a number.
  [[nodiscard]] Status take(const LatticeLevel& level, const LatticeLevel& next, double t, double h, double fraction);
  [[nodiscard]] const LatticeLevel& level() const { return result_; }

private:
  std::unique_ptr<LatticeScheme> scheme_;
  LatticeLevel result_;
};

}  // namespace rubato
