#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace audit {

/// Nodes on [0, 1], and the integrals of their Lagrange polynomials: a_ij from 0 to c_i, b_j from 0 to 1.
struct Quadrature {
  explicit Quadrature(std::vector<long double> nodes);

  std::vector<long double> c, b;
  std::vector<std::vector<long double>> a;

  /// ℓ_j(x) and ℓ_j'(x) of the nodes.
  [[nodiscard]] long double value(std::size_t j, long double x) const;
  [[nodiscard]] long double rate(std::size_t j, long double x) const;
};

/// The zeros of Legendre's polynomial of degree m; both ends and the zeros of the derivative of that of degree m - 1.
Quadrature gauss_quadrature(std::size_t m);
Quadrature lobatto_quadrature(std::size_t m);

/// One part of a composition of two flows, drifts and kicks by turns.
struct CompositionPart {
  bool drift;
  long double length;
};
/// By the name that problem files have for it.
std::vector<CompositionPart> composition_parts(const std::string& name);
int composition_order(const std::string& name);

/// Gaussian elimination; the right-hand side is the last column.
std::vector<long double> solved(std::vector<std::vector<long double>> rows);
/// Σ_j |A⁻¹|_ij errors_j
std::vector<long double> amplified(const std::vector<std::vector<long double>>& rows,
                                   const std::vector<long double>& errors);

}  // namespace audit
