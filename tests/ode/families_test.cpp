#include <array>
#include <cmath>
#include <functional>
#include <set>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/ode/gauss_function.hpp>
#include <rubato/ode/gauss_scheme.hpp>
#include <rubato/ode/lagrangian_scheme.hpp>
#include <rubato/ode/separable.hpp>
#include <rubato/ode/splitting_formula.hpp>
#include <rubato/ode/splitting_scheme.hpp>
#include <rubato/ode/tangent.hpp>
#include <rubato/variation/composition.hpp>
#include <rubato/variation/gauss_tableau.hpp>
#include <rubato/variation/time_levels.hpp>

#include "systems.hpp"

using namespace rubato;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using formula::Expression;

namespace {

constexpr double epsilon = std::numeric_limits<double>::epsilon();

Hamiltonian henon_heiles() {
  return systems::henon_heiles().hamiltonian;
}
Hamiltonian not_separable() {
  return systems::non_separable().hamiltonian;
}

/// A family of symplectic maps: its scheme for a given H, begun at z.
struct Family {
  std::string name;
  std::function<std::unique_ptr<SegmentScheme>(const Hamiltonian&, const VectorXd&)> make;
  bool separable_only = false;
  int order = 2;
};

std::span<const double> span_of(const VectorXd& z) {
  return {z.data(), static_cast<std::size_t>(z.size())};
}

/// henon_heiles() or not_separable() by their Lagrangians.
Lagrangian lagrangian_of(const Hamiltonian& H) {
  return H.degrees_of_freedom() == 1 ? Lagrangian({"q"}, "q_dot^2/(2*(1 + q^2)) - (1 + q^2)/2")
                                     : Lagrangian({"x", "y"}, "(x_dot^2 + y_dot^2)/2 - (x^2 + y^2)/2 - x^2*y + y^3/3");
}

/// A quadrature of the action as a family of maps of z = (q, p).
Family quadrature_family(const std::string& name, ActionQuadrature::Points points, int degree) {
  return {name,
          [=](const Hamiltonian& H, const VectorXd& z) {
            const auto n = static_cast<Eigen::Index>(H.degrees_of_freedom());
            VectorXd gradient(2 * n);
            HamiltonianEvaluator(H).gradient(z.data(), gradient.data());
            auto scheme = make_lagrangian_scheme(lagrangian_of(H), ActionQuadrature(points, degree),
                                                 span_of(z).first(H.degrees_of_freedom()),
                                                 span_of(gradient).last(H.degrees_of_freedom()));
            scheme->restart(span_of(z));  // p of the test itself, to the last bit
            return scheme;
          },
          false, 2 * degree};
}

std::vector<Family> families() {
  std::vector<Family> all;
  for (int stages = 1; stages <= GaussTableau::most_stages; ++stages) {
    all.push_back(
        {"gauss " + std::to_string(stages),
         [stages](const Hamiltonian& H, const VectorXd& z) { return make_gauss_scheme(H, stages, span_of(z)); }, false,
         2 * stages});
  }
  for (const Composition& one : compositions()) {
    all.push_back(
        {std::string(one.name),
         [&one](const Hamiltonian& H, const VectorXd& z) { return make_splitting_scheme(H, one, span_of(z)); }, true,
         one.order});
  }
  for (const int degree : {1, 2, 3, 4, 6, 8}) {
    all.push_back(
        quadrature_family("lobatto " + std::to_string(degree + 1), ActionQuadrature::Points::lobatto, degree));
  }
  for (const int degree : {1, 2, 4}) {
    all.push_back(quadrature_family("gauss points " + std::to_string(degree), ActionQuadrature::Points::gauss, degree));
  }
  return all;
}

VectorXd state_of(const SegmentScheme& scheme) {
  return Eigen::Map<const VectorXd>(scheme.state().data(), static_cast<Eigen::Index>(scheme.dimension()));
}

/// One step from z: the state at its end, and E_k.
struct Step {
  VectorXd z;
  double energy = 0.0;
};
Step step_from(const Family& family, const Hamiltonian& H, const VectorXd& z, double h) {
  const auto scheme = family.make(H, z);
  REQUIRE(scheme->advance(h, 0.0) == Status::success);
  const double energy = scheme->discrete_energy();
  scheme->accept();
  return {state_of(*scheme), energy};
}

VectorXd orbit(const Family& family, const Hamiltonian& H, const VectorXd& z, double h, int steps) {
  const auto scheme = family.make(H, z);
  for (int k = 0; k < steps; ++k) {
    REQUIRE(scheme->advance(h, 0.0) == Status::success);
    scheme->accept();
  }
  return state_of(*scheme);
}

/// Central differences of a function of z, column by column.
MatrixXd jacobian(const std::function<VectorXd(const VectorXd&)>& function, const VectorXd& z, double width) {
  MatrixXd result(function(z).size(), z.size());
  for (Eigen::Index i = 0; i < z.size(); ++i) {
    VectorXd up = z, down = z;
    up[i] += width;
    down[i] -= width;
    result.col(i) = (function(up) - function(down)) / (2 * width);
  }
  return result;
}

}  // namespace

TEST_CASE("the tableau of Gauss is symplectic and of order 2m") {
  for (int m = 1; m <= GaussTableau::most_stages; ++m) {
    const GaussTableau tableau(m);
    for (int i = 0; i < m; ++i) {
      for (int j = 0; j < m; ++j) {
        CHECK(std::abs(tableau.b[i] * tableau.a(i, j) + tableau.b[j] * tableau.a(j, i) - tableau.b[i] * tableau.b[j]) <
              epsilon);
        CHECK(tableau.a_short(i, j) + tableau.a_rest(i, j) == tableau.a(i, j));
      }
    }
    for (int k = 1; k <= 2 * m; ++k) {
      CHECK(std::abs(tableau.b.dot(tableau.c.array().pow(k - 1).matrix()) - 1.0 / k) < 4 * epsilon);
    }
    CHECK(std::abs(tableau.b.dot(tableau.c.array().pow(2 * m).matrix()) - 1.0 / (2 * m + 1)) > 100 * epsilon);  // twin
  }
  CHECK_THROWS_WITH(GaussTableau(9), Catch::Matchers::Contains("between 1 and 8; got 9"));
  CHECK_THROWS_WITH(GaussTableau(0), Catch::Matchers::Contains("got 0"));
}

TEST_CASE("orders of Gauss collocation and of the splittings on nonlinear problems") {
  for (const Family& family : families()) {
    if (family.order > 8) {
      continue;  // rounding is reached before three points show the order
    }
    const Hamiltonian H = family.separable_only ? henon_heiles() : not_separable();
    VectorXd z(static_cast<Eigen::Index>(2 * H.degrees_of_freedom()));
    z.setLinSpaced(0.3, 0.5);
    const double T = 2.4;
    const auto exact = [&] {
      return orbit({"", [](const Hamiltonian& h, const VectorXd& at) { return make_gauss_scheme(h, 8, span_of(at)); }},
                   H, z, T / 96, 96);
    }();
    // Three halvings above rounding; the coarsest where the order shows to a tenth or so.
    const int coarsest = family.order <= 2 ? 24 : family.order <= 4 ? 12 : 6;
    std::vector<double> errors;
    for (int steps = coarsest; steps <= 4 * coarsest; steps *= 2) {
      errors.push_back((orbit(family, H, z, T / steps, steps) - exact).norm());
    }
    INFO(family.name << ": errors " << errors[0] << ", " << errors[1] << ", " << errors[2]);
    REQUIRE(errors.back() > 1e-14);
    for (std::size_t i = 1; i < errors.size(); ++i) {
      const double slope = std::log2(errors[i - 1] / errors[i]);
      CHECK(slope > family.order - 0.5);
      CHECK(slope < family.order + 1.0);
    }
  }
}

TEST_CASE("the discrete energy of a family is the Hamiltonian that generates it in h") {
  // ∂_hψ_h(z) = J∇K_h at ψ_h(z) (theory, section 8). Families here are symmetric: ψ_h⁻¹ = ψ_{-h}, so K_h(y) is E of the
  // step that ends in y. Central differences of width 1e-4 of functions with derivatives of order 1: 1e-8.
  constexpr double width = 1e-4;
  constexpr double tolerance = 3e-8;
  for (const Family& family : families()) {
    const Hamiltonian H = family.separable_only ? henon_heiles() : not_separable();
    const auto size = static_cast<Eigen::Index>(2 * H.degrees_of_freedom());
    VectorXd z(size);
    z.setLinSpaced(0.3, 0.5);
    const double h = 0.3;
    const VectorXd end = step_from(family, H, z, h).z;
    const VectorXd velocity =
        (step_from(family, H, z, h + width).z - step_from(family, H, z, h - width).z) / (2 * width);
    const auto K = [&](const VectorXd& y) {
      return VectorXd::Constant(1, step_from(family, H, step_from(family, H, y, -h).z, h).energy);
    };
    HamiltonianEvaluator evaluator(H);
    const auto plain = [&](const VectorXd& y) { return VectorXd::Constant(1, evaluator.value(y.data())); };
    const auto field = [&](const std::function<VectorXd(const VectorXd&)>& energy) {
      const VectorXd gradient = jacobian(energy, end, width).row(0).transpose();
      VectorXd result(size);
      result << gradient.tail(size / 2), -gradient.head(size / 2);
      return result;
    };
    INFO(family.name);
    CHECK((velocity - field(K)).norm() < tolerance);
    if (family.order <= 4) {
      CHECK((velocity - field(plain)).norm() > 10 * tolerance);  // the twin: H does not generate it
    }
  }
}

TEST_CASE("steps of a family with the length from its discrete energy preserve dp^dq at fixed E") {
  // The length is a root that rounding moves by ε|E|/|dE/dh|, 1e-13 to 1e-12 here; over the width of the differences
  // that is 1e-6 of the largest entries of T. Their truncation is below: width² times third derivatives.
  constexpr double width = 1e-6;
  constexpr double tolerance = 1e-5;
  for (const Family& family : families()) {
    if (family.order > 4) {
      continue;  // the slope of K is below what differences resolve
    }
    const Hamiltonian H = family.separable_only ? henon_heiles() : not_separable();
    const auto size = static_cast<Eigen::Index>(2 * H.degrees_of_freedom());
    VectorXd z(size);
    z.setLinSpaced(0.3, 0.5);
    const double h_0 = family.order == 2 ? 0.3 : 0.6;
    // The twin's energy differs by a function of the state; one of h alone would do no harm (theory, section 9).
    const auto map_with = [&](double wrong) {
      const auto energy = [&, wrong](const VectorXd& at, double h) {
        const Step step = step_from(family, H, at, h);
        return step.energy + wrong * h * step.z[0];
      };
      const double E = energy(z, h_0);
      return [&, energy, E](const VectorXd& at) {
        double last = h_0, last_miss = energy(at, last) - E;
        double h = h_0 * (1.0 + 1e-4);
        for (int i = 0; i < 50; ++i) {
          const double miss = energy(at, h) - E;
          if (miss == last_miss || std::abs(h - last) < 1e-15) {
            break;
          }
          const double next = h - miss * (h - last) / (miss - last_miss);
          last = h, last_miss = miss, h = next;
        }
        return step_from(family, H, at, h).z;
      };
    };
    const MatrixXd W = canonical_two_form(H.degrees_of_freedom());
    const auto defect = [&](double wrong) {
      const MatrixXd T = jacobian(map_with(wrong), z, width);
      return (T.transpose() * W * T - W).norm() / T.squaredNorm();
    };
    INFO(family.name);
    CHECK(defect(0.0) < tolerance);
    CHECK(defect(0.1) > 100 * tolerance);
  }
}

TEST_CASE("the generating function of Gauss's step has its discrete energy and its own derivatives") {
  const Hamiltonian H = henon_heiles();
  for (int stages = 1; stages <= GaussTableau::most_stages; ++stages) {
    VectorXd z(4);
    z << 0.1, 0.2, 0.3, 0.1;
    const double h = 0.3;
    const Family gauss{
        "", [stages](const Hamiltonian& g, const VectorXd& at) { return make_gauss_scheme(g, stages, span_of(at)); }};
    const Step step = step_from(gauss, H, z, h);
    GaussFunction function(H, stages);
    VectorXd w = 0.5 * (z + step.z);
    REQUIRE(function.expand(span_of(w), h) == Status::success);
    CHECK(std::abs(function.rate() + step.energy) < 16 * epsilon);
    VectorXd J_delta(4);
    J_delta << (step.z - z).tail(2), -(step.z - z).head(2);
    CHECK((function.gradient() - J_delta).norm() < 16 * epsilon);

    // Differences of width 1e-5: truncation and rounding below 1e-9.
    const double d = 1e-5;
    double second_rate = 0.0;
    VectorXd gradient_rate;
    MatrixXd hessian;
    REQUIRE(function.second_variation(second_rate, gradient_rate, hessian) == Status::success);
    const VectorXd gradient = function.gradient();
    const double rate = function.rate();
    const auto at = [&](const VectorXd& place, double length) {
      REQUIRE(function.expand(span_of(place), length) == Status::success);
      VectorXd all(6);
      all << function.value(), function.rate(), function.gradient();
      return all;
    };
    const VectorXd by_h = (at(w, h + d) - at(w, h - d)) / (2 * d);
    CHECK(std::abs(by_h[0] - rate) < 1e-9);
    CHECK(std::abs(by_h[1] - second_rate) < 1e-9);
    CHECK((by_h.tail(4) - gradient_rate).norm() < 1e-9);
    const MatrixXd by_w = jacobian([&](const VectorXd& place) { return at(place, h); }, w, d);
    CHECK((by_w.row(0).transpose() - gradient).norm() < 1e-9);
    CHECK((by_w.row(1).transpose() - gradient_rate).norm() < 1e-9);
    CHECK((by_w.bottomRows(4) - hessian).norm() < 1e-9);
    CHECK((by_w.bottomRows(4) + hessian).norm() > 1e-3);  // a twin
  }
}

TEST_CASE("with variable levels the discrete energy of every family that keeps a sign is one number") {
  VectorXd z(4);
  z << 0.1, 0.2, 0.3, 0.1;
  const Hamiltonian H = henon_heiles();
  for (const Family& family : families()) {
    if (family.name != "golden" && family.name != "gauss 1" && family.name != "gauss 2" && family.name != "gauss 3" &&
        family.name != "gauss points 1" && family.name != "gauss points 2") {
      continue;  // on this orbit the others' step laws change their sign, or their terms are below rounding
    }
    const auto scheme = family.make(H, z);
    TimeLevels levels(*scheme, {.on_singular = OnSingular::stop}, 0.0, 0.2);
    double least = INFINITY, greatest = -INFINITY, shortest = INFINITY, longest = 0.0;
    while (levels.time() < 100.0) {
      const StepReport report = levels.step();
      INFO(family.name << " at t = " << levels.time());
      REQUIRE(report.status == Status::success);
      least = std::min(least, report.energy);
      greatest = std::max(greatest, report.energy);
      shortest = std::min(shortest, report.h);
      longest = std::max(longest, report.h);
    }
    INFO(family.name);
    CHECK(greatest - least <= 1e-13 * levels.energy_scale() * 2);
    CHECK(longest > 1.01 * shortest);  // it is the levels that keep it
  }
}

TEST_CASE("a family's run goes on bit for bit from its saved state, and a trial that is not taken leaves no trace") {
  VectorXd z(4);
  z << 0.1, 0.2, 0.3, 0.1;
  const Hamiltonian H = henon_heiles();
  for (const Family& family : families()) {
    const auto whole = family.make(H, z);
    const auto again = family.make(H, z);
    StateWriter saved;
    for (int k = 0; k < 20; ++k) {
      REQUIRE(whole->advance(0.2, 0.0) == Status::success);
      whole->accept();
      if (k == 9) {
        whole->save(saved);
      }
    }
    StateReader reader(saved.values());
    again->restore(reader);
    CHECK(reader.done());
    for (int k = 10; k < 20; ++k) {
      REQUIRE(again->advance(0.2, 0.0) == Status::success);
      again->accept();
    }
    INFO(family.name);
    CHECK(state_of(*whole) == state_of(*again));
  }
}

TEST_CASE("the slope of a family's discrete energy is its derivative to leading order") {
  VectorXd z(4);
  z << 0.1, 0.2, 0.3, 0.1;
  const Hamiltonian H = henon_heiles();
  for (const Family& family : families()) {
    if (family.order > 6) {
      continue;
    }
    const double h = family.order == 2 ? 0.1 : 0.4, width = 1e-3 * h;
    const auto scheme = family.make(H, z);
    REQUIRE(scheme->advance(h, 0.0) == Status::success);
    const double slope = scheme->discrete_energy_slope();
    const double difference =
        (step_from(family, H, z, h + width).energy - step_from(family, H, z, h - width).energy) / (2 * width);
    INFO(family.name << ": " << slope << ", " << difference);
    CHECK(std::abs(slope / difference - 1.0) < 0.3);
  }
}

TEST_CASE("a splitting names the term that mixes coordinates and momenta") {
  VectorXd z(2);
  z << 0.3, 0.4;
  CHECK(separate(henon_heiles()).separable());
  CHECK(separate(Hamiltonian({"q"}, {"p"}, "(p^2 - 2*cos(q))/2 - (3 - exp(p))*2")).separable());
  const Hamiltonian mixed({"q"}, {"p"}, "p^2/2 + q*p + q^2");
  CHECK(separate(mixed).mixed == "q*p");
  CHECK_THROWS_WITH(make_splitting_scheme(mixed, composition("golden"), span_of(z)), Catch::Matchers::Contains("q*p"));
  CHECK_THROWS_WITH(composition("ruth-3"), Catch::Matchers::Contains("kahan-li-8"));
}

TEST_CASE("a composition of Nyström's kind is taken where T is quadratic, and loses its order elsewhere") {
  VectorXd z(2);
  z << 0.3, 0.4;
  const Composition& nystrom = composition("blanes-moan-rkn-6");
  const Hamiltonian turned({"a", "b"}, {"p", "r"}, "(p + r)^2/2 + (p - 2*r + 3)^2/5 + p - cos(a)*b");
  VectorXd two(4);
  two << 0.1, 0.2, 0.3, 0.4;
  CHECK_NOTHROW(make_splitting_scheme(turned, nystrom, span_of(two)));
  const Hamiltonian quartic({"q"}, {"p"}, "p^2/2 + p^4/8 - cos(q)");
  CHECK_THROWS_WITH(make_splitting_scheme(quartic, nystrom, span_of(z)),
                    Catch::Matchers::Contains("degree two alone") && Catch::Matchers::Contains("kahan-li-6"));

  // Taken all the same it has order 4 there: steps half as long err by 2⁴, not 2⁶. Beside Gauss collocation of
  // order 16.
  Composition taken = nystrom;
  taken.of_quadratic_kinetic_energy = false;
  const double until = 6.0;
  const auto order = [&](const Hamiltonian& H) {
    const auto end = [&](const std::unique_ptr<OneStepScheme>& scheme, int steps) {
      for (int k = 0; k < steps; ++k) {
        REQUIRE(scheme->advance(until / steps, 0.0) == Status::success);
        scheme->accept();
      }
      return state_of(*scheme);
    };
    const VectorXd exact = end(make_gauss_scheme(H, 8, span_of(z)), 60);
    const auto error = [&](int steps) {
      return (end(make_splitting_scheme(H, taken, span_of(z)), steps) - exact).norm();
    };
    return std::log2(error(8) / error(32)) / 2.0;
  };
  CHECK(order(Hamiltonian({"q"}, {"p"}, "p^2/2 - cos(q) + q^4/5")) > 5.6);
  CHECK(order(quartic) < 5.0);
}

namespace {

/// One number of a state, and what rounding has left of it.
struct Added {
  double high, low = 0.0;

  void add(double change) {
    const double taken = low + change, sum = high + taken;
    low = taken - (sum - high);
    high = sum;
  }
};

}  // namespace

TEST_CASE("a splitting's whole step is its parts one after the other, bit for bit") {
  // H = Σ p_i²/2 + V(q_i), whose halves are known, as one formula, and as passes over long ones.
  struct Potential {
    double (*energy)(double);
    double (*slope)(double);
    Expression (*formula)(Expression);
  };
  const Potential pendulum{[](double q) { return -std::cos(q); }, [](double q) { return std::sin(q); },
                           [](Expression q) { return -cos(q); }};
  const Potential quartic{[](double q) { return q * q * (q * q) / 4; }, [](double q) { return q * (q * q); },
                          [](Expression q) { return pow(q, 4.0) / 4.0; }};
  const auto by_hand = [](const Composition& one, const Potential& V, double q, double p, double h) {
    Added here{q}, there{p};
    double energy = 0.0;
    for (const Composition::Part& part : one.parts) {
      if (part.drift) {
        energy += part.length * (there.high * there.high / 2);
        here.add(part.length * h * there.high);
      } else {
        energy += part.length * V.energy(here.high);
        there.add(-(part.length * h) * V.slope(here.high));
      }
    }
    return std::array{here.high, there.high, energy};
  };
  std::set<std::pair<bool, std::size_t>> seen;
  const std::vector<std::pair<Potential, std::size_t>> cases{
      {pendulum, 1}, {pendulum, 60}, {quartic, 1}, {quartic, 40}, {quartic, 203}};
  for (const auto& [V, n] : cases) {
    const Hamiltonian H(n, [&](const auto& q, const auto& p) {
      auto sum = p[0] * p[0] / 2 + V.formula(q[0]);
      for (std::size_t i = 1; i < q.size(); ++i) {
        sum += p[i] * p[i] / 2 + V.formula(q[i]);
      }
      return sum;
    });
    const rubato::Separation halves = rubato::separate(H);
    const std::span variables(H.variables());
    const rubato::SplittingHalf T(halves.T, variables.subspan(n)), rest(halves.V, variables.first(n));
    VectorXd z(2 * n);
    for (std::size_t i = 0; i < n; ++i) {
      z[static_cast<Eigen::Index>(i)] = 0.3 + 0.01 * static_cast<double>(i);
      z[static_cast<Eigen::Index>(n + i)] = 1.7 - 0.02 * static_cast<double>(i);
    }
    for (const Composition& one : compositions()) {
      const auto scheme = make_splitting_scheme(H, one, span_of(z));
      seen.emplace(rubato::is_long(T, rest, one), n);
      for (const double h : {0.1, -0.7}) {
        REQUIRE(scheme->advance(h, 0.0) == Status::success);
        scheme->accept();
        double energy = 0.0;
        for (std::size_t i = 0; i < n; ++i) {
          const double q = z[static_cast<Eigen::Index>(i)], p = z[static_cast<Eigen::Index>(n + i)];
          const auto expected = by_hand(one, V, q, p, h);
          INFO(one.name << ", n = " << n << ", h = " << h);
          CHECK(scheme->state()[i] == expected[0]);
          CHECK(scheme->state()[n + i] == expected[1]);
          CHECK(by_hand(one, V, q, p, h * (1.0 + 1e-12))[0] != expected[0]);
          energy += expected[2];
        }
        // Sums of n terms of size 2, in another order.
        CHECK(std::abs(scheme->discrete_energy() - energy) <= 8e-16 * static_cast<double>(n * n));
        scheme->restart(span_of(z));
      }
    }
  }
  CHECK(seen.contains({true, 40}));
  CHECK(seen.contains({false, 40}));
  CHECK(seen.contains({true, 203}));
}
