#pragma once

#include <Eigen/Core>

namespace rubato {

/// The orbit y(τ; t) through time t, τ ∈ [-½, ½], as a power series in t whose coefficients y_d are polynomials in τ of
/// degree d, known by their values at nodes. With w = ½(ẑ + z) + ½JF(ẑ - z) held fixed,
///
///     y(τ; t) = w + t ∫^τ f(y) - ½JF(ẑ - z),   ẑ - z = t ∫_{-½}^{½} f(y),   ∫^τ P_l(2τ) = (P_{l+1} -
///     P_{l-1})(2τ)/(2(2l+1))
///
/// with the Legendre polynomials P_l and P_{-1} = 0: these antiderivatives have opposite values at ±½ for l = 0 and
/// vanish there for all others, so that the mean of the ends is w as it must be. The nodes are Gauss', with which all
/// of this is exact for f(y)_d of degree up to 2m - 1 (with m nodes in 0 < τ < ½) if y_d(-τ) = (-1)^d y_d(τ), as it is
/// for F = 0, and m - 1 with m nodes in -½ < τ < ½ otherwise.
struct GeneratingNodes {
  /// \param parity whether y_d(-τ) = (-1)^d y_d(τ)
  /// \param terms the series of f(y) stops at t^(terms-1)
  GeneratingNodes(int terms, bool parity);

  int count;
  bool parity;
  Eigen::VectorXd tau;                 ///< increasing
  Eigen::MatrixXd transform;           ///< (l, j): contribution of a value at node j to the coefficient of P_l(2τ)
  Eigen::MatrixXd antiderivative[2];   ///< for even d and odd d: values of ∫^τ f(y)_d from those of f(y)_d
  Eigen::VectorXd integral;            ///< ∫_{-½}^{½} f(y)_d = integral·values (0 for odd d, with parity)
  Eigen::VectorXd centre_value;        ///< f(y)_d at τ = 0, for any d (0 for odd d, with parity)
  Eigen::VectorXd centre_integral[2];  ///< ∫^0 f(y)_d, for even d (0, with parity) and odd d

  /// ∫_{½}^{½+ratio} P_l(2τ) dτ for all l that are represented.
  [[nodiscard]] Eigen::VectorXd integrals_beyond(double ratio) const;
};

}  // namespace rubato
