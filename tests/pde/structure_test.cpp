#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

#include <fmt/format.h>

#include <rubato/grids/reductions.hpp>
#include <rubato/pde/field_system.hpp>
#include <rubato/pde/lattice.hpp>

#include "equations.hpp"

using namespace rubato;
using namespace rubato::tests;

namespace {

std::vector<std::string> names(const MultisymplecticSystem& system, const std::vector<bool>& which) {
  std::vector<std::string> result;
  for (std::size_t f = 0; f < which.size(); ++f) {
    if (which[f]) {
      result.push_back(system.fields()[f]);
    }
  }
  return result;
}

using Names = std::vector<std::string>;

}  // namespace

TEST_CASE("the structure of an equation follows from M, K and S") {
  struct Expected {
    MultisymplecticSystem system;
    Names algebraic, multipliers, nonlinear, potentials;
  };
  const Expected expected[] = {
      {sine_gordon(), {"w"}, {}, {}, {}},
      {schroedinger(2), {"v", "w"}, {}, {}, {}},
      {korteweg_de_vries(6, 1), {"v", "w"}, {"w"}, {}, {"phi"}},
      {benjamin_bona_mahony(1, 1, 1), {"w", "p"}, {"w", "p"}, {}, {"phi"}},
      {camassa_holm(1), {"w", "v"}, {"w", "v"}, {}, {"phi"}},
      {good_boussinesq(), {"u", "w", "p"}, {}, {"p"}, {"phi"}},
      {dirac(1, 1), {}, {}, {}, {}},
      {zakharov_kuznetsov(), {"v", "w", "p"}, {"p"}, {}, {"phi"}},
  };
  for (const auto& [system, algebraic, multipliers, nonlinear, potentials] : expected) {
    INFO(system.fields()[0] << " of " << system.field_count() << " fields");
    const FieldStructure& structure = system.structure();
    CHECK(names(system, structure.algebraic) == algebraic);
    CHECK(names(system, structure.multiplier) == multipliers);
    CHECK(names(system, structure.nonlinear) == nonlinear);
    CHECK(names(system, structure.potential) == potentials);
    CHECK((structure.M_plus - structure.M_plus.transpose() - system.M()).isZero(0.0));
    for (int a = 0; a < system.directions(); ++a) {
      const auto& plus = structure.K_plus[static_cast<std::size_t>(a)];
      CHECK((plus - plus.transpose() - system.K(a)).isZero(0.0));
      for (int f = 0; f < system.field_count(); ++f) {  // no bare potential, no differentiated multiplier
        CHECK((!structure.potential[static_cast<std::size_t>(f)] || plus.col(f).isZero(0.0)));
        CHECK((!structure.multiplier[static_cast<std::size_t>(f)] || plus.row(f).isZero(0.0)));
      }
    }
  }
}

TEST_CASE("the splitting of KdV is the one that gives its known densities") {
  const auto system = korteweg_de_vries(6, 0.5);
  const FieldStructure& structure = system.structure();
  // Energy S + φ_x w - γ u_x v with φ_x = u: η u³/6 + ½v² - γ u_x v; momentum -½ φ_x u.
  CHECK(structure.K_plus[0](system.field("phi"), system.field("w")) == 1.0);
  CHECK(structure.K_plus[0](system.field("u"), system.field("v")) == -0.5);
  CHECK(structure.M_plus(system.field("phi"), system.field("u")) == 0.5);
  // b = e_φ is the only constant null vector of ∇S.
  REQUIRE(structure.affine_symmetries.cols() == 1);
  CHECK((structure.affine_symmetries.col(0) - Eigen::VectorXd::Unit(4, 0)).isZero(1e-12));
}

TEST_CASE("differences stand on the same sides whatever the order of the fields") {
  const std::vector<std::vector<std::string>> orders = {{"H1", "H2", "H3", "E1", "E2", "E3"},
                                                        {"E3", "H1", "H2", "H3", "E1", "E2"},
                                                        {"H1", "H2", "E3", "H3", "E1", "E2"},
                                                        {"H2", "E1", "H3", "E3", "E2", "H1"}};
  for (const std::vector<std::string>& fields : orders) {
    INFO(fields[0] << ", " << fields[1] << ", ...");
    const auto system = make_system(fields, {{"H1", "E1", -1}, {"H2", "E2", -1}, {"H3", "E3", -1}},
                                    {{{"H3", "H2", 1}, {"E3", "E2", 1}}, {{"H1", "H3", 1}, {"E1", "E3", 1}}}, "0");
    const auto has_row = [&](int axis, const char* row, const char* column) {
      return system.structure().K_plus[static_cast<std::size_t>(axis)](system.field(row), system.field(column)) != 0.0;
    };
    CHECK(has_row(0, "H3", "H2") == has_row(0, "E3", "E2"));
    CHECK(has_row(1, "H1", "H3") == has_row(1, "E1", "E3"));
    // A standing wave of E3 stays what it is; with rows on different sides it grows by e in a time of the cell.
    const grids::Grid grid({{"x", 0.0, 3.0, 25}, {"y", 0.0, 2.0, 17}});
    InitialFields initial(fields.size(), std::vector<double>(grid.size(), 0.0));
    std::vector<double>& E3 = *initial[static_cast<std::size_t>(system.field("E3"))];
    for (std::size_t node = 0; node < E3.size(); ++node) {
      const auto at = grid.place(node);
      E3[node] = std::cos(2.0 * std::numbers::pi * grid.axis(0).node(at[0]) / 3.0) *
                 std::cos(std::numbers::pi * grid.axis(1).node(at[1]));
    }
    LatticeIntegrator lattice(system, grid, initial,
                              {.lagrangian = "splitting",
                               .composition = "blanes-moan-4",
                               .space = "differences",
                               .step = 0.02,
                               .until = 2.0,
                               .levels = Levels::fixed});
    for (int k = 0; k < 100; ++k) {
      REQUIRE(lattice.step().status == Status::success);
    }
    CHECK(grids::max_abs(lattice.level().fields.field(system.field("E3"))) < 1.01);
  }
}

TEST_CASE("a constant null vector of the gradient need not be a field's unit vector") {
  // S depends on a - b alone.
  const auto system = make_system({"a", "b", "v", "w"}, {{"a", "v", -1}, {"b", "w", -1}}, {{{"a", "b", 1}}},
                                  "cos(a - b) + (v^2 + w^2)/2");
  REQUIRE(system.structure().affine_symmetries.cols() == 1);
  const Eigen::VectorXd b = system.structure().affine_symmetries.col(0);
  CHECK(b[0] == Approx(b[1]));
  CHECK(b.tail(2).norm() < 1e-12);
  CHECK(names(system, system.structure().potential).empty());
}

TEST_CASE("bad systems are refused with the reason") {
  using Catch::Matchers::Contains;
  const Eigen::MatrixXd zero = Eigen::MatrixXd::Zero(2, 2);
  Eigen::MatrixXd skew = zero;
  skew(0, 1) = 1.0;
  skew(1, 0) = -1.0;
  Eigen::MatrixXd symmetric = zero;
  symmetric(0, 1) = symmetric(1, 0) = 3.0;
  const auto make = [](const std::vector<std::string>& fields, const Eigen::MatrixXd& M, const Eigen::MatrixXd& K,
                       const std::string& S) { return MultisymplecticSystem(fields, M, {K}, S); };
  CHECK_NOTHROW(make({"a", "b"}, skew, zero, "a^2 + b^2"));
  CHECK_THROWS_WITH(make({"a", "b"}, symmetric, zero, "a^2"), Contains("M is not skew-symmetric: [a, b] is 3"));
  CHECK_THROWS_WITH(make({"a", "b"}, skew, symmetric, "a^2"), Contains("K.x is not skew-symmetric"));
  CHECK_THROWS_WITH(make({"a", "a"}, skew, zero, "a^2"), Contains("\"a\" is named twice"));
  CHECK_THROWS_WITH(make({"a", "b"}, skew, zero, "a^2 + c"), Contains("c"));
  CHECK_THROWS_WITH(make({"a", "b", "c"}, skew, zero, "a^2"), Contains("2 by 2"));
  // c has neither M nor K; what determines it is S, if it does.
  const auto with_c = [](const std::string& S) {
    return make_system({"a", "b", "c"}, {{"a", "b", 1}}, {{{"a", "b", 1}}}, S);
  };
  CHECK_NOTHROW(with_c("a^2 + c^2"));
  CHECK_THROWS_WITH(with_c("a^2 + b^2"), Contains("the field c is not determined"));
}

TEST_CASE("the units of fields and equations do not matter") {
  // u_tt = c² u_xx - V'(u) as v = u_t, w = c² u_x: -v_t + w_x = V'(u), u_t = v, -u_x = -w/c². In other units M, K and S
  // are multiplied by anything.
  const auto wave = [](double row, double field, double c) {
    Eigen::MatrixXd M = Eigen::MatrixXd::Zero(3, 3);
    Eigen::MatrixXd K = M;
    M(0, 1) = -row * field;
    M(1, 0) = row * field;
    K(0, 2) = row * c;
    K(2, 0) = -row * c;
    return MultisymplecticSystem(
        {"u", "v", "w"}, M, {K},
        fmt::format("{:.17g}*((v*{:.17g})^2 - w^2)/2 + {:.17g}*(1 - cos(u))", row, field, row));
  };
  const MultisymplecticSystem natural = wave(1.0, 1.0, 1.0);
  const FieldStructure& plain = natural.structure();
  for (const double row : {1e-12, 1.0, 1e12}) {
    for (const double field : {1e-6, 1.0, 1e6}) {
      for (const double c : {1e-5, 1.0, 3e8}) {
        INFO("row " << row << ", field " << field << ", c " << c);
        const MultisymplecticSystem system = wave(row, field, c);
        CHECK(system.structure().algebraic == plain.algebraic);
        CHECK(system.structure().multiplier == plain.multiplier);
        CHECK(system.structure().nonlinear == plain.nonlinear);
        CHECK(system.structure().potential == plain.potential);
        CHECK(system.structure().kernel == plain.kernel);
      }
    }
  }
  // A potential that grows by powers of ten beside linear terms of order one.
  CHECK_NOTHROW(make_system({"u", "v", "w"}, {{"u", "v", -1}}, {{{"u", "w", 1}}}, "(v^2 - w^2)/2 + exp(30*u)/900"));
  // The twins: what is not determined is refused in all units.
  for (const double c : {1.0, 1e5, 1e10}) {
    CHECK_THROWS_WITH(
        make_system({"a", "b", "w"}, {{"a", "b", c}}, {{{"a", "b", 1}}}, fmt::format("a^2 + {:.17g}*b^2", c)),
        Catch::Contains("the field w is not determined"));
  }
}

TEST_CASE("a potential that is free across x is refused where derivatives by y and t see it") {
  const auto of = [](const std::string& equation, int dimensions = 2) {
    return equation_system({"u"}, {equation}, {}, dimensions);
  };
  CHECK_THROWS_WITH(of("u_t + u_x + u*u_x - u_xxt - u_yyt = 0"),
                    Catch::Contains("functions of y and t alone, the equations leave potential_u") &&
                        Catch::Contains("leave it out"));
  CHECK_THROWS_WITH(of("u_t + u*u_x - u_zzt = 0", 3), Catch::Contains("functions of z and t alone"));
  // The twins: along x alone, by y alone, and potentials that no derivative by y sees, in a frame that moves, too.
  CHECK_NOTHROW(of("u_t + u_x + u*u_x - u_xxt = 0"));
  CHECK_NOTHROW(of("u_xt + 6*u_x^2 + 6*u*u_xx + u_xxxx + 3*u_yy = 0"));
  CHECK_NOTHROW(of("u_tt - u_xxtt - u_yytt = u_xx + u_yy"));
  const MultisymplecticSystem zk = of("u_t + u*u_x + u_xxx + u_xyy = 0");
  CHECK_NOTHROW(
      MultisymplecticSystem(zk.graph(), zk.fields(), zk.M(), {zk.K(0), zk.K(1) - 0.7 * zk.M()}, zk.expression()));
}
