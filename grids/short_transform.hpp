#pragma once

#include <array>
#include <complex>
#include <cstddef>
#include <vector>

namespace rubato::grids {

/// Whether n has no prime factor beyond 7: transforms of lengths that have larger ones take longer.
[[nodiscard]] bool has_small_factors(std::size_t n);

/// The transforms of Fourier for one short line, real and imaginary parts of its waves apart: û(k) = Σ_j u_j e^{-2πi
/// jk/n}, k = 0 … n/2, and back with the factor 1/n.
///
/// With n = 8L, j = 8a + b and k = c + Ld (Cooley and Tukey, Math. Comp. 19, 1965)
///
///     û(c + Ld) = Σ_b e^{-2πi bd/8} e^{-2πi bc/n} Σ_a e^{-2πi ac/L} u_{8a+b}:
///
/// eight real transforms of length L, one in each lane of a vector, then transforms of length 8, eight c in a vector.
/// There is no plan to be chosen by measurement, so that results are the same in every run. In vectors of 64 bytes, and
/// for processors that have them alone: others take FFTW's transforms.
class ShortTransform {
public:
  static constexpr std::size_t lanes = 8, least_nodes = 56, most_nodes = 1024;

  /// Whether there is one on some processor: n = 8L from 56 to 1024 without prime factors beyond 7.
  [[nodiscard]] static bool is_made_for(std::size_t n);
  /// Whether there is one: on a processor with AVX-512.
  [[nodiscard]] static bool serves(std::size_t n);
  /// For an n that is served.
  explicit ShortTransform(std::size_t n);

  [[nodiscard]] std::size_t nodes() const { return static_cast<std::size_t>(tables_.n); }

  /// From n values to n/2 + 1 waves.
  void forward(const double* values, double* re, double* im) const;
  /// From waves to values; the imaginary parts of the waves 0 and n/2 count as 0.
  void inverse(const double* re, const double* im, double* values) const;

  /// One radix of a transform within lanes: m groups of factors e^{-2πi jq/(radix·m)}, `stride` apart.
  struct Pass {
    int radix = 0, m = 0, stride = 0;
    std::size_t factors = 0;  ///< where they begin
  };
  struct Tables {
    int n = 0, L = 0;
    int length = 0;  ///< of complex transforms within lanes: L/2, or L where that is odd
    int rows = 0;    ///< c that are transformed over lanes: those below L/2
    std::vector<Pass> passes;
    std::vector<std::complex<double>> factors;  ///< of passes
    std::vector<std::complex<double>> of_row;   ///< e^{-2πi c/L}
    std::vector<double> forward, inverse;       ///< e^{∓2πi bc/n}: for each c eight real parts, then imaginary ones
    /// e^{-2πi b(2d+1)/16}, of c = L/2: real parts of d < 4, then imaginary ones, for each b; and for each b the other
    /// way round.
    std::array<std::array<double, 8>, 8> middle{}, middle_by_d{};
  };

private:
  Tables tables_;
};

namespace short_transform {
void forward_avx512(const ShortTransform::Tables& tables, const double* values, double* re, double* im);
void inverse_avx512(const ShortTransform::Tables& tables, const double* re, const double* im, double* values);
}  // namespace short_transform

}  // namespace rubato::grids
