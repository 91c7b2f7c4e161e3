#include <algorithm>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/grids/reductions.hpp>
#include <rubato/pde/action_consistency.hpp>
#include <rubato/pde/action_scheme.hpp>
#include <rubato/pde/euler_box_map.hpp>
#include <rubato/pde/lattice_method.hpp>
#include <rubato/pde/shared_slopes.hpp>
#include <rubato/variation/corner_differences.hpp>

namespace rubato {

namespace {

/// What is wrong with L is a refusal of the scheme.
template <class Make>
auto refused(const Make& make) {
  try {
    return make();
  } catch (const SchemeRefusal&) {
    throw;
  } catch (const std::invalid_argument& error) {
    throw SchemeRefusal(error.what());
  }
}

/// On this collocation the constraints of the equation give fields before the rows of the action do.
Collocation collocation_of_constraints(const grids::Grid& grid) {
  if (grid.has_ghosts()) {
    return Collocation::corners;
  }
  const auto box = make_lattice_method({.name = "box"});
  bool is_odd = true;
  for (int a = 0; a < grid.dimensions(); ++a) {
    is_odd = is_odd && !box->other_count(grid.cells(a), grid.dimensions());
  }
  return is_odd ? Collocation::cells : Collocation::nodes;
}

/// By the constraints of the equation, then, as far as they give fields, by the rows of the action.
class ActionConstraints final : public ConstrainedFields {
public:
  ActionConstraints(const MultisymplecticSystem& system, const grids::Grid& grid, const CornerDensity& density)
      : stated_(state_action(system, density)),
        of_equation_(make_constrained_fields(system, grid, collocation_of_constraints(grid))),
        system_(system),
        grid_(grid) {}

  [[nodiscard]] Status find(LatticeLevel& level) override {
    if (const Status status = of_equation_->find(level); status != Status::success) {
      return status;
    }
    if (!step_) {
      stated_.typical = typical_values(level);
      step_.emplace(system_, grid_, stated_, grid_.spacing(0));
    }
    step_->constrain(grid_.spacing(0), level);
    return Status::success;
  }

private:
  StatedAction stated_;
  std::unique_ptr<ConstrainedFields> of_equation_;
  MultisymplecticSystem system_;
  grids::Grid grid_;
  std::optional<ActionStep> step_;
};

/// The scheme of a density that the problem states.
class CustomMethod final : public LatticeMethod {
public:
  explicit CustomMethod(const LatticeMethodChoice& choice)
      : density_(choice.density),
        next_(choice.next),
        drives_(choice.drives),
        reads_one_level_(density_->energy_reads_one_level()) {
    for (int f = 0; f < density_->fields; ++f) {
      if (density_->names(f)) {
        named_.push_back(f);
      }
    }
  }

  [[nodiscard]] std::string_view fixed_levels_only() const override {
    return reads_one_level_
               ? "the discrete energy -d(h L)/dh, or a row of the variation of L, reads one level alone, so "
                 "that no length of the next step follows from it"
               : "";
  }
  /// Fields that a constraint which is not linear binds are at midpoints if L reads means of them.
  [[nodiscard]] bool has_midpoints(const MultisymplecticSystem& system) const override {
    for (int f = 0; f < system.field_count(); ++f) {
      if (system.structure().nonlinear[static_cast<std::size_t>(f)] && !density_->reads_middle(f)) {
        return false;
      }
    }
    return true;
  }
  [[nodiscard]] bool laws_in_cells() const override { return names_all() && !reads_one_level_; }
  /// Where laws are at nodes. That L is the same in the mirror is for its reader to see to.
  [[nodiscard]] std::optional<Collocation> in_mirror() const override {
    return laws_in_cells() ? std::nullopt : std::optional(Collocation::corners);
  }
  [[nodiscard]] std::size_t wall_ghosts(const MultisymplecticSystem& system) const override {
    constexpr std::size_t of_laws = 3, few_cells = 8;
    if (next_ || laws_in_cells()) {
      return 0;
    }
    std::vector<grids::Axis> axes;
    for (int a = 0; a < system.directions(); ++a) {
      axes.push_back({std::string(1, static_cast<char>('a' + a)), 0.0, 1.0, few_cells});
    }
    const grids::Grid grid(std::move(axes));
    try {
      static_cast<void>(EulerBoxMap(system, grid));  // which makes the first level
      const ActionStep step(system, grid, state_action(system, *density_), grid.spacing(0));
      return step.is_explicit() && step.rows().begins_from_one_level() ? std::max(of_laws, step.lost_at_walls()) : 0;
    } catch (const std::invalid_argument&) {
      return 0;
    }
  }
  [[nodiscard]] std::string_view not_shared_in(int) const override {
    return "the rows of a stated action are solved on the whole lattice";
  }
  [[nodiscard]] std::optional<LatticeAction> action(const MultisymplecticSystem& system) const override {
    return corner_action(*density_, system.structure().at_midpoints(), system.structure().potential);
  }
  [[nodiscard]] InitialLevel first_level(const MultisymplecticSystem& system, const grids::Grid& grid,
                                         const InitialFields& given) const override {
    InitialLevel level = prepare_initial_level(system, grid, given, collocation_of_constraints(grid));
    const double h = grid.spacing(0);
    refused([&] {
      StatedAction stated = state_action(system, *density_);
      stated.typical = typical_values(level.level);
      ActionStep step(system, grid, stated, h);
      step.constrain(h, level.level);
      for (int f = 0; f < system.field_count(); ++f) {
        if (system.structure().at_midpoints(f)) {
          std::ranges::fill(level.level.fields.field(f), 0.0);  // as readers of a record have it
        }
      }
      if (const std::vector<std::string> held = step.held(); !held.empty()) {
        level.cautions.push_back(fmt::format("L leaves {} undetermined, and steps hold {}", fmt::join(held, ", "),
                                             held.size() == 1 ? "it" : "them"));
      }
      check_slopes(system, grid, level.level);
      if (const ActionConsistency found = consistency_of(system, stated); !found.wrong.empty()) {
        level.cautions.push_back(
            fmt::format("L does not approximate the equation: the variation by {} does not approach the row of {} in "
                        "M z_t + K z_x = grad S as steps and cells get smaller",
                        fmt::join(found.wrong, ", "), found.wrong.size() == 1 ? "it" : "them"));
      } else if (!found.is_tested) {
        level.cautions.emplace_back(
            "whether L approximates the equation could not be tested: a field that L leaves out has no row of the "
            "equation that gives it, or L is not defined at the values of the test; see by rubato converge");
      }
      return 0;
    });
    return level;
  }
  [[nodiscard]] std::unique_ptr<ConstrainedFields> constrained_fields(const MultisymplecticSystem& system,
                                                                      const grids::Grid& grid) const override {
    return std::make_unique<ActionConstraints>(system, grid, *density_);
  }
  [[nodiscard]] std::unique_ptr<LatticeScheme> scheme(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                      LatticeLevel first, double first_step) const override {
    return refused([&] {
      const StatedAction stated = stated_near(system, first);
      return make_action_scheme(system, grid, stated, next_, std::move(first), first_step);
    });
  }
  [[nodiscard]] std::unique_ptr<LawEvaluator> laws(LawTables tables) const override {
    return make_action_laws(laws_in_cells() ? make_edge_laws(std::move(tables), Collocation::cells)
                                            : make_node_laws(std::move(tables), Collocation::corners),
                            named_);
  }
  [[nodiscard]] std::unique_ptr<StepEquation> equation(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                       const LatticeLevel& first, double first_step) const override {
    return make_action_equation(system, grid, stated_near(system, first), next_, first, first_step);
  }
  [[nodiscard]] std::unique_ptr<TangentStep> tangents(const MultisymplecticSystem& system,
                                                      const grids::Grid& grid) const override {
    return make_action_tangents(system, grid, state_action(system, *density_));
  }

private:
  [[nodiscard]] StatedAction stated_near(const MultisymplecticSystem& system, const LatticeLevel& level) const {
    StatedAction stated = state_action(system, *density_, drives_);
    stated.typical = typical_values(level);
    return stated;
  }
  /// A potential that L reads itself has its periodic part there alone.
  void check_slopes(const MultisymplecticSystem& system, const grids::Grid& grid, const LatticeLevel& level) const {
    constexpr double rounding = 1e-14;
    const CornerDensity read = by_differences(*density_, system.structure().potential);
    for (int f = 0; f < system.field_count(); ++f) {
      const double slope = largest_slope(level.slopes, static_cast<std::size_t>(f), grid);
      const double largest = grids::max_abs(level.fields.field(f));
      if (density_->names(f) && slope * grid.spacing(0) > rounding * largest && !reads_differences(read, f)) {
        throw SchemeRefusal(
            fmt::format("L reads {0} itself, whose mean slope is {1:.3g}, so that it is another one in each period: "
                        "write L with differences of {0}",
                        system.fields()[static_cast<std::size_t>(f)], slope));
      }
    }
  }
  [[nodiscard]] bool names_all() const { return static_cast<int>(named_.size()) == density_->fields; }
  std::shared_ptr<const CornerDensity> density_;
  std::shared_ptr<const SecondLevel> next_;
  std::shared_ptr<const WallDrives> drives_;
  std::vector<int> named_;
  bool reads_one_level_;
};

}  // namespace

const LatticeMethodEntry& custom_lattice_method() {
  static const LatticeMethodEntry entry{
      .name = "custom",
      .summary = "a discrete action that the problem states: L, of the values at the corners of a cell",
      .make = [](const LatticeMethodChoice& choice) -> std::unique_ptr<LatticeMethod> {
        if (choice.density == nullptr) {
          throw std::invalid_argument("lagrangian = \"custom\" needs L, the density of the discrete action");
        }
        return std::make_unique<CustomMethod>(choice);
      }};
  return entry;
}

}  // namespace rubato
