#pragma once

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <Eigen/Core>

#include <rubato/variation/total_variation.hpp>

/// What every discrete action has to satisfy, the caller that states it: one function for a whole suite. It returns
/// what failed, so that the suite itself can be tried on actions that are wrong.
namespace conformance {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

struct Expectations {
  bool autonomous = true;  ///< A depends on coordinates through their differences only
};

namespace detail {

inline std::span<const double> as_span(const VectorXd& v) {
  return {v.data(), static_cast<std::size_t>(v.size())};
}

inline VectorXd gradient(rubato::DiscreteAction& action, const VectorXd& at) {
  VectorXd result(at.size());
  action.gradient(as_span(at), result);
  return result;
}

inline MatrixXd hessian(rubato::DiscreteAction& action, const VectorXd& at) {
  MatrixXd result(at.size(), at.size());
  action.hessian(as_span(at), result);
  return result;
}

/// Central difference of f along component i, extrapolated once: error O(ε⁴), rounding 1e-16 |f|/ε.
template <typename Function>
auto difference(const Function& f, const VectorXd& at, Index i, double epsilon) {
  using Result = std::decay_t<decltype(f(at))>;
  const auto central = [&](double distance) -> Result {
    VectorXd plus = at;
    VectorXd minus = at;
    plus[i] += distance;
    minus[i] -= distance;
    return (f(plus) - f(minus)) / (plus[i] - minus[i]);
  };
  const Result wide = central(epsilon);
  const Result narrow = central(0.5 * epsilon);
  return Result((4.0 * narrow - wide) / 3.0);
}

}  // namespace detail

/// The names of the properties that fail at `corners`, a point where the element is not degenerate; empty if none.
inline std::vector<std::string> failures(rubato::DiscreteAction& action, const VectorXd& corners,
                                         Expectations expected = {}) {
  using namespace detail;
  std::vector<std::string> failed;
  const rubato::Element& element = action.element();
  if (static_cast<Index>(element.size()) != corners.size()) {
    return {"size"};
  }
  const VectorXd first = gradient(action, corners);
  const MatrixXd second = hessian(action, corners);
  const double first_scale = std::max(1.0, first.cwiseAbs().maxCoeff());
  const double second_scale = std::max(1.0, second.cwiseAbs().maxCoeff());
  if (!std::isfinite(action.value(as_span(corners))) || !first.allFinite() || !second.allFinite()) {
    return {"finite"};
  }

  // ε is short beside the element: truncation ε⁴·|A⁽⁵⁾| and rounding 1e-16/ε stay below
  // 1e-8 for steps of 0.1 and more.
  constexpr double epsilon = 5e-4;
  constexpr double agreement = 1e-7;
  VectorXd first_difference(corners.size());
  MatrixXd second_difference(corners.size(), corners.size());
  for (Index i = 0; i < corners.size(); ++i) {
    first_difference[i] = difference([&](const VectorXd& x) { return action.value(as_span(x)); }, corners, i, epsilon);
    second_difference.col(i) = difference([&](const VectorXd& x) { return gradient(action, x); }, corners, i, epsilon);
  }
  if ((first - first_difference).cwiseAbs().maxCoeff() > agreement * first_scale) {
    failed.emplace_back("gradient");
  }
  if ((second - second_difference).cwiseAbs().maxCoeff() > agreement * second_scale) {
    failed.emplace_back("hessian");
  }
  const double rounding = 1e-13;
  if ((second - second.transpose()).cwiseAbs().maxCoeff() > rounding * second_scale) {
    failed.emplace_back("symmetry");
  }

  // Moving all corners along a coordinate changes nothing: the rows of that coordinate add up to zero.
  bool invariant = true;
  for (std::size_t direction = 0; direction < element.coordinates; ++direction) {
    double sum = 0.0;
    for (std::size_t corner = 0; corner < element.corners; ++corner) {
      sum += first[static_cast<Index>(element.coordinate(corner, direction))];
    }
    invariant = invariant && std::abs(sum) <= rounding * first_scale;
  }
  if (invariant != expected.autonomous) {
    failed.emplace_back("autonomy");
  }

  // The boundary one-forms add up to dA, and the variations at a node are their sums over the elements that meet it.
  VectorXd sum = VectorXd::Zero(corners.size());
  for (std::size_t corner = 0; corner < element.corners; ++corner) {
    const VectorXd form = rubato::boundary_one_form(action, as_span(corners), corner);
    sum += form;
    const rubato::Incidence alone[] = {{as_span(corners), corner}};
    const VectorXd values = rubato::value_variation(action, alone);
    bool same = values == form.segment(static_cast<Index>(element.value(corner, 0)), values.size());
    for (std::size_t direction = 0; direction < element.coordinates; ++direction) {
      same = same && rubato::coordinate_variation(action, alone, direction) ==
                         form[static_cast<Index>(element.coordinate(corner, direction))];
    }
    if (!same) {
      failed.emplace_back("variation at a node");
    }
  }
  if ((sum - first_difference).cwiseAbs().maxCoeff() > agreement * first_scale) {
    failed.emplace_back("one-forms");
  }

  // On a segment: ω = dθ⁺ = -dθ⁻, (dθ)_ij = ∂_iθ_j - ∂_jθ_i by differences of the one-forms; and ω is closed, dω = 0.
  if (element.corners == 2 && element.coordinates == 1) {
    const auto exterior_derivative = [&](std::size_t corner) -> MatrixXd {
      MatrixXd jacobian(corners.size(), corners.size());
      for (Index i = 0; i < corners.size(); ++i) {
        jacobian.row(i) =
            difference([&](const VectorXd& x) { return rubato::boundary_one_form(action, as_span(x), corner); },
                       corners, i, epsilon);
      }
      return jacobian - jacobian.transpose();
    };
    const auto omega = [&](const VectorXd& x) { return rubato::two_form(action, as_span(x)); };
    const MatrixXd form = omega(corners);
    if ((form - exterior_derivative(1)).cwiseAbs().maxCoeff() > agreement * second_scale ||
        (form + exterior_derivative(0)).cwiseAbs().maxCoeff() > agreement * second_scale) {
      failed.emplace_back("two-form");
    }
    if ((form + form.transpose()).cwiseAbs().maxCoeff() > 0.0) {
      failed.emplace_back("antisymmetry");
    }
    std::vector<MatrixXd> derivative;
    double third_scale = 1.0;
    for (Index i = 0; i < corners.size(); ++i) {
      derivative.push_back(difference(omega, corners, i, epsilon));
      third_scale = std::max(third_scale, derivative.back().cwiseAbs().maxCoeff());
    }
    double open = 0.0;
    for (Index i = 0; i < corners.size(); ++i) {
      for (Index j = 0; j < i; ++j) {
        for (Index k = 0; k < j; ++k) {
          const auto d = [&](Index a, Index b, Index c) { return derivative[static_cast<std::size_t>(a)](b, c); };
          open = std::max(open, std::abs(d(i, j, k) + d(j, k, i) + d(k, i, j)));
        }
      }
    }
    if (open > agreement * third_scale) {
      failed.emplace_back("closedness");
    }
  }
  return failed;
}

}  // namespace conformance
