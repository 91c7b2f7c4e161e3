#pragma once

#include <cmath>
#include <limits>
#include <span>
#include <string_view>
#include <vector>

namespace rubato {

/// A composition of the exact flows of T(p) and V(q), symmetric in time: drifts q += a h ∇T(p) and kicks p -= b h
/// ∇V(q), in turn. Their coefficients each sum to 1.
struct Composition {
  struct Part {
    bool drift = true;
    double length = 0.0;  ///< a or b
  };

  std::string_view name;
  int order = 2;
  std::string_view source;  ///< of the coefficients
  std::vector<Part> parts;
  /// -24 η of the node law E - H = (s+1) h^s η, in units of fᵀH_zz f (theory, section 8); NaN where η is no multiple of
  /// that.
  double gamma = std::numeric_limits<double>::quiet_NaN();
  /// Of Nyström's kind: of its order where kicks commute with what they make of drifts, [V, [V, [V, T]]] = 0, so for T
  /// of degree two in p; of lower order elsewhere.
  bool of_quadratic_kinetic_energy = false;

  /// The larger of Σ|a_i| and Σ|b_i|: how much more than that of H the terms of the discrete energy come to.
  [[nodiscard]] double magnitude() const;
  [[nodiscard]] bool has_node_law() const { return !std::isnan(gamma); }
  /// True if it is made of Verlet steps: each kick is half the sum of the drifts beside it. Such a composition keeps
  /// its order where a drift is of order 2, as it is with constraints.
  [[nodiscard]] bool is_of_verlet_steps() const;
};

/// By name:
///
// clang-format off
/// | name              | order | kicks | source                                                                           |
/// |-------------------|-------|-------|----------------------------------------------------------------------------------|
/// | golden            | 2     | 2     | theory, section 8.2: drifts a, 1 - 2a, a with a = (3 - √5)/4, kicks ½             |
/// | verlet            | 2     | 1     | kick ½, drift 1, kick ½: Störmer, Verlet; the discrete Lagrangian of Kane et al.  |
/// | suzuki-4          | 4     | 5     | five Verlet steps (Suzuki 1990)                                                   |
/// | blanes-moan-4     | 4     | 6     | Blanes and Moan, J. Comput. Appl. Math. 142 (2002), S₆ of order 4                 |
/// | kahan-li-6        | 6     | 9     | Kahan and Li, Math. Comp. 66 (1997), s9odr6a: nine Verlet steps                   |
/// | kahan-li-8        | 8     | 17    | the same, s17odr8a: seventeen Verlet steps                                        |
/// | blanes-moan-rkn-6 | 6     | 14    | Blanes and Moan, as above, SRKN₁₄ᵃ of order 6: of Nyström's kind                  |
// clang-format on
///
/// \throws std::invalid_argument for another name, with the list
[[nodiscard]] const Composition& composition(std::string_view name);
[[nodiscard]] std::span<const Composition> compositions();
/// The one to be taken where only the order is asked for: golden, blanes-moan-4, kahan-li-6 or kahan-li-8. \throws
/// std::invalid_argument for an order that none has, with those there are
[[nodiscard]] const Composition& composition_of_order(int order);

/// The names of those that is_of_verlet_steps(), in their order.
[[nodiscard]] std::vector<std::string_view> compositions_of_verlet_steps();

}  // namespace rubato
