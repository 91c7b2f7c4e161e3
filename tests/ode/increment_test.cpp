#include <catch2/catch.hpp>

#include <limits>

#include <rubato/ode/increment.hpp>

using namespace rubato;

namespace {

using Vector = Eigen::VectorXd;
const Vector zero = Vector::Zero(1);
Vector vector_of(double value) {
  return Vector::Constant(1, value);
}

/// What 2^16 increments δ = 2^-4 (1 + 2^-52), of each of which 2^-60 was lost in rounding, put on top of 1 + 2^12,
/// when added by `add`. The last step takes 1 + 2^12 away again, without rounding. δ fills all 53 bits of a number.
template <typename Add>
double low_digits(Add add) {
  CompensatedState<Vector> z(vector_of(1.0));
  const Vector delta = vector_of(0x1p-4 + 0x1p-56);
  for (int k = 0; k < 65536; ++k) {
    add(z, delta, vector_of(0x1p-60));
  }
  z.add(vector_of(-4097.0));
  return z.value()[0];
}

}  // namespace

TEST_CASE("a compensated state keeps increments, and what they lost when they were rounded, to the last bit") {
  const auto both = [](auto& z, const Vector& delta, const Vector& lost) { z.add(delta, lost); };
  CHECK(low_digits(both) == 0x1p-40 + 0x1p-44);
  const auto one_by_one = [](auto& z, const Vector& delta, const Vector& lost) {
    z.add(delta);
    z.add(lost);
  };
  CHECK(low_digits(one_by_one) == 0x1p-40 + 0x1p-44);
  // The twins: what was lost left out, or added to δ where there is no room for it.
  const auto without = [](auto& z, const Vector& delta, const Vector&) { z.add(delta); };
  CHECK(low_digits(without) == 0x1p-40);
  const auto before = [](auto& z, const Vector& delta, const Vector& lost) { z.add(delta + lost); };
  CHECK(low_digits(before) == 0x1p-40);
}

TEST_CASE("a displaced compensated state takes its low part along") {
  CompensatedState<Vector> z(vector_of(1.0));
  z.add(vector_of(0x1p-53));  // below the last place of 1
  REQUIRE(z.value()[0] == 1.0);
  Vector result = zero;
  z.displaced(1.0, zero, result);
  CHECK(result[0] == 1.0);
  z.displaced(0.5, vector_of(-2.0), result);
  CHECK(result[0] == 0x1p-53);
}

TEST_CASE("corrections are done where the next would mend nothing, known from the contraction, not before") {
  using Verdict = StagnationTest::Verdict;
  const double infinity = std::numeric_limits<double>::infinity();
  // One contraction made 1e-8 of the error: it is 1e-4, a correction of 1e-16 says, and leaves 1e-8 of itself.
  StagnationTest continued(0.0, infinity, 1e-8);
  CHECK(continued.judge(1e-16, 1e-16) == Verdict::done);
  CHECK(*continued.contraction() == Approx(1e-8));
  // The twins: a poor contraction before; nothing known.
  StagnationTest poor(0.0, 1e-2, 1e-8);
  CHECK(poor.judge(1e-14, 1e-14) == Verdict::again);
  StagnationTest unknown(0.0, infinity);
  CHECK(unknown.judge(1e-14, 1e-14) == Verdict::again);
  CHECK(unknown.judge(1e-22, 1e-22) == Verdict::done);

  // A loose answer is what Newton's iteration with a new matrix leaves of its first correction, about its square.
  CHECK(StagnationTest(1e-6, infinity).judge(0.9e-3, 0.9e-3) == Verdict::done);
  CHECK(StagnationTest(1e-6, infinity).judge(1.1e-3, 1.1e-3) == Verdict::again);
  CHECK(StagnationTest(1e-6).judge(0.9e-3, 0.9e-3) == Verdict::again);  // not of every iteration
  CHECK(StagnationTest(0.0, infinity).judge(0.9e-3, 0.9e-3) == Verdict::again);
}
