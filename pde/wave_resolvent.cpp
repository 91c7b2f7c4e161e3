#include <rubato/pde/wave_resolvent.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>

#include <rubato/grids/fourier.hpp>
#include <rubato/pde/kernel_conditions.hpp>
#include <rubato/pde/tuning.hpp>
#include <rubato/solve/small_matrices.hpp>

namespace rubato {

namespace {

using namespace tuning::wave_resolvent;

using Complex = std::complex<double>;
using Eigen::Index;
using Eigen::MatrixXcd;
using Eigen::MatrixXd;

/// The part Σ ik_a K_a - L of a wave.
class Symbols {
public:
  Symbols(const MultisymplecticSystem& system, std::span<const std::vector<double>> numbers, const MatrixXd& L)
      : numbers_(numbers), L_(L.cast<Complex>()) {
    for (int a = 0; a < system.directions(); ++a) {
      K_.push_back(system.K(a).cast<Complex>());
    }
  }
  [[nodiscard]] std::size_t waves() const { return numbers_.front().size(); }
  /// Σ ik_a K_a.
  [[nodiscard]] MatrixXcd derivatives(std::size_t wave) const {
    MatrixXcd sum = MatrixXcd::Zero(L_.rows(), L_.cols());
    for (std::size_t a = 0; a < K_.size(); ++a) {
      sum += Complex(0.0, numbers_[a][wave]) * K_[a];
    }
    return sum;
  }
  [[nodiscard]] const MatrixXcd& L() const { return L_; }

private:
  std::span<const std::vector<double>> numbers_;
  std::vector<MatrixXcd> K_;
  MatrixXcd L_;
};

/// Rows and columns that make P regular: with c the vectors that P maps to 0 at every μ and l those that Pᴴ does, P is
/// bordered by l and by the conditions that fix the multiple of c.
struct Border {
  MatrixXcd columns, rows;
};

}  // namespace

WaveResolvent::WaveResolvent(const MultisymplecticSystem& system, std::span<const std::vector<double>> numbers,
                             const MatrixXd& L, double radius)
    : fields_(system.field_count()), radius_(radius) {
  const Symbols symbols(system, numbers, L);
  waves_ = symbols.waves();
  const MatrixXcd M = system.M().cast<Complex>();
  degree_ = static_cast<int>(rank(M));  // even, so that the number of points is odd
  const int points = degree_ + 1;
  const KernelConditions conditions = step_conditions(system, 2.0 / radius);
  const auto d = static_cast<Index>(fields_);
  const std::size_t entries = static_cast<std::size_t>(fields_) * static_cast<std::size_t>(fields_);
  adjoint_.assign(entries, WaveRows(points, waves_));
  determinant_ = WaveRows(points, waves_);
  std::vector<bool> failed(waves_, false);

  grids::for_each_block(waves_, 64, [&](std::size_t begin, std::size_t end) {
    std::vector<MatrixXcd> inverses(static_cast<std::size_t>(points));
    std::vector<Complex> determinants(static_cast<std::size_t>(points));
    for (std::size_t wave = begin; wave < end; ++wave) {
      const MatrixXcd D = symbols.derivatives(wave);
      const MatrixXcd constant = D - symbols.L();
      Border border{MatrixXcd(d, 0), MatrixXcd(0, d)};
      if (conditions.count() > 0 &&
          solve::product(D, conditions.kernel.cast<Complex>()).isZero(1e-9 * (1.0 + D.norm()))) {
        border.columns = null_space(MatrixXcd((radius * M + constant).adjoint()));
        border.rows = conditions.pins.cast<Complex>();
      }
      if (border.columns.cols() != border.rows.rows()) {
        failed[wave] = true;
        continue;
      }
      const Index size = d + border.columns.cols();
      MatrixXcd P = MatrixXcd::Zero(size, size);
      P.topRightCorner(d, size - d) = border.columns;
      P.bottomLeftCorner(size - d, d) = border.rows;
      double scale = 0.0;
      for (int j = 0; j < points; ++j) {
        const double angle = 2.0 * std::numbers::pi * j / points;
        P.topLeftCorner(d, d) = constant + std::polar(radius, angle) * M;
        const solve::Inverse inverse = solve::inverse_of(P);
        failed[wave] = failed[wave] || !(inverse.smallest_pivot > singular * inverse.largest_pivot);
        const auto i = static_cast<std::size_t>(j);
        inverses[i] = inverse.matrix.topLeftCorner(d, d);
        determinants[i] = inverse.determinant;
        scale = std::max(scale, std::abs(determinants[i]));
      }
      // Coefficients from values on a circle; D is scaled, and A with it.
      for (int k = 0; k < points; ++k) {
        Complex sum = 0.0;
        MatrixXcd all = MatrixXcd::Zero(d, d);
        for (int j = 0; j < points; ++j) {
          const Complex weight = std::polar(1.0 / points, -2.0 * std::numbers::pi * j * k / points);
          const Complex value = weight * (determinants[static_cast<std::size_t>(j)] / scale);
          sum += value;
          all += value * inverses[static_cast<std::size_t>(j)];
        }
        determinant_.re.field(k)[wave] = sum.real();
        determinant_.im.field(k)[wave] = sum.imag();
        for (Index r = 0; r < d; ++r) {
          for (Index c = 0; c < d; ++c) {
            WaveRows& to = adjoint_[place(static_cast<int>(r), static_cast<int>(c))];
            to.re.field(k)[wave] = all(r, c).real();
            to.im.field(k)[wave] = all(r, c).imag();
          }
        }
      }
    }
  });
  if (std::ranges::find(failed, true) != failed.end()) {
    status_ = Status::undefined;
  }
  zero_.resize(entries);
  for (std::size_t e = 0; e < entries; ++e) {
    const auto is_zero = [](double value) { return value == 0.0; };
    zero_[e] = std::ranges::all_of(adjoint_[e].re.all(), is_zero) && std::ranges::all_of(adjoint_[e].im.all(), is_zero);
    if (zero_[e]) {
      adjoint_[e] = WaveRows();
    }
  }
}

void WaveResolvent::start(Complex mu, WaveRows& inverse) const {
  double* re = inverse.re.field(0).data();
  double* im = inverse.im.field(0).data();
  grids::for_each_block(waves_, grids::nodes_per_block, [&](std::size_t begin, std::size_t end) {
    polynomial(determinant_, mu, begin, end - begin, re + begin, im + begin);
    invert(end - begin, re + begin, im + begin);
  });
}

void WaveResolvent::entry(int row, int column, Complex mu, const WaveRows& inverse, std::size_t begin,
                          std::size_t count, double* re, double* im) const {
  polynomial(adjoint_[place(row, column)], mu, begin, count, re, im);
  multiply(inverse.re.field(0).data() + begin, inverse.im.field(0).data() + begin, count, re, im);
}

void WaveResolvent::polynomial(const WaveRows& coefficients, Complex mu, std::size_t begin, std::size_t count,
                               double* re, double* im) const {
  std::copy_n(coefficients.re.field(degree_).data() + begin, count, re);
  std::copy_n(coefficients.im.field(degree_).data() + begin, count, im);
  for (int k = degree_ - 1; k >= 0; --k) {
    horner(mu / radius_, coefficients.re.field(k).data() + begin, coefficients.im.field(k).data() + begin, count, re,
           im);
  }
}

}  // namespace rubato
