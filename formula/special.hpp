#pragma once

#include <span>

#include <rubato/formula/bytecode.hpp>

/// The error function, Bessel's functions and Jacobi's elliptic functions: values, and their Taylor coefficients.
namespace rubato::formula {

/// Bessel's functions J_n, Y_n, and the modified I_n, K_n, of integer order n. Y_n is defined for x > 0, and so is K_n;
/// elsewhere they are NaN or infinite.
///@{
[[nodiscard]] double bessel_j(double n, double x);
[[nodiscard]] double bessel_y(double n, double x);
[[nodiscard]] double bessel_i(double n, double x);
[[nodiscard]] double bessel_k(double n, double x);
///@}
/// Whether n is an integer that these functions take.
[[nodiscard]] bool is_bessel_order(double n);

/// sn, cn and dn of the argument u and the parameter m = k², 0 <= m <= 1, by descending Landen transformations
/// (R. Bulirsch, Numerical calculation of elliptic integrals and elliptic functions, Numer. Math. 7 (1965), sncndn).
struct Jacobi {
  double sn, cn, dn;
};
[[nodiscard]] Jacobi jacobi(double u, double m);
/// am(u, m), the angle whose sine is sn: grows by π over 2 K(m).
[[nodiscard]] double amplitude(double u, double m);

/// Complete elliptic integrals K(m) and E(m) of the parameter m = k²; NaN outside 0 <= m <= 1, and K(1) is infinite.
///@{
[[nodiscard]] double elliptic_k(double m);
[[nodiscard]] double elliptic_e(double m);
///@}

/// f^(k)(x)/k! for k = 0, 1, … as many as there is room for, of one of these functions; `parameter` is n or m.
/// Where f is not defined they are not finite.
void scaled_derivatives(OpCode function, double parameter, double x, std::span<double> coefficients);

}  // namespace rubato::formula
