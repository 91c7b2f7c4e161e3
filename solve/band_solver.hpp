#pragma once

#include <cstddef>
#include <span>
#include <utility>
#include <vector>

#include <rubato/base/status.hpp>

namespace rubato::solve {

/// Solves A x = b for a band matrix, by LU with partial pivoting: A_ij = 0 unless -upper <= i - j <= lower. Work and
/// memory are n (lower + 1)(2 lower + upper + 1) and n (2 lower + upper + 1) at most. All memory is taken at
/// construction.
///
///     BandSolver solver(n, 1, 1);
///     solver.clear();
///     solver.entry(i, j) = …;
///     if (const Status status = solver.factor(); status != Status::success) return status;
///     solver.solve(residual);   // in place
class BandSolver {
public:
  /// \throws std::invalid_argument unless n >= 1 and 0 <= lower, upper < n
  BandSolver(int n, int lower, int upper);

  [[nodiscard]] int size() const { return n_; }
  [[nodiscard]] int lower() const { return lower_; }
  [[nodiscard]] int upper() const { return upper_; }

  /// A = 0, to be filled by entry(). Needed before the entries of every new matrix.
  void clear();
  /// A_ij, of which i - j is in the band.
  [[nodiscard]] double& entry(int i, int j) { return entries_[place(i, j)]; }

  /// Status::undefined if an entry is not finite, Status::singular if a pivot vanishes. After either, solve() may not
  /// be called.
  [[nodiscard]] Status factor();
  /// Replaces b (n entries) by x. Hypothesis: the last factor() succeeded.
  void solve(double* b) const;

private:
  /// Row exchanges fill `lower` diagonals above the band.
  [[nodiscard]] std::size_t place(int i, int j) const {
    return static_cast<std::size_t>(lower_ + upper_ + i - j) + static_cast<std::size_t>(j) * stride_;
  }

  int n_, lower_, upper_;
  std::size_t stride_;
  std::vector<double> entries_;
  std::vector<int> pivots_;
};

/// A numbering of the n vertices of a graph that brings neighbours close together (Cuthill and McKee, Proc. 24th
/// National Conference of the ACM, 1969, in the order reversed): where each vertex comes. Edges are pairs of vertices,
/// in any order. A chain gets bandwidth 1, a ring 2.
[[nodiscard]] std::vector<int> reverse_cuthill_mckee(int n, std::span<const std::pair<int, int>> edges);

}  // namespace rubato::solve
