#include <rubato/pde/tangent.hpp>

#include <cmath>
#include <numbers>
#include <random>
#include <stdexcept>
#include <utility>

#include <rubato/grids/slab.hpp>
#include <rubato/grids/whole.hpp>
#include <rubato/pde/box_gather.hpp>
#include <rubato/pde/cell_solver.hpp>
#include <rubato/pde/cell_sweep.hpp>
#include <rubato/pde/euler_box_map.hpp>
#include <rubato/pde/kernel_conditions.hpp>
#include <rubato/solve/cyclic_parts.hpp>

namespace rubato {

namespace {

class BoxTangents final : public TangentStep {
public:
  BoxTangents(const MultisymplecticSystem& s, const grids::Grid& grid)
      : system(s),
        sweep(s, grid),
        blocks(grid),
        gather(grid),
        point(s.field_count(), grid.size()),
        hessian(static_cast<int>(s.varying_hessian().size()), grid.size()),
        rhs(point),
        middle(point) {
    for (int a = 0; a < s.directions(); ++a) {
      matrix.difference.push_back(s.K(a));
    }
    for (std::size_t e = 0; e < s.varying_hessian().size(); ++e) {
      const auto [row, column] = s.varying_hessian()[e];
      const double* values = hessian.field(static_cast<int>(e)).data();
      matrix.entries.push_back({row, column, -1.0, values});
      if (row != column) {
        matrix.entries.push_back({column, row, -1.0, values});
      }
    }
    const int conditions = step_conditions(s, 1.0).count();
    border.resize(static_cast<std::size_t>(conditions) * blocks.lines);
    solver = make_cell_solver(grid, Collocation::cells, s.field_count(), conditions, 1e-14);
  }

  Status operator()(const LatticeLevel& before, const LatticeLevel& after, double h, const grids::FieldSet& u_before,
                    grids::FieldSet& u_after) override {
    const FieldStructure& structure = system.structure();
    for (int f = 0; f < system.field_count(); ++f) {
      const auto z_0 = before.fields.field(f);
      const auto z_1 = after.fields.field(f);
      const auto at = point.field(f);
      for (std::size_t i = 0; i < at.size(); ++i) {
        at[i] = structure.at_midpoints(f) ? z_1[i] : 0.5 * (z_0[i] + z_1[i]);
      }
    }
    if (!sweep(std::as_const(point).pointers(), after.slopes, {}, 0.0, {}, hessian.pointers()).finite) {
      return Status::undefined;
    }
    matrix.mean = (2.0 / h) * system.M() - system.constant_hessian();
    make_rhs(u_before, h);
    solver->forget();
    if (const Status status =
            solver->solve(matrix, step_conditions(system, h), std::as_const(rhs).pointers(), middle.pointers(), border);
        status != Status::success) {
      return status;
    }
    if (!solver->finds_ghosts()) {
      grids::refresh_ghosts(middle);
    }
    for (int f = 0; f < system.field_count(); ++f) {
      const auto u_0 = u_before.field(f);
      const auto u_1 = u_after.field(f);
      const auto mean = std::as_const(middle).field(f);
      for (std::size_t i = 0; i < u_1.size(); ++i) {
        u_1[i] = structure.at_midpoints(f) ? mean[i] : 2.0 * mean[i] - u_0[i];
      }
    }
    return Status::success;
  }

private:
  /// rhs = (2/h) M A u.
  void make_rhs(const grids::FieldSet& u, double h) {
    rhs.fill(0.0);
    std::vector<double> mean(CellBlocks::most);
    double* const none[3] = {};
    for (std::size_t block = 0; block < blocks.count(); ++block) {
      const std::size_t line = block / blocks.per_line;
      const std::size_t begin = block % blocks.per_line * CellBlocks::most;
      const std::size_t count = std::min(CellBlocks::most, blocks.line - begin);
      for (int f = 0; f < system.field_count(); ++f) {
        gather(u.field(f).data(), line, begin, count, mean.data(), none);
        for (int r = 0; r < system.field_count(); ++r) {
          const double factor = 2.0 / h * system.M()(r, f);
          double* out = rhs.field(r).data() + line * blocks.line + begin;
          for (std::size_t c = 0; factor != 0.0 && c < count; ++c) {
            out[c] += factor * mean[c];
          }
        }
      }
    }
  }

  MultisymplecticSystem system;
  CellSweep sweep;
  CellBlocks blocks;
  BoxGather gather;
  grids::FieldSet point, hessian, rhs, middle;
  CellMatrix matrix;
  std::vector<double> border;
  std::unique_ptr<CellSolver> solver;
};

class EulerBoxTangents final : public TangentStep {
public:
  EulerBoxTangents(const MultisymplecticSystem& system, const grids::Grid& grid) : map_(system, grid) {}

  [[nodiscard]] Status operator()(const LatticeLevel& before, const LatticeLevel& after, double h,
                                  const grids::FieldSet& u_before, grids::FieldSet& u_after) override {
    return map_.tangent(h, before.fields, after.fields, u_before, u_after);
  }
  [[nodiscard]] bool law_on_three_levels() const override { return true; }

private:
  EulerBoxMap map_;
};

}  // namespace

std::unique_ptr<TangentStep> make_box_tangents(const MultisymplecticSystem& system, const grids::Grid& grid) {
  return std::make_unique<BoxTangents>(system, grid);
}
std::vector<std::size_t> box_tangent_parts(const MultisymplecticSystem& system, const grids::Grid& whole, int ranks) {
  return solve::cyclic_parts(system.field_count(), whole.cells(0), ranks).first_cells.front();
}
std::unique_ptr<TangentStep> make_euler_box_tangents(const MultisymplecticSystem& system, const grids::Grid& grid) {
  return std::make_unique<EulerBoxTangents>(system, grid);
}

grids::FieldSet random_tangent(const MultisymplecticSystem& system, const grids::Grid& grid, std::uint64_t seed) {
  constexpr int waves = 4;
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> amplitude(-1.0, 1.0);
  std::uniform_real_distribution<double> phase(0.0, 2.0 * std::numbers::pi);
  std::uniform_int_distribution<int> wave(1, 3);
  grids::FieldSet tangent(system.field_count(), grid.size());
  // Of a part of the lattice, the same numbers as at these nodes of the whole.
  const grids::Grid& whole = grids::whole_of(grid);
  const auto number = [&grid, &whole](int axis, std::size_t place) {
    return (grid.axis(axis).first + place) % whole.cells(axis);
  };
  for (int f = 0; f < system.field_count(); ++f) {
    for (int w = 0; w < waves; ++w) {
      const double a = amplitude(random);
      const double shift = phase(random);
      double k[3];
      for (double& component : k) {
        component = 2.0 * std::numbers::pi * wave(random);
      }
      const auto values = tangent.field(f);
      for (std::size_t i = 0; i < values.size(); ++i) {
        double angle = shift;
        std::size_t rest = i;
        for (int axis = 0; axis < grid.dimensions(); ++axis) {
          angle += k[axis] * static_cast<double>(number(axis, rest % grid.cells(axis))) /
                   static_cast<double>(whole.cells(axis));
          rest /= grid.cells(axis);
        }
        values[i] += a * std::sin(angle);
      }
    }
  }
  return tangent;
}

TangentPair::TangentPair(LocalLaws& laws, std::unique_ptr<TangentStep> step, const MultisymplecticSystem& system,
                         const grids::Grid& grid, std::uint64_t seed)
    : laws_(laws), step_(std::move(step)) {
  u_.now = random_tangent(system, grid, seed);
  v_.now = random_tangent(system, grid, seed + 1);
  for (Tangent* tangent : {&u_, &v_}) {
    tangent->next = tangent->now;
    tangent->earlier = step_->law_on_three_levels() ? tangent->now : grids::FieldSet();
  }
}

Status TangentPair::take(const LatticeLevel& before, const LatticeLevel& after, double h) {
  for (Tangent* tangent : {&u_, &v_}) {
    if (const Status status = (*step_)(before, after, h, tangent->now, tangent->next); status != Status::success) {
      return status;
    }
    tangent->stages.assign(step_->stages().begin(), step_->stages().end());
  }
  const bool three = step_->law_on_three_levels();
  residual_.reset();
  if (!three || steps_ > 0) {
    residual_ = laws_.multisymplectic_residual({u_.now, u_.next, &u_.earlier, u_.stages},
                                               {v_.now, v_.next, &v_.earlier, v_.stages}, h);
  }
  for (Tangent* tangent : {&u_, &v_}) {
    if (three) {
      std::swap(tangent->earlier, tangent->now);
    }
    std::swap(tangent->now, tangent->next);
  }
  ++steps_;
  return Status::success;
}

void TangentPair::save(StateWriter& state) const {
  state.write(static_cast<double>(steps_));
  for (const Tangent* tangent : {&u_, &v_}) {
    grids::save_whole(state, tangent->now);
    grids::save_whole(state, tangent->earlier);
  }
}

void TangentPair::restore(StateReader& state) {
  state.read(steps_);
  for (Tangent* tangent : {&u_, &v_}) {
    grids::restore_whole(state, tangent->now);
    grids::restore_whole(state, tangent->earlier);
  }
  residual_.reset();
}

}  // namespace rubato
