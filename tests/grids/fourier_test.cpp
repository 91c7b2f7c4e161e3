#include <omp.h>

#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include <catch2/catch.hpp>
#include <rubato/grids/box_operators.hpp>
#include <rubato/grids/field_set.hpp>
#include <rubato/grids/fourier.hpp>
#include <rubato/grids/reductions.hpp>

using namespace rubato::grids;

namespace {

double distance(std::span<const double> a, std::span<const double> b) {
  return max_abs_of(a.size(), [&](std::size_t i) { return a[i] - b[i]; });
}

FieldSet random_fields(int fields, std::size_t size) {
  FieldSet f(fields, size);
  std::mt19937_64 engine(4);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  for (double& v : f.all()) {
    v = uniform(engine);
  }
  return f;
}

}  // namespace

TEST_CASE("spectral derivatives are exact on resolved exponentials along every axis") {
  const auto counts = GENERATE(std::vector<std::size_t>{15}, std::vector<std::size_t>{16},
                               std::vector<std::size_t>{15, 12}, std::vector<std::size_t>{9, 10, 14});
  std::vector<Axis> axes;
  const char* names[] = {"x", "y", "z"};
  for (std::size_t a = 0; a < counts.size(); ++a) {
    axes.push_back({names[a], -1.0, -1.0 + 2.0 * static_cast<double>(a + 1), counts[a]});
  }
  const Grid g(axes);
  const SpectralDerivative derivative(g);
  for (int a = 0; a < g.dimensions(); ++a) {
    FieldSet u(2, g.size());
    FieldSet expected(2, g.size());
    FieldSet out(2, g.size());
    const double unit = 2.0 * std::numbers::pi / g.axis(a).length();
    for (int k = 0; 2 * k < static_cast<int>(g.cells(a)); ++k) {
      for (std::size_t i = 0; i < g.size(); ++i) {
        const auto place = g.place(i);
        const double x = g.axis(a).node(place[a]);
        const double other = 1.0 + static_cast<double>(place[(a + 1) % 3]);  // constant along the axis
        u.field(0)[i] = other * std::cos(unit * k * x + 0.3);
        expected.field(0)[i] = -other * unit * k * std::sin(unit * k * x + 0.3);
        u.field(1)[i] = other * std::sin(unit * k * x);
        expected.field(1)[i] = other * unit * k * std::cos(unit * k * x);
      }
      derivative(a, std::as_const(u).pointers(), out.pointers());
      // ε log n of the largest value (16), times the largest wave number.
      const double tolerance = 1e-15 * 16 * unit * static_cast<double>(g.cells(a)) + 1e-13;
      CHECK(distance(out.all(), expected.all()) < tolerance);
      derivative(a, std::as_const(u).pointers(), u.pointers());
      CHECK(distance(out.all(), u.all()) == 0.0);
      // Twin: the box's averaged difference is not exact for any k > 0.
      if (k > 0) {
        BoxOperator op{Along::identity, Along::identity, Along::identity};
        op[a] = Along::difference;
        apply(g, op, u.field(0).data(), out.field(0).data());
        CHECK_FALSE(distance(out.field(0), expected.field(0)) < tolerance);
      }
    }
  }
}

TEST_CASE("the derivative of the Nyquist mode is zero, and only of that one") {
  const Grid g({{"x", 0.0, 2.0, 16}});
  const SpectralDerivative derivative(g);
  std::vector<double> u(16);
  std::vector<double> out(16);
  for (std::size_t i = 0; i < 16; ++i) {
    u[i] = i % 2 == 0 ? 1.0 : -1.0;
  }
  derivative(0, u.data(), out.data());
  CHECK(max_abs(out) == 0.0);
  CHECK(derivative_symbol(8, g.axis(0)) == 0.0);
  CHECK(derivative_symbol(7, g.axis(0)).imag() == Approx(7 * std::numbers::pi));
  // An odd grid has no such mode: its highest is kept.
  const Grid odd({{"x", 0.0, 2.0, 17}});
  CHECK(derivative_symbol(8, odd.axis(0)).imag() == Approx(8 * std::numbers::pi));
}

TEST_CASE("transforms invert each other and separate the modes, in 1 to 3 dimensions") {
  const auto counts =
      GENERATE(std::vector<std::size_t>{5}, std::vector<std::size_t>{64}, std::vector<std::size_t>{7, 5},
               std::vector<std::size_t>{6, 8}, std::vector<std::size_t>{5, 6, 7}, std::vector<std::size_t>{8, 3, 4});
  std::vector<Axis> axes;
  const char* names[] = {"x", "y", "z"};
  for (std::size_t a = 0; a < counts.size(); ++a) {
    axes.push_back({names[a], 0.0, 1.0, counts[a]});
  }
  const Grid g(axes);
  Fourier fourier(g, 2);
  const FieldSet u = random_fields(2, g.size());
  FieldSet back(2, g.size());
  fourier.forward(u.pointers());
  // Against the definition.
  for (std::size_t mode = 0; mode < fourier.modes(); ++mode) {
    const auto k = fourier.wave(mode);
    std::complex<double> sum = 0.0;
    for (std::size_t i = 0; i < g.size(); ++i) {
      double phase = 0.0;
      for (int a = 0; a < g.dimensions(); ++a) {
        CHECK(2 * std::abs(k[a]) <= static_cast<std::ptrdiff_t>(g.cells(a)));
        phase -= wave_angle(k[a], g.cells(a)) * static_cast<double>(g.place(i)[a]);
      }
      sum += u.field(1)[i] * std::polar(1.0, phase);
    }
    // ε times the number of terms and the size of the phases.
    CHECK(std::abs(sum - fourier.at(1, mode)) < 1e-14 * static_cast<double>(g.size()));
  }
  fourier.inverse(back.pointers());
  CHECK(distance(u.all(), back.all()) < 1e-15 * 8);
  // Twin: one changed coefficient is seen.
  fourier.forward(u.pointers());
  fourier.at(0, 1) += 1e-10;
  fourier.inverse(back.pointers());
  CHECK(distance(u.all(), back.all()) > 1e-15 * 8);
}

TEST_CASE("symbols are those of the grid operators") {
  const Grid g({{"x", 0.0, 3.0, 15}, {"y", -1.0, 1.0, 9}});
  Fourier fourier(g, 2);
  FieldSet u = random_fields(2, g.size());
  apply(g, {Along::difference, Along::average, Along::identity}, u.field(0).data(), u.field(1).data());
  fourier.forward(std::as_const(u).pointers());
  for (std::size_t mode = 0; mode < fourier.modes(); ++mode) {
    const auto k = fourier.wave(mode);
    const auto d = difference_symbol(wave_angle(k[0], 15), g.spacing(0));
    const auto a = average_symbol(wave_angle(k[1], 9));
    const double size = 1e-14 * std::sqrt(static_cast<double>(g.size())) / g.spacing(0) * 4;
    CHECK(std::abs(fourier.at(1, mode) - d * a * fourier.at(0, mode)) < size);
    if (k[0] != 0) {  // twin: with the direction of the difference reversed
      CHECK(std::abs(fourier.at(1, mode) - std::conj(d) * a * fourier.at(0, mode)) > size);
    }
  }
}

TEST_CASE("transforms and derivatives are the same bit by bit for every number of threads and in every plan") {
  const Grid g({{"x", 0.0, 3.0, 45}, {"y", -1.0, 1.0, 33}});
  const FieldSet u = random_fields(3, g.size());
  const int threads = omp_get_max_threads();
  FieldSet first(3, g.size());
  for (const int count : {1, 2, 3, 7}) {
    omp_set_num_threads(count);
    Fourier fourier(g, 3);
    const SpectralDerivative derivative(g);
    FieldSet out(3, g.size());
    fourier.forward(u.pointers());
    for (std::size_t mode = 0; mode < fourier.modes(); ++mode) {
      for (int f = 0; f < 3; ++f) {
        fourier.at(f, mode) *= 1.1;
      }
    }
    fourier.inverse(out.pointers());
    derivative(1, std::as_const(out).pointers(), out.pointers());
    if (count == 1) {
      first = out;
    } else {
      CHECK(distance(first.all(), out.all()) == 0.0);
    }
  }
  omp_set_num_threads(threads);
}
