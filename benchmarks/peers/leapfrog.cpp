#include <cmath>
#include <utility>

#include "peer.hpp"

namespace peers {

double leapfrog(const Line& line, const Function& u, const Function& u_t, double h, int steps, Nodes& out) {
  const std::size_t n = line.nodes;
  Nodes before(n), now(n), after(n);
  const double dx = line.length / static_cast<double>(n), ratio = h * h / (dx * dx), square = h * h;
  for (std::size_t i = 0; i < n; ++i) {
    before[i] = u(line.node(i));
  }
  const auto force = [&](const Nodes& x, std::size_t i) {
    const double left = x[i == 0 ? n - 1 : i - 1], right = x[i + 1 == n ? 0 : i + 1];
    return ratio * (left - 2.0 * x[i] + right) - square * std::sin(x[i]);
  };
  for (std::size_t i = 0; i < n; ++i) {
    now[i] = before[i] + h * u_t(line.node(i)) + 0.5 * force(before, i);
  }
  const double start = cpu_seconds();
  for (int k = 1; k < steps; ++k) {
    const double* const x = now.data();
    const double* const old = before.data();
    double* const y = after.data();
    for (std::size_t i = 1; i + 1 < n; ++i) {
      y[i] = 2.0 * x[i] - old[i] + ratio * (x[i - 1] - 2.0 * x[i] + x[i + 1]) - square * std::sin(x[i]);
    }
    for (const std::size_t i : {std::size_t{0}, n - 1}) {
      y[i] = 2.0 * x[i] - old[i] + force(now, i);
    }
    std::swap(before, now);
    std::swap(now, after);
  }
  const double seconds = cpu_seconds() - start;
  out = now;
  return seconds * steps / (steps - 1);
}

}  // namespace peers
