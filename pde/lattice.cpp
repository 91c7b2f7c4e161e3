#include <rubato/pde/lattice.hpp>

#include <cmath>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>

#include <rubato/pde/well_posedness.hpp>
#include <rubato/variation/run_span.hpp>

namespace rubato {

namespace {

const LatticeOptions& checked(const LatticeOptions& options) {
  check_run_span(options.start, options.step, options.until, options.tolerance);
  return options;
}

/// \param cautions receives what the user should know about the problem
std::unique_ptr<LatticeScheme> make_scheme(const LatticeMethod& method, const MultisymplecticSystem& system,
                                           const grids::Grid& grid, const InitialFields& initial,
                                           const LatticeOptions& options, std::vector<std::string>& cautions) {
  if (const std::string_view reason = method.fixed_levels_only();
      !reason.empty() && options.levels == Levels::variable) {
    throw std::invalid_argument(
        fmt::format("{} has fixed levels only: {}; use levels = \"fixed\", or lagrangian = "
                    "\"box\"",
                    options.lagrangian, reason));
  }
  auto [first, about_data] = method.first_level(system, grid, initial);
  cautions = std::move(about_data);
  if (const auto growth = find_short_wave_growth(system, grid, first)) {
    cautions.insert(cautions.begin(), describe(*growth, grid, system));
  }
  return method.scheme(system, grid, std::move(first), options.step);
}

}  // namespace

LatticeIntegrator::LatticeIntegrator(const MultisymplecticSystem& system, const grids::Grid& grid,
                                     const InitialFields& initial, const LatticeOptions& options)
    : options_(checked(options)),
      method_(make_lattice_method(options.method())),
      system_(system),
      energy_constant_(system.constant() * grid.cell_volume() * static_cast<double>(grid.size())),
      scheme_(make_scheme(*method_, system.without_constant(), grid, initial, options, cautions_)),
      levels_(std::make_unique<TimeLevels>(
          *scheme_,
          LevelOptions{.levels = options.levels,
                       .on_singular = options.on_singular.value_or(OnSingular::bridge),
                       .bridge = options.bridge.value_or(BridgeRule::anchored),
                       .tolerance = options.tolerance,
                       .energy_constant = energy_constant_,
                       .potential = with_usual(options.potential, !options.on_singular && !options.bridge)},
          options.start, options.step)),
      laws_(make_local_laws(*method_, system, grid, options.symmetries)),
      previous_(scheme_->level()),
      before_(previous_.fields) {
  laws_.share(scheme_->stages());
}

StepReport LatticeIntegrator::step() {
  // The scheme overwrites its level only when the step is accepted, but a copy is needed before that. A step that fails
  // leaves the level before as it was, too.
  before_.copy_from(scheme_->level().fields);
  const StepReport report = levels_->step();
  if (report.status == Status::success) {
    std::swap(previous_.fields, before_);
  }
  return report;
}

LevelNode LatticeIntegrator::node() {
  LevelNode node = scheme_->node();
  node.energy += energy_constant_;
  return node;
}

bool LatticeIntegrator::finished() const {
  // Levels are start + k·step only to rounding; a level this near to `until` is meant to be at it.
  constexpr double slack = 1e-9;
  const double direction = options_.step < 0.0 ? -1.0 : 1.0;
  return direction * (levels_->time() - options_.until) >= -slack * std::abs(levels_->last_step());
}

std::vector<Spread> LatticeIntegrator::residuals(std::span<double* const> cells) {
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
