#include <rubato/ode/darboux.hpp>

#include <cmath>
#include <stdexcept>
#include <string_view>

#include <fmt/format.h>

#include <rubato/ode/tuning.hpp>
#include <rubato/solve/small_matrices.hpp>

namespace rubato {

namespace {

using namespace tuning::darboux;

using Eigen::Index;
using Eigen::MatrixXd;
using solve::product;

bool is_close(const MatrixXd& a, const MatrixXd& b, double tolerance) {
  return (a - b).cwiseAbs().maxCoeff() <= tolerance;  // false for NaN
}

double squared_scale(const MatrixXd& m) {
  const double largest = m.cwiseAbs().maxCoeff();
  return std::max(1.0, largest * largest);
}

/// The blocks of the inverse of a regular matrix, and the fractional map they make of `argument`.
MatrixXd apply_fraction(const MatrixXd& blocks, const MatrixXd& argument, std::string_view name) {
  const Index size = argument.rows();
  const MatrixXd left = product(blocks.leftCols(size), argument) + blocks.rightCols(size);
  const auto transposed =
      solve::quotient(left.bottomRows(size).transpose(), left.topRows(size).transpose(), singular_limit);
  if (!transposed) {
    throw std::invalid_argument(fmt::format("the fractional transform is not defined here: {} is singular", name));
  }
  return transposed->transpose();
}

void check_darboux(const MatrixXd& alpha, const MatrixXd& argument) {
  if (argument.rows() != argument.cols() || alpha.rows() != 2 * argument.rows()) {
    throw std::invalid_argument(
        fmt::format("a fractional transform by a {}×{} matrix acts on square matrices of half its size, not {}×{}",
                    alpha.rows(), alpha.cols(), argument.rows(), argument.cols()));
  }
  if (!is_darboux(alpha)) {
    throw std::invalid_argument("the matrix of a fractional transform has to be a Darboux matrix (4.2)");
  }
}

}  // namespace

MatrixXd symplectic_unit(Index n) {
  MatrixXd J = MatrixXd::Zero(2 * n, 2 * n);
  J.topRightCorner(n, n).setIdentity();
  J.bottomLeftCorner(n, n) = -MatrixXd::Identity(n, n);
  return J;
}

MatrixXd turned(const MatrixXd& m) {
  const Index n = m.rows() / 2;
  MatrixXd result(m.rows(), m.cols());
  result.topRows(n) = m.bottomRows(n);
  result.bottomRows(n) = -m.topRows(n);
  return result;
}

MatrixXd darboux_weight(const MatrixXd& F) {
  if (F.rows() % 2 != 0) {
    throw std::invalid_argument(fmt::format("F has to be 2n×2n; got {}×{}", F.rows(), F.cols()));
  }
  check_darboux_symmetric(F, F.rows() / 2);
  return 0.5 * (MatrixXd::Identity(F.rows(), F.rows()) + turned(F));
}

MatrixXd darboux_symmetric(DarbouxType type, Index n) {
  MatrixXd F = MatrixXd::Zero(2 * n, 2 * n);
  if (type != DarbouxType::midpoint) {
    const double sign = type == DarbouxType::euler_a ? 1.0 : -1.0;
    F.topRightCorner(n, n) = sign * MatrixXd::Identity(n, n);
    F.bottomLeftCorner(n, n) = sign * MatrixXd::Identity(n, n);
  }
  return F;
}

void check_darboux_symmetric(const MatrixXd& F, Index n) {
  if (F.rows() != 2 * n || F.cols() != 2 * n) {
    throw std::invalid_argument(
        fmt::format("the Darboux type of {} degrees of freedom is a symmetric {}×{} matrix F; got {}×{}", n, 2 * n,
                    2 * n, F.rows(), F.cols()));
  }
  for (Index i = 0; i < F.rows(); ++i) {
    for (Index j = 0; j <= i; ++j) {
      if (!std::isfinite(F(i, j)) || F(i, j) != F(j, i)) {
        throw std::invalid_argument(
            fmt::format("F has to be symmetric and finite: entry ({}, {}) is {} and ({}, {}) is {}", j + 1, i + 1,
                        F(j, i), i + 1, j + 1, F(i, j)));
      }
    }
  }
}

bool is_darboux(const MatrixXd& alpha, double tolerance) {
  if (alpha.rows() != alpha.cols() || alpha.rows() % 4 != 0 || alpha.rows() == 0) {
    return false;
  }
  const Index half = alpha.rows() / 2;
  MatrixXd split = MatrixXd::Zero(2 * half, 2 * half);
  split.topLeftCorner(half, half) = symplectic_unit(half / 2);
  split.bottomRightCorner(half, half) = -symplectic_unit(half / 2);
  const MatrixXd form = product(-alpha.transpose(), product(symplectic_unit(half), alpha));
  return is_close(form, split, tolerance * squared_scale(alpha));
}

MatrixXd normal_darboux(const MatrixXd& F) {
  const MatrixXd E = darboux_weight(F);
  const Index size = F.rows();
  MatrixXd alpha(2 * size, 2 * size);
  alpha.topLeftCorner(size, size) = symplectic_unit(size / 2);
  alpha.topRightCorner(size, size) = -symplectic_unit(size / 2);
  alpha.bottomLeftCorner(size, size) = E;
  alpha.bottomRightCorner(size, size) = MatrixXd::Identity(size, size) - E;
  return alpha;
}

MatrixXd normal_darboux_inverse(const MatrixXd& F) {
  const MatrixXd E = darboux_weight(F);
  const Index size = F.rows();
  const MatrixXd J = symplectic_unit(size / 2);
  MatrixXd inverse(2 * size, 2 * size);
  inverse.topLeftCorner(size, size) = product(E - MatrixXd::Identity(size, size), J);
  inverse.bottomLeftCorner(size, size) = product(E, J);
  inverse.topRightCorner(size, size).setIdentity();
  inverse.bottomRightCorner(size, size).setIdentity();
  return inverse;
}

bool is_symplectic(const MatrixXd& S, double tolerance) {
  if (S.rows() != S.cols() || S.rows() % 2 != 0 || S.rows() == 0) {
    return false;
  }
  const MatrixXd J = symplectic_unit(S.rows() / 2);
  return is_close(product(S.transpose(), product(J, S)), J, tolerance * squared_scale(S));
}

MatrixXd fractional_transform(const MatrixXd& alpha, const MatrixXd& S) {
  check_darboux(alpha, S);
  if (!is_symplectic(S)) {
    throw std::invalid_argument("the fractional transform is defined on symplectic matrices, and this one is not");
  }
  return apply_fraction(alpha, S, "CS + D");
}

MatrixXd inverse_fractional_transform(const MatrixXd& alpha, const MatrixXd& M) {
  check_darboux(alpha, M);
  if (!is_close(M, M.transpose(), symmetry_tolerance * std::max(1.0, M.cwiseAbs().maxCoeff()))) {
    throw std::invalid_argument(
        "the inverse fractional transform is defined on symmetric matrices, and this one is not");
  }
  const Index size = M.rows();
  MatrixXd split = MatrixXd::Zero(2 * size, 2 * size);
  split.topLeftCorner(size, size) = symplectic_unit(size / 2);
  split.bottomRightCorner(size, size) = -symplectic_unit(size / 2);
  const MatrixXd inverse = product(product(split, alpha.transpose()), symplectic_unit(size));  // two signs cancel
  return apply_fraction(inverse, M, "C₁M + D₁");
}

MatrixXd parasite_matrix(const MatrixXd& F) {
  const MatrixXd twice = 2.0 * darboux_weight(F).transpose();  // I - FJ
  const MatrixXd identity = MatrixXd::Identity(F.rows(), F.rows());
  const auto negative = solve::quotient(2.0 * identity - twice, twice, singular_limit);
  if (!negative) {
    throw StartingPairError(
        "I + FJ is singular for this Darboux type (as for both symplectic-Euler types): the two-step equation forces "
        "the one-step equation, so that an arbitrary starting pair cannot be continued (theory, section 4)");
  }
  return -*negative;
}

}  // namespace rubato
