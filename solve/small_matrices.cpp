#include <rubato/solve/small_matrices.hpp>

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <numeric>
#include <utility>
#include <vector>

#include <rubato/base/limits.hpp>

namespace rubato::solve {
namespace {

using Eigen::Index;
using Eigen::MatrixXcd;
using Eigen::MatrixXd;

double conjugate(double x) {
  return x;
}
std::complex<double> conjugate(std::complex<double> x) {
  return std::conj(x);
}

template <typename Matrix>
Matrix multiply(const Matrix& A, const Matrix& B) {
  Matrix result = Matrix::Zero(A.rows(), B.cols());
  for (Index c = 0; c < B.cols(); ++c) {
    for (Index k = 0; k < A.cols(); ++k) {
      for (Index r = 0; r < A.rows(); ++r) {
        result(r, c) += A(r, k) * B(k, c);
      }
    }
  }
  return result;
}

template <typename Matrix>
double squared_norm(const Matrix& matrix, Index column) {
  double sum = 0.0;
  for (Index r = 0; r < matrix.rows(); ++r) {
    sum += std::norm(matrix(r, column));
  }
  return sum;
}

/// Columns p and q of `matrix` rotated: c p - s q·phase, s p + c q·phase.
template <typename Matrix, typename Scalar>
void rotate(Matrix& matrix, Index p, Index q, double c, double s, Scalar phase) {
  for (Index r = 0; r < matrix.rows(); ++r) {
    const Scalar first = matrix(r, p);
    const Scalar second = matrix(r, q) * phase;
    matrix(r, p) = c * first - s * second;
    matrix(r, q) = s * first + c * second;
  }
}

template <typename Matrix>
SingularValues<Matrix> singular_values_of(Matrix images) {
  using Scalar = typename Matrix::Scalar;
  constexpr int most_sweeps = 60;  // some six are enough
  const Index columns = images.cols();
  Matrix vectors = Matrix::Identity(columns, columns);
  const double tolerance = epsilon * static_cast<double>(std::max<Index>(images.rows(), 4));
  bool changed = true;
  for (int sweep = 0; sweep < most_sweeps && changed; ++sweep) {
    changed = false;
    for (Index p = 0; p < columns; ++p) {
      for (Index q = p + 1; q < columns; ++q) {
        Scalar inner(0.0);
        for (Index r = 0; r < images.rows(); ++r) {
          inner += conjugate(images(r, p)) * images(r, q);
        }
        const double first = squared_norm(images, p);
        const double second = squared_norm(images, q);
        const double size = std::abs(inner);
        if (!(size > tolerance * std::sqrt(first) * std::sqrt(second))) {
          continue;
        }
        // The angle that makes the two orthogonal, the smaller one of the two there are.
        const double cotangent = (second - first) / (2.0 * size);
        const double tangent = std::copysign(1.0, cotangent) / (std::abs(cotangent) + std::hypot(1.0, cotangent));
        const double cosine = 1.0 / std::hypot(1.0, tangent);
        const Scalar phase = conjugate(inner) / size;
        rotate(images, p, q, cosine, tangent * cosine, phase);
        rotate(vectors, p, q, cosine, tangent * cosine, phase);
        changed = true;
      }
    }
  }

  std::vector<Index> order(static_cast<std::size_t>(columns));
  std::iota(order.begin(), order.end(), Index{0});
  Eigen::VectorXd values(columns);
  for (Index c = 0; c < columns; ++c) {
    values[c] = std::sqrt(squared_norm(images, c));
  }
  std::ranges::stable_sort(order, [&](Index a, Index b) { return values[a] > values[b]; });
  SingularValues<Matrix> result{Eigen::VectorXd(columns), Matrix(columns, columns), Matrix(images.rows(), columns)};
  for (Index c = 0; c < columns; ++c) {
    const Index from = order[static_cast<std::size_t>(c)];
    result.values[c] = values[from];
    result.vectors.col(c) = vectors.col(from);
    result.images.col(c) = images.col(from);
  }
  return result;
}

}  // namespace

MatrixXd product_of(const MatrixXd& A, const MatrixXd& B) {
  return multiply(A, B);
}
MatrixXcd product_of(const MatrixXcd& A, const MatrixXcd& B) {
  return multiply(A, B);
}

std::optional<MatrixXd> quotient(MatrixXd A, MatrixXd B, double threshold) {
  const Index n = A.rows();
  std::vector<Index> unknowns(static_cast<std::size_t>(n));
  std::iota(unknowns.begin(), unknowns.end(), Index{0});
  double first_pivot = 0.0;
  for (Index k = 0; k < n; ++k) {
    Index row = k;
    Index column = k;
    for (Index c = k; c < n; ++c) {
      for (Index r = k; r < n; ++r) {
        if (!std::isfinite(A(r, c))) {
          return std::nullopt;
        }
        if (std::abs(A(r, c)) > std::abs(A(row, column))) {
          row = r;
          column = c;
        }
      }
    }
    const double pivot = A(row, column);
    first_pivot = std::max(first_pivot, std::abs(pivot));
    if (pivot == 0.0 || !(std::abs(pivot) > threshold * first_pivot)) {
      return std::nullopt;
    }
    for (Index c = 0; c < n; ++c) {
      std::swap(A(k, c), A(row, c));
    }
    for (Index c = 0; c < B.cols(); ++c) {
      std::swap(B(k, c), B(row, c));
    }
    for (Index r = 0; r < n; ++r) {
      std::swap(A(r, k), A(r, column));
    }
    std::swap(unknowns[static_cast<std::size_t>(k)], unknowns[static_cast<std::size_t>(column)]);
    for (Index r = k + 1; r < n; ++r) {
      const double factor = A(r, k) / pivot;
      for (Index c = k + 1; c < n; ++c) {
        A(r, c) -= factor * A(k, c);
      }
      for (Index c = 0; c < B.cols(); ++c) {
        B(r, c) -= factor * B(k, c);
      }
    }
  }
  MatrixXd result(n, B.cols());
  for (Index c = 0; c < B.cols(); ++c) {
    for (Index k = n - 1; k >= 0; --k) {
      double sum = B(k, c);
      for (Index j = k + 1; j < n; ++j) {
        sum -= A(k, j) * result(unknowns[static_cast<std::size_t>(j)], c);
      }
      result(unknowns[static_cast<std::size_t>(k)], c) = sum / A(k, k);
    }
  }
  return result;
}

double spectral_radius(MatrixXd A) {
  // After j squarings, scaled to 1 in between, A^(2^j) = exp(2^j·exponent)·(the matrix at hand). A Jordan block of size
  // m makes the norm grow by k^(m-1), whose k-th root is 1 to rounding for k = 2^60.
  constexpr int squarings = 60;
  double exponent = 0.0;
  double weight = 1.0;
  for (int j = 0; j <= squarings; ++j) {
    double size = 0.0;
    for (Index i = 0; i < A.size(); ++i) {
      if (!std::isfinite(A(i))) {
        return std::numeric_limits<double>::quiet_NaN();
      }
      size = std::max(size, std::abs(A(i)));
    }
    if (size == 0.0) {
      return 0.0;
    }
    exponent += weight * std::log(size);
    A /= size;
    A = multiply(A, A);
    weight *= 0.5;
  }
  return std::exp(exponent);
}

SingularValues<MatrixXd> singular_values(MatrixXd A) {
  return singular_values_of(std::move(A));
}
SingularValues<MatrixXcd> singular_values(MatrixXcd A) {
  return singular_values_of(std::move(A));
}

Inverse inverse_of(MatrixXcd A) {
  const Index n = A.rows();
  Inverse result{MatrixXcd::Identity(n, n), 1.0, std::numeric_limits<double>::infinity(), 0.0};
  MatrixXcd& B = result.matrix;
  for (Index k = 0; k < n; ++k) {
    Index pivot = k;
    for (Index r = k + 1; r < n; ++r) {
      pivot = std::abs(A(r, k)) > std::abs(A(pivot, k)) ? r : pivot;
    }
    if (pivot != k) {
      for (Index c = 0; c < n; ++c) {
        std::swap(A(k, c), A(pivot, c));
        std::swap(B(k, c), B(pivot, c));
      }
      result.determinant = -result.determinant;
    }
    const std::complex<double> divisor = A(k, k);
    result.determinant *= divisor;
    result.smallest_pivot = std::min(result.smallest_pivot, std::abs(divisor));
    result.largest_pivot = std::max(result.largest_pivot, std::abs(divisor));
    for (Index c = 0; c < n; ++c) {
      A(k, c) /= divisor;
      B(k, c) /= divisor;
    }
    for (Index r = 0; r < n; ++r) {
      const std::complex<double> factor = A(r, k);
      if (r == k || factor == 0.0) {
        continue;
      }
      for (Index c = 0; c < n; ++c) {
        A(r, c) -= factor * A(k, c);
        B(r, c) -= factor * B(k, c);
      }
    }
  }
  return result;
}

MatrixXcd exponential_of(MatrixXcd A) {
  constexpr int terms = 18;  // 0.5^19/19! is below ε
  double size = 0.0;
  for (Index c = 0; c < A.cols(); ++c) {
    double column = 0.0;
    for (Index r = 0; r < A.rows(); ++r) {
      column += std::abs(A(r, c));
    }
    size = std::max(size, column);
  }
  const int squarings = size > 0.5 && std::isfinite(size) ? static_cast<int>(std::ceil(std::log2(2.0 * size))) : 0;
  for (Index c = 0; c < A.cols(); ++c) {
    for (Index r = 0; r < A.rows(); ++r) {
      A(r, c) = std::ldexp(1.0, -squarings) * A(r, c);
    }
  }
  MatrixXcd sum = MatrixXcd::Identity(A.rows(), A.cols()), term = sum;
  for (int k = 1; k <= terms; ++k) {
    term = product_of(term, A);
    for (Index c = 0; c < A.cols(); ++c) {
      for (Index r = 0; r < A.rows(); ++r) {
        term(r, c) /= k;
        sum(r, c) += term(r, c);
      }
    }
  }
  for (int k = 0; k < squarings; ++k) {
    sum = product_of(sum, sum);
  }
  return sum;
}

}  // namespace rubato::solve
