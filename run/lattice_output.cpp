#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include <rubato/grids/reductions.hpp>
#include <rubato/pde/lattice_between.hpp>
#include <rubato/pde/nodal_view.hpp>
#include <rubato/problem/lattice_problem.hpp>
#include <rubato/run/lattice_quantity.hpp>
#include <rubato/run/output.hpp>

namespace rubato {

namespace {

class LatticeOutput final : public OutputMaker {
public:
  explicit LatticeOutput(const Problem& problem)
      : with_states_(problem.output.states_at_times()),
        system_(make_system(problem)),
        grid_(present_grid(problem)),
        method_(make_method(problem)),
        level_(make_initial_level(problem, system_, grid_)),
        next_(level_),
        nodal_(system_, grid_, method_->in_mirror().value_or(Collocation::cells)) {
    for (const OutputQuantity& quantity : problem.output.quantities) {
      quantities_.emplace_back(problem, quantity, system_, grid_);
    }
    whole_ = WholeFields(make_jumps(problem), grid_, system_.field_count());
    if (auto frame = make_frame(problem)) {
      laboratory_.emplace(std::move(*frame), grid_);
    }
    if (problem.output.has_times()) {
      const double direction = problem.scheme.until < problem.start() ? -1.0 : 1.0;
      between_.emplace(*method_, system_, grid_, level_, problem.scheme.step.value_or(direction));
    }
  }

  void describe(record::Layout& layout) override {
    std::vector<std::string> nodes;
    for (int a = grid_.dimensions() - 1; a >= 0; --a) {
      nodes.push_back("/grid/" + grid_.axis(a).name);
    }
    if (with_states_) {
      for (const int f : reported()) {
        const std::string& name = system_.fields()[static_cast<std::size_t>(f)];
        columns_.push_back(layout.add({"/output/" + name, "/output/t", nodes, record::Type::f64,
                                       "field " + name + " at the output times, by dense output", true}));
      }
    }
    for (const LatticeQuantity& quantity : quantities_) {
      quantity_columns_.push_back(
          layout.add({"/output/quantities/" + quantity.name(), "/output/t",
                      quantity.is_field() ? nodes : std::vector<std::string>(), record::Type::f64,
                      quantity.name() + " of [output.quantities] at the output times", true}));
    }
  }

  bool append(RowSink& sink, const OutputStep& step, double t) override {
    std::ranges::copy(step.z_0, level_.fields.all().begin());
    std::ranges::copy(step.z_1, next_.fields.all().begin());
    const bool known = between_->take(level_, next_, step.t_0, step.h, fraction_of(step, t)) == Status::success;
    return write(sink, between_->level(), t) && known;
  }
  bool append(RowSink& sink, std::span<const double> z, double t) override {
    std::ranges::copy(z, level_.fields.all().begin());
    return write(sink, level_, t);
  }

private:
  /// The fields that there are at any time, and not in the middle of steps only.
  [[nodiscard]] std::vector<int> reported() const {
    std::vector<int> fields;
    for (int f = 0; f < system_.field_count(); ++f) {
      if (!system_.structure().at_midpoints(f)) {
        fields.push_back(f);
      }
    }
    return fields;
  }

  bool write(RowSink& sink, const LatticeLevel& level, double t) {
    if (with_states_) {
      const LatticeLevel& shown = nodal_(laboratory_ ? (*laboratory_)(level, t) : level);
      auto column = columns_.begin();
      for (const int f : reported()) {
        sink.append(*column++, whole_(f, shown.fields.all()));
      }
    }
    bool defined = true;
    auto column = quantity_columns_.begin();
    for (LatticeQuantity& quantity : quantities_) {
      const std::vector<double> values = quantity.at(level, t);
      sink.append(*column++, std::span<const double>(values));
      defined = std::isfinite(grids::max_abs(values)) && defined;  // of all ranks
    }
    return defined;
  }

  bool with_states_;
  MultisymplecticSystem system_;
  grids::Grid grid_;
  std::unique_ptr<LatticeMethod> method_;
  LatticeLevel level_, next_;
  NodalView nodal_;
  std::vector<LatticeQuantity> quantities_;
  std::optional<LaboratoryView> laboratory_;  ///< output times are of the laboratory
  WholeFields whole_;
  std::vector<record::Column> columns_, quantity_columns_;  ///< of the fields reported, and of the quantities
  std::optional<LatticeBetween> between_;
};

}  // namespace

std::unique_ptr<OutputMaker> make_lattice_output(const Problem& problem) {
  return std::make_unique<LatticeOutput>(problem);
}

}  // namespace rubato
