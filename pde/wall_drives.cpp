#include <rubato/pde/wall_drives.hpp>

#include <algorithm>
#include <set>
#include <span>
#include <utility>

#include <fmt/format.h>

#include <rubato/pde/lattice_scheme.hpp>
#include <rubato/pde/mirror_signs.hpp>
#include <rubato/pde/static_condensation.hpp>

namespace rubato {

std::optional<MomentumRow> momentum_row(const MultisymplecticSystem& system, int u) {
  std::optional<MomentumRow> found;
  for (int v = 0; v < system.field_count(); ++v) {
    if (system.M()(v, u) == 0.0) {
      continue;
    }
    const auto linear = linear_row(system, v);
    const bool is_momentum = linear && in_no_K(system, v) && (system.M().row(v).array() != 0.0).count() == 1;
    if (!is_momentum || found) {
      return std::nullopt;
    }
    found = MomentumRow{v, system.M()(v, u), linear->a, linear->b};
  }
  return found;
}

DrivenNodes::DrivenNodes(std::shared_ptr<const WallDrives> drives, const MultisymplecticSystem& system,
                         const grids::Grid& grid)
    : drives_(std::move(drives)), grid_(grid) {
  std::set<std::pair<int, std::size_t>> taken;  // where two walls meet by the first
  for (std::size_t number = 0; number < drives_->walls.size(); ++number) {
    const WallDrive& drive = drives_->walls[number];
    const auto row = momentum_row(system, drive.field);
    const grids::Axis& axis = grid.axis(drive.axis);
    if (!row || MirrorSigns(system, drive.axis, axis.name).at(drive.field, grids::End::fixed) > 0) {
      throw SchemeRefusal(
          fmt::format("a wall cannot drive {0}, which is no field with an equation of motion of second "
                      "order that varies along {1}: drive another field",
                      system.fields()[static_cast<std::size_t>(drive.field)], axis.name));
    }
    for (const int field : {drive.field, row->v}) {
      if (std::ranges::find(fields_, field) == fields_.end()) {
        fields_.push_back(field);
      }
    }
    evaluate_.emplace_back(drive.code);
    for (std::size_t node = 0; node < grid.size(); ++node) {
      const bool is_there = axis.is_on_wall(grid.place(node).at(static_cast<std::size_t>(drive.axis)), drive.is_right);
      const double weight = is_there ? grid.weight(node) : 0.0;
      if (weight > 0.0 && taken.emplace(drive.field, node).second) {
        nodes_.push_back({number, node, weight, drive.field, *row});
      }
    }
  }
}

DrivenNodes::Values DrivenNodes::at(const Node& node, double t) {
  std::array<double, 4> arguments{t};
  const auto place = grid_.place(node.node);
  for (std::size_t a = 0; a < static_cast<std::size_t>(grid_.dimensions()); ++a) {
    arguments[1 + a] = grid_.axis(static_cast<int>(a)).node(place[a]);
  }
  std::array<double, 2> values{};
  evaluate_[node.drive](std::span(arguments).first(1 + static_cast<std::size_t>(grid_.dimensions())), values);
  return {values[0], node.row.momentum(values[1])};
}

}  // namespace rubato
