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
/// The same with a real value.
void add(double value, const double* re, const double* im, std::size_t count, double* out_re, double* out_im);
/// out += value·ik·in.
void add_derivative(double value, const double* k, const double* re, const double* im, std::size_t count,
                    double* out_re, double* out_im);
/// A real matrix (1 + mend)(a b; c d) for each wave, of determinant 1. d may be a.
struct PairMatrices {
  double *a, *b, *c, *d, *mend;
};
/// Writes `mend` of matrices that turn (ad ≥ 0 ≥ bc), 0 of others. What a rounded matrix misses of its determinant
/// would make a wave grow by as much in every step.
void mend_turns(std::size_t count, const PairMatrices& matrices);
/// Writes a = cos(ωτ), b = up·sin(ωτ), c = down·sin(ωτ), with τ for the sine where ω = 0, and `mend` with d = a.
void make_turns(double tau, const double* frequencies, const double* cosines, const double* sines, const double* up,
                const double* down, std::size_t count, const PairMatrices& matrices);
/// out = value·in.
void multiply(double value, const double* in, std::size_t count, double* out);
/// Two rows of waves.
struct RowPair {
  double *x_re, *x_im, *y_re, *y_im;
};
/// What is done with a pair of rows before it is turned, in the same pass.
struct BeforeTurn {
  double kick = 0.0;                              ///< y += kick·(re + i im)
  const double *re = nullptr, *im = nullptr;      ///< none: no kick
  const double *of_x = nullptr, *of_y = nullptr;  ///< factors of |x|² and |y|² in the sum; none: no sum
  const double* weights = nullptr;                ///< of both
};
/// (x, y) = (1 + mend)(a x + b y, c x + d y). The first 12 bits of the entries are taken apart, so that products with
/// them err at random only. \return Σ weight (of_x |x|² + of_y |y|²) after the kick and before the turn
double turn_pair(const PairMatrices& matrices, const BeforeTurn& before, std::size_t count, const RowPair& rows);
/// out += x·y.
void add_product(const double* x_re, const double* x_im, const double* y_re, const double* y_im, std::size_t count,
                 double* out_re, double* out_im);
/// out += Σ x_j·y_j, j < terms, whose arrays are `stride` from one to the next.
void add_products(int terms, std::size_t stride, const double* x_re, const double* x_im, const double* y_re,
                  const double* y_im, std::size_t count, double* out_re, double* out_im);
/// out = value.
void fill(double value, std::size_t count, double* out);
/// out += value·Re(conj(l) r).
void add_dot(double value, const double* l_re, const double* l_im, const double* r_re, const double* r_im,
             std::size_t count, double* out);
/// out += value·k·Im(conj(l) r).
void add_cross(double value, const double* k, const double* l_re, const double* l_im, const double* r_re,
               const double* r_im, std::size_t count, double* out);
/// re + i im = (re + i im)·x + a + i b.
void horner(std::complex<double> x, const double* a, const double* b, std::size_t count, double* re, double* im);
/// re + i im = (re + i im)·(a + i b).
void multiply(const double* a, const double* b, std::size_t count, double* re, double* im);
/// re + i im = 1/(re + i im).
void invert(std::size_t count, double* re, double* im);
/// out += ½ Re(conj(l) g r).
void add_form(const double* g_re, const double* g_im, const double* l_re, const double* l_im, const double* r_re,
              const double* r_im, std::size_t count, double* out);
/// Σ weight g Re(conj(l) r), g real.
[[nodiscard]] double sum_form(const double* weights, const double* g, const double* l_re, const double* l_im,
                              const double* r_re, const double* r_im, std::size_t count);
/// Pairs (re, im) one after the other, and back.
///@{
void interleave(const double* re, const double* im, std::size_t count, double* pairs);
void separate(const double* pairs, std::size_t count, double* re, double* im);
///@}
/// Σ weights·values.
[[nodiscard]] double weighted_sum(const double* weights, const double* values, std::size_t count);

}  // namespace rubato
