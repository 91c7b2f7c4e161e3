#include <rubato/solve/fourier_preconditioner.hpp>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <stdexcept>
#include <utility>

#include <fmt/core.h>
#include <Eigen/SVD>
#include <rubato/grids/parallel.hpp>

namespace rubato::solve {
namespace {

using Complex = std::complex<double>;
using Matrix = Eigen::MatrixXcd;

constexpr double deficient_below = 1e-13;

bool finite(Complex z) {
  return std::isfinite(z.real()) && std::isfinite(z.imag());
}

/// Gauss–Jordan with row pivoting, a (row by row) → its inverse in `inverse`. False if a pivot is below
/// deficient_below times the largest; a is destroyed.
bool invert(int n, Complex* a, Complex* inverse) {
  std::fill_n(inverse, n * n, Complex{});
  for (int i = 0; i < n; ++i) {
    inverse[i * n + i] = 1.0;
  }
  double largest = 0.0;
  for (int k = 0; k < n; ++k) {
    int row = k;
    for (int i = k + 1; i < n; ++i) {
      if (std::norm(a[i * n + k]) > std::norm(a[row * n + k])) {
        row = i;
      }
    }
    const double size = std::abs(a[row * n + k]);
    largest = std::max(largest, size);
    if (!(size > deficient_below * largest)) {
      return false;
    }
    std::swap_ranges(a + k * n, a + k * n + n, a + row * n);
    std::swap_ranges(inverse + k * n, inverse + k * n + n, inverse + row * n);
    const Complex reciprocal = 1.0 / a[k * n + k];
    for (int j = 0; j < n; ++j) {
      a[k * n + j] *= reciprocal;
      inverse[k * n + j] *= reciprocal;
    }
    for (int i = 0; i < n; ++i) {
      const Complex factor = a[i * n + k];
      if (i == k || factor == 0.0) {
        continue;
      }
      for (int j = 0; j < n; ++j) {
        a[i * n + j] -= factor * a[k * n + j];
        inverse[i * n + j] -= factor * inverse[k * n + j];
      }
    }
  }
  return true;
}

void pseudo_invert(int n, const Complex* a, Complex* inverse) {
  using RowMajor = Eigen::Matrix<Complex, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const Matrix matrix = Eigen::Map<const RowMajor>(a, n, n);
  const Eigen::JacobiSVD<Matrix> svd(matrix, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::VectorXd values = svd.singularValues();
  // Ten times looser than for pivots: a matrix that came here loses at least its smallest value.
  const double smallest_kept = std::max(10.0 * deficient_below * values(0), values(n - 1) * (1.0 + 1e-12));
  for (double& v : values) {
    v = v > smallest_kept ? 1.0 / v : 0.0;
  }
  Eigen::Map<RowMajor>(inverse, n, n) = svd.matrixV() * values.asDiagonal() * svd.matrixU().adjoint();
}

}  // namespace

FourierPreconditioner::FourierPreconditioner(const grids::Grid& grid, int fields)
    : fields_(fields),
      size_(grid.size()),
      fourier_(grid, std::max(1, fields)),
      in_(std::max(0, fields)),
      out_(std::max(0, fields)) {
  if (fields < 1 || fields > 16) {
    throw std::invalid_argument(fmt::format("FourierPreconditioner: {} fields, expected 1 to 16", fields));
  }
  inverses_.resize(fourier_.modes() * static_cast<std::size_t>(fields) * fields);
}

Status FourierPreconditioner::factor(const Symbol& symbol) {
  std::atomic<std::size_t> deficient = 0;
  std::atomic<bool> undefined = false;
  const int n = fields_;
  grids::for_each_block(fourier_.modes(), 64, [&](std::size_t begin, std::size_t end) {
    std::array<Complex, 256> matrix;
    std::array<Complex, 256> work;
    std::array<Complex, 256> inverse;
    for (std::size_t mode = begin; mode < end; ++mode) {
      std::fill_n(matrix.begin(), n * n, Complex{});
      symbol(fourier_.wave(mode), matrix.data());
      if (!std::all_of(matrix.begin(), matrix.begin() + n * n, finite)) {
        undefined = true;
        return;
      }
      work = matrix;
      if (!invert(n, work.data(), inverse.data())) {
        pseudo_invert(n, matrix.data(), inverse.data());
        ++deficient;
      }
      Complex* to = &inverses_[mode * n * n];
      for (int r = 0; r < n; ++r) {
        for (int c = 0; c < n; ++c) {
          to[c * n + r] = inverse[r * n + c];
        }
      }
    }
  });
  deficient_ = deficient;
  return undefined ? Status::undefined : Status::success;
}

void FourierPreconditioner::operator()(const double* in, double* out) {
  const int n = fields_;
  for (int f = 0; f < n; ++f) {
    in_[f] = in + static_cast<std::size_t>(f) * size_;
    out_[f] = out + static_cast<std::size_t>(f) * size_;
  }
  fourier_.forward(in_);
  grids::for_each_block(fourier_.modes(), 256, [&](std::size_t begin, std::size_t end) {
    std::array<double, 16> real;
    std::array<double, 16> imaginary;
    for (std::size_t mode = begin; mode < end; ++mode) {
      const Complex* inverse = &inverses_[mode * n * n];
      real.fill(0.0);
      imaginary.fill(0.0);
      for (int c = 0; c < n; ++c) {
        const double a = fourier_.at(c, mode).real();
        const double b = fourier_.at(c, mode).imag();
        for (int r = 0; r < n; ++r) {  // in real arithmetic: std::complex's product looks out for infinities
          const Complex m = inverse[c * n + r];
          real[r] += m.real() * a - m.imag() * b;
          imaginary[r] += m.real() * b + m.imag() * a;
        }
      }
      for (int r = 0; r < n; ++r) {
        fourier_.at(r, mode) = {real[r], imaginary[r]};
      }
    }
  });
  fourier_.inverse(out_);
}

}  // namespace rubato::solve
