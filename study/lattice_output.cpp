#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include <fmt/format.h>

#include <rubato/pde/lattice_between.hpp>
#include <rubato/study/lattice_problem.hpp>
#include <rubato/study/output.hpp>
#include <rubato/study/reader.hpp>

namespace rubato::study {

namespace {

/// One of [output.quantities]: a number, or one for each node.
class LatticeQuantity {
public:
  LatticeQuantity(const Problem& problem, const OutputQuantity& quantity, const MultisymplecticSystem& system,
                  const grids::Grid& grid)
      : name_(quantity.name) {
    const MultisymplecticProblem& pde = *problem.multisymplectic();
    auto graph = std::make_shared<formula::Graph>();
    std::vector<formula::Expression> integrands;
    const formula::Expression value =
        problem.build_quantity(quantity.formula, *graph, quantity_names(pde), pde.fields, integrands);
    for (const auto& formula : integrands) {
      refuse_midpoints(*graph, formula, quantity, system);
    }
    refuse_midpoints(*graph, value, quantity, system);
    std::vector<std::string> numbers;
    for (std::size_t i = 0; i < integrands.size(); ++i) {
      numbers.push_back(fmt::format("integral {}", i + 1));
    }
    for (const std::size_t variable : formula::variables_of(value)) {
      const std::string& name = graph->variable_name(variable);
      is_field_ = is_field_ || (name != "t" && !name.starts_with("integral "));
    }
    if (quantity.at || !is_field_) {
      std::vector<double> point;
      for (int a = 0; a < grid.dimensions(); ++a) {
        point.push_back(quantity.at ? (*quantity.at)[static_cast<std::size_t>(a)] : grid.axis(a).from);
      }
      point_.emplace(grid, std::move(point));
      is_field_ = false;
    }
    if (!integrands.empty()) {
      integrands_.emplace(graph, std::move(integrands), pde.fields, grid);
    }
    value_.emplace(graph, std::vector{value}, pde.fields, grid, std::move(numbers));
  }

  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] bool is_field() const { return is_field_; }
  [[nodiscard]] std::vector<double> at(const LatticeLevel& level, double t) {
    const std::vector<double> numbers = integrands_ ? integrands_->integrals(level, t) : std::vector<double>();
    return point_ ? value_->at_point(level, t, *point_, numbers) : std::move((*value_)(level, t, numbers).front());
  }

private:
  static void refuse_midpoints(const formula::Graph& graph, formula::Expression formula, const OutputQuantity& quantity,
                               const MultisymplecticSystem& system) {
    for (const std::size_t variable : formula::variables_of(formula)) {
      std::string name = graph.variable_name(variable);
      while (name.ends_with(")")) {  // dx(f)
        name = name.substr(3, name.size() - 4);
      }
      const auto found = std::ranges::find(system.fields(), name);
      if (found != system.fields().end() && system.structure().at_midpoints(system.field(name))) {
        throw ProblemError(
            quantity.formula.location,
            fmt::format("{} exists in the middle of steps only, and quantities are told at times", name));
      }
    }
  }

  std::string name_;
  bool is_field_ = false;
  std::optional<NodeFormula> integrands_, value_;
  std::optional<grids::PointInterpolation> point_;
};

class LatticeOutput final : public OutputMaker {
public:
  explicit LatticeOutput(const Problem& problem)
      : with_states_(problem.output.states_at_times()),
        system_(make_system(problem)),
        grid_(make_grid(problem)),
        method_(make_method(problem)),
        level_(make_initial_level(problem, system_, grid_)),
        next_(level_) {
    for (const OutputQuantity& quantity : problem.output.quantities) {
      quantities_.emplace_back(problem, quantity, system_, grid_);
    }
    if (problem.output.has_times()) {
      const double direction = problem.scheme.until < problem.start() ? -1.0 : 1.0;
      between_.emplace(*method_, system_, grid_, level_, problem.scheme.step.value_or(direction));
    }
  }

  void describe(record::Layout& layout) const override {
    std::vector<std::string> nodes;
    for (int a = grid_.dimensions() - 1; a >= 0; --a) {
      nodes.push_back("/grid/" + grid_.axis(a).name);
    }
    if (with_states_) {
      for (const int f : told()) {
        const std::string& name = system_.fields()[static_cast<std::size_t>(f)];
        layout.datasets.push_back({"/output/" + name, "/output/t", nodes, record::Type::f64,
                                   "field " + name + " at the output times, by dense output", true});
      }
    }
    for (const LatticeQuantity& quantity : quantities_) {
      layout.datasets.push_back({"/output/quantities/" + quantity.name(), "/output/t",
                                 quantity.is_field() ? nodes : std::vector<std::string>(), record::Type::f64,
                                 quantity.name() + " of [output.quantities] at the output times", true});
    }
  }

  bool append(RowSink& sink, std::size_t first, const OutputStep& step, double t) override {
    std::ranges::copy(step.z_0, level_.fields.all().begin());
    std::ranges::copy(step.z_1, next_.fields.all().begin());
    const bool known = between_->take(level_, next_, step.h, fraction_of(step, t)) == Status::success;
    return tell(sink, first, between_->level(), t) && known;
  }
  bool append(RowSink& sink, std::size_t first, std::span<const double> z, double t) override {
    std::ranges::copy(z, level_.fields.all().begin());
    return tell(sink, first, level_, t);
  }

private:
  /// The fields that there are at any time, and not in the middle of steps only.
  [[nodiscard]] std::vector<int> told() const {
    std::vector<int> fields;
    for (int f = 0; f < system_.field_count(); ++f) {
      if (!system_.structure().at_midpoints(f)) {
        fields.push_back(f);
      }
    }
    return fields;
  }

  bool tell(RowSink& sink, std::size_t first, const LatticeLevel& level, double t) {
    if (with_states_) {
      for (const int f : told()) {
        sink.append(first++, level.fields.field(f));
      }
    }
    bool defined = true;
    for (LatticeQuantity& quantity : quantities_) {
      const std::vector<double> values = quantity.at(level, t);
      sink.append(first++, std::span<const double>(values));
      defined = defined && std::ranges::all_of(values, [](double value) { return std::isfinite(value); });
    }
    return defined;
  }

  bool with_states_;
  MultisymplecticSystem system_;
  grids::Grid grid_;
  std::unique_ptr<LatticeMethod> method_;
  LatticeLevel level_, next_;
  std::vector<LatticeQuantity> quantities_;
  std::optional<LatticeBetween> between_;
};

}  // namespace

std::unique_ptr<OutputMaker> make_lattice_output(const Problem& problem) {
  return std::make_unique<LatticeOutput>(problem);
}

}  // namespace rubato::study
