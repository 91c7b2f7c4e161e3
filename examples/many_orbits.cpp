// A thousand orbits of Hénon and Heiles of one energy, side by side in vectors: the largest deviation of their
// energies, and one of them alone, which is the same to the last bit.

#include <cmath>
#include <vector>

#include <fmt/format.h>

#include <rubato/rubato.hpp>

int main() {
  const rubato::Hamiltonian henon_heiles({"x", "y"}, {"u", "v"}, "(u^2 + v^2)/2 + (x^2 + y^2)/2 + x^2*y - y^3/3");
  std::vector<rubato::InitialState> starts;
  for (int m = 0; m < 1000; ++m) {
    const double y = 0.1, speed_squared = 2.0 / 12.0 - y * y + 2.0 * y * y * y / 3.0, angle = 2e-3 * M_PI * m;
    starts.push_back(
        {.q = {0.0, y}, .p = {std::sqrt(speed_squared) * std::cos(angle), std::sqrt(speed_squared) * std::sin(angle)}});
  }
  const rubato::IntegrationOptions options{.lagrangian = rubato::Splitting{.composition = "blanes-moan-4"},
                                           .step = 0.1,
                                           .until = 1000,
                                           .levels = rubato::Levels::fixed};

  const std::vector<rubato::OrbitEnd> ends = rubato::integrate(henon_heiles, starts, options);

  double deviation = 0.0;
  bool all_arrived = true;
  for (const rubato::OrbitEnd& end : ends) {
    deviation = std::max(deviation, end.node_energy_deviation);
    all_arrived = all_arrived && end.status == rubato::Status::success && end.steps == 10000;
  }
  const rubato::Orbit alone = rubato::integrate(henon_heiles, starts[123], options);
  const bool same = alone.t.back() == ends[123].t && alone.q_at(10000)[0] == ends[123].q[0] &&
                    alone.node_energy_deviation() == ends[123].node_energy_deviation;
  fmt::print("{} orbits, {} steps each: energies deviate by up to {:.2g} of 1/12\n", ends.size(), ends[0].steps,
             12.0 * deviation);
  fmt::print("alone, orbit 123 is {}\n", same ? "the same to the last bit" : "another");

  // A method of order 4 with errors of some h⁴/1000 of the energy.
  return all_arrived && same && deviation < 1e-6 ? 0 : 1;
}
