#include <rubato/pde/wave_resolvent.hpp>

#include <algorithm>
#include <array>
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

}  // namespace

WaveResolvent::Polynomial::Polynomial(int points, std::size_t waves) {
  for (int k = 0; k < points; ++k) {
    re.emplace_back(waves);
    im.emplace_back(waves);
  }
}

bool WaveResolvent::Polynomial::is_zero() const {
  const auto has_none = [](const grids::Buffer& values) { return values.size() == 0; };
  return std::ranges::all_of(re, has_none) && std::ranges::all_of(im, has_none);
}

void WaveResolvent::Polynomial::drop_zeros() {
  for (std::vector<grids::Buffer>* parts : {&re, &im}) {
    for (grids::Buffer& values : *parts) {
      if (std::ranges::all_of(std::as_const(values).span(), [](double value) { return value == 0.0; })) {
        values = {};
      }
    }
  }
}

/// Writes a polynomial. Of coefficients that are zero whatever the wave is, sums leave rounding: those that a sample of
/// many waves shows as such are not written.
class WaveResolvent::Coefficients {
public:
  explicit Coefficients(Polynomial& polynomial, std::size_t waves)
      : polynomial_(polynomial), is_zero_(2 * polynomial.re.size(), waves > few_waves ? 1 : 0) {}

  void look_at(std::size_t k, const Coefficient& value) {
    look_at(2 * k, value.sum().real(), value);
    look_at(2 * k + 1, value.sum().imag(), value);
  }
  void write(std::size_t k, std::size_t wave, const Coefficient& value) {
    write(2 * k, value.sum().real(), value, polynomial_.re[k][wave]);
    write(2 * k + 1, value.sum().imag(), value, polynomial_.im[k][wave]);
  }

private:
  void look_at(std::size_t place, double part, const Coefficient& value) {
    if (!value.may_be_zero(part)) {
      is_zero_[place] = 0;
    }
  }
  void write(std::size_t place, double part, const Coefficient& value, double& to) const {
    if (is_zero_[place] == 0 || !value.may_be_zero(part)) {
      to = part;
    }
  }

  Polynomial& polynomial_;
  std::vector<std::uint8_t> is_zero_;  ///< real and imaginary part of each coefficient
};

WaveResolvent::WaveResolvent(const MultisymplecticSystem& system, std::span<const std::vector<double>> numbers,
                             const MatrixXd& L, double radius, const std::vector<int>& fields)
    : fields_(system.field_count()), radius_(radius) {
  const Symbols symbols(system, numbers, L);
  waves_ = symbols.waves();
  const MatrixXcd M = system.M().cast<Complex>();
  const int points = static_cast<int>(rank(M)) + 1;  // odd
  const KernelConditions conditions = wave_conditions(system, L, 2.0 / radius);
  const KernelWaves kernel_waves(system.M(), conditions.kernel);
  const auto d = static_cast<Index>(fields_);
  has_mirror_ = conditions.count() == 0;
  adjoint_.resize(static_cast<std::size_t>(fields_) * static_cast<std::size_t>(fields_));
  for (const int r : fields) {
    for (const int c : fields) {
      if (!follows(r, c)) {
        adjoint_[place(r, c)] = Polynomial(points, waves_);
      }
    }
  }
  determinant_ = Polynomial(points, waves_);
  std::vector<bool> failed(waves_, false);
  std::vector<Complex> roots;  // of 1
  for (int j = 0; j < points; ++j) {
    roots.push_back(std::polar(1.0, 2.0 * std::numbers::pi * j / points));
  }

  std::vector<Coefficients> of_entries;
  for (Polynomial& polynomial : adjoint_) {
    of_entries.emplace_back(polynomial, waves_);
  }
  Coefficients of_determinant(determinant_, waves_);
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
        const auto power = static_cast<std::size_t>(k);
        use(of_determinant, power, wave, determinant);
        for (const int r : fields) {
          for (const int c : fields) {
            if (follows(r, c)) {
              continue;
            }
            Coefficient of_entry;
            for (std::size_t j = 0; j < values.size(); ++j) {
              const Complex entry = units.columns[r] * units.rows[c] *
                                    inverses[j].entry(static_cast<std::size_t>(r), static_cast<std::size_t>(c));
              const double a = values[j].real(), b = values[j].imag();
              of_entry.add({a * entry.real() - b * entry.imag(), a * entry.imag() + b * entry.real()});
            }
            use(of_entries[place(r, c)], power, wave, of_entry);
          }
        }
      }
    }
  };
  std::mt19937_64 random(30);
  for (std::size_t i = 0; i < sampled_waves && waves_ > few_waves; ++i) {
    const std::size_t wave = random() % waves_;
    find(wave, wave + 1,
         [](Coefficients& of, std::size_t k, std::size_t, const Coefficient& value) { of.look_at(k, value); });
  }
  grids::for_each_block(waves_, 64, [&](std::size_t begin, std::size_t end) {
    find(begin, end,
         [](Coefficients& of, std::size_t k, std::size_t wave, const Coefficient& value) { of.write(k, wave, value); });
  });
  if (std::ranges::find(failed, true) != failed.end()) {
    status_ = Status::undefined;
  }
  for (Polynomial& polynomial : adjoint_) {
    polynomial.drop_zeros();
  }
  determinant_.drop_zeros();
}

void WaveResolvent::inverse(Complex mu, std::size_t begin, std::size_t count, WaveBlock& inverse) const {
  evaluate(determinant_, mu, begin, count, inverse);
  invert(count, inverse.re, inverse.im);
}

void WaveResolvent::entry(int row, int column, Complex mu, std::size_t begin, std::size_t count,
                          WaveBlock& entry) const {
  if (follows(row, column)) {
    evaluate(adjoint_[place(column, row)], -std::conj(mu), begin, count, entry);
    std::transform(entry.im, entry.im + count, entry.im, std::negate());
  } else {
    evaluate(adjoint_[place(row, column)], mu, begin, count, entry);
  }
}

void WaveResolvent::evaluate(const Polynomial& polynomial, Complex mu, std::size_t begin, std::size_t count,
                             WaveBlock& value) const {
  static constexpr std::array<double, wave_block> zeros{};
  const auto from = [begin](const grids::Buffer& part) { return part.size() > 0 ? part.data() + begin : zeros.data(); };
  std::size_t k = polynomial.re.size();
  while (k > 1 && polynomial.re[k - 1].size() + polynomial.im[k - 1].size() == 0) {
    --k;
  }
  --k;
  std::copy_n(from(polynomial.re[k]), count, value.re);
  std::copy_n(from(polynomial.im[k]), count, value.im);
  while (k-- > 0) {
    horner(mu / radius_, from(polynomial.re[k]), from(polynomial.im[k]), count, value.re, value.im);
  }
}

}  // namespace rubato
