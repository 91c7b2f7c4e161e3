// The ring on which the space between walls goes on in mirrors.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

#include <rubato/grids/lines.hpp>
#include <rubato/pde/mirrors.hpp>

#include "equations.hpp"
#include "mesh_cases.hpp"

using namespace rubato;
using namespace rubato::tests;
using grids::End;

namespace {

/// How far a line of the ring is from its own mirror about a wall at node `wall`, whose sign is `sign`. A field half a
/// cell after its node has its mirror image one place further back, one half a cell before it one further on.
double off_mirror(const std::vector<double>& line, std::size_t wall, int sign, int offset) {
  const std::size_t n = line.size();
  double off = 0.0;
  for (std::size_t j = 0; j < n; ++j) {
    const std::size_t image = (2 * (wall + n) - j - static_cast<std::size_t>(offset + 1) + 1) % n;
    const double expected = sign > 0 ? line[image] : (offset == 0 ? 2.0 * line[wall] : 0.0) - line[image];
    off = std::max(off, std::abs(line[j] - expected));
  }
  return off;
}

}  // namespace

TEST_CASE("a field goes on round the ring in the mirrors of its walls, line by line and as a whole") {
  const auto [left, right, below, above] =
      GENERATE(table<End, End, End, End>({{End::free, End::free, End::free, End::free},
                                          {End::fixed, End::free, End::fixed, End::fixed},
                                          {End::free, End::fixed, End::fixed, End::free},
                                          {End::fixed, End::fixed, End::periodic, End::periodic}}));
  const grids::Grid grid({{.name = "x", .to = 1.0, .cells = 7, .left = left, .right = right},
                          {.name = "y", .to = 1.0, .cells = 6, .left = below, .right = above}});
  const MultisymplecticSystem system = wave_equation_2d("u^2/2");
  for (const Collocation collocation : {Collocation::nodes, Collocation::corners}) {
    const Mirrors mirrors(system, grid, collocation);
    const grids::Grid& ring = mirrors.ring();
    grids::FieldSet between = random_fields(system.field_count(), grid.size(), 5);
    // About two walls that hold it a field closes on the ring if it has the same values at both.
    for (const auto& [field, node] : mirrors.held()) {
      between.field(field)[node] = 0.25;
    }
    for (int f = 0; f < system.field_count(); ++f) {
      std::vector<double> whole(ring.size());
      mirrors.extend(f, between.field(f), whole);
      std::vector<double> back(grid.size());
      mirrors.restrict(whole, back);
      for (int a = 0; a < 2; ++a) {
        const std::size_t n = ring.cells(a);
        std::vector<double> line(n), of_whole(n);
        double off_twin = 0.0;
        for (const grids::Line& at : grids::lines_along(ring, a)) {
          mirrors.read_line(f, between.field(f), a, at.first, Mirrors::Slope::kept, line);
          at.read(whole.data(), of_whole);
          for (std::size_t i = 0; i < n; ++i) {
            CHECK(line[i] == Approx(of_whole[i]).margin(1e-15));
          }
          if (grid.axis(a).has_walls()) {
            const std::size_t last = grid.cells(a) - 1;
            const int at_left = mirrors.sign(a, f, grid.axis(a).left),
                      at_right = mirrors.sign(a, f, grid.axis(a).right);
            CHECK(off_mirror(line, 0, at_left, mirrors.offset(a, f)) < 1e-14);
            CHECK(off_mirror(line, last, at_right, mirrors.offset(a, f)) < 1e-14);
            // The twin: the other kind of wall.
            off_twin = std::max(off_twin, off_mirror(line, last, -at_right, mirrors.offset(a, f)));
          }
        }
        CHECK((off_twin > 1e-3 || !grid.axis(a).has_walls()));
      }
    }
  }
}

TEST_CASE("a field that two walls hold at different values is without the straight line between them") {
  const grids::Grid grid({{.name = "x", .to = 1.0, .cells = 9, .left = End::fixed, .right = End::fixed},
                          {.name = "y", .to = 1.0, .cells = 5, .left = End::fixed, .right = End::fixed}});
  const MultisymplecticSystem system = wave_equation_2d("u^2/2");
  const Mirrors mirrors(system, grid, Collocation::nodes);
  std::vector<double> u(grid.size());
  for (std::size_t node = 0; node < u.size(); ++node) {
    const auto [i, j, k] = grid.place(node);
    u[node] = 1.0 + 2.0 * static_cast<double>(i) - 3.0 * static_cast<double>(j);
  }
  for (int a = 0; a < 2; ++a) {
    std::vector<double> line(mirrors.ring().cells(a));
    for (const grids::Line& at : grids::lines_along(mirrors.ring(), a)) {
      mirrors.read_line(0, u, a, at.first, Mirrors::Slope::left_out, line);
      for (const double value : line) {
        CHECK(value == Approx(1.0));
      }
      mirrors.read_line(0, u, a, at.first, Mirrors::Slope::kept, line);
      CHECK(std::abs(line[1] - line[0]) > 1.0);
    }
  }
}

TEST_CASE("a fixed wall holds the field that moves, wherever its slopes stand among the fields") {
  using Fields = std::vector<std::string>;
  for (const Fields& fields :
       {Fields{"u", "v", "a", "b"}, {"a", "b", "u", "v"}, {"b", "u", "v", "a"}, {"b", "v", "a", "u"}}) {
    INFO(fields[0] << ", " << fields[1] << ", ...");
    // S does not name u, of which a and b are derivatives.
    const MultisymplecticSystem system =
        make_system(fields, {{"u", "v", -1}}, {{{"u", "a", 1}}, {{"u", "b", 1}}}, "(v^2 - a^2 - b^2)/2");
    for (const int axis : {0, 1}) {
      const MirrorSigns signs(system, axis, "x");
      const auto sign = [&](const char* field, End end) { return signs.at(system.field(field), end); };
      CHECK(sign("u", End::fixed) == -1);
      CHECK(sign("u", End::free) == 1);
      CHECK(sign(axis == 0 ? "a" : "b", End::fixed) == 1);
      CHECK(sign(axis == 0 ? "b" : "a", End::fixed) == -1);
    }
  }
}
