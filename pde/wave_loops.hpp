#pragma once

#include <complex>
#include <cstddef>

/// \file
/// Loops over waves, whose numbers have real and imaginary parts apart; outputs overlap no inputs. In vectors, and the
/// same bit by bit for every width of them.

namespace rubato {

/// out += value·in.
void add(std::complex<double> value, const double* re, const double* im, std::size_t count, double* out_re,
         double* out_im);
/// out += x·y.
void add_product(const double* x_re, const double* x_im, const double* y_re, const double* y_im, std::size_t count,
                 double* out_re, double* out_im);
/// re + i im = (re + i im)·x + a + i b.
void horner(std::complex<double> x, const double* a, const double* b, std::size_t count, double* re, double* im);
/// re + i im = (re + i im)·(a + i b).
void multiply(const double* a, const double* b, std::size_t count, double* re, double* im);
/// re + i im = 1/(re + i im).
void invert(std::size_t count, double* re, double* im);
/// out += ½ Re(conj(l) g r).
void add_form(const double* g_re, const double* g_im, const double* l_re, const double* l_im, const double* r_re,
              const double* r_im, std::size_t count, double* out);
/// Σ weights·values.
[[nodiscard]] double weighted_sum(const double* weights, const double* values, std::size_t count);

}  // namespace rubato
