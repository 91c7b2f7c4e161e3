// Generating functions as a user of problem files meets them.
#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <rubato/ode/generating_scheme.hpp>
#include <rubato/problem/location.hpp>
#include <rubato/problem/orbit_problem.hpp>
#include <rubato/run/converge.hpp>
#include <rubato/run/run.hpp>

#include "records.hpp"

namespace {

using namespace rubato;
using namespace rubato;

std::string problem_text(const std::string& H, const std::string& scheme, const std::string& q = "0.5") {
  return "[hamiltonian]\nq = [\"q\"]\np = [\"p\"]\nH = \"" + H + "\"\n[initial]\nq = " + q +
         "\np = 1\n[scheme]\nlagrangian = \"generating\"\nlevels = \"fixed\"\nstep = 0.25\nuntil = 2\n" + scheme;
}

Outcome run_text(const std::string& text) {
  const run_tests::Folder folder;  // of its own: tests may run side by side
  return run(parse_problem(text, "test.toml"), {.output = folder / "run.h5"});
}

/// What is said of a problem that is refused, with its place in front; empty if it is not refused.
std::string refusal(const std::string& text) {
  try {
    static_cast<void>(make_integrator(parse_problem(text, "test.toml")));
  } catch (const ProblemError& error) {
    return error.what();
  }
  return {};
}

}  // namespace

TEST_CASE("an odd order with F = 0 rounds up, and the run says so", "[run]") {
  const Outcome odd = run_text(problem_text("p^2/2 - cos(q)", "order = 3\n"));
  CHECK(odd.status == ExitStatus::done);
  REQUIRE(odd.warnings.size() == 1);
  CHECK_THAT(odd.warnings.front(), Catch::Contains("order = 3 rounds up to 4"));
  CHECK(run_text(problem_text("p^2/2 - cos(q)", "order = 4\n")).warnings.empty());
  CHECK(run_text(problem_text("p^2/2 - cos(q)", "order = 3\ndarboux = \"euler-a\"\n")).warnings.empty());
}

TEST_CASE("types that are no good for variable levels or for starting pairs are warned of, or refused", "[run]") {
  const std::string H = "p^2/2 - cos(q)";
  // The angle grows throughout, but φ² = ∓½q'p' changes sign at every turning point of p; the run ends before one.
  const auto with_levels = [&](const std::string& levels, const std::string& darboux) {
    std::string text = problem_text(H, "order = 1\ndarboux = \"" + darboux + "\"\non_singular = \"plain\"\n");
    const std::string fixed = "levels = \"fixed\"";
    text.replace(text.find(fixed), fixed.size(), "levels = \"" + levels + "\"");
    return run_text(text).warnings;
  };
  const auto mentions = [](const std::vector<std::string>& warnings, const std::string& words) {
    return std::ranges::any_of(warnings, [&](const std::string& w) { return w.find(words) != std::string::npos; });
  };
  CHECK(mentions(with_levels("variable", "euler-a"), "sign at every turning point"));
  CHECK(mentions(with_levels("variable", "euler-b"), "levels = \"fixed\" is the choice"));
  CHECK_FALSE(mentions(with_levels("fixed", "euler-a"), "turning point"));
  CHECK_FALSE(mentions(with_levels("variable", "midpoint"), "turning point"));

  const auto with_pair = [&](const std::string& darboux) {
    return problem_text(H, "order = 2\ndarboux = " + darboux + "\n[initial.next]\nt = 0.25\nq = 0.73\np = 0.86\n");
  };
  // FJ = [[-b, a], [-c, b]] for F = [[a, b], [b, c]]: eigenvalues ±√(b² - ac), imaginary for definite F.
  CHECK(mentions(run_text(with_pair("[[1, 0], [0, -0.25]]")).warnings, "grows by a factor of 3 in every step"));
  CHECK_FALSE(mentions(run_text(with_pair("[[1, 0], [0, 0.25]]")).warnings, "parasite"));
  CHECK_FALSE(mentions(run_text(with_pair("\"midpoint\"")).warnings, "parasite"));
  const std::string refused = refusal(with_pair("\"euler-a\""));
  CHECK_THAT(refused, Catch::Contains("arbitrary starting pair cannot be continued"));
  CHECK_THAT(refused, Catch::Contains("test.toml:15:"));  // [initial.next]
  CHECK_THROWS_WITH(converge(parse_problem(with_pair("\"midpoint\""), "test.toml"), std::nullopt),
                    Catch::Contains("the end of one step: leave it out"));
}

TEST_CASE("generating functions that cannot be are refused at their place", "[run]") {
  const std::string H = "p^2/2 - cos(q)";
  CHECK_THAT(refusal(problem_text(H, "order = 0\n")), Catch::Contains("test.toml:13:9"));
  CHECK_THAT(refusal(problem_text(H, "order = 500\n")), Catch::Contains("up to order 99"));
  CHECK_THAT(refusal(problem_text(H, "order = 2\ndarboux = [[1, 2], [3, 4]]\n")), Catch::Contains("not symmetric"));
  CHECK_THAT(refusal(problem_text(H, "order = 2\ndarboux = [[1]]\n")), Catch::Contains("2×2"));
  CHECK_THAT(refusal(problem_text(H, "")), Catch::Contains("needs an order"));
  CHECK_THAT(refusal(problem_text("p^2/2 + abs(q)", "order = 4\n", "0")),
             Catch::Contains("abs has no Taylor expansion at 0"));
  CHECK_THAT(refusal(problem_text("p^2/2 - 1/q", "order = 4\n", "0")), Catch::Contains("division"));
  CHECK(refusal(problem_text(H, "order = 2\ndarboux = [[1, 2], [2, 4]]\n")).empty());
}

TEST_CASE("a run that meets a kink ends with status 4, the reason, and all its levels", "[run]") {
  // q moves by 1/4 a step, p by -1/8 a step: the fifth midpoint is at q = 1.125.
  const Outcome outcome = run_text(problem_text("p + abs(q - 1.125)/2", "order = 4\n", "0"));
  CHECK(outcome.status == ExitStatus::failed);
  CHECK(outcome.statistics.steps == 4);
  CHECK_THAT(outcome.message, Catch::Contains("abs has no Taylor expansion at 0"));
}

namespace {

/// Puts the centre of mass at rest in the origin. Where it drifts, the coordinates grow to hundreds of units in a
/// million steps and their differences, which is all that H reads, lose the digits.
void to_barycentre(const Problem& problem, std::vector<double>& z) {
  const std::vector<std::string> bodies = {"sun", "jupiter", "saturn", "uranus", "neptune", "pluto"};
  std::vector<double> masses;
  double total = 0.0;
  for (const std::string& body : bodies) {
    const auto found = std::ranges::find(problem.parameters, "m_" + body, &Parameter::name);
    REQUIRE(found != problem.parameters.end());
    masses.push_back(found->value);
    total += found->value;
  }
  for (std::size_t axis = 0; axis < 3; ++axis) {
    double position = 0.0;
    double velocity = 0.0;
    for (std::size_t b = 0; b < bodies.size(); ++b) {
      position += masses[b] * z[3 * b + axis] / total;
      velocity += z[18 + 3 * b + axis] / total;
    }
    for (std::size_t b = 0; b < bodies.size(); ++b) {
      z[3 * b + axis] -= position;
      z[18 + 3 * b + axis] -= masses[b] * velocity;
    }
  }
}

struct EnergyErrors {
  double largest = 0.0;
  double late_mean = 0.0;  ///< over the last tenth of the run
};
/// Relative energy errors over `steps` steps of h days of the outer Solar System at order 12.
EnergyErrors solar_system_errors(long steps, double h) {
  const Problem problem = read_problem("outer-solar-system");
  const Hamiltonian hamiltonian = make_hamiltonian(problem);
  const PhasePoint& start = problem.hamiltonian()->initial;
  std::vector<double> z = start.q;
  z.insert(z.end(), start.p.begin(), start.p.end());
  to_barycentre(problem, z);
  const auto scheme = make_generating_scheme(hamiltonian, Eigen::MatrixXd::Zero(36, 36), 12, z);
  HamiltonianEvaluator evaluator(hamiltonian);
  const double energy = evaluator.value(z.data());
  const long late = steps - steps / 10;
  EnergyErrors errors;
  for (long k = 1; k <= steps; ++k) {
    REQUIRE(scheme->advance(h, 0.0) == Status::success);
    scheme->accept();
    const double error = evaluator.value(scheme->state().data()) / energy - 1.0;
    errors.largest = std::max(errors.largest, std::abs(error));
    errors.late_mean += k > late ? error / static_cast<double>(steps - late) : 0.0;
  }
  return errors;
}

/// What rounding adds to the relative energy error in a step, at random: δ is rounded at ε|δ|, |δ| is ωh of the size of
/// the orbit, and ω is that of Jupiter.
double rounding_of_a_step(double h) {
  return 2.3e-16 * 2.0 * 3.1416 * h / 4332.6;
}

}  // namespace

TEST_CASE("the outer Solar System at order 12 keeps its energy to rounding", "[run]") {
  // 87 steps a Jupiter year: the truncation error of the energy, 1e-13 at h = 100, is 3e-17 here. H itself is rounded
  // by some ten units of the last place.
  CHECK(solar_system_errors(400, 50).largest <= 10 * 2.3e-16);
  CHECK(solar_system_errors(400, 200).largest > 10 * 2.3e-16);
}

TEST_CASE("the outer Solar System at order 12 does not drift", "[run]") {
  // Three standard deviations of a random walk, 6e-15. A step that rounds δ, or leaves the residual of the prediction
  // uncorrected however small it is, moves the energy by 6e-19 at h = 44, always to one side: 12e-15.
  constexpr long steps = 20'000;
  CHECK(std::abs(solar_system_errors(steps, 44).late_mean) <= 3 * rounding_of_a_step(44) * std::sqrt(steps));
}

TEST_CASE("a million steps of the outer Solar System at order 12", "[run][long]") {
  constexpr long steps = 1'000'000;
  for (const double h : {44.0, 50.0, 55.0}) {
    const EnergyErrors errors = solar_system_errors(steps, h);
    WARN("h = " << h << ": largest relative energy error " << errors.largest << ", mean of the last tenth "
                << errors.late_mean);
    // Four standard deviations at any time, 7e-14; a drift of 1e-19 a step would be caught.
    CHECK(errors.largest <= 4 * rounding_of_a_step(h) * std::sqrt(steps));
  }
}
