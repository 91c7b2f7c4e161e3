// Problem files that were once refused, or read as something else than they say.

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/record/reader.hpp>
#include <rubato/report/page.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/run.hpp>

#include "defects.hpp"
#include "record/sample.hpp"
#include "report/page_reader.hpp"

using namespace rubato;
using namespace rubato::defect_tests;
using Catch::Contains;

namespace {

Problem read(const std::string& name, const std::vector<std::string>& settings = {}) {
  return read_problem(defect_file(name + ".toml"), settings);
}

/// The message of a file whose `from` is replaced by `to`.
std::string refusal(const std::string& name, const std::vector<std::string>& settings) {
  try {
    static_cast<void>(read(name, settings));
  } catch (const ProblemError& error) {
    return error.what();
  }
  return "";
}

Outcome run_to(const std::filesystem::path& record, const Problem& problem) {
  return run(problem, {.output = record.string(), .overwrite = true, .threads = 1});
}

/// The first state of a field.
std::vector<double> start_of(const Problem& problem, const std::string& field) {
  const sample::Folder folder;
  REQUIRE(run_to(folder / "record.h5", problem).status == ExitStatus::done);
  return record::Reader(folder / "record.h5").read("/states/" + field, 0, 1);
}

double largest_difference(const std::vector<double>& a, const std::vector<double>& b) {
  REQUIRE(a.size() == b.size());
  double largest = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    largest = std::max(largest, std::abs(a[i] - b[i]));
  }
  return largest;
}

}  // namespace

TEST_CASE("a parameter is 4*K(0.64) of another one, and noise of a seed") {
  const Problem problem = read("p22-parameter-of-parameter");
  // 4 K(m) from the arithmetic-geometric mean of 1 and sqrt(1 - 0.64) = 0.6.
  double a = 1.0, b = 0.6;
  for (int i = 0; i < 6; ++i) {
    const double mean = 0.5 * (a + b);
    b = std::sqrt(a * b);
    a = mean;
  }
  CHECK(problem.hamiltonian()->initial.q[0] == Approx(4.0 * std::acos(0.0) / a).epsilon(1e-15));
  const double noise = problem.hamiltonian()->initial.p[0];
  CHECK(noise == read("p22-parameter-of-parameter", {"parameters.g=noise(7)"}).hamiltonian()->initial.p[0]);
  CHECK(noise != read("p22-parameter-of-parameter", {"parameters.seed=8"}).hamiltonian()->initial.p[0]);
  CHECK_THAT(refusal("p22-parameter-of-parameter", {"parameters.m=f/8"}), Contains("in a cycle: m -> f -> m"));
}

TEST_CASE("a quantity of an orbit may be called x, in the record and on the page") {
  const sample::Folder folder;
  const auto file = folder / "record.h5";
  const Outcome outcome = run_to(file, read("p24-quantity-named-x"));
  REQUIRE(outcome.status == ExitStatus::done);
  const record::Reader reader(file);
  const std::vector<double> x = reader.read("/output/quantities/x"), t = reader.read("/output/t");
  REQUIRE(x.size() > 100);
  double worst = 0.0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    worst = std::max(worst, std::abs(x[i] - std::cos(t[i])));
  }
  CHECK(worst < 1e-7);  // g = 0: x = cos t; 400 steps of 0.05 with a scheme of order 6, whose error is near h^7 in each
  CHECK(check(file.string()).status == ExitStatus::done);
  const std::string data = sample::data_of(report::page(reader));
  CHECK(sample::after(data, {R"("name":"x")"}).size() > 0);
  for (const std::string name : {"y", "z"}) {
    CHECK_NOTHROW(read("p24-quantity-named-x", {"output.quantities." + name + "=r*sin(f)"}));
  }
  // The twins: the time is a dataset beside them, and x is the grid's of a lattice.
  CHECK_THAT(refusal("p24-quantity-named-x", {"output.quantities.t=r"}), Contains("\"t\" cannot name a quantity"));
  CHECK_THAT(refusal("user-dx-in-initial", {"output.quantities.x=u"}), Contains("\"x\" cannot name a quantity"));
  CHECK_NOTHROW(read("user-dx-in-initial", {"output.quantities.y=u"}));
}

TEST_CASE("t in [initial] is the time of the start") {
  // X = x + d*t and X0 = x + d*0: the same numbers.
  CHECK(start_of(read("user-t-in-initial", {"scheme.until=0.02"}), "u") ==
        start_of(read("user-t-in-initial", {"scheme.until=0.02", "initial.u=U0"}), "u"));
  const auto moved = start_of(read("user-t-in-initial", {"initial.t=1", "scheme.until=1.02"}), "u");
  CHECK(largest_difference(moved, start_of(read("user-t-in-initial", {"scheme.until=0.02"}), "u")) > 0.1);
  // Of an orbit, and where H names t, too.
  const std::vector<std::string> late = {"initial.t=0.5", "initial.q=10*cos(t)", "scheme.until=1.5"};
  CHECK(read("tanh-force", late).hamiltonian()->initial.q[0] == 10.0 * std::cos(0.5));
  CHECK_THAT(refusal("tanh-force", {"initial.t=2*t"}), Contains("unknown name 't'"));
  CHECK_THAT(refusal("tanh-force", {"scheme.step=t"}), Contains("unknown name 't'"));
}

TEST_CASE("dx of a formula in [initial] is its spectral derivative") {
  const auto v = [](const std::string& formula) {
    return start_of(read("user-dx-in-initial", {"scheme.until=0.05", "initial.v=" + formula}), "v");
  };
  // 201 nodes, 0.2 apart, represent exp(-x^2) up to exp(-(pi/0.2)^2/4) = 1e-27; the transform of a derivative
  // magnifies rounding by the highest wave, 16, of numbers up to 1, in log2(201) stages.
  const double rounding = 16.0 * 8.0 * 2.3e-16;
  CHECK(largest_difference(v("-0.5*dx(exp(-x^2))"), v("x*exp(-x^2)")) < rounding);
  CHECK(largest_difference(v("-0.5*dx(exp(-x^2))"), v("-0.5*dx(u)")) < rounding);
  // Nested, of products with one, twice the same, and of other fields.
  CHECK(largest_difference(v("dx(dx(exp(-x^2)))"), v("(4*x^2 - 2)*exp(-x^2)")) < 16.0 * rounding);
  CHECK(largest_difference(v("dx(x*dx(exp(-x^2)))"), v("(4*x^3 - 4*x)*exp(-x^2)")) < 20.0 * 16.0 * rounding);
  CHECK(largest_difference(v("dx(u*1)"), v("dx(u)")) == 0.0);
  // A square has waves twice as high: beyond the highest of the grid, k = 15.7, they hold k^3 exp(-k^2/8) = 2e-10.
  CHECK(largest_difference(v("dx(dx(u)^2) + dx(exp(-x^2))^2"), v("-8*x*(2*x^2 - 1)*exp(-2*x^2) + 4*x^2*exp(-2*x^2)")) <
        2e-10);
  // The twin: it is the derivative of that formula.
  CHECK(largest_difference(v("-0.5*dx(exp(-x^2))"), v("-0.5*dx(exp(-2*x^2))")) > 0.1);
  // A field itself is not there, and its own derivative is a cycle.
  CHECK_THAT(refusal("user-dx-in-initial", {"initial.v=dx(u^2)"}), Contains("names the field u"));
  CHECK_THAT(refusal("user-dx-in-initial", {"initial.v=dx(x*dx(v))"}), Contains("depends on its own derivatives"));
  // One message where it is not available.
  const std::string density = refusal("user-dx-in-initial", {R"x(invariants={I="dx(u^2)"})x"});
  CHECK_THAT(density, Contains("dx takes a field here") && !Contains("unknown function"));
  CHECK_THAT(refusal("user-dx-in-initial", {"initial.v=dy(u)"}), Contains("along y of the grid, which has x"));
}

TEST_CASE("an event called stop ends the run, as a formula and as a table") {
  const auto end = [](const std::vector<std::string>& settings) {
    const sample::Folder folder;
    return run_to(folder / "record.h5", read("user-stop-table", settings));
  };
  const Outcome table = end({}), formula = end({"events={ stop = \"p\" }"});
  REQUIRE(table.status == ExitStatus::done);
  // p = cos-like from 1 on: it passes zero downward at a quarter of a period, 6.743/4 (k = sin(q_max/2) = 1/2).
  CHECK(table.statistics.t > 1.6);
  CHECK(table.statistics.t < 1.9);
  CHECK(table.statistics.t == formula.statistics.t);
  CHECK(end({"events.stop={ crossing = \"p\", direction = \"down\", stop = 2 }"}).statistics.t > 8.0);
  // The twins: no stop is asked for, by its word or by another name.
  CHECK(end({"events.stop={ crossing = \"p\", stop = false }"}).statistics.t >= 100.0);
  CHECK(end({"events={ turn = { crossing = \"p\" } }"}).statistics.t >= 100.0);
}

TEST_CASE("the force of tanh keeps its digits far out") {
  for (const double q : {10.0, 18.0, 20.0, 40.0}) {
    const sample::Folder folder;
    REQUIRE(run_to(folder / "record.h5", read("tanh-force", {"initial.q=" + std::to_string(q)})).status ==
            ExitStatus::done);
    // Two half kicks by -sech(q)^2, each good to a few units in the last place.
    const double kick = -1.0 / std::pow(std::cosh(q), 2.0);
    CHECK(record::Reader(folder / "record.h5").read("/states/p").back() == Approx(kick).epsilon(1e-14));
    CHECK(std::abs(std::pow(std::tanh(q), 2.0) - 1.0 - kick) > 1e-9 * std::abs(kick));  // the twin
  }
}
