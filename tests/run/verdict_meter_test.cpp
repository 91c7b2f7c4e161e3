// What the verdict rests on: terms of H, the energy that they exchange, local frequencies, findings of many runs.

#include <catch2/catch.hpp>

#include <array>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include <fmt/format.h>

#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/parse.hpp>
#include <rubato/formula/sum.hpp>
#include <rubato/problem/problem.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/energy_exchange.hpp>
#include <rubato/run/local_frequency.hpp>
#include <rubato/run/member_verdicts.hpp>
#include <rubato/run/pole_watch.hpp>
#include <rubato/run/run.hpp>

#include "folder.hpp"

using namespace rubato;
using figures::Verdict;

TEST_CASE("the terms of a formula add up to it") {
  for (const auto& [text, count] : std::vector<std::pair<std::string, std::size_t>>{
           {"p^2/2 - cos(q)", 2},
           {"(p^2 + q^2)/2", 2},
           {"-(p - q*(p + 1))/2 - exp(q + p)", 4},
           {"(p + q)*(p - q) - (-(p + 1))", 6},
           {"(p + q)^2", 1},
       }) {
    INFO(text);
    formula::Graph graph;
    const formula::Expression q = graph.variable("q"), p = graph.variable("p");
    const formula::Expression whole = formula::parse(text, graph, std::array<std::string, 2>{"q", "p"});
    std::vector<formula::Expression> outputs = formula::terms_of(whole, formula::Products::expanded);
    CHECK(outputs.size() == count);
    outputs.push_back(whole);
    formula::ScalarEvaluator evaluator{formula::Bytecode(outputs, std::array{q, p})};
    std::vector<double> values(outputs.size());
    const std::array inputs = {0.7, -1.3};
    evaluator(inputs, values);
    double sum = 0.0;
    for (std::size_t i = 0; i + 1 < values.size(); ++i) {
      sum += values[i];
    }
    CHECK(sum == Approx(values.back()).epsilon(1e-14));
  }
}

TEST_CASE("an error of the energy is measured by what the terms exchange") {
  const auto worst = [](double error) {
    EnergyExchange exchange;
    constexpr int levels = 100;
    for (int k = 0; k <= levels; ++k) {
      // T and V of an oscillator; the error comes half-way and stays.
      const double t = 0.1 * k, T = std::pow(std::sin(t), 2) + (2 * k > levels ? error : 0.0);
      const std::array terms = {T, std::pow(std::cos(t), 2)};
      exchange.add(terms, terms[0] + terms[1], 1e-16, t, k);
    }
    figures::Measures measures;
    exchange.measure(measures);
    return measures.energy;
  };
  CHECK(worst(0.0) == 0.0);
  CHECK(worst(1e-3) < 0.1);
  CHECK(worst(0.4) > 0.1);
  CHECK(worst(100.0) > 0.5);
}

TEST_CASE("an error that remains is measured by the terms as they are then, wherever the motion began") {
  // A body falls out of a deep well, T = 1/r + E and V = -1/r; `error` is what it takes along from the closest step.
  const auto worst = [](double error, bool begins_below) {
    EnergyExchange exchange;
    for (int k = 0; k <= 400; ++k) {
      const double t = 0.05 * k, r = 0.005 + std::pow(begins_below ? t : std::abs(t - 10.0), 2.0 / 3.0);
      const bool is_before = begins_below ? k == 0 : t < 10.0;
      const double remains = is_before ? 0.0 : error;
      const std::array terms = {1.0 / r + remains, -1.0 / r};
      exchange.add(terms, remains, 1e-16, t, k);
    }
    figures::Measures measures;
    exchange.measure(measures);
    return measures.energy;
  };
  for (const bool begins_below : {false, true}) {
    CHECK(worst(0.02, begins_below) < 0.1);
    CHECK(worst(2.0, begins_below) > 0.5);
  }
}

TEST_CASE("an orbit that a step at the pericentre throws out of its well is lost") {
  const tests::Folder folder;
  const auto verdict = [&](double step) {
    const Problem problem = parse_problem(
        fmt::format("[hamiltonian]\nq = [\"x\", \"y\"]\np = [\"p\", \"s\"]\nH = \"(p^2 + s^2)/2 - 1/sqrt(x^2 + "
                    "y^2)\"\n[initial]\nx = 0.01\ny = 0\np = 0\ns = \"sqrt(199)\"\n[scheme]\nlagrangian = "
                    "\"gauss\"\nstages = 2\nlevels = \"fixed\"\nstep = {}\nuntil = 20\n[verdict]\naccept = "
                    "[\"resolution\"]\n",
                    step),
        "thrown.toml");
    return run(problem, {.output = folder / "a.h5", .overwrite = true, .threads = 1}).judgement.verdict;
  };
  CHECK(verdict(0.0015) == Verdict::lost);
  CHECK(verdict(0.0001) == Verdict::good);
}

TEST_CASE("an energy of one term at 0, or constant to rounding, has no error") {
  EnergyExchange exchange;
  for (int k = 0; k < 10; ++k) {
    exchange.add(std::array{1e-17 * k}, 1e-17 * k, 1e-16, k, k);
  }
  figures::Measures measures;
  exchange.measure(measures);
  CHECK_FALSE(measures.energy > 0.0);
}

TEST_CASE("the local frequency is that of the modes that have a part in the forces") {
  const auto frequency = [](const std::string& q, const std::string& p, const std::string& H,
                            const std::vector<double>& z) {
    const std::string text = "[hamiltonian]\nq = [" + q + "]\np = [" + p + "]\nH = \"" + H +
                             "\"\n[initial]\nx = 1\ny = 1\nu = 0\nv = 0\n[scheme]\nstep = 0.1\nuntil = 1\n";
    return LocalFrequency(parse_problem(text, "test.toml"))(z, 0.1);
  };
  const auto of = [&](const std::string& H, const std::vector<double>& z) {
    return frequency("\"x\", \"y\"", "\"u\", \"v\"", H, z);
  };
  // ω² = Σ ω_i⁴ E_i / Σ ω_i² E_i; differences leave 1e-6.
  const std::string springs = "(u^2 + v^2 + x^2 + 100*y^2)/2";
  for (const double part : {1.0, 0.1, 0.01, 0.0}) {
    const double E = part * part;
    CHECK(of(springs, {1, 0.1 * part, 0, 0}) == Approx(std::sqrt((1.0 + 1e4 * E) / (1.0 + 100.0 * E))).epsilon(1e-4));
    CHECK(of(springs, {0, 0, 1, part}) == Approx(std::sqrt((1.0 + 1e4 * E) / (1.0 + 100.0 * E))).epsilon(1e-4));
  }
  CHECK(of("1e30*(u^2 + v^2)/2 + 1e-30*(x^2 + 9*y^2)/2", {1, 1, 0, 0}) == Approx(std::sqrt(730.0 / 82.0)));
  // A spring that follows, y = -x/(10 k), and the same spring when it swings by 1.
  const std::string stiff = "(u^2 + v^2)/2 + 10000*y^2/2 - cos(x) + x*y/10";
  CHECK(of(stiff, {1, -1e-5, 0.1, -1e-6}) < 2.0);
  CHECK(of(stiff, {1, 0.01, 0.1, 0}) == Approx(100.0).epsilon(0.01));
  // At the pericentre of Kepler's problem, (3 + e)/(2 + e)/r³ with v² = (1 + e)/r; the fastest rate is sqrt(2/r³).
  const double r = 0.05, v = 6.0, e = v * v * r - 1.0;
  CHECK(of("(u^2 + v^2)/2 - 1/sqrt(x^2 + y^2)", {r, 0, 0, v}) ==
        Approx(std::sqrt((3.0 + e) / (2.0 + e) / (r * r * r))).epsilon(1e-3));
  CHECK(of("(u^2 + v^2)/2 + 9.8*x", {1, 1, 0, 0}) == 0.0);
}

TEST_CASE("steps over a stiff spring that follows a slow motion are good, over one that swings they are not") {
  const tests::Folder folder;
  const auto verdict = [&](double y) {
    const Problem problem = parse_problem(
        fmt::format(
            "[hamiltonian]\nq = [\"x\", \"y\"]\np = [\"u\", \"v\"]\nH = \"(u^2 + v^2)/2 + 10000*y^2/2 - cos(x) + "
            "x*y/10\"\n[initial]\nx = 1\ny = {}\nu = 0\nv = 0\n[scheme]\nlagrangian = \"gauss\"\nstages = 2\n"
            "levels = \"fixed\"\nstep = 0.1\nuntil = 20\n",
            y),
        "stiff.toml");
    return run(problem, {.output = folder / "a.h5", .overwrite = true, .threads = 1}).judgement.verdict;
  };
  CHECK(verdict(-1e-5) == Verdict::good);
  CHECK(verdict(1e-3) == Verdict::doubtful);  // 1 % of the energy
}

TEST_CASE("a step over a pole of H is found where the energy at both levels shows nothing") {
  const auto crosses = [](const std::string& stated, const std::vector<double>& from, const std::vector<double>& to) {
    const std::string text = stated + "\n[scheme]\nstep = 0.1\nuntil = 1\n";
    const Problem problem = parse_problem(text, "test.toml");
    PoleWatch watch(problem);
    return watch.looks() && watch.crosses(from, to);
  };
  const auto H = [](const std::string& V) {
    return "[hamiltonian]\nq = [\"q\"]\np = [\"p\"]\nH = \"p^2/2 + " + V + "\"\n[initial]\nq = 1\np = -1";
  };
  const std::vector<double> before = {0.07, -1.0}, after = {-0.04, -1.0}, beside = {0.03, -1.0};
  for (const std::string V : {"1e-6/q^2", "1e-9/q", "1e-7*(q*q)^(-1.5)", "1e-6*tan(q + pi/2)", "1e-6*csch(q)",
                              "1e-6/(3*abs(q))", "1e-6/(q*(2 + q))"}) {
    INFO(V);
    CHECK(crosses(H(V), before, after));
    CHECK_FALSE(crosses(H(V), before, beside));
  }
  // No poles: quotients with a limit, divisors that are not 0 or have no factor left, and a point that is gone round.
  for (const std::string V :
       {"sin(q)/q", "(1 - cos(q))/q^2", "1/q - 1/sin(q)", "1e-6/(q^2 + 0.01)", "0*p/q", "1e-6/sqrt(q^2 + p^2)"}) {
    INFO(V);
    CHECK_FALSE(crosses(H(V), before, after));
  }
  const std::string L = "[lagrangian]\nq = [\"q\"]\nL = \"q_dot^2/2 - 1e-6/q^2\"\n[initial]\nq = 1\nq_dot = -1";
  CHECK(crosses(L, before, after));
  CHECK_FALSE(crosses(L, before, beside));
}

TEST_CASE("the verdict names a stated L of an orbit that is not of H, and `check` finds the same") {
  const tests::Folder folder;
  const auto reasons = [&](const std::string& L) {
    const Problem problem = parse_problem(
        "[hamiltonian]\nq = [\"q\"]\np = [\"p\"]\nH = \"p^2/2 - cos(q)\"\n[initial]\nq = 0\np = "
        "1\n[scheme]\nlagrangian "
        "= \"custom\"\nL = \"" +
            L + "\"\nlevels = \"fixed\"\nstep = 0.05\nuntil = 2\n",
        "own.toml");
    const Outcome outcome = run(problem, {.output = folder / "a.h5", .overwrite = true, .threads = 1});
    CHECK(check(folder / "a.h5").status == ExitStatus::done);
    return figures::text_of(outcome.judgement);
  };
  const std::string of = "(p_0 + p_1)/2*(q_1 - q_0)/(t_1 - t_0) - ((p_0 + p_1)/2)^2/2 + ";
  CHECK(reasons(of + "cos((q_0 + q_1)/2)") == "good");
  CHECK_THAT(reasons(of + "1.05*cos((q_0 + q_1)/2)"), Catch::Contains("doubtful: L does not approximate the equation"));
}

TEST_CASE("findings of members are gathered, and come back from a checkpoint") {
  MemberVerdicts findings;
  const figures::Judgement lost{.verdict = Verdict::lost,
                                .reasons = {{.kind = figures::ReasonKind::energy,
                                             .verdict = Verdict::lost,
                                             .value = 0.75,
                                             .finding = "the energy strays",
                                             .remedy = "take smaller steps"}},
                                .accepted = {}};
  findings.add(0, "", {"at 6 of 11 times it is undefined"}, {}, RunEnd::complete);
  findings.add(1, "", {"at 7 of 11 times it is undefined"}, lost, RunEnd::complete);
  findings.add(2, "", {}, {}, RunEnd::complete);
  CHECK(findings.verdict() == Verdict::lost);
  CHECK_FALSE(findings.all_lost());
  CHECK(findings.warnings("members") ==
        std::vector<std::string>{"in 2 of 3 members, the first: 0: at 6 of 11 times it is undefined"});
  MemberVerdicts restored;
  restored.restore(findings.saved());
  restored.add_verdict(Verdict::good, RunEnd::complete);
  restored.add_verdict(Verdict::lost, RunEnd::complete);
  restored.add_verdict(Verdict::good, RunEnd::complete);
  CHECK(restored.warnings("members") == findings.warnings("members"));
  CHECK(restored.verdict_text("members") == findings.verdict_text("members"));
  CHECK(MemberVerdicts().verdict_text("members") == "none: none of the members has ended");
  figures::JsonObject one, other;
  findings.add_to(one, "members");
  restored.add_to(other, "members");
  CHECK(one.str() == other.str());
}

TEST_CASE("how full a spectrum is does not depend on the unit of the action") {
  const auto waves = [](const std::string& unit, const std::string& width) {
    const std::string text = R"toml(
[field]
L = "unit*(u_t^2/2 - u_x^2/2 - (1 - cos(u)))"
fields = ["u"]
[parameters]
unit = 1
width = 1
[grid]
x = { from = -20, to = 20, cells = 61 }
[initial]
u = "4*exp(-3*(x/width)^2)"
u_t = 0
[scheme]
lagrangian = "leapfrog"
levels = "fixed"
step = 0.05
until = 0.5
)toml";
    return run(parse_problem(text, "pulse.toml",
                             std::vector<std::string>{"parameters.unit=" + unit, "parameters.width=" + width}),
               {.output = tests::Folder() / "a.h5"})
        .statistics.measures.waves;
  };
  const double expected = waves("1", "1");
  CHECK(expected > 0.01);
  for (const char* unit : {"1e-12", "1e-30", "1e20"}) {
    INFO(unit);
    CHECK(waves(unit, "1") == Approx(expected).epsilon(1e-9));
  }
  CHECK(waves("1e-30", "8") < 1e-3 * expected);  // the twin: a pulse that the grid resolves
}

TEST_CASE("a force of place between walls has no period to close on") {
  const auto period = [](const std::string& ends) {
    const std::string text = R"toml(
[field]
L = "u_t^2/2 - u_x^2/2 - u^2/2 - 0.1*u^4 - 0.05*u*(x + 1)^2"
fields = ["u"]
[grid]
x = { from = -8, to = 2, cells = 101 }
[initial]
u = "1.2*exp(-(x + 2.3)^2)"
u_t = 0
[scheme]
lagrangian = "leapfrog"
levels = "fixed"
step = 0.05
until = 0.5
)toml";
    return run(parse_problem(text, "string.toml",
                             ends.empty() ? std::vector<std::string>()
                                          : std::vector<std::string>{"grid.x.left=" + ends, "grid.x.right=" + ends}),
               {.output = tests::Folder() / "a.h5"})
        .statistics.measures.period;
  };
  CHECK_FALSE(period("fixed") > 0.01);
  CHECK_FALSE(period("free") > 0.01);
  CHECK(period("") > 0.1);  // the twin
}
