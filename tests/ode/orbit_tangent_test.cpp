// Tangents of every scheme for orbits: they are the derivatives of its map, and preserve its two-form.

#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/ode/discrete_lagrangian.hpp>
#include <rubato/ode/midpoint_scheme.hpp>
#include <rubato/ode/orbit_tangent.hpp>
#include <rubato/ode/tangent.hpp>
#include <rubato/ode/tangent_vectors.hpp>
#include <rubato/solve/orthonormal.hpp>
#include <rubato/variation/composition.hpp>

using namespace rubato;

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

const Hamiltonian henon_heiles({"x", "y"}, {"u", "v"}, "(u^2+v^2)/2 + (x^2+y^2)/2 + x^2*y - y^3/3");
const Hamiltonian coupled({"x", "y"}, {"u", "v"}, "(u^2*(1+x^2)+v^2)/2 + u*v*y/3 + (x^2+y^2)/2 + x^2*y");
const Lagrangian double_pendulum({"a", "b"}, "a_dot^2 + b_dot^2/2 + a_dot*b_dot*cos(a-b) + 2*cos(a) + cos(b)");
const std::vector<double> start = {0.1, -0.2, 0.35, 0.3};

struct Case {
  std::string name;
  std::unique_ptr<OneStepScheme> scheme;
  std::unique_ptr<OrbitTangent> tangent;
};

std::vector<Case> all_maps() {
  std::vector<Case> all;
  const auto add = [&](const Hamiltonian& H, const SegmentLagrangian& of, const std::string& name) {
    all.push_back({name, make_one_step_scheme(H, of, start), make_orbit_tangent(H, of, false, start)});
  };
  for (const Hamiltonian* H : {&henon_heiles, &coupled}) {
    add(*H, Midpoint{}, "midpoint");
    for (const int stages : {1, 2, 3, 5}) {
      add(*H, Gauss{stages}, "gauss");
    }
    add(*H, Generating{.order = 4}, "generating");
    add(*H, Generating{.order = 3, .darboux = DarbouxType::euler_a}, "generating, euler-a");
    add(*H, Generating{.order = 3, .darboux = MatrixXd(0.3 * MatrixXd::Identity(4, 4))}, "generating, F");
  }
  for (const Composition& one : compositions()) {
    add(henon_heiles, Splitting{std::string(one.name)}, std::string(one.name));
  }
  for (const SegmentLagrangian& of : {SegmentLagrangian(Midpoint{}), SegmentLagrangian(Gauss{3}),
                                      SegmentLagrangian(Trapezoid{}), SegmentLagrangian(Lobatto{4})}) {
    const std::vector<double> q = {0.4, -0.3}, q_dot = {0.5, 0.7};
    all.push_back({"of L", make_one_step_scheme(double_pendulum, of, q, q_dot),
                   make_orbit_tangent(make_one_step_scheme(double_pendulum, of, q, q_dot))});
  }
  return all;
}

VectorXd mapped(OneStepScheme& scheme, const VectorXd& z, double h) {
  scheme.restart({z.data(), static_cast<std::size_t>(z.size())});
  REQUIRE(scheme.advance(h, 0.0) == Status::success);
  scheme.accept();
  return Eigen::Map<const VectorXd>(scheme.state().data(), z.size());
}

MatrixXd tangent_of(OrbitTangent& tangent, const VectorXd& z, const VectorXd& z_1, double h) {
  MatrixXd columns = MatrixXd::Identity(z.size(), z.size());
  const auto size = static_cast<std::size_t>(z.size());
  REQUIRE(tangent.step({z.data(), size}, {z_1.data(), size}, 0.0, h, {columns.data(), size * size}) == Status::success);
  return columns;
}

double defect_of(const MatrixXd& T) {
  const MatrixXd W = canonical_two_form(static_cast<std::size_t>(T.rows() / 2));
  return (T.transpose() * W * T - W).cwiseAbs().maxCoeff();
}

}  // namespace

TEST_CASE("the tangent of every map is its derivative, and preserves the two-form") {
  for (Case& one : all_maps()) {
    CAPTURE(one.name);
    const VectorXd z = Eigen::Map<const VectorXd>(one.scheme->state().data(), 4);
    for (const double h : {0.2, -0.35}) {
      const VectorXd z_1 = mapped(*one.scheme, z, h);
      const MatrixXd T = tangent_of(*one.tangent, z, z_1, h);
      // Differences over 2d: rounding ε/d, and d²/6 of third derivatives of order 1.
      constexpr double d = 1e-5;
      MatrixXd differences(4, 4);
      for (Index i = 0; i < 4; ++i) {
        const VectorXd change = d * VectorXd::Unit(4, i);
        differences.col(i) = (mapped(*one.scheme, z + change, h) - mapped(*one.scheme, z - change, h)) / (2.0 * d);
      }
      CHECK((T - differences).cwiseAbs().maxCoeff() < 1e-9);
      // Products of 4 terms of order 1 and a solution of a system whose matrix is close to 1.
      CHECK(defect_of(T) < 2e-15 * 10);

      // A derivative of a step of another length is found out; it still preserves the form.
      const VectorXd other_end = mapped(*one.scheme, z, 1.01 * h);
      const MatrixXd other = tangent_of(*one.tangent, z, other_end, 1.01 * h);
      CHECK((other - differences).cwiseAbs().maxCoeff() > 1e-4);
      // One with an entry that is off does not.
      MatrixXd wrong = T;
      wrong(0, 2) += 1e-10;
      CHECK(defect_of(wrong) > 1e-11);
    }
  }
}

TEST_CASE("the tangent of a two-step map is its derivative, and preserves its two-form") {
  const std::vector<std::pair<std::string, SegmentLagrangian>> forms = {
      {"midpoint", Midpoint{}},
      {"forward", Forward{}},
      {"generating", Generating{.order = 4}},
      {"custom", Custom{.L = "(u_0+u_1)/2*(x_1-x_0)/(t_1-t_0) + (v_0+v_1)/2*(y_1-y_0)/(t_1-t_0)"
                             " - (u_0^2+u_1^2+v_0^2+v_1^2)/4 - ((x_0+x_1)/2)^4 - x_0*y_1*(1+t_0/9)"}}};
  for (const auto& [name, form] : forms) {
    CAPTURE(name);
    constexpr double h = 0.15;
    const auto tangent = make_orbit_tangent(henon_heiles, form, true, start);
    REQUIRE(tangent->size() == 8);
    // (z, P) ↦ (z_1, P_1): P = -∂A/∂z_0, which makes z_1 in place of P the variable to start from.
    const auto action = make_action(henon_heiles.without_constant(), form);
    const auto gradient = [&](const VectorXd& z_0, const VectorXd& z_1) {
      std::vector<double> corners = {0.0};
      corners.insert(corners.end(), z_0.begin(), z_0.end());
      corners.push_back(h);
      corners.insert(corners.end(), z_1.begin(), z_1.end());
      VectorXd result(10);
      action->gradient(corners, result);
      return result;
    };
    const VectorXd z_0 = Eigen::Map<const VectorXd>(start.data(), 4);
    const auto midpoint = make_midpoint_scheme(henon_heiles, start);
    const VectorXd z_1 = mapped(*midpoint, z_0, h) + VectorXd::Constant(4, 1e-3);
    // ∂(z_0, P_0)/∂(z_0, z_1) and ∂(z_1, P_1)/∂(z_0, z_1), by differences: errors as above.
    constexpr double d = 1e-5;
    MatrixXd before = MatrixXd::Zero(8, 8), after = MatrixXd::Zero(8, 8);
    for (Index i = 0; i < 8; ++i) {
      const VectorXd change_0 = d * (i < 4 ? VectorXd(VectorXd::Unit(4, i)) : VectorXd(VectorXd::Zero(4)));
      const VectorXd change_1 = d * (i >= 4 ? VectorXd(VectorXd::Unit(4, i - 4)) : VectorXd(VectorXd::Zero(4)));
      const VectorXd rate =
          (gradient(z_0 + change_0, z_1 + change_1) - gradient(z_0 - change_0, z_1 - change_1)) / (2 * d);
      before.col(i) << change_0 / d, -rate.segment(1, 4);
      after.col(i) << change_1 / d, rate.segment(6, 4);
    }
    MatrixXd columns = before;
    REQUIRE(tangent->step({z_0.data(), 4}, {z_1.data(), 4}, 0.0, h, {columns.data(), 64}) == Status::success);
    CHECK((columns - after).cwiseAbs().maxCoeff() < 1e-7);  // the forward 𝕃 enlarges those errors by 16/h²

    MatrixXd T = MatrixXd::Identity(8, 8);
    REQUIRE(tangent->step({z_0.data(), 4}, {z_1.data(), 4}, 0.0, h, {T.data(), 64}) == Status::success);
    const double size = T.cwiseAbs().maxCoeff();
    CHECK(defect_of(T) < 1e-14 * size * size);
    T(0, 5) += 1e-8 * size;
    CHECK(defect_of(T) > 1e-11 * size);
  }
}

TEST_CASE("with all vectors pairs of exponents cancel in every step") {
  for (const Hamiltonian* H : {&henon_heiles, &coupled}) {
    constexpr double h = 0.1;
    const auto scheme = make_one_step_scheme(*H, Gauss{3}, start);
    TangentVectors vectors(make_orbit_tangent(*H, Gauss{3}, false, start), 4, 4, false);
    TangentVectors three(make_orbit_tangent(*H, Gauss{3}, false, start), 4, 3, true);
    VectorXd z = Eigen::Map<const VectorXd>(start.data(), 4);
    double worst = 0.0, defect = 0.0, largest = 0.0, same = 0.0;
    MatrixXd product = MatrixXd::Identity(4, 4);
    for (int k = 0; k < 300; ++k) {
      const VectorXd next = mapped(*scheme, z, h);
      REQUIRE(vectors.step({z.data(), 4}, {next.data(), 4}, 0.0, h) == Status::success);
      REQUIRE(three.step({z.data(), 4}, {next.data(), 4}, 0.0, h) == Status::success);
      const auto tangent = make_orbit_tangent(*H, Gauss{3}, false, start);
      product = tangent_of(*tangent, z, next, h) * product;
      z = next;
      const auto logs = vectors.logarithms();
      worst = std::max({worst, std::abs(logs[0] + logs[3]), std::abs(logs[1] + logs[2])});
      largest = std::max(largest, std::abs(logs[0]));
      defect = std::max({defect, vectors.defect(), three.defect()});
      for (std::size_t i = 0; i < 3; ++i) {
        same = std::max(same, std::abs(logs[i] - three.logarithms()[i]));
      }
    }
    // Some rounding errors of each step, as many as there are operations on a column (about 50, at random), and what
    // the steps before left of the symplectic frame, which grows with them at most like their number.
    CHECK(worst < 300 * 2e-16 * 10);
    CHECK(defect < 50 * 2.2e-16);
    CHECK(largest > 1e-3);
    CHECK(same < 1e-12);
    const Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>> matrix(three.matrix().data());
    CHECK((matrix - product).cwiseAbs().maxCoeff() < 1e-10 * product.cwiseAbs().maxCoeff());
  }
}

TEST_CASE("exponents do not depend on units of mass and length") {
  constexpr double h = 0.1;
  constexpr int steps = 200;
  for (const bool two_step : {false, true}) {
    CAPTURE(two_step);
    // The sums of the logarithms of all vectors; orthonormal as they are if not `natural`.
    const auto growth = [&](double mass, double length, bool natural) {
      const Hamiltonian H({"x", "y"}, {"u", "v"}, "(u^2+v^2)/(2*m) + m*((x^2+y^2)/2 + (x^2*y - y^3/3)/l)",
                          {{"m", mass}, {"l", length}});
      const VectorXd units{{length, length, mass * length, mass * length}};
      VectorXd z = units.cwiseProduct(Eigen::Map<const VectorXd>(start.data(), 4));
      const auto scheme = make_midpoint_scheme(H, {z.data(), 4});
      auto tangent = make_orbit_tangent(H, Midpoint{}, two_step, {z.data(), 4});
      TangentVectors vectors(make_orbit_tangent(H, Midpoint{}, two_step, {z.data(), 4}), 4, 4, false);
      std::vector<double> plain(4 * tangent->size()), logarithms(4), sums(4, 0.0);
      for (int k = 0; k < steps; ++k) {
        const VectorXd next = mapped(*scheme, z, h);
        if (natural) {
          REQUIRE(vectors.step({z.data(), 4}, {next.data(), 4}, 0.0, h) == Status::success);
          CHECK(vectors.defect() < 50 * 2.2e-16);
        } else {
          if (k == 0) {
            REQUIRE(tangent->lift({z.data(), 4}, {next.data(), 4}, 0.0, h, symplectic_start(2, 4), plain) ==
                    Status::success);
            static_cast<void>(solve::orthonormalise(plain, 4, logarithms));
          }
          REQUIRE(tangent->step({z.data(), 4}, {next.data(), 4}, 0.0, h, plain) == Status::success);
          static_cast<void>(solve::orthonormalise(plain, 4, logarithms));
        }
        for (std::size_t i = 0; i < 4; ++i) {
          sums[i] += natural ? vectors.logarithms()[i] : logarithms[i];
        }
        z = next;
      }
      return sums;
    };
    const auto distance = [](const std::vector<double>& a, const std::vector<double>& b) {
      double largest = 0.0;
      for (std::size_t i = 0; i < 4; ++i) {
        largest = std::max(largest, std::abs(a[i] - b[i]));
      }
      return largest;
    };
    const std::vector<double> sums = growth(1.0, 1.0, true);
    // Units that are powers of 2 leave rounding errors as they are, but for those of elimination, which may choose
    // other pivots: some 10 in each step, which the motion, a regular one, carries along like the number of steps.
    const double rounding = 10.0 * 2.2e-16 * steps * steps;
    for (const auto& [mass, length] : {std::pair(0x1p40, 1.0), {0x1p-88, 0x1p20}, {1.0, 0x1p-60}}) {
      CAPTURE(mass, length);
      CHECK(distance(growth(mass, length, true), sums) < rounding);
    }
    CHECK(distance(growth(0x1p40, 1.0, false), sums) > 1.0);
  }
}

TEST_CASE("vectors start orthonormal and symplectic, and refuse what is no basis") {
  for (const std::size_t n : {1, 2, 5}) {
    const std::size_t size = 2 * n;
    const std::vector<double> all = symplectic_start(n, size);
    const auto rows = static_cast<Index>(size);
    const Eigen::Map<const MatrixXd> V(all.data(), rows, rows);
    CHECK((V.transpose() * V - MatrixXd::Identity(rows, rows)).cwiseAbs().maxCoeff() < 1e-15 * 10);
    const MatrixXd form = V.transpose() * canonical_two_form(n) * V;
    for (Index i = 0; i < rows; ++i) {
      for (Index j = 0; j < rows; ++j) {
        CHECK(std::abs(form(i, j)) == Approx(i + j == rows - 1 ? 1.0 : 0.0).margin(1e-14));
      }
    }
    const std::vector<double> some = symplectic_start(n, n);
    CHECK(std::equal(some.begin(), some.end(), all.begin()));
  }
  CHECK_THROWS_AS(TangentVectors(make_orbit_tangent(henon_heiles, Midpoint{}, false, start), 4, 5, false),
                  std::invalid_argument);
  std::vector<double> columns = {1, 0, 2, 0}, logs(2);
  CHECK_FALSE(solve::orthonormalise(columns, 2, logs));
}

TEST_CASE("stiff stages fall back on a dense matrix, and what cannot be made is told") {
  const Hamiltonian stiff({"x"}, {"u"}, "u^2/2 + 1e4*x^2/2 + x^4");
  const std::vector<double> z = {1e-3, 0.2};
  const auto scheme = make_one_step_scheme(stiff, Gauss{3}, z);
  const auto tangent = make_orbit_tangent(stiff, Gauss{3}, false, z);
  const VectorXd z_0 = Eigen::Map<const VectorXd>(z.data(), 2);
  const VectorXd z_1 = mapped(*scheme, z_0, 0.1);  // 10 radians
  const MatrixXd T = tangent_of(*tangent, z_0, z_1, 0.1);
  CHECK(defect_of(T) < 1e-15 * 1e3);  // entries up to 1e2
  constexpr double d = 1e-7;          // x is some 1e-3: third derivatives are of order 1e4
  for (Index i = 0; i < 2; ++i) {
    const VectorXd change = (i == 0 ? d : 100.0 * d) * VectorXd::Unit(2, i);
    const VectorXd rate = (mapped(*scheme, z_0 + change, 0.1) - mapped(*scheme, z_0 - change, 0.1)) / (2.0 * change[i]);
    CHECK((T.col(i) - rate).cwiseAbs().maxCoeff() < 1e-6 * T.col(i).cwiseAbs().maxCoeff());
  }
  CHECK(T(0, 0) * T(1, 1) - T(0, 1) * T(1, 0) == Approx(1.0));

  TangentVectors vectors(make_orbit_tangent(stiff, Gauss{3}, false, z), 2, 2, true);
  const std::vector<double> nowhere(2, std::numeric_limits<double>::quiet_NaN());
  CHECK(vectors.step(z, nowhere, 0.0, std::numeric_limits<double>::infinity()) != Status::success);
  CHECK(std::isnan(vectors.logarithms()[0]));
  CHECK(std::isnan(vectors.matrix()[0]));
}
