// What the total variation of the generating functions' action preserves, and the parasite of an arbitrary pair.
#include <catch2/catch.hpp>

#include <cmath>
#include <memory>
#include <vector>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include <rubato/ode/generating_action.hpp>
#include <rubato/ode/generating_scheme.hpp>
#include <rubato/ode/integrate.hpp>
#include <rubato/ode/two_step_scheme.hpp>
#include <rubato/variation/total_variation.hpp>

#include "matrices.hpp"

namespace {

using namespace rubato;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Corners = std::vector<double>;

Hamiltonian henon_heiles() {
  return Hamiltonian({"x", "y"}, {"u", "v"}, "(x^2 + y^2 + u^2 + v^2)/2 + x^2*y - y^3/3");
}
Hamiltonian kepler() {
  return Hamiltonian({"x", "y"}, {"u", "v"}, "(u^2 + v^2)/2 - 1/sqrt(x^2 + y^2)");
}

MatrixXd definite(Index size) {
  const MatrixXd root = random_symmetric(size, 29);
  return 0.3 * (root * root + MatrixXd::Identity(size, size));
}

double largest(const MatrixXd& m) {
  return m.cwiseAbs().maxCoeff();
}

const Corners pair_at_large = {0.0, 0.1, 0.2, 0.35, -0.1, 0.2, 0.17, 0.18, 0.32, -0.14};

/// The corners of the step after `first` in the two-step form, levels included: (3.3) solved inside, (3.4) by the
/// secant method around it (theory, section 3.2: solving both at once throws h far away).
Corners next_pair(const Hamiltonian& hamiltonian, const MatrixXd& F, int order, const Corners& first) {
  GeneratingAction action(hamiltonian, F, order);
  VectorXd before(10), after(10);
  MatrixXd second(10, 10);
  action.gradient(first, before);
  Corners pair(first.begin() + 5, first.end());
  pair.insert(pair.end(), first.begin() + 5, first.end());
  for (std::size_t i = 1; i < 5; ++i) {
    pair[5 + i] += first[5 + i] - first[i];
  }
  const auto imbalance = [&](double h) {
    pair[5] = pair[0] + h;
    for (int iteration = 0; iteration < 8; ++iteration) {
      action.gradient(pair, after);
      action.hessian(pair, second);
      const VectorXd change =
          second.block(1, 6, 4, 4).partialPivLu().solve(-(after.segment(1, 4) + before.segment(6, 4)));
      for (std::size_t i = 0; i < 4; ++i) {
        pair[6 + i] += change[static_cast<Index>(i)];
      }
    }
    action.gradient(pair, after);
    return after[0] + before[5];
  };
  double h_0 = first[5] - first[0];
  double h_1 = 1.001 * h_0;
  double f_0 = imbalance(h_0);
  for (int iteration = 0; iteration < 12; ++iteration) {
    const double f_1 = imbalance(h_1);
    if (std::abs(f_1) <= 1e-15 || f_1 == f_0) {
      break;
    }
    const double next = h_1 - f_1 * (h_1 - h_0) / (f_1 - f_0);
    h_0 = h_1;
    f_0 = f_1;
    h_1 = next;
  }
  action.gradient(pair, after);
  REQUIRE((after.head(5) + before.tail(5)).cwiseAbs().maxCoeff() <= 1e-13);
  return pair;
}

}  // namespace

TEST_CASE("variations of the generating functions' action are its derivatives") {
  // Central differences at 1e-4: 1e-8 times third derivatives of order 10.
  constexpr double step = 1e-4;
  constexpr double tolerance = 1e-6;
  for (const auto& [F, order] : {std::pair{MatrixXd(MatrixXd::Zero(4, 4)), 6},
                                 {darboux_symmetric(DarbouxType::euler_a, 2), 3},
                                 {random_symmetric(4, 29), 4}}) {
    GeneratingAction action(henon_heiles(), F, order);
    VectorXd gradient(10), up(10), down(10);
    MatrixXd hessian(10, 10);
    action.gradient(pair_at_large, gradient);
    action.hessian(pair_at_large, hessian);
    CHECK(largest(hessian - hessian.transpose()) <= 1e-13);
    CHECK(std::abs(gradient[0] + gradient[5]) == 0.0);  // autonomous
    for (std::size_t i = 0; i < 10; ++i) {
      Corners moved = pair_at_large;
      moved[i] += step;
      const double value_up = action.value(moved);
      action.gradient(moved, up);
      moved[i] -= 2 * step;
      const double value_down = action.value(moved);
      action.gradient(moved, down);
      const auto column = static_cast<Index>(i);
      CHECK((value_up - value_down) / (2 * step) == Approx(gradient[column]).margin(tolerance));
      CHECK(((up - down) / (2 * step) - hessian.col(column)).cwiseAbs().maxCoeff() <= tolerance);
      CHECK(((up - down) / (2 * step) - hessian.col((column + 1) % 10)).cwiseAbs().maxCoeff() > tolerance);
    }
  }
}

TEST_CASE("one term with F = 0 is the midpoint action up to a total difference") {
  GeneratingAction own(henon_heiles(), MatrixXd::Zero(4, 4), 2);
  const auto midpoint = make_action(henon_heiles(), Midpoint{});
  MatrixXd own_hessian(10, 10), midpoint_hessian(10, 10);
  own.hessian(pair_at_large, own_hessian);
  midpoint->hessian(pair_at_large, midpoint_hessian);
  CHECK(largest(own_hessian.topRightCorner(5, 5) - midpoint_hessian.topRightCorner(5, 5)) <= 1e-14);
  GeneratingAction four(henon_heiles(), MatrixXd::Zero(4, 4), 4);
  four.hessian(pair_at_large, own_hessian);
  CHECK(largest(own_hessian.topRightCorner(5, 5) - midpoint_hessian.topRightCorner(5, 5)) > 1e-4);
}

TEST_CASE("the two-step map with variable levels preserves the two-form, from any pair") {
  struct Case {
    MatrixXd F;
    int order;
    double h;
  };
  const MatrixXd zero = MatrixXd::Zero(4, 4);
  for (const auto& [hamiltonian, z] : {std::pair{henon_heiles(), std::vector<double>{0.1, 0.2, 0.35, -0.1}},
                                       {kepler(), std::vector<double>{0.7, 0.1, 0.1, 1.3}}}) {
    for (const auto& [F, order, h] :
         {Case{zero, 2, 0.1}, Case{zero, 4, 0.2}, Case{zero, 6, 0.3}, Case{zero, 8, 0.3}, Case{definite(4), 2, 0.05}}) {
      // On the orbit, and off it by 1e-4: a parasite.
      for (const double parasite : {0.0, 1e-4}) {
        const auto scheme = make_generating_scheme(hamiltonian, F, order, z);
        REQUIRE(scheme->advance(h, 0.0) == Status::success);
        scheme->accept();
        Corners first = {0.0};
        first.insert(first.end(), z.begin(), z.end());
        first.push_back(h);
        first.insert(first.end(), scheme->state().begin(), scheme->state().end());
        first[6] += parasite;
        const Corners second = next_pair(hamiltonian, F, order, first);
        GeneratingAction action(hamiltonian, F, order);
        const MatrixXd tangent = two_step_tangent(action, first, second);
        const MatrixXd before = two_form(action, first);
        const MatrixXd after = two_form(action, second);
        // T has entries of order 1/(h^s φ^(s+1)), the reciprocal of the level equation's slope; rounding grows with T².
        const double scale = std::max(1.0, largest(tangent)) * std::max(1.0, largest(tangent));
        INFO("order " << order << ", largest entry of the tangent " << largest(tangent));
        CHECK(largest(tangent.transpose() * after * tangent - before) <= 1e-14 * scale);
        // The twin: the printed forms' factor dH for dE is another form.
        MatrixXd wrong = after;
        wrong(5, 1) += 1e-3;
        CHECK(largest(tangent.transpose() * wrong * tangent - before) > 1e-14 * scale);
      }
    }
  }
}

TEST_CASE("the one-step map with fixed levels is symplectic") {
  constexpr double step = 1e-4;
  for (const auto& [F, order] : {std::pair{MatrixXd(MatrixXd::Zero(4, 4)), 8},
                                 {darboux_symmetric(DarbouxType::euler_b, 2), 3},
                                 {random_symmetric(4, 29), 4}}) {
    const std::vector<double> z = {0.1, 0.2, 0.35, -0.1};
    const auto image = [&](std::size_t i, double by) {
      std::vector<double> moved = z;
      moved[i] += by;
      const auto scheme = make_generating_scheme(henon_heiles(), F, order, moved);
      REQUIRE(scheme->advance(0.4, 0.0) == Status::success);
      scheme->accept();
      return VectorXd(Eigen::Map<const VectorXd>(scheme->state().data(), 4));
    };
    MatrixXd S(4, 4);
    for (std::size_t i = 0; i < 4; ++i) {
      S.col(static_cast<Index>(i)) =
          (8 * (image(i, step) - image(i, -step)) - (image(i, 2 * step) - image(i, -2 * step))) /
          (12 * step);  // fourth order: step⁴ and ε/step remain
    }
    CHECK(is_symplectic(S, 1e-11));
    CHECK_FALSE(is_symplectic((1 + 1e-9) * S, 1e-11));
  }
}

TEST_CASE("the parasite of an arbitrary pair grows or stays as F says") {
  const Hamiltonian hamiltonian = henon_heiles();
  const std::vector<double> z = {0.1, 0.2, 0.35, -0.1};
  constexpr double h = 0.05;
  constexpr int order = 3;
  const auto defect_growth = [&](const MatrixXd& F, int steps) {
    const auto one_step = make_generating_scheme(hamiltonian, F, order, z);
    REQUIRE(one_step->advance(h, 0.0) == Status::success);
    one_step->accept();
    std::vector<double> second(one_step->state().begin(), one_step->state().end());
    second[0] += 1e-9;
    const auto two_step = make_two_step_scheme(std::make_unique<GeneratingAction>(hamiltonian, F, order), hamiltonian,
                                               {0.0, z}, {h, second});
    GeneratingFunction generating(hamiltonian, F, order);
    const MatrixXd J = symplectic_unit(2);
    VectorXd first_defect(4), defect(4), gradient(4);
    VectorXd last = Eigen::Map<const VectorXd>(z.data(), 4);
    for (int k = 0; k < steps; ++k) {
      REQUIRE(two_step->advance(h, 0.0) == Status::success);
      two_step->accept();
      const VectorXd now = Eigen::Map<const VectorXd>(two_step->state().data(), 4);
      const VectorXd w = 0.5 * (now + last) + 0.5 * J * F * (now - last);
      REQUIRE(generating.expand({w.data(), 4}) == Status::success);
      generating.gradient_sum(h, order, gradient);
      defect = J * (now - last) - gradient;
      first_defect = k == 0 ? defect : first_defect;
      last = now;
    }
    return std::pair<VectorXd, VectorXd>(first_defect, defect);
  };
  // d_k = P^k d_0 exactly while d is small beside the state; rounding of 1e-16 beside 1e-9, grown alike.
  const MatrixXd random = random_symmetric(4, 29);
  const double factor = parasite_matrix(random).eigenvalues().cwiseAbs().maxCoeff();
  CHECK(factor > 1.2);
  const auto [start, end] = defect_growth(random, 7);
  VectorXd expected = start;
  for (int k = 0; k < 6; ++k) {
    expected = parasite_matrix(random) * expected;
  }
  CHECK((end - expected).norm() <= 1e-4 * expected.norm());
  CHECK(end.norm() > 2.0 * start.norm());
  // Definite F, and F = 0: bounded for ever.
  for (const MatrixXd& F : {definite(4), MatrixXd(MatrixXd::Zero(4, 4))}) {
    const auto [first, last] = defect_growth(F, 200);
    CHECK(last.norm() <= 10.0 * first.norm());
    CHECK(last.norm() >= 0.1 * first.norm());
  }
  // Euler types: refused, with the reason.
  for (const DarbouxType type : {DarbouxType::euler_a, DarbouxType::euler_b}) {
    IntegrationOptions options{.lagrangian = Generating{.order = 1, .darboux = type}, .step = h, .until = 1.0};
    options.next = InitialState{.q = {0.12, 0.2}, .p = {0.35, -0.1}, .t = h};
    CHECK_THROWS_WITH(integrate(hamiltonian, {.q = {0.1, 0.2}, .p = {0.35, -0.1}}, options),
                      Catch::Contains("arbitrary starting pair cannot be continued"));
    options.next.reset();
    options.levels = Levels::fixed;
    CHECK_NOTHROW(integrate(hamiltonian, {.q = {0.1, 0.2}, .p = {0.35, -0.1}}, options));
  }
}

TEST_CASE("what generating functions do badly is said") {
  const auto cautions = [](const MatrixXd& F, Levels levels, bool pair) {
    const InitialState start{.q = {0.1, 0.2}, .p = {0.3, 0.4}};
    IntegrationOptions options{
        .lagrangian = Generating{.order = 2, .darboux = F}, .step = 0.01, .until = 0.02, .levels = levels};
    if (pair) {
      options.next = InitialState{.q = {0.103, 0.204}, .p = {0.299, 0.399}, .t = 0.01};
    }
    return integrate(henon_heiles(), start, options).cautions;
  };
  const MatrixXd euler = darboux_symmetric(DarbouxType::euler_b, 2);
  const MatrixXd plain = MatrixXd::Zero(4, 4);
  REQUIRE(cautions(euler, Levels::variable, false).size() == 1);
  CHECK_THAT(cautions(euler, Levels::variable, false)[0], Catch::Contains("turning point"));
  CHECK(cautions(euler, Levels::fixed, false).empty());
  CHECK(cautions(plain, Levels::variable, false).empty());
  const MatrixXd random = random_symmetric(4, 7);
  REQUIRE(cautions(random, Levels::fixed, true).size() == 1);
  CHECK_THAT(cautions(random, Levels::fixed, true)[0], Catch::Contains("grows by a factor of"));
  CHECK(cautions(random, Levels::fixed, false).empty());
  CHECK(cautions(definite(4), Levels::fixed, true).empty());
  CHECK(cautions(plain, Levels::fixed, true).empty());
}
