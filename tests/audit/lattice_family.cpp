#include "audit/lattice_family.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

namespace audit {

namespace {

using Complex = std::complex<long double>;
using Matrix = std::vector<std::vector<Complex>>;

constexpr int samples = 4;
/// Of the largest difference that some random roundings make: they might have been worse, and the library's transforms
/// and products take some operations more than one.
constexpr long double caution = 8.0L;

Matrix zeros(std::size_t n) {
  return Matrix(n, std::vector<Complex>(n));
}

Matrix identity(std::size_t n) {
  Matrix result = zeros(n);
  for (std::size_t i = 0; i < n; ++i) {
    result[i][i] = 1.0L;
  }
  return result;
}

Matrix product(const Matrix& a, const Matrix& b) {
  const std::size_t columns = b.empty() ? 0 : b[0].size();
  Matrix result(a.size(), std::vector<Complex>(columns));
  for (std::size_t i = 0; i < a.size(); ++i) {
    for (std::size_t k = 0; k < b.size(); ++k) {
      for (std::size_t j = 0; j < columns; ++j) {
        result[i][j] += a[i][k] * b[k][j];
      }
    }
  }
  return result;
}

/// By Gauss and Jordan.
Matrix inverse(Matrix a) {
  const std::size_t n = a.size();
  Matrix result = identity(n);
  for (std::size_t p = 0; p < n; ++p) {
    std::size_t largest = p;
    for (std::size_t r = p + 1; r < n; ++r) {
      largest = std::abs(a[r][p]) > std::abs(a[largest][p]) ? r : largest;
    }
    std::swap(a[p], a[largest]);
    std::swap(result[p], result[largest]);
    const Complex pivot = 1.0L / a[p][p];
    for (std::size_t c = 0; c < n; ++c) {
      a[p][c] *= pivot;
      result[p][c] *= pivot;
    }
    for (std::size_t r = 0; r < n; ++r) {
      if (const Complex factor = a[r][p]; r != p && factor != Complex(0.0L)) {
        for (std::size_t c = 0; c < n; ++c) {
          a[r][c] -= factor * a[p][c];
          result[r][c] -= factor * result[p][c];
        }
      }
    }
  }
  return result;
}

/// e^a: Taylor's series of a small part of it, squared again and again.
Matrix exponential(Matrix a) {
  long double size = 0.0L;
  for (const auto& row : a) {
    long double sum = 0.0L;
    for (const Complex& entry : row) {
      sum += std::abs(entry);
    }
    size = std::max(size, sum);
  }
  int squarings = 0;
  for (; size > 0.5L; size /= 2) {
    ++squarings;
  }
  for (auto& row : a) {
    for (Complex& entry : row) {
      entry = {std::ldexp(entry.real(), -squarings), std::ldexp(entry.imag(), -squarings)};
    }
  }
  Matrix result = identity(a.size()), term = result;
  for (int k = 1; k < 22; ++k) {
    term = product(term, a);
    for (std::size_t i = 0; i < a.size(); ++i) {
      for (std::size_t j = 0; j < a.size(); ++j) {
        term[i][j] /= static_cast<long double>(k);
        result[i][j] += term[i][j];
      }
    }
  }
  for (int i = 0; i < squarings; ++i) {
    result = product(result, result);
  }
  return result;
}

/// Σ_j Σ_e |V_ie V⁻¹_ej| of the eigenvectors of a, the largest: what sums over them lose, in units of their result.
long double cancellation(const Matrix& a) {
  const std::size_t m = a.size();
  // The characteristic polynomial by Faddeev and LeVerrier, its zeros all at once by Weierstrass.
  std::vector<Complex> polynomial = {1.0L};
  Matrix power = zeros(m);
  for (std::size_t k = 1; k <= m; ++k) {
    for (std::size_t i = 0; i < m; ++i) {
      power[i][i] += polynomial.back();
    }
    power = product(a, power);
    Complex trace;
    for (std::size_t i = 0; i < m; ++i) {
      trace += power[i][i];
    }
    polynomial.push_back(-trace / static_cast<long double>(k));
  }
  std::vector<Complex> roots;
  const long double radius = std::pow(std::abs(polynomial.back()), 1.0L / static_cast<long double>(m));
  for (std::size_t e = 0; e < m; ++e) {
    roots.push_back(std::polar(radius, 0.4L + 2 * std::numbers::pi_v<long double> * static_cast<long double>(e) /
                                                  static_cast<long double>(m)));
  }
  for (int round = 0; round < 500; ++round) {
    for (std::size_t e = 0; e < m; ++e) {
      Complex value = 0.0L, others = 1.0L;
      for (const Complex& coefficient : polynomial) {
        value = value * roots[e] + coefficient;
      }
      for (std::size_t other = 0; other < m; ++other) {
        others *= other == e ? 1.0L : roots[e] - roots[other];
      }
      roots[e] -= value / others;
    }
  }
  Matrix vectors = zeros(m);
  for (std::size_t e = 0; e < m; ++e) {
    Matrix shifted = a;
    for (std::size_t i = 0; i < m; ++i) {
      shifted[i][i] -= roots[e] * (1.0L + 1e-12L);
    }
    const Matrix near = inverse(shifted);  // of inverse iteration, twice
    Matrix vector(m, std::vector<Complex>(1, 1.0L));
    for (int round = 0; round < 3; ++round) {
      vector = product(near, vector);
      long double size = 0.0L;
      for (const auto& row : vector) {
        size = std::max(size, std::abs(row[0]));
      }
      for (auto& row : vector) {
        row[0] /= size;
      }
    }
    for (std::size_t i = 0; i < m; ++i) {
      vectors[i][e] = vector[i][0];
    }
  }
  const Matrix back = inverse(vectors);
  long double largest = 0.0L;
  for (std::size_t i = 0; i < m; ++i) {
    long double sum = 0.0L;
    for (std::size_t j = 0; j < m; ++j) {
      for (std::size_t e = 0; e < m; ++e) {
        sum += std::abs(vectors[i][e] * back[e][j]);
      }
    }
    largest = std::max(largest, sum);
  }
  return largest;
}

}  // namespace

LatticeFamily::LatticeFamily(const LatticeProblem& problem, const LatticeOracle& oracle)
    : problem_(problem),
      oracle_(oracle),
      d_(problem.fields.size()),
      nodes_(problem.nodes()),
      rule_(gauss_quadrature(static_cast<std::size_t>(problem.stages))),
      places_(lobatto_quadrature(static_cast<std::size_t>(problem.order_of_scheme() / 2) + 1)) {
  for (const Axis& axis : problem.axes) {
    auto& table = dft_.emplace_back(axis.cells, std::vector<Complex>(axis.cells));
    for (std::size_t j = 0; j < axis.cells; ++j) {
      for (std::size_t k = 0; k < axis.cells; ++k) {
        const long double angle = -2 * std::numbers::pi_v<long double> * static_cast<long double>(j * k % axis.cells) /
                                  static_cast<long double>(axis.cells);
        table[j][k] = {std::cos(angle), std::sin(angle)};
      }
    }
  }
  for (std::size_t wave = 0; wave < nodes_; ++wave) {
    derivatives_.push_back(derivatives(wave));
    Complex average = 1.0L;
    std::size_t rest = wave;
    for (std::size_t a = 0; a < problem.axes.size(); ++a) {
      // ½(1 + e^(ikΔx))
      const std::size_t k = rest % problem.axes[a].cells;
      average *= cells() ? 0.5L * (1.0L + std::conj(dft_[a][k][1])) : Complex(1.0L);
      rest /= problem.axes[a].cells;
    }
    averages_.push_back(average);
  }
  if (problem.lagrangian == LatticeProblem::Lagrangian::splitting) {
    L_ = hessian_at_zero();
  } else {
    Matrix a = zeros(rule_.c.size());
    for (std::size_t i = 0; i < a.size(); ++i) {
      for (std::size_t j = 0; j < a.size(); ++j) {
        a[i][j] = rule_.a[i][j];
      }
    }
    a_inverse_ = inverse(a);
    cancellation_ = cancellation(a_inverse_);
  }
}

long double LatticeFamily::noise() const {
  return 2.0L * static_cast<long double>(random_() >> 11) * 0x1p-53L - 1.0L;
}

bool LatticeFamily::moves(std::size_t field) const {
  return std::ranges::any_of(problem_.M,
                             [=](const MatrixEntry& entry) { return entry.row == field || entry.column == field; });
}

Matrix LatticeFamily::derivatives(std::size_t wave) const {
  Matrix sum = zeros(d_);
  std::size_t rest = wave;
  for (std::size_t a = 0; a < problem_.axes.size(); ++a) {
    const Axis& axis = problem_.axes[a];
    const std::size_t k = rest % axis.cells;
    rest /= axis.cells;
    const auto number =
        static_cast<long double>(k) - (2 * k > axis.cells ? static_cast<long double>(axis.cells) : 0.0L);
    Complex plus, minus;
    if (problem_.differences) {
      // δ⁺ on a wave, and δ⁻
      const long double angle = 2 * std::numbers::pi_v<long double> * number / static_cast<long double>(axis.cells);
      const Complex turn = {std::cos(angle), std::sin(angle)};
      plus = (turn - 1.0L) / static_cast<long double>(axis.width());
      minus = (1.0L - std::conj(turn)) / static_cast<long double>(axis.width());
    } else if (cells()) {  // of means over cells: (2/Δx) tan(kΔx/2)
      const auto width = static_cast<long double>(axis.width());
      plus = minus = {
          0.0L, 2 / width * std::tan(std::numbers::pi_v<long double> * number / static_cast<long double>(axis.cells))};
    } else {
      const bool sawtooth = 2 * k == axis.cells;
      plus = minus = {
          0.0L,
          sawtooth ? 0.0L : 2 * std::numbers::pi_v<long double> * number / static_cast<long double>(axis.length())};
    }
    for (const auto& [row, column, value] : problem_.K[a]) {
      sum[row][column] += static_cast<long double>(value) * plus;
      sum[column][row] -= static_cast<long double>(value) * minus;
    }
  }
  return sum;
}

LatticeFamily::Waves LatticeFamily::transformed(const Real& z) const {
  Waves waves;
  for (const auto& field : z) {
    waves.emplace_back(field.begin(), field.end());
  }
  std::size_t stride = 1;
  for (std::size_t a = 0; a < problem_.axes.size(); ++a) {
    const std::size_t count = problem_.axes[a].cells;
    for (auto& field : waves) {
      std::vector<Complex> next(nodes_);
      for (std::size_t i = 0; i < nodes_; ++i) {
        const std::size_t k = i / stride % count, first = i - k * stride;
        for (std::size_t j = 0; j < count; ++j) {
          next[i] += dft_[a][k][j] * field[first + j * stride];
        }
      }
      field = std::move(next);
    }
    stride *= count;
  }
  return waves;
}

LatticeFamily::Real LatticeFamily::real(const Waves& waves) const {
  Real result;
  for (auto field : waves) {
    std::size_t stride = 1;
    for (std::size_t a = 0; a < problem_.axes.size(); ++a) {
      const std::size_t count = problem_.axes[a].cells;
      std::vector<Complex> next(nodes_);
      for (std::size_t i = 0; i < nodes_; ++i) {
        const std::size_t k = i / stride % count, first = i - k * stride;
        for (std::size_t j = 0; j < count; ++j) {
          next[i] += std::conj(dft_[a][k][j]) * field[first + j * stride];
        }
      }
      field = std::move(next);
      stride *= count;
    }
    auto& values = result.emplace_back();
    for (const Complex& value : field) {
      values.push_back(value.real() / static_cast<long double>(nodes_));
    }
  }
  return result;
}

LatticeFamily::Real LatticeFamily::averaged(const Real& z) const {
  Waves waves = transformed(z);
  for (auto& field : waves) {
    for (std::size_t w = 0; w < nodes_; ++w) {
      field[w] *= averages_[w];
    }
  }
  return real(waves);
}

LatticeFamily::Real LatticeFamily::at_nodes(const Real& means) const {
  Waves waves = transformed(means);
  for (auto& field : waves) {
    for (std::size_t w = 0; w < nodes_; ++w) {
      field[w] /= averages_[w];
    }
  }
  return real(waves);
}

/// Of fields at midpoints a level has nothing.
LatticeFamily::Real LatticeFamily::start_of(const LatticeState& before) const {
  Real z(d_, std::vector<long double>(nodes_));
  for (std::size_t f = 0; f < d_; ++f) {
    for (std::size_t x = 0; x < nodes_; ++x) {
      z[f][x] = problem_.midpoint_only[f] ? 0.0L : before[f][x].value;
    }
  }
  return cells() ? averaged(z) : z;
}

LatticeFamily::Real LatticeFamily::applied(const Real& z) const {
  const Waves waves = transformed(z);
  Waves result(d_, std::vector<Complex>(nodes_));
  for (std::size_t w = 0; w < nodes_; ++w) {
    for (std::size_t r = 0; r < d_; ++r) {
      for (std::size_t c = 0; c < d_; ++c) {
        result[r][w] += derivatives_[w][r][c] * waves[c][w];
      }
    }
  }
  Real values = real(result);
  if (problem_.potential) {  // its slope, which the record leaves out
    for (const auto& [row, column, value] : problem_.K[0]) {
      for (long double& entry : values[row]) {
        entry += column == *problem_.potential ? value * oracle_.slope() : 0.0L;
      }
      for (long double& entry : values[column]) {
        entry -= row == *problem_.potential ? value * oracle_.slope() : 0.0L;
      }
    }
  }
  return values;
}

Matrix LatticeFamily::M() const {
  Matrix result = zeros(d_);
  for (const auto& [row, column, value] : problem_.M) {
    result[row][column] += static_cast<long double>(value);
    result[column][row] -= static_cast<long double>(value);
  }
  return result;
}

Matrix LatticeFamily::hessian_at_zero() const {
  const Shape& shape = Shape::of(d_, 2);
  std::vector<Series> z;
  for (std::size_t f = 0; f < d_; ++f) {
    z.emplace_back(shape, Bounded(0.0L), f);
  }
  const Series S = problem_.S(std::span<const Series>(z));
  Matrix result = zeros(d_);
  for (std::size_t r = 0; r < d_; ++r) {
    const Series slope = S.differentiated(r);
    for (std::size_t c = 0; c < d_; ++c) {
      result[r][c] = slope.derivative(c).value;
    }
  }
  return result;
}

LatticeFamily::Real LatticeFamily::gradient(const Real& z) const {
  const Shape& shape = Shape::of(d_, 1);
  Real result(d_, std::vector<long double>(nodes_));
  for (std::size_t i = 0; i < nodes_; ++i) {
    std::vector<Series> point;
    for (std::size_t f = 0; f < d_; ++f) {
      point.emplace_back(shape, Bounded(z[f][i]), f);
    }
    const Series S = problem_.S(std::span<const Series>(point));
    for (std::size_t f = 0; f < d_; ++f) {
      result[f][i] = S.derivative(f).value;
    }
  }
  return result;
}

long double LatticeFamily::sum_of_S(const Real& z) const {
  long double sum = 0.0L;
  std::vector<Bounded> point(d_);
  for (std::size_t i = 0; i < nodes_; ++i) {
    for (std::size_t f = 0; f < d_; ++f) {
      point[f] = z[f][i];
    }
    sum += problem_.S(std::span<const Bounded>(point)).value;
  }
  return sum;
}

// ---- Gauss collocation: M Ż_i + Σ K_a ∂_a Z_i = ∇S(Z_i), Z_i = z + Y_i, Ż = A⁻¹Y/h

std::vector<LatticeFamily::Real> LatticeFamily::stage_residual(const Real& z_0, const std::vector<Real>& Y,
                                                               long double h) const {
  const std::size_t m = Y.size();
  const Matrix mass = M();
  std::vector<Real> result;
  for (std::size_t i = 0; i < m; ++i) {
    Real Z = z_0;
    Real rate(d_, std::vector<long double>(nodes_));
    for (std::size_t f = 0; f < d_; ++f) {
      for (std::size_t x = 0; x < nodes_; ++x) {
        Z[f][x] += Y[i][f][x];
        for (std::size_t j = 0; j < m; ++j) {
          rate[f][x] += a_inverse_[i][j].real() * Y[j][f][x] / h;
        }
      }
    }
    Real rows = applied(Z);
    const Real slopes = gradient(Z);
    for (std::size_t r = 0; r < d_; ++r) {
      for (std::size_t x = 0; x < nodes_; ++x) {
        rows[r][x] -= slopes[r][x];
        for (std::size_t c = 0; c < d_; ++c) {
          rows[r][x] += mass[r][c].real() * rate[c][x];
        }
      }
    }
    result.push_back(std::move(rows));
  }
  return result;
}

/// What one evaluation of it in double may be off by.
std::vector<LatticeFamily::Real> LatticeFamily::stage_rounding(const LatticeState& z_0, const std::vector<Real>& Y,
                                                               long double h) const {
  const std::size_t m = Y.size();
  const Matrix mass = M();
  // Transforms leave an error in every wave that is the unit roundoff of the whole.
  long double highest = 0.0L;
  for (const Axis& axis : problem_.axes) {
    const auto width = static_cast<long double>(axis.width());
    highest = std::max(highest, (cells() ? 4 * static_cast<long double>(axis.cells) / std::numbers::pi_v<long double>
                                         : std::numbers::pi_v<long double>) /
                                    width);
  }
  std::vector<Real> result;
  for (std::size_t i = 0; i < m; ++i) {
    LatticeState Z = z_0;
    for (std::size_t f = 0; f < d_; ++f) {
      for (std::size_t x = 0; x < nodes_; ++x) {
        Z[f][x].value += Y[i][f][x];
        Z[f][x].error = unit_roundoff * (std::abs(Z[f][x].value) + std::abs(Y[i][f][x]));
      }
    }
    const LatticeState slopes = oracle_.gradient(Z);
    Real errors(d_, std::vector<long double>(nodes_));
    for (std::size_t r = 0; r < d_; ++r) {
      for (std::size_t c = 0; c < d_; ++c) {
        long double coupling = 0.0L;
        for (std::size_t a = 0; a < problem_.axes.size(); ++a) {
          for (const auto& [row, column, value] : problem_.K[a]) {
            coupling += (row == r && column == c) || (row == c && column == r) ? std::abs(value) : 0.0L;
          }
        }
        long double largest = 0.0L;
        for (std::size_t x = 0; x < nodes_; ++x) {
          largest = std::max(largest, std::abs(Z[c][x].value));
        }
        for (std::size_t x = 0; x < nodes_; ++x) {
          errors[r][x] += unit_roundoff * coupling * highest * largest;
          for (std::size_t j = 0; j < m; ++j) {
            errors[r][x] += unit_roundoff * std::abs(mass[r][c] * a_inverse_[i][j] * Y[j][c][x] / h);
          }
        }
      }
      for (std::size_t x = 0; x < nodes_; ++x) {
        errors[r][x] += slopes[r][x].error;
      }
    }
    result.push_back(std::move(errors));
  }
  return result;
}

/// The inverse of A⁻¹/h ⊗ M + I ⊗ (Σ ik_a K_a - S'') on every wave, S'' the mean over the nodes.
std::vector<Matrix> LatticeFamily::preconditioner(const Real& z, long double h) const {
  const std::size_t m = a_inverse_.size();
  const Shape& shape = Shape::of(d_, 2);
  Matrix mean = zeros(d_);
  for (std::size_t i = 0; i < nodes_; ++i) {
    std::vector<Series> point;
    for (std::size_t f = 0; f < d_; ++f) {
      point.emplace_back(shape, Bounded(z[f][i]), f);
    }
    const Series S = problem_.S(std::span<const Series>(point));
    for (std::size_t r = 0; r < d_; ++r) {
      const Series slope = S.differentiated(r);
      for (std::size_t c = 0; c < d_; ++c) {
        mean[r][c] += slope.derivative(c).value / static_cast<long double>(nodes_);
      }
    }
  }
  const Matrix mass = M();
  std::vector<Matrix> inverses;
  for (std::size_t w = 0; w < nodes_; ++w) {
    Matrix P = zeros(m * d_);
    for (std::size_t i = 0; i < m; ++i) {
      for (std::size_t r = 0; r < d_; ++r) {
        for (std::size_t c = 0; c < d_; ++c) {
          P[i * d_ + r][i * d_ + c] += derivatives_[w][r][c] - mean[r][c];
          for (std::size_t j = 0; j < m; ++j) {
            P[i * d_ + r][j * d_ + c] += a_inverse_[i][j] / h * mass[r][c];
          }
        }
      }
    }
    if (problem_.potential && w == 0) {  // a potential's mean is free, and held
      for (std::size_t i = 0; i < m; ++i) {
        const std::size_t held = i * d_ + *problem_.potential;
        for (std::size_t k = 0; k < m * d_; ++k) {
          P[held][k] = P[k][held] = k == held ? 1.0L : 0.0L;
        }
      }
    }
    inverses.push_back(inverse(P));
  }
  return inverses;
}

void LatticeFamily::correct(const std::vector<Real>& residual, const std::vector<Matrix>& inverses,
                            std::vector<Real>& Y) const {
  const std::size_t m = Y.size();
  std::vector<Waves> waves, corrections(m, Waves(d_, std::vector<Complex>(nodes_)));
  for (const Real& rows : residual) {
    waves.push_back(transformed(rows));
  }
  for (std::size_t w = 0; w < nodes_; ++w) {
    for (std::size_t i = 0; i < m * d_; ++i) {
      for (std::size_t j = 0; j < m * d_; ++j) {
        const bool held = problem_.potential && w == 0 && j % d_ == *problem_.potential;
        corrections[i / d_][i % d_][w] -= held ? 0.0L : inverses[w][i][j] * waves[j / d_][j % d_][w];
      }
    }
  }
  for (std::size_t i = 0; i < m; ++i) {
    const Real values = real(corrections[i]);
    for (std::size_t f = 0; f < d_; ++f) {
      for (std::size_t x = 0; x < nodes_; ++x) {
        Y[i][f][x] += values[f][x];
      }
    }
  }
}

void LatticeFamily::finish(const Real& z_0, const std::vector<Real>& Y, long double h, Taken& taken) const {
  const std::size_t m = Y.size();
  taken.end = z_0;
  taken.stages.assign(m, z_0);
  taken.rates.assign(m, Real(d_, std::vector<long double>(nodes_)));
  taken.energy = 0.0L;
  for (std::size_t f = 0; f < d_; ++f) {
    for (std::size_t x = 0; x < nodes_; ++x) {
      long double middle = 0.0L;
      for (std::size_t i = 0; i < m; ++i) {
        taken.stages[i][f][x] += Y[i][f][x];
        middle += rule_.value(i, 0.5L) * taken.stages[i][f][x];
        for (std::size_t j = 0; j < m; ++j) {
          taken.end[f][x] += rule_.b[i] * a_inverse_[i][j].real() * Y[j][f][x];
          taken.rates[i][f][x] += moves(f) ? a_inverse_[i][j].real() * Y[j][f][x] / h : 0.0L;
        }
      }
      taken.end[f][x] = problem_.midpoint_only[f] ? middle : taken.end[f][x];
    }
  }
  for (std::size_t i = 0; i < m; ++i) {
    // 𝓔 = Σ ΔV [S - ½ zᵀ Σ K_a ∂_a z]; of a sloping potential the whole derivative counts.
    const Real derived = applied(taken.stages[i]);
    long double sum = sum_of_S(taken.stages[i]);
    for (std::size_t f = 0; f < d_; ++f) {
      for (std::size_t x = 0; x < nodes_; ++x) {
        sum -= 0.5L * taken.stages[i][f][x] * derived[f][x];
      }
    }
    if (problem_.potential) {
      // (∂_x z)ᵀK₊z and -½ zᵀK∂_x z differ where a potential has a slope: by half of the slope's term.
      for (const auto& [row, column, value] : problem_.K[0]) {
        for (std::size_t x = 0; x < nodes_; ++x) {
          sum += row == *problem_.potential ? 0.5L * value * oracle_.slope() * taken.stages[i][column][x] : 0.0L;
        }
      }
    }
    taken.energy += rule_.b[i] * sum;
  }
  for (const Axis& axis : problem_.axes) {
    taken.energy *= static_cast<long double>(axis.width());
  }
}

LatticeFamily::Taken LatticeFamily::collocate(const LatticeState& before, long double h) const {
  const Real z_0 = start_of(before);
  const std::vector<Matrix> inverses = preconditioner(z_0, h);
  std::vector<Real> Y(rule_.c.size(), Real(d_, std::vector<long double>(nodes_)));
  long double last = HUGE_VALL;
  for (int round = 0;; ++round) {
    const std::vector<Real> old = Y;
    correct(stage_residual(z_0, Y, h), inverses, Y);
    long double change = 0.0L, size = 0.0L;
    for (std::size_t i = 0; i < Y.size(); ++i) {
      for (std::size_t f = 0; f < d_; ++f) {
        for (std::size_t x = 0; x < nodes_; ++x) {
          change = std::max(change, std::abs(Y[i][f][x] - old[i][f][x]));
          size = std::max(size, std::abs(Y[i][f][x]) + std::abs(z_0[f][x]));
        }
      }
    }
    if (change <= 1e-18L * size || (change <= 1e-14L * size && change >= 0.5L * last)) {
      break;
    }
    if (round > 300 || !std::isfinite(change)) {
      throw std::runtime_error("the oracle does not find the stages");
    }
    last = change;
  }
  Taken taken;
  finish(z_0, Y, h, taken);
  return taken;
}

void LatticeFamily::disturb_stages(const LatticeState& before, long double h, Taken& taken) const {
  const Real z_0 = start_of(before);
  std::vector<Real> Y = taken.stages;
  for (Real& stage : Y) {
    for (std::size_t f = 0; f < d_; ++f) {
      for (std::size_t x = 0; x < nodes_; ++x) {
        stage[f][x] -= z_0[f][x];
      }
    }
  }
  LatticeState level = before;
  for (std::size_t f = 0; f < d_; ++f) {
    for (std::size_t x = 0; x < nodes_; ++x) {
      level[f][x] = Bounded::stored(static_cast<double>(z_0[f][x]));
    }
  }
  std::vector<Real> rounding = stage_rounding(level, Y, h);
  for (Real& rows : rounding) {
    for (auto& row : rows) {
      for (long double& value : row) {
        value *= noise();
      }
    }
  }
  // Stages that are sums over the eigenvectors of A⁻¹ lose what cancels among these.
  for (std::size_t f = 0; f < d_; ++f) {
    long double largest = 0.0L;
    for (const Real& stage : Y) {
      for (const long double value : stage[f]) {
        largest = std::max(largest, std::abs(value));
      }
    }
    for (Real& stage : Y) {
      for (long double& value : stage[f]) {
        value += cancellation_ * unit_roundoff * noise() * largest;
      }
    }
  }
  correct(rounding, preconditioner(z_0, h), Y);
  finish(z_0, Y, h, taken);
}

// ---- Splittings

void LatticeFamily::drift(Real& z, long double tau, bool disturbed) const {
  std::vector<std::size_t> x, y;
  for (std::size_t f = 0; f < d_; ++f) {
    (moves(f) ? x : y).push_back(f);
  }
  const Matrix mass = M();
  const auto part = [](const Matrix& from, const std::vector<std::size_t>& rows,
                       const std::vector<std::size_t>& columns) {
    Matrix result(rows.size(), std::vector<Complex>(columns.size()));
    for (std::size_t i = 0; i < rows.size(); ++i) {
      for (std::size_t j = 0; j < columns.size(); ++j) {
        result[i][j] = from[rows[i]][columns[j]];
      }
    }
    return result;
  };
  const Matrix inverse_mass = inverse(part(mass, x, x));
  Waves waves = transformed(z);
  long double largest = 0.0L;
  for (const auto& field : waves) {
    for (const Complex& value : field) {
      largest = std::max(largest, std::abs(value));
    }
  }
  for (std::size_t w = 0; w < nodes_; ++w) {
    // M x_t = (L - ΣiKk) z, 0 = the same of the others
    Matrix B = derivatives_[w];
    for (std::size_t r = 0; r < d_; ++r) {
      for (std::size_t c = 0; c < d_; ++c) {
        B[r][c] = L_[r][c] - B[r][c];
      }
    }
    Matrix G = part(B, x, x);
    Matrix C(y.size(), std::vector<Complex>(x.size()));
    if (!y.empty()) {
      C = product(inverse(part(B, y, y)), part(B, y, x));
      const Matrix through = product(part(B, x, y), C);
      for (std::size_t i = 0; i < x.size(); ++i) {
        for (std::size_t j = 0; j < x.size(); ++j) {
          G[i][j] -= through[i][j];
        }
      }
    }
    Matrix A = product(inverse_mass, G);
    long double angle = 0.0L;
    for (auto& row : A) {
      for (Complex& entry : row) {
        entry *= tau;
        angle = std::max(angle, std::abs(entry));
      }
    }
    const Matrix flow = exponential(A);
    std::vector<Complex> moved(x.size());
    for (std::size_t i = 0; i < x.size(); ++i) {
      for (std::size_t j = 0; j < x.size(); ++j) {
        // An entry is off by what the angle of its wave is rounded by, and by its own rounding.
        const long double off = disturbed ? unit_roundoff * noise() * (1 + angle) : 0.0L;
        moved[i] += flow[i][j] * (1 + off) * waves[x[j]][w];
      }
    }
    for (std::size_t i = 0; i < x.size(); ++i) {
      waves[x[i]][w] = moved[i];
    }
    for (std::size_t i = 0; i < y.size(); ++i) {
      waves[y[i]][w] = 0.0L;
      for (std::size_t j = 0; j < x.size(); ++j) {
        waves[y[i]][w] -= C[i][j] * moved[j];
      }
    }
  }
  z = real(waves);
}

void LatticeFamily::kick(Real& z, long double tau) const {
  // Of N = S - ½ zᵀLz, the fields without an equation of motion 0.
  Real point = z;
  for (std::size_t f = 0; f < d_; ++f) {
    if (!moves(f)) {
      std::ranges::fill(point[f], 0.0L);
    }
  }
  Real force = gradient(point);
  for (std::size_t r = 0; r < d_; ++r) {
    for (std::size_t c = 0; c < d_; ++c) {
      for (std::size_t i = 0; i < nodes_; ++i) {
        force[r][i] -= L_[r][c].real() * point[c][i];
      }
    }
  }
  for (const auto& [p, q, value] : problem_.M) {
    const auto m = static_cast<long double>(value);
    for (std::size_t i = 0; i < nodes_; ++i) {
      if (problem_.turns) {
        // m q_t = N_p, -m p_t = N_q, with N of p² + q²: a turn.
        const long double squares = z[p][i] * z[p][i] + z[q][i] * z[q][i];
        const long double angle =
            squares > 0 ? tau * (z[p][i] * force[p][i] + z[q][i] * force[q][i]) / (m * squares) : 0.0L;
        const long double c = std::cos(angle), s = std::sin(angle), old = z[p][i];
        z[p][i] = old * c - z[q][i] * s;
        z[q][i] = z[q][i] * c + old * s;
      } else {
        z[q][i] += tau * force[p][i] / m;
        z[p][i] -= tau * force[q][i] / m;
      }
    }
  }
}

long double LatticeFamily::wave_energy(const Real& z) const {
  const Real derived = applied(z);
  long double sum = 0.0L;
  for (std::size_t r = 0; r < d_; ++r) {
    for (std::size_t i = 0; i < nodes_; ++i) {
      sum -= 0.5L * z[r][i] * derived[r][i];
      for (std::size_t c = 0; c < d_; ++c) {
        sum += 0.5L * z[r][i] * L_[r][c].real() * z[c][i];
      }
    }
  }
  return sum;
}

long double LatticeFamily::rest_energy(const Real& z) const {
  Real point = z;
  for (std::size_t f = 0; f < d_; ++f) {
    if (!moves(f)) {
      std::ranges::fill(point[f], 0.0L);
    }
  }
  long double sum = sum_of_S(point);
  for (std::size_t r = 0; r < d_; ++r) {
    for (std::size_t c = 0; c < d_; ++c) {
      for (std::size_t i = 0; i < nodes_; ++i) {
        sum -= 0.5L * point[r][i] * L_[r][c].real() * point[c][i];
      }
    }
  }
  return sum;
}

LatticeFamily::Taken LatticeFamily::compose(Real z, long double h, bool disturbed) const {
  Taken taken;
  const auto disturb = [&] {
    for (auto& field : z) {
      long double largest = 0.0L;
      for (const long double value : field) {
        largest = std::max(largest, std::abs(value));
      }
      for (long double& value : field) {
        value += disturbed ? unit_roundoff * noise() * largest : 0.0L;
      }
    }
  };
  disturb();
  bool stale = true;  // the fields that follow from the others
  for (const CompositionPart& part : composition_parts(problem_.composition)) {
    const long double off = disturbed ? unit_roundoff * noise() : 0.0L;
    if (part.drift) {
      if (stale) {
        drift(z, 0.0L, false);
      }
      taken.energy += part.length * wave_energy(z);
      drift(z, part.length * (1 + off) * h, disturbed);
    } else {
      taken.energy += part.length * rest_energy(z);
      kick(z, part.length * (1 + off) * h);
    }
    stale = !part.drift;
    disturb();
  }
  drift(z, 0.0L, false);
  for (const Axis& axis : problem_.axes) {
    taken.energy *= static_cast<long double>(axis.width());
  }
  taken.end = std::move(z);
  return taken;
}

/// At the nodes of Lobatto's quadrature, one more than half the order, with the levels for its ends: where steps of
/// these lengths lead, and the rates that the equation has there.
void LatticeFamily::add_places(const Real& z, long double h, bool disturbed, Taken& taken) const {
  taken.stages.clear();
  taken.rates.clear();
  std::vector<std::size_t> x;
  for (std::size_t f = 0; f < d_; ++f) {
    if (moves(f)) {
      x.push_back(f);
    }
  }
  const Matrix mass = M();
  Matrix of_moving(x.size(), std::vector<Complex>(x.size()));
  for (std::size_t i = 0; i < x.size(); ++i) {
    for (std::size_t j = 0; j < x.size(); ++j) {
      of_moving[i][j] = mass[x[i]][x[j]];
    }
  }
  const Matrix inverse_mass = inverse(of_moving);
  for (const long double c : places_.c) {
    const Real place = compose(z, c * h, disturbed).end;
    const Real derived = applied(place), slopes = gradient(place);
    Real rate(d_, std::vector<long double>(nodes_));
    for (std::size_t i = 0; i < x.size(); ++i) {
      for (std::size_t j = 0; j < x.size(); ++j) {
        for (std::size_t n = 0; n < nodes_; ++n) {
          rate[x[i]][n] += inverse_mass[i][j].real() * (slopes[x[j]][n] - derived[x[j]][n]);
        }
      }
    }
    taken.stages.push_back(place);
    taken.rates.push_back(std::move(rate));
  }
}

FamilyStep LatticeFamily::step(const LatticeState& before, double h) const {
  const bool splitting = problem_.lagrangian == LatticeProblem::Lagrangian::splitting;
  Real z(d_, std::vector<long double>(nodes_));
  for (std::size_t f = 0; f < d_; ++f) {
    for (std::size_t x = 0; x < nodes_; ++x) {
      z[f][x] = before[f][x].value;
    }
  }
  Taken taken = splitting ? compose(z, h, false) : collocate(before, h);
  const bool has_laws = splitting && !problem_.differences;
  if (has_laws) {
    add_places(z, h, false, taken);
  }
  std::vector<long double> off(d_);
  long double energy_off = 0.0L;
  std::vector<std::vector<long double>> stage_off(taken.stages.size(), std::vector<long double>(d_)),
      rate_off = stage_off;
  const auto largest_difference = [&](const std::vector<long double>& a, const std::vector<long double>& b) {
    long double largest = 0.0L;
    for (std::size_t x = 0; x < nodes_; ++x) {
      largest = std::max(largest, std::abs(a[x] - b[x]));
    }
    return largest;
  };
  const auto put_at_nodes = [&](Taken& step) {
    for (std::size_t i = 0; cells() && i < step.stages.size(); ++i) {
      step.stages[i] = at_nodes(step.stages[i]);
      step.rates[i] = at_nodes(step.rates[i]);
    }
  };
  const Taken in_cells = taken;
  put_at_nodes(taken);
  for (int sample = 0; sample < samples; ++sample) {
    Taken other = in_cells;
    if (splitting) {
      other = compose(z, h, true);
      if (has_laws) {
        add_places(z, h, true, other);
      }
    } else {
      disturb_stages(before, h, other);
      put_at_nodes(other);
    }
    energy_off = std::max(energy_off, std::abs(other.energy - taken.energy));
    for (std::size_t f = 0; f < d_; ++f) {
      off[f] = std::max(off[f], largest_difference(taken.end[f], other.end[f]));
      for (std::size_t i = 0; i < taken.stages.size(); ++i) {
        stage_off[i][f] = std::max(stage_off[i][f], largest_difference(taken.stages[i][f], other.stages[i][f]));
        rate_off[i][f] = std::max(rate_off[i][f], largest_difference(taken.rates[i][f], other.rates[i][f]));
      }
    }
  }
  const auto bounded = [&](const Real& values, const std::vector<long double>& errors) {
    LatticeState state(d_);
    for (std::size_t f = 0; f < d_; ++f) {
      for (const long double value : values[f]) {
        state[f].emplace_back(value, caution * errors[f] + unit_roundoff * std::abs(value));
      }
    }
    return state;
  };
  FamilyStep result;
  result.end = bounded(taken.end, off);
  // A sum over the nodes is good to a few units of its terms.
  result.energy = {taken.energy, caution * energy_off +
                                     unit_roundoff * (std::abs(taken.energy) + oracle_.magnitude_of_terms(before))};
  for (std::size_t i = 0; i < taken.stages.size(); ++i) {
    result.places.push_back({(splitting ? places_ : rule_).b[i], bounded(taken.stages[i], stage_off[i]),
                             bounded(taken.rates[i], rate_off[i])});
  }
  return result;
}

}  // namespace audit
