#pragma once

#include <compare>
#include <cstddef>
#include <map>
#include <optional>
#include <vector>

#include <rubato/pde/multisymplectic_form.hpp>

namespace rubato {

/// A field or a derivative of one.
struct Jet {
  std::size_t field = 0;
  DerivativeOrder order = {};
  auto operator<=>(const Jet&) const = default;
};
using JetMonomial = std::vector<Jet>;  ///< ascending, with repetitions
using JetPolynomial = std::map<JetMonomial, double>;

/// How often it is differentiated.
[[nodiscard]] int total(const Jet& jet);
[[nodiscard]] Jet shifted(Jet jet, std::size_t mu, int by = 1);
void add(JetPolynomial& sum, JetMonomial monomial, double coefficient);
void add(JetPolynomial& sum, const JetPolynomial& other, double factor);

/// D_mu of a polynomial.
[[nodiscard]] JetPolynomial differentiated(const JetPolynomial& polynomial, std::size_t mu);

/// δL/δu of a field: Σ_J (-D)^J ∂L/∂u_J.
[[nodiscard]] JetPolynomial euler_operator(const JetPolynomial& L, std::size_t field);

/// The same density with derivatives moved by parts: of two factors to both alike; of more, one that occurs once is
/// taken off where it is the highest.
[[nodiscard]] JetPolynomial reduced(const JetPolynomial& L);

/// The same density with derivatives by x moved by parts to a field that stands undifferentiated in products of three
/// and more, u φ u_x = -u² φ_x/2 + D_x(…), if it can be named by its derivatives alone; otherwise as it is.
[[nodiscard]] JetPolynomial with_derivatives_of(const JetPolynomial& L, std::size_t field);

/// G with D_x G = polynomial, if there is one.
[[nodiscard]] std::optional<JetPolynomial> integrated_by_x(JetPolynomial polynomial);

/// The same polynomial of the potential of a field, u = φ_x.
[[nodiscard]] JetPolynomial of_potential(const JetPolynomial& polynomial, std::size_t field);

}  // namespace rubato
