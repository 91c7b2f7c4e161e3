#include <catch2/catch.hpp>

#include <cmath>
#include <ctime>
#include <numbers>
#include <string>
#include <vector>

#include <rubato/formula/parse.hpp>

#include "random_formula.hpp"

using namespace rubato::formula;
using rubato::formula::testing::evaluate;

namespace {

const std::vector<std::string> xyz{"x", "y", "z", "omega", "E", "e"};

/// The value of the text at x = 2, y = 3, z = 5, omega = 7, E = 11, e = 13.
double value(const std::string& text) {
  Graph graph;
  for (const std::string& name : xyz) {
    graph.variable(name);
  }
  return evaluate<double>(parse(text, graph, xyz), {2, 3, 5, 7, 11, 13});
}

struct Refusal {
  std::size_t line, column;
  std::string reason;
  bool operator==(const Refusal&) const = default;
};

Refusal refusal(const std::string& text) {
  Graph graph;
  try {
    (void)parse(text, graph, xyz);
  } catch (const ParseError& error) {
    return {error.line(), error.column(), error.reason()};
  }
  return {0, 0, "accepted"};
}

std::string repeated(const std::string& piece, std::size_t times) {
  std::string text;
  text.reserve(piece.size() * times);
  for (std::size_t i = 0; i < times; ++i) {
    text += piece;
  }
  return text;
}

}  // namespace

TEST_CASE("formulas mean what mathematics means by them") {
  const auto [text, expected] = GENERATE(table<std::string, double>({
      {"1", 1.0},
      {"1.", 1.0},
      {".5", 0.5},
      {"1e-3", 1e-3},
      {"1E5", 1e5},
      {"2.5e+1", 25.0},
      {"1e-400", 0.0},
      {"4.9406564584124654e-324", 4.9406564584124654e-324},
      {"0.1", 0.1},
      {"pi", std::numbers::pi},
      {"x + y*z", 17.0},
      {"(x + y)*z", 25.0},
      {"x - y - z", -6.0},
      {"x - (y - z)", 4.0},
      {"z/y/x", 5.0 / 3.0 / 2.0},
      {"z/(y/x)", 5.0 / (3.0 / 2.0)},
      {"-x^2", -4.0},
      {"(-x)^2", 4.0},
      {"2^3^2", 512.0},
      {"(2^3)^2", 64.0},
      {"2^-3", 0.125},
      {"x^-y^2", 1.0 / 512.0},
      {"x*-y", -6.0},
      {"x - -y", 5.0},
      {"--x", 2.0},
      {"-x*y", -6.0},
      {"-x + y", 1.0},
      {"E*e", 143.0},
      {"2*e", 26.0},
      {" \t\r\n x\n +\n y ", 5.0},
      {"atan2(y, x)", std::atan2(3.0, 2.0)},
      {"min(x, y)", 2.0},
      {"min(z, y, x)", 2.0},
      {"max(x, y, z, 4)", 5.0},
      {"sech(x)", 1.0 / std::cosh(2.0)},
      {"csch(x)", 1.0 / std::sinh(2.0)},
      {"sign(-x)", -1.0},
      {"sin(cos(x))", std::sin(std::cos(2.0))},
      {"cbrt(-8)", -2.0},
  }));
  CAPTURE(text);
  // The expected values are the same operations in the same order, or differ by the rounding of 1/cosh: 4 ulp at most.
  CHECK(std::abs(value(text) - expected) <= 4 * std::numeric_limits<double>::epsilon() * std::abs(expected));
}

TEST_CASE("a mistake in a formula is named where it stands") {
  const auto [text, line, column, reason] = GENERATE(table<std::string, std::size_t, std::size_t, std::string>({
      {"", 1, 1, "the formula is empty"},
      {" \n ", 2, 2, "the formula is empty"},
      {"(x + 1", 1, 1, "this ( is never closed"},
      {"x*sin((x + 1)", 1, 6, "this ( is never closed"},
      {"min(x, y", 1, 4, "this ( is never closed"},
      {"x + 1)", 1, 6, "this ) closes nothing"},
      {"x +", 1, 4, "a number, name or ( is missing after '+'"},
      {"x + * y", 1, 5, "a number, name or ( is missing before '*'"},
      {"* y", 1, 1, "a number, name or ( is missing before '*'"},
      {"x + + y", 1, 5, "a number, name or ( is missing before '+': a plus sign stands only between two operands"},
      {"()", 1, 1, "nothing stands between ( and )"},
      {"sin(x +)", 1, 8, "a number, name or ( is missing before ')'"},
      {"x**2", 1, 2, "** is not an operator: use ^ for a power"},
      {"2x", 1, 2, "an operator is missing: for a product write 2*x"},
      {"2 x", 1, 3, "an operator is missing: for a product write 2*x"},
      {"x y", 1, 3, "an operator is missing: for a product write x*y"},
      {"2e", 1, 2, "an operator is missing: for a product write 2*e"},
      {"2(x)", 1, 2, "an operator is missing before '(': for a product write *"},
      {"(x)(y)", 1, 4, "an operator is missing before '(': for a product write *"},
      {"(x)y", 1, 4, "an operator is missing before 'y': for a product write *"},
      {"x(2)", 1, 1, "'x' is not a function: for a product write x*(...)"},
      {"sin x", 1, 1, "sin is a function: write sin(...)"},
      {"sin(x, y)", 1, 1, "sin takes 1 argument, got 2"},
      {"1 + sin()", 1, 5, "sin takes 1 argument, got 0"},
      {"atan2(x)", 1, 1, "atan2 takes 2 arguments, got 1"},
      {"min(x)", 1, 1, "min takes 2 or more arguments, got 1"},
      {"omgea + x", 1, 1, "unknown name 'omgea': did you mean 'omega'?"},
      {"x +\n  omega*\n w", 3, 2, "unknown name 'w'"},
      {"coss(x)", 1, 1, "unknown function 'coss': did you mean 'cos'?"},
      {"Sqrt(x)", 1, 1, "unknown function 'Sqrt': did you mean 'sqrt'?"},
      {"ln(x)", 1, 1, "unknown function 'ln': the natural logarithm is log"},
      {"1.2.3", 1, 4, "the number 1.2 goes on with a second point"},
      {"1e400", 1, 1, "the number 1e400 is too large: the largest is about 1.8e308"},
      {"1,5", 1, 2, "a comma separates the arguments of a function: decimals are written with a point"},
      {"x = 1", 1, 3, "unexpected character '=': a formula is one expression, without ="},
      {"x $ y", 1, 3, "unexpected character '$'"},
      {"x × y", 1, 3, "unexpected character '×': write * for a product"},
      {"ω + x", 1, 1, "unexpected character 'ω'"},
      {"x² + ÷", 1, 2, "unexpected character '²': write ^2 for a square"},
      {"x + \xff", 1, 5, "the byte 0xFF is not valid UTF-8"},
      {"x + \xe2\x82", 1, 5, "the byte 0xE2 is not valid UTF-8"},
      {std::string("x\0y", 3), 1, 2, "unexpected control character U+0000"},
  }));
  CAPTURE(text);
  const Refusal got = refusal(text);
  CHECK(got.reason == reason);
  CHECK(got.line == line);
  CHECK(got.column == column);
}

TEST_CASE("columns count characters, not bytes") {
  Graph graph;
  const ParseContext context{.resolve = [&](std::string_view name) { return std::optional(graph.variable(name)); },
                             .known_names = {}};
  try {
    (void)parse("x + y\n ×", graph, context);
    FAIL("accepted");
  } catch (const ParseError& error) {
    CHECK(error.offset() == 7);
    CHECK(error.line() == 2);
    CHECK(error.column() == 2);
    CHECK(std::string(error.what()) == "unexpected character '×': write * for a product\n   ×\n   ^");
  }
}

TEST_CASE("the excerpt of a long line is a window around the place") {
  Graph graph;
  const std::string text = repeated("x + ", 1000) + "$" + repeated(" + x", 1000);
  try {
    (void)parse(text, graph, xyz);
    FAIL("accepted");
  } catch (const ParseError& error) {
    const std::string message = error.what();
    const std::size_t line_begin = message.find('\n') + 1;
    const std::size_t caret_begin = message.find('\n', line_begin) + 1;
    CHECK(caret_begin - line_begin < 100);
    CHECK(message[line_begin + message.find('^', caret_begin) - caret_begin] == '$');
  }
}

TEST_CASE("nesting is limited, length is not") {
  const auto too_deep = std::string("nesting deeper than 1000 levels");
  const std::size_t hundred_thousand = 100000;
  CHECK(refusal(repeated("(", hundred_thousand) + "x" + repeated(")", hundred_thousand)).reason == too_deep);
  CHECK(refusal(repeated("-", hundred_thousand) + "x").reason == too_deep);
  CHECK(refusal(repeated("x^", hundred_thousand) + "x").reason == too_deep);
  CHECK(refusal(repeated("sin(", hundred_thousand) + "x" + repeated(")", hundred_thousand)).reason == too_deep);
  CHECK(refusal(repeated("(", 1000) + "x" + repeated(")", 1000)).reason == "accepted");
  CHECK(refusal(repeated("(", 1001) + "x" + repeated(")", 1001)).reason == too_deep);
  CHECK(refusal("(x)" + repeated("*(x)", hundred_thousand)).reason == "accepted");
}

TEST_CASE("a sum of ten megabytes is read in seconds") {
  std::string text = "0";
  for (int i = 0; text.size() < 10'000'000; ++i) {
    text += i % 2 == 0 ? " + x*" : " - y/";
    text += std::to_string(i + 1);
  }
  Graph graph;
  const std::clock_t begin = std::clock();  // of the processor: the machine may have other things to do
  const Expression sum = parse(text, graph, xyz);
  const double seconds = static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC;
  CHECK(graph.size() > 1'000'000);
  CHECK(variables_of(sum) == std::vector<std::size_t>{0, 1});
  CHECK(seconds < 20.0);  // about one second; a quadratic reader would take hours
}

TEST_CASE("calls that the caller defines") {
  Graph graph;
  const ParseContext context{
      .resolve = [&](std::string_view name) -> std::optional<Expression> {
        return name == "u" ? std::optional(graph.variable("u")) : std::nullopt;
      },
      .call = [&](std::string_view name, std::span<const Expression> arguments) -> std::optional<Expression> {
        return name == "dx" && arguments.size() == 1 ? std::optional(graph.variable("u_x")) : std::nullopt;
      },
      .known_names = {}};
  CHECK(to_string(parse("2*dx(u)", graph, context)) == "2*u_x");
  CHECK_THROWS_AS(parse("2*dy(u)", graph, context), ParseError);
}

TEST_CASE("names") {
  CHECK(is_valid_name("x"));
  CHECK(is_valid_name("_q1"));
  CHECK(is_valid_name("e"));
  CHECK_FALSE(is_valid_name(""));
  CHECK_FALSE(is_valid_name("1x"));
  CHECK_FALSE(is_valid_name("x y"));
  CHECK_FALSE(is_valid_name("ω"));
  CHECK_FALSE(is_valid_name("pi"));
  CHECK_FALSE(is_valid_name("sin"));
  CHECK(is_reserved_name("pi"));
  CHECK(is_reserved_name("csch"));
  CHECK_FALSE(is_reserved_name("ln"));

  const std::vector<std::string> known{"omega", "gamma", "levels"};
  CHECK(nearest_name("omgea", known) == "omega");
  CHECK(nearest_name("gama", known) == "gamma");
  CHECK(nearest_name("LEVELS", known) == "levels");
  CHECK_FALSE(nearest_name("alpha", known).has_value());
  CHECK_FALSE(nearest_name("o", known).has_value());
}

TEST_CASE("to_string is read back as the same expression") {
  std::size_t checked = 0;
  const bool holds = rc::check("parse(to_string(e)) == e", [&] {
    Graph graph;
    const std::vector<std::string> names(testing::names.begin(), testing::names.end());
    for (const Expression formula : testing::build(graph, *testing::recipes(14))) {
      RC_ASSERT(parse(to_string(formula), graph, names) == formula);
      ++checked;
    }
  });
  CHECK(holds);
  CHECK(checked > 1000);
  // Twin: without the parentheses that to_string writes, another expression is read.
  Graph graph;
  const Expression difference = parse("x - (y - z)", graph, xyz);
  CHECK_FALSE(parse("x - y - z", graph, xyz) == difference);
}

TEST_CASE("names of other languages are answered by what to write") {
  const auto message = [](const std::string& text) {
    Graph graph;
    const std::vector<std::string> names = {"x", "y"};
    try {
      (void)parse(text, graph, names);
    } catch (const ParseError& error) {
      return error.reason();
    }
    return std::string("accepted");
  };
  CHECK(message("pow(x, 2)") == "unknown function 'pow': write a^b");
  CHECK(message("2*ln(x)") == "unknown function 'ln': the natural logarithm is log");
  CHECK(message("fabs(x)") == "unknown function 'fabs': write abs(x)");
  CHECK(message("arctan(x) + 1") == "unknown function 'arctan': write atan(x)");
  CHECK(message("x + heaviside(y)") == "unknown function 'heaviside': write where(x > 0, 1, 0)");
  CHECK(message("1 + pow") == "unknown name 'pow': write a^b");
  CHECK(message("x**2") == "** is not an operator: use ^ for a power");
  // The twins: other names get the nearest one, and a user's own is no foreign one.
  CHECK(message("coss(x)") == "unknown function 'coss': did you mean 'cos'?");
  Graph graph;
  const std::vector<std::string> names = {"pow", "ln"};
  CHECK_NOTHROW((void)parse("pow + 2*ln", graph, names));
}
