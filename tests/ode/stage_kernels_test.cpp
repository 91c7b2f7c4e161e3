#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include <catch2/catch.hpp>
#include <rubato/base/larger.hpp>
#include <rubato/ode/gauss_scheme.hpp>
#include <rubato/ode/stage_kernels.hpp>
#include <rubato/ode/stage_slopes.hpp>
#include <rubato/variation/gauss_tableau.hpp>

#include "systems.hpp"

using rubato::Hamiltonian;
using rubato::StageSlopes;
using rubato::Status;

namespace {

using Numbers = std::vector<double>;

/// What the kernels do, one number after the other.
struct PlainKernels {
  std::size_t lanes, stages;

  [[nodiscard]] double sum(const Numbers& from, const Numbers& table, std::size_t row, std::size_t place) const {
    double even = 0.0, odd = 0.0;
    for (std::size_t j = 0; j < stages; ++j) {
      (j % 2 == 0 ? even : odd) += from[row * lanes + j] * table[j * lanes + place];
    }
    return even + odd;
  }
  [[nodiscard]] double relative_size(const Numbers& Y, const Numbers& correction, const Numbers& floor) const {
    double result = 0.0;
    for (std::size_t r = 0; r < floor.size(); ++r) {
      double size = 0.0, scale = floor[r];
      for (std::size_t i = r * lanes; i < (r + 1) * lanes; ++i) {
        size = std::max(size, std::abs(correction[i]));
        scale = std::max({scale, std::abs(correction[i]), std::abs(Y[i])});
      }
      result = rubato::larger(result, size == 0.0 ? 0.0 : size / scale);
    }
    return result;
  }
};

}  // namespace

TEST_CASE("kernels over stages do what their loops say, bit for bit") {
  std::mt19937_64 engine(7);
  std::uniform_real_distribution<double> random(-1.0, 1.0);
  const auto numbers = [&](std::size_t count) {
    Numbers all(count);
    std::ranges::generate(all, [&] { return random(engine); });
    return all;
  };
  for (std::size_t stages = 1; stages <= 8; ++stages) {
    const int m = static_cast<int>(stages);
    const auto lanes = static_cast<std::size_t>(rubato::stages::row_length(m));
    REQUIRE(lanes >= stages);
    const PlainKernels plain{lanes, stages};
    for (std::size_t rows = 1; rows <= 7; ++rows) {
      INFO(stages << " stages, " << rows << " rows");
      const Numbers from = numbers(rows * lanes), first = numbers(stages * lanes), second = numbers(stages * lanes);
      const Numbers high = numbers(rows), low = numbers(rows), floor = numbers(rows);
      const Numbers Y = numbers(rows * lanes);
      const double h = random(engine);
      Numbers one(rows * lanes), two = one, placed = one, mended = Y, correction = one, stages_there = one;
      Numbers begun = one, summed = one;
      rubato::stages::combine(rows, m, from.data(), first.data(), nullptr, h, one.data());
      rubato::stages::combine(rows, m, from.data(), first.data(), second.data(), h, two.data());
      rubato::stages::place(rows, m, high.data(), low.data(), Y.data(), placed.data());
      const double size =
          rubato::stages::correct(rows, m, from.data(), first.data(), second.data(), h, floor.data(), high.data(),
                                  low.data(), mended.data(), correction.data(), stages_there.data());
      const Numbers base = numbers(rows * lanes), rest = numbers(rows * lanes);
      Numbers gathered = one, moved_to = Y, moved_by = one, there = one;
      rubato::stages::gather(rows, m, from.data(), first.data(), second.data(), h, base.data(), rest.data(),
                             gathered.data());
      const double by = rubato::stages::mend(rows, m, from.data(), h, floor.data(), high.data(), low.data(),
                                             moved_to.data(), moved_by.data(), there.data());
      rubato::stages::begin(rows, m, from.data(), first.data(), h, Y.data(), 0.7, begun.data(), summed.data());
      std::size_t wrong = 0, moved = 0;
      for (std::size_t i = 0; i < rows * lanes; ++i) {
        const std::size_t r = i / lanes, place = i % lanes;
        const double a = plain.sum(from, first, r, place), b = plain.sum(from, second, r, place);
        wrong += one[i] != h * a;
        wrong += two[i] != h * (a + b);
        wrong += placed[i] != high[r] + (low[r] + Y[i]);
        wrong += correction[i] != h * (a + b) - Y[i];
        wrong += mended[i] != h * (a + b);
        wrong += stages_there[i] != high[r] + (low[r] + h * (a + b));
        wrong += begun[i] != h * a || summed[i] != h * a + 0.7 * Y[i];
        wrong += gathered[i] != base[i] + (rest[i] + h * (a + b));
        wrong += moved_to[i] != h * from[i];
        wrong += moved_by[i] != h * from[i] - Y[i];
        wrong += there[i] != high[r] + (low[r] + h * from[i]);
        moved += two[i] != h * a;  // the twin: the second table counts
      }
      CHECK(wrong == 0);
      CHECK(moved == rows * lanes);
      CHECK(size == plain.relative_size(Y, correction, floor));
      CHECK(rubato::stages::relative_size(rows, m, Y.data(), correction.data(), floor.data()) == size);
      CHECK(by == plain.relative_size(Y, moved_by, floor));
      Numbers gone = from;
      gone.back() = std::numeric_limits<double>::quiet_NaN();
      CHECK(std::isnan(rubato::stages::mend(rows, m, gone.data(), h, floor.data(), high.data(), low.data(),
                                            moved_to.data(), moved_by.data(), there.data())));
      for (const std::size_t place : {std::size_t{0}, rows * lanes - 1}) {
        Numbers undefined = correction;
        undefined[place] = std::numeric_limits<double>::quiet_NaN();
        CHECK(std::isnan(rubato::stages::relative_size(rows, m, Y.data(), undefined.data(), floor.data())));
      }
      const Numbers none(rows * lanes), nothing(rows);
      CHECK(rubato::stages::relative_size(rows, m, none.data(), none.data(), nothing.data()) == 0.0);
    }
  }
}

TEST_CASE("slopes at the stages are the same of H as a whole and by halves") {
  const Hamiltonian H = systems::henon_heiles().hamiltonian;
  StageSlopes::Rows Z = StageSlopes::Rows::Random(4, 8), f = StageSlopes::Rows::Zero(4, 8);
  StageSlopes slopes(H, Z, f);
  REQUIRE(slopes.has_halves());
  slopes.evaluate();
  const StageSlopes::Rows whole = f;
  f.setZero();
  slopes.evaluate_forces();
  CHECK(f.topRows(2).isZero(0.0));
  slopes.evaluate_velocities();
  CHECK((f - whole).cwiseAbs().maxCoeff() < 1e-15);
  rubato::HamiltonianEvaluator at(H);
  for (Eigen::Index i = 0; i < 8; ++i) {
    Eigen::Vector4d gradient;
    const Eigen::Vector4d z = Z.col(i);
    const double energy = at.gradient(z.data(), gradient.data());
    CHECK(slopes.energy(i, true) == Approx(energy).epsilon(1e-14));
    CHECK(slopes.energy(i, false) == Approx(energy).epsilon(1e-14));
    CHECK((f.col(i).head(2) - gradient.tail(2)).norm() < 1e-15);
    CHECK((f.col(i).tail(2) + gradient.head(2)).norm() < 1e-15);
  }
  StageSlopes::Rows z = StageSlopes::Rows::Random(2, 4), g = z;
  CHECK_FALSE(StageSlopes(systems::non_separable().hamiltonian, z, g).has_halves());
}

TEST_CASE("velocities are told of sums of momenta where T is a quadratic form, and of no others") {
  const auto linear = [](const char* T) {
    const Hamiltonian H({"a", "b"}, {"u", "v"}, std::string(T) + " + cos(a*b)");
    StageSlopes::Rows Z = StageSlopes::Rows::Random(4, 4), f = StageSlopes::Rows::Zero(4, 4);
    StageSlopes slopes(H, Z, f);
    if (!slopes.has_linear_velocities()) {
      return false;
    }
    // Reported apart: each velocity is that of the stage where its momenta are those.
    slopes.momenta() = Z.bottomRows(2);
    slopes.evaluate_linear_velocities();
    slopes.evaluate_velocities();
    CHECK((slopes.velocities() - f.topRows(2)).cwiseAbs().maxCoeff() == 0.0);
    CHECK(slopes.velocities().cwiseAbs().minCoeff() > 0.0);
    return true;
  };
  CHECK(linear("(u^2 + v^2)/2"));
  CHECK(linear("u^2/6 + v^2"));
  CHECK(linear("u^2/2 + u*v/3 + v^2"));
  CHECK_FALSE(linear("(u^2 + v^2)/2 + u"));
  CHECK_FALSE(linear("sqrt(1 + u^2 + v^2)"));
  CHECK_FALSE(linear("u^2/2 + v^4"));
  for (const int stages : {1, 3, 8}) {
    const rubato::GaussTableau tableau(stages);
    const auto square = tableau.square();
    CHECK((square.a_short + square.a_rest - tableau.a * tableau.a).cwiseAbs().maxCoeff() < 4e-16);
    CHECK((square.c_short + square.c_rest - tableau.c).cwiseAbs().maxCoeff() < 4e-16);
    CHECK(square.a_rest.cwiseAbs().maxCoeff() <= 0x1p-13);  // of 12 bits after the point
  }
}

TEST_CASE("Gauss collocation by halves leads where it leads without, in fewer sweeps") {
  // The same H, once so written that its terms mix q and p.
  const Hamiltonian plain({"q"}, {"p"}, "p^2/2 - cos(q) + q^4/5"),
      mixed({"q"}, {"p"}, "p*(p + q)/2 - p*q/2 - cos(q) + q^4/5"),
      other({"q"}, {"p"}, "p*(p + q)/2 - p*q/2.0000000001 - cos(q) + q^4/5");
  // And with a T that is no quadratic form.
  const Hamiltonian relativistic({"q"}, {"p"}, "2*sqrt(4 + p^2) - cos(q) + q^4/5"),
      relativistic_mixed({"q"}, {"p"}, "2*sqrt(4 + p^2) + p*(p + q)/2 - p*q/2 - p^2/2 - cos(q) + q^4/5");
  const double start[] = {0.3, 1.7};
  for (const int stages : {1, 2, 3, 5, 8}) {
    const auto end = [&](const Hamiltonian& H, int& sweeps) {
      const auto scheme = rubato::make_gauss_scheme(H, stages, start);
      for (int k = 0; k < 200; ++k) {
        REQUIRE(scheme->advance(0.25, 0.0) == Status::success);
        sweeps += scheme->iterations();
        scheme->accept();
      }
      return Eigen::Vector2d(scheme->state()[0], scheme->state()[1]);
    };
    int by_halves = 0, whole = 0, unused = 0;
    const Eigen::Vector2d halves = end(plain, by_halves);
    INFO(stages << " stages, " << by_halves << " and " << whole << " sweeps");
    // Rounding of 200 steps, ε each at most, grown by what the orbit stretches in 50 time units, less than 100 times.
    CHECK((halves - end(mixed, whole)).norm() < 4e-12);
    CHECK((halves - end(other, unused)).norm() > 4e-12);
    CHECK((end(relativistic, unused) - end(relativistic_mixed, unused)).norm() < 4e-12);
    CHECK((end(relativistic, unused) - halves).norm() > 1e-3);
    CHECK(by_halves < 0.8 * whole);
  }
}

TEST_CASE("Gauss collocation takes a step to which neither iteration leads from the tangent") {
  // Through steps that double. Going back by the same length leads to where it came from: the method is symmetric.
  const Hamiltonian H({"q"}, {"p"}, "(q^2 + 1)*(p^2 + 1)/2 + 0.3875*exp(-0.1751*p)");
  const double start[] = {-0.06724368443213467, 0.8733051675281385};
  const auto scheme = rubato::make_gauss_scheme(H, 3, start);
  for (const double h : {2.6706507431891136, -2.6706507431891136}) {
    REQUIRE(scheme->advance(h, 0.0) == Status::success);
    scheme->accept();
  }
  // In these units rounding is 1e-16, and the step stretches less than a thousand times.
  CHECK(std::abs(scheme->state()[0] - start[0]) + std::abs(scheme->state()[1] - start[1]) < 1e-12);
  // A trial is not worth that, and is given up.
  CHECK(rubato::make_gauss_scheme(H, 3, start)->advance(2.6706507431891136, 1e-6) != Status::success);
}
