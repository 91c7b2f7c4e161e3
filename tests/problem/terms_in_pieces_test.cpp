// Terms of an equation, or of S, that are 0 near 0: none is lost, and none makes a symmetry.

#include <catch2/catch.hpp>

#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include <rubato/formula/bytecode.hpp>
#include <rubato/problem/lattice_problem.hpp>
#include <rubato/problem/problem.hpp>

using namespace rubato;
using Catch::Contains;

namespace {

std::string wave(const std::string& force) {
  return "[field]\nequation = \"u_tt = u_xx - " + force +
         "\"\n[grid]\nx = { from = -20, to = 20, cells = 101 }\n[initial]\nu = \"exp(-x^2)\"\nu_t = 0\n[scheme]\n"
         "lagrangian = \"fourier\"\nlevels = \"fixed\"\nstep = 0.1\nuntil = 1\n";
}

/// ∂S/∂u, which is the force, at this place; nothing where the equation is refused.
std::optional<double> force_at(const std::string& force, double x, double u) {
  std::optional<Problem> problem;
  try {
    problem = parse_problem(wave(force), "t.toml");
  } catch (const ProblemError& error) {
    CHECK_THAT(error.what(), Contains("density"));
    return std::nullopt;
  }
  const MultisymplecticSystem system = make_system(*problem);
  std::vector<double> point(system.variables().size(), 0.0), outputs(1 + system.fields().size());
  point[static_cast<std::size_t>(system.field("u"))] = u;
  if (!system.coordinates().empty()) {
    point[system.fields().size()] = x;
  }
  formula::ScalarEvaluator(system.gradient_code())(point, outputs);
  return outputs[1 + static_cast<std::size_t>(system.field("u"))];
}

}  // namespace

TEST_CASE("a coefficient that is 0 in most places stays in the equation", "[problem][field]") {
  struct Case {
    std::string force;
    double x, u, value;
  };
  for (const auto& [force, x, u, value] :
       {Case{"where(x > 3, 20, 0)*u", 4.0, 0.7, 14.0}, Case{"where(x < -3, 20, 0)*u", -4.0, 0.7, 14.0},
        Case{"max(0, x - 3)*u", 5.0, 0.7, 1.4}, Case{"u*(x - abs(x))", -2.0, 0.7, -2.8},
        Case{"5*exp(-1000*(x - 12)^2)*u", 12.01, 0.7, 3.5 * std::exp(-0.1)},
        Case{"5*sech(100*(x - 12))^2*u", 12.001, 0.7, 3.5 / std::pow(std::cosh(0.1), 2)}}) {
    INFO(force);
    const auto found = force_at(force, x, u);
    REQUIRE(found);
    CHECK(*found == Approx(value).epsilon(1e-9));
  }
}

TEST_CASE("a force that acts at large values alone stays, or is refused", "[problem][field]") {
  struct Case {
    std::string force;
    double u, value;
  };
  for (const auto& [force, u, value] :
       {Case{"max(0, u - 2)^3", 4.0, 8.0}, Case{"min(0, u)", -2.0, -2.0}, Case{"100*min(0, u + 0.5)", -1.0, -50.0},
        Case{"max(0, abs(u) - 2)^3*sign(u)", -3.0, -1.0}, Case{"20*where(u > 3, sin(u), 0)", 4.0, 20.0 * std::sin(4.0)},
        Case{"floor(u/10)", 25.0, 2.0}}) {
    INFO(force);
    if (const auto found = force_at(force, 0.0, u)) {
      CHECK(*found == Approx(value));
    }
  }
}

TEST_CASE("forces that couple fields in one direction have no density, however far from 0 they begin",
          "[problem][field]") {
  const std::string text =
      "[field]\nequation = [\"u_tt = 2*u_xx - u - max(0, w - 2)\", \"w_tt = w_xx - w\"]\n"
      "[grid]\nx = { from = -20, to = 20, cells = 101 }\n[initial]\nu = \"exp(-x^2)\"\nu_t = 0\nw = 0\nw_t = 0\n"
      "[scheme]\nlagrangian = \"fourier\"\nlevels = \"fixed\"\nstep = 0.1\nuntil = 1\n";
  CHECK_THROWS_AS(parse_problem(text, "t.toml"), ProblemError);
}

TEST_CASE("what S has at large values alone breaks symmetries and turns", "[problem]") {
  const auto text = [](const std::string& more) {
    return "[field]\nfields = [\"p\", \"q\"]\nH = \"p_x^2 + q_x^2 - (p^2 + q^2)^2 + " + more +
           "\"\nstructure = \"schroedinger\"\npsi = [\"p\", \"q\"]\n[grid]\nx = { from = -10, to = 10, cells = 64 }\n"
           "[initial]\npsi = \"2.2*exp(-x^2/4)\"\n"
           "[scheme]\nlagrangian = \"splitting\"\nlevels = \"fixed\"\nstep = 0.01\nuntil = 0.1\n";
  };
  const auto begins = [&](const std::string& more, const std::vector<std::string>& settings) {
    try {
      static_cast<void>(make_lattice(parse_problem(text(more), "t.toml", settings)));
      return true;
    } catch (const ProblemError&) {
      return false;
    }
  };
  const std::vector<std::string> splitting = {}, turning = {"scheme.lagrangian=fourier", "scheme.frame.phase.charge=3"};
  CHECK(begins("2*max(0, p^2 + q^2 - 3)^3", splitting));
  CHECK_FALSE(begins("2*max(0, p - 1.6)^3", splitting));
  CHECK(begins("2*max(0, p^2 + q^2 - 3)^3", turning));
  CHECK_FALSE(begins("2*max(0, p - 1.6)^3", turning));
}
