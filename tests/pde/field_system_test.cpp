// Field equations by a density, a lambda and an equation: the same M, K and S three times.

#include <catch2/catch.hpp>

#include <algorithm>
#include <stdexcept>
#include <string>
#include <vector>

#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/parse.hpp>
#include <rubato/pde/field_system.hpp>

using namespace rubato;
using Catch::Matchers::Contains;

namespace {

/// Whether both have the same fields, in some order, the same matrices and, at some points, the same gradient of S.
bool are_equal(const MultisymplecticSystem& a, const MultisymplecticSystem& b) {
  const auto d = static_cast<Eigen::Index>(a.fields().size());
  Eigen::MatrixXd order = Eigen::MatrixXd::Zero(d, d);  // z of b from that of a
  for (Eigen::Index f = 0; f < d; ++f) {
    const auto place = std::ranges::find(b.fields(), a.fields()[static_cast<std::size_t>(f)]);
    if (place == b.fields().end()) {
      return false;
    }
    order(place - b.fields().begin(), f) = 1.0;
  }
  if (b.field_count() != a.field_count() || order.transpose() * b.M() * order != a.M() ||
      order.transpose() * b.K(0) * order != a.K(0)) {
    return false;
  }
  formula::ScalarEvaluator one(a.gradient_code()), other(b.gradient_code());
  for (int i = 1; i < 8; ++i) {
    const Eigen::VectorXd z = Eigen::VectorXd::LinSpaced(d, 0.1 * i, -0.3), moved = order * z;
    std::vector<double> of_one(a.fields().size() + 1), of_other(of_one);
    one({z.data(), a.fields().size()}, of_one);
    other({moved.data(), a.fields().size()}, of_other);
    const Eigen::Map<const Eigen::VectorXd> slope(of_one.data() + 1, d), other_slope(of_other.data() + 1, d);
    if ((order * slope - other_slope).norm() > 1e-14) {  // of terms of size 1
      return false;
    }
  }
  return true;
}

}  // namespace

TEST_CASE("a density as text, as a lambda, and its equation give one system") {
  const MultisymplecticSystem text = field_system({"u"}, "u_t^2/2 - c^2*u_x^2/2 - (1 - cos(u))", {{"c", 2.0}});
  const MultisymplecticSystem lambda = field_system(
      {"u"}, [](FieldJets& j) { return 0.5 * pow(j("u_t"), 2.0) - 2.0 * pow(j("u_x"), 2.0) - (1.0 - cos(j("u"))); });
  const MultisymplecticSystem equation = equation_system({"u"}, {"u_tt = 4*u_xx - sin(u)"});
  CHECK(text.fields().size() == 3);
  CHECK(are_equal(text, lambda));
  CHECK(are_equal(text, equation));
  CHECK_FALSE(are_equal(text, equation_system({"u"}, {"u_tt = 4*u_xx - u"})));  // the twin
  CHECK(field_system({"u"}, "u_t^2/2 - u_x^2/2 - u_y^2/2 - x*u^2", {}, 2).directions() == 2);
}

TEST_CASE("what cannot be stated as a field is refused") {
  CHECK_THROWS_WITH(field_system({"u"}, "u_t^2/2 - v_x^2"), Contains("v_x"));
  CHECK_THROWS_WITH(field_system({"u"}, [](FieldJets& j) { return j("v_t"); }), Contains("v_t is neither a field"));
  CHECK_THROWS_WITH(field_system({"u"}, "u_t^2", {}, 4), Contains("there are 1 to 3"));
  CHECK_THROWS_WITH(equation_system({"u"}, {"u_tt - u_xx"}), Contains("is no equation"));
  CHECK_THROWS_WITH(equation_system({"u"}, {"u_t = u_xx"}), Contains("diffusion"));
  CHECK_THROWS_AS(equation_system({"u"}, {"u_tt = u_xx +"}), formula::ParseError);
}
