#include <rubato/pde/lattice.hpp>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>

#include <rubato/pde/shared_slopes.hpp>
#include <rubato/pde/well_posedness.hpp>

namespace rubato {

namespace {

const LatticeOptions& checked(const LatticeOptions& options) {
  check_run_span(options.start, options.step, options.until, options.tolerance);
  return options;
}

const grids::Grid& part_of(const grids::Grid& grid, const LatticeOptions& options) {
  return options.slab == nullptr ? grid : options.slab->grid();
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
  LatticeLevel first;
  {
    // Every rank makes its part of the first level, or the whole, and keeps its part.
    const grids::Slab::Shared those_who_make_it(options.initial_is_part ? options.slab : nullptr);
    const grids::Grid& made = options.initial_is_part ? part_of(grid, options) : grid;
    InitialLevel level = method.first_level(system, made, initial);
    cautions = std::move(level.cautions);
    if (const auto growth = find_short_wave_growth(system, made, level.level)) {
      cautions.insert(cautions.begin(), describe(*growth, grid, system));
    }
    first = std::move(level.level);
  }
  if (options.initial_is_part) {
    options.slab->refresh(first.fields);
    refresh_slopes(first.slopes, part_of(grid, options));
  } else if (options.slab != nullptr) {
    grids::FieldSet part(first.fields.fields(), options.slab->size());
    for (int f = 0; f < part.fields(); ++f) {
      options.slab->take_part(first.fields.field(f), part.field(f));
    }
    first.fields = std::move(part);
    first.slopes = part_of(first.slopes, *options.slab);
  }
  auto scheme = method.scheme(system, part_of(grid, options), std::move(first), options.step);
  if (!options.keeps_previous) {
    scheme->forget_previous();
  }
  return scheme;
}

}  // namespace

LatticeIntegrator::LatticeIntegrator(const MultisymplecticSystem& system, const grids::Grid& grid,
                                     const InitialFields& initial, const LatticeOptions& options)
    : method_(with_sponge(make_lattice_method(checked(options).method(), grid), options.sponge)),
      system_(method_->seen(system)),
      scheme_(make_scheme(*method_, system_.without_constant(), grid, initial, options, cautions_)),
      laws_(make_local_laws(*method_, system_, part_of(grid, options), options.symmetries)),
      keeps_previous_(options.keeps_previous || scheme_->previous() != nullptr),
      previous_{{}, scheme_->level().slopes} {
  if (keeps_previous_ && scheme_->previous() == nullptr) {
    before_ = scheme_->level().fields;
    previous_.fields = before_;
  }
  laws_.share(scheme_->stages());
  const double constant = system.constant() * grid.volume();
  LevelOptions levels = level_options(options, true, constant);
  levels.run_length = std::abs(options.until - options.start);
  levels.spares_look_ahead = true;
  begin(*scheme_, options, levels, options.start, constant);
}

StepReport LatticeIntegrator::step() {
  // The scheme overwrites its level only when the step is accepted, but a copy is needed before that. A step that fails
  // leaves the level before as it was, too.
  const bool reported = scheme_->level_is_current() && before_.size() > 0;  // else the scheme keeps the level before
  if (reported) {
    before_.copy_from(scheme_->level().fields);
  }
  const StepReport report = Integrator::step();
  if (report.status == Status::success) {
    if (reported) {
      std::swap(previous_.fields, before_);
    }
    where_ = reported ? Previous::here : keeps_previous_ ? Previous::of_scheme : Previous::not_kept;
    of_step_before_ = std::exchange(of_last_step_, LocalLaws::none);
  }
  return report;
}

std::optional<double> LatticeIntegrator::energy_lost() const {
  const auto* const sponge = dynamic_cast<const LosesEnergy*>(scheme_.get());
  return sponge == nullptr ? std::nullopt : std::optional(sponge->energy_lost());
}

const LatticeLevel& LatticeIntegrator::previous() const {
  if (where_ == Previous::none) {
    return level();
  }
  if (where_ == Previous::not_kept) {
    throw std::logic_error("the level before is not kept");
  }
  if (where_ == Previous::of_scheme) {
    if (const LatticeLevel* const kept = scheme_->previous()) {
      return *kept;
    }
    scheme_->write_previous(previous_.fields);
    where_ = Previous::here;
  }
  return previous_;
}

std::vector<Spread> LatticeIntegrator::residuals(std::span<double* const> cells) {
  auto sizes = laws_.residuals(previous(), level(), levels().last_step(), cells, of_step_before_);
  of_last_step_ = laws_.last_question();
  return sizes;
}

void LatticeIntegrator::save(StateWriter& state) const {
  Integrator::save(state);
  const bool none = where_ == Previous::none || where_ == Previous::not_kept;
  state.write(none ? 1.0 : 0.0);
  if (!none && scheme_->previous() == nullptr) {
    grids::save_whole(state, previous().fields);
  }
}

void LatticeIntegrator::restore(StateReader& state) {
  Integrator::restore(state);
  if (state.read() != 0.0) {
    where_ = Previous::none;
  } else if (scheme_->previous() != nullptr) {
    where_ = Previous::of_scheme;
  } else {
    if (previous_.fields.size() == 0) {
      previous_.fields = level().fields;
    }
    grids::restore_whole(state, previous_.fields);
    where_ = Previous::here;
  }
  of_step_before_ = of_last_step_ = LocalLaws::none;
}

}  // namespace rubato
