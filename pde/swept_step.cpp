#include <algorithm>
#include <stdexcept>
#include <utility>
#include <vector>

#include <rubato/grids/fourier.hpp>
#include <rubato/pde/periodic_step.hpp>

namespace rubato {

namespace {

using Eigen::Index;
using Eigen::VectorXd;

class SweptStep final : public PeriodicStep {
public:
  SweptStep(const MultisymplecticSystem& system, const grids::Grid& grid, Collocation collocation)
      : system_(system),
        grid_(grid),
        places_(system, grid),
        sweep_(system, grid, collocation),
        point_(system.field_count(), grid.size()),
        delta_(point_),
        rows_(point_),
        hessian_(static_cast<int>(system.varying_hessian().size()), grid.size()) {
    make_operators(collocation);
  }

  bool evaluate(const grids::FieldSet& before, const grids::FieldSet& after, double h, const PotentialSlopes& slopes,
                grids::FieldSet& rows, double& energy) override {
    set_middle(before, after);
    h_ = h;
    slopes_ = slopes;
    const SweepResult result = sweep_(std::as_const(point_).pointers(), slopes_, std::as_const(delta_).pointers(),
                                      1.0 / h_, rows.pointers(), {});
    std::ranges::transform(rows.all(), rows.all().begin(), [](double minus) { return -minus; });
    energy = result.energy;
    return result.finite;
  }

  void linearise(const VectorXd&, LinearisedStep& step) override {
    sweep_(std::as_const(point_).pointers(), slopes_, std::as_const(delta_).pointers(), 1.0 / h_, rows_.pointers(),
           hessian_.pointers());
    keep_rows(step);
    keep_energy(step);
  }

private:
  struct Entry {
    Index node;
    double value;
  };
  using Operator = std::vector<std::vector<Entry>>;  ///< of each point, what it reads at nodes

  void make_operators(Collocation collocation) {
    const Index n = places_.nodes();
    mean_.resize(grid_.size());
    difference_.resize(grid_.size());
    if (collocation == Collocation::cells) {
      const double inverse = 1.0 / grid_.spacing(0);
      for (Index i = 0; i < n; ++i) {
        mean_[static_cast<std::size_t>(i)] = {{i, 0.5}, {(i + 1) % n, 0.5}};
        difference_[static_cast<std::size_t>(i)] = {{i, -inverse}, {(i + 1) % n, inverse}};
      }
      return;
    }
    std::vector<double> unit(grid_.size(), 0.0), column(grid_.size());
    unit[0] = 1.0;
    const grids::SpectralDerivative derivative(grid_);
    derivative(0, unit.data(), column.data());
    for (Index i = 0; i < n; ++i) {
      mean_[static_cast<std::size_t>(i)] = {{i, 1.0}};
      for (Index j = 0; j < n; ++j) {
        difference_[static_cast<std::size_t>(i)].push_back({j, column[static_cast<std::size_t>((i - j + n) % n)]});
      }
    }
  }

  /// z̄, and δ, which is 0 of fields in ker M.
  void set_middle(const grids::FieldSet& before, const grids::FieldSet& after) {
    for (int f = 0; f < system_.field_count(); ++f) {
      const std::span<const double> z_0 = before.field(f), z_1 = after.field(f);
      const std::span<double> middle = point_.field(f), delta = delta_.field(f);
      for (std::size_t i = 0; i < middle.size(); ++i) {
        middle[i] = places_.in_kernel(f) ? z_0[i] : 0.5 * (z_0[i] + z_1[i]);
        delta[i] = places_.in_kernel(f) ? 0.0 : z_1[i] - z_0[i];
      }
    }
  }

  [[nodiscard]] double hessian(int row, int field, std::size_t point) const {
    const auto& varying = system_.varying_hessian();
    for (std::size_t e = 0; e < varying.size(); ++e) {
      if ((varying[e].row == row && varying[e].column == field) ||
          (varying[e].row == field && varying[e].column == row)) {
        return hessian_.field(static_cast<int>(e))[point];
      }
    }
    return system_.constant_hessian()(row, field);
  }

  /// M A δ/h of a row at a point.
  [[nodiscard]] double rate(int row, std::size_t point) const {
    double sum = 0.0;
    for (int f = 0; f < system_.field_count(); ++f) {
      for (const Entry& entry : mean_[point]) {
        sum += system_.M()(row, f) * entry.value * delta_.field(f)[static_cast<std::size_t>(entry.node)] / h_;
      }
    }
    return sum;
  }

  void keep_rows(LinearisedStep& step) const {
    std::vector<Eigen::Triplet<double>> before, after;
    step.by_h = VectorXd::Zero(places_.size());
    for (int r = 0; r < system_.field_count(); ++r) {
      for (int f = 0; f < system_.field_count(); ++f) {
        const double M = system_.M()(r, f) / h_, K = system_.K(0)(r, f);
        const bool in_kernel = places_.in_kernel(f);
        const auto add = [&](Index row, const Entry& entry, double middle, double rate) {
          const double share = in_kernel ? 1.0 : 0.5;
          if (const double value = share * middle + rate; value != 0.0) {
            after.emplace_back(row, places_(f, entry.node), entry.value * value);
          }
          if (const double value = share * middle - rate; value != 0.0 && !in_kernel) {
            before.emplace_back(row, places_(f, entry.node), entry.value * value);
          }
        };
        for (Index i = 0; i < places_.nodes(); ++i) {
          const auto point = static_cast<std::size_t>(i);
          for (const Entry& entry : mean_[point]) {
            add(places_(r, i), entry, -hessian(r, f, point), M);
          }
          for (const Entry& entry : difference_[point]) {
            add(places_(r, i), entry, K, 0.0);
          }
        }
      }
      for (Index i = 0; i < places_.nodes(); ++i) {
        step.by_h[places_(r, i)] = -rate(r, static_cast<std::size_t>(i)) / h_;
      }
    }
    step.before.resize(places_.size(), places_.moving());
    step.before.setFromTriplets(before.begin(), before.end());
    step.after.resize(places_.size(), places_.size());
    step.after.setFromTriplets(after.begin(), after.end());
  }

  /// ∇S - K D z̄ = M A δ/h - R is the first variation of E_k by the middle of the step. E_k does not name h.
  void keep_energy(LinearisedStep& step) const {
    step.energy_before = VectorXd::Zero(places_.moving());
    step.energy_after = VectorXd::Zero(places_.size());
    for (int f = 0; f < system_.field_count(); ++f) {
      for (Index i = 0; i < places_.nodes(); ++i) {
        const auto point = static_cast<std::size_t>(i);
        const double force = rate(f, point) + rows_.field(f)[point];  // which has -R
        for (const Entry& entry : mean_[point]) {
          const double value = grid_.cell_volume() * force * entry.value;
          step.energy_after[places_(f, entry.node)] += places_.in_kernel(f) ? value : 0.5 * value;
          if (!places_.in_kernel(f)) {
            step.energy_before[places_(f, entry.node)] += 0.5 * value;
          }
        }
      }
    }
    step.energy_by_h = 0.0;
  }

  const MultisymplecticSystem& system_;
  grids::Grid grid_;
  LevelPlaces places_;
  Operator mean_, difference_;
  CellSweep sweep_;
  grids::FieldSet point_, delta_, rows_, hessian_;  ///< of the step that was evaluated last
  PotentialSlopes slopes_;
  double h_ = 0.0;
};

}  // namespace

LevelPlaces::LevelPlaces(const MultisymplecticSystem& system, const grids::Grid& grid)
    : nodes_(static_cast<Index>(grid.size())) {
  const std::vector<bool>& algebraic = system.structure().algebraic;
  const auto count = static_cast<Index>(std::ranges::count(algebraic, true));
  if (system.structure().kernel.cols() != count) {
    throw std::invalid_argument(
        "a combination of fields has no equation of motion: take other fields, of which it is one");
  }
  evolving_ = system.field_count() - count;
  Index moving = 0, still = evolving_;
  for (const bool is_still : algebraic) {
    places_.push_back(is_still ? still++ : moving++);
  }
}

std::unique_ptr<PeriodicStep> make_swept_step(const MultisymplecticSystem& system, const grids::Grid& grid,
                                              Collocation collocation) {
  if (grid.dimensions() != 1 || grid.has_walls() || collocation == Collocation::corners || collocation.has_elements()) {
    throw std::invalid_argument(
        "periodic orbits are of one periodic dimension, by the box scheme or fourier with one stage");
  }
  return std::make_unique<SweptStep>(system, grid, collocation);
}

}  // namespace rubato
