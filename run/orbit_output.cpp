#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include <rubato/base/limits.hpp>
#include <rubato/problem/formula_table.hpp>
#include <rubato/problem/reader.hpp>
#include <rubato/run/orbit_levels.hpp>
#include <rubato/run/output.hpp>

namespace rubato {

namespace {

std::vector<NamedFormula> formulas_of(const std::vector<OutputQuantity>& quantities) {
  std::vector<NamedFormula> formulas;
  for (const OutputQuantity& quantity : quantities) {
    formulas.push_back({quantity.name, quantity.formula});
  }
  return formulas;
}

class OrbitOutput final : public OutputMaker {
public:
  explicit OrbitOutput(const Problem& problem)
      : with_states_(problem.output.states_at_times()),
        names_(quantity_names(*problem.hamiltonian(), problem.parameters)),
        quantities_(problem, formulas_of(problem.output.quantities), names_),
        z_(start_of(*problem.hamiltonian())) {
    if (problem.output.has_times()) {
      between_.emplace(make_between(problem, "output.times and output.interval"));
    }
    if (!problem.output.quantities.empty()) {
      reads_velocities_ = make_velocities(problem);
    }
  }

  void describe(record::Layout& layout) override {
    if (with_states_) {
      q_ = layout.add({"/output/q",
                       "/output/t",
                       {"/states/coordinate"},
                       record::Type::f64,
                       "coordinates at the output times, by dense output",
                       true});
      p_ = layout.add({"/output/p",
                       "/output/t",
                       {"/states/momentum"},
                       record::Type::f64,
                       "momenta at the output times, by dense output",
                       true});
    }
    for (const std::string& name : quantities_.names()) {
      columns_.push_back(layout.add({"/output/quantities/" + name,
                                     "/output/t",
                                     {},
                                     record::Type::f64,
                                     name + " of [output.quantities] at the output times",
                                     true}));
    }
  }

  bool append(RowSink& sink, const OutputStep& step, double t) override {
    const double fraction = step.clock ? fraction_at(step, t) : fraction_of(step, t);
    const bool known = between_->at(step.z_0, step.z_1, step.h, fraction, z_) == Status::success;
    return write(sink, t) && known;
  }
  bool append(RowSink& sink, std::span<const double> z, double t) override {
    std::ranges::copy(z, z_.begin());
    return write(sink, t);
  }
  void save(StateWriter& state) const override {
    if (between_) {
      between_->save(state);
    }
    if (reads_velocities_) {
      reads_velocities_->save_guesses(state);
    }
  }
  void restore(StateReader& state) override {
    if (between_) {
      between_->restore(state);
    }
    if (reads_velocities_) {
      reads_velocities_->restore_guesses(state);
    }
  }

private:
  /// The fraction of a step in fictitious time at which the physical time, which grows along it, is t: by regula falsi,
  /// with the Illinois rule, to rounding.
  [[nodiscard]] double fraction_at(const OutputStep& step, double t) {
    const double linear = fraction_of(step, t);
    if (!(linear > 0.0 && linear < 1.0)) {
      return linear;
    }
    constexpr int most = 60;
    const double rounding = 4.0 * epsilon * std::max(std::abs(step.begin()), std::abs(step.end()));
    double low = 0.0, high = 1.0, at_low = step.begin() - t, at_high = step.end() - t;
    double fraction = linear;
    for (int i = 0; i < most; ++i) {
      if (between_->at(step.z_0, step.z_1, step.h, fraction, z_) != Status::success) {
        return fraction;
      }
      const double miss = z_[*step.clock] - t;
      if (std::abs(miss) <= rounding) {
        break;
      }
      if ((miss < 0.0) == (at_low < 0.0)) {
        low = fraction;
        at_low = miss;
        at_high *= 0.5;
      } else {
        high = fraction;
        at_high = miss;
        at_low *= 0.5;
      }
      const double next = low - at_low * (high - low) / (at_high - at_low);
      if (next == fraction || !(next > low && next < high)) {
        break;
      }
      fraction = next;
    }
    return fraction;
  }

  bool write(RowSink& sink, double t) {
    const std::size_t n = z_.size() / 2;
    if (with_states_) {
      sink.append(q_, std::span<const double>(z_).first(n));
      sink.append(p_, std::span<const double>(z_).last(n));
    }
    arguments_ = z_;
    if (reads_velocities_) {
      reads_velocities_->restart(z_);
      const auto velocities = reads_velocities_->velocities();
      arguments_.insert(arguments_.begin() + static_cast<std::ptrdiff_t>(n), velocities.begin(), velocities.end());
    }
    arguments_.resize(names_.size(), t);
    const std::span<const double> values = quantities_(arguments_);
    bool defined = true;
    for (std::size_t i = 0; i < values.size(); ++i) {
      sink.append(columns_[i], values[i]);
      defined = defined && std::isfinite(values[i]);
    }
    return defined;
  }

  bool with_states_;
  std::vector<std::string> names_;
  FormulaTable quantities_;
  std::optional<OrbitBetween> between_;
  std::unique_ptr<OneStepScheme> reads_velocities_;  ///< of a problem stated by L
  std::vector<double> z_, arguments_;
  record::Column q_, p_;
  std::vector<record::Column> columns_;  ///< of the quantities
};

}  // namespace

std::unique_ptr<OutputMaker> make_orbit_output(const Problem& problem) {
  return std::make_unique<OrbitOutput>(problem);
}

}  // namespace rubato
