#include <rubato/pde/dispersion.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <complex>
#include <cstdint>
#include <map>
#include <stdexcept>
#include <vector>

namespace rubato {

namespace {

/// Powers of ω, k_x, k_y, k_z.
using Powers = std::array<int, 4>;
using WavePolynomial = std::map<Powers, std::complex<double>>;

WavePolynomial product(const WavePolynomial& a, const WavePolynomial& b) {
  WavePolynomial result;
  for (const auto& [m, c] : a) {
    for (const auto& [n, d] : b) {
      Powers both;
      std::ranges::transform(m, n, both.begin(), std::plus());
      result[both] += c * d;
    }
  }
  return result;
}

/// By rows, each with the minors of what is left of the columns, which are kept by their set.
class Determinant {
public:
  explicit Determinant(std::vector<std::vector<WavePolynomial>> matrix) : matrix_(std::move(matrix)) {}

  [[nodiscard]] WavePolynomial value() { return minor((std::uint32_t{1} << matrix_.size()) - 1); }

private:
  const WavePolynomial& minor(std::uint32_t columns) {
    const auto known = minors_.find(columns);
    if (known != minors_.end()) {
      return known->second;
    }
    WavePolynomial sum;
    if (columns == 0) {
      sum[{}] = 1.0;
    } else {
      const std::size_t row = matrix_.size() - static_cast<std::size_t>(std::popcount(columns));
      double sign = 1.0;
      for (std::size_t column = 0; column < matrix_.size(); ++column) {
        const std::uint32_t bit = std::uint32_t{1} << column;
        if ((columns & bit) == 0) {
          continue;
        }
        if (!matrix_[row][column].empty()) {
          for (const auto& [powers, value] : product(matrix_[row][column], minor(columns & ~bit))) {
            sum[powers] += sign * value;
          }
        }
        sign = -sign;
      }
    }
    return minors_.emplace(columns, std::move(sum)).first->second;
  }

  std::vector<std::vector<WavePolynomial>> matrix_;
  std::map<std::uint32_t, WavePolynomial> minors_;
};

/// Without rounding, and without the powers that all terms share.
void reduce(WavePolynomial& polynomial) {
  constexpr double rounding = 1e-12;
  double size = 0.0;
  for (const auto& [powers, value] : polynomial) {
    size = std::max(size, std::abs(value));
  }
  std::erase_if(polynomial, [&](const auto& term) { return std::abs(term.second) <= rounding * size; });
  if (polynomial.empty()) {
    return;
  }
  Powers least = polynomial.begin()->first;
  for (const auto& [powers, value] : polynomial) {
    std::ranges::transform(least, powers, least.begin(), [](int a, int b) { return std::min(a, b); });
  }
  WavePolynomial rest;
  for (const auto& [powers, value] : polynomial) {
    Powers lower;
    std::ranges::transform(powers, least, lower.begin(), std::minus());
    rest[lower] = value;
  }
  polynomial = std::move(rest);
}

}  // namespace

DispersionRelation dispersion_relation(const MultisymplecticSystem& system, formula::Graph& graph) {
  const std::vector<double> rest(system.variables().size(), 0.0);
  const Eigen::MatrixXd hessian = system.hessian(rest);
  if (!hessian.allFinite()) {
    throw std::invalid_argument("S has no second derivatives at z = 0, about which waves are taken");
  }
  const auto d = static_cast<std::size_t>(system.field_count());
  std::vector<std::vector<WavePolynomial>> matrix(d, std::vector<WavePolynomial>(d));
  const std::complex<double> i(0.0, 1.0);
  for (std::size_t row = 0; row < d; ++row) {
    for (std::size_t column = 0; column < d; ++column) {
      const auto r = static_cast<Eigen::Index>(row), c = static_cast<Eigen::Index>(column);
      const auto put = [&](const Powers& powers, std::complex<double> value) {
        if (value != 0.0) {
          matrix[row][column][powers] = value;
        }
      };
      put({}, -hessian(r, c));
      put({1, 0, 0, 0}, -i * system.M()(r, c));
      for (int a = 0; a < system.directions(); ++a) {
        Powers powers{};
        powers.at(static_cast<std::size_t>(a) + 1) = 1;
        put(powers, i * system.K(a)(r, c));
      }
    }
  }
  WavePolynomial polynomial = Determinant(std::move(matrix)).value();
  reduce(polynomial);
  if (polynomial.empty()) {
    throw std::invalid_argument("waves about z = 0 are not determined");
  }
  const int highest =
      std::ranges::max_element(polynomial, {}, [](const auto& term) { return term.first[0]; })->first[0];
  // The coefficient of the term of that power with the least powers of k is 1.
  const auto leading = std::ranges::find_if(polynomial, [&](const auto& term) { return term.first[0] == highest; });
  const double scale = leading->second.real();
  std::array<formula::Expression, 4> variables;
  variables[0] = graph.variable("omega");
  for (int a = 0; a < 3; ++a) {
    variables.at(static_cast<std::size_t>(a) + 1) =
        graph.variable(system.directions() == 1 ? "k" : std::string("k_") + "xyz"[a]);
  }
  const auto sum_of = [&](bool is_left) {
    formula::Expression sum = graph.constant(0.0);
    for (auto term = polynomial.rbegin(); term != polynomial.rend(); ++term) {
      const auto& [powers, value] = *term;
      if ((powers[0] == highest) != is_left) {
        continue;
      }
      formula::Expression factor = graph.constant(std::abs(value.real() / scale));
      for (std::size_t v = 0; v < powers.size(); ++v) {
        if (powers.at(v) > 0) {
          factor = factor * pow(variables.at(v), static_cast<double>(powers.at(v)));
        }
      }
      const bool is_negative = (value.real() / scale < 0.0) == is_left;
      sum = !sum.is_constant(0.0) ? (is_negative ? sum - factor : sum + factor) : is_negative ? -factor : factor;
    }
    return sum;
  };
  return {sum_of(true), sum_of(false)};
}

}  // namespace rubato
