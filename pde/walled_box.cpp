#include <rubato/pde/walled_box.hpp>

#include <string>
#include <utility>
#include <vector>

#include <rubato/pde/kernel_conditions.hpp>
#include <rubato/pde/lattice_actions.hpp>
#include <rubato/pde/mirrors.hpp>
#include <rubato/pde/wall_conditions.hpp>
#include <rubato/pde/wall_data.hpp>

namespace rubato {

namespace {

class WalledBoxMethod final : public LatticeMethod {
public:
  explicit WalledBoxMethod(std::shared_ptr<const WallDrives> drives) : drives_(std::move(drives)) {}

  [[nodiscard]] bool has_variational_laws() const override { return false; }
  [[nodiscard]] bool laws_in_cells() const override { return true; }
  [[nodiscard]] std::string_view not_shared_in(int) const override {
    return "between walls one process solves all cells";
  }
  [[nodiscard]] std::optional<LatticeAction> action(const MultisymplecticSystem& system) const override {
    return box_action(system);
  }
  [[nodiscard]] InitialLevel first_level(const MultisymplecticSystem& system, const grids::Grid& grid,
                                         const InitialFields& given) const override {
    static_cast<void>(WallConditions(system, grid, drives_));  // which refuses what it cannot close
    InitialFields met = given;
    // Of the mirrors, the signs alone.
    std::vector<std::string> cautions = meet_walls(system, {system, grid, Collocation::nodes, 1}, met, drives_);
    return {prepare_initial_level(system, grid, met, Collocation::cells).level, std::move(cautions)};
  }
  [[nodiscard]] std::unique_ptr<ConstrainedFields> constrained_fields(const MultisymplecticSystem& system,
                                                                      const grids::Grid& grid) const override {
    return make_constrained_fields(system, grid, Collocation::cells);
  }
  [[nodiscard]] std::unique_ptr<LatticeScheme> scheme(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                      LatticeLevel first, double first_step) const override {
    if (step_conditions(system, first_step).count() > 0) {
      throw SchemeRefusal(
          "box between walls cannot hold the potential of this equation: leave left and right out of [grid]");
    }
    return make_box_scheme(system, grid, std::move(first), first_step, drives_);
  }
  [[nodiscard]] std::unique_ptr<LawEvaluator> laws(LawTables tables) const override {
    return make_edge_laws(std::move(tables), Collocation::cells);
  }
  [[nodiscard]] std::unique_ptr<StepEquation> equation(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                       const LatticeLevel& first, double first_step) const override {
    return make_midpoint_equation(system, grid, Collocation::cells, first, first_step, drives_);
  }
  [[nodiscard]] std::unique_ptr<TangentStep> tangents(const MultisymplecticSystem&, const grids::Grid&) const override {
    return nullptr;
  }

private:
  std::shared_ptr<const WallDrives> drives_;
};

}  // namespace

std::unique_ptr<LatticeMethod> make_walled_box_method(const LatticeMethodChoice& choice) {
  return std::make_unique<WalledBoxMethod>(choice.drives);
}

}  // namespace rubato
