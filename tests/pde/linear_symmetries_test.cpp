// All linear symmetries of an equation: a null space, compared with what is known of the equation.

#include <catch2/catch.hpp>

#include <cmath>
#include <string>
#include <tuple>
#include <vector>

#include <rubato/pde/linear_symmetries.hpp>
#include <rubato/pde/local_laws.hpp>

using namespace rubato;
using Eigen::MatrixXd;

namespace {

/// M or K from entries above the diagonal.
MatrixXd skew(Eigen::Index size, const std::vector<std::tuple<int, int, double>>& entries) {
  MatrixXd result = MatrixXd::Zero(size, size);
  for (const auto& [row, column, value] : entries) {
    result(row, column) = value;
    result(column, row) = -value;
  }
  return result;
}

/// i ψ_t + ψ_xx + |ψ|² ψ = 0 and S with `more` added.
MultisymplecticSystem schroedinger(const std::string& more = "") {
  return MultisymplecticSystem({"p", "q", "v", "w"}, skew(4, {{0, 1, 1.0}}), {skew(4, {{0, 2, -1.0}, {1, 3, -1.0}})},
                               "(v^2 + w^2)/2 + (p^2 + q^2)^2/4" + more);
}

}  // namespace

TEST_CASE("the phase of Schroedinger's equation is its one linear symmetry") {
  const MultisymplecticSystem system = schroedinger();
  const LinearSymmetries all(system);
  const auto basis = all.beside({});
  REQUIRE(basis.size() == 1);
  const auto phase = all.phase(0, 1);
  REQUIRE(phase);
  MatrixXd expected = MatrixXd::Zero(4, 4);
  expected(0, 1) = expected(2, 3) = -1.0;
  expected(1, 0) = expected(3, 2) = 1.0;
  CHECK(*phase == expected);
  CHECK_NOTHROW(check_symmetry(system, {"phase", *phase}));
  CHECK(all.beside({2.0 * expected}).empty());
  CHECK_FALSE(LinearSymmetries::is_beside(*phase, {-3.0 * expected}));
  CHECK(LinearSymmetries::is_beside(*phase, {MatrixXd::Identity(4, 4)}));
  CHECK_FALSE(all.phase(0, 2));
}

TEST_CASE("a term that a symmetry changes takes it away") {
  const LinearSymmetries all(schroedinger(" + p^2/1000"));
  CHECK(all.beside({}).empty());
  CHECK_FALSE(all.phase(0, 1));
}

TEST_CASE("a real wave has no linear symmetry, two equal ones turn into each other") {
  const MultisymplecticSystem one({"u", "v", "w"}, skew(3, {{0, 1, -1.0}}), {skew(3, {{0, 2, 1.0}})},
                                  "(v^2 - w^2)/2 + 1 - cos(u)");
  CHECK(LinearSymmetries(one).beside({}).empty());
  const auto two = [](const char* potential) {
    return MultisymplecticSystem({"u", "v", "w", "a", "b", "c"}, skew(6, {{0, 1, -1.0}, {3, 4, -1.0}}),
                                 {skew(6, {{0, 2, 1.0}, {3, 5, 1.0}})},
                                 std::string("(v^2 - w^2 + b^2 - c^2)/2 + ") + potential);
  };
  const auto turns = LinearSymmetries(two("(u^2 + a^2)^2")).beside({});
  REQUIRE(turns.size() == 1);
  CHECK(std::abs(turns[0](0, 3)) == 1.0);
  CHECK(turns[0](0, 3) == -turns[0](3, 0));
  CHECK(LinearSymmetries(two("(u^2 + 2*a^2)^2")).beside({}).empty());
}

TEST_CASE("symmetries are those of all terms, in whatever units, and of no less") {
  // Kepler's problem in metres, kilograms and seconds: at z of size 1 potential energies are 1e70 times kinetic ones.
  const auto kepler = [](const char* kinetic) {
    return MultisymplecticSystem({"x", "y", "u", "v"}, skew(4, {{0, 2, -1.0}, {1, 3, -1.0}}), {MatrixXd::Zero(4, 4)},
                                 std::string(kinetic) + "/(2*5.97e24) - 7.925e44/sqrt(x^2 + y^2)");
  };
  const auto turns = LinearSymmetries(kepler("(u^2 + v^2)")).beside({});
  REQUIRE(turns.size() == 1);
  MatrixXd expected = MatrixXd::Zero(4, 4);
  expected(0, 1) = expected(2, 3) = 1.0;
  expected(1, 0) = expected(3, 2) = -1.0;
  CHECK((turns[0] - expected).cwiseAbs().maxCoeff() < 1e-9);
  CHECK(LinearSymmetries(kepler("(u^2 + 1.001*v^2)")).beside({}).empty());

  // Two waves whose fields have units of their own.
  const auto waves = [](const char* potential) {
    return MultisymplecticSystem({"u", "v", "w", "a", "b", "c"}, skew(6, {{0, 1, -1.0}, {3, 4, -1.0}}),
                                 {skew(6, {{0, 2, 1.0}, {3, 5, 1.0}})},
                                 std::string("1e-24*(v^2 + b^2)/2 - 1e20*(w^2 + c^2)/2 + ") + potential);
  };
  const auto both = LinearSymmetries(waves("1e9*(u^2 + a^2)^2")).beside({});
  REQUIRE(both.size() == 1);
  CHECK(std::abs(both[0](0, 3)) == 1.0);
  CHECK(both[0](0, 3) == -both[0](3, 0));
  CHECK(LinearSymmetries(waves("1e9*(u^2 + 1.001*a^2)^2")).beside({}).empty());

  // The Korteweg-de Vries equation in lengths of 2^-30: its potential is not in S, and units of it are those of K.
  const MultisymplecticSystem kdv({"phi", "u", "v", "w"}, skew(4, {{0, 1, -0.5}}),
                                  {skew(4, {{0, 3, 1.0}, {1, 2, -0x1p90}})}, "u*w - u^3 - 2^90*v^2/2");
  CHECK(LinearSymmetries(kdv).beside({}).empty());
}
