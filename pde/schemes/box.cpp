#include <utility>

#include <rubato/grids/fourier.hpp>
#include <rubato/pde/gauss_slab.hpp>
#include <rubato/pde/lattice_actions.hpp>
#include <rubato/pde/lattice_method.hpp>

namespace rubato {

namespace {

/// On cells the midpoint in space; in time one stage is the midpoint rule, local and with a node law, more are Gauss
/// collocation.
class BoxMethod final : public LatticeMethod {
public:
  explicit BoxMethod(int stages) : stages_(stages) {}

  [[nodiscard]] int order() const override { return 2 * stages_; }
  [[nodiscard]] bool has_bridges() const override { return stages_ == 1; }
  [[nodiscard]] bool has_variational_laws() const override { return stages_ == 1; }
  [[nodiscard]] std::optional<OtherCount> other_count(std::size_t cells, int dimensions) const override {
    if (cells % 2 != 0) {
      return std::nullopt;
    }
    // In planes and volumes, and with several stages, there are transforms, which like small prime factors.
    constexpr std::size_t largest_plane = 1'000'000;
    return OtherCount{
        (dimensions > 1 || stages_ > 1) && cells < largest_plane ? grids::good_odd_count(cells) : cells + 1,
        "averaging annihilates the sawtooth of an even one, which then is undetermined or frozen"};
  }
  [[nodiscard]] bool laws_in_cells() const override { return true; }
  [[nodiscard]] std::optional<LatticeAction> action(const MultisymplecticSystem& system) const override {
    return stages_ == 1 ? std::optional(box_action(system)) : std::nullopt;
  }
  [[nodiscard]] InitialLevel first_level(const MultisymplecticSystem& system, const grids::Grid& grid,
                                         const InitialFields& given) const override {
    return prepare_initial_level(system, grid, given, Placement::cells);
  }
  [[nodiscard]] std::unique_ptr<LatticeScheme> scheme(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                      LatticeLevel first, double first_step) const override {
    return stages_ == 1 ? make_box_scheme(system, grid, std::move(first), first_step)
                        : make_gauss_lattice(system, grid, stages_, std::move(first), {.stages = 1});
  }
  [[nodiscard]] std::unique_ptr<LawEngine> laws(LawTables tables) const override {
    if (stages_ == 1) {
      return make_face_laws(std::move(tables), Placement::cells);
    }
    auto stages = make_gauss_stages(tables.system, tables.grid, stages_, {.stages = 1});
    return make_stage_laws(std::move(tables), std::move(stages), Placement::cells);
  }
  [[nodiscard]] std::unique_ptr<StepEquation> equation(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                       const LatticeLevel& first, double first_step) const override {
    return stages_ == 1 ? make_midpoint_equation(system, grid, Placement::cells, first, first_step)
                        : make_gauss_equation(system, grid, stages_, first, {.stages = 1});
  }
  [[nodiscard]] std::unique_ptr<TangentStep> tangents(const MultisymplecticSystem& system,
                                                      const grids::Grid& grid) const override {
    return stages_ == 1 ? make_box_tangents(system, grid) : nullptr;
  }

private:
  int stages_;
};

}  // namespace

LatticeMethodEntry box_method() {
  return {.name = "box",
          .summary = "midpoint in space, Gauss collocation in time (one stage: midpoint, local); odd numbers of cells",
          .has_stages = true,
          .make = [](const LatticeMethodChoice& choice) -> std::unique_ptr<LatticeMethod> {
            return std::make_unique<BoxMethod>(choice.stages);
          }};
}

}  // namespace rubato
