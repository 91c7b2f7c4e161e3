// What `rubato help` prints is what the parser and the reader accept.

#include <algorithm>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <catch2/catch.hpp>

#include <rubato/formula/language.hpp>
#include <rubato/formula/parse.hpp>
#include <rubato/problem/help.hpp>
#include <rubato/problem/keys.hpp>
#include <rubato/problem/problem.hpp>

#include "problem_texts.hpp"

using namespace rubato;
using namespace rubato;
using namespace rubato::run_tests;
using Catch::Contains;

namespace {

/// What is said of a problem; empty if nothing.
std::string refusal(const std::string& text, const std::vector<std::string>& settings) {
  try {
    static_cast<void>(parse_problem(text, "p.toml", settings));
    return {};
  } catch (const ProblemError& error) {
    return error.what();
  }
}

const std::string by_lagrangian =
    replaced(replaced(replaced(replaced(pendulum, "[hamiltonian]", "[lagrangian]"), "p = [\"p\"]\n", ""),
                      "H = \"p^2/2 - cos(q)\"", "L = \"q_dot^2/2 + cos(q)\""),
             "p = 1.9", "q_dot = 1.9");

const std::string by_density = replaced(
    replaced(replaced(replaced(breather, "[multisymplectic]", "[field]"),
                      "fields = [\"u\", \"v\", \"w\"]\nM = [[\"u\", \"v\", -1]]\nK.x = [[\"u\", \"w\", 1]]\nS = \"(v^2 "
                      "- w^2)/2 + 1 - cos(u)\"",
                      "fields = [\"u\"]\nL = \"u_t^2/2 - u_x^2/2 - (1 - cos(u))\""),
             "\nv = ", "\nu_t = "),
    "[invariants]\ntopological_charge = \"w/(2*pi)\"\n[symmetries]\nturn = [[\"u\", \"v\", 1], [\"v\", \"u\", -1]]\n",
    "");

/// Of four problems, two orbits and two lattices, with the key added: how many call it unknown.
int called_unknown(const std::string& path) {
  int count = 0;
  for (const std::string& text : {pendulum, by_lagrangian, breather, by_density}) {
    // A date is right nowhere: a key that is known is called wrong for its value, or for its place.
    const std::string said = refusal(text, {path + "=1979-05-27"});
    REQUIRE_FALSE(said.empty());
    count += said.find("unknown key") != std::string::npos || said.find("unknown table") != std::string::npos ? 1 : 0;
  }
  return count;
}

std::string path_of(std::string_view table, std::string_view key) {
  return table.empty() ? std::string(key) : std::string(table) + "." + std::string(key);
}

}  // namespace

TEST_CASE("the lists of lagrangians are those of the registries") {
  using Words = std::vector<std::string_view>;
  const auto list = [](std::span<const std::string_view> words) { return Words(words.begin(), words.end()); };
  CHECK(list(hamiltonian_lagrangians()) == Words{"midpoint", "forward", "generating", "custom", "gauss", "splitting"});
  CHECK(list(quadratures()) == Words{"midpoint", "gauss", "trapezoid", "lobatto"});
  CHECK(to_string(LagrangianName::forward) == "forward");
  CHECK(to_string(LagrangianName::generating) == "generating");
  CHECK(to_string(LagrangianName::custom) == "custom");
  CHECK(to_string(LagrangianName::lobatto) == "lobatto");
}

TEST_CASE("every key that help problem lists is read, and no other") {
  for (const KeyEntry& key : problem_keys()) {
    if (key.table == "initial.next" || key.name == "next" || key.table == "multisymplectic.K") {
      continue;  // below
    }
    const std::string path = path_of(key.table, key.name);
    INFO(path);
    CHECK(called_unknown(path) < 4);
    const auto table = std::ranges::find(problem_tables(), key.table, &TableEntry::name);
    REQUIRE(table != problem_tables().end());
    if (table->names_what.empty()) {
      CHECK(called_unknown(path + "qq") > 0);
    }
  }
  CHECK_THAT(refusal(pendulum, {"initial.next.q=1", "initial.next.p=1"}), Contains("[initial.next] needs t"));
  CHECK_THAT(refusal(breather, {"multisymplectic.K.y=[]"}), Contains("K.y is given, but [grid] has no y"));
  CHECK_THAT(refusal(breather, {"multisymplectic.K.q=[]"}), Contains("unknown key q"));
}

TEST_CASE("every word that help problem lists is one") {
  for (const KeyEntry& key : problem_keys()) {
    for (const std::string_view word : key.words) {
      INFO(key.name << " = " << word);
      bool accepted = false;
      for (const std::string& text : {pendulum, breather}) {
        std::vector<std::string> settings = {path_of(key.table, key.name) + "=" + std::string(word)};
        if (key.name == "darboux") {
          settings.insert(settings.end(), {"scheme.lagrangian=generating", "scheme.order=4"});
        }
        const std::string said = refusal(text, settings);
        accepted = accepted || said.find("is not known") == std::string::npos;
      }
      CHECK(accepted);
    }
  }
  CHECK_THAT(refusal(pendulum, {"scheme.levels=variabel"}), Contains("did you mean \"variable\"?"));
}

TEST_CASE("every function, operator and constant that help formulas lists is parsed, and stands there") {
  const std::string text = help_text("formulas");
  const std::vector<std::string> names = {"a", "b"};
  formula::Graph graph;
  for (const formula::Function& function : formula::functions()) {
    const std::string name(function.name);
    INFO(name);
    CHECK_THAT(text, Contains("  " + name + "("));
    CHECK(function.name == formula::name(function.operation));
    // Numbers suit all: the orders of Bessel functions, and the parameters of elliptic ones, have to be such.
    const std::string arguments = formula::arity(function.operation) == 1 ? "(a)"
                                  : name.starts_with("bessel")            ? "(2, b)"
                                  : function.yields                       ? "(a, 0.5)"
                                                                          : "(a, b)";
    CHECK_NOTHROW(formula::parse(name + arguments, graph, names));
    if (function.variadic) {
      CHECK_NOTHROW(formula::parse(name + "(a, b, 1)", graph, names));
    }
    CHECK(formula::is_reserved_name(name) != function.yields);
  }
  for (const formula::Word& word : formula::words()) {
    CHECK_THAT(text, Contains("  " + std::string(word.name) + "("));
    CHECK_FALSE(formula::is_reserved_name(word.name));
  }
  for (const formula::Operator& op : formula::operators()) {
    CHECK_NOTHROW(formula::parse(std::string("a ") + op.symbol + " b", graph, names));
    CHECK_THAT(text, Contains(std::string("  a ") + op.symbol + " b"));
  }
  for (const formula::Constant& constant : formula::constants()) {
    CHECK(formula::parse(constant.name, graph, names).constant_value() == constant.value);
    CHECK_THAT(text, Contains("  " + std::string(constant.name)));
  }
  CHECK_THAT(text, Contains("^; then the sign of -a; then * and /; then + and -"));
}

TEST_CASE("help on what there is none for names the nearest") {
  CHECK_THROWS_WITH(help_text("formula"), Contains("did you mean formulas?"));
  CHECK_THROWS_WITH(help_text("xyz"), Contains("topics are formulas, problem, table, "));
  for (const std::string& topic : help_topics()) {
    const std::string text = help_text(topic);
    CHECK(text.size() > 100);
    // Of a table its own keys, and no other table.
    for (const KeyEntry& key : problem_keys()) {
      if (key.table == topic) {
        CHECK_THAT(text, Contains(fmt::format("\n  {:<18}", key.name)));
      }
    }
    for (const TableEntry& table : problem_tables()) {
      const bool is_there = text.find(fmt::format("[{}]\n", table.name)) != std::string::npos;
      CHECK(is_there == (!table.name.empty() && (topic == table.name || topic == "problem")));
    }
  }
}

TEST_CASE("what the help of an entry shows as an example of members is an ensemble") {
  const auto keys = problem_keys();
  const auto members =
      std::ranges::find_if(keys, [](const KeyEntry& key) { return key.table == "ensemble" && key.name == "members"; });
  REQUIRE(members != keys.end());
  const std::string& meaning = members->meaning;
  const std::string example = meaning.substr(meaning.find('['), meaning.find(']') + 1 - meaning.find('['));
  CHECK(refusal(pendulum, {"ensemble.members=" + example}).empty());
  // The twin: a member that leaves an entry of the others out.
  CHECK_THAT(refusal(pendulum, {"ensemble.members=[{ initial.p = 1 }, { initial.p = 1.5, parameters.k = 2 }]"}),
             Contains("every member gives the same entries"));
}
