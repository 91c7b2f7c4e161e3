#include <catch2/catch.hpp>
#include <cmath>
#include <complex>
#include <numbers>
#include <random>
#include <vector>

#include <rubato/grids/fourier.hpp>
#include <rubato/grids/short_transform.hpp>

using rubato::grids::ShortTransform;

namespace {

std::vector<double> random_line(std::size_t n) {
  std::mt19937_64 random(n);
  std::uniform_real_distribution<double> value(-1.0, 1.0);
  std::vector<double> line(n);
  for (double& x : line) {
    x = value(random);
  }
  return line;
}

/// The largest |û(k) - Σ_j u_j e^{-2πi jk/n}|.
double off_definition(const std::vector<double>& u, const std::vector<double>& re, const std::vector<double>& im) {
  double largest = 0.0;
  const std::size_t n = u.size();
  for (std::size_t k = 0; 2 * k <= n; ++k) {
    std::complex<long double> sum = 0.0;
    for (std::size_t j = 0; j < n; ++j) {
      const long double angle =
          -2.0L * std::numbers::pi_v<long double> * static_cast<long double>(j * k % n) / static_cast<long double>(n);
      sum += static_cast<long double>(u[j]) * std::complex<long double>(std::cos(angle), std::sin(angle));
    }
    largest = std::max(largest, std::hypot(static_cast<double>(sum.real() - static_cast<long double>(re[k])),
                                           static_cast<double>(sum.imag() - static_cast<long double>(im[k]))));
  }
  return largest;
}

}  // namespace

TEST_CASE("short transforms are what they are defined as, and invert each other, for every length there is") {
  std::size_t lengths = 0;
  for (std::size_t n = 8; n <= ShortTransform::most_nodes; n += 8) {
    if (!ShortTransform::serves(n)) {
      continue;
    }
    ++lengths;
    CAPTURE(n);
    const ShortTransform transform(n);
    REQUIRE(transform.nodes() == n);
    const std::vector<double> u = random_line(n);
    // Nothing is written, and nothing of what is read counts, beyond the waves 0 … n/2.
    constexpr double mark = 1e300;
    std::vector<double> re(n / 2 + 3, mark), im(n / 2 + 3, mark), back(n + 2, mark);
    transform.forward(u.data(), re.data() + 1, im.data() + 1);
    for (const auto* row : {&re, &im}) {
      CHECK(row->front() == mark);
      CHECK(row->back() == mark);
    }
    // Each number is a sum of n terms below 1 in log n roundings: ε √n log n.
    const double rounding = 2.2e-16 * std::sqrt(static_cast<double>(n)) * std::log2(static_cast<double>(n));
    const std::vector<double> real(re.begin() + 1, re.end() - 1);
    std::vector<double> imaginary(im.begin() + 1, im.end() - 1);
    CHECK(off_definition(u, real, imaginary) < 4.0 * rounding);
    imaginary[3] *= 1.0 + 1e-12;
    CHECK(off_definition(u, real, imaginary) > (imaginary[3] == 0.0 ? 0.0 : 1e-13 * std::abs(imaginary[3])));
    im[1] = im[n / 2 + 1] = 7.0;  // of no grid function
    transform.inverse(re.data() + 1, im.data() + 1, back.data() + 1);
    CHECK(back.front() == mark);
    CHECK(back.back() == mark);
    double off = 0.0;
    for (std::size_t j = 0; j < n; ++j) {
      off = std::max(off, std::abs(back[j + 1] - u[j]));
    }
    CHECK(off < 4.0 * 2.2e-16 * std::log2(static_cast<double>(n)));
    re[1 + n / 4] += 1e-10 * static_cast<double>(n);  // twin
    transform.inverse(re.data() + 1, im.data() + 1, back.data() + 1);
    off = 0.0;
    for (std::size_t j = 0; j < n; ++j) {
      off = std::max(off, std::abs(back[j + 1] - u[j]));
    }
    CHECK(off > 1e-11);
  }
  if (lengths == 0) {
    WARN("this processor has no vectors of 64 bytes");
    return;
  }
  CHECK(lengths == 47);
}

TEST_CASE("short transforms are had on a line of a length that they serve, and nowhere else") {
  using rubato::grids::Fourier;
  using rubato::grids::Grid;
  const auto has_one = [](const std::vector<std::size_t>& cells) {
    std::vector<rubato::grids::Axis> axes;
    const char* names[] = {"x", "y"};
    for (std::size_t a = 0; a < cells.size(); ++a) {
      axes.push_back({names[a], 0.0, 1.0, cells[a]});
    }
    return Fourier(Grid(axes), 1).short_transform() != nullptr;
  };
  CHECK(has_one({64}) == ShortTransform::serves(64));
  CHECK_FALSE(has_one({64, 8}));
  CHECK_FALSE(has_one({88}));  // 11
  CHECK_FALSE(has_one({60}));
  CHECK_FALSE(has_one({48}));
  CHECK_FALSE(has_one({2048}));
}
