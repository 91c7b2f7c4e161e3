#include <rubato/solve/cyclic_sparse.hpp>

#include <algorithm>
#include <cmath>

#include <rubato/base/all_finite.hpp>
#include <rubato/solve/sparse_factors.hpp>

namespace rubato::solve {
namespace {

bool column_is_finite(const double* values, std::size_t count) {
  return values == nullptr || all_finite(std::span(values, count));
}

double value_of(const CyclicCoefficient& c, std::size_t i) {
  return c.constant + (c.values != nullptr ? c.values[i] : 0.0);
}

}  // namespace

bool cyclic_is_finite(const CyclicBidiagonal& a, const CyclicBorder& border, std::span<const double* const> rhs,
                      std::span<const double> border_rhs) {
  const auto finite = [&](const CyclicCoefficient& c) {
    return std::isfinite(c.constant) && column_is_finite(c.values, a.cells);
  };
  return all_finite(a.left) && all_finite(a.right) && all_finite(a.last_left) && all_finite(a.last_right) &&
         all_finite(border.corner) && all_finite(border_rhs) &&
         std::all_of(a.entries.begin(), a.entries.end(),
                     [&](const CyclicEntry& e) {
                       return column_is_finite(e.values, a.cells) && std::isfinite(e.left) && std::isfinite(e.right);
                     }) &&
         std::all_of(border.columns.begin(), border.columns.end(), finite) &&
         std::all_of(border.rows.begin(), border.rows.end(), finite) &&
         std::all_of(rhs.begin(), rhs.end(), [&](const double* r) { return column_is_finite(r, a.cells); });
}

Status solve_cyclic_by_sparse_lu(const CyclicBidiagonal& a, const CyclicBorder& border,
                                 std::span<const double* const> rhs, std::span<const double> border_rhs,
                                 std::span<double* const> solution, std::span<double> border_solution) {
  const int d = a.block;
  const int k = border.count;
  const auto cells = static_cast<int>(a.cells);
  const int n = cells * d + k;
  std::vector<Eigen::Triplet<double>> triplets;
  triplets.reserve(a.cells * (2 * d * d + a.entries.size()));
  const auto add = [&](int row, int column, double value) {
    if (value != 0.0) {
      triplets.emplace_back(row, column, value);
    }
  };
  for (int i = 0; i < cells; ++i) {
    const int next = i + 1 == cells ? 0 : i + 1;
    const bool closes = next == 0 && a.closes();
    const std::vector<double>& left = closes ? a.last_left : a.left;
    const std::vector<double>& right = closes ? a.last_right : a.right;
    for (int r = 0; r < d; ++r) {
      for (int c = 0; c < d; ++c) {
        add(i * d + r, i * d + c, left[r * d + c]);
        add(i * d + r, next * d + c, right[r * d + c]);
      }
      for (int b = 0; b < k; ++b) {
        add(i * d + r, cells * d + b, value_of(border.columns[b * d + r], i));
        add(cells * d + b, i * d + r, value_of(border.rows[b * d + r], i));
      }
    }
    for (const CyclicEntry& e : closes ? std::vector<CyclicEntry>() : a.entries) {
      add(i * d + e.row, i * d + e.column, e.left * e.values[i]);
      add(i * d + e.row, next * d + e.column, e.right * e.values[i]);
    }
  }
  for (int r = 0; r < k; ++r) {
    for (int c = 0; c < k; ++c) {
      add(cells * d + r, cells * d + c, border.corner[r * k + c]);
    }
  }
  Eigen::SparseMatrix<double> matrix(n, n);
  matrix.setFromTriplets(triplets.begin(), triplets.end());
  SparseFactors factors;
  if (const Status status = factors.factor(matrix); status != Status::success) {
    return status;
  }
  const auto columns = static_cast<int>(rhs.size()) / d;
  Eigen::MatrixXd b(n, columns);
  for (int c = 0; c < columns; ++c) {
    for (int j = 0; j < cells * d; ++j) {
      b(j, c) = rhs[c * d + j % d][j / d];
    }
    for (int j = 0; j < k; ++j) {
      b(cells * d + j, c) = border_rhs[c * k + j];
    }
  }
  const Eigen::MatrixXd x = factors.solve(b);
  for (int c = 0; c < columns; ++c) {
    for (int j = 0; j < cells * d; ++j) {
      solution[c * d + j % d][j / d] = x(j, c);
    }
    for (int j = 0; j < k; ++j) {
      border_solution[c * k + j] = x(cells * d + j, c);
    }
  }
  return x.allFinite() ? Status::success : Status::singular;
}

}  // namespace rubato::solve
