// Walls of box: rows of its own at both ends (WallConditions), for any number of cells.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <Eigen/Core>

#include <rubato/problem/lattice_problem.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/run.hpp>

#include "problem_texts.hpp"
#include "records.hpp"

using namespace rubato;
using namespace rubato::run_tests;
using Catch::Matchers::Contains;

namespace {

constexpr const char* box_string = R"toml(
[multisymplectic]
fields = ["u", "v", "w"]
M = [["u", "v", -1]]
K.x = [["u", "w", 1]]
S = "(v^2 - w^2)/2"
[parameters]
k = "pi/3"
[grid]
x = { from = 0, to = 3, cells = 20, left = "fixed", right = "fixed" }
[initial]
u = "sin(k*x)"
v = "0"
[exact]
u = "sin(k*x)*cos(k*t)"
[scheme]
lagrangian = "box"
levels = "fixed"
step = 0.1
until = 1.3
)toml";

/// Both ends, and a wave that stands between them.
struct BoxEnds {
  const char *left, *right, *form, *k;

  [[nodiscard]] Settings settings() const {
    return {fmt::format("grid.x.left={}", left), fmt::format("grid.x.right={}", right),
            fmt::format("initial.u={}(k*x)", form), fmt::format("exact.u={}(k*x)*cos(k*t)", form),
            fmt::format("parameters.k={}", k)};
  }
};
constexpr BoxEnds box_ends[] = {{"fixed", "fixed", "sin", "pi/3"},
                                {"free", "free", "cos", "pi/3"},
                                {"fixed", "free", "sin", "pi/2"},
                                {"free", "fixed", "cos", "pi/2"}};

Outcome box_outcome(const std::string& file, const Settings& settings, const std::string& problem = box_string) {
  Outcome outcome =
      run(parse_problem(problem, "box.toml", settings), {.output = file, .overwrite = true, .threads = 1});
  REQUIRE(outcome.complete);
  return outcome;
}

/// The largest fourth difference over 16: the amplitude of a sawtooth, or of a wave of twenty nodes its part of (k
/// Δx)^4.
double sawtooth_of(const std::vector<double>& z) {
  double largest = 0.0;
  for (std::size_t i = 0; i + 4 < z.size(); ++i) {
    largest = std::max(largest, std::abs(z[i] - 4.0 * z[i + 1] + 6.0 * z[i + 2] - 4.0 * z[i + 3] + z[i + 4]) / 16.0);
  }
  return largest;
}

}  // namespace

TEST_CASE("waves stand between walls of box with order 2, on even and on odd numbers of cells") {
  const Folder folder;
  for (const BoxEnds& ends : box_ends) {
    for (const int odd : {0, 1}) {
      std::vector<double> errors;
      for (const int cells : {20 + odd, 40 + odd, 80 + odd}) {
        const Outcome outcome = box_outcome(
            folder / "a.h5", joined(ends.settings(), {fmt::format("grid.x.cells={}", cells),
                                                      fmt::format("scheme.step={}", 0.1 * (20 + odd) / cells)}));
        errors.push_back(outcome.statistics.errors.front().value.largest());
        // S is quadratic, so that equal levels keep the energy, to some roundings.
        CHECK(outcome.statistics.relative_energy_deviation().value() < 1e-13);
      }
      INFO(ends.left << ", " << ends.right << ", " << 20 + odd << ": errors " << errors[0] << ", " << errors[1] << ", "
                     << errors[2]);
      CHECK(std::log2(errors[0] / errors[1]) == Approx(2.0).margin(0.2));
      CHECK(std::log2(errors[1] / errors[2]) == Approx(2.0).margin(0.2));
      CHECK(check(folder / "a.h5").status == ExitStatus::done);
    }
  }
  // The twin: the wave of other walls.
  Settings other = box_ends[0].settings();
  other[1] = "grid.x.right=free";
  CHECK(box_outcome(folder / "a.h5", other).statistics.errors.front().value.largest() > 0.1);
}

TEST_CASE("no sawtooth grows between walls of box in ten thousand steps") {
  const Folder folder;
  const std::string problem = with(box_string, "(v^2 - w^2)/2", "(v^2 - w^2)/2 + 1 - cos(u)");
  for (const BoxEnds& ends : box_ends) {
    for (const int cells : {20, 21}) {
      INFO(ends.left << ", " << ends.right << ", " << cells);
      Settings settings = ends.settings();
      settings.erase(settings.begin() + 3);
      settings.insert(settings.end(), {fmt::format("grid.x.cells={}", cells), "scheme.until=1000", "output.every=1000",
                                       "laws.every=false"});
      const Outcome outcome =
          box_outcome(folder / "a.h5", settings, with(problem, "[exact]\nu = \"sin(k*x)*cos(k*t)\"\n", ""));
      // An energy error of second order in the step stays bounded; a mode that grew would not.
      CHECK(outcome.statistics.relative_energy_deviation().value() < 1e-2);
      const record::Reader reader(folder / "a.h5");
      CHECK(sawtooth_of(last_row(reader, "/states/u")) < 1e-3);
      CHECK(sawtooth_of(last_row(reader, "/states/v")) < 1e-3);
    }
  }
}

TEST_CASE("momentum of box and the force on both walls balance with the residuals of the cells") {
  // Δx Σ_c r_c = (P_{k+1} - P_k)/h + F_N - F_0, F = S(z̄) + (δ_t z)ᵀM₊z̄ at a node.
  const Folder folder;
  const std::string problem = with(box_string, "(v^2 - w^2)/2", "(v^2 - w^2)/2 + 1 - cos(u)");
  static_cast<void>(box_outcome(folder / "a.h5",
                                {"laws.fields=true", "output.every=1", "initial.u=2*sin(k*x)", "initial.v=sin(2*k*x)"},
                                with(problem, "[exact]\nu = \"sin(k*x)*cos(k*t)\"\n", "")));
  const record::Reader reader(folder / "a.h5");
  const Eigen::MatrixXd plus = make_system(parse_problem(problem, "box.toml")).structure().M_plus;
  const std::vector<double> residuals = reader.read("/laws/fields/momentum_balance"),
                            momentum = reader.read("/laws/totals/momentum_balance");
  const std::size_t nodes = 21, levels = reader.read("/states/t").size(), cells = 20;
  std::vector<std::vector<double>> fields;
  for (const char* name : {"u", "v", "w"}) {
    fields.push_back(reader.read(fmt::format("/states/{}", name)));
  }
  const auto force = [&](std::size_t level, std::size_t node) {
    const auto at = [&](std::size_t k) {
      return Eigen::Vector3d(fields[0][k * nodes + node], fields[1][k * nodes + node], fields[2][k * nodes + node]);
    };
    const Eigen::Vector3d mean = 0.5 * (at(level) + at(level + 1));
    return (mean(1) * mean(1) - mean(2) * mean(2)) / 2.0 + 1.0 - std::cos(mean(0)) +
           ((at(level + 1) - at(level)) / 0.1).dot(plus * mean);
  };
  double impulse = 0.0;
  for (std::size_t level = 0; level + 1 < levels; ++level) {
    double sum = 0.0;
    for (std::size_t cell = 0; cell < cells; ++cell) {
      sum += 0.15 * residuals[(level + 1) * cells + cell];
    }
    const double forces = force(level, nodes - 1) - force(level, 0);
    // Rounding of momenta of 10 over h.
    CHECK(std::abs(sum - (momentum[level + 1] - momentum[level]) / 0.1 - forces) < 1e-11);
    impulse += 0.1 * std::abs(forces);
  }
  // The twin: without the forces nothing balances.
  CHECK(impulse > 0.1);
}

TEST_CASE("a momentum whose row names the place has that row at an end of box") {
  const Folder folder;
  const std::string problem =
      with(with(box_string, "(v^2 - w^2)/2", "(v^2/(1 + x/6) - w^2)/2"), "[exact]\nu = \"sin(k*x)*cos(k*t)\"\n", "");
  for (const BoxEnds& ends : box_ends) {
    INFO(ends.left << ", " << ends.right);
    Settings settings = ends.settings();
    settings.erase(settings.begin() + 3);
    CHECK(box_outcome(folder / "a.h5", settings, problem).statistics.relative_energy_deviation().value() < 1e-13);
    CHECK(check(folder / "a.h5").status == ExitStatus::done);
    // Of order Δx², as the truncation error. The twin of the row is a singular matrix.
    CHECK(sawtooth_of(last_row(record::Reader(folder / "a.h5"), "/states/v")) < 5e-3);
  }
}

TEST_CASE("what box has no walls for is refused with reason and remedy") {
  const auto refusal = [](const Settings& settings, const std::string& problem) {
    return refusal_at_start(problem, "box.toml", settings);
  };
  CHECK(refusal({}, box_string).empty());
  CHECK_THAT(refusal({"scheme.stages=2"}, box_string), Contains("stages = 1") && Contains("fourier"));
  const std::string beam =
      "[field]\nequation = \"u_tt + u_xxxx = 0\"\n[grid]\nx = { from = 0, to = \"pi\", cells = 24, "
      "left = \"fixed\", right = \"fixed\" }\n[initial]\nu = \"sin(2*x)\"\nu_t = 0\n[scheme]\n"
      "lagrangian = \"box\"\nstep = 0.05\nuntil = 1\n";
  CHECK_THAT(refusal({}, beam), Contains("box.toml:") && Contains("differentiates a field") && Contains("fourier"));
  const std::string plane =
      "[field]\nequation = \"u_tt = u_xx + u_yy\"\n[grid]\nx = { from = 0, to = 1, cells = 8, left "
      "= \"fixed\", right = \"fixed\" }\ny = { from = 0, to = 1, cells = 9 }\n[initial]\nu = "
      "\"sin(pi*x)\"\nu_t = 0\n[scheme]\nlagrangian = \"box\"\nstep = 0.05\nuntil = 1\n";
  CHECK_THAT(refusal({}, plane), Contains("line alone") && Contains("leapfrog"));
}
