#include <array>
#include <utility>
#include <vector>

#include <rubato/pde/periodic_step.hpp>
#include <rubato/pde/wave_splitting.hpp>

namespace rubato {

namespace {

using Eigen::Index;
using Eigen::VectorXd;

class SplitStep final : public PeriodicStep {
public:
  SplitStep(const MultisymplecticSystem& system, const grids::Grid& grid, const Composition& composition,
            Collocation collocation)
      : composition_(composition),
        places_(system, grid),
        fields_(system.field_count()),
        splitting_(system, grid, collocation),
        level_{.fields = grids::FieldSet(fields_, grid.size()), .slopes = {}},
        begin_(level_.fields),
        end_(level_.fields) {
    splitting_.check(composition);
  }

  bool evaluate(const grids::FieldSet& before, const grids::FieldSet& after, double h, const PotentialSlopes& slopes,
                grids::FieldSet& rows, double& energy) override {
    level_.fields.copy_from(before);
    level_.slopes = slopes;
    h_ = h;
    const bool finite = step(h);
    energy = splitting_.generator();
    for (int f = 0; f < fields_; ++f) {
      const bool is_moving = !places_.in_kernel(f);
      const std::span<const double> z_0 = before.field(f), z_1 = after.field(f);
      for (std::size_t i = 0; i < z_0.size(); ++i) {
        rows.field(f)[i] = is_moving ? z_1[i] - std::as_const(end_).field(f)[i] : z_0[i] - mean(f, i);
      }
    }
    return finite;
  }

  void linearise(const VectorXd& scales, LinearisedStep& step) override {
    constexpr double width = 1e-3;  // its fourth power is the error, and rounding errors are a thousandfold
    Eigen::MatrixXd columns(places_.size(), places_.moving());
    step.energy_before.resize(places_.moving());
    for (int f = 0; f < fields_; ++f) {
      for (Index i = 0; i < places_.nodes() && !places_.in_kernel(f); ++i) {
        double& value = level_.fields.field(f)[static_cast<std::size_t>(i)];
        const double there = value, by = width * scales[f];
        const Index column = places_(f, i);
        const VectorXd derivative = difference(by, [&](double moved) {
          value = there + moved;
          static_cast<void>(this->step(h_));
        });
        value = there;
        columns.col(column) = derivative.head(places_.size());
        step.energy_before[column] = derivative[places_.size()];
      }
    }
    const VectorXd by_h = difference(width * h_, [&](double moved) { static_cast<void>(this->step(h_ + moved)); });
    step.before = (-columns).sparseView();
    step.by_h = -by_h.head(places_.size());
    step.energy_by_h = by_h[places_.size()];
    step.energy_after = VectorXd::Zero(places_.size());
    step.after.resize(places_.size(), places_.size());
    step.after.setIdentity();
  }

private:
  /// From level_ to end_; begin_ is level_ with the fields in ker M that it has. \return whether all is finite
  bool step(double h) {
    splitting_.stand(level_);
    splitting_.fields_here(begin_);
    const bool finite = splitting_.step(composition_, h);
    splitting_.fields(end_);
    return finite;
  }
  [[nodiscard]] double mean(int field, std::size_t node) const {
    return 0.5 * (begin_.field(field)[node] + end_.field(field)[node]);
  }
  /// Adds x_{k+1}, y_k and E_k of the step taken last.
  void add(double factor, VectorXd& sum) const {
    for (int f = 0; f < fields_; ++f) {
      for (Index i = 0; i < places_.nodes(); ++i) {
        const auto node = static_cast<std::size_t>(i);
        sum[places_(f, i)] += factor * (places_.in_kernel(f) ? mean(f, node) : end_.field(f)[node]);
      }
    }
    sum[places_.size()] += factor * splitting_.generator();
  }
  /// (8 (f(d) - f(-d)) - f(2d) + f(-2d))/12d
  template <class StepAt>
  VectorXd difference(double d, const StepAt& step_at) {
    VectorXd sum = VectorXd::Zero(places_.size() + 1);
    for (const auto& [times, factor] : {std::pair(1.0, 8.0), {-1.0, -8.0}, {2.0, -1.0}, {-2.0, 1.0}}) {
      step_at(times * d);
      add(factor / (12.0 * d), sum);
    }
    return sum;
  }

  const Composition& composition_;
  LevelPlaces places_;
  int fields_;
  WaveSplitting splitting_;
  LatticeLevel level_;  ///< where the step begins
  grids::FieldSet begin_, end_;
  double h_ = 0.0;
};

}  // namespace

std::unique_ptr<PeriodicStep> make_split_step(const MultisymplecticSystem& system, const grids::Grid& grid,
                                              const Composition& composition, Collocation collocation) {
  return std::make_unique<SplitStep>(system, grid, composition, collocation);
}

}  // namespace rubato
