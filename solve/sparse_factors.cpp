#include <rubato/solve/sparse_factors.hpp>

#include <span>

#include <Eigen/SparseLU>

#include <rubato/base/all_finite.hpp>

namespace rubato::solve {

struct SparseFactors::Storage {
  Eigen::SparseLU<Eigen::SparseMatrix<double>, Eigen::COLAMDOrdering<int>> lu;
};

SparseFactors::SparseFactors() : storage_(std::make_unique<Storage>()) {}
SparseFactors::~SparseFactors() = default;
SparseFactors::SparseFactors(SparseFactors&&) noexcept = default;
SparseFactors& SparseFactors::operator=(SparseFactors&&) noexcept = default;

Status SparseFactors::factor(const Eigen::SparseMatrix<double>& A, bool has_pattern_of_last) {
  if (!all_finite(std::span(A.valuePtr(), static_cast<std::size_t>(A.nonZeros())))) {
    return Status::undefined;
  }
  if (!has_pattern_of_last) {
    storage_->lu.analyzePattern(A);
  }
  storage_->lu.factorize(A);
  return storage_->lu.info() == Eigen::Success ? Status::success : Status::singular;
}

Eigen::Index SparseFactors::size() const {
  return storage_->lu.rows();
}

Eigen::MatrixXd SparseFactors::solve(const Eigen::MatrixXd& B) const {
  return storage_->lu.solve(B);
}

}  // namespace rubato::solve
