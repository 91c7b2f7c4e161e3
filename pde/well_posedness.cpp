#include <rubato/pde/well_posedness.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <limits>
#include <numbers>
#include <set>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/grids/reductions.hpp>
#include <rubato/grids/whole.hpp>
#include <rubato/pde/tuning.hpp>
#include <rubato/solve/small_matrices.hpp>

namespace rubato {

namespace {

using namespace tuning::well_posedness;

using Complex = std::complex<double>;
using Eigen::Index;
using Eigen::MatrixXcd;
using Eigen::MatrixXd;

/// ZᵀXZ, entries that are nothing but rounding of their terms set to 0.
MatrixXcd congruent(const MatrixXd& Z, const MatrixXcd& X) {
  const MatrixXcd z = Z.cast<Complex>();
  MatrixXcd result = solve::product(solve::product(z.transpose(), X), z);
  const MatrixXd terms = solve::product(solve::product(Z.transpose().cwiseAbs(), X.cwiseAbs()), Z.cwiseAbs());
  for (Index i = 0; i < result.size(); ++i) {
    if (std::abs(result(i)) <= cancelled_entry * terms(i)) {
      result(i) = 0.0;
    }
  }
  return result;
}

/// Unit vectors that complete the kernel, and the kernel: in these, M is 0 where it should be, exactly. In reduced
/// echelon form the first entry of a column is the only one of its row: that unit vector is left out.
MatrixXd basis_with_kernel(const MatrixXd& kernel, Index d) {
  std::vector<bool> pivot(static_cast<std::size_t>(d), false);
  for (Index c = 0; c < kernel.cols(); ++c) {
    Index row = 0;
    while (row + 1 < d && kernel(row, c) == 0.0) {
      ++row;
    }
    pivot[static_cast<std::size_t>(row)] = true;
  }
  MatrixXd Z = MatrixXd::Zero(d, d);
  Z.leftCols(kernel.cols()) = kernel;
  Index column = kernel.cols();
  for (Index f = 0; f < d && column < d; ++f) {
    if (!pivot[static_cast<std::size_t>(f)]) {
      Z(f, column++) = 1.0;
    }
  }
  return Z;
}

/// The roots of σⁿ + a[n-1] σⁿ⁻¹ + … + a[0], whose sizes are about 1, by the iteration of Weierstrass for all at once:
/// multiple ones come out as accurate as rounding in the coefficients leaves them.
std::vector<Complex> roots_of_monic(const std::vector<Complex>& a) {
  constexpr int most_iterations = 300;
  std::vector<Complex> roots;
  for (std::size_t i = 0; i < a.size(); ++i) {
    roots.push_back(std::pow(Complex(0.4, 0.9), static_cast<double>(i)));  // neither real nor on one circle
  }
  for (int iteration = 0; iteration < most_iterations; ++iteration) {
    double change = 0.0;
    for (std::size_t i = 0; i < roots.size(); ++i) {
      Complex value = 1.0;
      Complex others = 1.0;
      for (std::size_t j = a.size(); j > 0; --j) {
        value = value * roots[i] + a[j - 1];
        others *= j - 1 == i ? 1.0 : roots[i] - roots[j - 1];
      }
      const Complex step = others == 0.0 ? Complex(1e-8, 1e-8) : value / others;
      roots[i] -= step;
      change = std::max(change, std::abs(step) / std::max(1.0, std::abs(roots[i])));
    }
    if (!(change > 1e-14)) {
      break;
    }
  }
  return roots;
}

/// e^{2πi m/n}, m = 0, …, n - 1.
std::vector<Complex> unit_roots(std::size_t n) {
  std::vector<Complex> roots;
  for (std::size_t m = 0; m < n; ++m) {
    roots.push_back(std::polar(1.0, 2.0 * std::numbers::pi * static_cast<double>(m) / static_cast<double>(n)));
  }
  return roots;
}

/// Σ c_j σ^j, found from values on circles. Numbers of any size: each with a logarithm of its own.
class Polynomial {
public:
  /// \param circle unit_roots(n), which it reads, n > degree \param degree that it has at most: terms beyond show the
  /// rounding errors of the values
  Polynomial(const std::vector<Complex>& circle, std::size_t degree)
      : circle_(circle),
        most_(degree),
        coefficient_(circle.size(), 0.0),
        logarithm_(circle.size(), 0.0),
        share_(circle.size(), significant) {}

  [[nodiscard]] std::size_t size() const { return coefficient_.size(); }

  /// Values times e^logs at the unit roots times radius.
  void observe(double radius, const std::vector<Complex>& values, const std::vector<double>& logs) {
    const double largest = *std::ranges::max_element(logs);
    if (!std::isfinite(largest)) {
      return;
    }
    std::vector<Complex> scaled;
    for (std::size_t m = 0; m < size(); ++m) {
      scaled.push_back(values[m] * std::exp(logs[m] - largest));
    }
    std::vector<Complex> terms;  // c_j radius^j / e^largest
    double most = 0.0;
    for (std::size_t j = 0; j < size(); ++j) {
      Complex sum = 0.0;
      for (std::size_t m = 0; m < size(); ++m) {
        sum += scaled[m] * std::conj(circle_[j * m % size()]);
      }
      terms.push_back(sum / static_cast<double>(size()));
      most = std::max(most, std::abs(terms.back()));
    }
    double noise = 0.0;
    for (std::size_t j = most_ + 1; j < size(); ++j) {
      noise = std::max(noise, above_noise * std::abs(terms[j]) / most);
    }
    for (std::size_t j = 0; j <= most_; ++j) {
      if (const double share = std::abs(terms[j]) / most; share > std::max(share_[j], noise)) {
        share_[j] = share;
        coefficient_[j] = terms[j];
        logarithm_[j] = largest - static_cast<double>(j) * std::log(radius);
      }
    }
  }

  /// The geometric mean of the sizes of the roots that are not 0, if there are any.
  [[nodiscard]] std::optional<double> scale_of_roots() const {
    const std::size_t top = degree();
    const std::size_t low = lowest();
    if (top <= low) {
      return std::nullopt;
    }
    return std::exp((log_of(low) - log_of(top)) / static_cast<double>(top - low));
  }

  [[nodiscard]] std::vector<Complex> roots() const {
    const std::size_t low = lowest();
    const std::size_t top = degree();
    const auto scale = scale_of_roots();
    if (!scale) {
      return {};
    }
    std::vector<Complex> monic;  // in units of the scale
    for (std::size_t j = low; j < top; ++j) {
      const double log = logarithm_[j] - logarithm_[top] - static_cast<double>(top - j) * std::log(*scale);
      monic.push_back(coefficient_[j] == 0.0 ? 0.0 : coefficient_[j] / coefficient_[top] * std::exp(log));
    }
    std::vector<Complex> result(low, 0.0);
    for (const Complex& root : roots_of_monic(monic)) {
      result.push_back(root * *scale);
    }
    return result;
  }

private:
  [[nodiscard]] double log_of(std::size_t j) const { return std::log(std::abs(coefficient_[j])) + logarithm_[j]; }
  /// Of the last coefficient that is not 0, and of the first.
  [[nodiscard]] std::size_t degree() const {
    std::size_t top = size() - 1;
    while (top > 0 && coefficient_[top] == 0.0) {
      --top;
    }
    return top;
  }
  [[nodiscard]] std::size_t lowest() const {
    std::size_t low = 0;
    while (low < degree() && coefficient_[low] == 0.0) {
      ++low;
    }
    return low;
  }

  static constexpr double above_noise = 100.0;

  const std::vector<Complex>& circle_;
  std::size_t most_;
  std::vector<Complex> coefficient_;
  std::vector<double> logarithm_;  ///< of a factor beside each
  std::vector<double> share_;      ///< of the circle that showed it best
};

/// All waves of the same direction: σ as a function of the length of k.
class Pencil {
public:
  Pencil(const MatrixXd& M, const MatrixXd& kernel)
      : Z_(basis_with_kernel(kernel, M.rows())),
        M_(congruent(Z_, M.cast<Complex>())),
        rank_(static_cast<std::size_t>(M.rows() - kernel.cols())),
        circle_(unit_roots(static_cast<std::size_t>(M.rows()) + 1)) {}

  /// The polynomial det(σM - B) is known by its values on circles, each of which shows the coefficients that matter
  /// there; one more, through the roots' geometric mean, shows those of roots alike in size best.
  [[nodiscard]] std::vector<Complex> roots(const MatrixXcd& matrix) const {
    const MatrixXcd B = congruent(Z_, matrix);
    Polynomial polynomial(circle_, rank_);
    for (int power = -8; power <= 24; power += 2) {
      observe(polynomial, std::pow(10.0, power), B);
    }
    if (const auto scale = polynomial.scale_of_roots()) {
      observe(polynomial, *scale, B);
    }
    return polynomial.roots();
  }

private:
  /// A determinant as value · e^log, |value| = 1 or 0: elimination with row pivoting.
  static std::pair<Complex, double> determinant(MatrixXcd A) {
    const Index d = A.rows();
    Complex value = 1.0;
    double log = 0.0;
    for (Index k = 0; k < d; ++k) {
      Index pivot = k;
      for (Index i = k + 1; i < d; ++i) {
        pivot = std::abs(A(i, k)) > std::abs(A(pivot, k)) ? i : pivot;
      }
      const double size = std::abs(A(pivot, k));
      if (!(size > 0.0) || !std::isfinite(size)) {
        return {0.0, -std::numeric_limits<double>::infinity()};
      }
      value *= (pivot == k ? 1.0 : -1.0) * A(pivot, k) / size;
      log += std::log(size);
      for (Index j = k; j < d; ++j) {
        std::swap(A(k, j), A(pivot, j));
      }
      for (Index i = k + 1; i < d; ++i) {
        const Complex factor = A(i, k) / A(k, k);
        for (Index j = k; factor != 0.0 && j < d; ++j) {
          A(i, j) -= factor * A(k, j);
        }
      }
    }
    return {value, log};
  }

  void observe(Polynomial& polynomial, double radius, const MatrixXcd& B) const {
    std::vector<Complex> values;
    std::vector<double> logs;
    for (const Complex& root : circle_) {
      const auto [value, log] = determinant(radius * root * M_ - B);
      values.push_back(value);
      logs.push_back(log);
    }
    polynomial.observe(radius, values, logs);
  }

  MatrixXd Z_;
  MatrixXcd M_;
  std::size_t rank_;
  std::vector<Complex> circle_;
};

/// The axes and, in more dimensions, the diagonals, as factors of the largest wave number along each.
std::vector<std::array<double, 3>> directions_of(int dimensions) {
  std::vector<std::array<double, 3>> result;
  const std::array<double, 3> steps{1.0, 0.0, -1.0};
  for (const double x : steps) {
    for (const double y : steps) {
      for (const double z : steps) {
        const std::array<double, 3> direction{x, y, z};
        const auto* const first = std::ranges::find_if(direction, [](double c) { return c != 0.0; });
        const bool beyond = (dimensions < 2 && y != 0.0) || (dimensions < 3 && z != 0.0);
        if (first != direction.end() && *first > 0.0 && !beyond) {  // -k is the conjugate of k
          result.push_back(direction);
        }
      }
    }
  }
  return result;
}

/// The mean of a level and its values at some nodes, those where a field is least or greatest among them; 0 for fields
/// that a level does not have. Then the coordinates that S names.
std::vector<std::vector<double>> states_of(const MultisymplecticSystem& system, const grids::Grid& grid,
                                           const LatticeLevel& level) {
  const grids::Grid& whole = grids::whole_of(grid);
  const std::size_t nodes = whole.size();
  std::set<std::size_t> samples;
  for (std::size_t s = 0; s < sample_states; ++s) {
    // Multiples of the golden mean: not in step with the grid's rows.
    const double place = std::fmod(static_cast<double>(s) * std::numbers::phi, 1.0);
    samples.insert(std::min(nodes - 1, static_cast<std::size_t>(place * static_cast<double>(nodes))));
  }
  std::vector<double> mean(system.fields().size(), 0.0);
  for (int f = 0; f < system.field_count(); ++f) {
    if (!system.structure().at_midpoints(f)) {
      const std::span<const double> values = level.fields.field(f);
      mean[static_cast<std::size_t>(f)] = grids::sum(values) / static_cast<double>(nodes);
      const auto [least, greatest] = grids::extreme_nodes(values);
      samples.insert({least, greatest});
    }
  }
  const auto append_place = [&](std::size_t node, std::vector<double>& state) {
    for (const int axis : system.coordinates()) {
      state.push_back(whole.axis(axis).node(whole.place(node)[static_cast<std::size_t>(axis)]));
    }
  };
  append_place(nodes / 2, mean);
  std::vector<std::vector<double>> states{mean};
  for (const std::size_t node : samples) {
    std::vector<double>& state = states.emplace_back(grids::values_at(level.fields, node));
    for (int f = 0; f < system.field_count(); ++f) {
      if (system.structure().at_midpoints(f)) {
        state[static_cast<std::size_t>(f)] = 0.0;
      }
    }
    append_place(node, state);
  }
  return states;
}

struct Rates {
  double growth = 0.0;  ///< the largest Re σ
  double size = 0.0;    ///< the largest |σ|
};

Rates rates_of(const std::vector<Complex>& roots) {
  Rates rates;
  for (const Complex& sigma : roots) {
    rates.growth = std::max(rates.growth, sigma.real());
    rates.size = std::max(rates.size, std::abs(sigma));
  }
  return rates;
}

}  // namespace

std::vector<Complex> finite_roots(const MatrixXd& M, const MatrixXd& kernel, const MatrixXcd& B) {
  return Pencil(M, kernel).roots(B);
}

std::optional<ShortWaveGrowth> find_short_wave_growth(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                      const LatticeLevel& level) {
  const Pencil pencil(system.M(), system.structure().kernel);
  std::optional<ShortWaveGrowth> worst;
  bool about_mean = true;
  for (const std::vector<double>& state : states_of(system, grid, level)) {
    const MatrixXd hessian = system.hessian(state);
    if (!hessian.allFinite()) {
      continue;
    }
    for (const std::array<double, 3>& direction : directions_of(grid.dimensions())) {
      std::vector<double> wave;
      MatrixXd K = MatrixXd::Zero(hessian.rows(), hessian.cols());
      for (int a = 0; a < grid.dimensions(); ++a) {
        wave.push_back(direction[static_cast<std::size_t>(a)] * std::numbers::pi / grid.spacing(a));
        K += wave.back() * system.K(a);
      }
      const auto rates = [&](double times) {
        MatrixXcd B = hessian.cast<Complex>();
        B -= Complex(0.0, times) * K.cast<Complex>();
        return rates_of(pencil.roots(B));
      };
      const Rates far = rates(shorter);
      if (!(far.growth > beside_sigma * far.size)) {
        continue;
      }
      const Rates here = rates(1.0);
      const bool grows = here.growth > beside_sigma * here.size;
      if (!grows || far.growth < least_growth * here.growth || (worst && worst->rate >= here.growth)) {
        continue;
      }
      worst = ShortWaveGrowth{wave, here.growth, rates(2.0).growth, about_mean ? std::vector<double>() : state};
    }
    if ((worst && about_mean) || system.varying_hessian().empty()) {
      break;  // it does not take a special state
    }
    about_mean = false;
  }
  return worst;
}

std::string describe(const ShortWaveGrowth& growth, const grids::Grid& grid, const MultisymplecticSystem& system) {
  double square = 0.0;
  std::vector<std::string> along;
  for (int a = 0; a < grid.dimensions(); ++a) {
    const double k = growth.wave[static_cast<std::size_t>(a)];
    square += k * k;
    if (k != 0.0) {
      along.push_back(grid.axis(a).name);
    }
  }
  std::vector<std::string> state;
  for (const auto& [row, column] : system.varying_hessian()) {
    for (const int f : {row, column}) {
      const auto i = static_cast<std::size_t>(f);
      if (growth.state.empty()) {
        continue;
      }
      const std::string shown = fmt::format("{} = {:.3g}", system.fields()[i], growth.state[i]);
      if (std::ranges::find(state, shown) == state.end()) {
        state.push_back(shown);
      }
    }
  }
  return fmt::format(
      "this equation is ill-posed{}{}: the shorter a wave, the faster it grows, without bound. Waves of length {:.3g} "
      "along {}, the shortest of this grid, grow as exp({:.3g} t), and those of half that length as exp({:.3g} t): "
      "the solution is lost in them, on finer grids the sooner. A sign in S, M or K is likely to be wrong",
      state.empty() ? "" : " near ", fmt::join(state, ", "), 2.0 * std::numbers::pi / std::sqrt(square),
      fmt::join(along, " and "), growth.rate, growth.rate_of_half);
}

}  // namespace rubato
