#pragma once

#include <cstddef>
#include <string>

/// \file
/// Codes by hand for large periodic lattices, as many nodes and one length in each direction: compiled as one would for
/// speed alone. Each begins with u = ½ Π cos(2πx_a/L) (of ψ the real part), takes so many steps and tells the seconds
/// of one.

namespace peers {

struct Torus {
  int dimensions = 3;
  std::size_t nodes = 0;  ///< in each direction
  double length = 1.0;
  [[nodiscard]] std::size_t size() const { return dimensions == 3 ? nodes * nodes * nodes : nodes * nodes; }
};

struct Pace {
  double cpu = 0.0, wall = 0.0;  ///< seconds a step
  double energy_change = 0.0;    ///< of the energy between the first step and the last one, relative
};

/// u_tt = Δu - u - u³.
///@{
/// The leapfrog with its energy at each level, in one pass over two arrays.
[[nodiscard]] Pace leapfrog(const Torus& torus, double h, int steps, int threads = 1);
/// A composition of the drift u_t = v and the kick v_t = Δu - u - u³ with differences, a drift and the kick before it
/// in one pass, with its energy at each level.
[[nodiscard]] Pace drifts_and_kicks(const Torus& torus, const std::string& composition, double h, int steps);
/// A composition of exact waves (of differences or spectral) and kicks v_t = -u³, with FFTW, without energy.
[[nodiscard]] Pace waves_and_kicks(const Torus& torus, const std::string& composition, bool differences, double h,
                                   int steps);
///@}

/// i ψ_t + Δψ - |ψ|²ψ = 0 by a composition of the free flow and turns at the nodes, with FFTW, without energy.
[[nodiscard]] Pace split_step(const Torus& torus, const std::string& composition, double h, int steps);

/// Bytes a second of a(i) = b(i) + s c(i) on arrays far beyond the caches, 24 bytes a cell (STREAM's triad).
[[nodiscard]] double triad_bandwidth(int threads);

}  // namespace peers
