#include <rubato/solve/fourier_preconditioner.hpp>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <utility>

#include <fmt/core.h>
#include <rubato/grids/parallel.hpp>
#include <rubato/grids/transposition.hpp>
#include <rubato/solve/small_matrices.hpp>
#include <rubato/solve/tuning.hpp>

namespace rubato::solve {
namespace {

using namespace tuning::preconditioner;

using Complex = std::complex<double>;

bool finite(Complex z) {
  return std::isfinite(z.real()) && std::isfinite(z.imag());
}

// std::complex's product and quotient look out for infinities.
Complex product(Complex a, Complex b) {
  return {a.real() * b.real() - a.imag() * b.imag(), a.real() * b.imag() + a.imag() * b.real()};
}

/// Gauss–Jordan with row pivoting, in place: a (row by row) → its inverse. False, and a in disorder, if a pivot is
/// below deficient_below times the largest.
template <int Fixed>
bool invert(int size, Complex* a) {
  const int n = Fixed > 0 ? Fixed : size;  // a constant where loops are short
  std::array<int, 16> swapped;
  double largest = 0.0;  // squares
  for (int k = 0; k < n; ++k) {
    int row = k;
    for (int i = k + 1; i < n; ++i) {
      if (std::norm(a[i * n + k]) > std::norm(a[row * n + k])) {
        row = i;
      }
    }
    swapped[k] = row;
    const double square = std::norm(a[row * n + k]);
    largest = std::max(largest, square);
    if (!(square > deficient_below * deficient_below * largest)) {
      return false;
    }
    if (row != k) {
      std::swap_ranges(a + k * n, a + k * n + n, a + row * n);
    }
    const Complex reciprocal = std::conj(a[k * n + k]) / square;
    a[k * n + k] = 1.0;
    for (int j = 0; j < n; ++j) {
      a[k * n + j] = product(a[k * n + j], reciprocal);
    }
    for (int i = 0; i < n; ++i) {
      const Complex factor = a[i * n + k];
      if (i == k || factor == 0.0) {
        continue;
      }
      a[i * n + k] = 0.0;
      for (int j = 0; j < n; ++j) {
        a[i * n + j] -= product(factor, a[k * n + j]);
      }
    }
  }
  for (int k = n - 1; k >= 0; --k) {
    for (int i = 0; swapped[k] != k && i < n; ++i) {
      std::swap(a[i * n + k], a[i * n + swapped[k]]);
    }
  }
  return true;
}

bool invert(int n, Complex* a) {
  switch (n) {
    case 1: return invert<1>(n, a);
    case 2: return invert<2>(n, a);
    case 3: return invert<3>(n, a);
    case 4: return invert<4>(n, a);
    default: return invert<0>(n, a);
  }
}

void pseudo_invert(int n, const Complex* a, Complex* inverse) {
  double scale = 0.0;
  for (int i = 0; i < n * n; ++i) {
    scale = std::max({scale, std::abs(a[i].real()), std::abs(a[i].imag())});
  }
  std::fill_n(inverse, n * n, Complex{});
  if (scale == 0.0) {
    return;
  }
  Eigen::MatrixXcd matrix(n, n);
  for (int i = 0; i < n * n; ++i) {
    matrix(i / n, i % n) = a[i] / scale;
  }
  const auto [values, v] = singular_values(matrix);
  const Eigen::MatrixXcd av = product_of(matrix, v);
  // Ten times looser than for pivots: a matrix that came here loses at least its smallest value.
  const double smallest_kept = std::max(10.0 * deficient_below * values(0), values(n - 1) * (1.0 + 1e-12));
  for (int j = 0; j < n && values(j) > smallest_kept; ++j) {  // Σ v_j u_jᴴ / σ_j, u_j = A v_j / σ_j
    const double factor = 1.0 / (values(j) * values(j) * scale);
    for (int i = 0; i < n * n; ++i) {
      inverse[i] += product(factor * v(i / n, j), std::conj(av(i % n, j)));
    }
  }
}

/// Powers of two for rows and columns.
struct Scales {
  bool is_needed = false;
  std::array<double, 16> rows, columns;
};

/// Such that the largest of |sizes| in each row and column comes to about 1 (D. Ruiz, A scaling algorithm to
/// equilibrate both rows and columns norms in matrices, 2001: each sweep takes the roots of the largest, and halves how
/// many digits are missing).
Scales scales_of(int n, std::span<const double> sizes) {
  Scales scales;
  scales.rows.fill(1.0);
  scales.columns.fill(1.0);
  std::array<double, 16> of_rows, of_columns;
  const auto find_largest = [&] {
    of_rows.fill(0.0);
    of_columns.fill(0.0);
    for (int i = 0; i < n * n; ++i) {
      const double size = scales.rows[i / n] * sizes[i] * scales.columns[i % n];
      of_rows[i / n] = std::max(of_rows[i / n], size);
      of_columns[i % n] = std::max(of_columns[i % n], size);
    }
  };
  find_largest();
  const auto range = [n](const std::array<double, 16>& all) {
    const auto [least, most] = std::minmax_element(all.begin(), all.begin() + n);
    return *least / *most;
  };
  const double least = std::min(range(of_rows), range(of_columns));
  scales.is_needed = least < scaled_below && least >= zero_below;
  constexpr int sweeps = 6;
  for (int sweep = 0; scales.is_needed && sweep < sweeps; ++sweep) {
    const auto divide_by_root = [](double& scale, double largest) {
      if (largest > 0.0) {
        scale = std::ldexp(scale, -static_cast<int>(std::lround(0.5 * std::log2(largest))));
      }
    };
    for (int i = 0; i < n; ++i) {
      divide_by_root(scales.rows[i], of_rows[i]);
      divide_by_root(scales.columns[i], of_columns[i]);
    }
    find_largest();
  }
  return scales;
}

/// a = the inverse of the matrix, by way of the one that is scaled. False, and a in disorder, if that is singular.
bool invert_scaled(int n, const Scales& scales, const Complex* matrix, Complex* a) {
  for (int i = 0; i < n * n; ++i) {
    a[i] = scales.rows[i / n] * matrix[i] * scales.columns[i % n];
  }
  if (!invert(n, a)) {
    return false;
  }
  for (int i = 0; i < n * n; ++i) {
    a[i] = scales.columns[i / n] * a[i] * scales.rows[i % n];
  }
  return std::all_of(a, a + n * n, finite);
}

/// Coefficients of some waves, real and imaginary parts apart, as loops in vectors have them. std::complex's product
/// looks out for infinities.
struct Piece {
  std::array<double, piece> re, im;

  void add(double factor, const Complex* values, std::size_t count) {
    const auto* from = reinterpret_cast<const double*>(values);
    for (std::size_t k = 0; k < count; ++k) {
      re[k] += factor * from[2 * k];
      im[k] += factor * from[2 * k + 1];
    }
  }
  void add_real(const double* m, const Piece& a, std::size_t count) {
    for (std::size_t k = 0; k < count; ++k) {
      re[k] += m[k] * a.re[k];
      im[k] += m[k] * a.im[k];
    }
  }
  void add_imaginary(const double* m, const Piece& a, std::size_t count) {
    for (std::size_t k = 0; k < count; ++k) {
      re[k] -= m[k] * a.im[k];
      im[k] += m[k] * a.re[k];
    }
  }
  void multiply(Complex all, const Complex* each, std::size_t count) {
    for (std::size_t k = 0; k < count; ++k) {
      const Complex value = product(product(all, each[k]), {re[k], im[k]});
      re[k] = value.real();
      im[k] = value.imag();
    }
  }
  void write(Complex* values, std::size_t count) const {
    auto* to = reinterpret_cast<double*>(values);
    for (std::size_t k = 0; k < count; ++k) {
      to[2 * k] = re[k];
      to[2 * k + 1] = im[k];
    }
  }
};

}  // namespace

FourierPreconditioner::FourierPreconditioner(const grids::Grid& grid, int fields)
    : fields_(fields),
      size_(grid.size()),
      taken_(grid, std::max(1, fields)),
      work_(grid, std::max(1, fields)),
      all_(std::max(0, fields)),
      in_(std::max(0, fields)),
      out_(std::max(0, fields)) {
  if (fields < 1 || fields > 16) {
    throw std::invalid_argument(fmt::format("FourierPreconditioner: {} fields, expected 1 to 16", fields));
  }
  std::iota(all_.begin(), all_.end(), 0);
  parts_.resize(2 * static_cast<std::size_t>(fields) * fields);
}

Status FourierPreconditioner::factor(const Symbol& symbol, std::span<const double> sizes,
                                     std::span<const std::vector<Complex>> averages) {
  std::atomic<std::size_t> deficient;
  std::atomic<bool> undefined = false;
  const int n = fields_;
  const Scales scales = sizes.empty() ? Scales() : scales_of(n, sizes);
  const std::size_t modes = taken_.modes();
  std::array<std::atomic<bool>, 512> is_missing{};
  const auto invert_all = [&] {
    deficient = 0;
    grids::for_each_block(modes, 64, [&](std::size_t begin, std::size_t end) {
      std::array<Complex, 256> matrix;
      std::array<Complex, 256> inverse;
      for (std::size_t mode = begin; mode < end; ++mode) {
        std::fill_n(matrix.begin(), n * n, Complex{});
        symbol(taken_.wave(mode), matrix.data());
        if (!std::all_of(matrix.begin(), matrix.begin() + n * n, finite)) {
          undefined = true;
          return;
        }
        std::copy_n(matrix.begin(), n * n, inverse.begin());
        if (!invert(n, inverse.data()) &&
            !(scales.is_needed && invert_scaled(n, scales, matrix.data(), inverse.data()))) {
          pseudo_invert(n, matrix.data(), inverse.data());
          ++deficient;
        }
        for (std::size_t part = 0; part < parts_.size(); ++part) {
          const auto entry = static_cast<int>(part / 2);
          const Complex value = inverse[entry % n * n + entry / n];
          const double number = part % 2 == 0 ? value.real() : value.imag();
          if (parts_[part].size() > 0) {
            parts_[part][mode] = number;
          } else if (number != 0.0) {
            is_missing[part] = true;
          }
        }
      }
    });
  };
  // The first time shows which parts there are, and again what a pseudo-inverse brings along.
  for (bool is_complete = false; !is_complete;) {
    invert_all();
    is_complete = true;
    for (std::size_t part = 0; part < parts_.size(); ++part) {
      if (is_missing[part].exchange(false)) {
        parts_[part] = grids::Buffer(modes);
        is_complete = false;
      }
    }
  }
  find_averages(averages);
  deficient_ = deficient;
  if (const grids::Transposition* const shared = taken_.transposition()) {
    deficient_ = static_cast<std::size_t>(shared->slab().sum_over_ranks(static_cast<double>(deficient_)));
    undefined = shared->slab().largest_over_ranks(undefined ? 1.0 : 0.0) > 0.0;
  }
  return undefined ? Status::undefined : Status::success;
}

void FourierPreconditioner::operator()(const double* in, double* out) {
  for (int f = 0; f < fields_; ++f) {
    in_[f] = in + static_cast<std::size_t>(f) * size_;
    out_[f] = out + static_cast<std::size_t>(f) * size_;
  }
  respond(all_, in_, all_, out_);
}

void FourierPreconditioner::find_averages(std::span<const std::vector<Complex>> averages) {
  const auto inverse = [&](std::size_t axis, std::ptrdiff_t k) {
    if (axis >= averages.size()) {
      return Complex(1.0);
    }
    const auto n = static_cast<std::ptrdiff_t>(averages[axis].size());
    const Complex average = averages[axis][static_cast<std::size_t>(k < 0 ? k + n : k)];
    return average == 0.0 ? Complex() : 1.0 / average;
  };
  along_row_.clear();
  of_rows_.clear();
  const std::size_t row = taken_.row_length();
  for (std::size_t mode = 0; !averages.empty() && mode < taken_.modes(); mode += mode < row ? 1 : row) {
    const auto k = taken_.wave(mode);
    if (mode < row) {
      along_row_.push_back(inverse(0, k[0]));
    }
    if (mode % row == 0) {
      of_rows_.push_back(product(inverse(1, k[1]), inverse(2, k[2])));
    }
  }
}

void FourierPreconditioner::take(std::span<const double* const> rhs) {
  taken_.forward(rhs);
}

void FourierPreconditioner::solve(std::span<const int> rows, std::span<const double* const> values,
                                  std::span<const int> fields, std::span<double* const> out) {
  work_.forward(values);
  multiply(true, -1.0, rows, fields, work_);
  work_.inverse(out);
}

void FourierPreconditioner::solve_all(std::span<const int> rows, std::span<const double* const> values,
                                      std::span<double* const> out) {
  work_.forward(values);
  multiply(true, -1.0, rows, all_, taken_);
  taken_.inverse(out);
}

void FourierPreconditioner::respond(std::span<const int> rows, std::span<const double* const> values,
                                    std::span<const int> fields, std::span<double* const> out) {
  work_.forward(values);
  multiply(false, 1.0, rows, fields, work_);
  work_.inverse(out);
}

/// to = (matrix)⁻¹ (taken + factor · work), in the order of `rows` before and of `fields` after.
void FourierPreconditioner::multiply(bool with_taken, double factor, std::span<const int> rows,
                                     std::span<const int> fields, grids::Fourier& to) {
  const std::size_t modes = taken_.modes();
  const std::size_t row_length = taken_.row_length();
  if (row_length == 0) {
    return;  // other ranks have all waves
  }
  const std::size_t pieces = (row_length + piece - 1) / piece;
  const std::span<const int> read = with_taken ? std::span<const int>(all_) : rows;
  grids::for_each_block(
      modes / row_length * pieces, std::max<std::size_t>(1, 4 / pieces), [&](std::size_t first, std::size_t last) {
        std::array<Piece, 16> in;
        for (std::size_t unit = first; unit < last; ++unit) {
          const std::size_t start = unit % pieces * piece;
          const std::size_t begin = unit / pieces * row_length + start;
          const std::size_t count = std::min(piece, row_length - start);
          for (const int r : read) {
            in[r] = {};
            if (with_taken) {
              in[r].add(1.0, &taken_.at(r, begin), count);
            }
          }
          for (std::size_t i = 0; i < rows.size(); ++i) {
            in[rows[i]].add(factor, &work_.at(static_cast<int>(i), begin), count);
          }
          for (std::size_t j = 0; j < fields.size(); ++j) {
            Piece sum = {};
            for (const int r : read) {
              const grids::Buffer* const parts = &parts_[2 * static_cast<std::size_t>(r * fields_ + fields[j])];
              if (parts[0].size() > 0) {
                sum.add_real(parts[0].data() + begin, in[r], count);
              }
              if (parts[1].size() > 0) {
                sum.add_imaginary(parts[1].data() + begin, in[r], count);
              }
            }
            if (!of_rows_.empty()) {
              sum.multiply(of_rows_[unit / pieces], along_row_.data() + start, count);
            }
            sum.write(&to.at(static_cast<int>(j), begin), count);
          }
        }
      });
}

}  // namespace rubato::solve
