#pragma once

#include <array>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <rubato/grids/slab.hpp>
#include <rubato/pde/lattice_scheme.hpp>
#include <rubato/pde/law_evaluator.hpp>
#include <rubato/pde/local_laws.hpp>
#include <rubato/pde/step_equation.hpp>
#include <rubato/pde/tangent.hpp>
#include <rubato/pde/wall_drives.hpp>
#include <rubato/variation/corner_density.hpp>
#include <rubato/variation/lattice_action.hpp>

namespace rubato {

/// Derivatives in space: spectral, or differences of neighbours.
inline constexpr std::array<std::string_view, 2> space_words = {"fourier", "differences"};

/// A level that is given beside the first one, h after it.
struct SecondLevel {
  InitialFields fields;
  double h = 0.0;
};

/// What a problem says of the scheme it wants.
struct LatticeMethodChoice {
  std::string name = "box";                                ///< of lattice_methods()
  int stages = 1;                                          ///< of Gauss collocation in time, where the method has them
  std::string composition = "golden";                      ///< of compositions(), where the method has them
  std::string space = "fourier";                           ///< of space_words, where the method has a choice
  int space_stages = 1;                                    ///< of Gauss collocation in space, where the method has them
  std::shared_ptr<const CornerDensity> density = nullptr;  ///< of custom
  std::shared_ptr<const SecondLevel> next = nullptr;       ///< of custom, where it is given
  std::shared_ptr<const WallDrives> drives = nullptr;      ///< null where no wall drives a field
};

/// A discretisation of M z_t + Σ_a K_a z_{x_a} = ∇S(z), with all that the integrator, the check of records, the
/// reports and the program's help ask of it. One file of `pde/schemes/` states each; the caller that uses one knows
/// this interface alone.
class LatticeMethod {
public:
  LatticeMethod() = default;
  LatticeMethod(const LatticeMethod&) = delete;
  LatticeMethod& operator=(const LatticeMethod&) = delete;
  virtual ~LatticeMethod() = default;

  /// The order s in time.
  [[nodiscard]] virtual int order() const { return 2; }
  /// Why levels cannot be variable; empty where they can.
  [[nodiscard]] virtual std::string_view fixed_levels_only() const { return {}; }
  /// The number of cells to take in place of `cells`, and why, where the method cannot take that one.
  struct OtherCount {
    std::size_t cells = 0;
    std::string_view reason;
  };
  [[nodiscard]] virtual std::optional<OtherCount> other_count(std::size_t cells, int dimensions) const;
  /// True if it takes transforms, whose time depends on the prime factors of the numbers of cells.
  [[nodiscard]] virtual bool has_transforms(int /*dimensions*/) const { return false; }
  /// The number of cells nearest to `wanted` that the method takes; where it has transforms, one without prime factors
  /// beyond 7. Of two equally near numbers the larger one.
  [[nodiscard]] std::size_t count_near(std::size_t wanted, int dimensions) const;
  /// Why the method cannot be taken in so many dimensions, and what to do; empty where it can.
  [[nodiscard]] virtual std::string_view other_dimensions(int /*dimensions*/) const { return {}; }
  /// True if there are values in the middle of steps: see MultisymplecticSystem::at_levels.
  [[nodiscard]] virtual bool has_midpoints(const MultisymplecticSystem& /*system*/) const { return true; }
  /// The system as the method has it.
  [[nodiscard]] MultisymplecticSystem seen(const MultisymplecticSystem& system) const {
    return has_midpoints(system) ? system : system.at_levels();
  }
  /// True if local laws live in the middle of cells; else at nodes.
  [[nodiscard]] virtual bool laws_in_cells() const { return false; }

  /// The collocation with which the scheme is the same in a mirror, for walls; nothing where it is not.
  [[nodiscard]] virtual std::optional<Collocation> in_mirror() const { return std::nullopt; }
  /// How many ghosts beyond each wall are enough for a step, its energies and its laws on the short ring (Mirrors);
  /// 0 for schemes that need the whole one.
  [[nodiscard]] virtual std::size_t wall_ghosts(const MultisymplecticSystem& /*system*/) const { return 0; }

  /// Where ranks share a lattice (grids::Slab).
  ///@{
  /// Why they cannot in so many dimensions; empty where they can.
  [[nodiscard]] virtual std::string_view not_shared_in(int /*dimensions*/) const { return {}; }
  /// How many planes of its neighbours each has to know of two levels to take a step, its energies and its laws from
  /// them. \throws as scheme()
  [[nodiscard]] virtual grids::Ghosts ghosts(const MultisymplecticSystem& /*system*/) const { return {}; }
  /// The first plane of each rank's part, and how many there are, for steps of length h; none: any parts will do.
  /// \throws std::invalid_argument if there are too many ranks
  [[nodiscard]] virtual std::vector<std::size_t> parts(const MultisymplecticSystem& /*system*/,
                                                       const grids::Grid& /*whole*/, double /*h*/,
                                                       int /*ranks*/) const {
    return {};
  }
  /// True if each rank makes first_level() of its part, where these fields are given: not where what is given has to
  /// agree with what others determine, nor where fields are missing.
  [[nodiscard]] virtual bool begins_in_parts(const MultisymplecticSystem& system, const std::vector<bool>& given) const;
  ///@}

  /// The discrete action that states the scheme; nothing for a family of maps that has its K in place of one (theory,
  /// section 8).
  [[nodiscard]] virtual std::optional<LatticeAction> action(const MultisymplecticSystem& system) const = 0;
  /// True if varying the places of single nodes gives local laws: not where the action joins all nodes of a level.
  [[nodiscard]] virtual bool has_variational_laws() const { return true; }

  /// \throws std::invalid_argument as prepare_initial_level()
  [[nodiscard]] virtual InitialLevel first_level(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                 const InitialFields& given) const = 0;
  /// What gives the fields without an equation of motion of its levels. \throws as first_level()
  [[nodiscard]] virtual std::unique_ptr<ConstrainedFields> constrained_fields(const MultisymplecticSystem& system,
                                                                              const grids::Grid& grid) const = 0;
  /// \throws std::invalid_argument if the method cannot take this system or grid, with the remedy
  [[nodiscard]] virtual std::unique_ptr<LatticeScheme> scheme(const MultisymplecticSystem& system,
                                                              const grids::Grid& grid, LatticeLevel first,
                                                              double first_step) const = 0;
  /// The local laws between two levels.
  [[nodiscard]] virtual std::unique_ptr<LawEvaluator> laws(LawTables tables) const = 0;
  /// What two levels leave of the scheme's equation. `first` and `first_step` are those of the run.
  [[nodiscard]] virtual std::unique_ptr<StepEquation> equation(const MultisymplecticSystem& system,
                                                               const grids::Grid& grid, const LatticeLevel& first,
                                                               double first_step) const = 0;
  /// The step of solutions of the linearised scheme; nothing where there is no local law of two of them.
  [[nodiscard]] virtual std::unique_ptr<TangentStep> tangents(const MultisymplecticSystem& system,
                                                              const grids::Grid& grid) const = 0;
};

/// A method by name.
struct LatticeMethodEntry {
  std::string_view name;
  std::string_view summary;  ///< half a line, for the program's help
  bool has_stages = false;
  bool has_space_stages = false;
  bool has_compositions = false;
  bool has_space = false;
  std::unique_ptr<LatticeMethod> (*make)(const LatticeMethodChoice& choice) = nullptr;
};

/// All that are built in, the default first: pde/schemes/registry.inc.
[[nodiscard]] std::span<const LatticeMethodEntry> lattice_methods();
/// The one beside them, whose action the problem states.
[[nodiscard]] const LatticeMethodEntry& custom_lattice_method();
/// \throws std::invalid_argument for a name that is not there, with the list
[[nodiscard]] const LatticeMethodEntry& lattice_method_entry(std::string_view name);
/// \throws std::invalid_argument for a name that is not there, stages, a composition or a `space` that it cannot have
[[nodiscard]] std::unique_ptr<LatticeMethod> make_lattice_method(const LatticeMethodChoice& choice);
/// The same on a grid, which may have walls. \throws also SchemeRefusal if the method cannot have them
[[nodiscard]] std::unique_ptr<LatticeMethod> make_lattice_method(const LatticeMethodChoice& choice,
                                                                 const grids::Grid& grid);

/// The local laws of a method, which has to outlive them. \throws std::invalid_argument if one of `symmetries` is none
[[nodiscard]] LocalLaws make_local_laws(const LatticeMethod& method, const MultisymplecticSystem& system,
                                        const grids::Grid& grid, const std::vector<LinearSymmetry>& symmetries = {});

}  // namespace rubato
