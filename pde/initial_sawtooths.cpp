#include <rubato/pde/initial_sawtooths.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <utility>

#include <rubato/base/limits.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/grids/whole.hpp>
#include <rubato/pde/still_waves.hpp>
#include <rubato/pde/tuning.hpp>
#include <rubato/solve/small_matrices.hpp>

namespace rubato {

namespace {

using namespace tuning::sawtooths;

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

class Removal {
public:
  Removal(const MultisymplecticSystem& system, const grids::Grid& grid, Collocation collocation,
          const std::vector<int>& computed, const MatrixXd& left)
      : system_(system),
        grid_(grid),
        computed_(computed),
        left_(left),
        waves_(grid, collocation, free_directions(system, left)),
        lines_(grid.size() / grid.cells(0)) {
    if (left.cols() > 0 && waves_.patterns().size() > 1) {
      sweep_.emplace(system, grid, collocation);
      residual_ = grids::FieldSet(system.field_count(), grid.size());
      hessian_ = grids::FieldSet(static_cast<int>(system.varying_hessian().size()), grid.size());
    }
  }

  void operator()(LatticeLevel& level) {
    for (std::size_t p = 1; sweep_ && p < waves_.patterns().size(); ++p) {
      for (int pass = 0; pass < most_passes; ++pass) {
        const SweepResult result = (*sweep_)(std::as_const(level.fields).pointers(), level.slopes, {}, 0.0,
                                             residual_.pointers(), hessian_.pointers());
        if (!result.finite || !step(level, waves_.patterns()[p])) {
          break;  // the constraints' own iteration shows what is wrong
        }
      }
    }
  }

private:
  static std::array<bool, 2> free_directions(const MultisymplecticSystem& system, const MatrixXd& left) {
    std::array<bool, 2> free{};
    for (int a = 1; a < system.directions(); ++a) {
      free[static_cast<std::size_t>(a) - 1] =
          solve::annihilates(system.K(a).cast<std::complex<double>>(), left.cast<std::complex<double>>());
    }
    return free;
  }

  /// The gradient of lᵀ∇S with respect to the given fields, in the mean over the grid.
  [[nodiscard]] MatrixXd gradient() const {
    MatrixXd hessian = system_.constant_hessian();
    for (std::size_t e = 0; e < system_.varying_hessian().size(); ++e) {
      const auto [row, column] = system_.varying_hessian()[e];
      hessian(row, column) = hessian(column, row) =
          grids::sum(hessian_.field(static_cast<int>(e))) / static_cast<double>(grids::whole_of(grid_).size());
    }
    MatrixXd result = solve::product(hessian, left_);
    for (Index f = 0; f < result.rows(); ++f) {
      const auto field = static_cast<int>(f);
      if (std::ranges::find(computed_, field) != computed_.end() ||
          system_.structure().multiplier[static_cast<std::size_t>(f)]) {
        result.row(f).setZero();
      }
    }
    return result;
  }

  /// Calls visit(node, group, sign) for every node; of those of other ranks for none.
  template <typename Visit>
  void for_each_node(unsigned pattern, const Visit& visit) const {
    const double next = StillWaves::alternates_along_x(pattern) ? -1.0 : 1.0;
    for (std::size_t line = 0; line < lines_; ++line) {
      if (!waves_.owns(line)) {
        continue;
      }
      double sign = waves_.sign_of(pattern, line);
      for (std::size_t i = 0; i < grid_.cells(0); ++i, sign *= next) {
        visit(line * grid_.cells(0) + i, static_cast<Index>(waves_.group_of(line)), sign);
      }
    }
  }

  /// \return whether the amplitudes of a pattern were changed by more than rounding
  bool step(LatticeLevel& level, unsigned pattern) {
    const MatrixXd slope = gradient();
    MatrixXd sums = MatrixXd::Zero(left_.cols(), static_cast<Index>(lines_));
    for_each_node(pattern, [&](std::size_t node, Index group, double sign) {
      for (Index r = 0; r < left_.rows(); ++r) {
        for (Index b = 0; b < left_.cols(); ++b) {
          sums(b, group) += sign * left_(r, b) * std::as_const(residual_).field(static_cast<int>(r))[node];
        }
      }
    });
    waves_.add_ranks({sums.data(), static_cast<std::size_t>(sums.size())}, static_cast<std::size_t>(sums.rows()));
    sums /= static_cast<double>(waves_.members());
    const auto amplitudes =
        solve::quotient(solve::product(slope.transpose(), slope), sums, epsilon * static_cast<double>(slope.cols()));
    if (!amplitudes) {
      return false;
    }
    const MatrixXd change = -solve::product(slope, *amplitudes);
    bool changed = false;
    if (!grids::agreed_by_all(grid_, change.allFinite())) {
      return false;
    }
    const grids::Slab* const slab = grids::Slab::of(grid_);
    for (int f = 0; f < system_.field_count(); ++f) {
      double size = change.row(f).cwiseAbs().maxCoeff();
      size = slab == nullptr ? size : slab->largest_over_ranks(size);
      if (size <= no_amplitude * grids::max_abs(std::as_const(level.fields).field(f))) {
        continue;
      }
      changed = true;
      const auto values = level.fields.field(f);
      for_each_node(pattern,
                    [&](std::size_t node, Index group, double sign) { values[node] += sign * change(f, group); });
    }
    return changed;
  }

  const MultisymplecticSystem& system_;
  const grids::Grid& grid_;
  const std::vector<int>& computed_;
  const MatrixXd& left_;
  StillWaves waves_;
  std::size_t lines_;
  std::optional<CellSweep> sweep_;
  grids::FieldSet residual_, hessian_;
};

}  // namespace

void remove_sawtooths(const MultisymplecticSystem& system, const grids::Grid& grid, Collocation collocation,
                      const std::vector<int>& computed, const MatrixXd& left, LatticeLevel& level) {
  Removal(system, grid, collocation, computed, left)(level);
}

}  // namespace rubato
