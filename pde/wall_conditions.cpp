#include <rubato/pde/wall_conditions.hpp>

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <rubato/pde/lattice_scheme.hpp>
#include <rubato/pde/mirror_signs.hpp>
#include <rubato/pde/static_condensation.hpp>

namespace rubato {

WallConditions::WallConditions(const MultisymplecticSystem& system, const grids::Grid& grid,
                               const std::shared_ptr<const WallDrives>& drives)
    : system_(system), evaluate_(system.hessian_code()) {
  if (grid.dimensions() > 1) {
    throw SchemeRefusal(
        "box has walls on a line alone: write lagrangian = \"leapfrog\" or \"splitting\", or leave left and right out");
  }
  int joined = 0;
  for (int f = 0; f < system.field_count(); ++f) {
    joined += in_no_K(system, f) ? 0 : 1;
  }
  const FieldMirrors mirrors(system, grid, Collocation::cells);
  std::ranges::copy_if(mirrors.held(grid), std::back_inserter(held_),
                       [&](const Held& held) { return !in_no_K(system, held.first); });
  if (held_.size() != static_cast<std::size_t>(joined)) {
    throw SchemeRefusal(fmt::format(
        "box between walls needs one condition for each of the {} fields with derivatives in space, and the "
        "walls give {}: write lagrangian = \"fourier\", or leave left and right out",
        joined, held_.size()));
  }
  if (drives != nullptr) {
    driven_.emplace(drives, system, grid);
  }
  for (const int axis : system.coordinates()) {
    place_.push_back(grid.axis(axis).node(0));
  }
  outputs_.resize(1 + static_cast<std::size_t>(system.field_count()) + system.varying_hessian().size());
}

void WallConditions::hold(const grids::FieldSet& high, const grids::FieldSet& low, double t, grids::FieldSet& delta) {
  hold(delta);
  for (std::size_t i = 0; driven_ && i < driven_->nodes().size(); ++i) {
    const DrivenNodes::Node& at = driven_->nodes()[i];
    delta.field(at.u)[at.node] = (driven_->at(at, t).u - high.field(at.u)[at.node]) - low.field(at.u)[at.node];
  }
}

double WallConditions::work(const grids::FieldSet& point, const grids::FieldSet& delta) const {
  double work = 0.0;
  const Eigen::MatrixXd& plus = system_.structure().K_plus.front();
  for (std::size_t i = 0; driven_ && i < driven_->nodes().size(); ++i) {
    const DrivenNodes::Node& at = driven_->nodes()[i];
    double force = 0.0;
    for (int g = 0; g < point.fields(); ++g) {
      force += plus(at.u, g) * point.field(g)[at.node];
    }
    work += (at.node == 0 ? -force : force) * delta.field(at.u)[at.node];
  }
  return work;
}

void WallConditions::close(const std::vector<int>& free, const grids::FieldSet& point, const grids::FieldSet& delta,
                           double inverse_h, CellMatrix& matrix, grids::FieldSet& residual) {
  const auto size = static_cast<Eigen::Index>(free.size());
  const std::size_t last = point.size() - 1;
  const auto place = [&](int field) {
    return static_cast<Eigen::Index>(std::ranges::find(free, field) - free.begin());
  };
  matrix.last_left.setZero(size, size);
  matrix.last_right.setZero(size, size);
  for (int f = 0; f < residual.fields(); ++f) {
    residual.field(f)[last] = 0.0;
  }
  Eigen::Index row = 0;
  for (const auto& [field, node] : held_) {
    (node == 0 ? matrix.last_right : matrix.last_left)(row++, place(field)) = 1.0;
  }
  bool is_evaluated = false;
  for (const int f : free) {
    if (!in_no_K(system_, f)) {
      continue;
    }
    if (!is_evaluated) {
      inputs_.clear();
      for (int g = 0; g < point.fields(); ++g) {
        inputs_.push_back(point.field(g)[0]);
      }
      inputs_.insert(inputs_.end(), place_.begin(), place_.end());
      evaluate_(inputs_, outputs_);
      is_evaluated = true;
    }
    double left_over = outputs_[1 + static_cast<std::size_t>(f)];
    for (int g = 0; g < point.fields(); ++g) {
      if (system_.M()(f, g) != 0.0 && !system_.structure().at_midpoints(g)) {
        left_over -= inverse_h * system_.M()(f, g) * delta.field(g)[0];
      }
    }
    residual.field(free[static_cast<std::size_t>(row)])[last] = left_over;
    matrix.last_right.row(row) = matrix.mean.row(place(f));
    for (std::size_t e = 0; e < system_.varying_hessian().size(); ++e) {
      const auto [i, j] = system_.varying_hessian()[e];
      const double value = outputs_[1 + static_cast<std::size_t>(system_.field_count()) + e];
      if (i == f) {
        matrix.last_right(row, place(j)) -= value;
      } else if (j == f) {
        matrix.last_right(row, place(i)) -= value;
      }
    }
    ++row;
  }
}

void remove_wall_sawtooths(const MultisymplecticSystem& system, const grids::Grid& grid, grids::FieldSet& fields) {
  const FieldMirrors mirrors(system, grid, Collocation::cells);
  const grids::Axis& axis = grid.axis(0);
  for (int f = 0; f < system.field_count(); ++f) {
    if (system.structure().algebraic[static_cast<std::size_t>(f)] || mirrors.sign(0, f, axis.left) < 0 ||
        mirrors.sign(0, f, axis.right) < 0) {
      continue;
    }
    const std::span<double> z = fields.field(f);
    double sum = 0.0, sign = 1.0;
    for (std::size_t c = 0; c + 1 < z.size(); ++c, sign = -sign) {
      sum += sign * (z[c + 1] - z[c]);
    }
    double amplitude = -0.5 * sum / static_cast<double>(z.size() - 1);
    for (double& value : z) {
      value -= amplitude;
      amplitude = -amplitude;
    }
  }
}

void smooth_sawtooth(std::span<double> values) {
  const std::size_t count = values.size() - 3;
  double sum = 0.0, sign = 1.0;
  for (std::size_t i = 0; i < count; ++i, sign = -sign) {
    sum += sign * (values[i + 3] - 3.0 * values[i + 2] + 3.0 * values[i + 1] - values[i]);
  }
  double amplitude = -0.125 * sum / static_cast<double>(count);
  for (double& value : values) {
    value -= amplitude;
    amplitude = -amplitude;
  }
}

}  // namespace rubato
