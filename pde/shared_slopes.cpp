#include <rubato/pde/shared_slopes.hpp>

#include <algorithm>
#include <cmath>
#include <span>
#include <vector>

#include <rubato/base/larger.hpp>
#include <rubato/grids/field_set.hpp>
#include <rubato/grids/whole.hpp>

namespace rubato {

namespace {

/// Null where this process has all lines, be it as the one line that there is.
const grids::Slab* sharing(const grids::Grid& grid) {
  return grid.dimensions() > 1 ? grids::Slab::of(grid) : nullptr;
}

/// One number for each line, at all nodes of the line; and back.
///@{
void to_nodes(std::span<const double> lines, std::size_t line, std::span<double> nodes) {
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    nodes[i] = lines[i / line];
  }
}
void to_lines(std::span<const double> nodes, std::size_t line, std::span<double> lines) {
  for (std::size_t l = 0; l < lines.size(); ++l) {
    lines[l] = nodes[l * line];
  }
}
///@}

}  // namespace

PotentialSlopes part_of(const PotentialSlopes& whole, const grids::Slab& slab) {
  if (sharing(slab.grid()) == nullptr) {
    return whole;
  }
  const std::size_t line = slab.whole().cells(0);
  std::vector<double> all(slab.whole().size()), here(slab.size());
  PotentialSlopes part;
  for (const std::vector<double>& slopes : whole.of_field) {
    std::vector<double>& lines = part.of_field.emplace_back(slopes.empty() ? 0 : slab.size() / line);
    if (!slopes.empty()) {
      to_nodes(slopes, line, all);
      slab.take_part(all, here);
      to_lines(here, line, lines);
    }
  }
  return part;
}

void refresh_slopes(PotentialSlopes& slopes, const grids::Grid& grid) {
  const grids::Slab* const slab = sharing(grid);
  const std::size_t line = grid.cells(0);
  for (std::vector<double>& lines : slopes.of_field) {
    if (slab != nullptr && !lines.empty()) {
      grids::FieldSet nodes(1, grid.size());
      to_nodes(lines, line, nodes.field(0));
      slab->refresh(nodes);
      to_lines(nodes.field(0), line, lines);
    }
  }
}

bool has_slope(const PotentialSlopes& slopes, std::size_t field, const grids::Grid& grid) {
  if (field >= slopes.of_field.size() || slopes.of_field[field].empty()) {
    return false;  // at every rank
  }
  return !grids::agreed_by_all(grid,
                               std::ranges::all_of(slopes.of_field[field], [](double slope) { return slope == 0.0; }));
}

bool has_slope(const PotentialSlopes& slopes, const grids::Grid& grid) {
  bool any = false;
  for (std::size_t field = 0; field < slopes.of_field.size(); ++field) {
    any = any || has_slope(slopes, field, grid);
  }
  return any;
}

double largest_slope(const PotentialSlopes& slopes, std::size_t field, const grids::Grid& grid) {
  if (field >= slopes.of_field.size() || slopes.of_field[field].empty()) {
    return 0.0;  // at every rank
  }
  double largest = 0.0;
  for (const double slope : slopes.of_field[field]) {
    largest = larger(largest, std::abs(slope));
  }
  const grids::Slab* const slab = sharing(grid);
  return slab == nullptr ? largest : slab->largest_over_ranks(largest);
}

void save_slopes(StateWriter& state, const PotentialSlopes& slopes, const grids::Grid& grid) {
  const grids::Slab* const slab = sharing(grid);
  const std::size_t line = grid.cells(0);
  std::vector<double> nodes(slab == nullptr ? 0 : grid.size());
  for (const std::vector<double>& lines : slopes.of_field) {
    if (slab == nullptr || lines.empty()) {
      state.write(lines);
    } else if (state.reader() == StateWriter::For::going_back) {
      state.write_part(lines, slab->whole().size() / line);
    } else {
      to_nodes(lines, line, nodes);
      slab->gather(nodes, [&](std::span<const double> planes) {
        std::vector<double> some(planes.size() / line);
        to_lines(planes, line, some);
        state.write(some);
      });
    }
  }
}

void restore_slopes(StateReader& state, PotentialSlopes& slopes, const grids::Grid& grid) {
  const grids::Slab* const slab = sharing(grid);
  const std::size_t line = grid.cells(0);
  grids::FieldSet nodes(1, slab == nullptr ? 0 : grid.size());
  for (std::vector<double>& lines : slopes.of_field) {
    if (slab == nullptr || lines.empty() || state.reader() == StateWriter::For::going_back) {
      state.read(std::span<double>(lines));
      continue;
    }
    const std::size_t count = slab->whole().size() / line;
    state.require(count);
    slab->scatter(nodes.field(0), [&](std::span<double> planes) {
      std::vector<double> some(planes.size() / line);
      state.read_alone(some.size(), some);
      to_nodes(some, line, planes);
    });
    if (!slab->leads()) {
      state.read_alone(count, {});
    }
    slab->refresh(nodes);
    to_lines(nodes.field(0), line, lines);
  }
}

}  // namespace rubato
