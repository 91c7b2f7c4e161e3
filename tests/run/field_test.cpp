// Problems stated by a density: the same waves as with the M, K and S of the catalogue.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include <fmt/format.h>

#include <rubato/catalogue/catalogue.hpp>
#include <rubato/problem/lattice_problem.hpp>
#include <rubato/problem/problem.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/run.hpp>

#include "problem_texts.hpp"
#include "records.hpp"

using namespace rubato;
using namespace rubato::run_tests;
using Catch::Matchers::Contains;

namespace {

/// A problem of the catalogue with [field] in place of [multisymplectic], and other names of fields in the rest.
std::string with_field(const std::string& name, const std::string& field,
                       const std::vector<std::pair<std::string, std::string>>& renamed = {}) {
  const auto entry = std::ranges::find(catalogue::entries(), name, &catalogue::Entry::name);
  std::string text(entry->text);
  const std::size_t first = text.find("[multisymplectic]"), last = text.find("\n[", first);
  text.replace(first, last - first, "[field]\n" + field + "\n");
  for (const auto& [from, to] : renamed) {
    for (std::size_t place = text.find(from); place != std::string::npos; place = text.find(from, place + to.size())) {
      text.replace(place, from.size(), to);
    }
  }
  return text;
}

/// The largest difference of a field's states, over its largest value.
double difference(const std::string& a, const std::string& b, const std::string& field) {
  const std::vector<double> one = record::Reader(a).read("/states/" + field),
                            other = record::Reader(b).read("/states/" + field);
  REQUIRE(one.size() == other.size());
  double size = 0.0, worst = 0.0;
  for (std::size_t i = 0; i < one.size(); ++i) {
    size = std::max(size, std::abs(one[i]));
    worst = std::max(worst, std::abs(one[i] - other[i]));
  }
  return worst / size;
}

struct Stated {
  std::string name, field, twin;  ///< the density, and one of another equation
  std::vector<std::string> compared, settings;
  std::vector<std::pair<std::string, std::string>> renamed;
};

/// Runs a problem as it is in the catalogue, as stated, and as stated wrongly.
void compare(const Stated& one) {
  const Folder folder;
  const std::string by_hand = folder / "hand.h5", derived = folder / "field.h5";
  std::vector<std::string> settings = one.settings;
  settings.insert(settings.end(), {"scheme.levels=fixed", "output.every=1"});
  INFO(one.name);
  static_cast<void>(run(read_problem(one.name, settings), {.output = by_hand, .threads = 1}));
  const Outcome outcome = run(parse_problem(with_field(one.name, one.field, one.renamed), one.name, settings),
                              {.output = derived, .threads = 1});
  CHECK(outcome.status == ExitStatus::done);
  for (const std::string& field : one.compared) {
    // Each of some hundred steps is solved to some roundings of the largest value.
    CHECK(difference(by_hand, derived, field) < 1e-11);
  }
  const std::string twin = folder / "twin.h5";  // another wave
  static_cast<void>(run(parse_problem(with_field(one.name, one.twin, one.renamed), one.name, settings),
                        {.output = twin, .threads = 1}));
  CHECK(difference(by_hand, twin, one.compared.front()) > 1e-6);
  CHECK(check(derived).status == ExitStatus::done);
}

}  // namespace

TEST_CASE("a density gives the waves of the M, K and S stated by hand") {
  const std::vector<Stated> all = {
      {"sine-gordon",
       "fields = [\"u\"]\nL = \"u_t^2/2 - u_x^2/2 - (1 - cos(u))\"",
       "fields = [\"u\"]\nL = \"u_t^2/2 - u_x^2/2 - u^2/2\"",
       {"u"},
       {},
       {{"\nv = ", "\nu_t = "}, {"\"w/(2*pi)\"", "\"u_x/(2*pi)\""}}},
      {"kdv",
       "fields = [\"u\"]\nH = \"gamma^2*u_x^2/2 - eta*u^3/6\"\nstructure = \"dx\"",
       "fields = [\"u\"]\nH = \"gamma^2*u_x^2/2 - eta*u^3/5\"\nstructure = \"dx\"",
       {"u"},
       {"scheme.until=0.1"},
       {}},
      {"bbm",
       "fields = [\"u\"]\nH = \"-alpha*u^2/2 - g*u^3/6\"\nstructure = \"dx/(1-dxx)\"",
       "fields = [\"u\"]\nH = \"-alpha*u^2/2 - g*u^3/6\"\nstructure = \"dx\"",
       {"u"},
       {"scheme.until=2"},
       {}},
      {"camassa-holm",
       "fields = [\"u\"]\nH = \"-(u^3 + gamma*u*u_x^2)/2\"\nstructure = \"dx/(1-dxx)\"",
       "fields = [\"u\"]\nH = \"-(u^3 + gamma*u*u_x^2/2)/2\"\nstructure = \"dx/(1-dxx)\"",
       {"u"},
       {"scheme.until=1"},
       {}},
      {"nls",
       "fields = [\"p\", \"q\"]\nH = \"p_x^2 + q_x^2 - a/2*(p^2 + q^2)^2\"\nstructure = \"schroedinger\"\npsi = "
       "[\"p\", \"q\"]",
       "fields = [\"p\", \"q\"]\nH = \"p_x^2 + q_x^2 - a/3*(p^2 + q^2)^2\"\nstructure = \"schroedinger\"\npsi = "
       "[\"p\", \"q\"]",
       {"p", "q"},
       {"scheme.until=1"},
       {{"[\"v\", \"w\", -1], [\"w\", \"v\", 1]", "[\"p_x\", \"q_x\", -1], [\"q_x\", \"p_x\", 1]"}}},
      {"sine-gordon-2d",
       "fields = [\"u\"]\nL = \"u_t^2/2 - u_x^2/2 - u_y^2/2 - (1 - cos(u))\"",
       "fields = [\"u\"]\nL = \"u_t^2/2 - u_x^2/2 - u_y^2 - (1 - cos(u))\"",
       {"u"},
       {"scheme.until=0.5", "grid.x.cells=31", "grid.y.cells=31"},
       {{"\nv = ", "\nu_t = "}}},
  };
  for (const Stated& one : all) {
    compare(one);
  }
}

TEST_CASE("an equation gives the waves of the M, K and S stated by hand") {
  const std::vector<Stated> all = {
      {"sine-gordon",
       "equation = \"u_tt = u_xx - sin(u)\"",
       "equation = \"u_tt = u_xx - sinh(u)\"",
       {"u"},
       {},
       {{"\nv = ", "\nu_t = "}, {"\"w/(2*pi)\"", "\"u_x/(2*pi)\""}}},
      {"kdv",
       "equation = \"u_t + eta*u*u_x + gamma^2*u_xxx = 0\"",
       "equation = \"u_t + eta*u^2*u_x + gamma^2*u_xxx = 0\"",
       {"u"},
       {"scheme.until=0.1"},
       {}},
      {"bbm",
       "equation = \"u_t + alpha*u_x + g*u*u_x = sigma*u_xxt\"",
       "equation = \"u_t + alpha*u_x + g*u*u_x = 2*sigma*u_xxt\"",
       {"u"},
       {"scheme.until=2"},
       {}},
      {"nls",
       "equation = \"i*psi_t + psi_xx + a*abs2(psi)*psi = 0\"",
       "equation = \"i*psi_t + psi_xx + a*abs2(psi)*psi + psi/3 = 0\"\npsi = [\"p\", \"q\"]",
       {"p", "q"},
       {"scheme.until=1"},
       {{"[\"v\", \"w\", -1], [\"w\", \"v\", 1]", "[\"p_x\", \"q_x\", -1], [\"q_x\", \"p_x\", 1]"}}},
  };
  for (const Stated& one : all) {
    compare(one);
  }
}

TEST_CASE("the rest of the catalogue, each in one to three lines") {
  const std::vector<std::pair<std::string, std::string>> second_order = {{"\nv = ", "\nu_t = "},
                                                                         {"\"w/(2*pi)\"", "\"u_x/(2*pi)\""}};
  const std::vector<std::pair<std::string, std::string>> charge = {
      {"[\"v\", \"w\", -1], [\"w\", \"v\", 1]", "[\"p_x\", \"q_x\", -1], [\"q_x\", \"p_x\", 1]"},
      {"[\"a\", \"b\", -1], [\"b\", \"a\", 1]", "[\"p_y\", \"q_y\", -1], [\"q_y\", \"p_y\", 1]"}};
  const std::vector<std::pair<std::string, std::string>> charges = {{"[\"v1\", \"w1\"", "[\"p1_x\", \"q1_x\""},
                                                                    {"[\"w1\", \"v1\"", "[\"q1_x\", \"p1_x\""},
                                                                    {"[\"v2\", \"w2\"", "[\"p2_x\", \"q2_x\""},
                                                                    {"[\"w2\", \"v2\"", "[\"q2_x\", \"p2_x\""}};
  const std::string rod = "equation = \"u_t - u_xxt + 3*u*u_x = gamma*(2*u_x*u_xx + u*u_xxx)\"",
                    kdv = "equation = \"u_t + eta*u*u_x + gamma^2*u_xxx = 0\"",
                    kdv_twin = "equation = \"u_t + eta*u*u_x + 1.1*gamma^2*u_xxx = 0\"",
                    zk = "equation = \"u_t + u*u_x + u_xxx + u_xyy = 0\"",
                    zk_twin = "equation = \"u_t + u*u_x + u_xxx = 0\"",
                    coupled =
                        "equation = [\"i*psi1_t + psi1_xx + (abs2(psi1) "
                        "+ beta*abs2(psi2))*psi1 = 0\", \"i*psi2_t + psi2_xx + (abs2(psi2) + beta*abs2(psi1))*psi2 = "
                        "0\"]",
                    coupled_twin =
                        "psi = [[\"p1\", \"q1\"], [\"p2\", \"q2\"]]\nequation = [\"i*psi1_t + psi1_xx + "
                        "abs2(psi1)*psi1 = 0\", \"i*psi2_t + psi2_xx + abs2(psi2)*psi2 = 0\"]",
                    maxwell =
                        "equation = [\"E1_t = (H3_y - H2_z)/epsilon\", \"E2_t = (H1_z - H3_x)/epsilon\", \"E3_t = "
                        "(H2_x - H1_y)/epsilon\", \"H1_t = (E2_z - E3_y)/mu\", \"H2_t = (E3_x - E1_z)/mu\", \"H3_t = "
                        "(E1_y - E2_x)/mu\"]",
                    maxwell_twin =
                        "equation = [\"E1_t = (H3_y - H2_z)/2\", \"E2_t = (H1_z - H3_x)/2\", \"E3_t = (H2_x - "
                        "H1_y)/2\", \"H1_t = (E2_z - E3_y)/2\", \"H2_t = (E3_x - E1_z)/2\", \"H3_t = (E1_y - "
                        "E2_x)/2\"]";
  const std::vector<Stated> all = {
      {"sine-gordon-kinks",
       "equation = \"u_tt = u_xx - sin(u)\"",
       "equation = \"u_tt = u_xx - u\"",
       {"u"},
       {"scheme.until=0.5"},
       second_order},
      {"klein-gordon",
       "equation = \"u_tt = u_xx - u - lambda*u^3\"",
       "equation = \"u_tt = u_xx - u + lambda*u^3\"",
       {"u"},
       {"scheme.until=0.5"},
       second_order},
      {"josephson-junction",
       "equation = \"u_tt = u_xx - critical_current*sin(u) + current\"",
       "equation = \"u_tt = u_xx - sin(u) + current\"",
       {"u"},
       {"scheme.until=0.5"},
       second_order},
      {"boussinesq",
       "fields = [\"u\", \"m\"]\nH = \"m^2/2 + u^2/2 + u^3/3 + u_x^2/2\"\nstructure = \"dx\"\npairs = [[\"u\", \"m\"]]",
       "fields = [\"u\", \"m\"]\nH = \"m^2/2 + u^2/2 + u^3/2 + u_x^2/2\"\nstructure = \"dx\"\npairs = [[\"u\", \"m\"]]",
       {"u"},
       {"scheme.until=0.5"},
       {{"\nv = ", "\nm = "}}},
      // In the user's own fields: v = φ_t is the integral of u_t.
      {"boussinesq",
       "equation = \"u_tt = u_xx + 2*u*u_xx + 2*u_x^2 - u_xxxx\"",
       "equation = \"u_tt = u_xx + 3*u*u_xx + 3*u_x^2 - u_xxxx\"",
       {"u"},
       {"scheme.until=0.5"},
       {{"\nv = \"-c*A*sech(k*x)^2\"", "\nu_t = \"2*c*A*k*sech(k*x)^2*tanh(k*x)\""}}},
      {"camassa-holm", rod, kdv_twin, {"u"}, {"scheme.until=0.2"}, {{"gamma = 1", "gamma = 1\neta = 3"}}},
      {"dispersive-rod", rod, "equation = \"u_t - u_xxt + 2*u*u_x = 0\"", {"u"}, {"scheme.until=0.5"}, {}},
      {"kdv-two-solitons", kdv, kdv_twin, {"u"}, {"scheme.until=0.0005"}, {}},
      {"kdv-zabusky-kruskal", kdv, kdv_twin, {"u"}, {"scheme.until=0.1"}, {}},
      {"nls-bound-state",
       "equation = \"i*psi_t + psi_xx + 2*k^2*abs2(psi)*psi = 0\"",
       "psi = [\"p\", \"q\"]\nequation = \"i*psi_t + psi_xx + k^2*abs2(psi)*psi = 0\"",
       {"p", "q"},
       {"scheme.until=0.1"},
       charge},
      {"trapped-condensate",
       "psi = [\"p\", \"q\"]\nequation = \"i*psi_t + psi_xx/2 + psi_yy/2 - V*psi - g*abs2(psi)*psi = 0\"",
       "psi = [\"p\", \"q\"]\nequation = \"i*psi_t + psi_xx/2 + psi_yy/2 - V*psi + g*abs2(psi)*psi = 0\"",
       {"p", "q"},
       {"scheme.until=0.1"},
       charge},
      {"coupled-nls", coupled, coupled_twin, {"p1", "q2"}, {"scheme.until=0.1"}, charges},
      {"coupled-nls-collision", coupled, coupled_twin, {"p1", "q2"}, {"scheme.until=0.04"}, charges},
      {"dirac",
       "fields = [\"p1\", \"q1\", \"p2\", \"q2\"]\nL = \"-q1*p1_t - q2*p2_t - p1_x*q2 - p2_x*q1 + m/2*density - "
       "lambda/2*density^2\"\n[definitions]\ndensity = \"p1^2 + q1^2 - p2^2 - q2^2\"",
       "fields = [\"p1\", \"q1\", \"p2\", \"q2\"]\nL = \"-q1*p1_t - q2*p2_t - p1_x*q2 - p2_x*q1 + m/2*density\"\n"
       "[definitions]\ndensity = \"p1^2 + q1^2 - p2^2 - q2^2\"",
       {"p1", "q2"},
       {"scheme.until=0.2"},
       {}},
      {"maxwell",
       maxwell,
       maxwell_twin,
       {"E1", "H3"},
       {"scheme.until=0.2", "grid.x.cells=9", "grid.y.cells=9", "grid.z.cells=9"},
       {}},
      {"zakharov-kuznetsov", zk, zk_twin, {"u"}, {"scheme.until=0.04", "grid.x.cells=31", "grid.y.cells=31"}, {}},
      {"zakharov-kuznetsov-pulse", zk, zk_twin, {"u"}, {"scheme.until=0.04", "grid.x.cells=31", "grid.y.cells=31"}, {}},
  };
  for (const Stated& one : all) {
    compare(one);
  }
}

namespace {

/// A wave on (-20, 20) by an equation.
std::string wave(const std::string& field, const std::string& rest,
                 const std::string& grid = "x = { from = -20, to = 20, cells = 101 }") {
  return "[field]\n" + field + "\n[grid]\n" + grid + "\n" + rest + "\n[scheme]\nstep = 0.02\nuntil = 0.2\n";
}

}  // namespace

TEST_CASE("equations that new users bring, each in one to three lines, run with their laws") {
  const std::string pulse = "[initial]\nu = \"sech(x)\"\nu_t = 0\n";
  const std::vector<std::pair<std::string, std::string>> all = {
      {"modified KdV", wave("equation = \"u_t + 6*u^2*u_x + u_xxx = 0\"", "[exact]\nu = \"sech(x - t)\"")},
      {"improved Boussinesq", wave("equation = \"u_tt = u_xx + 2*u*u_xx + 2*u_x^2 + u_xxtt\"",
                                   "[initial]\nu = \"0.2*sech(x/4)^2\"\nu_t = \"0.1*sech(x/4)^2*tanh(x/4)\"")},
      {"Klein-Gordon-Zakharov",
       wave("equation = [\"u_tt = u_xx - u - u*n\", \"n_tt = n_xx + 2*u*u_xx + 2*u_x^2\"]", pulse + "n = 0\nn_t = 0")},
      {"Kadomtsev-Petviashvili",
       wave("equation = \"u_tx + 6*u*u_xx + 6*u_x^2 + u_xxxx + 3*u_yy = 0\"",
            "[initial]\nu = \"sech(x)^2*tanh(x)*cos(pi*y/5)/10\"",
            "x = { from = -10, to = 10, cells = 41 }\ny = { from = -5, to = 5, cells = 21 }")},
      {"shallow water over a bump",
       wave("fields = [\"eta\", \"v\"]\nH = \"(1 - sech(x)^2/5 + eta)*v^2/2 + eta^2/2\"\nstructure = \"dx\"\npairs = "
            "[[\"eta\", \"v\"]]",
            "[initial]\neta = \"sech(x)^2/10\"\nv = 0")},
      {"suspension bridge", wave("equation = \"u_tt + u_xxxx + max(u + 1, 0) - 1 = 0\"", pulse)},
      {"phi^6", wave("equation = \"u_tt = u_xx - u*(1 - u^2)*(1 - 3*u^2)\"", pulse)},
      {"Thirring",
       wave("psi = [[\"a\", \"b\"], [\"c\", \"d\"]]\nequation = [\"i*psi1_t + i*psi1_x + psi2 + abs2(psi2)*psi1 = 0\", "
            "\"i*psi2_t - i*psi2_x + psi1 + abs2(psi1)*psi2 = 0\"]",
            "[initial]\npsi1 = \"sech(x)*exp(i*x/2)\"\npsi2 = \"sech(x)/2\"")},
      {"damped sine-Gordon", wave("equation = \"u_tt + 0.1*u_t = u_xx - sin(u)\"", pulse)},
  };
  const Folder folder;
  for (const auto& [name, text] : all) {
    for (const std::string scheme : {"box", "fourier"}) {
      INFO(name << ", " << scheme);
      const std::string file = folder / "wave.h5";
      const Outcome outcome = run(parse_problem(text, name, std::vector<std::string>{"scheme.lagrangian=" + scheme}),
                                  {.output = file, .overwrite = true, .threads = 1});
      CHECK(outcome.status == ExitStatus::done);
      // The law holds to what 1e-13 of each step makes of ten of them.
      CHECK(outcome.statistics.law_steps() > 0);
      CHECK(outcome.statistics.relative_energy_deviation().value_or(1.0) < 1e-12);
      CHECK(check(file).status == ExitStatus::done);
    }
  }
  // Ill-posed, and no run for long: waves grow the faster the shorter they are.
  const Outcome bad = run(parse_problem(wave("equation = \"u_tt = u_xx + 2*u*u_xx + 2*u_x^2 + u_xxxx\"", pulse), "bad"),
                          {.output = folder / "bad.h5", .threads = 1});
  CHECK(bad.status == ExitStatus::failed);
}

TEST_CASE("a damped equation is that of a scaled field, and speaks of the user's") {
  // u_tt + a u_t = u_xx - m u has exp(-a t/2) cos(k x) cos(w t - phase); each mode of the box has its own frequency,
  // so that steps and cells are refined together.
  const auto error = [](int refined, const std::string& sign) {
    const Folder folder;
    const std::string text = "[field]\nequation = \"u_tt + a*u_t = u_xx - u\"\n[parameters]\na = 0.5\nw = \"sqrt(2 - " +
                             sign +
                             "a^2/4)\"\n[grid]\nx = { from = 0, to = \"2*pi\", cells = 21 }\n[exact]\nu = "
                             "\"exp(-a*t/2)*cos(x)*cos(w*t)\"\n[scheme]\nlevels = \"fixed\"\nstep = 0.1\nuntil = 2\n";
    const std::vector<std::string> settings = {fmt::format("grid.x.cells={}", 21 * refined),
                                               fmt::format("scheme.step={}", 0.1 / refined)};
    const Outcome outcome =
        run(parse_problem(text, "damped", settings), {.output = folder / "damped.h5", .threads = 1});
    REQUIRE(outcome.statistics.errors.size() == 1);
    return outcome.statistics.errors.front().value.largest();
  };
  const double coarse = error(1, ""), middle = error(3, ""), fine = error(9, "");
  CHECK(std::log(coarse / middle) / std::log(3.0) == Approx(2.0).margin(0.1));
  CHECK(std::log(middle / fine) / std::log(3.0) == Approx(2.0).margin(0.05));
  CHECK(error(9, "2*") > 10.0 * fine);  // twin: another frequency
  const Problem read = parse_problem(wave("equation = \"u_tt + 0.1*u_t = u_xx - sin(u)\"",
                                          "[initial]\nu = \"sech(x)\"\nu_t = 0\n[output]\ninterval = 0.1\n"
                                          "[output.quantities]\nU = \"u\"\nV = \"u_t\"\nW = \"u_x\""),
                                     "damped");
  CHECK(read.multisymplectic()->fields ==
        std::vector<std::string>{"scaled_u", "scaled_u_x", "scaled_u_t", "time", "minus_work"});
}

TEST_CASE("psi is given whole at the start, and [exact] gives the start where [initial] is left out") {
  const Folder folder;
  const std::string equation = "psi = [\"p\", \"q\"]\nequation = \"i*psi_t + psi_xx + 2*abs2(psi)*psi = 0\"";
  const auto last = [&](const std::string& rest) {
    const std::string file = folder / "psi.h5";
    const Outcome outcome =
        run(parse_problem(wave(equation, rest), "psi"), {.output = file, .overwrite = true, .threads = 1});
    CHECK(outcome.status == ExitStatus::done);
    const std::vector<double> q = record::Reader(file).read("/states/q");
    return std::vector<double>(q.end() - 101, q.end());
  };
  const auto parts = last("[initial]\np = \"sech(x)*cos(x/2)\"\nq = \"sech(x)*sin(x/2)\"");
  const auto whole = last("[initial]\npsi = \"sech(x)*exp(i*x/2)\"");
  const auto exact = last("[exact]\npsi = \"sech(x - t)*exp(i*x/2 + 3*i*t/4)\"");
  const auto other = last("[initial]\npsi = \"sech(x)*exp(i*x/3)\"");
  // cos(x/2)·1 in place of exp(0)·cos(x/2)·…: roundings of the data, which twenty steps of a stable scheme keep.
  for (std::size_t i = 0; i < parts.size(); ++i) {
    CHECK(std::abs(parts[i] - whole[i]) < 1e-13);
    CHECK(std::abs(parts[i] - exact[i]) < 1e-13);
  }
  CHECK(std::abs(parts[40] - other[40]) > 1e-6);
  const auto refusal = [&](const std::string& rest) -> std::string {
    try {
      static_cast<void>(parse_problem(wave(equation, rest), "p.toml"));
    } catch (const ProblemError& error) {
      return error.what();
    }
    return "accepted";
  };
  CHECK_THAT(refusal("[initial]\npsi = \"sin(i*x)\""), Contains("p.toml:7:8: ") && Contains("sin of a complex number"));
  CHECK_THAT(refusal("[initial]\npsi = \"sech(x)*exp(j*x)\""), Contains("unknown name 'j'"));
  CHECK_THAT(refusal(""), Contains("there is no [initial]"));
}

TEST_CASE(
    "psi_t of an equation of second order is given whole, and fields of the form are told by what they stand for") {
  const std::string head =
      "[field]\nequation = \"psi_tt = psi_xx - psi - abs2(psi)*psi\"\npsi = [\"p\", \"q\"]\n[grid]\n"
      "x = { from = 0, to = \"2*pi\", cells = 33 }\n[scheme]\nstep = 0.05\nuntil = 1\n[initial]\n";
  const auto start = [&](const std::string& initial) {
    const Problem problem = parse_problem(head + initial, "p.toml");
    return make_initial_fields(problem, make_grid(problem));
  };
  const auto parts = start("p = \"cos(x)\"\nq = \"sin(x)\"\np_t = \"2*sin(x)\"\nq_t = \"-2*cos(x)\"");
  const auto whole = start("psi = \"exp(i*x)\"\npsi_t = \"-2*i*exp(i*x)\"");
  const auto other = start("psi = \"exp(i*x)\"\npsi_t = \"2*i*exp(i*x)\"");
  const std::vector<std::string> fields =
      parse_problem(head + "psi = 0\npsi_t = 0", "p.toml").multisymplectic()->fields;
  for (const char* const name : {"p", "q", "p_t", "q_t"}) {
    const auto f = static_cast<std::size_t>(std::ranges::find(fields, name) - fields.begin());
    double difference = 0.0, from_other = 0.0;
    for (std::size_t i = 0; i < 33; ++i) {
      difference = std::max(difference, std::abs(parts.at(f).value()[i] - whole.at(f).value()[i]));
      from_other = std::max(from_other, std::abs(parts.at(f).value()[i] - other.at(f).value()[i]));
    }
    CHECK(difference < 1e-15);
    CHECK((from_other > 1.0) == (std::string_view(name).ends_with("_t")));  // the twin: the other way round
  }
  // Of first order in time psi has no rate of its own.
  CHECK_THROWS_WITH(
      parse_problem("[field]\nequation = \"i*psi_t + psi_xx = 0\"\npsi = [\"p\", \"q\"]\n[grid]\nx = { from = 0, "
                    "to = 1, cells = 9 }\n[scheme]\nstep = 0.1\nuntil = 1\n[initial]\npsi = 0\npsi_t = 0\n",
                    "p.toml"),
      Contains("psi_t"));

  const auto unknowns = parse_problem(head + "psi = 0\npsi_t = 0", "p.toml").multisymplectic()->unknowns;
  REQUIRE(unknowns.size() == 2);
  CHECK(unknowns[0].name == "psi");
  CHECK(unknowns[1].name == "psi_t");
  CHECK(unknowns[1].im == std::vector<std::pair<std::string, double>>{{"q_t", 1.0}});
  const auto damped =
      parse_problem(wave("equation = \"u_tt + 0.1*u_t = u_xx - sin(u)\"", "[initial]\nu = 0\nu_t = 0"), "p.toml")
          .multisymplectic()
          ->unknowns;
  REQUIRE(damped.size() == 3);
  CHECK(damped[0].rate == 0.05);
  CHECK(damped[2].name == "u_t");
  CHECK(damped[2].re == std::vector<std::pair<std::string, double>>{{"scaled_u_t", 1.0}, {"scaled_u", -0.05}});
  // The twin: fields that stand for themselves.
  CHECK(parse_problem(wave("equation = \"u_tt = u_xx - sin(u)\"", "[initial]\nu = 0\nu_t = 0"), "p.toml")
            .multisymplectic()
            ->unknowns.empty());
}

TEST_CASE("u_xt follows from u_t, and has to be its derivative where it is given") {
  const auto start = [](const std::string& initial) {
    const Problem problem = parse_problem(
        "[field]\nequation = \"u_tt - 0.2*u_xxtt + u_xxxx = 0\"\n[grid]\nx = { from = 0, to = \"2*pi\", cells = 17 }\n"
        "[scheme]\nstep = 0.1\nuntil = 1\n[initial]\nu = \"cos(x)\"\n" +
            initial,
        "p.toml");
    const auto names = problem.multisymplectic()->fields;
    const auto f = std::ranges::find(names, "u_xt") - names.begin();
    return make_initial_fields(problem, make_grid(problem)).at(static_cast<std::size_t>(f)).value();
  };
  const std::vector<double> follows = start("u_t = \"sin(x)\"");
  REQUIRE(follows.size() == 17);
  for (std::size_t i = 0; i < follows.size(); ++i) {
    CHECK(follows[i] == Approx(std::cos(2.0 * std::numbers::pi * static_cast<double>(i) / 17.0)).margin(1e-13));
  }
  CHECK_NOTHROW(start("u_t = \"sin(x)\"\nu_xt = \"cos(x)\""));
  CHECK_THROWS_WITH(start("u_t = \"sin(x)\"\nu_xt = \"cos(x)+0.1\""),
                    Contains("p.toml:11:1") && Contains("contradicts u_t"));
}

TEST_CASE("derivatives of parentheses are expanded, and moduli and conjugates of complex unknowns known") {
  const auto density = [](const std::string& field, const std::string& others) {
    return parse_problem(wave(field, "[initial]\nu = 0\n" + others), "p.toml").multisymplectic()->density;
  };
  const auto of_u = [&](const std::string& equation) { return density("equation = \"" + equation + "\"", ""); };
  const auto of_psi = [&](const std::string& term) {
    return density("psi = [\"u\", \"v\"]\nequation = [\"i*psi_t + psi_xx = n*psi\", \"n_tt = n_xx + " + term + "\"]",
                   "v = 0\nn = 0\nn_t = 0");
  };
  const auto schroedinger = [&](const std::string& term) {
    return density("psi = [\"u\", \"v\"]\nequation = \"i*psi_t + psi_xx + " + term + " = 0\"", "v = 0");
  };
  const std::string good = of_u("u_tt = u_xx + 2*u*u_xx + 2*u_x^2 - u_xxxx");
  CHECK(of_u("u_tt = (u + u^2)_xx - u_xxxx") == good);
  CHECK(of_u("u_tt - ( u + u^2 - ((u)_x)_x )_xx = 0") == good);
  CHECK(of_u("u_tt = u_xx + 2*(u*u_x)_x - u_xxxx") == good);
  CHECK(of_u("u_tt = u_xx + (|u|^2)_xx - u_xxxx") == good);
  CHECK(of_u("u_tt = (u + 2*u^2)_xx - u_xxxx") != good);
  CHECK(of_u("u_t + (3*u^2)_x + u_xxx = 0") == of_u("u_t + 6*u*u_x + u_xxx = 0"));
  const std::string zakharov = of_psi("(u^2 + v^2)_xx");
  CHECK(of_psi("abs2(psi)_xx") == zakharov);
  CHECK(of_psi("(|psi|^2)_xx") == zakharov);
  CHECK(of_psi("(psi*conj(psi))_xx") == zakharov);
  CHECK(of_psi("2*abs2(psi)_xx") != zakharov);
  const std::string cubic = schroedinger("2*abs2(psi)*psi");
  for (const char* const same : {"2*|psi|^2*psi", "2*abs(psi)^2*psi", "2*psi^2*conj(psi)", "2*abs2(conj(psi))*psi"}) {
    CHECK(schroedinger(same) == cubic);
  }
  CHECK(schroedinger("|psi|^4*psi") == schroedinger("abs2(psi)^2*psi"));
  CHECK(schroedinger("|psi|*psi") == schroedinger("sqrt(abs2(psi))*psi"));
  CHECK(schroedinger("|psi|^4*psi") != cubic);
}

TEST_CASE("what a density or an equation lacks is said with its place") {
  const auto refusal = [](const std::string& field) -> std::string {
    try {
      static_cast<void>(
          parse_problem("[field]\n" + field +
                            "\n[grid]\nx = { from = 0, to = 1, cells = 11 }\n[initial]\nu = 0\n[scheme]\nstep "
                            "= 0.1\nuntil = 1\n",
                        "p.toml"));
    } catch (const ProblemError& error) {
      return error.what();
    }
    return "accepted";
  };
  CHECK(refusal("fields = [\"u\"]\nL = \"u_t^2/2 - u_x^2/2\"") == "accepted");
  CHECK_THAT(refusal("fields = [\"u\"]"), Contains("a Lagrangian density L, a Hamiltonian density H, or an equation"));
  CHECK(refusal("equation = \"u_tt = u_xx\"") == "accepted");
  CHECK_THAT(refusal("equation = \"u_tt - u_xx\""), Contains("p.toml:2:13: ") && Contains("is no equation"));
  CHECK(refusal("equation = \"u_tt = u_xx + (u^2)_xx - u_xxxx\"") == "accepted");
  CHECK_THAT(refusal("equation = \"u_tt = u_xx + (u^2)_xx + v\""), Contains("p.toml:2:38: unknown name 'v'"));
  CHECK_THAT(refusal("equation = \"u_tt = u_xx + (u^2 + v)_xx\""), Contains("p.toml:2:34: unknown name 'v'"));
  CHECK_THAT(refusal("equation = \"u_tt = u_xx + (u^2)_xy\""), Contains("p.toml:2:27: a derivative by y"));
  // psi beside its parts: Zakharov's equations, whose twin has a sign that no density has.
  const std::string zakharov =
      "psi = [\"u\", \"q\"]\nequation = [\"i*psi_t + psi_xx = n*psi\", \"n_tt = n_xx {} 2*u*u_xx + "
      "2*u_x^2 + 2*q*q_xx + 2*q_x^2\"]";
  CHECK(refusal(fmt::format(fmt::runtime(zakharov), "+")) == "accepted");
  CHECK_THAT(refusal(fmt::format(fmt::runtime(zakharov), "+ 3*")), Contains("no Lagrangian was found"));
  CHECK_THAT(refusal("equation = \"u_t = u_xx\""),
             Contains("p.toml:2:13: u_xx beside a first derivative by t is diffusion"));
  CHECK_THAT(refusal("equation = \"u_tt = u_xx + u_xxx\""), Contains("no density has the term u_xxx"));
  CHECK_THAT(refusal("equation = \"u_tt = u_xx - v\""), Contains("p.toml:2:27: unknown name 'v'"));
  CHECK_THAT(refusal("equation = [\"u_tt = u_xx\", \"u = 0\"]"), Contains("2 equations for 1 fields"));
  CHECK(refusal("equation = \"i*psi_t = psi_xx + abs2( psi )*psi\"\npsi = [\"p\", \"q\"]").find("abs2") ==
        std::string::npos);
  CHECK_THAT(refusal("equation = \"i*psi_t = psi_xx + abs2(phi)*psi\"\npsi = [\"p\", \"q\"]"),
             Contains("unknown name 'phi'"));
  CHECK_THAT(refusal("equation = \"i*psi_t = abs2(psi)*psi + chi\"\npsi = [\"p\", \"q\"]"), Contains("p.toml:2:39: "));
  CHECK_THAT(refusal("fields = [\"u\"]\nL = \"-sqrt(1 + u_x^2 - u_t^2)\""),
             Contains("S is not linear in u_t") && Contains("a polynomial of degree two with constant coefficients"));
  CHECK_THAT(refusal("psi = [\"u\", \"q\"]\nequation = [\"i*psi_t + psi_xx = w*psi\", \"w_xx - w = abs2(psi)\"]"),
             Contains("S is not linear in w") && Contains("a field that no derivative by t moves"));
  CHECK_THAT(refusal("equation = \"i*psi_t = psi_xx + sin(psi)\"\npsi = [\"p\", \"q\"]"),
             Contains("sin of a complex number"));
  CHECK_THAT(refusal("fields = [\"u\"]\nL = \"u_t^2\"\nstructure = \"dx\""),
             Contains("p.toml:4:1: structure belongs to"));
  CHECK_THAT(refusal("fields = [\"u\"]\nH = \"u^2\""), Contains("H needs its structure: canonical, dx"));
  CHECK_THAT(refusal("fields = [\"u\"]\nH = \"u^2\"\nstructure = \"canonical\""), Contains("canonical needs pairs"));
  CHECK_THAT(refusal("fields = [\"u\"]\nH = \"u^2\"\nstructure = \"dy\""), Contains("structure"));
  CHECK_THAT(refusal("fields = [\"u\"]\nL = \"u_t^2 - u_y^2\""), Contains("p.toml:3:6: u_y is a derivative by y"));
  CHECK_THAT(refusal("fields = [\"u\"]\nL = \"u_t^2 - v_x^2\""), Contains("p.toml:3:14: ") && Contains("v_x"));
  CHECK_THAT(refusal("fields = [\"u\"]\nL = \"u_t^2/2 - u_q\""), Contains("u_q"));
  CHECK_THAT(refusal("fields = [\"u\"]\nL = \"u_tt^2/2 - u_x^2/2\""),
             Contains("p.toml:3:6: u_tt is of second order in time"));
  CHECK_THAT(refusal("fields = [\"u\"]\nH = \"u_t^2/2\"\nstructure = \"dx\""),
             Contains("p.toml:3:6: u_t is a derivative by t, and H has none"));
  CHECK_THAT(refusal("fields = [\"u\"]\nL = \"u_t^2/2 - a_x^2\"\n[parameters]\na = 1"),
             Contains("a_x is a derivative of the parameter a"));
  CHECK_THAT(refusal("equation = \"u_xx = sin(u)\""), Contains("p.toml:2:13: no equation has a derivative by t"));
  CHECK_THAT(refusal("equation = \"i*u_t + u_xx = 0\""),
             Contains("i is the imaginary unit of a complex unknown") && Contains("called psi"));
  CHECK_THAT(refusal("fields = [\"u\", \"v\"]\nL = \"(u_t - v_x)^2/2\""), Contains("a gauge"));
  CHECK_THAT(refusal("fields = [\"u\"]\nL = \"u_t^2/2\"\nN = 1"), Contains("unknown key N"));
}

TEST_CASE("psi is complex where its equation has abs2 or conj, as where it has i") {
  const auto fields = [](const std::string& equation) {
    const Problem problem = parse_problem("[field]\nequation = \"" + equation +
                                              "\"\n[grid]\nx = { from = -5, to = 5, cells = 33 }\n[initial]\n"
                                              "psi = \"sech(x)\"\npsi_t = \"i*sech(x)\"\n[scheme]\nstep = 0.1\n"
                                              "until = 1\n",
                                          "psi.toml");
    return problem.multisymplectic()->fields;
  };
  const std::vector<std::string> of_abs2 = fields("psi_tt = psi_xx - psi - abs2(psi)*psi");
  CHECK(std::vector<std::string>(of_abs2.begin(), of_abs2.begin() + 2) == std::vector<std::string>{"p", "q"});
  CHECK(fields("psi_tt = psi_xx - psi - psi*conj(psi)*psi") == of_abs2);
  // A real field of that name stays one, for which a complex start is no data.
  CHECK_THROWS_AS(fields("psi_tt = psi_xx - psi - psi^3"), ProblemError);
}

TEST_CASE("forces of place and time drive a field that has a potential, with their sign and a mean of the field") {
  // u_t + u_x = f with u = m + 0.3 sin(x) sin(2t), and with u = m + 0.3 (cos(x - t) - cos(x)).
  struct Forced {
    std::string force;
    double (*u)(double x, double t);
  };
  const std::vector<Forced> all = {
      {"0.6*sin(x)*cos(2*t) + 0.3*cos(x)*sin(2*t)",
       [](double x, double t) { return 0.3 * std::sin(x) * std::sin(2 * t); }},
      {"0.3*sin(x)", [](double x, double t) { return 0.3 * (std::cos(x - t) - std::cos(x)); }},
      {"(0.3*(1 - cos(x)))_x", [](double x, double t) { return 0.3 * (std::cos(x - t) - std::cos(x)); }}};
  constexpr double mean = 0.2;
  const Folder folder;
  const auto error = [&](const Forced& one, double step, double sign, int stages = 1) {
    const std::string file = folder / "forced.h5";
    const std::string text = fmt::format(
        "[field]\nequation = \"u_t + u_x = {}\"\n[grid]\nx = {{ from = 0, to = \"2*pi\", cells = 33 }}\n"
        "[initial]\nu = {}\n[scheme]\nlagrangian = \"fourier\"\nstages = {}\nlevels = \"fixed\"\nstep = {}\nuntil = "
        "1\n",
        one.force, mean, stages, step);
    REQUIRE(run(parse_problem(text, "forced"), {.output = file, .overwrite = true, .threads = 1}).status ==
            ExitStatus::done);
    CHECK(check(file).status == ExitStatus::done);
    const record::Reader reader(file);
    const std::vector<double> u = reader.read("/states/u"), x = reader.read("/grid/x");
    double worst = 0.0;
    for (std::size_t i = 0; i < x.size(); ++i) {
      worst = std::max(worst, std::abs(u[u.size() - x.size() + i] - (mean + sign * one.u(x[i], 1.0))));
    }
    return worst;
  };
  for (const Forced& one : all) {
    INFO(one.force);
    const double coarse = error(one, 0.1, 1.0), middle = error(one, 0.05, 1.0), fine = error(one, 0.025, 1.0);
    CHECK(std::log2(coarse / middle) == Approx(2.0).margin(0.1));
    CHECK(std::log2(middle / fine) == Approx(2.0).margin(0.1));
    CHECK(error(one, 0.025, -1.0) > 0.1);  // the force with the other sign
    CHECK(std::log2(error(one, 0.1, 1.0, 2) / error(one, 0.05, 1.0, 2)) == Approx(4.0).margin(0.2));
  }
}

TEST_CASE("a force that would move the mean of a field with a potential is refused at its equation") {
  const auto said = [](const std::string& force) {
    const std::string text = fmt::format(
        "[field]\nequation = \"u_t + 6*u*u_x + u_xxx = {}\"\n[grid]\nx = {{ from = 0, to = \"2*pi\", cells = 33 }}\n"
        "[initial]\nu = \"0.1*cos(x)\"\n[scheme]\nlagrangian = \"fourier\"\nstep = 0.01\nuntil = 0.1\n",
        force);
    return refusal_at_start(text, "forced");
  };
  CHECK_THAT(said("cos(t)"), Contains("forced:2:") && Contains("at all times") && Contains("Subtract the mean"));
  CHECK_THAT(said("sin(t)"), Contains("forced:2:") && Contains("at all times"));  // 0 at the start
  CHECK_THAT(said("1 + cos(x)"), Contains("has to be 0"));
  CHECK(said("cos(x)*cos(t)").empty());
  CHECK(said("cos(x)").empty());
}

TEST_CASE("a field is in one pair, and in that once") {
  const auto said = [](const std::string& pairs) {
    const std::string text =
        "[field]\nfields = [\"u\", \"m\"]\nH = \"m^2/2 + u^2/2 + u_x^2/2\"\nstructure = \"dx\"\npairs = " + pairs +
        "\n[grid]\nx = { from = 0, to = 1, cells = 15 }\n[initial]\nu = 0\nm = 0\n[scheme]\nlagrangian = \"fourier\"\n"
        "step = 0.1\nuntil = 1\n";
    return refusal_at_start(text, "t.toml");
  };
  CHECK(said("[[\"u\", \"m\"]]").empty());
  CHECK_THAT(said("[[\"u\", \"u\"]]"), Contains("t.toml:5:10: pairs: u is in a pair twice"));
  CHECK_THAT(said("[[\"u\", \"m\"], [\"m\", \"u\"]]"), Contains("pairs: m is in a pair twice"));
}

TEST_CASE("a density in metres and seconds has the fields that it has in other units") {
  const auto problem_of = [](const std::string& L, const std::string& scheme) {
    return parse_problem("[field]\nfields = [\"u\"]\nL = \"" + L +
                             "\"\n[parameters]\nc = 299792458\nw0 = 3e12\nl = 2e-3\n[grid]\nx = { from = 0, to = "
                             "\"l\", cells = 101 }\n[initial]\nu = \"0.5*cos(2*pi*x/l)\"\nu_t = 0\n[scheme]\n"
                             "lagrangian = \"" +
                             scheme + "\"\nstep = 2e-14\nuntil = 1e-12\n",
                         "metres.toml");
  };
  for (const char* const scheme : {"box", "fourier", "leapfrog", "splitting"}) {
    INFO(scheme);
    const Problem problem = problem_of("u_t^2/2 - c^2*u_x^2/2 - w0^2*(1 - cos(u))", scheme);
    CHECK(problem.multisymplectic()->fields == std::vector<std::string>{"u", "u_t", "u_x"});
    const Folder folder;
    const Outcome outcome = run(problem, {.output = folder / "a.h5", .threads = 1});
    CHECK(outcome.status == ExitStatus::done);
    CHECK(outcome.judgement.verdict == figures::Verdict::good);
    CHECK(check(folder / "a.h5").status == ExitStatus::done);
  }
  // The twin: momenta that are the same but for their unit do not give both derivatives, whatever the units are.
  CHECK(problem_of("(u_t + c*u_x)^2/2 - w0^2*(1 - cos(u))", "box").multisymplectic()->fields.size() > 3);
}

TEST_CASE("a field with a potential keeps its mean where the potential can be named by its derivatives alone") {
  // Zakharov's equations, shallow water, and a long wave beside short ones: of n with a mean the same as of n - m where
  // the mean is only a phase, or moves with the flow.
  const auto of = [](const std::string& equations, const std::string& initial) {
    return parse_problem("[field]\nequation = " + equations +
                             "\n[grid]\nx = { from = -10, to = 10, cells = 65 }\n[initial]\n" + initial +
                             "\n[scheme]\nlagrangian = \"fourier\"\nlevels = \"fixed\"\nstep = 0.01\nuntil = 0.2\n",
                         "t.toml");
  };
  const Folder folder;
  const auto states = [&](const Problem& problem, const std::string& field) {
    const std::string file = folder / "mean.h5";
    REQUIRE(run(problem, {.output = file, .overwrite = true, .threads = 1}).status == ExitStatus::done);
    CHECK(check(file).status == ExitStatus::done);
    return record::Reader(file).read("/states/" + field);
  };
  const std::string zakharov = "[\"i*psi_t + psi_xx = n*psi\", \"n_tt = n_xx + abs2(psi)_xx\"]";
  const auto n = [&](const std::string& mean) {
    return states(of(zakharov, "psi = \"sech(x)\"\nn = \"-sech(x)^2 + " + mean + "\"\nn_t = 0"), "n");
  };
  std::vector<double> with = n("0.7");
  const std::vector<double> without = n("0.1"), twin = n("0.7 + 0.01*cos(pi*x/10)");
  double worst = 0.0, of_twin = 0.0;
  for (std::size_t i = 0; i < with.size(); ++i) {
    worst = std::max(worst, std::abs(with[i] - 0.6 - without[i]));
    of_twin = std::max(of_twin, std::abs(twin[i] - 0.6 - without[i]));
  }
  CHECK(worst < 1e-4);  // psi turns by 0.6 t more, which steps of order 2 see
  CHECK(of_twin > 1e-3);
  CHECK(of(zakharov, "psi = 1\nn = 1\nn_t = 0").multisymplectic()->density.find("potential_n*") == std::string::npos);
  for (const char* const equations :
       {"[\"h_t + (h*u)_x = 0\", \"u_t + u*u_x + h_x = 0\"]", "[\"u_t + u*u_x + h_x = 0\", \"h_t + (h*u)_x = 0\"]"}) {
    INFO(equations);
    const std::vector<double> h = states(of(equations, "h = \"1 + 0.1*exp(-x^2)\"\nu = 0"), "h");
    const std::vector<double> other =
        states(of("[\"u_t = -(u^2/2 + h)_x\", \"h_t = -(h*u)_x\"]", "h = \"1 + 0.1*exp(-x^2)\"\nu = 0"), "h");
    REQUIRE(h.size() == other.size());
    double difference = 0.0;
    for (std::size_t i = 0; i < h.size(); ++i) {
      difference = std::max(difference, std::abs(h[i] - other[i]));
    }
    CHECK(difference < 1e-4);  // two densities of one equation, each of order 2
  }
}

TEST_CASE("a vector of fields begins from a list or from its parts") {
  const auto problem = [](const std::string& initial) {
    return "[field]\nfields = [\"w\", \"r[2]\"]\nL = \"(r1_t^2 + r2_t^2 + w_t^2 - r1_x^2 - r2_x^2 - w_x^2)/2 - "
           "(r1^2 + r2^2)^2/4 - w^2*r1\"\n[grid]\nx = { from = 0, to = \"2*pi\", cells = 16 }\n[initial]\nw = "
           "\"sin(x)\"\n"
           "r1_t = 0\nr2_t = 0\nw_t = 0\n" +
           initial + "\n[scheme]\nlagrangian = \"fourier\"\nstep = 0.05\nuntil = 0.2\n";
  };
  const auto first = [&](const std::string& initial) {
    return make_lattice(parse_problem(problem(initial), "t.toml")).level().fields;
  };
  const grids::FieldSet list = first("r = [\"cos(x)\", 0.2]"), parts = first("r1 = \"cos(x)\"\nr2 = 0.2"),
                        other = first("r1 = 0.2\nr2 = \"cos(x)\"");
  CHECK(std::ranges::equal(list.all(), parts.all()));
  CHECK_FALSE(std::ranges::equal(list.all(), other.all()));
  CHECK_THAT(refusal_at_start(problem("r = [\"cos(x)\", 0.2]\nr1 = 0"), "t.toml"), Contains("r1"));
  CHECK_THAT(refusal_at_start(problem("r = [0]"), "t.toml"), Contains("t.toml:11:"));
}

TEST_CASE("powers of the modulus of psi are those of its square") {
  const auto S = [](const std::string& term) {
    return parse_problem("[field]\nequation = \"i*psi_t + psi_xx + " + term +
                             "*psi = 0\"\n[parameters]\nsigma = 1.5\n[grid]\nx = { from = -5, to = 5, cells = 33 }\n"
                             "[initial]\npsi = \"sech(x)\"\n[scheme]\nstep = 0.1\nuntil = 1\n",
                         "psi.toml")
        .multisymplectic()
        ->density;
  };
  const std::string cubic = S("abs2(psi)^1.5");
  for (const char* const term : {"abs(psi)^3", "|psi|^3", "abs(psi)^(2*sigma)", "|psi|^(2*sigma)", "abs2(psi)^sigma"}) {
    INFO(term);
    CHECK(S(term) == cubic);
  }
  CHECK(S("abs(psi)^2.5") != cubic);
}
