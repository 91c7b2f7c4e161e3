#include <rubato/solve/cyclic_residual.hpp>

#include <rubato/base/wide_vectors.hpp>

namespace rubato::solve {

namespace residuals {

RUBATO_WIDE_VECTORS void residual_of_row(const CyclicBidiagonal& a, const CyclicBorder& border, const double* rhs,
                                         const double* const* z, const double* y, int row, std::size_t begin,
                                         std::size_t count, double* out) {
  const int d = a.block;
  for (std::size_t j = 0; j < count; ++j) {
    out[j] = rhs != nullptr ? rhs[begin + j] : 0.0;
  }
  for (int c = 0; c < d; ++c) {
    const double left = a.left[row * d + c];
    const double right = a.right[row * d + c];
    if (left != 0.0 || right != 0.0) {
      const double* zc = z[c] + begin;
      for (std::size_t j = 0; j < count; ++j) {
        out[j] -= left * zc[j] + right * zc[j + 1];
      }
    }
  }
  for (const CyclicEntry& e : a.entries) {
    if (e.row == row) {
      const double* zc = z[e.column] + begin;
      const double* v = e.values + begin;
      for (std::size_t j = 0; j < count; ++j) {
        out[j] -= v[j] * (e.left * zc[j] + e.right * zc[j + 1]);
      }
    }
  }
  for (int b = 0; b < border.count; ++b) {
    const CyclicCoefficient& column = border.columns[b * d + row];
    for (std::size_t j = 0; j < count; ++j) {
      out[j] -= (column.constant + (column.values != nullptr ? column.values[begin + j] : 0.0)) * y[b];
    }
  }
}

double residual_at_seam(const CyclicBidiagonal& a, const CyclicBorder& border, const double* rhs,
                        const double* const* z, const double* y, int row) {
  const int d = a.block;
  const std::size_t i = a.cells - 1;
  double out = rhs != nullptr ? rhs[i] : 0.0;
  const std::vector<double>& left = a.closes() ? a.last_left : a.left;
  const std::vector<double>& right = a.closes() ? a.last_right : a.right;
  for (int c = 0; c < d; ++c) {
    out -= left[row * d + c] * z[c][i] + right[row * d + c] * z[c][0];
  }
  for (const CyclicEntry& e : a.entries) {
    if (e.row == row && !a.closes()) {
      out -= e.values[i] * (e.left * z[e.column][i] + e.right * z[e.column][0]);
    }
  }
  for (int b = 0; b < border.count; ++b) {
    const CyclicCoefficient& column = border.columns[b * d + row];
    out -= (column.constant + (column.values != nullptr ? column.values[i] : 0.0)) * y[b];
  }
  return out;
}

}  // namespace residuals

void cyclic_residual(const CyclicBidiagonal& matrix, const CyclicBorder& border, std::span<const double* const> rhs,
                     std::span<const double* const> z, std::span<const double> y, std::span<double* const> out) {
  residuals::for_each_residual(matrix, border, rhs.empty() ? nullptr : rhs.data(), z.data(), y.data(), true,
                               [&](std::size_t begin, std::size_t count, int row, const double* values) {
                                 std::copy_n(values, count, out[row] + begin);
                               });
}

}  // namespace rubato::solve
