#pragma once

#include <cstddef>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <rubato/base/spread.hpp>
#include <rubato/base/state.hpp>
#include <rubato/figures/verdict.hpp>

namespace rubato::figures {

/// Of a record in which laws were not taken at every level: 1 where they were.
inline constexpr std::string_view laws_taken = "/levels/laws";

/// The physical times of the levels, of a record in fictitious time.
inline constexpr std::string_view level_times = "/levels/time";

/// Strength, length and exponent of the step potential of a run that has one.
inline constexpr std::string_view step_potential_path = "/checkpoint/step_potential";

/// What the names of constraints begin with among the residuals: constraints/NAME, and constraints/NAME_dot.
inline constexpr std::string_view constraint_group = "constraints/";

/// Where a checkpoint keeps the statistics of its run, and the names of their four lists (Statistics::names_text).
inline constexpr std::string_view statistics_name = "statistics";
inline constexpr std::string_view statistics_names_name = "statistics_names";

/// A quantity under its name, in the order of the problem file.
template <typename T>
struct Named {
  std::string name;
  T value = {};
};

/// A conserved quantity along a run, level by level: its first value and how far it strays.
struct Deviation {
  double initial = std::numeric_limits<double>::quiet_NaN();
  Spread values;

  void add(double value) {
    if (values.count() == 0.0) {
      initial = value;
    }
    values.add(value);
  }
  /// True if the first value is defined, so that deviations from it are.
  [[nodiscard]] bool has_initial() const { return initial - initial == 0.0; }
  /// max |value - initial| over the defined ones; 0 without a first value.
  [[nodiscard]] double max() const { return has_initial() ? values.farthest(initial) : 0.0; }
};

/// The total of what a sponge has taken from the energy.
inline constexpr std::string_view energy_lost_name = "energy_lost";
/// Of driven walls.
inline constexpr std::string_view wall_work_name = "work";
/// True for totals that belong to the balance of E, and are known at every level, whatever laws are taken.
[[nodiscard]] constexpr bool is_balance(std::string_view total) {
  return total == energy_lost_name || total == wall_work_name;
}

/// What is known of a level.
struct LevelFigures {
  double t = 0.0;
  double node_energy = 0.0;                                 ///< H(z_k)
  double gamma = std::numeric_limits<double>::quiet_NaN();  ///< Γ(z_k), or not a number where the scheme has none
};

/// What is known of a step.
struct StepFigures {
  double h = 0.0;
  double energy = 0.0;  ///< E_k
  /// What E_k has to equal; not a number as long as no step has met the law.
  double target = std::numeric_limits<double>::quiet_NaN();
  double condition = std::numeric_limits<double>::quiet_NaN();  ///< not a number with fixed levels
  double rounding = 0.0;                                        ///< of E_k, absolute
  double potential = 0.0;                                       ///< f'(h), the step potential's part of E_k
  double iterations = 0.0;
  bool off_law = false;  ///< E_k is not the target
};

/// The magnitudes of a local residual over the cells of a step, as a record keeps them: what `run` adds up step by step
/// is then what others add up from its record.
struct ResidualFigures {
  double max = std::numeric_limits<double>::quiet_NaN();  ///< of the defined values, not a number if there is none
  double rms = std::numeric_limits<double>::quiet_NaN();
  double defined = 0.0, undefined = 0.0;  ///< numbers of cells; both 0 on a step that has no such residual

  [[nodiscard]] static ResidualFigures of(const Spread& magnitudes);
  [[nodiscard]] Spread magnitudes() const;
};

/// What tangent vectors along an orbit add up to, besides the growth of each of them.
struct TangentFigures {
  double time = 0.0;  ///< Σ|t_{k+1} - t_k| of the steps that they were taken along
  /// Of the first vector, v: ∫ t d ln|v|, and ∫ Y dt of Y(T) = (2/T) ∫_0^T t d ln|v| (Cincotta and Simó, Astron.
  /// Astrophys. Suppl. 147, 2000), t counted from the start.
  double weighted = 0.0, megno = 0.0;
  Spread defect;  ///< of the two-form, of each step
};

/// Where a record has ln r_ii of vector NAME, of every step, and the defect of the two-form.
///@{
[[nodiscard]] std::string growth_path(std::string_view name);
inline constexpr std::string_view two_form_path = "/tangents/two_form";
///@}

/// The crossings of an event along a run, and the steps in which some may have been missed.
struct EventFigures {
  std::size_t count = 0;
  double first = std::numeric_limits<double>::quiet_NaN();    ///< time of the first
  double last = std::numeric_limits<double>::quiet_NaN();     ///< and of the last one
  double stopped = std::numeric_limits<double>::quiet_NaN();  ///< of the one that ended the run
  std::size_t undefined = 0;                                  ///< steps in which its formula was not defined everywhere
  std::size_t jumps = 0;                                      ///< steps in which it jumped through zero
  std::size_t several = 0;                                    ///< steps with more than one crossing
  std::size_t incomplete = 0;                                 ///< crossings at which a quantity was not defined
  std::size_t returned = 0;  ///< first steps that leave its zero and end beyond it, without a crossing

  void add(double t, bool stops, bool defined) {
    first = count == 0 ? t : first;
    last = t;
    stopped = stops && stopped != stopped ? t : stopped;
    ++count;
    incomplete += defined ? 0 : 1;
  }
  /// `missed`: 0, 1 where it is not defined, 2 where it jumps, 3 where it crosses several times, 4 where it leaves zero
  /// and ends beyond it.
  void add_step(int missed) {
    undefined += missed == 1 ? 1 : 0;
    jumps += missed == 2 ? 1 : 0;
    several += missed == 3 ? 1 : 0;
    returned += missed == 4 ? 1 : 0;
  }
  [[nodiscard]] bool stops() const { return stopped == stopped; }
};

/// The momentum of the time in the extended phase space of a driven system, H(q, p, t) + minus_work: minus the work
/// done on it since the start. Records are known by it.
inline constexpr std::string_view work_momentum = "minus_work";

/// What a run reports on how well each law held: every figure that the table of a run, `check`, `compare` and a report
/// print is computed here, from the same numbers, level by level and step by step, be it along the run or from its
/// record (stored_statistics).
///
/// The *energy law* is E_k = E with one E for the run, which the first step on the law sets. Steps before that
/// one are measured by the E that came later.
class Statistics {
public:
  std::size_t steps = 0;
  bool balance = false;  ///< the system is driven: H is that of work_momentum, and E_k = E the energy balance (3.4)
  double t = 0.0;
  double start = 0.0;
  /// The physical times of the last level and of the start, of a run in fictitious time, which t and start are of then;
  /// else not numbers.
  double clock = std::numeric_limits<double>::quiet_NaN(), clock_start = std::numeric_limits<double>::quiet_NaN();
  Spread h;
  double first_h = std::numeric_limits<double>::quiet_NaN();
  Deviation node_energy;  ///< of H(z_k)
  Spread gamma;           ///< at levels
  std::size_t off_law_steps = 0;
  Spread condition;  ///< of the steps on the law
  Spread rounding;   ///< of E_k, absolute
  Spread potential;  ///< f'(h), the step potential's part of E_k; 0 without one
  /// f' = strength (|h| / potential_length)^potential_exponent; not numbers without one, or where a record does not
  /// show.
  ///@{
  double potential_length = std::numeric_limits<double>::quiet_NaN();
  double potential_exponent = std::numeric_limits<double>::quiet_NaN();
  ///@}
  Spread iterations;
  double all_iterations = 0.0;
  /// Residuals, invariants and totals are taken at every n-th level, and of the step that leads there; 0: at none.
  std::size_t laws_every = 1;
  std::vector<Named<Spread>> residuals;  ///< magnitudes over cells and steps
  std::vector<Named<Deviation>> invariants;
  std::vector<Named<Deviation>> totals;  ///< of the densities of local laws
  std::vector<Named<EventFigures>> events;
  /// Of tangent vectors, which are called "1", "2" …: the sum of the logarithms of their growth.
  std::vector<Named<double>> growth;
  TangentFigures tangents;
  std::vector<Named<Spread>> errors;  ///< magnitudes, at the last level
  Measures measures;                  ///< for the verdict; saved apart from the rest

  /// Begins the five lists with their names.
  void name(const std::vector<std::string>& invariant_names, const std::vector<std::string>& total_names,
            const std::vector<std::string>& residual_names, const std::vector<std::string>& event_names,
            const std::vector<std::string>& vector_names = {});

  void add_level(const LevelFigures& level);
  /// Of the level added last, where they are taken.
  void add_laws(std::span<const double> invariant_values, std::span<const double> total_values);
  /// Of the same level where they are not: of the totals those alone that are known at every level (is_balance).
  void add_balances(std::span<const double> total_values);
  void add_step(const StepFigures& step);
  void add_residual(std::size_t residual, const ResidualFigures& figures);
  /// Of the step added last. \param length its length in the time of users \param logarithms of the growth of each
  /// tangent vector \param defect of the two-form, not a number where there is one vector alone
  void add_tangents(double length, std::span<const double> logarithms, double defect);

  [[nodiscard]] bool has_clock() const { return clock == clock; }
  [[nodiscard]] bool has_laws() const { return !(residuals.empty() && invariants.empty() && totals.empty()); }
  /// True if there are levels at which no laws were taken, although they were at others.
  [[nodiscard]] bool has_gaps() const { return laws_every > 1; }
  /// How many steps' laws were taken.
  [[nodiscard]] std::size_t law_steps_taken() const { return laws_every == 0 ? 0 : steps / laws_every; }
  /// True if h was chosen by the law: false with fixed levels.
  [[nodiscard]] bool variable_levels() const { return condition.any() || off_law_steps > 0; }
  /// True if E_k has to equal one number for the run; not so for an 𝕃 that depends on t.
  [[nodiscard]] bool autonomous() const { return one_energy_; }
  /// True if any step met the law, so that there is an E.
  [[nodiscard]] bool has_law() const { return energy_ - energy_ == 0.0; }
  /// E of the law; of the first step where no step met it.
  [[nodiscard]] double energy() const { return has_law() ? energy_ : energies_.initial; }
  [[nodiscard]] double first_energy() const { return energies_.initial; }    ///< E_0
  [[nodiscard]] const Spread& energies() const { return energies_.values; }  ///< all E_k
  /// Steps that met the law.
  [[nodiscard]] std::size_t law_steps() const { return steps - off_law_steps; }
  /// The Lyapunov exponent that tangent vector number i shows so far, and the mean exponential growth of nearby orbits,
  /// MEGNO, averaged over the time: 2 on regular orbits, and λt/2 on chaotic ones. Not numbers before the first step.
  ///@{
  [[nodiscard]] double exponent(std::size_t i) const { return growth[i].value / tangents.time; }
  [[nodiscard]] double megno() const { return tangents.megno / tangents.time; }
  ///@}
  /// κ of the step potential: its length over that of the first step.
  [[nodiscard]] double potential_kappa() const;
  /// max |E_k - target| over the steps on the law, and over those off it. Those before the law was first met count
  /// against energy().
  ///@{
  [[nodiscard]] double energy_deviation() const { return misses_.largest(); }
  [[nodiscard]] double off_law_deviation() const;
  ///@}

  /// max(|E|, max |H| on the orbit, max |total| of those in its balance): what energies are relative to.
  [[nodiscard]] double energy_scale() const;
  /// True if that is more than rounding: a deviation relative to nothing says nothing.
  [[nodiscard]] bool has_energy_scale() const;
  /// A deviation of energy over energy_scale(), if there is one.
  [[nodiscard]] std::optional<double> relative(double deviation) const;
  [[nodiscard]] std::optional<double> relative_energy_deviation() const { return relative(energy_deviation()); }
  [[nodiscard]] std::optional<double> relative_off_law_deviation() const { return relative(off_law_deviation()); }

  /// The event that ended the run: of several in its last step the first. Null if none did.
  [[nodiscard]] const Named<EventFigures>* stopped_by() const;

  /// One sentence for each law, invariant and error and event that is not a number everywhere, since its formula left
  /// its domain.
  [[nodiscard]] std::vector<std::string> undefined_quantities() const;

  void save(StateWriter& state) const;
  /// The names must be in place already.
  void restore(StateReader& state);

  /// The same with laws_every before them, and with the names, as a record keeps them.
  ///@{
  [[nodiscard]] std::vector<double> values() const;
  [[nodiscard]] std::string names_text() const;
  /// \throws std::invalid_argument unless these are values() and names_text() of some statistics
  [[nodiscard]] static Statistics of(std::span<const double> values, std::string_view names_text);
  ///@}
  /// The number of steps in values().
  static constexpr std::size_t place_of_steps = 1;

  /// What rows of a record are parts of: the numbers of all levels or steps, by dataset.
  [[nodiscard]] std::vector<std::pair<std::string, Spread>> spreads() const;

private:
  double energy_ = std::numeric_limits<double>::quiet_NaN();
  bool one_energy_ = true;
  Deviation energies_;     ///< E_k of all steps
  Spread misses_;          ///< E_k - target on steps on the law
  Spread off_law_misses_;  ///< the same of steps off the law
  Spread before_law_;      ///< E_k of steps before the law was first met

  template <typename Self, typename Visitor>
  static void visit(Self& self, Visitor&& visitor);
  /// What records of earlier versions have not: it is saved last.
  template <typename Self, typename Visitor>
  static void visit_later(Self& self, Visitor&& visitor);
  void restore(StateReader& state, bool all);
};

}  // namespace rubato::figures
