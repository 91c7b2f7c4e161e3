#include <algorithm>
#include <bit>
#include <cmath>
#include <iterator>
#include <limits>

#include <fmt/format.h>

#include <rubato/figures/text.hpp>
#include <rubato/pde/mirrors.hpp>
#include <rubato/pde/shared_slopes.hpp>
#include <rubato/problem/energy_terms.hpp>
#include <rubato/problem/lattice_problem.hpp>
#include <rubato/run/exact_measures.hpp>
#include <rubato/run/lattice_meter.hpp>
#include <rubato/run/lattice_residuals.hpp>
#include <rubato/run/simulation.hpp>

namespace rubato {

namespace {

/// For measures, which ranks do not take.
std::optional<Mirrors> make_mirrors(const LatticeIntegrator& lattice) {
  const bool are_read = lattice.grid().has_walls() && grids::Slab::present() == nullptr;
  return are_read ? std::optional<Mirrors>(std::in_place, lattice.system(), lattice.grid(),
                                           lattice.method().in_mirror().value_or(Collocation::nodes))
                  : std::nullopt;
}

class LatticeSimulation final : public Simulation {
public:
  LatticeSimulation(const Problem& problem, bool tangents)
      : laws_(problem.laws),
        evolving_alone_(problem.stores_evolving_alone()),
        lattice_(make_lattice(problem)),
        residuals_(lattice_.method(), lattice_.laws(), lattice_.system(), lattice_.grid(),
                   {.variational = !laws_.none(), .tangents = tangents, .cells = laws_.fields}),
        invariants_(make_invariants(problem, lattice_.system(), lattice_.grid())),
        exact_(make_exact(problem, lattice_.system(), lattice_.grid())),
        frame_(make_frame(problem)),
        whole_(make_jumps(problem), lattice_.grid(), lattice_.system().field_count()),
        energy_terms_(make_energy_terms(lattice_.system(), lattice_.grid())),
        mirrors_(make_mirrors(lattice_)),
        meter_(problem, lattice_.system(), lattice_.grid(), lattice_.level(), mirrors_ ? &*mirrors_ : nullptr),
        previous_t_(lattice_.t()) {
    step_by(lattice_);
    for (const auto& formula : problem.multisymplectic()->initial) {
      given_.push_back(formula.has_value());
    }
    if (tangents && laws_.none()) {
      throw ProblemError(laws_.location,
                         "[laws] every = false takes no laws, and --tangents asks for one: leave out one");
    }
  }

  [[nodiscard]] std::vector<std::string> warnings() const override {
    std::vector<std::string> warnings;
    if (residuals_.tangent_status() != Status::success) {
      warnings.push_back(
          fmt::format("the tangent solutions ended early ({}), and with them the multisymplectic residual: a smaller "
                      "step may help",
                      to_string(residuals_.tangent_status())));
    }
    return warnings;
  }

  [[nodiscard]] std::vector<std::string> invariant_names() const override { return invariants_.names(); }
  [[nodiscard]] std::span<const double> invariants() override {
    return invariant_values_ = invariants_.integrals(lattice_.level(), t());
  }

  [[nodiscard]] std::span<const double> energy_term_values() override {
    energy_values_.clear();
    for (NodeFormula& terms : energy_terms_) {
      const std::vector<double> values = terms.integrals(lattice_.level(), t());
      energy_values_.insert(energy_values_.end(), values.begin(), values.end());
    }
    return energy_values_;
  }

  void measure(std::size_t number, figures::Measures& measures) override {
    if (grids::Slab::present() != nullptr) {
      return;
    }
    const LatticeLevel& level = lattice_.level();
    std::vector<double> magnitudes;
    for (int f = 0; f < level.fields.fields(); ++f) {
      magnitudes.push_back(
          std::max(grids::max_abs(level.fields.field(f)), whole_.largest_addend(f, level.fields.all())));
    }
    meter_.measure(level, magnitudes, number, t(), last_h_, measures,
                   frame_ && std::has_single_bit(number) ? &lattice_.previous() : nullptr);
    // A wave that rests in the frame shows no increment.
    if (number < (frame_ ? 1U : 2U)) {
      measure_exact(number == 0, measures);
    }
  }

  [[nodiscard]] std::vector<std::string> total_names() const override {
    std::vector<std::string> names;
    if (!laws_.none()) {  // the first is energy, which node() gives
      std::ranges::transform(residuals_.in_cells().subspan(1), std::back_inserter(names), &Law::name);
    }
    if (lattice_.energy_lost()) {
      names.emplace_back(figures::energy_lost_name);
    }
    if (lattice_.work()) {
      names.emplace_back(figures::wall_work_name);
    }
    return names;
  }
  [[nodiscard]] std::span<const double> totals(bool taken) override {
    if (taken) {
      total_values_ = residuals_.took_cells() ? lattice_.totals_after_residuals() : lattice_.totals();
      total_values_.erase(total_values_.begin());
    } else {
      total_values_.assign(laws_.none() ? 0 : residuals_.in_cells().size() - 1,
                           std::numeric_limits<double>::quiet_NaN());
    }
    if (const auto lost = lattice_.energy_lost()) {
      total_values_.push_back(*lost);
    }
    if (const auto work = lattice_.work()) {
      total_values_.push_back(*work);
    }
    return total_values_;
  }

  [[nodiscard]] std::vector<Named<Spread>> errors() override {
    return lattice_errors(exact_, lattice_.system(), lattice_.level(), t());
  }

  [[nodiscard]] std::span<Law> laws() override { return laws_.none() ? std::span<Law>() : residuals_.laws(); }
  [[nodiscard]] std::span<const Law> laws() const override {
    return laws_.none() ? std::span<const Law>() : residuals_.laws();
  }

  void describe_states(record::Layout& layout, bool with_previous) override {
    const grids::Slab* const slab = grids::Slab::present();
    const grids::Grid& grid = slab == nullptr ? lattice_.grid() : slab->whole();
    std::vector<std::string> nodes, cells;
    for (int a = grid.dimensions() - 1; a >= 0; --a) {
      nodes.push_back("/grid/" + grid.axis(a).name);
      cells.push_back("/grid/" + grid.axis(a).name + "_cell");
    }
    for (int a = 0; a < grid.dimensions(); ++a) {
      std::vector<double> node, centre;
      for (std::size_t i = 0; i < grid.cells(a); ++i) {
        node.push_back(grid.axis(a).node(i));
      }
      for (std::size_t i = 0; i < grid.axis(a).cell_count(); ++i) {
        centre.push_back(grid.axis(a).centre(i));
      }
      layout.scales.push_back({"/grid/" + grid.axis(a).name, node, "coordinates of the nodes"});
      layout.scales.push_back(
          {"/grid/" + grid.axis(a).name + "_cell", centre, "coordinates of the middle of the cells"});
    }
    const auto describe = [&](const std::string& path, const std::string& axis, const auto& dimensions,
                              const std::string& description, bool may_be_undefined = false) {
      return layout.add({path, axis, dimensions, record::Type::f64, description, may_be_undefined});
    };
    for (int f = 0; f < lattice_.system().field_count(); ++f) {
      const std::string& name = lattice_.system().fields()[static_cast<std::size_t>(f)];
      if (evolving_alone_ && !is_stored_alone(lattice_.system(), f, exact_.names())) {
        continue;
      }
      if (at_midpoints(f)) {
        field_columns_.emplace_back(
            f, describe("/states/midpoints/" + name, "/states/t", nodes,
                        "field " + name +
                            " in the middle of the step that led to the stored level, the only place where it exists; "
                            "undefined at the start",
                        true));
      } else {
        field_columns_.emplace_back(f, describe("/states/" + name, "/states/t", nodes,
                                                "field " + name + " at the stored levels" + slope_remark(f)));
      }
    }
    if (with_previous && !evolving_alone_) {
      const std::string before = "one level before each stored one (the first row repeats the start)";
      previous_t_column_ =
          describe("/states/previous/t", "/states/previous/t", std::vector<std::string>(), "time " + before);
      for (int f = 0; f < lattice_.system().field_count(); ++f) {
        const std::string& name = lattice_.system().fields()[static_cast<std::size_t>(f)];
        if (!at_midpoints(f)) {
          previous_columns_.emplace_back(
              f, describe("/states/previous/" + name, "/states/previous/t", nodes, "field " + name + " " + before));
        }
      }
    }
    for (const std::string& name : exact_.names()) {
      exact_columns_.push_back(describe("/exact/" + name, "/states/t", nodes, "exact solution, from [exact]", true));
    }
    if (frame_) {
      describe_frame(layout);
    }
    for (Law& law : laws()) {
      if (law.has_cells()) {
        law.describe_cells(layout, lattice_.method().laws_in_cells() ? cells : nodes, laws_.every != 1);
      }
    }
  }

  void append_states(RowSink& sink, std::size_t /*count*/, std::size_t /*stride*/) override {
    for (const auto& [field, column] : field_columns_) {
      if (at_midpoints(field) && last_h_ == 0.0) {
        const std::vector<double> undefined(lattice_.grid().size(), std::numeric_limits<double>::quiet_NaN());
        sink.append(column, std::span<const double>(undefined));
      } else {
        sink.append(column, whole_(field, lattice_.level().fields.all()));
      }
    }
    if (!previous_columns_.empty()) {
      sink.append(previous_t_column_, previous_t_);
      for (const auto& [field, column] : previous_columns_) {
        sink.append(column, whole_(field, lattice_.previous().fields.all()));
      }
    }
    const auto exact = exact_.at(lattice_.level(), t());
    for (std::size_t i = 0; i < exact.size(); ++i) {
      sink.append(exact_columns_[i], std::span<const double>(exact[i]));
    }
    if (frame_) {
      const auto shift = frame_->shift(t());
      sink.append(shift_column_, std::span(shift).first(static_cast<std::size_t>(lattice_.grid().dimensions())));
      if (frame_->rate != 0.0) {
        sink.append(phase_column_, frame_->phase(t()));
        const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> turn = frame_->turn(t());
        sink.append(turn_column_, std::span<const double>(turn.data(), static_cast<std::size_t>(turn.size())));
      }
    }
    for (const Law& law : laws()) {
      if (law.has_cells()) {
        law.append_cells(sink);
      }
    }
  }

  [[nodiscard]] double clock() const override { return t(); }  // the level before may have to be computed
  [[nodiscard]] OutputStep last() const override {
    return {.z_0 = lattice_.previous().fields.all(),
            .z_1 = lattice_.level().fields.all(),
            .t_0 = previous_t_,
            .t_1 = t(),
            .h = last_h_};
  }

  void save(StateWriter& state) const override {
    lattice_.save(state);
    state.write(previous_t_);
    state.write(last_h_);
    if (laws_.every != 1) {
      state.write(static_cast<double>(steps_));
    }
    residuals_.save(state);
  }
  void restore(StateReader& state) override {
    lattice_.restore(state);
    state.read(previous_t_);
    state.read(last_h_);
    if (laws_.every != 1) {
      state.read(steps_);
    }
    residuals_.restore(state, lattice_.previous(), lattice_.level(), last_h_, LatticeResiduals::part(laws_, steps_));
  }

protected:
  [[nodiscard]] StepReport step(std::size_t /*place*/) override {
    const double before = lattice_.t();
    const StepReport report = lattice_.step();
    if (report.status == Status::success) {
      previous_t_ = before;
      last_h_ = report.h;
      ++steps_;
      if (const LatticeResiduals::Part wanted = LatticeResiduals::part(laws_, steps_); residuals_.may_skip(wanted)) {
        residuals_.skip();
      } else {
        residuals_.take(lattice_.previous(), lattice_.level(), report.h, wanted);
      }
    }
    return report;
  }

private:
  /// At the start, of the fields that are given there; or after the first step.
  void measure_exact(bool is_start, figures::Measures& measures) {
    if (exact_.names().empty()) {
      return;
    }
    const auto exact = exact_.at(lattice_.level(), t());
    const auto exact_before = is_start ? exact : exact_.at(lattice_.previous(), previous_t_);
    const auto exact_after = is_start || order() > 1 ? std::vector<std::vector<double>>(exact.size())
                                                     : exact_.at(lattice_.level(), 2.0 * t() - previous_t_);
    // A field that turns at the start moves by the square of the step, and the error of the grid in the rates of
    // others.
    constexpr double turning = 0.1;
    std::vector<double> moved;
    for (std::size_t i = 0; i < exact.size(); ++i) {
      double increment = 0.0, size = 0.0;
      for (std::size_t node = 0; node < exact[i].size(); ++node) {
        increment = std::max(increment, std::abs(exact[i][node] - exact_before[i][node]));
        size = std::max(size, std::abs(exact[i][node]));
      }
      moved.push_back(size > 0.0 ? increment / size : 0.0);
    }
    const double most = *std::ranges::max_element(moved);
    for (std::size_t i = 0; i < exact.size(); ++i) {
      const int field = lattice_.system().field(exact_.names()[i]);
      if (has_slope(lattice_.level().slopes, static_cast<std::size_t>(field), lattice_.grid())) {
        continue;  // states have the periodic part alone
      }
      if (!is_start && lattice_.system().structure().algebraic[static_cast<std::size_t>(field)]) {
        continue;  // differences of neighbours may lie half a cell off their node
      }
      if (!is_start && moved[i] >= turning * most) {
        const std::span<const double> whole = whole_(field, lattice_.level().fields.all());
        const std::vector<double> now(whole.begin(), whole.end());
        compare_increments(now, whole_(field, lattice_.previous().fields.all()), exact[i], exact_before[i],
                           exact_after[i], measures.exact_residual);
      } else if (is_start && given_[static_cast<std::size_t>(field)]) {
        const std::span<const double> whole = whole_(field, lattice_.level().fields.all());
        double size = 0.0, error = 0.0;
        for (std::size_t node = 0; node < whole.size(); ++node) {
          size = std::max({size, std::abs(whole[node]), std::abs(exact[i][node])});
          error = std::max(error, std::abs(whole[node] - exact[i][node]));
        }
        compare_exact(error, 0.0, size, measures.exact_start);
      }
    }
  }

  void describe_frame(record::Layout& layout) {
    const int directions = lattice_.grid().dimensions();
    if (directions > 1) {
      std::vector<std::string> axes;
      for (const grids::Axis& axis : lattice_.grid().axes()) {
        axes.push_back(axis.name);
      }
      layout.scales.push_back({"/frame/direction", axes, "names of the directions"});
    }
    shift_column_ = layout.add(
        {"/frame/shift", "/states/t",
         directions > 1 ? std::vector<std::string>{"/frame/direction"} : std::vector<std::string>(), record::Type::f64,
         "how far the nodes of the frame have moved at the stored levels: x = node + shift"});
    for (int f = 0; f < lattice_.system().field_count(); ++f) {
      std::vector<double> jump;
      std::ranges::transform(frame_->jumps, std::back_inserter(jump), [f](const auto& of_all) { return of_all(f); });
      if (std::ranges::any_of(jump, [](double value) { return value != 0.0; })) {
        layout.scales.push_back({"/frame/jump/" + lattice_.system().fields()[static_cast<std::size_t>(f)], jump,
                                 "how much larger the field is one period farther, for each direction"});
      }
    }
    if (frame_->rate != 0.0) {
      layout.scales.push_back({"/frame/row", lattice_.system().fields(), "names of the fields"});
      layout.scales.push_back({"/frame/column", lattice_.system().fields(), "names of the fields"});
      phase_column_ = layout.add({"/frame/phase",
                                  "/states/t",
                                  {},
                                  record::Type::f64,
                                  "the angle by which the frame has turned at the stored levels"});
      turn_column_ = layout.add({"/frame/turn",
                                 "/states/t",
                                 {"/frame/row", "/frame/column"},
                                 record::Type::f64,
                                 "exp(phase B), which takes the stored fields to those of the laboratory"});
    }
  }

  [[nodiscard]] bool at_midpoints(int field) const { return lattice_.system().structure().at_midpoints(field); }

  /// Of a potential only the periodic part is a grid function.
  [[nodiscard]] std::string slope_remark(int field) const {
    const bool sloping = has_slope(lattice_.level().slopes, static_cast<std::size_t>(field), lattice_.grid());
    return sloping ? ", its periodic part (the whole potential has a mean slope along x)" : "";
  }

  const Laws& laws_;
  const bool evolving_alone_;
  LatticeIntegrator lattice_;
  LatticeResiduals residuals_;
  NodeTable invariants_, exact_;
  std::optional<MovingFrame> frame_;
  WholeFields whole_;
  std::vector<NodeFormula> energy_terms_;
  std::optional<Mirrors> mirrors_;  ///< between walls: what is periodic
  LatticeMeter meter_;
  std::vector<bool> given_;  ///< the fields with initial data of their own
  std::vector<double> invariant_values_, total_values_, energy_values_;
  double previous_t_;
  double last_h_ = 0.0;  ///< of the step taken last; 0 before the first
  std::size_t steps_ = 0;
  std::vector<record::Column> exact_columns_;
  std::vector<std::pair<int, record::Column>> field_columns_;  ///< of the fields that are stored
  record::Column previous_t_column_, shift_column_, phase_column_, turn_column_;
  std::vector<std::pair<int, record::Column>> previous_columns_;  ///< of the fields at levels, where they are stored
};

}  // namespace

std::unique_ptr<Simulation> make_lattice_simulation(const Problem& problem, bool tangents) {
  try {
    return std::make_unique<LatticeSimulation>(problem, tangents);
  } catch (const SchemeRefusal& error) {
    throw ProblemError(problem.scheme.lagrangian_location, error.what());
  }
}

}  // namespace rubato
