#include <string>
#include <utility>
#include <vector>

#include <rubato/grids/fourier.hpp>
#include <rubato/pde/gauss_step.hpp>
#include <rubato/pde/kernel_conditions.hpp>
#include <rubato/pde/lattice_actions.hpp>
#include <rubato/pde/lattice_method.hpp>
#include <rubato/pde/mirrored_method.hpp>
#include <rubato/pde/mirrors.hpp>
#include <rubato/pde/wall_conditions.hpp>
#include <rubato/pde/wall_data.hpp>
#include <rubato/solve/cyclic_parts.hpp>

namespace rubato {

namespace {

/// Gauss collocation in space and time (Reich 2000). With one stage each it is the box scheme, local and with a node
/// law, and closes its rows at walls of a line (WallConditions) with any number of cells.
class BoxMethod final : public LatticeMethod {
public:
  explicit BoxMethod(const LatticeMethodChoice& choice, bool has_walls = false)
      : stages_(choice.stages), space_{.stages = choice.space_stages}, has_walls_(has_walls), drives_(choice.drives) {}

  [[nodiscard]] int order() const override { return 2 * stages_; }
  [[nodiscard]] bool has_variational_laws() const override { return is_box() && !has_walls_; }
  [[nodiscard]] std::optional<OtherCount> other_count(std::size_t cells, int dimensions) const override {
    const std::string_view objection = space_rule_objection(space_, cells);
    if (objection.empty() || has_walls_) {
      return std::nullopt;
    }
    constexpr std::size_t largest_plane = 1'000'000;
    const auto stages = static_cast<std::size_t>(space_.stages);
    const std::size_t elements = (cells + stages - 1) / stages;
    const bool transforms = has_transforms(dimensions) && cells < largest_plane;
    return OtherCount{stages * (transforms ? grids::good_odd_count(elements) : elements + 1 - elements % 2), objection};
  }
  [[nodiscard]] bool has_transforms(int dimensions) const override { return dimensions > 1 || !is_box(); }
  [[nodiscard]] std::string_view other_dimensions(int dimensions) const override {
    return dimensions > 1 && space_.stages > 1
               ? "several stages in space are made for a line; leave space_stages out, or write lagrangian = "
                 "\"fourier\", which is spectral in every direction"
               : "";
  }
  [[nodiscard]] bool laws_in_cells() const override { return true; }
  [[nodiscard]] std::string_view not_shared_in(int dimensions) const override {
    return has_walls_                   ? "between walls one process solves all cells"
           : dimensions > 1 || is_box() ? ""
                                        : "with stages its transforms along a line take the whole of it";
  }
  /// Laws of a node read the cell before it; cells the node after.
  [[nodiscard]] grids::Ghosts ghosts(const MultisymplecticSystem& /*system*/) const override { return {1, 1}; }
  /// Elimination on a line has pieces of its own.
  [[nodiscard]] std::vector<std::size_t> parts(const MultisymplecticSystem& system, const grids::Grid& whole, double h,
                                               int ranks) const override {
    if (whole.dimensions() > 1) {
      return {};
    }
    return solve::cyclic_parts(box_unknowns(system, h), whole.cells(0), ranks).first_cells.front();
  }
  [[nodiscard]] bool begins_in_parts(const MultisymplecticSystem& system,
                                     const std::vector<bool>& given) const override {
    return system.directions() > 1 && determines_no_given_field(system, given);
  }
  [[nodiscard]] std::optional<LatticeAction> action(const MultisymplecticSystem& system) const override {
    return is_box() ? std::optional(box_action(system)) : std::nullopt;
  }
  /// Of cells: see make_box_between_walls().
  [[nodiscard]] std::optional<Collocation> in_mirror() const override {
    return is_box() ? std::optional(Collocation::cells) : std::nullopt;
  }
  [[nodiscard]] InitialLevel first_level(const MultisymplecticSystem& system, const grids::Grid& grid,
                                         const InitialFields& given) const override {
    if (!has_walls_) {
      return prepare_initial_level(system, grid, given, collocation());
    }
    static_cast<void>(WallConditions(system, grid, drives_));  // which refuses what it cannot close
    InitialFields met = given;
    // Of the mirrors, the signs alone.
    std::vector<std::string> cautions = meet_walls(system, {system, grid, Collocation::nodes, 1}, met, drives_);
    return {prepare_initial_level(system, grid, met, collocation()).level, std::move(cautions)};
  }
  [[nodiscard]] std::unique_ptr<ConstrainedFields> constrained_fields(const MultisymplecticSystem& system,
                                                                      const grids::Grid& grid) const override {
    return make_constrained_fields(system, grid, collocation());
  }
  [[nodiscard]] std::unique_ptr<LatticeScheme> scheme(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                      LatticeLevel first, double first_step) const override {
    if (has_walls_ && step_conditions(system, first_step).count() > 0) {
      throw SchemeRefusal(
          "box between walls cannot hold the potential of this equation: leave left and right out of [grid]");
    }
    return is_box() ? make_box_scheme(system, grid, std::move(first), first_step, drives_)
                    : make_gauss_lattice(system, grid, stages_, std::move(first), space_);
  }
  [[nodiscard]] std::unique_ptr<LawEvaluator> laws(LawTables tables) const override {
    if (is_box()) {
      return make_edge_laws(std::move(tables), Collocation::cells);
    }
    auto stages = make_gauss_stages(tables.system, tables.grid, stages_, space_);
    return make_edge_laws(std::move(tables), collocation(), std::move(stages));
  }
  [[nodiscard]] std::unique_ptr<StepEquation> equation(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                       const LatticeLevel& first, double first_step) const override {
    return is_box() ? make_midpoint_equation(system, grid, Collocation::cells, first, first_step, drives_)
                    : make_gauss_equation(system, grid, stages_, first, space_);
  }
  [[nodiscard]] std::unique_ptr<TangentStep> tangents(const MultisymplecticSystem& system,
                                                      const grids::Grid& grid) const override {
    return has_walls_ ? nullptr
           : is_box() ? make_box_tangents(system, grid)
                      : make_gauss_tangents(system, grid, stages_, space_);
  }

private:
  [[nodiscard]] bool is_box() const { return stages_ == 1 && space_.stages == 1; }
  [[nodiscard]] Collocation collocation() const { return Collocation::elements(space_.stages); }

  int stages_;
  SpaceRule space_;
  bool has_walls_;
  std::shared_ptr<const WallDrives> drives_;
};

}  // namespace

std::unique_ptr<LatticeMethod> make_box_between_walls(const LatticeMethodChoice& choice) {
  return std::make_unique<BoxMethod>(choice, true);
}

LatticeMethodEntry box_method() {
  return {.name = "box",
          .summary = "Gauss collocation in space and time (one stage each: midpoint, local); odd numbers of cells",
          .has_stages = true,
          .has_space_stages = true,
          .make = [](const LatticeMethodChoice& choice) -> std::unique_ptr<LatticeMethod> {
            return std::make_unique<BoxMethod>(choice);
          }};
}

}  // namespace rubato
