// What formulas of a slab have of one level alone is kept from slab to slab, and changes nothing of what they give.

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/variation/level_values.hpp>

using namespace rubato;
using formula::Expression;
using grids::FieldSet;

namespace {

/// Two fields at two levels, and a coordinate: u, v, then u, v of the upper level, then x; others after them.
constexpr LevelValues::Arrays arrays{.of_level = 2, .steady = 1, .kept = 5};
constexpr std::array<int, 3> next{1, 0, 0}, previous{-1, 0, 0};

struct Formulas {
  explicit Formulas(const grids::Grid& grid) : nodes(grid) {
    const Expression u = nodes.node(0), v = nodes.node(1), after = nodes.node(2), x = nodes.node(4);
    const Expression u_next = nodes.node(0, next), after_before = nodes.node(2, previous);
    const Expression h = nodes.uniform(0);
    density = pow(after, 2.0) * nodes.node(3) + cos(after);
    outputs = {
        h * (density - (pow(u, 2.0) * v + cos(u))),  // the density of both levels
        cos(u_next) * after + cos(after_before),     // a part of it, elsewhere
        sin(u) + v,                                  // of the lower level alone
        cos(0.5 * (u + after)) + sin(x * u) - sin(nodes.node(4, next) * nodes.node(2, next)),
    };
  }
  NodeFormulas nodes;
  Expression density;
  std::vector<Expression> outputs;
};

FieldSet waves(std::size_t nodes, double phase) {
  FieldSet fields(2, nodes);
  for (std::size_t i = 0; i < nodes; ++i) {
    const double angle = 0.37 * static_cast<double>(i) + phase;
    fields.field(0)[i] = 1.3 * std::sin(angle);
    fields.field(1)[i] = std::cos(1.7 * angle);
  }
  return fields;
}

}  // namespace

TEST_CASE("values of levels that are kept change nothing of what formulas of slabs give") {
  // More than one piece of NodeCode; and a plane.
  for (const grids::Grid& grid : {grids::Grid({{"x", 0, 1, 517}}), grids::Grid({{"x", 0, 1, 7}, {"y", 0, 1, 5}})}) {
    const std::size_t nodes = grid.size();
    FieldSet x(1, nodes);
    for (std::size_t i = 0; i < nodes; ++i) {
      x.field(0)[i] = static_cast<double>(grid.place(i)[0]) / static_cast<double>(grid.cells(0));
    }
    const FieldSet levels[] = {waves(nodes, 0.0), waves(nodes, 0.4), waves(nodes, 0.9)};
    const PotentialSlopes slopes;
    const std::array numbers{0.25};

    Formulas plain(grid), kept(grid);
    NodeCode whole = plain.nodes.code(plain.outputs);
    LevelValues values(kept.nodes, arrays, std::array{kept.density}, {&kept.outputs});
    NodeCode code = kept.nodes.code(kept.outputs);
    // The density; cos u, which is a part of it, too; sin x u. Not sin u, of one level only, nor cos of both.
    REQUIRE(values.upper().fields() == 3);
    CHECK(formula::variables_of(kept.outputs[2]) == formula::variables_of(Formulas(grid).outputs[2]));

    const auto read_level = [&](NodeCode& of_level, const FieldSet& level) {
      of_level.read({&level, &level, &x}, {}, slopes);
    };
    const auto outputs_of = [&](std::size_t k) {
      FieldSet out(static_cast<int>(kept.outputs.size()), nodes);
      code.read({&levels[k], &levels[k + 1], &x, &values.lower(), &values.upper()}, numbers, slopes);
      code(out.pointers());
      return out;
    };
    const auto expected_of = [&](std::size_t k) {
      FieldSet out(static_cast<int>(plain.outputs.size()), nodes);
      whole.read({&levels[k], &levels[k + 1], &x}, numbers, slopes);
      whole(out.pointers());
      return out;
    };
    values.take(levels[0], levels[1], false, read_level);
    CHECK(std::ranges::equal(outputs_of(0).all(), expected_of(0).all()));
    values.take(levels[1], levels[2], true, read_level);
    CHECK(std::ranges::equal(outputs_of(1).all(), expected_of(1).all()));
    const FieldSet density = values.upper();
    for (std::size_t i = 0; i < nodes; ++i) {
      const double u = levels[2].field(0)[i], v = levels[2].field(1)[i];
      // A product and a sum of terms below 2 and 1, and two units of the cosine.
      CHECK(std::abs(density.field(0)[i] - (u * u * v + std::cos(u))) < 4e-15);
    }
    // A level alone.
    values.take(levels[2], read_level);
    CHECK(std::ranges::equal(values.upper().all(), density.all()));
    // The twin: a slab that does not follow, said to.
    values.take(levels[0], levels[1], true, read_level);
    CHECK_FALSE(std::ranges::equal(outputs_of(0).all(), expected_of(0).all()));
    values.take(levels[0], levels[1], false, read_level);
    CHECK(std::ranges::equal(outputs_of(0).all(), expected_of(0).all()));
  }
}

TEST_CASE("formulas that have nothing of one level alone keep nothing") {
  const grids::Grid grid({{"x", 0, 1, 9}});
  NodeFormulas nodes(grid);
  std::vector<Expression> outputs = {nodes.node(2) - nodes.node(0), cos(nodes.node(0) * nodes.uniform(0)),
                                     cos(nodes.node(5)) - cos(nodes.node(6)), nodes.graph().constant(0.0)};
  const std::vector<Expression> before = outputs;
  const LevelValues values(nodes, arrays, {}, {&outputs});
  CHECK(values.upper().fields() == 0);
  CHECK(outputs == before);
}
