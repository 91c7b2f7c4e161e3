#pragma once

#include <memory>

#include <Eigen/SparseCore>

#include <rubato/base/status.hpp>

namespace rubato::solve {

/// Solves A X = B for sparse square A by Eigen's SparseLU with columns ordered by COLAMD, which is compiled once, here.
class SparseFactors {
public:
  SparseFactors();
  ~SparseFactors();
  SparseFactors(SparseFactors&&) noexcept;
  SparseFactors& operator=(SparseFactors&&) noexcept;

  /// \param A compressed
  /// \param has_pattern_of_last the places of its entries are those of the matrix factored last, whose order is kept
  /// \return Status::undefined if an entry is not finite, singular where the factorisation fails
  Status factor(const Eigen::SparseMatrix<double>& A, bool has_pattern_of_last = false);
  /// The rows of the matrix factored last.
  [[nodiscard]] Eigen::Index size() const;
  /// Hypothesis: the last factor() succeeded.
  [[nodiscard]] Eigen::MatrixXd solve(const Eigen::MatrixXd& B) const;

private:
  struct Storage;
  std::unique_ptr<Storage> storage_;
};

}  // namespace rubato::solve
