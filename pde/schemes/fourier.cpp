#include <memory>
#include <optional>
#include <utility>

#include <rubato/pde/gauss_step.hpp>
#include <rubato/pde/lattice_actions.hpp>
#include <rubato/pde/lattice_method.hpp>

namespace rubato {

namespace {

/// One stage is the midpoint rule, whose laws and equation two levels give; more are of stages.
class FourierMethod final : public LatticeMethod {
public:
  explicit FourierMethod(int stages) : stages_(stages) {}

  [[nodiscard]] int order() const override { return 2 * stages_; }
  [[nodiscard]] bool has_transforms(int /*dimensions*/) const override { return true; }
  [[nodiscard]] std::optional<LatticeAction> action(const MultisymplecticSystem& system) const override {
    return stages_ == 1 ? std::optional(fourier_action(system)) : std::nullopt;
  }
  [[nodiscard]] bool has_variational_laws() const override { return false; }
  [[nodiscard]] std::optional<Collocation> in_mirror() const override { return Collocation::nodes; }
  [[nodiscard]] std::string_view not_shared_in(int dimensions) const override {
    return dimensions > 1 ? "" : "its transforms along a line take the whole of it";
  }
  [[nodiscard]] bool begins_in_parts(const MultisymplecticSystem& system,
                                     const std::vector<bool>& given) const override {
    return system.directions() > 1 && determines_no_given_field(system, given);
  }
  [[nodiscard]] InitialLevel first_level(const MultisymplecticSystem& system, const grids::Grid& grid,
                                         const InitialFields& given) const override {
    return prepare_initial_level(system, grid, given, Collocation::nodes);
  }
  [[nodiscard]] std::unique_ptr<ConstrainedFields> constrained_fields(const MultisymplecticSystem& system,
                                                                      const grids::Grid& grid) const override {
    return make_constrained_fields(system, grid, Collocation::nodes);
  }
  [[nodiscard]] std::unique_ptr<LatticeScheme> scheme(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                      LatticeLevel first, double /*first_step*/) const override {
    return make_gauss_lattice(system, grid, stages_, std::move(first));
  }
  [[nodiscard]] std::unique_ptr<LawEvaluator> laws(LawTables tables) const override {
    if (stages_ == 1) {
      return make_node_laws(std::move(tables), Collocation::nodes);
    }
    auto stages = make_gauss_stages(tables.system, tables.grid, stages_);
    return make_node_laws(std::move(tables), Collocation::nodes, std::move(stages));
  }
  [[nodiscard]] std::unique_ptr<StepEquation> equation(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                       const LatticeLevel& first, double first_step) const override {
    return stages_ == 1 ? make_midpoint_equation(system, grid, Collocation::nodes, first, first_step)
                        : make_gauss_equation(system, grid, stages_, first);
  }
  [[nodiscard]] std::unique_ptr<TangentStep> tangents(const MultisymplecticSystem&, const grids::Grid&) const override {
    return nullptr;
  }

private:
  int stages_;
};

}  // namespace

LatticeMethodEntry fourier_method() {
  return {.name = "fourier",
          .summary = "spectral in space, Gauss collocation in time (one stage: midpoint)",
          .has_stages = true,
          .make = [](const LatticeMethodChoice& choice) -> std::unique_ptr<LatticeMethod> {
            return std::make_unique<FourierMethod>(choice.stages);
          }};
}

}  // namespace rubato
