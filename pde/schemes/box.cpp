#include <utility>

#include <rubato/grids/fourier.hpp>
#include <rubato/pde/gauss_step.hpp>
#include <rubato/pde/lattice_actions.hpp>
#include <rubato/pde/lattice_method.hpp>
#include <rubato/solve/cyclic_parts.hpp>

namespace rubato {

namespace {

/// Gauss collocation in space and time (Reich 2000). With one stage each it is the box scheme, local and with a node
/// law.
class BoxMethod final : public LatticeMethod {
public:
  BoxMethod(int stages, int space_stages) : stages_(stages), space_{.stages = space_stages} {}

  [[nodiscard]] int order() const override { return 2 * stages_; }
  [[nodiscard]] bool has_variational_laws() const override { return is_box(); }
  [[nodiscard]] std::optional<OtherCount> other_count(std::size_t cells, int dimensions) const override {
    const std::string_view objection = space_rule_objection(space_, cells);
    if (objection.empty()) {
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
    return dimensions > 1 || is_box() ? "" : "with stages its transforms along a line take the whole of it";
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
  /// Of cells, which close their rows at walls themselves.
  [[nodiscard]] std::optional<Collocation> in_mirror() const override {
    return is_box() ? std::optional(Collocation::cells) : std::nullopt;
  }
  [[nodiscard]] InitialLevel first_level(const MultisymplecticSystem& system, const grids::Grid& grid,
                                         const InitialFields& given) const override {
    return prepare_initial_level(system, grid, given, collocation());
  }
  [[nodiscard]] std::unique_ptr<ConstrainedFields> constrained_fields(const MultisymplecticSystem& system,
                                                                      const grids::Grid& grid) const override {
    return make_constrained_fields(system, grid, collocation());
  }
  [[nodiscard]] std::unique_ptr<LatticeScheme> scheme(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                      LatticeLevel first, double first_step) const override {
    return is_box() ? make_box_scheme(system, grid, std::move(first), first_step)
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
    return is_box() ? make_midpoint_equation(system, grid, Collocation::cells, first, first_step)
                    : make_gauss_equation(system, grid, stages_, first, space_);
  }
  [[nodiscard]] std::unique_ptr<TangentStep> tangents(const MultisymplecticSystem& system,
                                                      const grids::Grid& grid) const override {
    return is_box() ? make_box_tangents(system, grid) : make_gauss_tangents(system, grid, stages_, space_);
  }

private:
  [[nodiscard]] bool is_box() const { return stages_ == 1 && space_.stages == 1; }
  [[nodiscard]] Collocation collocation() const { return Collocation::elements(space_.stages); }

  int stages_;
  SpaceRule space_;
};

}  // namespace

LatticeMethodEntry box_method() {
  return {.name = "box",
          .summary = "Gauss collocation in space and time (one stage each: midpoint, local); odd numbers of cells",
          .has_stages = true,
          .has_space_stages = true,
          .make = [](const LatticeMethodChoice& choice) -> std::unique_ptr<LatticeMethod> {
            return std::make_unique<BoxMethod>(choice.stages, choice.space_stages);
          }};
}

}  // namespace rubato
