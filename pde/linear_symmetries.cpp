#include <rubato/pde/linear_symmetries.hpp>

#include <Eigen/Core>

#include <rubato/pde/field_structure.hpp>
#include <rubato/pde/random_points.hpp>
#include <rubato/solve/small_matrices.hpp>

namespace rubato {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Relative to what is compared.
constexpr double no_rounding = 1e-9;

VectorXd flat(const MatrixXd& B) {
  return B.transpose().reshaped();
}
MatrixXd square(const VectorXd& flat, Index size) {
  return flat.unaryExpr(&nearest_twelfth).reshaped(size, size).transpose();
}

/// (MB)_ij = (MB)_ji for i < j, as rows of equations for the entries of B.
void require_symmetric(const MatrixXd& M, std::vector<VectorXd>& equations) {
  const Index d = M.rows();
  for (Index i = 0; i < d; ++i) {
    for (Index j = 0; j < i; ++j) {
      VectorXd row = VectorXd::Zero(d * d);
      for (Index k = 0; k < d; ++k) {
        row(k * d + j) += M(i, k);
        row(k * d + i) -= M(j, k);
      }
      if (!row.isZero(0.0)) {
        equations.push_back(row.normalized());
      }
    }
  }
}

/// Columns less their projections on `known`.
MatrixXd without(MatrixXd columns, const std::vector<MatrixXd>& known) {
  if (known.empty()) {
    return columns;
  }
  MatrixXd given(columns.rows(), static_cast<Index>(known.size()));
  for (std::size_t i = 0; i < known.size(); ++i) {
    given.col(static_cast<Index>(i)) = flat(known[i]);
  }
  return columns - solve::product(given, solve::least_squares(given, columns));
}

}  // namespace

LinearSymmetries::LinearSymmetries(const MultisymplecticSystem& system) : fields_(system.field_count()) {
  const Index d = fields_;
  std::vector<VectorXd> equations;
  require_symmetric(system.M(), equations);
  for (int a = 0; a < system.directions(); ++a) {
    require_symmetric(system.K(a), equations);
  }
  for (const PotentialSample& sample : samples_of(system, 2 * d * d)) {
    const VectorXd row = flat(sample.gradient * sample.point.head(d).transpose());
    if (row.norm() > 0.0) {
      equations.push_back(row.normalized());
    }
  }
  MatrixXd matrix(static_cast<Index>(equations.size()), d * d);
  for (std::size_t i = 0; i < equations.size(); ++i) {
    matrix.row(static_cast<Index>(i)) = equations[i].transpose();
  }
  basis_ = null_space(matrix);
}

std::vector<MatrixXd> LinearSymmetries::beside(const std::vector<MatrixXd>& known) const {
  std::vector<MatrixXd> result;
  if (basis_.cols() == 0) {
    return result;
  }
  const MatrixXd columns = column_echelon(without(basis_, known));
  for (Index i = 0; i < columns.cols(); ++i) {
    if (columns.col(i).norm() > no_rounding) {
      result.push_back(square(columns.col(i), fields_));
    }
  }
  return result;
}

bool LinearSymmetries::is_beside(const MatrixXd& B, const std::vector<MatrixXd>& known) {
  return without(flat(B), known).norm() > no_rounding * B.norm();
}

std::optional<MatrixXd> LinearSymmetries::phase(int p, int q) const {
  const Index d = fields_;
  MatrixXd rows(2 * d, basis_.cols());
  VectorXd wanted = VectorXd::Zero(2 * d);
  wanted(q) = -1.0;
  wanted(d + p) = 1.0;
  rows.topRows(d) = basis_.middleRows(p * d, d);
  rows.bottomRows(d) = basis_.middleRows(q * d, d);
  if (basis_.cols() == 0) {
    return std::nullopt;
  }
  const VectorXd weights = solve::least_squares(rows, wanted);
  if ((rows * weights - wanted).norm() > no_rounding) {
    return std::nullopt;
  }
  return square(basis_ * weights, d);
}

}  // namespace rubato
