#include "audit/orbit_oracle.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

namespace audit {

namespace {

using Lagrangian = OrbitProblem::Lagrangian;
using Vector = std::vector<Bounded>;

/// J v, v = (a, b): (b, -a)
template <typename T>
std::vector<T> times_J(std::span<const T> v) {
  const std::size_t n = v.size() / 2;
  std::vector<T> result(v.begin(), v.end());
  for (std::size_t i = 0; i < n; ++i) {
    result[i] = v[n + i];
    result[n + i] = -v[i];
  }
  return result;
}

template <typename T>
std::vector<T> times(std::span<const double> matrix, std::span<const T> v) {
  std::vector<T> result;
  for (std::size_t i = 0; i < v.size(); ++i) {
    T sum = Bounded(static_cast<long double>(matrix[i * v.size()])) * v[0];
    for (std::size_t j = 1; j < v.size(); ++j) {
      sum += Bounded(static_cast<long double>(matrix[i * v.size() + j])) * v[j];
    }
    result.push_back(sum);
  }
  return result;
}

Vector stored(std::span<const double> values) {
  Vector result;
  for (const double value : values) {
    result.push_back(Bounded::stored(value));
  }
  return result;
}

const Bounded half = 0.5L;

}  // namespace

OrbitOracle::OrbitOracle(const OrbitProblem& problem) : problem_(problem) {
  if (problem.is_stated_by_L()) {
    by_L_.emplace(problem);
  } else if (problem.lagrangian == Lagrangian::gauss) {
    collocation_ = gauss_quadrature(static_cast<std::size_t>(problem.stages));
  }
}

std::size_t OrbitOracle::terms() const {
  if (problem_.lagrangian == Lagrangian::midpoint) {
    return 1;
  }
  // F = 0: the even coefficients vanish, and an odd order rounds up.
  return problem_.F.empty() ? static_cast<std::size_t>((problem_.order + 1) / 2 * 2 - 1)
                            : static_cast<std::size_t>(problem_.order);
}

double OrbitOracle::cost() const {
  if (by_L_) {
    return by_L_->cost();
  }
  if (problem_.lagrangian == Lagrangian::custom || problem_.lagrangian == Lagrangian::forward ||
      problem_.lagrangian == Lagrangian::splitting) {
    return 1e4;
  }
  if (problem_.lagrangian == Lagrangian::gauss) {
    return 1e4 * problem_.stages * problem_.stages;
  }
  const std::size_t degree = terms() + 1;
  return 60.0 * static_cast<double>(degree * Shape::of(2 * problem_.degrees_of_freedom() + 1, degree).products.size());
}

OrbitOracle::Generated OrbitOracle::generate(std::span<const Bounded> w, std::size_t degree) const {
  const std::size_t size = w.size();
  const Shape& shape = Shape::of(size + 1, degree);
  const std::size_t time = size;
  std::vector<Series> points;
  for (std::size_t i = 0; i < size; ++i) {
    points.emplace_back(shape, w[i], i);
  }
  Generated phi;
  phi.gradient.assign(size, Series(shape, 0.0L));
  // φ_t = -H(ẑ), ẑ = w - ½(I - JF)J∇φ; each round makes one more power of t right.
  for (std::size_t round = 0; round <= degree; ++round) {
    std::vector<Series> end = points;
    const std::vector<Series> rotated = times_J<Series>(phi.gradient);
    std::vector<Series> sheared;
    if (!problem_.F.empty()) {
      sheared = times_J<Series>(times<Series>(problem_.F, rotated));
    }
    for (std::size_t i = 0; i < size; ++i) {
      end[i] += -(half * rotated[i]);
      if (!sheared.empty()) {
        end[i] += half * sheared[i];
      }
    }
    phi.rate = -problem_.H(std::span<const Series>(end));
    for (std::size_t i = 0; i < size; ++i) {
      phi.gradient[i] = phi.rate.differentiated(i).integrated(time);
    }
  }
  return phi;
}

OrbitStep OrbitOracle::generated_step(std::span<const Bounded> z_0, std::span<const Bounded> z_1, Bounded h) const {
  const std::size_t size = z_0.size(), s = terms();
  Vector difference, w;
  for (std::size_t i = 0; i < size; ++i) {
    difference.push_back(z_1[i] - z_0[i]);
    w.push_back(half * (z_0[i] + z_1[i]));
  }
  const Vector rotated = times_J<Bounded>(difference);
  Vector sheared(size);
  if (!problem_.F.empty()) {
    sheared = times<Bounded>(problem_.F, difference);
    const Vector shift = times_J<Bounded>(sheared);
    for (std::size_t i = 0; i < size; ++i) {
      w[i] = w[i] + half * shift[i];
    }
  }
  const Generated phi = generate(w, s);
  OrbitStep step;
  Vector gradient(size);
  Bounded power = 1.0L;
  for (std::size_t j = 1; j <= s; ++j) {
    // E = -∂Φ/∂h = -Σ j h^(j-1) φ^j
    step.energy = step.energy - power * phi.rate.coefficient(size, j - 1);
    power = power * h;
    for (std::size_t i = 0; i < size; ++i) {
      gradient[i] = gradient[i] + power * phi.gradient[i].coefficient(size, j);
    }
  }
  for (std::size_t i = 0; i < size; ++i) {
    step.defect.push_back(rotated[i] - gradient[i]);
  }
  // A = -½ z̄ᵀJδ + Φ(w) - ¼ δᵀFδ, so that ∂A/∂z_0 = ½(Jz̄ - ½Jδ... ) collects to ∓½(I ± FJ)(…) of the defect plus what
  // is a total difference, the same from both sides: (3.3) is (I + FJ) d_k + (I - FJ) d_{k-1} = 0.
  step.first = step.defect;
  step.second = step.defect;
  if (!problem_.F.empty()) {
    const Vector turned = times<Bounded>(problem_.F, times_J<Bounded>(step.defect));
    for (std::size_t i = 0; i < size; ++i) {
      step.first[i] = step.first[i] + turned[i];
      step.second[i] = step.second[i] - turned[i];
    }
  }
  return step;
}

std::vector<Bounded> OrbitOracle::velocity(std::span<const Bounded> z, std::vector<long double>& slopes) const {
  const std::size_t size = z.size(), n = size / 2;
  std::vector<Series> variables;
  for (std::size_t i = 0; i < size; ++i) {
    variables.emplace_back(Shape::of(size, 2), z[i], i);
  }
  const Series H = problem_.H(std::span<const Series>(variables));
  Vector gradient;
  slopes.assign(size * size, 0.0L);
  for (std::size_t i = 0; i < size; ++i) {
    gradient.push_back(H.derivative(i));
    const Series derivative = H.differentiated(i);
    for (std::size_t j = 0; j < size; ++j) {
      const std::size_t row = i < n ? n + i : i - n;  // of J∇H
      slopes[row * size + j] = (i < n ? -1.0L : 1.0L) * derivative.derivative(j).value;
    }
  }
  return times_J<Bounded>(gradient);
}

OrbitStep OrbitOracle::collocated_step(std::span<const Bounded> z_0, std::span<const Bounded> z_1, Bounded h) const {
  const auto m = static_cast<std::size_t>(problem_.stages);
  const Quadrature& rule = *collocation_;
  const std::size_t size = z_0.size();
  const std::size_t unknowns = m * size;
  // To begin with on the line between both ends, near the stages of the step and no others.
  std::vector<Vector> stages(m, Vector(z_0.begin(), z_0.end()));
  for (std::size_t i = 0; i < m; ++i) {
    for (std::size_t r = 0; r < size; ++r) {
      stages[i][r].value += rule.c[i] * (z_1[r].value - z_0[r].value);
    }
  }
  std::vector<Vector> rates;
  // Newton's method for Z_i = z_0 + h Σ a_ij f(Z_j); the last round takes the stages as the last rates give them.
  constexpr int most_rounds = 30;
  std::vector<std::vector<long double>> system;
  long double last = std::numeric_limits<long double>::infinity();
  for (int round = 0; round < most_rounds; ++round) {
    rates.clear();
    system.assign(unknowns, std::vector<long double>(unknowns + 1));
    std::vector<std::vector<long double>> derivatives;
    for (const Vector& stage : stages) {
      derivatives.emplace_back();
      rates.push_back(velocity(stage, derivatives.back()));
    }
    long double scale = 0.0L;
    for (std::size_t i = 0; i < m; ++i) {
      for (std::size_t r = 0; r < size; ++r) {
        std::vector<long double>& row = system[i * size + r];
        row[i * size + r] = 1.0L;
        row[unknowns] = z_0[r].value - stages[i][r].value;
        scale = std::max(scale, std::abs(stages[i][r].value));
        for (std::size_t j = 0; j < m; ++j) {
          row[unknowns] += h.value * rule.a[i][j] * rates[j][r].value;
          for (std::size_t c = 0; c < size; ++c) {
            row[j * size + c] -= h.value * rule.a[i][j] * derivatives[j][r * size + c];
          }
        }
      }
    }
    const std::vector<long double> correction = solved(system);
    long double change = 0.0L;
    for (std::size_t i = 0; i < m; ++i) {
      for (std::size_t r = 0; r < size; ++r) {
        const long double moved = correction[i * size + r];
        change = std::max(change, std::abs(moved));
        stages[i][r].value += moved;
      }
    }
    if (!(change > 1e-17L * scale) || (change < 1e-14L * scale && change >= 0.5L * last)) {
      break;
    }
    last = change;
  }
  // What z_0 is off by goes to every stage through the inverse of the last system.
  std::vector<long double> rows(unknowns);
  for (std::size_t column = 0; column < unknowns; ++column) {
    for (std::size_t row = 0; row < unknowns; ++row) {
      system[row][unknowns] = row == column ? 1.0L : 0.0L;
    }
    const std::vector<long double> inverse = solved(system);
    for (std::size_t row = 0; row < unknowns; ++row) {
      rows[row] += std::abs(inverse[row]);
    }
  }
  const long double growth = 2.0L * *std::max_element(rows.begin(), rows.end());
  std::vector<long double> slopes;
  rates.clear();
  for (Vector& stage : stages) {
    for (std::size_t r = 0; r < size; ++r) {
      stage[r].error = unit_roundoff * std::abs(stage[r].value) + growth * z_0[r].error;
    }
    rates.push_back(velocity(stage, slopes));
  }
  OrbitStep step;
  for (std::size_t r = 0; r < size; ++r) {
    Bounded defect = z_1[r] - z_0[r];
    for (std::size_t i = 0; i < m; ++i) {
      defect = defect - h * Bounded(rule.b[i]) * rates[i][r];
    }
    step.defect.push_back(defect);
  }
  for (std::size_t i = 0; i < m; ++i) {
    step.energy += Bounded(rule.b[i]) * problem_.H(std::span<const Bounded>(stages[i]));
  }
  return step;
}

/// Drifts along T(p) and kicks by V(q), each from where the last one led.
OrbitStep OrbitOracle::composed_step(std::span<const Bounded> z_0, std::span<const Bounded> z_1, Bounded h) const {
  const std::size_t size = z_0.size(), n = size / 2;
  const Shape& shape = Shape::of(size, 1);
  const auto has_momenta = [=](const Expression& term) { return term.depends_on(n, size); };
  const Expression T = problem_.H.terms_where(has_momenta);
  const Expression V = problem_.H.terms_where([&](const Expression& term) { return !has_momenta(term); });
  // The step goes by increments, so that what a long z loses is not lost in every part.
  Vector moved(size);
  OrbitStep step;
  for (const CompositionPart& part : composition_parts(problem_.composition)) {
    const Bounded length = Bounded::rounded(part.length, 0.0L);
    std::vector<Series> variables;
    for (std::size_t i = 0; i < size; ++i) {
      variables.emplace_back(shape, z_0[i] + moved[i], i);
    }
    const Series energy = (part.drift ? T : V)(std::span<const Series>(variables));
    step.energy += length * energy.constant();
    for (std::size_t i = 0; i < n; ++i) {
      if (part.drift) {
        moved[i] += length * h * energy.derivative(n + i);
      } else {
        moved[n + i] = moved[n + i] - length * h * energy.derivative(i);
      }
    }
  }
  for (std::size_t i = 0; i < size; ++i) {
    step.defect.push_back(z_1[i] - z_0[i] - moved[i]);
  }
  return step;
}

OrbitStep OrbitOracle::varied_step(std::span<const Bounded> z_0, std::span<const Bounded> z_1, Bounded h) const {
  const std::size_t size = z_0.size(), corner = size + 1;
  const Shape& shape = Shape::of(2 * corner, 1);
  std::vector<Series> variables;
  for (std::size_t end = 0; end < 2; ++end) {
    variables.emplace_back(shape, end == 0 ? Bounded() : h, end * corner);
    for (std::size_t i = 0; i < size; ++i) {
      variables.emplace_back(shape, (end == 0 ? z_0 : z_1)[i], end * corner + 1 + i);
    }
  }
  const Series action = (variables[corner] - variables[0]) * problem_.L(std::span<const Series>(variables));
  OrbitStep step;
  for (std::size_t i = 0; i < size; ++i) {
    step.first.push_back(action.derivative(1 + i));
    step.second.push_back(action.derivative(corner + 1 + i));
  }
  step.energy = action.derivative(0);
  return step;
}

OrbitStep OrbitOracle::step(std::span<const double> z_0, std::span<const double> z_1, double h,
                            long double time_rounding) const {
  Bounded length = Bounded::stored(h);
  length.error += time_rounding;
  const bool generated = problem_.lagrangian == Lagrangian::midpoint || problem_.lagrangian == Lagrangian::generating;
  const Vector first = stored(z_0);
  Vector second = stored(z_1);
  for (std::size_t i = 0; i < second.size(); ++i) {
    // A step is solved for z_1 - z_0, which is rounded, too, and may be longer than z_1.
    second[i].error += unit_roundoff * std::abs(second[i].value - first[i].value);
  }
  if (by_L_) {
    return by_L_->step(first, second, length);
  }
  if (problem_.lagrangian == Lagrangian::gauss) {
    return collocated_step(first, second, length);
  }
  if (problem_.lagrangian == Lagrangian::splitting) {
    return composed_step(first, second, length);
  }
  return generated ? generated_step(first, second, length) : varied_step(first, second, length);
}

/// J(z_1 - z_0) = ∇Φ(w, h) by repeated insertion, for two lengths beside h.
std::optional<long double> OrbitOracle::slope(std::span<const double> z_0, std::span<const double> z_1,
                                              double h) const {
  const bool generated = problem_.lagrangian == Lagrangian::midpoint || problem_.lagrangian == Lagrangian::generating;
  if (by_L_ || !generated || cost() > 3e5) {
    return std::nullopt;
  }
  constexpr long double part = 1e-4L;
  long double energies[2] = {};
  for (const int side : {0, 1}) {
    const Bounded length = h * (1 + (side == 0 ? -part : part));
    Vector first, second;
    for (std::size_t i = 0; i < z_0.size(); ++i) {
      first.emplace_back(static_cast<long double>(z_0[i]));
      second.emplace_back(static_cast<long double>(z_1[i]));
    }
    long double largest = 1.0L;
    for (int round = 0; round < 200 && largest > 1e-16L; ++round) {
      const OrbitStep step = generated_step(first, second, length);
      energies[side] = step.energy.value;
      // d = Jδ - ∇Φ, and so δ is off by -Jd.
      const Vector turned = times_J<Bounded>(step.defect);
      largest = 0.0L;
      for (std::size_t i = 0; i < second.size(); ++i) {
        second[i].value += turned[i].value;
        largest = std::max(largest, std::abs(turned[i].value));
      }
    }
    if (!(largest <= 1e-16L)) {
      return std::nullopt;
    }
  }
  return (energies[1] - energies[0]) / (2 * part * h);
}

std::vector<Bounded> OrbitOracle::momentum_defect(std::span<const double> z) const {
  return by_L_ ? by_L_->momentum_defect(stored(z)) : Vector();
}

Bounded OrbitOracle::node_energy(std::span<const double> z) const {
  if (by_L_) {
    return by_L_->node_energy(stored(z));
  }
  return problem_.H(std::span<const Bounded>(stored(z)));
}

long double OrbitOracle::scale(std::span<const double> z) const {
  if (by_L_) {
    return by_L_->scale(stored(z));
  }
  const long double bare = node_energy(z).value - problem_.H.added_constant();
  // A sparse record does not show the levels between, where the terms may be larger.
  const long double part = problem_.every > 1 ? 1.0L : 0.03L;
  return std::max(std::abs(bare), part * problem_.H.sum_of_magnitudes(std::span<const Bounded>(stored(z))));
}

std::optional<Bounded> OrbitOracle::gamma(std::span<const double> z) const {
  const Vector state = stored(z);
  if (by_L_) {
    return by_L_->gamma(state);
  }
  const bool golden = problem_.lagrangian == Lagrangian::splitting && problem_.composition == "golden";
  if (problem_.lagrangian == Lagrangian::midpoint || golden) {
    // fᵀH''f is the second derivative of H along f.
    const Shape& gradient_shape = Shape::of(z.size(), 1);
    std::vector<Series> variables;
    for (std::size_t i = 0; i < z.size(); ++i) {
      variables.emplace_back(gradient_shape, state[i], i);
    }
    const Series H = problem_.H(std::span<const Series>(variables));
    Vector gradient;
    for (std::size_t i = 0; i < z.size(); ++i) {
      gradient.push_back(H.derivative(i));
    }
    const Vector velocity = times_J<Bounded>(gradient);
    std::vector<Series> line;
    for (std::size_t i = 0; i < z.size(); ++i) {
      line.emplace_back(Shape::of(1, 2), state[i]);
      line.back()[1] = velocity[i];
    }
    return Bounded(2.0L) * problem_.H(std::span<const Series>(line))[2];
  }
  if (problem_.lagrangian == Lagrangian::generating && problem_.F.empty() && terms() == 1) {
    constexpr std::size_t power = 2;  // of t in φ_t, the first left out: Γ is -24 φ_3
    const Generated phi = generate(state, power);
    return Bounded(-24.0L / static_cast<long double>(power + 1)) * phi.rate.coefficient(z.size(), power);
  }
  return std::nullopt;
}

std::vector<Bounded> OrbitOracle::invariants(std::span<const double> z) const {
  const Vector state = stored(z);
  Vector values;
  for (const auto& [name, formula] : problem_.invariants) {
    values.push_back(formula(std::span<const Bounded>(state)));
  }
  return values;
}

}  // namespace audit
