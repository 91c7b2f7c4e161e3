#pragma once

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
};

/// By name:
///
// clang-format off
/// | name          | order | kicks | source                                                                           |
/// |---------------|-------|-------|----------------------------------------------------------------------------------|
/// | golden        | 2     | 2     | theory, section 8.2: drifts a, 1 - 2a, a with a = (3 - √5)/4, kicks ½             |
/// | verlet        | 2     | 1     | kick ½, drift 1, kick ½: Störmer, Verlet; the discrete Lagrangian of Kane et al.  |
/// | suzuki-4      | 4     | 5     | five Verlet steps (Suzuki 1990)                                                   |
/// | blanes-moan-4 | 4     | 6     | Blanes and Moan, J. Comput. Appl. Math. 142 (2002), S₆ of order 4                 |
/// | kahan-li-6    | 6     | 9     | Kahan and Li, Math. Comp. 66 (1997), s9odr6a: nine Verlet steps                   |
/// | kahan-li-8    | 8     | 17    | the same, s17odr8a: seventeen Verlet steps                                        |
// clang-format on
///
/// \throws std::invalid_argument for another name, with the list
[[nodiscard]] const Composition& composition(std::string_view name);
[[nodiscard]] std::span<const Composition> compositions();

}  // namespace rubato
