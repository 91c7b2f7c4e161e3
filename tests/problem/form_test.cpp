// What `show --form` prints: symmetries, dispersion and schemes that are known from textbooks, and twins that have lost
// them.

#include <catch2/catch.hpp>

#include <string>
#include <vector>

#include <fmt/format.h>

#include <rubato/problem/form.hpp>
#include <rubato/problem/problem.hpp>

using namespace rubato;
using Catch::Matchers::Contains;

namespace {

std::string form(const std::string& field, FormStyle style = FormStyle::text,
                 const std::string& grid = "x = { from = 0, to = 20, cells = 33 }") {
  const std::string initial =
      field.find("psi") != std::string::npos ? "psi = \"cos(pi*x/10)\"" : "u = \"cos(pi*x/10)\"";
  const std::string rate = field.find("u_tt") != std::string::npos ? "\nu_t = 0" : "";
  return form_of(
      parse_problem(fmt::format("[field]\n{}\n[grid]\n{}\n[initial]\n{}{}\n[scheme]\nstep = 0.1\nuntil = 1\n", field,
                                grid, initial, rate),
                    "p"),
      style);
}

const std::string kdv = "equation = \"u_t + 6*u*u_x + u_xxx = 0\"",
                  nls = "psi = [\"p\", \"q\"]\nequation = \"i*psi_t + psi_xx + 2*abs2(psi)*psi = 0\"",
                  sine_gordon = "equation = \"u_tt = u_xx - sin(u)\"";

}  // namespace

TEST_CASE("the dispersion relation of the linear part") {
  CHECK_THAT(form(sine_gordon), Contains("omega^2 = k^2 + 1\n"));
  CHECK_THAT(form("equation = \"u_tt = u_xx - 2*sin(u)\""), Contains("omega^2 = k^2 + 2\n"));
  CHECK_THAT(form(kdv), Contains("omega = -k^3\n"));
  CHECK_THAT(form(nls), Contains("omega^2 = k^4\n"));
  // (1 + k²) ω = k
  CHECK_THAT(form("equation = \"u_t + u_x + u*u_x - u_xxt = 0\""),
             Contains("omega") && Contains("k^2*omega") || Contains("omega*k^2"));
  CHECK_THAT(form("equation = \"u_tt = u_xx + 4*u_yy - u\"", FormStyle::text,
                  "x = { from = 0, to = 20, cells = 9 }\ny = { from = 0, to = 20, cells = 9 }"),
             Contains("omega^2 = k_x^2 + 4*k_y^2 + 1\n"));
}

TEST_CASE("scalings and Galilei's transformation are found where an equation has them") {
  // u -> l^2 u(l x, l^3 t), and u + v/6 in a frame that moves with v.
  CHECK_THAT(form(kdv), Contains("x -> l^(1/3) x") && Contains(" u -> l^(-2/3) u,"));
  CHECK_THAT(form(kdv), Contains("Galilei, x -> x + v*t") && Contains("u -> u + v*(0.16666666666666666)"));
  // psi -> exp(i v x/2) psi, to first order.
  CHECK_THAT(form(nls), Contains("p -> p + v*(-0.5*(q*x)), q -> q + v*(0.5*(p*x))"));
  CHECK_THAT(form(nls), Contains("linear, z -> exp(s B) z: charge\n  density = -0.5*p^2 + -0.5*q^2"));
  // Twins: a dispersion of two orders has no scaling, a wave no Galilei, a trap neither it nor momentum.
  CHECK_THAT(form("equation = \"u_t + 6*u*u_x + u_xxx - u_xxxxx = 0\""), !Contains("scaling") && Contains("Galilei"));
  CHECK_THAT(form(sine_gordon), !Contains("Galilei") && !Contains("scaling"));
  CHECK_THAT(form("psi = [\"p\", \"q\"]\nequation = \"i*psi_t + psi_xx - x^2*psi = 0\""),
             !Contains("Galilei") && Contains("translation in x: momentum, with a source: a balance"));
}

TEST_CASE("numbers of a form are printed as they were meant, and kept as they are in TOML") {
  const std::string sum = "equation = \"u_tt = 0.1*3*u_xx - u^3\"", third = "equation = \"u_tt = u_xx/3 - u^3\"";
  CHECK_THAT(form(sum), Contains("omega^2 = 0.3*k^2\n") && !Contains("00000004"));
  CHECK_THAT(form(sum, FormStyle::toml), Contains("0.15000000000000002"));
  CHECK_THAT(form(third), Contains("omega^2 = 0.3333333333333333*k^2\n"));  // has no shorter decimal
  CHECK_THAT(form(kdv), !Contains("v*(-0)") && !Contains("v*(0)"));
}

TEST_CASE("the form says which schemes take an equation, and why others do not") {
  CHECK_THAT(form(kdv),
             Contains("box        yes\n") && Contains("leapfrog   no: leapfrog is for equations of wave type"));
  CHECK_THAT(form(sine_gordon), Contains("leapfrog   yes\n"));
}

TEST_CASE("the form as TOML is a problem of its own, and as LaTeX has its formulas") {
  const std::string toml = form(kdv, FormStyle::toml);
  CHECK_THAT(toml, Contains("[multisymplectic]"));
  const Problem again = parse_problem(
      toml + "\n[grid]\nx = { from = 0, to = 20, cells = 33 }\n[initial]\nu = 1\n[scheme]\nstep = 0.1\nuntil = 1\n",
      "p");
  // Stated by M, K and S its form says the same, but for what was stated.
  CHECK_THAT(form_of(again, FormStyle::toml), Contains("S = "));
  CHECK_THAT(form_of(again, FormStyle::text), Contains("omega = -k^3\n") && !Contains("as stated, or found"));
  CHECK_THAT(form(kdv), Contains("as stated, or found"));
  CHECK_THAT(form(sine_gordon, FormStyle::latex),
             Contains("\\omega^{2} = k^{2} + 1") && Contains("\\sin\\left(u\\right)"));
  CHECK_THROWS_WITH(form_of(read_problem("pendulum"), FormStyle::text), Contains("this is an orbit"));
}
