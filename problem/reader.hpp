#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include <rubato/figures/statistics.hpp>
#include <rubato/problem/document.hpp>
#include <rubato/problem/problem.hpp>

namespace rubato {
struct Composition;
struct MultisymplecticForm;
}  // namespace rubato

namespace rubato {

/// A table being read: remembers which keys were asked for, so that finish() can refuse all others.
class Section {
public:
  /// `name` is what messages call it, such as "[scheme]"; empty for the whole file.
  Section(const Value::Table& table, Location location, std::string name);

  /// The entry called `key`, if it is there. The key has to be in the table of keys (keys.hpp), which is what people
  /// are reported.
  const Entry* take(std::string_view key);
  /// The same for a key of an earlier version, which is in no table of keys.
  const Entry* take_outdated(std::string_view key);
  /// The same for an entry that must be there; `purpose` says what it is for.
  const Entry& require(std::string_view key, std::string_view purpose);
  /// The table called `key`, if it is there; an entry of another type is an error.
  std::optional<Section> take_section(std::string_view key);
  /// \throws ProblemError at the first key that nobody asked for, with the nearest of those that were
  void finish() const;

  /// Has `table` in place of the entries; what was asked for stays asked for.
  void rewrite(Value::Table table);

  /// Keeps a value that stands for a part of another, as long as the section.
  const Value& keep(Value value) { return *kept_.emplace_back(std::make_shared<const Value>(std::move(value))); }

  [[nodiscard]] const Location& location() const { return location_; }
  [[nodiscard]] const Value::Table& entries() const { return *table_; }
  [[nodiscard]] const std::string& name() const { return name_; }

private:
  const Value::Table* table_;
  Location location_;
  std::string name_;
  std::unordered_map<std::string_view, const Entry*> entries_;
  std::vector<std::string> known_;
  std::vector<std::shared_ptr<const Value>> kept_;
};

/// "expected …, got …", at the value.
[[noreturn]] void wrong_type(const Value& value, std::string_view what, std::string_view expected);

[[nodiscard]] const std::string& read_string(const Value& value, std::string_view what);
[[nodiscard]] bool read_boolean(const Value& value, std::string_view what);
[[nodiscard]] const Value::Array& read_array(const Value& value, std::string_view what, std::string_view of);
/// A formula given as a string or as a number.
[[nodiscard]] FormulaText read_formula(const Value& value, std::string_view what);
/// A finite number, given as a number or as a formula of the parameters.
[[nodiscard]] double read_number(const Value& value, std::string_view what, const Parameters& parameters);
/// The same, with an integer value from `least` on: any written as an integer, a formula's up to 2^53.
[[nodiscard]] std::int64_t read_integer(const Value& value, std::string_view what, const Parameters& parameters,
                                        std::int64_t least);
/// One of `words`; the answer is its place among them.
[[nodiscard]] std::size_t read_word(const Value& value, std::string_view what, std::span<const std::string_view> words);

/// Why a name may not be used.
inline constexpr std::string_view malformed_name = "a name is a letter or _, then letters, digits and _";
inline constexpr std::string_view name_of_record = "records have something else of that name";
/// \throws ProblemError "… cannot name …: reason" at the entry's key; `role` is such as "an invariant"
[[noreturn]] void refuse_name(const Entry& entry, std::string_view role, std::string_view reason);

/// The names of a problem, which must all be distinct.
class Names {
public:
  /// Sets a name aside; `reason` completes "… cannot name a coordinate: it …".
  void reserve(std::string_view name, std::string_view reason);
  /// The integers of [parameters], by which vectors may be as long: "r[N]".
  void know_sizes(const Section& root);
  [[nodiscard]] std::optional<std::int64_t> size(std::string_view name) const;
  /// \throws ProblemError if the name is malformed, reserved, or declared before; `role` is such as "a coordinate"
  void declare(std::string_view name, std::string_view role, const Location& location);

private:
  std::map<std::string, std::string, std::less<>> taken_;  ///< with the reason why it may not be used again
  std::map<std::string, std::int64_t, std::less<>> sizes_;
};

/// The names of a lattice's problem before it declares any: t, the coordinates of the grid and dx, dy, dz are taken.
[[nodiscard]] Names names_of_lattice(const Section& root);

/// True if it matches `[A-Za-z_][A-Za-z0-9_]*`.
[[nodiscard]] bool is_identifier(std::string_view name);

/// Names as the user lists them, with vectors such as "r[3]", which stands for r1, r2, r3.
struct NameList {
  struct Group {
    std::string base;
    std::size_t first;
    std::size_t count;
    bool is_vector;
  };
  std::vector<Group> groups;
  std::vector<std::string> names;
};

/// Reads and declares a list of names; `role` is such as "a coordinate".
[[nodiscard]] NameList read_names(const Value& value, std::string_view what, std::string_view role, Names& names);

/// The values given in `section` for the names of `list`: `r = [..]` or `r1 = .., r2 = ..`, not both. Those left out
/// are null.
[[nodiscard]] std::vector<const Value*> take_values(Section& section, const NameList& list);
/// Parameters, and t with its value.
[[nodiscard]] Parameters with_time(Parameters parameters, double t, const Location& location);
/// The same as numbers, at the end of `into`; names of those left out go to `missing`.
void take_numbers(Section& section, const NameList& list, const Parameters& parameters, std::vector<double>& into,
                  std::vector<std::string>& missing);

/// [parameters]: numbers and formulas that may refer to each other in any order.
/// \throws ProblemError also for a cycle, naming it
[[nodiscard]] Parameters read_parameters(Section& root, Names& names);

/// What a formula may speak of, beside parameters and functions.
struct Vocabulary {
  std::span<const std::string> names;
  std::span<const std::string> differentiable = {};  ///< names that dx() and its like may be applied to
  std::span<const std::string> axes = {};            ///< the grid's directions: "x" allows dx()
  /// Where what integral() is applied to goes; null where there is no such function.
  std::vector<formula::Expression>* integrands = nullptr;
  /// The periods of the grid, where noise(seed, waves) is a function of its coordinates.
  std::span<const GridAxis> periods = {};
  /// Where the formulas go that dx() and its like are applied to; dx() of number i is a variable
  /// "dx(" + expression_name(i) + ")". Null where only fields are differentiated.
  std::vector<formula::Expression>* differentiated = nullptr;
};

/// The name that expression number i of Vocabulary::differentiated has as an argument of dx(). No user's name is such.
[[nodiscard]] std::string expression_name(std::size_t number);

/// [definitions]: formulas of `names`, parameters and each other. Names that are not known where a definition is used
/// are an error there, so that one of x serves [initial] and one of the fields S.
/// \throws ProblemError also for a cycle, naming it
void add_definitions(Section& root, Names& taken, const Vocabulary& vocabulary, Parameters& parameters);

/// A formula as an expression; see Problem::build.
/// \throws ProblemError at the place in the file
[[nodiscard]] formula::Expression build_formula(const FormulaText& text, formula::Graph& graph,
                                                const Vocabulary& vocabulary, const Parameters& parameters);

/// The initial formula of a field: of the grid's coordinates, t, which is the start, and derivatives of the other
/// initial fields and of formulas; see Vocabulary::differentiated. \throws ProblemError at the place in the file
[[nodiscard]] formula::Expression build_initial(const FormulaText& text, formula::Graph& graph,
                                                const MultisymplecticProblem& pde, const Parameters& parameters,
                                                std::vector<formula::Expression>& differentiated);

/// [multisymplectic] of a form; `axes` names the directions of K.
[[nodiscard]] Value form_table(const MultisymplecticForm& form, std::span<const std::string> axes,
                               const Location& place);

/// The place in the file of character `column` of line `line` of a formula that begins at `start`.
[[nodiscard]] Location place_in_file(const Location& start, std::size_t line, std::size_t column);

/// \throws ProblemError at the first term of H that depends on coordinates and momenta, if there is one
void check_separable(const HamiltonianProblem& orbit, const Parameters& parameters);
/// \throws ProblemError at `location`, of the composition, if that needs a T(p) of degree two and this one is not.
/// Hypothesis: check_separable() passed.
void check_kinetic_energy(const HamiltonianProblem& orbit, const Parameters& parameters, const Composition& composition,
                          const Location& location);

/// True if a formula names t, itself or through a definition.
[[nodiscard]] bool names_time(const FormulaText& text, const Vocabulary& vocabulary, const Parameters& parameters);

/// The pair that an extended phase space adds for a driven system: the time, and minus the work done.
inline constexpr std::string_view clock_name = "time", work_name = figures::work_momentum;

/// Checks a formula by building it in a graph of its own.
void check_formula(const FormulaText& text, const Vocabulary& vocabulary, const Parameters& parameters);

/// [invariants]: every entry a formula.
[[nodiscard]] std::vector<NamedFormula> read_invariants(Section& root, const Vocabulary& vocabulary,
                                                        const Parameters& parameters);

/// [exact]: formulas of `arguments` for some of the names of `lists`.
[[nodiscard]] std::vector<NamedFormula> read_exact(Section& root, std::span<const NameList> lists,
                                                   std::span<const std::string> arguments,
                                                   const Parameters& parameters);

// ---- the parts of a problem -----------------------------------------------------------------------------------------

/// [hamiltonian], [lagrangian] and [multisymplectic] with all that belongs to them: [parameters], [initial],
/// [invariants], [exact], and for the last [grid] and [symmetries]. They set the problem's `parameters` and `system`.
void read_hamiltonian(Section& root, Section& section, Problem& problem);
void read_lagrangian(Section& root, Section& section, Problem& problem);
/// \param slopes fields that [initial] may give by their derivatives
void read_multisymplectic(Section& root, Section& section, Problem& problem, std::vector<InitialSlope> slopes = {});
/// jump = { FIELD = J } of a direction of the grid. \throws ProblemError
[[nodiscard]] std::vector<StatedJump> read_jumps(Section& axis, std::span<const std::string> fields,
                                                 const Parameters& parameters);
/// left and right of a direction of the grid. \throws ProblemError
void read_walls(Section& section, std::span<const std::string> fields, GridAxis& axis);
/// \throws ProblemError if the equation cannot have its walls
void check_walls(const Problem& problem);
/// The same of the density of a custom action, which has to be the same in the mirror.
void check_density_walls(const Problem& problem, const FormulaText& text, const CornerDensity& density);
/// \throws ProblemError if a field cannot jump, or the jumps change S or the density of an invariant, naming the term
void check_jumps(const Problem& problem);
/// The same of the density of a custom action.
void check_density_jumps(const MultisymplecticProblem& pde, const FormulaText& text, const CornerDensity& density);
/// phase = { NAME = θ } of a direction of the grid. \throws ProblemError
[[nodiscard]] std::vector<StatedTwist> read_twists(Section& axis, const Parameters& parameters);
/// Finds the symmetries of twists; leaves out symmetries that [field] has found and that do not turn with them. Needs
/// [symmetries], stated and found. \throws ProblemError if fields cannot turn, naming the reason, or the density of an
/// invariant does not turn with them
void check_twists(Problem& problem);
/// The same of the density of a custom action.
void check_density_twists(const Problem& problem, const FormulaText& text, const CornerDensity& density);
/// sponge = { width, strength } of a direction of the grid, whose range and walls have been read. \throws ProblemError
[[nodiscard]] std::optional<StatedSponge> read_sponge(Section& section, const GridAxis& axis,
                                                      const Parameters& parameters);
/// \throws ProblemError if the problem cannot have its sponge, naming the reason; needs all of it
void check_sponge(const Problem& problem);
/// The entry of [symmetries] that an entry of `phase`, of [grid] or a frame, names: itself, or that of the phase of a
/// complex unknown of [field]. \throws ProblemError
[[nodiscard]] std::string symmetry_of_phase(const Entry& entry, const MultisymplecticProblem& pde);
/// [field]: derives [multisymplectic], and reads that.
void read_field(Section& root, Section& section, Problem& problem);
/// [ensemble], if there is one. Whether the entries that it changes exist is seen when its members are read.
[[nodiscard]] std::optional<Ensemble> read_ensemble(Section& root, const Parameters& parameters);
/// The part of [output] that says what is reported, and when; needs all but it.
void read_output_times(Section& section, Problem& problem);
/// A quantity that is reported at times: a formula, or { formula = "u", at = { x = 3.5 } }. `what` is what messages
/// call it. \throws ProblemError also where the formula is none of such a quantity
[[nodiscard]] OutputQuantity read_quantity(const Value& value, std::string_view what, const Problem& problem);
/// A point of a lattice's domain: at = { x = 3.5 }.
[[nodiscard]] std::vector<double> read_point_of_grid(const Entry& at, const Problem& problem);
/// [events] and [section]; need all but them.
[[nodiscard]] std::vector<StatedEvent> read_events(Section& root, const Problem& problem);
/// What a quantity may name. Of an orbit coordinates and momenta, and t after them, unless that is known already as a
/// coordinate of the extended phase space; on a lattice fields, coordinates of the grid, t.
///@{
[[nodiscard]] std::vector<std::string> quantity_names(const HamiltonianProblem& ode, const Parameters& parameters);
[[nodiscard]] std::vector<std::string> quantity_names(const MultisymplecticProblem& pde);
/// Of these the coordinates of the grid, and t.
[[nodiscard]] std::vector<std::string> argument_names(const MultisymplecticProblem& pde);
///@}
/// [scheme] frame, with its own location, if there is one.
[[nodiscard]] std::optional<StatedFrame> read_frame(Section& scheme, const Problem& problem);
/// [symmetries] of an orbit: adds their momentum maps to its invariants, and their names. Needs the invariants.
void read_orbit_symmetries(Section& root, HamiltonianProblem& orbit, const Parameters& parameters);
/// [constraints] of an orbit. Needs all of [hamiltonian] or [lagrangian] and [initial].
void read_constraints(Section& root, HamiltonianProblem& orbit, const Parameters& parameters);
/// \throws ProblemError at what a problem with constraints cannot have
void check_constrained(const Problem& problem);
/// [scheme] tangents, if there are any.
[[nodiscard]] StatedTangents read_tangents(Section& scheme, const Problem& problem);

/// L of a lattice, a density of the corners of a cell, as the ring sees it: with the time of a driven system as a
/// field. \throws ProblemError if it names no field or a place that S does not name, or boundaries change it
[[nodiscard]] std::shared_ptr<const CornerDensity> read_corner_density(const FormulaText& text, const Problem& problem);
/// The values of `--set` that put fitted numbers in the place of "fit". \throws ProblemError where a first step of the
/// problem in the laboratory fails
[[nodiscard]] std::vector<std::string> fitted_frame(const Problem& problem);
/// [scheme]; needs the rest of the problem.
[[nodiscard]] Scheme read_scheme(Section& root, const Problem& problem);

}  // namespace rubato
