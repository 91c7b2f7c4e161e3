#include "audit/lagrange_oracle.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace audit {

namespace {

using Vector = std::vector<Bounded>;
using Matrix = std::vector<std::vector<long double>>;

Quadrature rule_of(const OrbitProblem& problem) {
  switch (problem.quadrature) {
    case OrbitProblem::Quadrature::trapezoid: return lobatto_quadrature(2);
    case OrbitProblem::Quadrature::lobatto: return lobatto_quadrature(static_cast<std::size_t>(problem.stages));
    case OrbitProblem::Quadrature::gauss: return gauss_quadrature(static_cast<std::size_t>(problem.stages));
    default: return gauss_quadrature(1);
  }
}

/// The degree of the polynomials: that for which the rule is the one of the family.
std::size_t degree_of(const OrbitProblem& problem, const Quadrature& rule) {
  const bool lobatto = problem.quadrature == OrbitProblem::Quadrature::trapezoid ||
                       problem.quadrature == OrbitProblem::Quadrature::lobatto;
  return rule.c.size() - (lobatto ? 1 : 0);
}

}  // namespace

LagrangeOracle::LagrangeOracle(const OrbitProblem& problem)
    : problem_(problem),
      n_(problem.degrees_of_freedom()),
      degree_(degree_of(problem, rule_of(problem))),
      rule_(rule_of(problem)),
      control_(lobatto_quadrature(degree_ + 1)) {
  for (const long double node : rule_.c) {
    values_.emplace_back();
    rates_.emplace_back();
    for (std::size_t i = 0; i <= degree_; ++i) {
      const long double value = control_.value(i, node), rate = control_.rate(i, node);
      values_.back().emplace_back(value, unit_roundoff * std::abs(value));
      rates_.back().emplace_back(rate, unit_roundoff * std::abs(rate));
    }
  }
}

Series LagrangeOracle::expand(std::span<const Bounded> q, std::span<const Bounded> velocity, std::size_t degree) const {
  const Shape& shape = Shape::of(2 * n_, degree);
  std::vector<Series> variables;
  for (std::size_t i = 0; i < n_; ++i) {
    variables.emplace_back(shape, q[i], i);
  }
  for (std::size_t i = 0; i < n_; ++i) {
    variables.emplace_back(shape, velocity[i], n_ + i);
  }
  return problem_.L(std::span<const Series>(variables));
}

OrbitStep LagrangeOracle::step(std::span<const Bounded> z_0, std::span<const Bounded> z_1, Bounded h) const {
  const std::size_t d = degree_, unknowns = d * n_;
  const auto q_0 = z_0.first(n_), p_0 = z_0.subspan(n_, n_), v_0 = z_0.last(n_), v_1 = z_1.last(n_);
  // Increments at the control points but the first, to begin with those of the cubic through both ends.
  std::vector<Vector> Y(d, Vector(n_));
  for (std::size_t i = 0; i < d; ++i) {
    const long double s = control_.c[i + 1], rest = 1 - s;
    for (std::size_t r = 0; r < n_; ++r) {
      const long double rise = z_1[r].value - q_0[r].value;
      Y[i][r] = rise * s * s * (3 - 2 * s) + h.value * (v_0[r].value * s * rest * rest - v_1[r].value * s * s * rest);
    }
  }
  struct Point {
    Vector q, v;
    Series L;
  };
  std::vector<Point> points;
  const auto evaluate = [&](std::size_t degree) {
    points.clear();
    for (std::size_t j = 0; j < rule_.c.size(); ++j) {
      Point point{Vector(q_0.begin(), q_0.end()), Vector(n_), {}};
      for (std::size_t r = 0; r < n_; ++r) {
        Bounded moved, rate;
        for (std::size_t i = 0; i < d; ++i) {
          moved += values_[j][i + 1] * Y[i][r];
          rate += rates_[j][i + 1] * Y[i][r];
        }
        point.q[r] += moved;
        point.v[r] = rate / h;
      }
      point.L = expand(point.q, point.v, degree);
      points.push_back(std::move(point));
    }
  };
  /// p_k + ∂S/∂q_k, and ∂S/∂q at the control points between.
  const auto residual = [&] {
    Vector rows(unknowns);
    for (std::size_t i = 0; i < d; ++i) {
      for (std::size_t r = 0; r < n_; ++r) {
        Bounded sum = i == 0 ? p_0[r] : Bounded();
        for (std::size_t j = 0; j < points.size(); ++j) {
          const Series& L = points[j].L;
          const Bounded weight{rule_.b[j], unit_roundoff * rule_.b[j]};
          sum += weight * (h * values_[j][i] * L.derivative(r) + rates_[j][i] * L.derivative(n_ + r));
        }
        rows[i * n_ + r] = sum;
      }
    }
    return rows;
  };
  Matrix system;
  const auto assemble = [&] {
    system.assign(unknowns, std::vector<long double>(unknowns + 1));
    for (std::size_t j = 0; j < points.size(); ++j) {
      Matrix hessian(2 * n_, std::vector<long double>(2 * n_));
      for (std::size_t r = 0; r < 2 * n_; ++r) {
        const Series slope = points[j].L.differentiated(r);
        for (std::size_t c = 0; c < 2 * n_; ++c) {
          hessian[r][c] = slope.derivative(c).value;
        }
      }
      for (std::size_t i = 0; i < d; ++i) {
        const long double value = h.value * values_[j][i].value, rate = rates_[j][i].value;
        for (std::size_t k = 0; k < d; ++k) {
          const long double value_k = values_[j][k + 1].value, rate_k = rates_[j][k + 1].value / h.value;
          for (std::size_t r = 0; r < n_; ++r) {
            for (std::size_t c = 0; c < n_; ++c) {
              system[i * n_ + r][k * n_ + c] +=
                  rule_.b[j] * (value * (value_k * hessian[r][c] + rate_k * hessian[r][n_ + c]) +
                                rate * (value_k * hessian[n_ + r][c] + rate_k * hessian[n_ + r][n_ + c]));
            }
          }
        }
      }
    }
  };
  constexpr int most_rounds = 40;
  long double last = std::numeric_limits<long double>::infinity();
  for (int round = 0; round < most_rounds; ++round) {
    evaluate(2);
    const Vector rows = residual();
    assemble();
    for (std::size_t i = 0; i < unknowns; ++i) {
      system[i][unknowns] = -rows[i].value;
    }
    const std::vector<long double> correction = solved(system);
    long double change = 0.0L, scale = 0.0L;
    for (std::size_t i = 0; i < d; ++i) {
      for (std::size_t r = 0; r < n_; ++r) {
        Y[i][r].value += correction[i * n_ + r];
        change = std::max(change, std::abs(correction[i * n_ + r]));
        scale = std::max(scale, std::abs(Y[i][r].value));
      }
    }
    if (!(change > 1e-18L * scale) || (change < 1e-14L * scale && change >= 0.5L * last)) {
      break;
    }
    last = change;
  }
  // Y is rounded when it is kept. What evaluation in double makes of the rows, the inverse makes of Y.
  for (Vector& values : Y) {
    for (Bounded& value : values) {
      value.error = unit_roundoff * std::abs(value.value);
    }
  }
  evaluate(2);
  assemble();
  std::vector<long double> errors;
  for (const Bounded& row : residual()) {
    errors.push_back(row.error);
  }
  const std::vector<long double> off = amplified(system, errors);
  for (std::size_t i = 0; i < d; ++i) {
    for (std::size_t r = 0; r < n_; ++r) {
      Y[i][r].error += off[i * n_ + r];
    }
  }
  evaluate(1);
  OrbitStep step;
  for (std::size_t r = 0; r < n_; ++r) {
    step.defect.push_back(z_1[r] - q_0[r] - Y[d - 1][r]);
  }
  for (std::size_t r = 0; r < n_; ++r) {
    Bounded defect = z_1[n_ + r] - p_0[r];
    for (std::size_t j = 0; j < points.size(); ++j) {
      defect = defect - h * Bounded(rule_.b[j], unit_roundoff * rule_.b[j]) * points[j].L.derivative(r);
    }
    step.defect.push_back(defect);
  }
  for (std::size_t j = 0; j < points.size(); ++j) {
    Bounded energy = -points[j].L.constant();
    for (std::size_t r = 0; r < n_; ++r) {
      energy += points[j].v[r] * points[j].L.derivative(n_ + r);
    }
    step.energy += Bounded(rule_.b[j], unit_roundoff * rule_.b[j]) * energy;
  }
  return step;
}

Bounded LagrangeOracle::node_energy(std::span<const Bounded> z) const {
  Bounded sum = -expand(z.first(n_), z.last(n_), 1).constant();
  for (std::size_t r = 0; r < n_; ++r) {
    sum += z[n_ + r] * z[2 * n_ + r];
  }
  return sum;
}

long double LagrangeOracle::scale(std::span<const Bounded> z) const {
  Vector variables(z.begin(), z.begin() + static_cast<std::ptrdiff_t>(n_));
  variables.insert(variables.end(), z.end() - static_cast<std::ptrdiff_t>(n_), z.end());
  const long double bare = node_energy(z).value + problem_.L.added_constant();
  // A term of degree g in the velocities is g - 1 times itself in E, written out as g times and once.
  long double terms = 3 * problem_.L.sum_of_magnitudes(std::span<const Bounded>(variables));
  const Series L = expand(z.first(n_), z.last(n_), 1);
  for (std::size_t r = 0; r < n_; ++r) {
    terms += std::abs(z[2 * n_ + r].value * L.derivative(n_ + r).value);
  }
  const long double part = problem_.every > 1 ? 1.0L : 0.03L;
  return std::max(std::abs(bare), part * terms);
}

std::vector<Bounded> LagrangeOracle::momentum_defect(std::span<const Bounded> z) const {
  const Series L = expand(z.first(n_), z.last(n_), 1);
  Vector defect;
  for (std::size_t r = 0; r < n_; ++r) {
    defect.push_back(L.derivative(n_ + r) - z[n_ + r]);
  }
  return defect;
}

std::optional<Bounded> LagrangeOracle::gamma(std::span<const Bounded> z) const {
  if (degree_ != 1 || rule_.c.size() != 1) {
    return std::nullopt;
  }
  // The second derivative of H along f = (q̇, ∂L/∂q), H = p·q̇ - L at the velocities that follow from q and p: these
  // change by w with ∂²L/∂q̇² w = ∂L/∂q - ∂²L/∂q̇∂q q̇, and what they change by to second order leaves H alone.
  const auto q = z.first(n_), p = z.subspan(n_, n_), v = z.last(n_);
  const Series L = expand(q, v, 2);
  Matrix rows(n_, std::vector<long double>(n_ + 1));
  std::vector<long double> errors;
  for (std::size_t r = 0; r < n_; ++r) {
    const Series slope = L.differentiated(n_ + r);
    Bounded right = L.derivative(r);
    for (std::size_t c = 0; c < n_; ++c) {
      rows[r][c] = slope.derivative(n_ + c).value;
      right = right - slope.derivative(c) * v[c];
    }
    rows[r][n_] = right.value;
    errors.push_back(right.error);
  }
  const std::vector<long double> w = solved(rows);
  for (std::size_t r = 0; r < n_; ++r) {
    const Series slope = L.differentiated(n_ + r);
    for (std::size_t c = 0; c < n_; ++c) {
      errors[r] += std::abs(w[c]) * (slope.derivative(n_ + c).error + unit_roundoff * std::abs(rows[r][c]));
    }
  }
  const std::vector<long double> off = amplified(rows, errors);
  const Shape& line = Shape::of(1, 2);
  std::vector<Series> variables;
  for (std::size_t i = 0; i < n_; ++i) {
    variables.emplace_back(line, q[i]);
    variables.back()[1] = v[i];
  }
  for (std::size_t i = 0; i < n_; ++i) {
    variables.emplace_back(line, v[i]);
    variables.back()[1] = Bounded(w[i], off[i] + unit_roundoff * std::abs(w[i]));
  }
  Series H = -problem_.L(std::span<const Series>(variables));
  for (std::size_t i = 0; i < n_; ++i) {
    Series momentum(line, p[i]);
    momentum[1] = L.derivative(i);
    H += momentum * variables[n_ + i];
  }
  return Bounded(2.0L) * H[2];
}

}  // namespace audit
