// Components of vectors, r[i], and sums over them.

#include <catch2/catch.hpp>

#include <array>
#include <string>
#include <vector>

#include <rubato/formula/parse.hpp>

using namespace rubato::formula;
using Catch::Contains;

namespace {

const std::vector<std::string> names = {"q1", "q2", "q3", "k", "x"};

std::string failure(const std::string& text) {
  Graph graph;
  try {
    static_cast<void>(parse(text, graph, names));
  } catch (const ParseError& error) {
    return error.reason();
  }
  return "";
}

/// Whether both texts are one expression.
bool same(const std::string& a, const std::string& b) {
  Graph graph;
  return parse(a, graph, names) == parse(b, graph, names);
}

}  // namespace

TEST_CASE("sums and components are what they stand for, written out") {
  CHECK(same("q[2]", "q2"));
  CHECK(same("q[1+1]*x", "q2*x"));
  CHECK(same("sum(i, 1, 3, q[i]^2)", "q1^2 + q2^2 + q3^2"));
  CHECK(same("sum(i, 1, 2, (q[i+1] - q[i])^2)/2", "((q2 - q1)^2 + (q3 - q2)^2)/2"));
  CHECK(same("sum(i, 1, 2, sum(j, i, 2, q[i]*q[j+1]))", "(q1*q2 + q1*q3) + q2*q3"));
  CHECK(same("x - sum(i, 2, 2, i*q[i]) + 1", "x - 2*q2 + 1"));
  CHECK(same("sum(i, 3, 2, q[99]*(1 + i))", "0"));
  CHECK(same("sum(k1, 1, 2, k1*k)", "1*k + 2*k"));
  CHECK_FALSE(same("sum(i, 1, 2, q[i])", "q1 + q3"));
}

TEST_CASE("who calls something sum means that") {
  Graph graph;
  const std::vector<std::string> own = {"sum", "x"};
  CHECK(parse("2*sum", graph, own) == 2.0 * graph.variable("sum"));
  CHECK_THROWS_AS(parse("sum(i, 1, 2, x)", graph, own), ParseError);
}

TEST_CASE("what is wrong with a sum is told at its place") {
  CHECK_THAT(failure("q[4]"), Contains("there is no q[4]"));
  CHECK_THAT(failure("q[0.5]"), Contains("an integer that is known beforehand, and is 0.5"));
  CHECK_THAT(failure("q[x]"), Contains("an integer that is known beforehand"));
  CHECK_THAT(failure("q[1"), Contains("this [ is never closed"));
  CHECK_THAT(failure("[1]"), Contains("only ( ) group"));
  CHECK_THAT(failure("x]"), Contains("only ( ) group"));
  CHECK_THAT(failure("sum(i, 1, 3)"), Contains("sum takes an index"));
  CHECK_THAT(failure("sum(i, 1, 3, 4, 5)"), Contains("sum takes one term"));
  CHECK_THAT(failure("sum(x, 1, 3, x)"), Contains("'x' has a meaning already"));
  CHECK_THAT(failure("sum(i, 1, 2, sum(i, 1, 2, i))"), Contains("'i' has a meaning already"));
  CHECK_THAT(failure("sum(i, 1, 3, i"), Contains("never closed"));
  CHECK_THAT(failure("sum(i, 1, 2, i) + i"), Contains("unknown name 'i'"));
  CHECK_THAT(failure("sum(i, 1, 10^7, i)"), Contains("more than 1000000 terms"));
  CHECK_THAT(failure("sum(i, 1, 10^12, i)"), Contains("an integer that is known beforehand"));
}
