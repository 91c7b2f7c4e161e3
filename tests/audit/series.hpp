#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "audit/bounded.hpp"

namespace audit {

/// The monomials in `variables` variables up to a total degree, and which two of them multiply to a third.
struct Shape {
  using Exponents = std::array<std::uint8_t, 16>;  ///< as many as there are variables, then zeros
  struct Product {
    std::uint32_t left, right, result;
  };

  Shape(std::size_t variables, std::size_t degree);

  std::size_t variables, degree;
  std::vector<Exponents> monomials;  ///< by degree; first 1, then each variable
  std::vector<Product> products;     ///< those that stay within the degree
  /// For each variable and monomial the number of the monomial times the variable; their count where it passes the
  /// degree.
  std::vector<std::vector<std::size_t>> raised;

  /// The number of x_variable^power.
  [[nodiscard]] std::size_t index(std::size_t variable, std::size_t power) const;
  /// Built once.
  static const Shape& of(std::size_t variables, std::size_t degree);
};

/// A polynomial truncated at the degree of its shape: the Taylor expansion of some function about a point. Degree 1 is
/// a gradient, degree 2 a Hessian as well.
class Series {
public:
  Series() = default;
  Series(const Shape& shape, const Bounded& constant) : shape_(&shape), coefficients_(shape.monomials.size()) {
    coefficients_[0] = constant;
  }
  /// constant + x_variable
  Series(const Shape& shape, const Bounded& constant, std::size_t variable) : Series(shape, constant) {
    coefficients_[1 + variable] = 1.0L;
  }

  [[nodiscard]] const Shape& shape() const { return *shape_; }
  [[nodiscard]] const Bounded& operator[](std::size_t i) const { return coefficients_[i]; }
  [[nodiscard]] Bounded& operator[](std::size_t i) { return coefficients_[i]; }
  [[nodiscard]] const Bounded& constant() const { return coefficients_[0]; }
  [[nodiscard]] const Bounded& derivative(std::size_t variable) const { return coefficients_[1 + variable]; }
  [[nodiscard]] const Bounded& coefficient(std::size_t variable, std::size_t power) const {
    return coefficients_[shape_->index(variable, power)];
  }

  Series& operator+=(const Series& other);
  Series operator-() const;
  friend Series operator+(Series a, const Series& b) { return a += b; }
  friend Series operator-(const Series& a, const Series& b) { return a + (-b); }
  friend Series operator*(const Series& a, const Series& b);
  friend Series operator/(const Series& a, const Series& b);
  friend Series operator*(const Bounded& factor, Series a);

  /// ∂/∂x_variable, and the antiderivative by x_variable that vanishes with it. What passes the degree is lost.
  [[nodiscard]] Series differentiated(std::size_t variable) const;
  [[nodiscard]] Series integrated(std::size_t variable) const;
  /// Σ_k outer[k] (this - constant)^k
  [[nodiscard]] Series composed(std::span<const Bounded> outer) const;

private:
  const Shape* shape_ = nullptr;
  std::vector<Bounded> coefficients_;
};

Series sin(const Series& x);
Series cos(const Series& x);
Series exp(const Series& x);
Series log(const Series& x);
Series power(const Series& x, long double exponent);

}  // namespace audit
