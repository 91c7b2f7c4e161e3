#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include <catch2/catch.hpp>

#include <rubato/pde/lattice.hpp>

namespace rubato::tests {

struct StepLengths {
  double shortest = std::numeric_limits<double>::infinity(), longest = 0.0;
};

/// Runs a lattice to its end, or as far as t = `end`; every step has to meet the law E_k = E to 1e-12.
inline StepLengths check_energy_is_kept(LatticeIntegrator& lattice,
                                        double end = std::numeric_limits<double>::infinity()) {
  StepLengths lengths;
  double energy = 0.0;
  while (!lattice.finished() && lattice.t() < end) {
    const StepReport report = lattice.step();
    REQUIRE(report.status == Status::success);
    REQUIRE_FALSE(report.off_law);
    energy = energy == 0.0 ? report.energy : energy;
    CHECK(std::abs(report.energy - energy) <= 1e-12 * std::abs(energy));
    lengths.shortest = std::min(lengths.shortest, report.h);
    lengths.longest = std::max(lengths.longest, report.h);
  }
  return lengths;
}

}  // namespace rubato::tests
