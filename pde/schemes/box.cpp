#include <utility>

#include <rubato/grids/fourier.hpp>
#include <rubato/pde/lattice_actions.hpp>
#include <rubato/pde/lattice_method.hpp>

namespace rubato {

namespace {

class BoxMethod final : public LatticeMethod {
public:
  [[nodiscard]] std::optional<OtherCount> other_count(std::size_t cells, int dimensions) const override {
    if (cells % 2 != 0) {
      return std::nullopt;
    }
    // In planes and volumes there are transforms, which like small prime factors.
    constexpr std::size_t largest_plane = 1'000'000;
    return OtherCount{dimensions > 1 && cells < largest_plane ? grids::good_odd_count(cells) : cells + 1,
                      "averaging annihilates the sawtooth of an even one, which then is undetermined or frozen"};
  }
  [[nodiscard]] bool laws_in_cells() const override { return true; }
  [[nodiscard]] std::optional<LatticeAction> action(const MultisymplecticSystem& system) const override {
    return box_action(system);
  }
  [[nodiscard]] InitialLevel first_level(const MultisymplecticSystem& system, const grids::Grid& grid,
                                         const InitialFields& given) const override {
    return prepare_initial_level(system, grid, given, Placement::cells);
  }
  [[nodiscard]] std::unique_ptr<LatticeScheme> scheme(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                      LatticeLevel first, double first_step) const override {
    return make_box_scheme(system, grid, std::move(first), first_step);
  }
  [[nodiscard]] std::unique_ptr<LawEngine> laws(LawTables tables) const override {
    return make_face_laws(std::move(tables), Placement::cells);
  }
  [[nodiscard]] std::unique_ptr<StepEquation> equation(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                       const LatticeLevel& first, double first_step) const override {
    return make_midpoint_equation(system, grid, Placement::cells, first, first_step);
  }
  [[nodiscard]] std::unique_ptr<TangentStep> tangents(const MultisymplecticSystem& system,
                                                      const grids::Grid& grid) const override {
    return make_box_tangents(system, grid);
  }
};

}  // namespace

LatticeMethodEntry box_method() {
  return {.name = "box",
          .summary = "midpoint in space and time, local; odd numbers of cells",
          .make = [](const LatticeMethodChoice&) -> std::unique_ptr<LatticeMethod> {
            return std::make_unique<BoxMethod>();
          }};
}

}  // namespace rubato
