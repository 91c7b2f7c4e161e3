#include <rubato/run/lattice_residuals.hpp>

#include <algorithm>
#include <limits>
#include <utility>

namespace rubato {

namespace {

constexpr std::uint64_t seed = 1;

void set(std::span<Law> laws, const std::vector<Spread>& sizes) {
  for (std::size_t i = 0; i < laws.size(); ++i) {
    laws[i].set(sizes[i]);
  }
}

}  // namespace

LatticeResiduals::LatticeResiduals(const LatticeMethod& method, LocalLaws& laws, const MultisymplecticSystem& system,
                                   const grids::Grid& grid, Wanted wanted)
    : local_(laws), steps_follow_(wanted.variational) {
  if (wanted.cells) {
    cells_.emplace(static_cast<int>(laws.count()), grid.size()).fill(std::numeric_limits<double>::quiet_NaN());
  }
  // On a line between walls the last node has no cell.
  const std::size_t count = method.laws_in_cells() && grid.has_walls() ? grid.axis(0).cell_count() : grid.size();
  for (std::size_t i = 0; i < laws.count(); ++i) {
    laws_.emplace_back(laws.names()[i], cells_ ? std::as_const(*cells_).field(static_cast<int>(i)).first(count)
                                               : std::span<const double>());
  }
  if (wanted.variational && method.has_variational_laws()) {
    variational_.emplace(method.action(system).value(), system, grid);
    for (const std::string& name : variational_->names()) {
      laws_.emplace_back(name);
    }
  }
  if (wanted.tangents) {
    auto step = method.tangents(system, grid);
    if (step == nullptr) {
      throw SchemeRefusal(
          "tangent solutions are for schemes that have a local law of two of them, as \"box\" and \"euler-box\" have, "
          "and "
          "this one has none: leave out --tangents");
    }
    tangents_.emplace(laws, std::move(step), system, grid, seed);
    laws_.emplace_back("multisymplectic");
  }
  in_cells_ = std::span(laws_).first(laws.count());
  of_tangents_ = std::span(laws_).last(tangents_ ? 1 : 0);
  at_nodes_ = std::span(laws_).subspan(in_cells_.size(), laws_.size() - in_cells_.size() - of_tangents_.size());
}

void LatticeResiduals::clear() {
  for (Law& law : laws_) {
    law.set({});
  }
}

void LatticeResiduals::forget_cells() {
  if (took_cells_ && cells_) {
    cells_->fill(std::numeric_limits<double>::quiet_NaN());
  }
  took_cells_ = false;
  of_last_step_ = LocalLaws::none;
}

void LatticeResiduals::skip() {
  clear();
  forget_cells();
  if (variational_) {
    variational_->reset();
  }
}

void LatticeResiduals::take_in_cells(const LatticeLevel& before, const LatticeLevel& after, double h, Part wanted) {
  if (wanted != Part::all) {
    forget_cells();
    return;
  }
  const std::span<double* const> cells = cells_ ? cells_->pointers() : std::span<double* const>();
  set(in_cells_, local_.residuals(before, after, h, cells, of_last_step_));
  took_cells_ = true;
  of_last_step_ = steps_follow_ ? local_.last_question() : LocalLaws::none;
}

void LatticeResiduals::take(const LatticeLevel& before, const LatticeLevel& after, double h, Part wanted) {
  clear();
  take_in_cells(before, after, h, wanted);
  if (variational_ && wanted == Part::none) {
    variational_->reset();
  } else if (variational_) {
    if (const auto sizes = variational_->take(before, after, h); sizes && wanted == Part::all) {
      set(at_nodes_, *sizes);
    }
  }
  if (tangents_ && tangent_status_ == Status::success) {
    tangent_status_ = tangents_->take(before, after, h);
    if (tangent_status_ == Status::success && tangents_->residual() && wanted == Part::all) {
      of_tangents_.front().set(*tangents_->residual());
    }
  }
}

void LatticeResiduals::save(StateWriter& state) const {
  if (tangents_) {
    state.write(static_cast<double>(tangent_status_));
    tangents_->save(state);
  }
}

void LatticeResiduals::restore(StateReader& state, const LatticeLevel& before, const LatticeLevel& after, double h,
                               Part wanted) {
  if (tangents_) {
    tangent_status_ = static_cast<Status>(static_cast<int>(state.read()));
    tangents_->restore(state);
  }
  of_last_step_ = LocalLaws::none;
  if (h != 0.0) {
    clear();
    take_in_cells(before, after, h, wanted);
    if (variational_) {
      variational_->reset();
    }
    if (variational_ && wanted != Part::none) {
      static_cast<void>(variational_->take(before, after, h));
    }
  }
}

}  // namespace rubato
