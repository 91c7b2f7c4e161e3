#include <cmath>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

#include <omp.h>

#include <catch2/catch.hpp>

#include <rubato/pde/lattice.hpp>

#include "equations.hpp"

// Results do not depend on the number of threads, bit by bit.

using namespace rubato;
using namespace rubato::tests;

namespace {

/// Sets OpenMP's number of threads for as long as it lives.
class Threads {
public:
  explicit Threads(int count) : before_(omp_get_max_threads()) { omp_set_num_threads(count); }
  Threads(const Threads&) = delete;
  Threads& operator=(const Threads&) = delete;
  ~Threads() { omp_set_num_threads(before_); }

private:
  int before_;
};

struct Case {
  std::string name;
  MultisymplecticSystem system;
  grids::Grid grid;
  LatticeOptions options;
};

std::vector<Case> cases() {
  // Long enough that every loop and solver is shared out: blocks of cells, of sums, and chunks of the elimination.
  const grids::Grid line({{"x", -20, 20, 20001}});
  const grids::Grid short_line({{"x", -20, 20, 2187}});
  const grids::Grid plane({{"x", -7, 7, 45}, {"y", -7, 7, 35}});
  const LatticeOptions box{.step = 0.02, .until = 0.04, .tolerance = 1e-12};
  LatticeOptions fourier = box;
  fourier.lagrangian = "fourier";
  fourier.levels = Levels::fixed;  // one solve a step: levels are chosen by the same code for all
  LatticeOptions box_in_plane = box;
  box_in_plane.levels = Levels::fixed;
  LatticeOptions euler_box = box;
  euler_box.lagrangian = "euler-box";
  euler_box.levels = Levels::fixed;
  euler_box.step = 0.0005;
  euler_box.until = 0.0015;
  LatticeOptions leapfrog = euler_box;
  leapfrog.lagrangian = "leapfrog";
  return {{"box", sine_gordon(), line, box},
          {"Fourier", sine_gordon(), short_line, fourier},
          {"euler-box", sine_gordon(), line, euler_box},
          {"leapfrog", sine_gordon(), line, leapfrog},
          {"box in the plane", wave_equation_2d("1 - cos(u)"), plane, box_in_plane},
          {"Fourier in the plane", wave_equation_2d("1 - cos(u)"), plane, fourier}};
}

/// All that a run gives, as numbers in one row; `nudge` moves one initial value.
std::vector<double> results(const Case& run, int count, double nudge = 0.0) {
  const Threads threads(count);
  std::vector<double> u(run.grid.size());
  std::vector<double> v(run.grid.size());
  for (std::size_t i = 0; i < u.size(); ++i) {
    const auto place = run.grid.place(i);
    double square = 0.0;
    for (int a = 0; a < run.grid.dimensions(); ++a) {
      square += std::pow(run.grid.axis(a).node(place[static_cast<std::size_t>(a)]), 2);
    }
    u[i] = std::exp(-square);
    v[i] = -2 * std::exp(-square / 2);
  }
  u[u.size() / 2] += nudge;
  InitialFields initial{u, v};
  initial.resize(run.system.fields().size());
  LatticeIntegrator lattice(run.system, run.grid, initial, run.options);
  std::vector<double> all;
  while (!lattice.finished()) {
    const StepReport report = lattice.step();
    REQUIRE(report.status == Status::success);
    all.insert(all.end(), {report.h, report.energy});
    for (const Spread& size : lattice.residuals()) {
      all.insert(all.end(), {size.largest(), size.rms()});
    }
    const std::vector<double> totals = lattice.totals();
    all.insert(all.end(), totals.begin(), totals.end());
  }
  const auto fields = std::as_const(lattice.level().fields).all();
  all.insert(all.end(), fields.begin(), fields.end());
  return all;
}

bool same_bits(const std::vector<double>& a, const std::vector<double>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(double)) == 0;
}

}  // namespace

TEST_CASE("one thread and two give the same lattice, bit by bit") {
  for (const Case& run : cases()) {
    INFO(run.name);
    const std::vector<double> one = results(run, 1);
    CHECK(same_bits(one, results(run, 2)));
  }
  // The comparison sees the last bits of a single initial value.
  CHECK_FALSE(same_bits(results(cases().front(), 2), results(cases().front(), 2, 1e-15)));
}
