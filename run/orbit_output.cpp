#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

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
    const double fraction = fraction_of(step, t);
    const bool known = between_->at(step.z_0, step.z_1, step.h, fraction, z_) == Status::success;
    return tell(sink, t) && known;
  }
  bool append(RowSink& sink, std::span<const double> z, double t) override {
    std::ranges::copy(z, z_.begin());
    return tell(sink, t);
  }

private:
  bool tell(RowSink& sink, double t) {
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
