// Every lattice of the catalogue: nothing doubtful about it, and `fourier` runs it on even and odd numbers of cells.

#include <cmath>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/problem/browse.hpp>
#include <rubato/problem/lattice_problem.hpp>
#include <rubato/problem/problem.hpp>

using namespace rubato;
using namespace rubato;

namespace {

std::vector<std::string> lattices() {
  std::vector<std::string> names;
  for (const CatalogueItem& item : list_catalogue()) {
    if (item.is_lattice) {
      names.push_back(item.name);
    }
  }
  return names;
}

}  // namespace

TEST_CASE("no lattice of the catalogue is called ill-posed, or its data not periodic") {
  REQUIRE(lattices().size() > 10);
  for (const std::string& name : lattices()) {
    INFO(name);
    CHECK(make_lattice(read_problem(name)).cautions() == std::vector<std::string>{});
  }
}

TEST_CASE("fourier runs every lattice of the catalogue on 64, 65, 125 and 128 cells with both kinds of levels") {
  for (const std::string& name : lattices()) {
    if (read_problem(name).multisymplectic()->has_drives()) {
      const std::vector<std::string> fourier = {"scheme.lagrangian=fourier"};
      CHECK_THROWS_WITH(make_lattice(read_problem(name, fourier)), Catch::Contains("leapfrog"));
      continue;
    }
    for (const int cells : {64, 65, 125, 128}) {
      for (const std::string levels : {"fixed", "variable"}) {
        INFO(name << ", " << cells << " cells, " << levels);
        std::vector<std::string> settings = {"scheme.lagrangian=fourier", "scheme.levels=" + levels,
                                             "grid.x.cells=" + std::to_string(cells)};
        const std::size_t directions = read_problem(name).multisymplectic()->axes.size();
        if (directions > 1 && cells > 65) {
          continue;  // planes and volumes cost more than all lines together
        }
        if (directions > 1) {
          settings.emplace_back(cells % 2 == 0 ? "grid.y.cells=9" : "grid.y.cells=8");
        }
        if (directions > 2) {
          settings.emplace_back("grid.z.cells=4");
        }
        LatticeIntegrator lattice = make_lattice(read_problem(name, settings));
        for (int step = 0; step < 3; ++step) {
          const StepReport report = lattice.step();
          REQUIRE(report.status == Status::success);
          if (levels == "variable" && !report.off_law) {
            CHECK(std::abs(report.energy - report.target) <= 1e-12 * lattice.levels().energy_scale());
          }
        }
      }
    }
  }
}
