#include <rubato/pde/placed_coordinates.hpp>

#include <algorithm>

namespace rubato {

PlacedCoordinates::PlacedCoordinates(const MultisymplecticSystem& system, const grids::Grid& grid,
                                     const grids::BoxOperator& place)
    : values_(static_cast<int>(system.coordinates().size()), grid.size()) {
  for (std::size_t c = 0; c < system.coordinates().size(); ++c) {
    const int axis = system.coordinates()[c];
    const auto a = static_cast<std::size_t>(axis);
    const auto values = values_.field(static_cast<int>(c));
    for (std::size_t cell = 0; cell < values.size(); ++cell) {
      values[cell] = grids::coordinate(grid.axis(axis), grid.place(cell)[a], place[a]);
    }
  }
}

PlacedCoordinates::PlacedCoordinates(const MultisymplecticSystem& system, std::span<const double> along_x)
    : values_(static_cast<int>(system.coordinates().size()), along_x.size()) {
  for (int c = 0; c < values_.fields(); ++c) {
    std::ranges::copy(along_x, values_.field(c).begin());
  }
}

std::vector<const double*> PlacedCoordinates::after(std::span<const double* const> fields) const {
  std::vector<const double*> inputs;
  static_cast<void>(after(fields, inputs));
  return inputs;
}

std::span<const double* const> PlacedCoordinates::after(std::span<const double* const> fields,
                                                        std::vector<const double*>& inputs) const {
  inputs.assign(fields.begin(), fields.end());
  inputs.resize(fields.size() + count());
  put(0, std::span(inputs).subspan(fields.size()));
  return inputs;
}

}  // namespace rubato
