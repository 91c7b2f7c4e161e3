#include <rubato/ode/hessian_band.hpp>

#include <algorithm>
#include <cstdlib>
#include <utility>

#include <rubato/ode/tuning.hpp>
#include <rubato/solve/band_solver.hpp>

namespace rubato {

namespace {

using namespace tuning::band;

}  // namespace

std::optional<HessianBand> HessianBand::of(const Hamiltonian& hamiltonian) {
  const auto n = static_cast<int>(hamiltonian.degrees_of_freedom());
  const auto& places = hamiltonian.hessian_places();
  std::vector<std::pair<int, int>> edges;
  for (const auto& [row, column] : places) {
    edges.emplace_back(static_cast<int>(row) % n, static_cast<int>(column) % n);
  }
  const std::vector<int> order = solve::reverse_cuthill_mckee(n, edges);
  const auto place = [&](int vertex) { return order[static_cast<std::size_t>(vertex)]; };
  int distance = 0;
  for (const auto& [a, b] : edges) {
    distance = std::max(distance, std::abs(place(a) - place(b)));
  }
  const double size = 2.0 * n, width = 2.0 * distance + 1.0;
  if (band_gain * 4.0 * size * width * width > 2.0 / 3.0 * size * size * size) {
    return std::nullopt;
  }
  HessianBand band;
  band.width = 2 * distance + 1;
  for (int i = 0; i < 2 * n; ++i) {
    band.places.push_back(2 * place(i % n) + i / n);
  }
  // Row i of J H_zz is row n + i of H_zz, row n + i is minus row i.
  const auto add = [&](std::size_t row, std::size_t column, std::size_t number) {
    const auto i = static_cast<int>(row);
    const int turned = i < n ? i + n : i - n;
    band.entries.push_back(
        {band.places[static_cast<std::size_t>(turned)], band.places[column], number, i < n ? -1.0 : 1.0});
  };
  for (std::size_t k = 0; k < places.size(); ++k) {
    add(places[k].row, places[k].column, k);
    if (places[k].row != places[k].column) {
      add(places[k].column, places[k].row, k);
    }
  }
  return band;
}

}  // namespace rubato
