#include <rubato/pde/tangent.hpp>

#include <cmath>
#include <numbers>
#include <random>

#include <rubato/pde/cell_solver.hpp>
#include <rubato/pde/cell_sweep.hpp>
#include <rubato/pde/kernel_conditions.hpp>

namespace rubato {

struct TangentStep::Storage {
  MultisymplecticSystem system;
  CellSweep sweep;
  CellBlocks blocks;
  BoxGather gather;
  grids::FieldSet point, hessian, rhs, middle;
  CellMatrix matrix;
  std::vector<double> border;
  std::unique_ptr<CellSolver> solver;

  Storage(const MultisymplecticSystem& s, const grids::Grid& grid)
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
    solver = make_cell_solver(grid, Placement::cells, s.field_count(), conditions, 1e-14);
  }

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
};

TangentStep::TangentStep(const MultisymplecticSystem& system, const grids::Grid& grid)
    : storage_(std::make_unique<Storage>(system, grid)) {}
TangentStep::~TangentStep() = default;
TangentStep::TangentStep(TangentStep&&) noexcept = default;
TangentStep& TangentStep::operator=(TangentStep&&) noexcept = default;

Status TangentStep::operator()(const LatticeLevel& before, const LatticeLevel& after, double h,
                               const grids::FieldSet& u_before, grids::FieldSet& u_after) {
  Storage& s = *storage_;
  const FieldStructure& structure = s.system.structure();
  for (int f = 0; f < s.system.field_count(); ++f) {
    const auto z_0 = before.fields.field(f);
    const auto z_1 = after.fields.field(f);
    const auto point = s.point.field(f);
    for (std::size_t i = 0; i < point.size(); ++i) {
      point[i] = structure.at_midpoints(f) ? z_1[i] : 0.5 * (z_0[i] + z_1[i]);
    }
  }
  const grids::FieldSet& point = s.point;
  if (!s.sweep(point.pointers(), after.slopes, {}, 0.0, {}, s.hessian.pointers()).finite) {
    return Status::undefined;
  }
  s.matrix.mean = (2.0 / h) * s.system.M() - s.system.constant_hessian();
  s.make_rhs(u_before, h);
  s.solver->forget();
  const grids::FieldSet& rhs = s.rhs;
  if (const Status status =
          s.solver->solve(s.matrix, step_conditions(s.system, h), rhs.pointers(), s.middle.pointers(), s.border);
      status != Status::success) {
    return status;
  }
  for (int f = 0; f < s.system.field_count(); ++f) {
    const auto u_0 = u_before.field(f);
    const auto u_1 = u_after.field(f);
    const auto middle = s.middle.field(f);
    for (std::size_t i = 0; i < u_1.size(); ++i) {
      u_1[i] = structure.at_midpoints(f) ? middle[i] : 2.0 * middle[i] - u_0[i];
    }
  }
  return Status::success;
}

grids::FieldSet random_tangent(const MultisymplecticSystem& system, const grids::Grid& grid, std::uint64_t seed) {
  constexpr int waves = 4;
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> amplitude(-1.0, 1.0);
  std::uniform_real_distribution<double> phase(0.0, 2.0 * std::numbers::pi);
  std::uniform_int_distribution<int> wave(1, 3);
  grids::FieldSet tangent(system.field_count(), grid.size());
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
          angle += k[axis] * static_cast<double>(rest % grid.cells(axis)) / static_cast<double>(grid.cells(axis));
          rest /= grid.cells(axis);
        }
        values[i] += a * std::sin(angle);
      }
    }
  }
  return tangent;
}

}  // namespace rubato
