// What the rules of levels are relative to: units, energies that vanish, steps that are exact, tolerances, Γ.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include <fmt/format.h>

#include <rubato/problem/problem.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/ensemble.hpp>
#include <rubato/run/run.hpp>

#include "defects.hpp"

using namespace rubato;
using rubato::defect_tests::defect_file;
using rubato::tests::Folder;

namespace {
struct Reported {
  Outcome outcome;
  ExitStatus checked;
  std::vector<double> t, energy, node_energy, gamma, off_law;

  [[nodiscard]] bool is_quiet() const {
    return outcome.status == ExitStatus::done && outcome.warnings.empty() && outcome.message.empty();
  }
  [[nodiscard]] std::size_t flagged() const { return static_cast<std::size_t>(std::ranges::count(off_law, 1.0)); }
  /// max |H(z_k) - E_0| over the larger of |E_0| and max |H(z_k)|, of E without f'.
  [[nodiscard]] double strayed() const {
    const double E = energy.front();
    double scale = std::abs(E), farthest = 0.0;
    for (const double H : node_energy) {
      scale = std::max(scale, std::abs(H));
      farthest = std::max(farthest, std::abs(H - E));
    }
    return farthest / scale;
  }
};

Reported run_of(const Problem& problem) {
  const Folder folder;
  Reported reported;
  reported.outcome = run(problem, {.output = (folder / "record.h5"), .threads = 1});
  reported.checked = check((folder / "record.h5")).status;
  const record::Reader reader((folder / "record.h5"));
  reported.t = reader.read("/levels/t");
  reported.energy = reader.read("/levels/energy");
  reported.node_energy = reader.read("/levels/node_energy");
  reported.gamma = reader.read("/levels/gamma");
  reported.off_law = reader.read("/levels/off_law");
  return reported;
}

Reported run_of(const std::string& name, const std::vector<std::string>& settings = {}) {
  return run_of(read_problem(defect_file(name + ".toml"), settings));
}

}  // namespace

TEST_CASE("an orbit takes the same steps in all units of length, mass and time") {
  for (const char* const scheme : {"scheme.lagrangian=midpoint", "scheme.lagrangian=splitting"}) {
    const Folder folder;
    const EnsembleOutcome all =
        run_ensemble(read_problem(defect_file("p14-units.toml"), std::vector<std::string>{scheme}),
                     {.output = (folder / "record.h5"), .threads = 1});
    REQUIRE(all.status == ExitStatus::done);
    const auto steps = std::ranges::find(all.summary, std::string("steps"), &EnsembleFigure::name);
    REQUIRE(steps != all.summary.end());
    CHECK(steps->values.min == steps->values.max);
  }
}

TEST_CASE("a first step is found where H is 0 along the orbit") {
  const Reported vortices = run_of("p32-auto-where-H-is-zero");
  CHECK(vortices.is_quiet());
  CHECK(vortices.flagged() == 0);
  // Half to twice 0.02: the scale of H is known by what rounding says of its terms alone.
  CHECK(vortices.t[1] > 0.01);
  CHECK(vortices.t[1] < 0.04);
  // A constant that is added to H changes nothing.
  const Reported raised = run_of("p32-auto-where-H-is-zero", {"hamiltonian.H=-log((x1-x2)^2+(y1-y2)^2)/(4*pi) + 3"});
  CHECK(raised.t == vortices.t);
}

TEST_CASE("a first step is found where a motion begins from rest") {
  const Reported driven = run_of("p32-auto-from-rest");
  CHECK(driven.outcome.status == ExitStatus::done);
  CHECK(driven.flagged() == 0);
  CHECK(driven.t[1] > 1e-4);
  CHECK(driven.checked == ExitStatus::done);
}

TEST_CASE("fields that are the same everywhere, and at rest, keep the law") {
  for (const char* const scheme : {"box", "fourier", "splitting", "leapfrog"}) {
    for (const char* const potential : {"auto", "none"}) {
      for (const char* const amplitude : {"0", "1e-9", "0.1"}) {
        INFO(scheme << ", " << potential << ", " << amplitude);
        const Reported reported = run_of("uniform-from-rest", {fmt::format("scheme.lagrangian={}", scheme),
                                                               fmt::format("parameters.a={}", amplitude),
                                                               fmt::format("scheme.step_potential={}", potential)});
        CHECK(reported.outcome.status == ExitStatus::done);
        CHECK(reported.checked == ExitStatus::done);
        CHECK(reported.t.size() > 50);
        if (std::string_view(scheme) == "box" || std::string_view(scheme) == "fourier") {
          // The potential is nothing up to the end of the run, and Γ falls from 40 to 15, so that steps grow.
          CHECK(reported.is_quiet());
          CHECK(reported.t.back() - reported.t[reported.t.size() - 2] > 1.1 * (reported.t[1] - reported.t[0]));
        }
        if (std::string_view(potential) == "auto") {
          CHECK(reported.flagged() == 0);
        }
      }
    }
  }
  // The twin: equal steps are off.
  const Reported equal = run_of("uniform-from-rest", {"scheme.levels=fixed"});
  const auto [least, most] = std::ranges::minmax(equal.energy);
  CHECK(most - least > 1e-4);
}

TEST_CASE("where the energy does not depend on the step the run is quiet, and the discrete energy is H") {
  struct Case {
    const char* name;
    double energy;
    std::vector<std::string> settings = {};
  };
  const std::vector<Case> cases = {{"user-equilibrium", 0.0},
                                   {"user-equilibrium", 0.0, {"scheme.lagrangian=gauss", "scheme.stages=2"}},
                                   {"user-equilibrium", 0.0, {"scheme.lagrangian=generating", "scheme.order=4"}},
                                   {"user-equilibrium", 0.0, {"scheme.lagrangian=splitting"}},
                                   {"user-equilibrium", -1.0, {"hamiltonian.H=v^2/2 - cos(x)"}},
                                   {"user-equilibrium", 0.5, {"hamiltonian.H=v^2/2", "initial.v=1"}},
                                   {"p08-false-warning-free-fall", 9.81},
                                   {"p08-false-warning-free-fall", 9.81, {"scheme.stages=2"}},
                                   {"p08-false-warning-free-fall", 9.81, {"scheme.until=100"}},
                                   {"p08-false-warning-zero-energy", 0.0}};
  for (const Case& one : cases) {
    const Reported reported = run_of(one.name, one.settings);
    INFO(one.name << ", " << fmt::format("{}", fmt::join(one.settings, ", ")) << ": "
                  << fmt::format("{}", fmt::join(reported.outcome.warnings, "; ")));
    CHECK(reported.is_quiet());
    CHECK(reported.checked == ExitStatus::done);
    CHECK(reported.flagged() == 0);
    CHECK(reported.outcome.statistics.potential.largest() == 0.0);
    const double h = reported.t[1] - reported.t[0];
    for (std::size_t k = 0; k < reported.energy.size(); ++k) {
      REQUIRE(reported.energy[k] ==
              Approx(one.energy).epsilon(1e-13).margin(2.0 * reported.outcome.statistics.rounding.largest()));
      REQUIRE(reported.t[k + 1] - reported.t[k] == Approx(h).epsilon(1e-12));
    }
  }
  // The twin: where there is a force that is no polynomial, and that strides of a look-ahead pass over, steps that are
  // off the law are flagged, and reported on.
  const Reported late = run_of("user-equilibrium", {"hamiltonian.H=v^2/2 + exp(-4*(x-430)^2)/3", "initial.v=1",
                                                    "scheme.until=905", "scheme.lagrangian=gauss", "scheme.stages=2"});
  CHECK(late.flagged() > 0);
  CHECK(late.flagged() < late.energy.size() / 2);
  CHECK(late.outcome.warnings.size() == 1);
}

TEST_CASE("energy_tolerance is kept by orbits and lattices, with fixed and variable levels") {
  struct Case {
    const char* name;
    double tolerance;
    std::vector<std::string> settings = {};
  };
  const std::vector<Case> cases = {{"auto-tolerance-lattice", 1e-3},
                                   {"auto-tolerance-orbit", 1e-4},
                                   {"auto-tolerance-orbit", 1e-4, {"scheme.stages=2"}}};
  for (const Case& one : cases) {
    const Reported reported = run_of(one.name, one.settings);
    INFO(one.name << ", " << fmt::format("{}", fmt::join(one.settings, ", ")));
    CHECK(reported.outcome.status == ExitStatus::done);
    CHECK(reported.strayed() <= one.tolerance);
    CHECK(reported.strayed() > 0.5 * one.tolerance);
    // The twin: twice the step does not.
    Problem problem = read_problem(defect_file(std::string(one.name) + ".toml"), one.settings);
    problem.scheme.step = 2.0 * (reported.t[1] - reported.t[0]);
    problem.scheme.energy_tolerance.reset();
    CHECK(run_of(problem).strayed() > one.tolerance);
  }
}

TEST_CASE("a step that is not flagged meets the law, however coarse it is") {
  const Reported reported = run_of("law-off-coarse");
  REQUIRE(reported.outcome.status == ExitStatus::lost);  // by how many steps are flagged
  CHECK(reported.checked == ExitStatus::done);
  CHECK(reported.flagged() > 0);
  const double E = reported.outcome.statistics.energy();
  for (std::size_t k = 0; k < reported.energy.size(); ++k) {
    if (reported.off_law[k] == 0.0) {
      CHECK(std::abs(reported.energy[k] - E) <= 1e-12);
    }
  }
}

TEST_CASE("Gamma is f^T H_zz f, or not told") {
  const Reported golden = run_of("golden-gamma");
  CHECK(golden.gamma.front() == Approx(1.9 * 1.9).epsilon(1e-14));  // f = (p, -sin q), H_zz = diag(cos q, 1)
  CHECK(golden.outcome.statistics.gamma.max == Approx(3.61).epsilon(1e-3));
  CHECK(golden.outcome.statistics.gamma.min > 0.0);
  CHECK(golden.checked == ExitStatus::done);
  CHECK(run_of("golden-gamma", {"scheme.lagrangian=midpoint"}).gamma.front() == Approx(3.61).epsilon(1e-14));
  for (const char* const order : {"scheme.order=2", "scheme.order=4"}) {
    const Reported reported = run_of("golden-gamma", {"scheme.lagrangian=generating", order});
    CHECK(reported.checked == ExitStatus::done);
    if (std::string(order) == "scheme.order=2") {
      CHECK(reported.gamma.front() == Approx(3.61).epsilon(1e-14));
    } else {
      CHECK(std::ranges::all_of(reported.gamma, [](double x) { return std::isnan(x); }));
      CHECK(to_table(reported.outcome).find("  Gamma ") == std::string::npos);
      CHECK(to_json(reported.outcome).find("\"gamma\"") == std::string::npos);
    }
  }
}
