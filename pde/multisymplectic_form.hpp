#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <rubato/formula/expression.hpp>

namespace rubato {

/// A derivative of a field: how many times by t, x, y and z.
using DerivativeOrder = std::array<int, 4>;

/// A Lagrangian density L of fields, their derivatives, x, y, z and t.
struct FieldDensity {
  /// A variable of L that stands for a derivative of a field.
  struct Derivative {
    std::size_t field = 0;
    DerivativeOrder order = {};
    formula::Expression variable;
  };

  std::shared_ptr<formula::Graph> graph;
  std::vector<std::string> fields;      ///< variables of the graph have their names
  std::vector<Derivative> derivatives;  ///< all that L has
  int dimensions = 1;                   ///< of space
  formula::Expression L;
  /// A field that is ∂_x of a potential, which is the field varied: its number, and that of the potential.
  struct Potential {
    std::size_t field = 0, potential = 0;
  };
  std::vector<Potential> potentials;
  /// The fields are exp(damping t/2) times those of the equations that the density was found for: of u_tt + damping
  /// u_t.
  double damping = 0.0;
};

/// M z_t + Σ_a K_a z_{x_a} = ∇S(z), as a problem file states it.
struct MultisymplecticForm {
  struct Entry {
    std::size_t row = 0, column = 0;
    double value = 0.0;  ///< the transposed entry has the opposite
  };

  std::vector<std::string> fields;          ///< those of the density first
  std::array<std::vector<Entry>, 4> terms;  ///< of M, K_x, K_y and K_z, row < column
  formula::Expression S;                    ///< of `fields`, x, y, z and t
};

/// How many times a derivative differentiates.
[[nodiscard]] int total_order(const DerivativeOrder& order);
/// The direction that it differentiates by last, 0 for t: t, if it does, else the last of x, y, z.
[[nodiscard]] std::size_t last_direction(const DerivativeOrder& order);
/// "u_xxt" and its like: the name of a derivative.
[[nodiscard]] std::string derivative_name(std::string_view field, const DerivativeOrder& order);

/// The derivative that a name says, "u_xt": of which field, and how often by each direction. Nothing if it is none.
struct NamedDerivative {
  std::string name;
  std::size_t field = 0;
  DerivativeOrder order = {};
};
[[nodiscard]] std::optional<NamedDerivative> derivative_named(std::string_view name,
                                                              const std::vector<std::string>& fields);

/// Derives M, K and S of the Euler–Lagrange equations of L (theory, section 5), with E = ∫ Σ u_t ∂L/∂u_t - L:
///
///     L = Σ ½ A_ij d_i d_j + Σ b_i(u) d_i + c   becomes   Σ A_ij a_i d_i - ½ aᵀA a + Σ b_i(u) d_i + c
///
/// for the first derivatives d that L has as a polynomial of degree two, A constant and regular and b linear in the
/// fields: each such d gets one field a, equal to it. Any other derivative, and any that is differentiated again, gets
/// a field for itself and one for its Lagrange multiplier, λ(d - a). A field that equals a derivative has its name:
/// u_t. \throws std::invalid_argument where an added field's name is taken, and if L has a derivative beyond
/// `dimensions`
[[nodiscard]] MultisymplecticForm multisymplectic_form(const FieldDensity& density);

}  // namespace rubato
