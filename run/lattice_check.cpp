#include <rubato/run/lattice_check.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <utility>

#include <fmt/format.h>

#include <rubato/base/interrupt.hpp>
#include <rubato/figures/text.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/grids/whole.hpp>
#include <rubato/problem/lattice_problem.hpp>
#include <rubato/run/event_check.hpp>
#include <rubato/run/lattice_residuals.hpp>
#include <rubato/run/lattice_solve.hpp>
#include <rubato/run/output_check.hpp>
#include <rubato/run/solution_rows.hpp>
#include <rubato/run/state_scales.hpp>
#include <rubato/run/stored_lattice.hpp>

namespace rubato {

namespace {

class LatticeCheck {
public:
  LatticeCheck(const SharedRecord& record, const StoredLevels& levels, const Problem& problem, bool has_gamma,
               Disagreements& findings)
      : record_(record),
        levels_(levels),
        problem_(problem),
        has_gamma_(has_gamma),
        findings_(findings),
        parts_(record.slab(), findings),
        system_(make_system(problem)),
        grid_(record.slab() == nullptr ? make_grid(problem) : record.slab()->grid()),
        method_(make_method(problem)),
        law_levels_(problem.laws),
        laws_(make_local_laws(*method_, system_, grid_, make_lattice_options(problem, system_).symmetries)),
        residuals_(*method_, laws_, system_, grid_,
                   {.variational = levels.complete() && !law_levels_.none(),
                    .tangents = levels.complete() && record.has("/laws/multisymplectic_max"),
                    .cells = law_levels_.fields}),
        invariants_(make_invariants(problem, system_, grid_)),
        exact_(make_exact(problem, system_, grid_)),
        stored_(record, system_, exact_, exact_.whole(), grid_.size(), levels, findings),
        after_(make_initial_level(problem, system_, grid_)),
        before_(room()),
        largest_(static_cast<std::size_t>(system_.field_count()), 0.0),
        node_energy_(record, "/levels/node_energy"),
        gamma_(record, "/levels/gamma"),
        energy_(record, "/levels/energy"),
        output_(record, levels, problem, grid_.size(), findings),
        events_(record, levels, problem, grid_.size(), findings) {
    for (const std::string& name : exact_.names()) {
      stored_exact_.emplace_back(record, "/exact/" + name, grid_.size());
    }
    if (const auto sponge = make_sponge(problem)) {
      bare_method_ = make_bare_method(problem);
      loss_.emplace(*bare_method_, system_.without_constant(), grid_, *sponge, after_);
      lost_.emplace(record, fmt::format("/laws/totals/{}", figures::energy_lost_name));
    }
    if (problem.multisymplectic()->has_drives()) {
      work_.emplace(record, fmt::format("/laws/totals/{}", figures::wall_work_name));
      driven_.emplace(make_wall_drives(problem), system_, grid_);
    }
    if (law_levels_.none()) {
      return;
    }
    for (std::size_t law = 1; law < laws_.count(); ++law) {  // the first is energy, the node energy
      totals_.emplace_back(record, "/laws/totals/" + laws_.names()[law]);
    }
    for (const std::string& name : invariants_.names()) {
      stored_invariants_.emplace_back(record, "/laws/" + name);
    }
    for (const Law& law : residuals_.laws()) {
      stored_laws_.emplace_back(record, law);
    }
  }

  Spread run() {
    std::optional<grids::FieldSet> first;  // of a periodic orbit
    record_.at_rank_0([this] {
      check_grid();
      check_frame();
    });
    output_.check_times();
    bool whole = check_start();
    if (record_.has(solution_history)) {
      first = after_.fields;
    }
    const bool in_turn = levels_.complete() && levels_.steps() > 0;
    law_slack_ = make_lattice_options(problem_, system_).stages > 1 ? stage_slack : 1.0;
    equation_ = method_->equation(system_, grid_, after_, in_turn ? levels_.h.front() : 0.0);
    check_level(0, in_turn);
    output_.check_level(0, std::as_const(after_.fields).all());
    events_.begin(std::as_const(after_.fields).all());
    bool start_known = true;
    for (std::size_t row = 1; row < levels_.state_level.size(); ++row) {
      Interruptible::end_if_asked();
      if (levels_.evolving_alone) {  // the checkpoint has the other fields, and is compared with these
        static_cast<void>(stored_.load(row, after_.fields));
        check_exact(row);
        continue;
      }
      if (levels_.sparse) {
        whole = check_previous(row);
      } else {
        std::swap(before_.fields, after_.fields);
      }
      const bool before_whole = whole;
      whole = stored_.load(row, after_.fields);
      grow_scales();
      start_known = start_known && whole && before_whole;
      if (whole && before_whole) {
        if (const auto step = levels_.step_to(row)) {
          check_step(row, *step);
        }
        output_.check_step(row, std::as_const(before_.fields).all(), std::as_const(after_.fields).all());
        events_.check_step(row, std::as_const(before_.fields).all(), std::as_const(after_.fields).all());
      }
      if (whole) {
        check_level(row, in_turn && start_known);
        output_.check_level(row, std::as_const(after_.fields).all());
      }
    }
    events_.finish();
    if (first && levels_.state_level.size() > 1) {
      check_closing(*first);
    }
    return residual_;
  }

private:
  void check_grid() {
    const record::Reader& reader = *record_.reader();
    const grids::Grid& grid = record_.slab() == nullptr ? grid_ : record_.slab()->whole();
    for (int a = 0; a < grid.dimensions(); ++a) {
      const grids::Axis& axis = grid.axis(a);
      StoredRows nodes(reader, "/grid/" + axis.name), cells(reader, "/grid/" + axis.name + "_cell");
      if (nodes.rows() != grid.cells(a) || cells.rows() != axis.cell_count()) {
        throw figures::Mismatch(reader.file(), nodes.path(),
                                fmt::format("{} has {} nodes; by the problem it should have {}", nodes.path(),
                                            nodes.rows(), grid.cells(a)));
      }
      for (std::size_t i = 0; i < grid.cells(a); ++i) {
        findings_.same(nodes.path(), i, {}, nodes.at(i), axis.node(i), "[grid] of the problem");
      }
      for (std::size_t i = 0; i < axis.cell_count(); ++i) {
        findings_.same(cells.path(), i, {}, cells.at(i), axis.centre(i), "[grid] of the problem");
      }
    }
  }

  /// What a sponge has taken, less what walls have done.
  [[nodiscard]] double lost_at(std::size_t at) { return (lost_ ? lost_->at(at) : 0.0) - (work_ ? work_->at(at) : 0.0); }

  void check_frame() {
    const std::optional<MovingFrame> frame = make_frame(problem_);
    if (!frame) {
      return;
    }
    const std::size_t states = levels_.state_t.size(), directions = frame->velocity.size();
    const record::Reader& reader = *record_.reader();
    StoredRows shift(reader, "/frame/shift", directions);
    for (std::size_t row = 0; row < states; ++row) {
      const std::array<double, 3> expected = frame->shift(levels_.state_t[row]);
      const std::span<const double> found = shift.row(row);
      for (std::size_t a = 0; a < directions; ++a) {
        findings_.same(shift.path(), row, a, found[a], expected[a], "[scheme] frame of the problem");
      }
    }
    if (frame->rate == 0.0) {
      return;
    }
    StoredRows phase(reader, "/frame/phase");
    const auto fields = static_cast<std::size_t>(system_.field_count());
    StoredRows turns(reader, "/frame/turn", fields * fields);
    for (std::size_t row = 0; row < states; ++row) {
      const double t = levels_.state_t[row];
      findings_.same(phase.path(), row, {}, phase.at(row), frame->phase(t), "[scheme] frame of the problem");
      const Eigen::MatrixXd turn = frame->turn(t);
      const std::span<const double> found = turns.row(row);
      for (std::size_t i = 0; i < found.size(); ++i) {
        // The exponential of an angle is squared as often as that has binary digits, which doubles its rounding error.
        findings_.compare(
            turns.path(), row, i, found[i],
            turn(static_cast<Eigen::Index>(i / fields), static_cast<Eigen::Index>(i % fields)),
            [&] { return Rounding::unit * (1.0 + std::abs(frame->phase(t))); }, "[scheme] frame of the problem");
      }
    }
  }

  /// Any other initial data than the problem's differ by more than this, relative to a field; on other machines the
  /// constraints that give auxiliary fields may be solved with other rounding.
  static constexpr double start_tolerance = 1e-9;

  /// The last level of a periodic orbit is the first one.
  void check_closing(const grids::FieldSet& first) {
    const std::vector<double> scales = closing_scales(largest_);
    for (int f = 0; f < system_.field_count(); ++f) {
      if (system_.structure().algebraic[static_cast<std::size_t>(f)] || !stored_.is_stored(f)) {
        continue;
      }
      const auto expected = first.field(f);
      parts_.compare(
          stored_.path(f), levels_.state_level.size() - 1, std::as_const(after_.fields).field(f),
          [&](std::size_t i) { return expected[i]; },
          [&] { return closing_tolerance * scales[static_cast<std::size_t>(f)]; }, "the first level, after one period");
    }
  }

  /// Puts the stored start in the place of the problem's. \return whether it is finite
  bool check_start() {
    for (int f = 0; f < system_.field_count(); ++f) {
      if (!stored_.is_stored(f)) {
        std::ranges::copy(std::as_const(after_.fields).field(f), before_.fields.field(f).begin());
      }
    }
    const bool whole = stored_.load(0, before_.fields);
    std::swap(before_.fields, after_.fields);
    for (int f = 0; f < system_.field_count(); ++f) {
      if (system_.structure().at_midpoints(f) || !stored_.is_stored(f)) {
        continue;
      }
      const auto expected = std::as_const(before_.fields).field(f);
      const auto found = std::as_const(after_.fields).field(f);
      parts_.compare(
          stored_.path(f), 0, found, [&](std::size_t i) { return expected[i]; },
          [&] { return start_tolerance * (grids::max_abs(expected) + largest_addend(f)); },
          "the initial level of the problem");
    }
    before_ = room();
    grow_scales();
    if (levels_.sparse && !levels_.evolving_alone && stored_.load_previous(0, before_.fields)) {
      compare_levels(0, "the first row repeats the start");
    }
    return whole;
  }

  /// For a level, which takes no memory yet.
  [[nodiscard]] LatticeLevel room() const {
    return {grids::FieldSet(after_.fields.fields(), after_.fields.size()), after_.slopes};
  }

  /// Loads the level before a stored one.
  bool check_previous(std::size_t row) {
    const bool whole = stored_.load_previous(row, before_.fields);
    if (whole && levels_.follows(row)) {
      compare_levels(row, "the stored level before");
    }
    return whole;
  }

  /// before_, as loaded, with after_, still that of the row before.
  void compare_levels(std::size_t row, const char* reason) {
    for (int f = 0; f < system_.field_count(); ++f) {
      if (!system_.structure().at_midpoints(f)) {
        const auto found = std::as_const(before_.fields).field(f), expected = std::as_const(after_.fields).field(f);
        parts_.compare(
            stored_.previous_path(f), row, found, [&](std::size_t i) { return expected[i]; }, [] { return 0.0; },
            reason);
      }
    }
  }

  void grow_scales() {
    for (int f = 0; f < system_.field_count(); ++f) {
      const auto values = std::as_const(after_.fields).field(f);
      const auto finite = [values](std::size_t i) { return std::isfinite(values[i]) ? values[i] : 0.0; };
      double& largest = largest_[static_cast<std::size_t>(f)];
      largest = std::max(largest, grids::max_abs_of(values.size(), finite) + largest_addend(f));
    }
  }

  /// A stored field is rounded with its ramp, and with those that it turns with.
  [[nodiscard]] double largest_addend(int field) {
    return exact_.whole().largest_addend(field, std::as_const(after_.fields).all());
  }

  /// Fields displaced as Rounding says, by the largest magnitude of each so far.
  void displace(const LatticeLevel& state, int attempt, int level, LatticeLevel& moved) const {
    const std::uint64_t nodes = grids::whole_of(grid_).size();
    for (int f = 0; f < system_.field_count(); ++f) {
      const std::uint64_t before = static_cast<std::uint64_t>(f) * nodes;
      const double size = Rounding::displacement * largest_[static_cast<std::size_t>(f)];
      const auto from = state.fields.field(f);
      const auto to = moved.fields.field(f);
      for (std::size_t i = 0; i < to.size(); ++i) {
        to[i] = from[i] + Rounding::sign(attempt, before + number_in_whole(record_.slab(), i) + 1, level) * size;
      }
    }
  }

  /// Calls use(before, after) with both levels displaced as Rounding says, in each of its ways.
  template <typename Use>
  void for_each_displacement(Use&& use) {
    LatticeLevel before = room(), after = room();
    for (int attempt = 0; attempt < Rounding::displacements; ++attempt) {
      displace(before_, attempt, 0, before);
      displace(after_, attempt, 1, after);
      use(before, after);
    }
  }

  /// The tolerances of what `evaluate(before, after)` gives, one after the other.
  template <typename Evaluate>
  std::vector<double> tolerances(Evaluate&& evaluate) {
    const std::vector<double> sound = evaluate(before_, after_);
    std::vector<double> result(sound.size(), 0.0);
    for_each_displacement([&](LatticeLevel& before, LatticeLevel& after) {
      const std::vector<double> moved = evaluate(before, after);
      for (std::size_t i = 0; i < result.size(); ++i) {
        const double change = std::abs(moved[i] - sound[i]) / Rounding::displacement;
        result[i] = change > result[i] ? change : result[i];
      }
    });
    for (std::size_t i = 0; i < result.size(); ++i) {
      result[i] = Rounding::unit * (result[i] + std::abs(sound[i]));
    }
    return result;
  }

  /// The same where an energy comes first. A run sums S without its constant C, and adds ∫C: where 1 - cos u is small
  /// itself, what rounding the partial sums of up to 32 nodes, all with the same sign where nodes are alike, makes of
  /// that, sixteen roundings.
  template <typename Evaluate>
  std::vector<double> tolerances_of_energy_first(Evaluate&& evaluate) {
    std::vector<double> result = tolerances(evaluate);
    const double volume = grid_.cell_volume() * static_cast<double>(grids::whole_of(grid_).size());
    result.front() += 8.0 * std::numeric_limits<double>::epsilon() * std::abs(system_.constant()) * volume;
    return result;
  }

  /// What the residual of each law in cells may differ by in any of them: the largest residual changes by less where
  /// the cell that has it is one that rounding leaves alone.
  std::vector<double> tolerances_in_cells(double h) {
    const auto count = static_cast<int>(laws_.count());
    grids::FieldSet sound(count, grid_.size()), moved(count, grid_.size());
    static_cast<void>(laws_.residuals(before_, after_, h, sound.pointers()));
    std::vector<double> result(laws_.count(), 0.0);
    for_each_displacement([&](const LatticeLevel& before, const LatticeLevel& after) {
      static_cast<void>(laws_.residuals(before, after, h, moved.pointers()));
      const auto from = std::as_const(sound).all();
      const auto change = moved.all();
      for (std::size_t i = 0; i < change.size(); ++i) {
        change[i] -= from[i];
      }
      const std::vector<Spread> changes = grids::magnitudes(moved);
      for (std::size_t law = 0; law < result.size(); ++law) {
        result[law] = std::max(result[law], changes[law].largest() / Rounding::displacement);
      }
    });
    const std::vector<Spread> sizes = grids::magnitudes(sound);
    for (std::size_t law = 0; law < result.size(); ++law) {
      result[law] = Rounding::unit * (result[law] + sizes[law].largest());
    }
    return result;
  }

  /// The row of a stored level, where it has one, and the exact solution there.
  void check_level(std::size_t row, bool gamma_known) {
    if (const auto at = levels_.row_of(levels_.state_level[row])) {
      check_row(row, *at, gamma_known);
    }
    check_exact(row);
    check_driven(row);
  }

  /// What walls give at a stored level.
  void check_driven(std::size_t row) {
    if (!driven_) {
      return;
    }
    const double t = levels_.state_t[row];
    grids::FieldSet given(after_.fields);
    std::vector<double> slack(static_cast<std::size_t>(given.fields()), 0.0);
    for (const DrivenNodes::Node& node : driven_->nodes()) {
      const DrivenNodes::Values values = driven_->at(node, t), later = driven_->at(node, t + Rounding::unit * t);
      const auto give = [&](int field, double value, double other) {
        given.field(field)[node.node] = value;
        double& of_field = slack[static_cast<std::size_t>(field)];
        of_field = std::max(of_field, std::abs(other - value));
      };
      give(node.u, values.u, later.u);
      give(node.row.v, values.v, later.v);
    }
    for (const int f : driven_->fields()) {
      if (method_->laws_in_cells() && !momentum_row(system_, f)) {
        continue;  // there momenta follow from rates in the middle of steps
      }
      const auto found = std::as_const(after_.fields).field(f), expected = std::as_const(given).field(f);
      const double here = slack[static_cast<std::size_t>(f)];
      parts_.compare(
          stored_.path(f), row, found, [&](std::size_t i) { return expected[i]; },
          [&] {
            return (record_.slab() == nullptr ? here : record_.slab()->largest_over_ranks(here)) +
                   Rounding::unit * largest_[static_cast<std::size_t>(f)];
          },
          "what a wall of [grid] gives");
    }
  }

  void check_exact(std::size_t row) {
    const double t = levels_.state_t[row];
    const std::vector<std::vector<double>> exact = exact_.at(after_, t);
    for (std::size_t i = 0; i < exact.size(); ++i) {
      compare_row(stored_exact_[i], row, exact[i], "[exact] of the problem",
                  [&] { return Rounding::unit * (1.0 + std::abs(t)) * grids::magnitudes(exact[i]).largest(); });
    }
  }

  /// Node energy, Γ, totals and invariants. \param at the row of the level under /levels
  void check_row(std::size_t row, std::size_t at, bool gamma_known) {
    const std::size_t level = levels_.state_level[row];
    const double t = levels_.state_t[row];
    const auto evaluate = [&](LatticeLevel& there) {
      std::vector<double> values = laws_.totals(there);
      const std::vector<double> invariants = invariants_.integrals(there, t);
      values.insert(values.end(), invariants.begin(), invariants.end());
      return values;
    };
    std::vector<double> allowed, found;  // without laws the energy alone is compared, which the equation gives
    if (!law_levels_.none()) {
      found = evaluate(after_);
    }
    const NodeEnergy node = equation_->node(after_);
    const auto tolerance = [&](std::size_t i) {
      return [&, i] {
        if (allowed.empty()) {
          allowed =
              tolerances_of_energy_first([&](const LatticeLevel&, LatticeLevel& there) { return evaluate(there); });
        }
        return allowed[i];
      };
    };
    const char* reason = "from the state at that level";
    findings_.compare("/levels/node_energy", at, {}, node_energy_.at(at), node.energy + lost_at(at), tolerance(0),
                      reason);
    check_totals(level, at, found, tolerance);
    if (has_gamma_ && gamma_known) {
      check_gamma(at, node.gamma);
    }
  }

  /// Totals and invariants; `found` and `tolerance` report on the node energy first.
  template <typename Tolerance>
  void check_totals(std::size_t level, std::size_t at, std::vector<double>& found, Tolerance&& tolerance) {
    const bool taken = law_levels_.taken_at(level);
    const char* reason = taken ? "from the state at that level" : "[laws] every of the problem";
    if (!taken) {
      std::ranges::fill(found, std::numeric_limits<double>::quiet_NaN());
    }
    std::size_t next = 1;
    for (SharedRows& rows : totals_) {
      findings_.compare(rows.path(), at, {}, rows.at(at), found[next], tolerance(next), reason);
      ++next;
    }
    for (SharedRows& rows : stored_invariants_) {
      findings_.compare(rows.path(), at, {}, rows.at(at), found[next], tolerance(next), reason);
      ++next;
    }
  }

  /// Γ at a level is a quadratic form of rates that are extrapolated from differences of stored levels, which have lost
  /// digits: at the first levels two steps of a hundredth of h.
  void check_gamma(std::size_t at, double gamma) {
    constexpr double lost_digits = 1e4;
    gamma_scale_ = std::max(gamma_scale_, std::abs(gamma));
    findings_.compare(
        "/levels/gamma", at, {}, gamma_.at(at), gamma,
        [&] { return lost_digits * Rounding::unit * std::max(gamma_scale_, energy_rate_scale()); },
        "from the states at that level and before");
  }

  /// A rate squared, by the states and the step: what Γ would be if nothing cancelled.
  [[nodiscard]] double energy_rate_scale() const {
    double scale = 0.0;
    for (const double largest : largest_) {
      scale += largest * largest * grid_.cell_volume() * static_cast<double>(grids::whole_of(grid_).size());
    }
    return scale;
  }

  /// Newton's iteration ends where the error that its last correction left, as the contraction measured so far shows
  /// it, is below rounding: an estimate that is off by the contraction's own variation from one correction to the next.
  static constexpr double solver_slack = 16.0;
  /// Where a law, or E_k, is evaluated at stages they are solved anew: both solutions end like that, and each wave's
  /// stages are taken apart in a basis of their own (4).
  static constexpr double stage_slack = 4.0 * solver_slack;
  /// In long steps, of h|N''| ≫ 1, a slow motion of all makes h² of what transforms and S round at, which is more than
  /// what rounding moves the levels by: by the logarithm of the nodes (8), the stages that it comes from (8), the
  /// terms that cancel (2) and the basis in which stages are taken apart (4).
  static constexpr double long_slack = 8192.0;

  /// E_k, what the step leaves of the scheme's equation, and the local laws.
  /// \param step the row of the step
  void check_step(std::size_t row, std::size_t step) {
    const double h = levels_.h[step];
    const StepLaw law = equation_->judge(before_, after_, h);
    if (!std::isfinite(law.energy)) {
      findings_.doubt(row);
      return;
    }
    std::vector<double> allowed;
    const auto tolerance = [&](std::size_t i) {
      return [&, i] {
        if (allowed.empty()) {
          allowed = tolerances_of_energy_first([&](const LatticeLevel& before, const LatticeLevel& after) {
            const StepLaw moved = equation_->measure(before, after, h);
            return std::vector<double>{moved.energy, moved.residual.largest(),
                                       loss_ ? loss_->of_step(before, after, h) : 0.0};
          });
        }
        return allowed[i];
      };
    };
    const double taken = loss_ ? loss_->of_step(before_, after_, h) : 0.0, work = work_ ? law.work : 0.0;
    // Where rows are of some levels only, none is of the level before: what is lost there follows from the next.
    const bool in_turn = levels_.complete();
    const double others = levels_.potential_of(step) + (in_turn ? lost_at(step) : lost_at(step + 1) - taken + work);
    findings_.compare(
        "/levels/energy", step, {}, energy_.at(step), law.energy + others,
        [&] {
          return (law.is_long ? stage_slack : std::max(law_slack_, solver_slack)) * tolerance(0)() +
                 Rounding::of_sum(law.energy, others);
        },
        "from the states around the step");
    if (loss_ && in_turn) {
      const double before = lost_->at(step);
      findings_.compare(
          lost_->path(), step + 1, {}, lost_->at(step + 1), before + taken,
          [&] { return tolerance(0)() + tolerance(2)() + Rounding::of_sum(before, law.energy); },
          "what the sponge takes from the states around the step");
    }
    if (work_ && in_turn) {
      const double before = work_->at(step);
      findings_.compare(
          work_->path(), step + 1, {}, work_->at(step + 1), before + work,
          [&] { return tolerance(0)() + Rounding::of_sum(before, law.energy); },
          "the work of the walls by the states around the step");
    }
    residual_.add(law.residual);
    findings_.count(grids::whole_of(grid_).size());
    if (law.residual.undefined > 0.0 || law.residual.largest() > equation_tolerance_) {
      equation_tolerance_ = std::max(equation_tolerance_, (law.is_long ? long_slack : solver_slack) * tolerance(1)());
      if (law.residual.undefined > 0.0 || !(law.residual.largest() <= equation_tolerance_)) {
        findings_.add({.dataset = "/states",
                       .row = row,
                       .stored = law.residual.largest(),
                       .recomputed = 0.0,
                       .tolerance = equation_tolerance_,
                       .reason = "what the step from the level before leaves of the scheme's equation"});
      }
    }
    check_laws(row, step, h, law.is_long ? long_slack : law_slack_);
  }

  /// `slack`: how many times what rounding of the levels makes of a law is allowed.
  void check_laws(std::size_t row, std::size_t step, double h, double slack) {
    if (law_levels_.none()) {
      return;
    }
    residuals_.take(before_, after_, h, LatticeResiduals::part(law_levels_, levels_.state_level[row]));
    std::vector<double> allowed;  // of the largest residual of each law in cells
    const auto law_tolerances = [&] {
      if (allowed.empty()) {
        allowed = tolerances_in_cells(h);
      }
    };
    for (std::size_t i = 0; i < stored_laws_.size(); ++i) {
      StoredLaw& stored = stored_laws_[i];
      const figures::ResidualFigures figures = stored.law.figures();
      const auto tolerance = [&] {
        law_tolerances();
        const double own = i < laws_.count() ? allowed[i] : *std::ranges::max_element(allowed);
        return slack * own + Rounding::unit * (std::isfinite(figures.max) ? figures.max : 0.0);
      };
      const char* reason = law_levels_.taken_at(levels_.state_level[row]) ? "from the states around the step"
                                                                          : "[laws] every of the problem";
      findings_.compare(stored.max.path(), step, {}, stored.max.at(step), figures.max, tolerance, reason);
      findings_.compare(stored.rms.path(), step, {}, stored.rms.at(step), figures.rms, tolerance, reason);
      if (stored.undefined) {
        findings_.same(stored.undefined->path(), step, {}, stored.undefined->at(step), figures.undefined, reason);
      }
      if (stored.cells) {
        compare_row(*stored.cells, row, stored.law.cells(), reason, tolerance);
      }
    }
  }

  template <typename Tolerance>
  void compare_row(SharedRows& rows, std::size_t row, std::span<const double> expected, const char* reason,
                   Tolerance&& tolerance) {
    parts_.compare(
        rows.path(), row, rows.row(row), [&](std::size_t i) { return expected[i]; }, tolerance, reason);
  }

  const SharedRecord& record_;
  const StoredLevels& levels_;
  const Problem& problem_;
  bool has_gamma_;
  Disagreements& findings_;
  PartDisagreements parts_;
  MultisymplecticSystem system_;
  grids::Grid grid_;
  std::unique_ptr<LatticeMethod> method_;
  double law_slack_ = 1.0;  ///< where stages are solved anew, by another way: their equations round, too
  Laws law_levels_;
  LocalLaws laws_;
  LatticeResiduals residuals_;
  NodeTable invariants_, exact_;
  StoredLattice stored_;
  LatticeLevel after_, before_;
  std::vector<double> largest_;  ///< of each field so far
  SharedRows node_energy_, gamma_, energy_;
  std::vector<SharedRows> totals_, stored_invariants_, stored_exact_;
  std::vector<StoredLaw> stored_laws_;
  std::unique_ptr<LatticeMethod> bare_method_;
  std::optional<SpongeLoss> loss_;
  std::optional<SharedRows> lost_, work_;
  std::optional<DrivenNodes> driven_;
  std::unique_ptr<StepEquation> equation_;
  OutputCheck output_;
  EventCheck events_;
  double equation_tolerance_ = 0.0;
  double gamma_scale_ = 0.0;
  Spread residual_;
};

}  // namespace

Spread check_lattice(const SharedRecord& record, const StoredLevels& levels, const Problem& problem, bool has_gamma,
                     Disagreements& findings) {
  return LatticeCheck(record, levels, problem, has_gamma, findings).run();
}

}  // namespace rubato
