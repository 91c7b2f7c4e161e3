#pragma once

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

/// What a run does level by level, be it an orbit or a lattice: the driver in run.cpp knows no more than this.
class Simulation {
public:
  virtual ~Simulation() = default;

  [[nodiscard]] virtual StepReport step() = 0;
  /// What takes the steps, and chooses the levels.
  ///@{
  [[nodiscard]] virtual Integrator& integrator() = 0;
  [[nodiscard]] virtual const Integrator& integrator() const = 0;
  ///@}

  [[nodiscard]] bool finished() const { return integrator().finished(); }
  [[nodiscard]] double t() const { return integrator().t(); }
  [[nodiscard]] NodeEnergy node() { return integrator().node(); }  ///< H(z_k) and Γ(z_k)
  [[nodiscard]] bool autonomous() const { return integrator().autonomous(); }
  /// Whether node() knows Γ: not for an arbitrary 𝕃, nor where no levels are chosen by it.
  [[nodiscard]] bool has_gamma() const { return integrator().has_gamma(); }
  [[nodiscard]] double last_step() const { return integrator().levels().last_step(); }
  /// A bound of what rounding makes of E_k of the step just taken, and the largest sum of the magnitudes of its terms
  /// so far, which the tolerance of the law is relative to.
  ///@{
  [[nodiscard]] double energy_rounding() const { return integrator().levels().energy_rounding(); }
  [[nodiscard]] double energy_terms() const { return integrator().levels().energy_scale(); }
  ///@}
  /// The step potential of the run; none before its first step.
  [[nodiscard]] std::optional<double> potential_price() const { return integrator().levels().potential_price(); }
  [[nodiscard]] const StepPotential& step_potential() const { return integrator().levels().potential(); }
  /// The order of the scheme in time.
  [[nodiscard]] int order() const { return integrator().traits().order; }

  [[nodiscard]] virtual std::vector<std::string> invariant_names() const = 0;
  /// At the present level. Valid until the next call.
  [[nodiscard]] virtual std::span<const double> invariants() = 0;
  /// |z - exact| at the present level, one entry per name of [exact].
  [[nodiscard]] virtual std::vector<Named<Spread>> errors() = 0;

  /// What to tell the user at the start: what is doubtful about the problem, each one sentence with the remedy.
  [[nodiscard]] std::vector<std::string> cautions() const { return integrator().cautions(); }
  /// What to tell the user at the end, each one sentence with the remedy.
  [[nodiscard]] virtual std::vector<std::string> warnings() const { return {}; }

  /// Totals over the domain of the densities of the local laws at the present level, but for energy, which node()
  /// gives. Valid until the next call.
  [[nodiscard]] virtual std::vector<std::string> total_names() const { return {}; }
  [[nodiscard]] virtual std::span<const double> totals() { return {}; }

  /// The local laws, of the step just taken.
  ///@{
  [[nodiscard]] virtual std::span<Law> laws() { return {}; }
  [[nodiscard]] virtual std::span<const Law> laws() const { return {}; }
  [[nodiscard]] std::vector<std::string> law_names() const;
  ///@}

  /// Adds the columns of a stored state (under /states, /states/previous when `with_previous`, /exact) and their
  /// scales.
  virtual void describe_states(record::Layout& layout, bool with_previous) = 0;
  /// Appends one row to each of them.
  virtual void append_state(RowSink& sink) = 0;

  /// The step taken last, as its record has it. Valid until the next step.
  [[nodiscard]] virtual OutputStep last() const = 0;

  virtual void save(StateWriter& state) const = 0;
  virtual void restore(StateReader& state) = 0;
};

/// \throws ProblemError at the place in the problem that is wrong
[[nodiscard]] std::unique_ptr<Simulation> make_orbit_simulation(const Problem& problem);
/// With `tangents`, two tangent solutions are carried along a lattice and the multisymplectic residual is reported.
/// \throws ProblemError likewise; std::invalid_argument
[[nodiscard]] std::unique_ptr<Simulation> make_lattice_simulation(const Problem& problem, bool tangents);
[[nodiscard]] std::unique_ptr<Simulation> make_simulation(const Problem& problem, bool tangents = false);

}  // namespace rubato
