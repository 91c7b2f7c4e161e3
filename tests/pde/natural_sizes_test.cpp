// Natural sizes of fields, and energies that are rounding errors alone.

#include <catch2/catch.hpp>

#include <array>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include <rubato/pde/natural_sizes.hpp>
#include <rubato/pde/row_rounding.hpp>

#include "equations.hpp"

using namespace rubato;
using namespace rubato::tests;

TEST_CASE("in natural sizes the largest weight of each field is 1, whatever the units") {
  Eigen::MatrixXd weights(3, 3);
  weights << 4.0, 0.5, 0.0, 0.5, 0.0, 3.0, 0.0, 3.0, 1e-4;
  const auto largest_of_rows = [](const Eigen::MatrixXd& W, const std::vector<double>& D) {
    const Eigen::VectorXd sizes = Eigen::Map<const Eigen::VectorXd>(D.data(), static_cast<Eigen::Index>(D.size()));
    const Eigen::MatrixXd scaled = sizes.asDiagonal() * W * sizes.asDiagonal();
    return std::array{scaled.row(0).maxCoeff(), scaled.row(1).maxCoeff(), scaled.row(2).maxCoeff()};
  };
  const std::vector<double> sizes = natural_sizes(weights);
  for (const double largest : largest_of_rows(weights, sizes)) {
    CHECK(largest == Approx(1.0).epsilon(1e-9));
  }
  // The second field in a unit 1e8 times as large: its numbers are as many times smaller, and so is its size.
  const Eigen::Vector3d unit(1.0, 1e8, 1.0);
  const std::vector<double> other = natural_sizes(unit.asDiagonal() * weights * unit.asDiagonal());
  CHECK(largest_of_rows(unit.asDiagonal() * weights * unit.asDiagonal(), other)[1] == Approx(1.0).epsilon(1e-9));
  const std::array z = {0.1, 20.0, -0.3}, z_other = {0.1, 20e-8, -0.3};
  CHECK(largest_in(other, z_other) / largest_in(sizes, z) == Approx(1.0).epsilon(1e-6));
  // A weight that is nothing beside the others, as exp(u) far below 0, does not stretch sizes apart.
  for (const double nothing : {0.0, 1e-20, 1e-217}) {
    weights << nothing, 0.0, 0.2, 0.0, 1.0, 0.0, 0.2, 0.0, 1.0;
    const std::vector<double> D = natural_sizes(weights);
    CHECK(D[0] == Approx(5.0).epsilon(1e-6));
    CHECK(D[2] == Approx(1.0).epsilon(1e-6));
  }
  // A field that nothing is coupled with keeps its numbers.
  CHECK(natural_sizes(Eigen::MatrixXd::Zero(2, 2)) == std::vector{1.0, 1.0});
}

TEST_CASE("the floor of an energy is raised where all its terms are products with rounding errors") {
  const grids::Grid line({{"x", 0, 2.0 * std::numbers::pi, 45}});
  const MultisymplecticSystem system = sine_gordon();  // fields u, v, w
  const auto rounding_of = [&](double size, double magnitudes) {
    grids::FieldSet fields(3, line.size());
    for (std::size_t i = 0; i < line.size(); ++i) {
      fields.field(0)[i] = size * std::sin(line.spacing(0) * static_cast<double>(i));
    }
    formula::SumSize found{.rounding = 0.0, .magnitudes = magnitudes};
    EnergyFloor(system, line).raise(found, std::as_const(fields).pointers());
    return found.rounding;
  };
  // S'' = 1 at u = 0, so that the energy that a wave of u = sin x could have is 2π/2.
  CHECK(rounding_of(1.0, 1e-13) > 0.0);
  CHECK(rounding_of(1.0, 1e-13) < 1e-8);
  CHECK(rounding_of(1.0, 1e-6) == 0.0);    // the twin: terms that are small, but no rounding errors
  CHECK(rounding_of(1e-6, 1e-13) == 0.0);  // and those of a small wave
}

TEST_CASE("the floor of an energy reads S'' on the side on which the field is") {
  const grids::Grid line({{"x", 0, 2.0 * std::numbers::pi, 45}});
  const MultisymplecticSystem system =
      make_system({"u", "v", "w"}, {{"u", "v", -1}}, {{{"u", "w", 1}}}, "(v^2 - w^2)/2 + exp(u)");
  const auto rounding_at = [&](double u) {
    grids::FieldSet fields(3, line.size());
    for (std::size_t i = 0; i < line.size(); ++i) {
      fields.field(0)[i] = u + 0.1 * std::sin(line.spacing(0) * static_cast<double>(i));
    }
    formula::SumSize found{.rounding = 0.0, .magnitudes = 1.0};
    EnergyFloor(system, line).raise(found, std::as_const(fields).pointers());
    return found.rounding;
  };
  CHECK(rounding_at(-110.0) == 0.0);
  CHECK(rounding_at(110.0) > 0.0);  // the twin: terms of 1 are nothing beside exp(110)
}

TEST_CASE("a field that is 0 gets the rounding errors of the others") {
  // Two polarisations that do not act on each other; only the first is there.
  Eigen::MatrixXd M = Eigen::MatrixXd::Zero(4, 4), K = Eigen::MatrixXd::Zero(4, 4);
  M(0, 2) = M(1, 3) = -1.0;
  M(2, 0) = M(3, 1) = 1.0;
  K(1, 0) = K(3, 2) = 1.0;
  K(0, 1) = K(2, 3) = -1.0;
  const MultisymplecticSystem system({"H2", "H3", "E2", "E3"}, M, {K}, [](const auto& z) { return 0.0 * z[0]; });
  const grids::Grid line({{"x", 0, 2.0 * std::numbers::pi, 45}});
  const RowRounding rounding(system, line);
  RowRounding::Values values;
  values.point = {0.0, 1.0, 1.0, 0.0};
  values.increment = {0.0, 0.1, 0.1, 0.0};
  const RowRounding::Sizes bounds = rounding(values, 10.0, grids::FieldSet(0, line.size()));
  for (std::size_t row = 0; row < 4; ++row) {
    CHECK(bounds[row] > 0.1);
  }
  // The twin: where all are small, all bounds are.
  values.point = {0.0, 1e-9, 1e-9, 0.0};
  values.increment = {0.0, 1e-10, 1e-10, 0.0};
  const RowRounding::Sizes small = rounding(values, 10.0, grids::FieldSet(0, line.size()));
  for (std::size_t row = 0; row < 4; ++row) {
    CHECK(small[row] < 1e-6);
  }
}
