#include <rubato/pde/nodal_view.hpp>

#include <algorithm>

#include <rubato/grids/slab.hpp>

namespace rubato {

NodalView::NodalView(const MultisymplecticSystem& system, const grids::Grid& grid, Collocation collocation)
    : grid_(grid) {
  const FieldStructure& structure = system.structure();
  const auto is_algebraic = [&](Eigen::Index f) { return structure.algebraic[static_cast<std::size_t>(f)]; };
  for (int f = 0; collocation == Collocation::corners && f < system.field_count(); ++f) {
    std::vector<int> axes;
    bool of_moving = is_algebraic(f);
    for (int a = 0; a < system.directions(); ++a) {
      const auto row = system.K(a).row(f);
      for (Eigen::Index u = 0; u < row.size(); ++u) {
        of_moving = of_moving && (row(u) == 0.0 || !is_algebraic(u));
      }
      if (!row.isZero(0.0)) {
        axes.push_back(a);
      }
    }
    if (of_moving && axes.size() == 1) {
      const Eigen::MatrixXd& plus = structure.K_plus[static_cast<std::size_t>(axes.front())];
      moved_.push_back({f, axes.front(), !plus.row(f).isZero(0.0)});
      fields_.push_back(f);
    }
  }
  if (!moved_.empty()) {
    mirrors_.emplace(system, grid, collocation);
  }
}

bool NodalView::moves(const std::vector<int>& fields) const {
  return std::ranges::any_of(fields, [this](int f) { return std::ranges::find(fields_, f) != fields_.end(); });
}

const LatticeLevel& NodalView::operator()(const LatticeLevel& level) {
  if (moved_.empty()) {
    return level;
  }
  if (at_nodes_) {
    at_nodes_->fields.copy_from(level.fields);
    at_nodes_->slopes = level.slopes;
  } else {
    at_nodes_ = level;
  }
  grids::refresh_ghosts(at_nodes_->fields, fields_);
  std::ranges::for_each(moved_, [this](const Moved& moved) { average(moved); });
  grids::refresh_ghosts(at_nodes_->fields, fields_);
  return *at_nodes_;
}

/// Lines along the axis: at a node the mean of what is half a cell before it and half a cell after it. Beyond a wall is
/// what the mirror shows.
void NodalView::average(const Moved& moved) {
  const auto& [field, axis, forward] = moved;
  const grids::Axis& along = grid_.axis(axis);
  const std::size_t stride = grid_.stride(axis), cells = grid_.cells(axis);
  const auto values = at_nodes_->fields.field(field);
  line_.resize(cells);
  for (std::size_t first = 0; first < grid_.size(); ++first) {
    if (first / stride % cells != 0) {
      continue;
    }
    for (std::size_t i = 0; i < cells; ++i) {
      line_[i] = values[first + i * stride];
    }
    for (std::size_t i = 0; i < cells; ++i) {
      const std::size_t last = cells - 1;
      double before = line_[!forward ? i : i == 0 ? last : i - 1];
      double after = line_[forward ? i : i == last ? 0 : i + 1];
      if (along.has_walls() && i == 0) {
        before = mirrors_->sign(axis, field, along.left) * after;
      } else if (along.has_walls() && i == last) {
        after = mirrors_->sign(axis, field, along.right) * before;
      }
      values[first + i * stride] = 0.5 * (before + after);
    }
  }
}

}  // namespace rubato
