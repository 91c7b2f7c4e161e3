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
/// with derivatives moved by parts so that none is higher than it has to be. One of the fields is also tried as u =
/// φ_x, with the equations as they stand (Korteweg and de Vries) or one of them integrated by x (Boussinesq). u_tt + a
/// u_t has the factor exp(a t) in L; the density that is given is of w = exp(at/2) u, FieldDensity::damping = a, named
/// scaled_u, with which coefficients of squares are constant. Terms with derivatives have to be polynomials with
/// constant coefficients. Terms without may be any functions of the fields, x, y, z and t that have a potential in
/// closed form, antiderivative() by one field after another, by φ where u = φ_x: a force f(x, t) adds φ f to L. The
/// density's own equations are derived again and compared, coefficient by coefficient. Its sign is that with which u_t²
/// is positive or, where there is none, squares of derivatives by x are negative. \throws std::invalid_argument with
/// the term that has no Lagrangian
[[nodiscard]] FieldDensity density_of(const FieldEquations& equations);

}  // namespace rubato
