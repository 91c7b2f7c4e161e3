#pragma once

#include <string>
#include <vector>

#include "../passes.hpp"
#include "case.hpp"

namespace orbits {

/// A composition of drifts and kicks, parts that meet between steps made one; with sums that keep what rounding takes
/// (Kahan), or without.
template <typename System, bool Compensated>
class Splitting {
public:
  explicit Splitting(const rubato::Composition& composition)
      : passes_(composition), slope_(System::n), rest_(2 * System::n) {}

  template <typename Watch>
  Taken operator()(int steps, double until, State<System>& state, Watch& watch) {
    const double h = until / steps;
    std::fill(rest_.begin(), rest_.end(), 0.0);
    double* const q = state.q.data();
    double* const p = state.p.data();
    const double start = peers::cpu_seconds();
    const auto pass = [&](const peers::Passes::Pass& one) {
      if (one.kick != 0.0) {
        System::force(q, slope_.data());
        go(p, rest_.data(), slope_.data(), one.kick * h);
      }
      const double a = passes_.drifts[one.drift] * h;
      if constexpr (System::unit_masses) {
        go(q, rest_.data() + System::n, p, a);
      } else {
        System::velocity(p, slope_.data());
        go(q, rest_.data() + System::n, slope_.data(), a);
      }
    };
    if constexpr (Watch::active) {
      for (int i = 0; i < steps; ++i) {
        passes_.run(1, pass);
        watch(q, p);
      }
    } else {
      passes_.run(steps, pass);
    }
    return {peers::cpu_seconds() - start, steps, until};
  }

private:
  static void go(double* x, double* rest, const double* slope, double length) {
    for (std::size_t i = 0; i < System::n; ++i) {
      if constexpr (Compensated) {
        add(x[i], rest[i], length * slope[i]);
      } else {
        x[i] += length * slope[i];
      }
    }
  }

  peers::Passes passes_;
  std::vector<double> slope_, rest_;
};

/// Compositions of orders 4, 6 that Rubato has not.
[[nodiscard]] const std::vector<rubato::Composition>& more_compositions();
/// Of Kepler orbits and kicks that are small beside them: Wisdom and Holman's, SABA₃, ABA(8,6,4).
[[nodiscard]] const std::vector<rubato::Composition>& planetary_compositions();

template <typename System>
void add_splittings(const Case<System>& problem, int first, std::vector<Method>& methods) {
  const auto take = [&](const rubato::Composition& one) {
    const std::string name(one.name);
    methods.push_back(problem.method(name, Class::peer, first, Splitting<System, false>(one)));
    if (one.order >= 6) {  // others do not come to where rounding is felt
      methods.push_back(problem.method(name + ", compensated", Class::peer, first, Splitting<System, true>(one)));
    }
  };
  for (const rubato::Composition& one : rubato::compositions()) {
    take(one);
  }
  for (const rubato::Composition& one : more_compositions()) {
    take(one);
  }
}

}  // namespace orbits
