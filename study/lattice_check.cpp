#include <rubato/study/lattice_check.hpp>

#include <algorithm>
#include <cmath>
#include <utility>

#include <fmt/format.h>

#include <rubato/study/lattice_problem.hpp>
#include <rubato/study/lattice_residuals.hpp>
#include <rubato/study/step_equation.hpp>

namespace rubato::study {

namespace {

/// The stored levels of a lattice, one at a time.
class StoredLattice {
public:
  StoredLattice(const record::Reader& reader, const MultisymplecticSystem& system, std::size_t nodes, bool sparse)
      : file_(reader.file()), system_(system) {
    for (int f = 0; f < system.field_count(); ++f) {
      const std::string& name = system.fields()[static_cast<std::size_t>(f)];
      const bool at_midpoints = system.structure().at_midpoints(f);
      fields_.emplace_back(reader, (at_midpoints ? "/states/midpoints/" : "/states/") + name, nodes);
      if (sparse && !at_midpoints) {
        previous_.emplace_back(reader, "/states/previous/" + name, nodes);
      }
    }
  }

  /// Of fields at midpoints the value in the middle of the step that led there; 0 at the start, where there is none.
  void load(std::size_t row, grids::FieldSet& level) {
    for (int f = 0; f < system_.field_count(); ++f) {
      if (row == 0 && system_.structure().at_midpoints(f)) {
        std::ranges::fill(level.field(f), 0.0);
      } else {
        copy(fields_[static_cast<std::size_t>(f)], row, level.field(f));
      }
    }
  }
  /// The level before it.
  void load_previous(std::size_t row, grids::FieldSet& level) {
    auto rows = previous_.begin();
    for (int f = 0; f < system_.field_count(); ++f) {
      if (system_.structure().at_midpoints(f)) {
        std::ranges::fill(level.field(f), 0.0);
      } else {
        copy(*rows++, row, level.field(f));
      }
    }
  }

private:
  void copy(StoredRows& rows, std::size_t row, std::span<double> out) const {
    const std::span<const double> values = rows.row(row);
    if (!std::ranges::all_of(values, [](double value) { return std::isfinite(value); })) {
      throw record::Error(file_, fmt::format("stored state {} is not finite everywhere: the record is damaged", row));
    }
    std::ranges::copy(values, out.begin());
  }

  std::filesystem::path file_;
  const MultisymplecticSystem& system_;
  std::vector<StoredRows> fields_, previous_;
};

class LatticeCheck {
public:
  LatticeCheck(const record::Reader& reader, const StoredLevels& levels, const Problem& problem)
      : reader_(reader),
        levels_(levels),
        problem_(problem),
        system_(make_system(problem)),
        grid_(make_grid(problem)),
        laws_(system_, grid_, make_lattice_options(problem, system_).symmetries, placement_of(problem)),
        residuals_(laws_, system_, grid_,
                   {.variational = !levels.sparse && placement_of(problem) != Placement::nodes,
                    .tangents = !levels.sparse && reader.has("/laws/multisymplectic_max")}),
        invariants_(make_invariants(problem, system_, grid_)),
        stored_(reader, system_, grid_.size(), levels.sparse),
        after_(make_initial_level(problem, system_, grid_)),
        before_(after_) {
    for (const std::string& name : invariants_.names()) {
      statistics_.invariants.push_back({name, {}});
    }
    for (std::size_t law = 1; law < laws_.count(); ++law) {  // the first is energy, the node energy
      statistics_.totals.push_back({laws_.names()[law], {}});
    }
    for (const std::string& name : residuals_.names()) {
      statistics_.residuals.push_back({name, {}});
    }
    statistics_.residuals.push_back({"step_equation", {}});
  }

  Statistics run() {
    copy_counts(reader_, levels_, statistics_);
    stored_.load(0, after_.fields);
    const bool gamma_at_levels = !levels_.sparse && !levels_.h.empty();
    equation_ =
        make_step_equation(system_, grid_, placement_of(problem_), after_, gamma_at_levels ? levels_.h.front() : 0.0);
    check_level(0);
    for (std::size_t row = 1; row < levels_.state_level.size(); ++row) {
      if (levels_.sparse) {
        stored_.load_previous(row, before_.fields);
      } else {
        std::swap(before_.fields, after_.fields);
      }
      stored_.load(row, after_.fields);
      check_step(row);
      check_level(row);
    }
    NodeTable exact = make_exact(problem_, system_, grid_);
    statistics_.errors = lattice_errors(exact, system_, after_, levels_.state_t.back());
    return std::move(statistics_);
  }

private:
  /// Node energy, Γ, totals and invariants.
  void check_level(std::size_t row) {
    const LevelNode node = equation_->node(after_);
    require_finite(node.energy);
    if (!levels_.sparse) {
      statistics_.gamma.add(node.gamma);
    }
    statistics_.energy_magnitude.add(std::abs(node.energy));
    const std::vector<double> totals = laws_.totals(after_);
    const std::vector<double> invariants = invariants_.integrals(after_, levels_.state_t[row]);
    if (row == 0) {
      statistics_.node_energy.start(node.energy);
      start(statistics_.totals, std::span(totals).subspan(1));
      start(statistics_.invariants, invariants);
    }
    statistics_.node_energy.add(node.energy);
    add(statistics_.totals, std::span(totals).subspan(1));
    add(statistics_.invariants, invariants);
  }

  /// E_k, what the step leaves of the scheme's equation, and the local laws.
  void check_step(std::size_t row) {
    const std::size_t step = levels_.state_level[row] - 1;
    const double h = levels_.h[step];
    const StepLaw law = equation_->judge(before_, after_, h);
    require_finite(law.energy);
    if (row == 1) {
      statistics_.energy = law.energy;
    }
    double& deviation = levels_.bridged[step] != 0.0 ? statistics_.bridge_deviation : statistics_.energy_deviation;
    deviation = std::max(deviation, std::abs(law.energy - statistics_.energy));
    if (levels_.sparse) {
      statistics_.gamma.add(law.gamma);
    }
    statistics_.residuals.back().value.add(law.residual);
    residuals_.take(before_, after_, h);
    for (std::size_t i = 0; i < residuals_.sizes().size(); ++i) {
      statistics_.residuals[i].value.add(residuals_.sizes()[i]);
    }
  }

  void require_finite(double energy) const {
    if (!std::isfinite(energy)) {
      throw record::Error(reader_.file(), "S is not finite at a stored state: the record is damaged");
    }
  }

  const record::Reader& reader_;
  const StoredLevels& levels_;
  const Problem& problem_;
  MultisymplecticSystem system_;
  grids::Grid grid_;
  LocalLaws laws_;
  LatticeResiduals residuals_;
  NodeTable invariants_;
  StoredLattice stored_;
  LatticeLevel after_, before_;
  std::unique_ptr<StepEquation> equation_;
  Statistics statistics_;
};

}  // namespace

Statistics check_lattice(const record::Reader& reader, const StoredLevels& levels, const Problem& problem) {
  return LatticeCheck(reader, levels, problem).run();
}

}  // namespace rubato::study
