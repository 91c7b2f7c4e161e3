// Codes that follow each other through the lattice give what they give one after the other.

#include <array>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/grids/reductions.hpp>
#include <rubato/variation/node_pass.hpp>

using namespace rubato;
using formula::Expression;
using grids::FieldSet;

namespace {

FieldSet waves(std::size_t nodes) {
  FieldSet fields(1, nodes);
  for (std::size_t i = 0; i < nodes; ++i) {
    fields.field(0)[i] = std::sin(0.37 * static_cast<double>(i)) + 1e-3 * static_cast<double>(i % 17);
  }
  return fields;
}

/// Array 0 gives array 1 by neighbours, this array 2, and both two sums.
struct Codes {
  explicit Codes(const grids::Grid& grid, int far) : formulas(grid) {
    const auto neighbours = [&](int array) {
      Expression sum = formulas.node(array);
      for (int axis = 0; axis < grid.dimensions(); ++axis) {
        std::array<int, 3> there{};
        there[static_cast<std::size_t>(axis)] = axis == 0 ? far : 1;
        sum += 0.3 * formulas.node(array, there) - 0.2 * formulas.node(array, shifted({}, there, -1));
      }
      return sum;
    };
    first = {neighbours(0)};
    second = {neighbours(1), formulas.node(1) * neighbours(1), neighbours(0)};
  }
  NodeFormulas formulas;
  std::vector<Expression> first, second;
};

}  // namespace

TEST_CASE("a pass gives what its codes give one after the other") {
  // Less than a block; some blocks; lines, planes and their seams, and neighbours further than a block.
  const std::pair<grids::Grid, int> cases[] = {{grids::Grid({{"x", 0, 1, 517}}), 1},
                                               {grids::Grid({{"x", 0, 1, 100'003}}), 1},
                                               {grids::Grid({{"x", 0, 1, 200'001}}), 5'000},
                                               {grids::Grid({{"x", 0, 1, 301}, {"y", 0, 1, 403}}), 2},
                                               {grids::Grid({{"x", 0, 1, 31}, {"y", 0, 1, 33}, {"z", 0, 1, 151}}), 3}};
  int found_out = 0;
  for (const auto& [grid, far] : cases) {
    const std::size_t nodes = grid.size();
    INFO(nodes << " nodes");
    const FieldSet u = waves(nodes);
    FieldSet a(1, nodes), b(3, nodes);
    const PotentialSlopes slopes;
    Codes codes(grid, far);
    NodeCode first = codes.formulas.code(codes.first), second = codes.formulas.code(codes.second);
    const std::vector<double*> into_a(a.pointers().begin(), a.pointers().end());
    first.read({&u}, {}, slopes);
    first(into_a);
    second.read({&u, &a}, {}, slopes);
    second(b.pointers());

    for (const bool is_twin : {false, true}) {
      FieldSet found_a(1, nodes), found_b(1, nodes);
      NodePass pass(grid);
      pass.add(codes.formulas.code(codes.first), {is_twin ? 7 : 1});  // the twin: nobody waits for it
      pass.add(codes.formulas.code(codes.second), {2});
      pass.code(0).read({&u}, {}, slopes);
      pass.code(1).read({&u, &found_a}, {}, slopes);
      pass.write(0, found_a, std::array{0});
      pass.write(1, found_b, std::array{0});
      pass(0);
      const bool same = std::ranges::equal(std::as_const(found_a).field(0), std::as_const(a).field(0)) &&
                        std::ranges::equal(std::as_const(found_b).field(0), std::as_const(b).field(0));
      if (is_twin) {
        found_out += same ? 0 : 1;
        continue;
      }
      CHECK(same);
      REQUIRE(pass.sums().size() == 2);
      for (int k = 0; k < 2; ++k) {
        // Both are compensated: a rounding of each.
        const double expected = grids::sum(std::as_const(b).field(1 + k));
        CHECK(std::abs(pass.sums()[static_cast<std::size_t>(k)] - expected) <= 4e-16 * std::abs(expected));
      }
      // The second code alone.
      const std::vector<double> before(pass.sums().begin(), pass.sums().end());
      found_a.field(0)[nodes / 2] += 1.0;
      pass(1);
      CHECK(pass.sums()[0] != before[0]);
      CHECK(pass.sums()[1] == before[1]);
      CHECK_FALSE(std::ranges::equal(std::as_const(found_b).field(0), std::as_const(b).field(0)));
    }
  }
  CHECK(found_out >= 3);
}
