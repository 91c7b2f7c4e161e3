#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include <rubato/figures/verdict.hpp>
#include <rubato/formula/expression.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/problem/location.hpp>
#include <rubato/record/layout.hpp>
#include <rubato/variation/corner_density.hpp>
#include <rubato/variation/crossing.hpp>
#include <rubato/variation/time_levels.hpp>

/// Problems as files: read, validated, run, resumed and checked.
namespace rubato {

/// A formula as the user wrote it, and where its first character stands.
struct FormulaText {
  std::string text;
  Location location;
};

/// A formula with a name: an invariant, or one component of an exact solution.
struct NamedFormula {
  std::string name;
  FormulaText formula;
};

/// What a name stands for in formulas: of [parameters] a number, of [definitions] a formula of the state, the time, the
/// grid's coordinates, wherever these are known. They may refer to each other in any order.
struct Parameter {
  std::string name;
  double value = 0.0;  ///< of a parameter
  Location location;
  std::optional<FormulaText> definition = {};  ///< of a definition
  std::vector<std::string> needs = {};         ///< of a definition: the other definitions that it names
};

/// All parameters and definitions of a problem, found by their names.
class Parameters {
public:
  void push_back(Parameter parameter) {
    places_.emplace(parameter.name, all_.size());
    all_.push_back(std::move(parameter));
  }
  /// The entry of this name, or null. The pointer is valid until the next push_back().
  [[nodiscard]] const Parameter* find(std::string_view name) const {
    const auto place = places_.find(name);
    return place == places_.end() ? nullptr : &all_[place->second];
  }
  [[nodiscard]] std::size_t size() const { return all_.size(); }
  [[nodiscard]] auto begin() const { return all_.begin(); }
  [[nodiscard]] auto end() const { return all_.end(); }

private:
  std::vector<Parameter> all_;
  std::map<std::string, std::size_t, std::less<>> places_;
};

/// Dense square matrix, row by row.
struct Matrix {
  std::size_t size = 0;
  std::vector<double> entries;  ///< size * size
  Location location;

  [[nodiscard]] double operator()(std::size_t row, std::size_t column) const { return entries[row * size + column]; }
  double& operator()(std::size_t row, std::size_t column) { return entries[row * size + column]; }
};

/// A point of the phase space at its own time.
struct PhasePoint {
  double t = 0.0;
  std::vector<double> q, p;
  std::vector<double> q_dot;  ///< of a problem stated by L
  Location location;          ///< of its table
};

/// [hamiltonian], or [lagrangian]: an ODE in canonical coordinates.
struct HamiltonianProblem {
  std::vector<std::string> q, p;  ///< names, vectors expanded: r[3] is r1, r2, r3
  FormulaText H;                  ///< in q, p and parameters; empty if there is L
  /// Of a problem stated by L: a formula in q, q_dot and parameters. Momenta are called p_ and the coordinate.
  ///@{
  std::optional<FormulaText> L;
  std::vector<std::string> q_dot;
  ///@}
  /// With time_scale, and where H names t: a system of one more pair, the time and its momentum, that does not depend
  /// on its own independent variable s. H is then g·(H - E), or H + w; the initial point has the pair, too.
  ///@{
  bool fictitious_time = false;  ///< dt = g ds
  bool driven = false;           ///< H names t
  ///@}
  PhasePoint initial;
  std::optional<PhasePoint> next;         ///< [initial.next]: the second level of a starting pair
  std::vector<NamedFormula> invariants;   ///< in q, p, in the order of the file; of [symmetries] after them
  std::vector<NamedFormula> exact;        ///< in t; names of some coordinates and momenta, in the order q, p
  std::vector<std::string> symmetries;    ///< those of the invariants that are momentum maps of [symmetries]
  std::vector<NamedFormula> constraints;  ///< formulas of q that vanish, in the order of the file

  /// With time_scale, which coordinate is the physical time; else t of the levels is that. In (q, p) it has the same
  /// place.
  [[nodiscard]] std::optional<std::size_t> clock() const {
    return fictitious_time ? std::optional(q.size() - 1) : std::nullopt;
  }

  /// q followed by p.
  [[nodiscard]] std::vector<std::string> names() const;
  /// q followed by q_dot.
  [[nodiscard]] std::vector<std::string> lagrangian_names() const;
  /// What [invariants] and [exact] know: names(), with q_dot in the middle if there is L.
  [[nodiscard]] std::vector<std::string> formula_names() const;
  /// H or L.
  [[nodiscard]] const FormulaText& statement() const { return L ? *L : H; }
};

/// The names in a custom 𝕃: t_0, every name of q and p with suffix _0, t_1, and the same with suffix _1.
[[nodiscard]] std::vector<std::string> custom_lagrangian_names(const HamiltonianProblem& problem);

/// By how much a field differs from one period of an axis to the next.
struct StatedJump {
  std::string field;
  double value = 0.0;
  Location location = {};
};

/// By which angle fields turn from one period of an axis to the next.
struct StatedTwist {
  std::string name;    ///< as [grid] has it
  double angle = 0.0;  ///< between -π and π where the turn by 2π is none
  Location location = {};
  std::string symmetry = {};  ///< the entry of [symmetries] that it is
};

/// Layers at both ends of an axis that damp what comes there: see Sponge (pde/sponge.hpp).
struct StatedSponge {
  double width = 0.0, strength = 0.0;
  Location location = {};
};

/// A value that a wall gives a field: a formula of t and the coordinates.
struct StatedDrive {
  bool is_right = false;
  std::string field;
  FormulaText value;
};

/// One direction of the grid: nodes from + i (to - from)/cells, i = 0 … cells-1, and between walls i = cells, too.
struct GridAxis {
  std::string name;  ///< "x", "y" or "z"
  double from = 0.0, to = 0.0;
  std::int64_t cells = 0;
  Location location;
  std::vector<StatedJump> jumps = {};
  std::vector<StatedTwist> twists = {};
  std::optional<StatedSponge> sponge = {};
  grids::End left = grids::End::periodic, right = grids::End::periodic;
  std::vector<StatedDrive> drives = {};

  [[nodiscard]] bool has_walls() const { return left != grids::End::periodic; }
  [[nodiscard]] std::int64_t nodes() const { return cells + (has_walls() ? 1 : 0); }
};

/// A linear symmetry z -> z + s B z.
struct StatedSymmetry {
  std::string name;
  Matrix B;
  bool is_found = false;  ///< of the equation of [field], which the problem does not state
};

/// [initial] from: a state of another run on a lattice, or of this one where its problem was read from its record.
struct InitialRecord {
  std::string file;
  double at = 0.0;                     ///< the time of a stored level
  std::vector<std::string> take = {};  ///< names of fields
  bool own_start = false;              ///< the first state of `file`, whatever `at` is
  /// In place of `file`: values at the nodes, x fastest, for each of `take`; they have to outlive the problem.
  std::map<std::string, std::span<const double>> arrays = {};
  Location location;
};

/// [initial.next] of a lattice: a second level.
struct NextLevel {
  double t = 0.0;
  /// Per field, as MultisymplecticProblem::initial.
  std::vector<std::optional<FormulaText>> fields;
  Location location;
};

/// A field that [initial] gives by its derivative by x, which has a name: potential_u_t by u_t where u = ∂_x
/// potential_u.
struct InitialSlope {
  std::string name;
  std::string field;
};

/// What [field] is stated in, by the fields of the form that is derived: exp(-rate t) (Σ c re + i Σ c im). The u of a
/// damped equation, psi, and their derivatives where the form has them.
struct StatedUnknown {
  std::string name;
  double rate = 0.0;
  std::vector<std::pair<std::string, double>> re = {}, im = {};  ///< fields with factors; no im of a real one
};

/// [multisymplectic]: M z_t + K_x z_x (+ K_y z_y + K_z z_z) = ∇S(z) on a periodic grid.
struct MultisymplecticProblem {
  std::vector<std::string> fields;
  Matrix M;               ///< skew
  std::vector<Matrix> K;  ///< one per grid axis, skew
  FormulaText S;          ///< in the fields, the grid's coordinates, t and the parameters
  /// S names t: the last two fields are `time` and `minus_work` of the extended system, which S as given does not name.
  bool driven = false;
  std::vector<GridAxis> axes;
  double start = 0.0;
  /// Per field, in the grid's coordinates; may hold dx(f), dy(f), dz(f) of other fields. A field may be left out.
  std::vector<std::optional<FormulaText>> initial;
  std::vector<InitialSlope> slopes;  ///< that are given
  std::optional<InitialRecord> initial_record;
  std::optional<NextLevel> next;
  Location initial_location;
  std::vector<NamedFormula> invariants;  ///< densities in the fields, with dx(f) …
  std::vector<NamedFormula> exact;       ///< in the grid's coordinates and t; names of some fields, in their order
  std::vector<StatedSymmetry> symmetries;
  /// Of a problem stated by [field]: the [multisymplectic] that was derived, as TOML, and the Lagrangian density L.
  std::string derived, density;
  std::vector<StatedUnknown> unknowns;  ///< of such a problem, those that are no fields

  [[nodiscard]] std::vector<std::string> axis_names() const;
  /// How many nodes the grid has.
  [[nodiscard]] double nodes() const;
  /// True if a field jumps along an axis.
  [[nodiscard]] bool has_jumps() const;
  /// True if fields turn along an axis.
  [[nodiscard]] bool has_twists() const;
  /// The first sponge of an axis; null where there is none.
  [[nodiscard]] const StatedSponge* sponge() const;
  /// True if an axis is between walls.
  [[nodiscard]] bool has_walls() const;
  /// True if a wall gives a field values in time.
  [[nodiscard]] bool has_drives() const;
};

/// Of an orbit, in the order of orbit_methods(). A lattice's scheme is one of lattice_methods(), by its name.
enum class LagrangianName { midpoint, forward, generating, custom, gauss, splitting, trapezoid, lobatto, of_lattice };

/// What the user writes: "midpoint", "variable", "stop", …
[[nodiscard]] std::string_view to_string(LagrangianName lagrangian);
[[nodiscard]] std::string_view to_string(Levels levels);
[[nodiscard]] std::string_view to_string(OnSingular on_singular);

/// The normal Darboux matrix of a generating function: F = 0, ±[[0, I], [I, 0]], or the user's symmetric 2n×2n F.
enum class DarbouxKind { midpoint, euler_a, euler_b, matrix };

/// [scheme] frame of a lattice: see MovingFrame (pde/moving_frame.hpp).
struct StatedFrame {
  /// One for each direction; absent for "fit".
  std::optional<std::vector<double>> velocity;
  std::string symmetry = {};        ///< in which the frame turns: an entry of [symmetries]; empty where it does not
  std::optional<double> rate = {};  ///< absent for "fit"
  Location location;

  [[nodiscard]] bool is_fitted() const { return !velocity || (!symmetry.empty() && !rate); }
};

/// [scheme] tangents of an orbit: what is carried along with it by the tangent of its scheme.
struct StatedTangents {
  std::size_t vectors = 0;                   ///< made orthonormal after each step, for exponents and the two-form
  bool matrix = false;                       ///< ∂z_k/∂z_0
  std::vector<std::string> parameters = {};  ///< of ∂z_k/∂parameter
  Location location = {};

  [[nodiscard]] bool any() const { return vectors > 0 || matrix || !parameters.empty(); }
};

/// [scheme]
struct Scheme {
  LagrangianName lagrangian = LagrangianName::midpoint;
  std::string method;  ///< a lattice's: a name of lattice_methods()
  Levels levels = Levels::variable;
  OnSingular on_singular = OnSingular::plain;
  /// A word or key of an earlier version for singular points that records may have, and problem files may not.
  std::optional<Location> outdated;
  StepPotentialChoice potential = {};
  bool usual_potential = false;  ///< the problem says nothing of it, nor of singular points
  /// t_1 - t_0, finite, nonzero, with the sign of until - start. Absent for step = "auto" only (then energy_tolerance
  /// holds); taken from [initial.next] where that is given.
  std::optional<double> step;
  std::optional<double> energy_tolerance;
  double until = 0.0;
  std::optional<int> order;            ///< generating; of splitting only where it chose the composition
  std::optional<int> stages;           ///< gauss, lobatto, and methods for lattices that have stages
  std::string composition = "golden";  ///< splitting: the name of one of compositions()
  std::string space = "fourier";       ///< splitting of a lattice: one of space_words
  int space_stages = 1;                ///< box
  DarbouxKind darboux = DarbouxKind::midpoint;
  std::optional<Matrix> darboux_matrix;
  std::optional<FormulaText> L;  ///< custom: in t_0, t_1 and every coordinate and momentum with suffix _0 and _1
  std::shared_ptr<const CornerDensity> density;  ///< custom of a lattice: L, of the corners of a cell
  std::optional<StatedFrame> frame;              ///< of a lattice
  StatedTangents tangents;                       ///< of an orbit
  bool allow_unstable = false;
  std::int64_t max_steps = 100'000'000;
  double tolerance = 1e-13;

  /// lagrangian = "…", as the user writes it.
  [[nodiscard]] std::string_view word() const;

  Location location;  ///< of the table
  Location potential_location, step_location, until_location, lagrangian_location, levels_location, order_location,
      darboux_location, space_stages_location;
};

/// [laws]: at which levels and steps local laws, their totals and invariants are taken.
struct Laws {
  std::int64_t every = 1;  ///< at every n-th; 0: at none
  bool fields = false;     ///< true if the record has the residual in every cell, over the steps to stored levels
  Location location;

  [[nodiscard]] bool none() const { return every == 0; }
  /// True if those of this level, and of the step that leads to it, are taken.
  [[nodiscard]] bool taken_at(std::size_t level) const {
    return every > 0 && level % static_cast<std::size_t>(every) == 0;
  }
};

/// [levels]: which levels have rows in the record.
struct LevelRowsChoice {
  std::int64_t every = 1;  ///< every n-th, and the last

  [[nodiscard]] bool stored_at(std::size_t level) const { return level % static_cast<std::size_t>(every) == 0; }
  /// False where there are levels without a row.
  [[nodiscard]] bool all() const { return every == 1; }
};

/// [output.quantities]: a formula that is reported at the output times.
struct OutputQuantity {
  std::string name;
  FormulaText formula;                    ///< in coordinates, momenta and t; or in fields, with dx(f), integral(f) …
  std::optional<std::vector<double>> at;  ///< a point of the grid's domain: reported there alone
  Location location;
};

/// [output]
struct Output {
  std::string file;  ///< default: the problem's name with .h5
  std::int64_t every = 1;
  bool states = true;  ///< of levels; if not, those of the first and the last
  /// Without states of levels: those two have all fields of a lattice, and the level before, as earlier versions stored
  /// them; else only the fields that evolve. No entry of problem files.
  bool all_fields = false;
  std::vector<double> times;       ///< strictly monotone in the direction of the run
  std::optional<double> interval;  ///< positive; in place of times
  /// With time_scale: times are those of the levels, not physical ones. No entry of problem files.
  bool in_fictitious_time = false;
  std::vector<OutputQuantity> quantities;

  /// True if there are times of their own.
  [[nodiscard]] bool has_times() const { return interval.has_value() || !times.empty(); }
  /// True if there is anything under /output.
  [[nodiscard]] bool any() const { return has_times() || !quantities.empty(); }
  /// True if states are among it: at times of their own, unless quantities take their place.
  [[nodiscard]] bool states_at_times() const { return has_times() && (states || quantities.empty()); }
  /// Every n-th level is stored.
  [[nodiscard]] std::int64_t states_every() const { return states ? every : std::numeric_limits<std::int64_t>::max(); }
  bool durable = true;  ///< every version of the record is on the disk before it takes its place
  int compression = record::usual_compression;  ///< 0, none, to record::most_compression
  Location location;                            ///< of the table
  Location file_location;
};

/// An entry of [events], or [section], which is the event of that name: g passes zero, or a condition becomes true.
struct StatedEvent {
  std::string name;
  FormulaText crossing;                   ///< g; of a condition the side that becomes the greater
  std::optional<FormulaText> less;        ///< of a condition: the other side
  std::optional<std::vector<double>> at;  ///< of a lattice: a point of the domain where both are meant
  Direction direction = Direction::both;
  std::int64_t stop_after = 0;             ///< the run ends with the step of so many crossings; 0: it does not
  std::vector<OutputQuantity> quantities;  ///< that are reported at each crossing
  Location location;

  [[nodiscard]] bool is_condition() const { return less.has_value(); }
};
/// What [section] is called among the events.
inline constexpr std::string_view section_event = "section";

/// [ensemble]: many runs of one problem, each with some of its entries changed.
struct Ensemble {
  std::vector<std::string> paths;                ///< of the entries: "initial.p", "parameters.c"
  std::vector<std::vector<std::string>> values;  ///< for every member, one TOML value for every path
  std::string common;                            ///< the text of the problem without [ensemble]
  Location location;

  [[nodiscard]] std::size_t members() const { return values.size(); }
  /// "initial.p = 0.5, parameters.c = 1"
  [[nodiscard]] std::string described(std::size_t member) const;
};

struct StatedSolve;

/// A whole problem, read and validated: names, types, signs, sizes and the syntax of every formula are in order.
struct Problem {
  std::string name;       ///< of the file without folder and extension, or of the catalogue entry
  std::string title;      ///< default: the name
  std::string source;     ///< the file as the user named it
  std::string text;       ///< the whole effective problem, TOML: reading it again gives the same problem
  Parameters parameters;  ///< and definitions
  std::variant<HamiltonianProblem, MultisymplecticProblem> system;
  Scheme scheme;
  Laws laws;
  std::vector<figures::ReasonKind> accepted;  ///< [verdict] accept: reasons that do not count
  Output output;
  LevelRowsChoice levels;
  std::vector<StatedEvent> events;           ///< of [events] and [section], in alphabetical order
  std::shared_ptr<const StatedSolve> solve;  ///< [solve]; null if there is none
  std::optional<Ensemble> ensemble;          ///< the problem itself is then what its members have in common

  [[nodiscard]] const HamiltonianProblem* hamiltonian() const { return std::get_if<HamiltonianProblem>(&system); }
  [[nodiscard]] const MultisymplecticProblem* multisymplectic() const {
    return std::get_if<MultisymplecticProblem>(&system);
  }
  /// True if the record has the first and the last state of a lattice's evolving fields, and no other state.
  [[nodiscard]] bool stores_evolving_alone() const {
    return multisymplectic() != nullptr && !output.states && !output.all_fields;
  }
  /// Start time.
  [[nodiscard]] double start() const;
  /// Which coordinate has the times of outputs and events; nothing where t of the levels is that.
  [[nodiscard]] std::optional<std::size_t> clock() const;
  /// The first of these times.
  [[nodiscard]] double clock_start() const;

  /// The formula as an expression of `graph` in the variables `names` (made in that order if they are new), parameters
  /// put in as constants. With `derivatives`, dx(f), dy(f), dz(f) of one of `differentiable` stand for a variable
  /// called "dx(f)" and so on, and may be nested. \throws ProblemError at the place in the file
  [[nodiscard]] formula::Expression build(const FormulaText& formula, formula::Graph& graph,
                                          std::span<const std::string> names,
                                          std::span<const std::string> differentiable = {}) const;
  /// The same of a quantity on a lattice, in which integral(f) stands for a variable called "integral 1" and so on;
  /// what is integrated is put into `integrands`.
  [[nodiscard]] formula::Expression build_quantity(const FormulaText& formula, formula::Graph& graph,
                                                   std::span<const std::string> names,
                                                   std::span<const std::string> differentiable,
                                                   std::vector<formula::Expression>& integrands) const;
};

/// Reads a problem: `problem` is a file, or else a catalogue name; `settings` are the values of `--set`,
/// "table.key=value". \throws ProblemError if anything in it is wrong, or there is neither such a file nor such a
/// catalogue entry \throws FileError if the file exists and cannot be read
[[nodiscard]] Problem read_problem(const std::string& problem, std::span<const std::string> settings = {});

/// Member number `member` of a problem with an ensemble: a problem of its own, without one.
/// \throws ProblemError at [ensemble], naming the member
[[nodiscard]] Problem member_problem(const Problem& problem, std::size_t member);

/// Reads a problem from its text; `source` names it in messages, and its stem is the problem's name.
/// \throws ProblemError
[[nodiscard]] Problem parse_problem(std::string_view text, const std::string& source,
                                    std::span<const std::string> settings = {});
/// The same of a record's problem, which an earlier version may have written (Scheme::outdated).
[[nodiscard]] Problem parse_recorded(std::string_view text, const std::string& source,
                                     std::span<const std::string> settings = {});

/// g of an event as an expression; `integrands` as of Problem::build_quantity. \throws ProblemError
[[nodiscard]] formula::Expression build_event(const StatedEvent& event, const Problem& problem, formula::Graph& graph,
                                              std::vector<formula::Expression>& integrands);

}  // namespace rubato
