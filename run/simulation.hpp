#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <rubato/figures/statistics.hpp>
#include <rubato/ode/integrate.hpp>
#include <rubato/problem/problem.hpp>
#include <rubato/record/layout.hpp>
#include <rubato/run/law.hpp>
#include <rubato/run/output.hpp>
#include <rubato/run/row_sink.hpp>
#include <rubato/variation/time_levels.hpp>

namespace rubato {

using figures::Named;

/// A step that was taken, with the level that it led to.
struct TakenStep {
  StepReport report;
  double rounding = 0.0;  ///< a bound of the rounding error of E_k
  figures::LevelFigures level;
};

/// What a run does, be it an orbit or a lattice: the driver in run.cpp knows no more than this. Steps are taken in
/// blocks; what is asked of a level is that of look_at(), after a block its last one, where the simulation stands.
class Simulation {
public:
  virtual ~Simulation() = default;

  /// Takes up to `most` steps, no more than levels_kept(): taken(). The block ends early with a step that fails, at
  /// `until`, with a level at which the node energy or Γ is not a number, or where the flag of this thread's
  /// Interruptible is set. \return report()
  const StepReport& take(std::size_t most);
  [[nodiscard]] std::span<const TakenStep> taken() const { return taken_; }
  /// The report of the last step that was tried: why it failed, if it did.
  [[nodiscard]] const StepReport& report() const { return report_; }
  /// True if a look-ahead was interrupted in place of a further step.
  [[nodiscard]] bool interrupted() const { return interrupted_; }
  /// False where the block ended with a level at which the node energy is not a number, or Γ where node() knows it.
  [[nodiscard]] bool is_defined() const { return is_defined_; }
  /// The most steps of a block.
  [[nodiscard]] virtual std::size_t levels_kept() const { return 1; }
  /// \param place of a step in the block
  virtual void look_at(std::size_t /*place*/) {}

  /// What takes the steps, and chooses the levels.
  ///@{
  [[nodiscard]] Integrator& integrator() { return *integrator_; }
  [[nodiscard]] const Integrator& integrator() const { return *integrator_; }
  ///@}

  [[nodiscard]] bool finished() const { return integrator().finished(); }
  [[nodiscard]] double t() const { return integrator().t(); }
  /// The time of the present level that users read: with time_scale the physical one.
  [[nodiscard]] virtual double clock() const { return last().end(); }
  [[nodiscard]] NodeEnergy node() { return integrator().reported_node(); }  ///< H(z_k) and Γ(z_k), where it stands
  [[nodiscard]] bool autonomous() const { return integrator().autonomous(); }
  /// True if node() knows Γ: not for an arbitrary 𝕃, nor where no levels are chosen by it.
  [[nodiscard]] bool has_gamma() const { return integrator().has_gamma(); }
  /// A bound of the rounding error of E_k of the step just taken, and the largest sum of the magnitudes of its terms
  /// so far, which the tolerance of the law is relative to.
  ///@{
  [[nodiscard]] double energy_rounding() const { return integrator().levels().energy_rounding(); }
  [[nodiscard]] double energy_terms() const { return integrator().levels().energy_scale(); }
  ///@}
  /// The step potential of the run; none before its first step.
  [[nodiscard]] std::optional<double> potential_cost() const { return integrator().levels().potential_cost(); }
  [[nodiscard]] const StepPotential& step_potential() const { return integrator().levels().potential(); }
  /// The order of the scheme in time.
  [[nodiscard]] int order() const { return integrator().order(); }

  [[nodiscard]] virtual std::vector<std::string> invariant_names() const = 0;
  /// Valid until the next call.
  [[nodiscard]] virtual std::span<const double> invariants() = 0;
  /// |z - exact|, one entry per name of [exact].
  [[nodiscard]] virtual std::vector<Named<Spread>> errors() = 0;

  /// What to show the user at the start: what is doubtful about the problem, each one sentence with the remedy.
  [[nodiscard]] std::vector<std::string> cautions() const { return integrator().cautions(); }
  /// What to show the user at the end, each one sentence with the remedy.
  [[nodiscard]] virtual std::vector<std::string> warnings() const { return {}; }

  /// The terms that the node energy is a sum of at the level, as EnergyExchange takes them; on a lattice their totals.
  /// None where they are not defined at levels. Valid until the next call. Collective on a shared lattice.
  [[nodiscard]] virtual std::span<const double> energy_term_values() { return {}; }

  /// Adds what the level, of this number, shows to the measures of the verdict. Of a shared lattice, nothing.
  virtual void measure(std::size_t number, figures::Measures& measures) = 0;

  /// Totals over the domain of the densities of the local laws at the level, but for energy, which node() gives, and
  /// of what else the balance of energy has (figures::is_balance). Those of laws that are not `taken` are not numbers.
  /// Valid until the next call.
  [[nodiscard]] virtual std::vector<std::string> total_names() const { return {}; }
  [[nodiscard]] virtual std::span<const double> totals(bool /*taken*/) { return {}; }

  /// The local laws, of the step just taken.
  ///@{
  [[nodiscard]] virtual std::span<Law> laws() { return {}; }
  [[nodiscard]] virtual std::span<const Law> laws() const { return {}; }
  [[nodiscard]] std::vector<std::string> law_names() const;
  ///@}

  /// Adds the columns of a stored state (under /states, /states/previous when `with_previous`, /exact) and their
  /// scales.
  virtual void describe_states(record::Layout& layout, bool with_previous) = 0;
  /// Appends rows to each of them: of the level, and of every `stride`-th after it, `count` in all.
  virtual void append_states(RowSink& sink, std::size_t count, std::size_t stride) = 0;

  /// The step to the level, as its record has it. Valid until the next block.
  [[nodiscard]] virtual OutputStep last() const = 0;

  virtual void save(StateWriter& state) const = 0;
  virtual void restore(StateReader& state) = 0;

protected:
  /// To be called by constructors. \param integrator has to live as long as this
  void step_by(Integrator& integrator) { integrator_ = &integrator; }
  /// One step; its level is kept at this place of the block.
  [[nodiscard]] virtual StepReport step(std::size_t place) = 0;

private:
  Integrator* integrator_ = nullptr;
  std::vector<TakenStep> taken_;
  StepReport report_;
  bool is_defined_ = true, interrupted_ = false;
};

/// \throws ProblemError at the place in the problem that is wrong
[[nodiscard]] std::unique_ptr<Simulation> make_orbit_simulation(const Problem& problem);
/// With `tangents`, two tangent solutions are carried along a lattice and the multisymplectic residual is reported.
/// \throws ProblemError likewise; std::invalid_argument
[[nodiscard]] std::unique_ptr<Simulation> make_lattice_simulation(const Problem& problem, bool tangents);
[[nodiscard]] std::unique_ptr<Simulation> make_simulation(const Problem& problem, bool tangents = false);

}  // namespace rubato
