#include <rubato/pde/lattice.hpp>

#include <cmath>
#include <stdexcept>

#include <fmt/format.h>

namespace rubato {

namespace {

const LatticeOptions& checked(const LatticeOptions& options) {
  const double span = options.until - options.start;
  if (!std::isfinite(options.step) || options.step == 0.0 || !std::isfinite(span) || span * options.step < 0.0) {
    throw std::invalid_argument(
        fmt::format("the step has to be finite, not 0, and lead from start to until; got step = {}, start = {}, "
                    "until = {}",
                    options.step, options.start, options.until));
  }
  return options;
}

std::unique_ptr<LatticeScheme> make_scheme(const MultisymplecticSystem& system, const grids::Grid& grid,
                                           const InitialFields& initial, const LatticeOptions& options) {
  if (options.lagrangian == LatticeLagrangian::euler_box && options.levels == Levels::variable) {
    throw std::invalid_argument(
        "euler-box has fixed levels only: its discrete energy reads one level, so that no step can be solved from it "
        "at turning points or on travelling waves, and with varying levels it drops to first order; use levels = "
        "\"fixed\", or lagrangian = \"box\"");
  }
  LatticeLevel first = initial_level(system, grid, initial, placement_of(options.lagrangian));
  switch (options.lagrangian) {
    case LatticeLagrangian::box: return make_box_scheme(system, grid, std::move(first), options.step);
    case LatticeLagrangian::fourier: return make_fourier_scheme(system, grid, std::move(first), options.step);
    case LatticeLagrangian::euler_box: return make_euler_box_scheme(system, grid, std::move(first));
  }
  throw std::invalid_argument("no such lagrangian on a lattice");
}

}  // namespace

Placement placement_of(LatticeLagrangian lagrangian) {
  switch (lagrangian) {
    case LatticeLagrangian::box: return Placement::cells;
    case LatticeLagrangian::fourier: return Placement::nodes;
    case LatticeLagrangian::euler_box: return Placement::corners;
  }
  throw std::invalid_argument("no such lagrangian on a lattice");
}

LatticeIntegrator::LatticeIntegrator(const MultisymplecticSystem& system, const grids::Grid& grid,
                                     const InitialFields& initial, const LatticeOptions& options)
    : options_(checked(options)),
      scheme_(make_scheme(system, grid, initial, options)),
      levels_(std::make_unique<TimeLevels>(*scheme_,
                                           LevelOptions{.levels = options.levels,
                                                        .on_singular = options.on_singular,
                                                        .bridge = options.bridge,
                                                        .tolerance = options.tolerance},
                                           options.start, options.step)),
      laws_(system, grid, options.symmetries, placement_of(options.lagrangian)),
      previous_(scheme_->level()) {}

StepReport LatticeIntegrator::step() {
  // The scheme overwrites its level only when the step is accepted, but a copy is needed before that.
  previous_.fields.copy_from(scheme_->level().fields);
  return levels_->step();
}

bool LatticeIntegrator::finished() const {
  // Levels are start + k·step only to rounding; a level this near to `until` is meant to be at it.
  constexpr double slack = 1e-9;
  const double direction = options_.step < 0.0 ? -1.0 : 1.0;
  return direction * (levels_->time() - options_.until) >= -slack * std::abs(levels_->last_step());
}

std::vector<LawSize> LatticeIntegrator::residuals(std::span<double* const> cells) {
  return laws_.residuals(previous_, level(), levels_->last_step(), cells);
}

void LatticeIntegrator::save(StateWriter& state) const {
  scheme_->save(state);
  levels_->save(state);
  state.write(previous_.fields.all());
}

void LatticeIntegrator::restore(StateReader& state) {
  scheme_->restore(state);
  levels_->restore(state);
  state.read(previous_.fields.all());
}

}  // namespace rubato
