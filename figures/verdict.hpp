#pragma once

#include <array>
#include <cstddef>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

/// The verdict on a run: what its result is worth, by measures taken along it.
namespace rubato::figures {

class Statistics;

/// A run whose figures show no fault; one to look at with care; one whose result means nothing.
enum class Verdict { good, doubtful, lost };
[[nodiscard]] std::string_view to_string(Verdict verdict);

/// The kinds of reasons, in the order in which they are reported; `[verdict] accept` names them.
enum class ReasonKind { energy, law, spectrum, period, exact, resolution, event, end, action, conditions };
inline constexpr std::array<std::string_view, 10> reason_words = {
    "energy", "law", "spectrum", "period", "exact", "resolution", "event", "end", "action", "conditions"};
[[nodiscard]] inline std::string_view to_string(ReasonKind kind) {
  return reason_words[static_cast<std::size_t>(kind)];
}

/// What the verdict needs beside the statistics of a run; not a number where it was not measured. A record keeps them
/// in this order.
struct Measures {
  static constexpr double none = std::numeric_limits<double>::quiet_NaN();

  double accepted = 0.0;  ///< Σ 2^kind over the kinds of [verdict] accept
  double pure_law =
      0.0;  ///< 1 where the problem asks for the law without a step potential, which has no step everywhere
  /// The largest |H(z_k) - H(z_0)| over the energy exchanged between the terms of H, and its level, or its mean over
  /// that of the terms, where that is larger: of no level (EnergyExchange).
  double energy = none, energy_t = none;
  double exchanged = none;  ///< that energy, its mean over the run
  /// The fewest steps per turn of the fastest motion (LocalFrequency, WaveMeter), the level, and the fewest that the
  /// scheme resolves.
  double turn = none, turn_t = none, turn_least = none;
  /// Of a lattice, the largest share of a field's power in the last third of its waves, and the level (WaveMeter).
  double waves = none, waves_t = none;
  /// 1 where a full spectrum is no sign of a fault: random data, a chain of particles.
  double rough = 0.0;
  /// The share of the energy at the start in waves that the scheme does not move although the equation does.
  double frozen = none;
  /// The largest break at the seam of the period, of initial data and of S as a function of place (SeamMeter).
  double period = none;
  /// The largest of a field beside the seam over the largest of it anywhere, and the level at which it is: a remark.
  double seam = none, seam_t = none;
  /// |exact - initial| at the start, and the residual of the exact solution in the equation, relative (ExactMeter).
  double exact_start = none, exact_residual = none;
  /// Of a run that failed, the time at which it ended, and that at which it should have.
  double end = none, end_wanted = none;
  /// Of a stated action, what its variation is off a row of the equation as steps and cells get smaller, relative to
  /// the terms of the row; 0 where it approximates all of them (consistency_of, off_motion).
  double action = none;
  /// How far [initial] and S as functions of place are off what the grid holds of them (lost_between_nodes).
  double between_nodes = none;
  /// The first level that a step over a pole of H leads to (PoleWatch).
  double pole_t = none;
  /// Of a boundary-value problem: what its solution is off beside one with half the step, and the level (StepError);
  /// infinite where there is none.
  double halved = none, halved_t = none;
  /// The directions that its conditions leave open (OpenDirections), and 1 where the duration, or the energy, changes
  /// along them.
  double open = none, open_duration = none, open_energy = none;
  /// 1 where its solution is an equilibrium, and its guess moves.
  double rest = none;

  [[nodiscard]] bool accepts(ReasonKind kind) const {
    return (static_cast<unsigned>(accepted) >> static_cast<unsigned>(kind) & 1U) != 0;
  }

  template <typename Self, typename Visitor>
  static void visit(Self& self, Visitor&& visitor) {
    for (auto* value : {&self.accepted,       &self.pure_law,   &self.energy,   &self.energy_t,   &self.turn,
                        &self.turn_t,         &self.turn_least, &self.waves,    &self.waves_t,    &self.rough,
                        &self.frozen,         &self.period,     &self.seam,     &self.seam_t,     &self.exact_start,
                        &self.exact_residual, &self.exchanged,  &self.end,      &self.end_wanted, &self.action,
                        &self.between_nodes,  &self.halved,     &self.halved_t, &self.open,       &self.open_duration,
                        &self.open_energy,    &self.rest,       &self.pole_t}) {
      visitor(*value);
    }
  }
};

/// Where a record keeps the measures of its run.
inline constexpr std::string_view measures_name = "verdict";
inline constexpr std::string_view measures_path = "/checkpoint/verdict";
[[nodiscard]] std::vector<double> to_values(const Measures& measures);
/// Those that are missing, in a record of another version, are not numbers.
[[nodiscard]] Measures measures_of(std::span<const double> values);

/// Why a run is not good.
struct Reason {
  ReasonKind kind = ReasonKind::energy;
  Verdict verdict = Verdict::doubtful;  ///< that it leads to
  double value = 0.0;                   ///< the figure that it rests on
  std::string finding, remedy;          ///< without a full stop
};

struct Judgement {
  Verdict verdict = Verdict::good;  ///< the worst of the reasons that count
  std::vector<Reason> reasons;      ///< that count
  std::vector<Reason> accepted;     ///< that [verdict] accept turns off
};
[[nodiscard]] Judgement judge(const Statistics& statistics);

/// "lost: node energy …; take smaller steps" in one line.
[[nodiscard]] std::string text_of(const Judgement& judgement);

}  // namespace rubato::figures
