#include <rubato/ode/second_variation.hpp>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <fmt/format.h>

#include <rubato/ode/tuning.hpp>
#include <rubato/solve/damped_least_squares.hpp>
#include <rubato/solve/small_matrices.hpp>
#include <rubato/solve/spectrum.hpp>

namespace rubato {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;

MatrixXd symmetric_part(const MatrixXd& A) {
  return 0.5 * (A + A.transpose());
}

/// det A, of a small matrix.
double determinant(const MatrixXd& A) {
  return solve::inverse_of(A.cast<std::complex<double>>()).determinant.real();
}

}  // namespace

SecondVariation::SecondVariation(SegmentEquation& segments, const NodesOfOrbit& orbit) {
  if (segments.is_action()) {
    throw std::invalid_argument("the second variation in q is of a one-step map, which this discretisation is not");
  }
  SegmentRows rows;
  const auto size = static_cast<Index>(orbit.dimension), n = size / 2;
  times_.push_back(0.0);
  for (std::size_t k = 0; k < orbit.segments(); ++k) {
    const bool defined = segments.evaluate(orbit.node(k), orbit.node(k + 1), orbit.h[k], rows) == Status::success;
    const auto S = defined ? SegmentEquation::tangent(rows) : std::nullopt;
    if (!S) {
      throw std::invalid_argument(fmt::format("the step from level {} has no tangent", k));
    }
    products_.push_back(k == 0 ? *S : solve::product(*S, products_.back()));
    times_.push_back(times_.back() + orbit.h[k]);
    const MatrixXd B = S->topRightCorner(n, n);
    const auto inverse = solve::quotient(B, MatrixXd::Identity(n, n));
    legendre_ = legendre_ && inverse && solve::symmetric_eigenvalues(symmetric_part(B / orbit.h[k])).minCoeff() > 0.0;
    if (!legendre_) {
      continue;
    }
    // Backward in time the action is that forward with the other sign.
    const double sign = orbit.h[k] < 0.0 ? -1.0 : 1.0;
    first_.push_back(sign * symmetric_part(solve::product(*inverse, S->topLeftCorner(n, n))));
    last_.push_back(sign * symmetric_part(solve::product(S->bottomRightCorner(n, n), *inverse)));
    mixed_.push_back(-sign * *inverse);
  }
}

std::vector<std::complex<double>> SecondVariation::multipliers() const {
  const Eigen::VectorXcd values = solve::eigenvectors(monodromy()).values;
  std::vector<std::complex<double>> sorted(values.begin(), values.end());
  std::ranges::stable_sort(sorted, [](const auto& a, const auto& b) { return std::abs(a) > std::abs(b); });
  return sorted;
}

std::optional<std::size_t> SecondVariation::index_of_fixed_ends() const {
  if (!legendre_) {
    return std::nullopt;
  }
  // Block LDLᵀ from the start: each pivot has the inertia of one node.
  std::size_t negative = 0;
  MatrixXd pivot;
  for (std::size_t k = 1; k < first_.size(); ++k) {
    MatrixXd next = last_[k - 1] + first_[k];
    if (k > 1) {
      const auto quotient = solve::quotient(pivot, mixed_[k - 1]);
      if (!quotient) {
        return std::nullopt;  // a conjugate point at a node, to rounding
      }
      next -= solve::product(mixed_[k - 1].transpose(), *quotient);
    }
    pivot = symmetric_part(next);
    negative += static_cast<std::size_t>((solve::symmetric_eigenvalues(pivot).array() < 0.0).count());
  }
  return negative;
}

std::optional<std::size_t> SecondVariation::index_of_periodic() const {
  const std::size_t steps = first_.size();
  if (!legendre_ || steps < 3) {
    return std::nullopt;
  }
  const Index n = degrees();
  std::vector<Eigen::Triplet<double>> entries;
  double size = 0.0;
  const auto add = [&](std::size_t row, std::size_t column, const MatrixXd& block) {
    for (Index i = 0; i < n; ++i) {
      for (Index j = 0; j < n; ++j) {
        entries.emplace_back(static_cast<int>(static_cast<Index>(row) * n + i),
                             static_cast<int>(static_cast<Index>(column) * n + j), block(i, j));
      }
    }
    size = std::max(size, block.cwiseAbs().maxCoeff());
  };
  for (std::size_t k = 0; k < steps; ++k) {
    const std::size_t next = (k + 1) % steps;
    add(k, k, first_[k]);
    add(next, next, last_[k]);
    add(k, next, mixed_[k]);
    add(next, k, mixed_[k].transpose());
  }
  Eigen::SparseMatrix<double> matrix(static_cast<Index>(steps) * n, static_cast<Index>(steps) * n);
  matrix.setFromTriplets(entries.begin(), entries.end());
  // Entries are 1/h of a mass, eigenvalues of long waves h of it: what counts as 0 is between rounding and these.
  const double h = std::abs(times_.back()) / static_cast<double>(steps);
  const double scale = size * h;  // of a mass
  return solve::eigenvalues_below(matrix,
                                  -tuning::boundary_value::vanishing * scale * h / (times_.back() * times_.back()));
}

std::vector<double> SecondVariation::conjugate_points() const {
  std::vector<double> found;
  if (!legendre_) {
    return found;
  }
  const Index n = degrees();
  std::vector<double> values = {0.0};
  for (const MatrixXd& product : products_) {
    values.push_back(determinant(product.topRightCorner(n, n)));
  }
  for (std::size_t k = 1; k + 1 < values.size(); ++k) {
    if (!(values[k] * values[k + 1] < 0.0)) {
      continue;
    }
    const std::size_t count = std::min<std::size_t>(4, values.size());
    const std::size_t first = std::clamp<std::size_t>(k, 1, values.size() - count + 1) - 1;
    const auto at = [&](double t) {
      double sum = 0.0;
      for (std::size_t i = first; i < first + count; ++i) {
        double weight = values[i];
        for (std::size_t j = first; j < first + count; ++j) {
          weight *= i == j ? 1.0 : (t - times_[j]) / (times_[i] - times_[j]);
        }
        sum += weight;
      }
      return sum;
    };
    double a = times_[k], b = times_[k + 1];
    for (int halving = 0; halving < 60; ++halving) {
      const double middle = 0.5 * (a + b);
      (at(middle) * values[k] > 0.0 ? a : b) = middle;
    }
    found.push_back(0.5 * (a + b));
  }
  return found;
}

}  // namespace rubato
