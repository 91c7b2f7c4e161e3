// Problem files with random damage: whatever they say, reading them ends with a problem or with the reason why not, and
// running them with a status.

#include <catch2/catch.hpp>

#include <algorithm>
#include <array>
#include <random>
#include <string>
#include <string_view>

#include <fmt/format.h>

#include <rubato/problem/problem.hpp>
#include <rubato/run/run.hpp>

#include "problem/problem_texts.hpp"
#include "records.hpp"

namespace {

using namespace rubato;
using namespace rubato::run_tests;

/// Replaces, inserts, repeats or takes out a few pieces of a text. The same seed does the same everywhere.
std::string damaged(std::string text, std::mt19937& random) {
  static constexpr std::array<std::string_view, 26> pieces = {
      "\"", "[",  "]", "{",   "}", "=",     ".",      ",",       "\n", "#",   "(",  ")", "-",
      "^",  "/0", "0", "nan", "é", "1e308", "\"\"\"", "\\u0000", "*",  "sin", "pi", "t", "\xFF",
  };
  const auto below = [&random](std::size_t count) { return static_cast<std::size_t>(random() % count); };
  for (std::size_t change = 1 + below(2); change > 0; --change) {
    const std::size_t place = below(text.size()), length = std::min(below(12), text.size() - place);
    const std::string_view whole(text), piece(pieces[below(pieces.size())]);
    const std::string_view before = whole.substr(0, place), after = whole.substr(place);
    switch (below(4)) {
      case 0: text = fmt::format("{}{}{}", before, piece, after.substr(std::min<std::size_t>(length, 2))); break;
      case 1: text = fmt::format("{}{}{}", before, piece, after); break;
      case 2: text = fmt::format("{}{}{}", before, whole.substr(below(whole.size()), length), after); break;
      default: text = fmt::format("{}{}", before, after.substr(length)); break;
    }
    if (text.empty()) {
      text += '#';
    }
  }
  return text;
}

struct Counts {
  std::size_t read = 0, refused = 0, ran = 0, ended = 0;
};

}  // namespace

TEST_CASE("problem files with random damage are read or refused with a reason", "[run][bad input]") {
  constexpr unsigned seed = 20261121;
  constexpr std::size_t most_runs = 60;
  std::mt19937 random(seed);
  const Folder folder;
  Counts counts;
  for (int i = 0; i < 1500; ++i) {
    const bool orbit = i % 2 == 0;
    const std::string text = damaged(orbit ? pendulum : breather, random);
    INFO(text);
    try {
      const Problem problem = parse_problem(text, "f.toml");
      ++counts.read;
      // The effective text is what a record keeps: it has to say the same.
      REQUIRE(parse_problem(problem.text, "f.toml").text == problem.text);
      if (!orbit || counts.ran + counts.ended >= most_runs) {
        continue;
      }
      const Problem brief = parse_problem(text, "f.toml", std::vector<std::string>{"scheme.max_steps=3"});
      const Outcome outcome = run(brief, {.output = folder / "f.h5", .overwrite = true, .threads = 1});
      const bool done = outcome.status == ExitStatus::done;
      CHECK((done || outcome.status == ExitStatus::singular || outcome.status == ExitStatus::failed));
      CHECK(outcome.message.empty() == done);
      ++counts.ran;
    } catch (const ProblemError& error) {
      const std::string message = error.what();
      CHECK_THAT(message, Catch::StartsWith("f.toml"));
      CHECK(message.size() > std::string("f.toml:1:1: ").size());
      ++(error.location().line > 0 ? counts.refused : counts.ended);
    }
  }
  // The damage is neither so light that all is read nor so heavy that nothing is.
  CHECK(counts.read > 30);
  CHECK(counts.refused > 500);
  CHECK(counts.ran > 20);
}
