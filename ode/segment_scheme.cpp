#include <rubato/ode/segment_scheme.hpp>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace rubato {

void check_initial_state(const Hamiltonian& hamiltonian, std::span<const double> z_0) {
  const std::size_t size = 2 * hamiltonian.degrees_of_freedom();
  if (z_0.size() != size) {
    throw std::invalid_argument(fmt::format(
        "the initial state has {} entries, the Hamiltonian has {} coordinates and as many momenta: {} are needed",
        z_0.size(), size / 2, size));
  }
  HamiltonianEvaluator evaluator(hamiltonian);
  std::vector<double> gradient(size);
  const double energy = evaluator.gradient(z_0.data(), gradient.data());
  const auto finite = [](double x) { return std::isfinite(x); };
  if (!std::ranges::all_of(z_0, finite) || !finite(energy) || !std::ranges::all_of(gradient, finite)) {
    throw std::invalid_argument(
        fmt::format("H or its gradient is not finite at the initial state ({}): H = {}, gradient ({})",
                    fmt::join(z_0, ", "), energy, fmt::join(gradient, ", ")));
  }
}

}  // namespace rubato
