#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/formula/batch.hpp>
#include <rubato/grids/box_operators.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/pde/lattice_scheme.hpp>

namespace rubato {

namespace {

constexpr int most_iterations = 50;

/// The equation of `row` at one level gives `field` there, node by node; `rate` is the entry of M₊ that multiplies its
/// increment (0 for a constraint).
struct LocalSolve {
  int row = 0;
  int field = 0;
  double rate = 0.0;
};

/// An entry of M₊: the equation of `row` at a level gives `column` at the next.
struct Kick {
  int row = 0;
  int column = 0;
  double value = 0.0;
};

class EulerBoxScheme final : public LatticeScheme {
public:
  EulerBoxScheme(const MultisymplecticSystem& system, const grids::Grid& grid, const InitialFields& given)
      : system_(system),
        grid_(grid),
        level_{grids::FieldSet(system.field_count(), grid.size()), {}},
        trial_(level_.fields),
        outputs_(static_cast<int>(system.hessian_code().output_count()), grid.size()),
        space_(1, grid.size()),
        scratch_(space_),
        evaluate_(system.hessian_code()) {
    plan();
    start(given);
  }

  [[nodiscard]] const MultisymplecticSystem& system() const override { return system_; }
  [[nodiscard]] const grids::Grid& grid() const override { return grid_; }
  [[nodiscard]] const LatticeLevel& level() const override { return level_; }

  [[nodiscard]] Status advance(double h, double) override {
    trial_.copy_from(level_.fields);
    evaluate(level_.fields);
    for (const Kick& kick : kicks_) {
      space_terms(level_.fields, kick.row);
      const auto out = trial_.field(kick.column);
      for (std::size_t i = 0; i < out.size(); ++i) {
        out[i] += h / kick.value * space_.field(0)[i];
      }
    }
    for (const LocalSolve& solve : solves_) {
      if (const Status status = run(solve, h, trial_, level_.fields); status != Status::success) {
        return status;
      }
    }
    energy_ = energy_of(level_.fields);
    slope_ = (energy_of(trial_) - energy_) / h;
    return std::isfinite(slope_) ? Status::success : Status::undefined;
  }

  [[nodiscard]] double discrete_energy() const override { return energy_; }
  [[nodiscard]] double discrete_energy_slope() const override { return slope_; }
  [[nodiscard]] LevelNode node() override { return {energy_of(level_.fields), 0.0}; }
  [[nodiscard]] LevelNode trial_node() override { return {energy_of(trial_), 0.0}; }
  [[nodiscard]] int iterations() const override { return iterations_; }

  void accept() override {
    level_.fields.copy_from(trial_);
    iterations_ = 0;
  }
  void save(StateWriter& state) const override { state.write(level_.fields.all()); }
  void restore(StateReader& state) override { state.read(level_.fields.all()); }

private:
  /// Finds an order in which each equation of a level has one unknown, which it holds at the node itself.
  void plan() {
    const auto& M_plus = system_.structure().M_plus;
    const int d = system_.field_count();
    std::vector<bool> known(static_cast<std::size_t>(d), false);
    std::vector<bool> used(static_cast<std::size_t>(d), false);
    for (int r = 0; r < d; ++r) {
      for (int c = 0; c < d; ++c) {
        if (M_plus(r, c) == 0.0) {
          continue;
        }
        if ((M_plus.row(r).array() != 0.0).count() > 1 || (M_plus.col(c).array() != 0.0).count() > 1 ||
            !M_plus.col(r).isZero(0.0)) {
          refuse(fmt::format("its part M+ of M couples {} to more than one field",
                             system_.fields()[static_cast<std::size_t>(r)]));
        }
        kicks_.push_back({r, c, M_plus(r, c)});
        known[static_cast<std::size_t>(c)] = true;
        used[static_cast<std::size_t>(r)] = true;
      }
    }
    order_solves(known, used, solves_);
    // At the start every field with an equation of motion is known, and the constraints give the rest.
    for (int f = 0; f < d; ++f) {
      const bool algebraic = system_.structure().algebraic[static_cast<std::size_t>(f)];
      known[static_cast<std::size_t>(f)] = used[static_cast<std::size_t>(f)] = !algebraic;
    }
    order_solves(known, used, start_solves_);
  }

  [[nodiscard]] double rate_of(int row, int field) const { return system_.structure().M_plus(field, row); }

  [[nodiscard]] bool local(int row, int field) const {
    if (rate_of(row, field) != 0.0 || system_.constant_hessian()(row, field) != 0.0) {
      return true;
    }
    return std::ranges::any_of(system_.varying_hessian(), [&](const HessianEntry& e) {
      return (e.row == row && e.column == field) || (e.row == field && e.column == row);
    });
  }

  [[nodiscard]] bool across(int row, int field) const {
    return std::ranges::any_of(system_.structure().K_plus, [&](const Eigen::MatrixXd& plus) {
      return plus(row, field) != 0.0 || plus(field, row) != 0.0;
    });
  }

  void order_solves(std::vector<bool> known, std::vector<bool> used, std::vector<LocalSolve>& solves) const {
    const int d = system_.field_count();
    for (bool progress = true; progress;) {
      progress = false;
      for (int r = 0; r < d; ++r) {
        std::vector<int> unknown;
        for (int f = 0; f < d; ++f) {
          if (!known[static_cast<std::size_t>(f)] && (local(r, f) || across(r, f))) {
            unknown.push_back(f);
          }
        }
        if (!used[static_cast<std::size_t>(r)] && unknown.size() == 1 && !across(r, unknown[0])) {
          solves.push_back({r, unknown[0], rate_of(r, unknown[0])});
          known[static_cast<std::size_t>(unknown[0])] = used[static_cast<std::size_t>(r)] = progress = true;
        }
      }
    }
    std::vector<std::string> left;
    for (int f = 0; f < d; ++f) {
      if (!known[static_cast<std::size_t>(f)]) {
        left.push_back(system_.fields()[static_cast<std::size_t>(f)]);
      }
    }
    if (!left.empty()) {
      refuse(fmt::format("no equation gives {} at a level node by node", fmt::join(left, ", ")));
    }
  }

  [[noreturn]] static void refuse(const std::string& reason) {
    throw std::invalid_argument(
        fmt::format("euler-box is not explicit for this system: {}; use lagrangian = \"box\" or \"fourier\"", reason));
  }

  void start(const InitialFields& given) {
    if (given.size() != system_.fields().size()) {
      throw std::invalid_argument(
          fmt::format("initial data for {} fields; the system has {}", given.size(), system_.fields().size()));
    }
    for (int f = 0; f < system_.field_count(); ++f) {
      const auto& values = given[static_cast<std::size_t>(f)];
      const auto& name = system_.fields()[static_cast<std::size_t>(f)];
      if (!values && !system_.structure().algebraic[static_cast<std::size_t>(f)]) {
        throw std::invalid_argument(fmt::format("no initial data for {}", name));
      }
      if (values && values->size() != grid_.size()) {
        throw std::invalid_argument(
            fmt::format("the initial {} has {} values; the grid has {} nodes", name, values->size(), grid_.size()));
      }
      if (values && !std::ranges::all_of(*values, [](double x) { return std::isfinite(x); })) {
        throw std::invalid_argument(fmt::format("the initial {} is not finite everywhere", name));
      }
      if (values) {
        std::ranges::copy(*values, level_.fields.field(f).begin());
      }
    }
    for (const LocalSolve& solve : start_solves_) {
      if (run(solve, 1.0, level_.fields, level_.fields) != Status::success) {
        throw std::invalid_argument(fmt::format("the constraints of the initial level could not be solved for {}",
                                                system_.fields()[static_cast<std::size_t>(solve.field)]));
      }
    }
  }

  void evaluate(const grids::FieldSet& fields) {
    evaluate_(grid_.size(), fields.pointers(), outputs_.pointers());
    ++iterations_;
  }

  /// space_ = [∇S - K₊δ⁺z + K₊ᵀδ⁻z] of one row, ∇S as last evaluated.
  void space_terms(const grids::FieldSet& fields, int row) {
    const auto out = space_.field(0);
    std::ranges::copy(outputs_.field(1 + row), out.begin());
    const auto scratch = scratch_.field(0);
    for (int a = 0; a < grid_.dimensions(); ++a) {
      const auto& plus = system_.structure().K_plus[static_cast<std::size_t>(a)];
      grids::BoxOperator difference{grids::Along::identity, grids::Along::identity, grids::Along::identity};
      difference[static_cast<std::size_t>(a)] = grids::Along::difference;
      for (int f = 0; f < system_.field_count(); ++f) {
        if (plus(row, f) != 0.0) {
          grids::apply(grid_, difference, fields.field(f).data(), scratch.data());
          add(-plus(row, f), scratch, out);
        }
        if (plus(f, row) != 0.0) {  // δ⁻ is minus the adjoint of δ⁺
          grids::apply_adjoint(grid_, difference, fields.field(f).data(), scratch.data());
          add(-plus(f, row), scratch, out);
        }
      }
    }
  }

  static void add(double factor, std::span<const double> in, std::span<double> out) {
    for (std::size_t i = 0; i < out.size(); ++i) {
      out[i] += factor * in[i];
    }
  }

  /// Newton at every node for [∇S - K₊δ⁺z + K₊ᵀδ⁻z]_row + rate (z - z_before)/h = 0, in the one field.
  [[nodiscard]] Status run(const LocalSolve& solve, double h, grids::FieldSet& fields, const grids::FieldSet& before) {
    const auto& varying = system_.varying_hessian();
    int entry = -1;
    for (std::size_t e = 0; e < varying.size(); ++e) {
      if ((varying[e].row == solve.row && varying[e].column == solve.field) ||
          (varying[e].row == solve.field && varying[e].column == solve.row)) {
        entry = static_cast<int>(e);
      }
    }
    const double constant = system_.constant_hessian()(solve.row, solve.field) + solve.rate / h;
    double last = std::numeric_limits<double>::infinity();
    for (int iteration = 0; iteration < most_iterations; ++iteration) {
      evaluate(fields);
      space_terms(fields, solve.row);
      const auto values = fields.field(solve.field);
      const auto old = before.field(solve.field);
      double change = 0.0;
      for (std::size_t i = 0; i < values.size(); ++i) {
        const double derivative = constant + (entry < 0 ? 0.0 : outputs_.field(1 + system_.field_count() + entry)[i]);
        const double residual = space_.field(0)[i] + solve.rate / h * (values[i] - old[i]);
        const double correction = residual / derivative;
        values[i] -= correction;
        change = std::abs(correction) > change || std::isnan(correction) ? std::abs(correction) : change;
      }
      if (!std::isfinite(change)) {
        return Status::undefined;
      }
      const double scale = grids::max_abs(values);
      if (change <= 1e-15 * scale || (change <= 1e-10 * scale && change >= 0.5 * last)) {
        return Status::success;
      }
      last = change;
    }
    return Status::not_converged;
  }

  /// Σ ΔV [S - Σ_a zᵀK₊δ_a⁺z].
  double energy_of(const grids::FieldSet& fields) {
    evaluate(fields);
    double sum = grids::sum(outputs_.field(0));
    for (int a = 0; a < grid_.dimensions(); ++a) {
      const auto& plus = system_.structure().K_plus[static_cast<std::size_t>(a)];
      grids::BoxOperator difference{grids::Along::identity, grids::Along::identity, grids::Along::identity};
      difference[static_cast<std::size_t>(a)] = grids::Along::difference;
      for (int r = 0; r < system_.field_count(); ++r) {
        for (int c = 0; c < system_.field_count(); ++c) {
          if (plus(r, c) != 0.0) {
            grids::apply(grid_, difference, fields.field(c).data(), scratch_.field(0).data());
            sum -= plus(r, c) * grids::dot(fields.field(r), scratch_.field(0));
          }
        }
      }
    }
    return grid_.cell_volume() * sum;
  }

  MultisymplecticSystem system_;
  grids::Grid grid_;
  LatticeLevel level_;
  grids::FieldSet trial_;
  grids::FieldSet outputs_;  ///< S, ∇S and the varying entries of S'' as last evaluated
  grids::FieldSet space_, scratch_;
  formula::BatchEvaluator evaluate_;
  std::vector<Kick> kicks_;
  std::vector<LocalSolve> solves_, start_solves_;
  double energy_ = 0.0;
  double slope_ = 0.0;
  int iterations_ = 0;
};

}  // namespace

std::unique_ptr<LatticeScheme> make_euler_box_scheme(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                     const InitialFields& initial) {
  if (system.directions() != grid.dimensions()) {
    throw std::invalid_argument(
        fmt::format("the system has {} space direction(s), the grid {}", system.directions(), grid.dimensions()));
  }
  return std::make_unique<EulerBoxScheme>(system, grid, initial);
}

}  // namespace rubato
