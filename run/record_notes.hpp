#pragma once

#include <map>
#include <string>
#include <vector>

#include <rubato/record/reader.hpp>

namespace rubato {

/// What only the problem of a record reports on the numbers in it, for those who draw them.
struct RecordNotes {
  /// Fields of a lattice in the order in which one wants to see them: first those with an exact solution, then those
  /// with an equation of motion, potentials, fields that space derivatives of others give, and last those that exist in
  /// the middle of steps only. Among equals a field that S knows by its square alone, as velocities and slopes are,
  /// comes after others; then the order of the problem decides.
  std::vector<std::string> fields;
  /// Those among them that nobody stated: of [field] potentials, multipliers and derivatives by space, which are drawn
  /// where they are asked for.
  std::vector<std::string> auxiliary = {};
  /// By dataset: the size of what rounding alone leaves of a law. With ε = 2⁻⁵² and values z that carry a relative
  /// error of ε, a function f is known to
  ///
  ///     ε m(f),   m(f) = |f| + Σ_i |∂f/∂z_i| |z_i|,
  ///
  /// which is the level of H, of E and of an orbit's invariants. On a lattice differences turn an error of z into one
  /// of z/Δ_ν, and the divergence divides by Δ_μ: with |z|Λ|z| = Σ_ij |z_i Λ_ij z_j|, the residual (LocalLaws) of
  /// translation in ν is known to
  ///
  ///     ε [m(S)/Δ_ν + 2 Σ_{μ≠ν} |z|Λ₊_μ|z|/(Δ_μ Δ_ν)],   Δ_t = h,
  ///
  /// that of a linear symmetry to ε Σ_μ ½|z|Λ_μB|z|/Δ_μ, that of an affine one to ε Σ_μ |b|Λ_μ|z|/Δ_μ: the largest over
  /// cells. Totals are known to h times the sums of these over the cells, invariants to ε times the sum of the
  /// magnitudes of their densities. Of each the largest over up to 16 stored levels, evenly spread, and four times
  /// that: a few such errors come together. It is an order of magnitude and no bound.
  std::map<std::string, double> rounding;
};

/// \throws record::Error, ProblemError if the problem in the record cannot be read or does not fit its states
[[nodiscard]] RecordNotes notes_on(const record::Reader& reader);

}  // namespace rubato
