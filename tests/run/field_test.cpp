// Problems stated by a density: the same waves as with the M, K and S of the catalogue.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <rubato/catalogue/catalogue.hpp>
#include <rubato/problem/problem.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/run.hpp>

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
       "equation = \"i*psi_t + psi_xx + a*abs2(psi)*psi = 0\"\npsi = [\"p\", \"q\"]",
       "equation = \"i*psi_t + psi_xx + a*abs2(psi)*psi + psi/3 = 0\"\npsi = [\"p\", \"q\"]",
       {"p", "q"},
       {"scheme.until=1"},
       {{"[\"v\", \"w\", -1], [\"w\", \"v\", 1]", "[\"p_x\", \"q_x\", -1], [\"q_x\", \"p_x\", 1]"}}},
  };
  for (const Stated& one : all) {
    compare(one);
  }
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
  CHECK_THAT(refusal("equation = \"u_t = u_xx\""), Contains("p.toml:2:13: there is no Lagrangian"));
  CHECK_THAT(refusal("equation = \"u_tt = u_xx - v\""), Contains("p.toml:2:27: unknown name 'v'"));
  CHECK_THAT(refusal("equation = [\"u_tt = u_xx\", \"u = 0\"]"), Contains("2 equations for 1 fields"));
  CHECK(refusal("equation = \"i*psi_t = psi_xx + abs2( psi )*psi\"\npsi = [\"p\", \"q\"]").find("abs2") ==
        std::string::npos);
  CHECK_THAT(refusal("equation = \"i*psi_t = psi_xx + abs2(phi)*psi\"\npsi = [\"p\", \"q\"]"),
             Contains("unknown name 'phi'"));
  CHECK_THAT(refusal("equation = \"i*psi_t = abs2(psi)*psi + chi\"\npsi = [\"p\", \"q\"]"), Contains("p.toml:2:39: "));
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
  CHECK_THAT(refusal("fields = [\"u\"]\nL = \"u_t^2/2\"\nN = 1"), Contains("unknown key N"));
}
