#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include <rubato/base/larger.hpp>
#include <rubato/base/state.hpp>
#include <rubato/variation/time_levels.hpp>

namespace rubato::study {

struct Range {
  double min = std::numeric_limits<double>::infinity();
  double max = -std::numeric_limits<double>::infinity();
  void add(double value) {
    min = std::min(min, value);
    max = std::max(max, value);
  }
};

/// Largest magnitude and root mean square of many values.
struct MaxRms {
  double max = 0.0;
  double sum_of_squares = 0.0;
  double count = 0.0;
  void add(double value) {
    max = larger(max, std::abs(value));
    sum_of_squares += value * value;
    count += 1.0;
  }
  void add(const MaxRms& other) {
    max = larger(max, other.max);
    sum_of_squares += other.sum_of_squares;
    count += other.count;
  }
  [[nodiscard]] double rms() const { return count > 0.0 ? std::sqrt(sum_of_squares / count) : 0.0; }
};

/// A conserved quantity along a run: its first value and how far it strayed.
struct Deviation {
  double initial = 0.0;
  double max = 0.0;
  void start(double value) { initial = value; }
  void add(double value) { max = larger(max, std::abs(value - initial)); }
};

/// A quantity under its name, in the order of the problem file.
template <typename T>
struct Named {
  std::string name;
  T value = {};
};

void start(std::vector<Named<Deviation>>& deviations, std::span<const double> values);
void add(std::vector<Named<Deviation>>& deviations, std::span<const double> values);

/// What a run tells of how well each law held, gathered level by level. The same class serves `run`, which feeds it as
/// it goes, and `check`, which feeds it from the record.
struct Statistics {
  std::size_t steps = 0;
  double t = 0.0;
  Range h;
  double energy = 0.0;            ///< E_0
  double energy_deviation = 0.0;  ///< max |E_k - E_0| off bridges; or, if not autonomous, what (3.4) leaves
  double bridge_deviation = 0.0;  ///< the same on bridges
  bool autonomous = true;
  Range energy_magnitude;  ///< of |H(z_k)|
  Deviation node_energy;
  Range gamma;
  std::size_t bridges = 0;
  std::size_t bridge_steps = 0;
  double condition = 0.0;
  double iterations = 0.0;
  double most_iterations = 0.0;
  std::vector<Named<MaxRms>> residuals;
  std::vector<Named<Deviation>> invariants;
  std::vector<Named<Deviation>> totals;  ///< of the densities of local laws
  std::vector<Named<MaxRms>> errors;     ///< at the last level

  /// max(|E_0|, max |H| on the orbit): what energies are relative to.
  [[nodiscard]] double energy_scale() const { return std::max(std::abs(energy), energy_magnitude.max); }
  [[nodiscard]] double relative_energy_deviation() const { return relative(energy_deviation); }
  [[nodiscard]] double relative_bridge_deviation() const { return relative(bridge_deviation); }

  void add_start(double t, const LevelNode& node, std::span<const double> invariant_values,
                 std::span<const double> total_values);
  void add_step(const StepReport& report, double t, const LevelNode& node, std::span<const double> invariant_values,
                std::span<const double> total_values);

  /// One sentence for each invariant and each error that is not a number, since its formula left its domain.
  [[nodiscard]] std::vector<std::string> undefined_quantities() const;

  void save(StateWriter& state) const;
  /// The names must be in place already.
  void restore(StateReader& state);

private:
  void add_level(double t, const LevelNode& node);
  [[nodiscard]] double relative(double deviation) const { return deviation == 0.0 ? 0.0 : deviation / energy_scale(); }
  template <typename Visitor>
  void visit(Visitor&& visitor);
};

}  // namespace rubato::study
