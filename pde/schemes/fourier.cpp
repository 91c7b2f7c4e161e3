#include <utility>

#include <rubato/pde/lattice_actions.hpp>
#include <rubato/pde/lattice_method.hpp>

namespace rubato {

namespace {

class FourierMethod final : public LatticeMethod {
public:
  [[nodiscard]] std::optional<LatticeAction> action(const MultisymplecticSystem& system) const override {
    return fourier_action(system);
  }
  [[nodiscard]] bool has_variational_laws() const override { return false; }
  [[nodiscard]] InitialLevel first_level(const MultisymplecticSystem& system, const grids::Grid& grid,
                                         const InitialFields& given) const override {
    return prepare_initial_level(system, grid, given, Placement::nodes);
  }
  [[nodiscard]] std::unique_ptr<LatticeScheme> scheme(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                      LatticeLevel first, double first_step) const override {
    return make_fourier_scheme(system, grid, std::move(first), first_step);
  }
  [[nodiscard]] std::unique_ptr<LawEngine> laws(LawTables tables) const override {
    return make_face_laws(std::move(tables), Placement::nodes);
  }
  [[nodiscard]] std::unique_ptr<StepEquation> equation(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                       const LatticeLevel& first, double first_step) const override {
    return make_midpoint_equation(system, grid, Placement::nodes, first, first_step);
  }
  [[nodiscard]] std::unique_ptr<TangentStep> tangents(const MultisymplecticSystem&, const grids::Grid&) const override {
    return nullptr;
  }
};

}  // namespace

LatticeMethodEntry fourier_method() {
  return {.name = "fourier",
          .summary = "spectral in space, midpoint in time",
          .make = [](const LatticeMethodChoice&) -> std::unique_ptr<LatticeMethod> {
            return std::make_unique<FourierMethod>();
          }};
}

}  // namespace rubato
