#include <rubato/pde/wave_resolvent.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <numbers>
#include <random>
#include <utility>

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

/// A small complex matrix, real and imaginary parts apart, inverted in place by elimination with partial pivoting.
class Elimination {
public:
  /// \throws std::bad_alloc
  void take(const MatrixXcd& matrix) {
    n_ = static_cast<std::size_t>(matrix.rows());
    re_.resize(n_ * n_);
    im_.resize(n_ * n_);
    pivots_.resize(n_);
    for (std::size_t r = 0; r < n_; ++r) {
      for (std::size_t c = 0; c < n_; ++c) {
        const Complex entry = matrix(static_cast<Index>(r), static_cast<Index>(c));
        re_[r * n_ + c] = entry.real();
        im_[r * n_ + c] = entry.imag();
      }
    }
  }
  void invert() {
    determinant_ = 1.0;
    smallest_ = std::numeric_limits<double>::infinity();
    largest_ = 0.0;
    for (std::size_t k = 0; k < n_; ++k) {
      step(k);
    }
    for (std::size_t k = n_; k-- > 0;) {
      for (std::size_t r = 0; pivots_[k] != k && r < n_; ++r) {
        std::swap(re_[r * n_ + k], re_[r * n_ + pivots_[k]]);
        std::swap(im_[r * n_ + k], im_[r * n_ + pivots_[k]]);
      }
    }
  }
  [[nodiscard]] Complex entry(std::size_t row, std::size_t column) const {
    return {re_[row * n_ + column], im_[row * n_ + column]};
  }
  [[nodiscard]] Complex determinant() const { return determinant_; }
  [[nodiscard]] bool is_regular() const { return smallest_ > singular * singular * largest_; }

private:
  void step(std::size_t k) {
    const auto square = [this](std::size_t at) { return re_[at] * re_[at] + im_[at] * im_[at]; };
    std::size_t pivot = k;
    for (std::size_t r = k + 1; r < n_; ++r) {
      pivot = square(r * n_ + k) > square(pivot * n_ + k) ? r : pivot;
    }
    pivots_[k] = pivot;
    double *re = &re_[k * n_], *im = &im_[k * n_];
    if (pivot != k) {
      std::swap_ranges(re, re + n_, &re_[pivot * n_]);
      std::swap_ranges(im, im + n_, &im_[pivot * n_]);
      determinant_ = -determinant_;
    }
    const double size = square(k * n_ + k), a = re[k] / size, b = -im[k] / size;  // of its inverse
    determinant_ = {determinant_.real() * re[k] - determinant_.imag() * im[k],
                    determinant_.real() * im[k] + determinant_.imag() * re[k]};
    smallest_ = std::min(smallest_, size);
    largest_ = std::max(largest_, size);
    re[k] = 1.0;
    im[k] = 0.0;
    for (std::size_t c = 0; c < n_; ++c) {
      const double x = re[c];
      re[c] = x * a - im[c] * b;
      im[c] = x * b + im[c] * a;
    }
    for (std::size_t r = 0; r < n_; ++r) {
      double *to_re = &re_[r * n_], *to_im = &im_[r * n_];
      const double x = to_re[k], y = to_im[k];
      if (r == k || (x == 0.0 && y == 0.0)) {
        continue;
      }
      to_re[k] = to_im[k] = 0.0;
      for (std::size_t c = 0; c < n_; ++c) {
        to_re[c] -= x * re[c] - y * im[c];
        to_im[c] -= x * im[c] + y * re[c];
      }
    }
  }

  std::size_t n_ = 0;
  std::vector<double> re_, im_;
  std::vector<std::size_t> pivots_;
  Complex determinant_ = 1.0;
  double smallest_ = 0.0, largest_ = 0.0;  ///< |pivot|²
};

/// A coefficient summed up from values on a circle, and the size of what it is the sum of.
class Coefficient {
public:
  void add(Complex term) {
    sum_ += term;
    terms_ += std::abs(term.real()) + std::abs(term.imag());
  }
  [[nodiscard]] Complex sum() const { return sum_; }
  /// True if rounding explains such a number.
  [[nodiscard]] bool may_be_zero(double part) const { return !(std::abs(part) > rounding_of_coefficients * terms_); }

private:
  Complex sum_ = 0.0;
  double terms_ = 0.0;
};

/// The coefficients of a polynomial on each wave. Many are zero whatever the wave is, and sums leave rounding of them:
/// those that a sample of many waves shows as such are not written, and take no memory.
class Coefficients {
public:
  explicit Coefficients(WaveRows& rows)
      : rows_(rows), is_zero_(2 * static_cast<std::size_t>(rows.rows()), rows.waves() > few_waves ? 1 : 0) {}

  void look_at(int k, const Coefficient& value) {
    look_at(2 * k, value.sum().real(), value);
    look_at(2 * k + 1, value.sum().imag(), value);
  }
  void write(int k, std::size_t wave, const Coefficient& value) {
    write(2 * k, value.sum().real(), value, rows_.re.pointers()[static_cast<std::size_t>(k)][wave]);
    write(2 * k + 1, value.sum().imag(), value, rows_.im.pointers()[static_cast<std::size_t>(k)][wave]);
  }

private:
  void look_at(int place, double part, const Coefficient& value) {
    if (!value.may_be_zero(part)) {
      is_zero_[static_cast<std::size_t>(place)] = 0;
    }
  }
  void write(int place, double part, const Coefficient& value, double& to) const {
    if (is_zero_[static_cast<std::size_t>(place)] == 0 || !value.may_be_zero(part)) {
      to = part;
    }
  }

  WaveRows& rows_;
  std::vector<std::uint8_t> is_zero_;  ///< real and imaginary part of each coefficient
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
  const KernelConditions conditions = wave_conditions(system, L, 2.0 / radius);
  const KernelWaves kernel_waves(system.M(), conditions.kernel);
  const auto d = static_cast<Index>(fields_);
  has_mirror_ = conditions.count() == 0;
  const std::size_t entries = static_cast<std::size_t>(fields_) * static_cast<std::size_t>(fields_);
  const auto follows = [&](int row, int column) { return has_mirror_ && row > column; };
  for (int r = 0; r < fields_; ++r) {
    for (int c = 0; c < fields_; ++c) {  // no copies: those write, and take memory
      adjoint_.push_back(follows(r, c) ? WaveRows() : WaveRows(points, waves_));
    }
  }
  determinant_ = WaveRows(points, waves_);
  std::vector<bool> failed(waves_, false);
  std::vector<Complex> roots;  // of 1
  for (int j = 0; j < points; ++j) {
    roots.push_back(std::polar(1.0, 2.0 * std::numbers::pi * j / points));
  }

  std::vector<Coefficients> of_entries;
  for (WaveRows& rows : adjoint_) {
    of_entries.emplace_back(rows);
  }
  Coefficients of_determinant(determinant_);
  // Calls use(coefficients, k, wave, coefficient) for the waves of [begin, end).
  const auto find = [&](std::size_t begin, std::size_t end, const auto& use) {
    std::vector<Elimination> inverses(static_cast<std::size_t>(points));
    std::vector<Complex> values(static_cast<std::size_t>(points));
    for (std::size_t wave = begin; wave < end; ++wave) {
      const MatrixXcd D = symbols.derivatives(wave);
      const MatrixXcd constant = D - symbols.L();
      Border border{MatrixXcd(d, 0), MatrixXcd(0, d)};
      if (kernel_waves.has(D)) {
        border.columns = null_space(MatrixXcd((radius * M + constant).adjoint()));
        if (border.columns.cols() > 0) {
          border.rows = conditions.pins.cast<Complex>();
        }
      }
      if (border.columns.cols() != border.rows.rows()) {
        failed[wave] = true;
        continue;
      }
      const Index size = d + border.columns.cols();
      MatrixXcd P = MatrixXcd::Zero(size, size);
      P.topRightCorner(d, size - d) = border.columns;
      P.bottomLeftCorner(size - d, d) = border.rows;
      P.topLeftCorner(d, d) = constant + radius * M;
      // Pivots are compared, in units of the rows and fields in which entries are about 1.
      const solve::Equilibration units = solve::equilibrate(P.cwiseAbs());
      double scale = 0.0;
      for (int j = 0; j < points; ++j) {
        P.topLeftCorner(d, d) = constant + roots[static_cast<std::size_t>(j)] * radius * M;
        Elimination& inverse = inverses[static_cast<std::size_t>(j)];
        inverse.take(units.rows.asDiagonal() * P * units.columns.asDiagonal());
        inverse.invert();
        failed[wave] = failed[wave] || !inverse.is_regular();
        scale = std::max(scale, std::abs(inverse.determinant()));
      }
      // Coefficients from values on a circle; D is scaled, and A with it.
      for (int k = 0; k < points; ++k) {
        Coefficient determinant;
        for (int j = 0; j < points; ++j) {
          const Complex weight = std::conj(roots[static_cast<std::size_t>(j * k % points)]) / double(points);
          values[static_cast<std::size_t>(j)] = weight * (inverses[static_cast<std::size_t>(j)].determinant() / scale);
          determinant.add(values[static_cast<std::size_t>(j)]);
        }
        use(of_determinant, k, wave, determinant);
        for (int r = 0; r < fields_; ++r) {
          for (int c = follows(r, 0) ? r : 0; c < fields_; ++c) {
            Coefficient of_entry;
            for (std::size_t j = 0; j < values.size(); ++j) {
              const Complex entry = units.columns[r] * units.rows[c] *
                                    inverses[j].entry(static_cast<std::size_t>(r), static_cast<std::size_t>(c));
              const double a = values[j].real(), b = values[j].imag();
              of_entry.add({a * entry.real() - b * entry.imag(), a * entry.imag() + b * entry.real()});
            }
            use(of_entries[place(r, c)], k, wave, of_entry);
          }
        }
      }
    }
  };
  std::mt19937_64 random(30);
  for (std::size_t i = 0; i < sampled_waves && waves_ > few_waves; ++i) {
    const std::size_t wave = random() % waves_;
    find(wave, wave + 1, [](Coefficients& of, int k, std::size_t, const Coefficient& value) { of.look_at(k, value); });
  }
  grids::for_each_block(waves_, 64, [&](std::size_t begin, std::size_t end) {
    find(begin, end,
         [](Coefficients& of, int k, std::size_t wave, const Coefficient& value) { of.write(k, wave, value); });
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
  for (int r = 0; r < fields_; ++r) {
    for (int c = 0; c < r && has_mirror_; ++c) {
      zero_[place(r, c)] = zero_[place(c, r)];
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
  if (has_mirror_ && row > column) {
    polynomial(adjoint_[place(column, row)], -std::conj(mu), begin, count, re, im);
    std::transform(im, im + count, im, std::negate());
  } else {
    polynomial(adjoint_[place(row, column)], mu, begin, count, re, im);
  }
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
