#pragma once

#include <memory>
#include <string>
#include <vector>

#include <rubato/pde/multisymplectic_form.hpp>

namespace rubato {

/// Equations E_i = 0 of fields and their derivatives, as many as fields.
struct FieldEquations {
  std::shared_ptr<formula::Graph> graph;
  std::vector<std::string> fields;                    ///< variables of the graph have their names
  std::vector<FieldDensity::Derivative> derivatives;  ///< all that the equations have
  int dimensions = 1;                                 ///< of space
  std::vector<formula::Expression> equations;
};

/// The Lagrangian density that has these as its Euler–Lagrange equations, up to an order of the equations and constant
/// factors: the inverse problem of the calculus of variations, by Vainberg's formula
///
///     L = Σ u_i ∫₀¹ E_i(λu) dλ,
///
/// with derivatives moved by parts so that none is higher than it has to be. A single field is also tried as u = φ_x,
/// with the equation as it stands (Korteweg and de Vries) or integrated by x (Boussinesq), and u_tt + a u_t by the
/// factor exp(a t) of L. Terms with derivatives have to be polynomials with constant coefficients. A term without may
/// be any function of its own field, x, y, z and t that is a sum of multiples of 1, u, and powers, sqrt, exp, log, sin,
/// cos, tan, sinh, cosh and tanh of a u + b. The density's own equations are derived again and compared, coefficient by
/// coefficient. Its sign is that with which u_t² is positive or, where there is none, squares of derivatives by x are
/// negative. \throws std::invalid_argument with the term that has no Lagrangian
[[nodiscard]] FieldDensity density_of(const FieldEquations& equations);

}  // namespace rubato
