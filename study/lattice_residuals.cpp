#include <rubato/study/lattice_residuals.hpp>

#include <algorithm>
#include <limits>
#include <utility>

namespace rubato::study {

namespace {

constexpr std::uint64_t seed = 1;

}  // namespace

LatticeResiduals::LatticeResiduals(const LatticeMethod& method, LocalLaws& laws, const MultisymplecticSystem& system,
                                   const grids::Grid& grid, Wanted wanted)
    : laws_(laws), names_(laws.names()), cells_(static_cast<int>(laws.count()), grid.size()) {
  cells_.fill(std::numeric_limits<double>::quiet_NaN());
  if (wanted.variational && method.has_variational_laws()) {
    variational_.emplace(method.action(system).value(), grid);
    names_.insert(names_.end(), variational_->names().begin(), variational_->names().end());
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
    names_.emplace_back("multisymplectic");
  }
  sizes_.resize(names_.size());
}

void LatticeResiduals::take_in_cells(const LatticeLevel& before, const LatticeLevel& after, double h, Part wanted) {
  if (wanted == Part::all) {
    std::ranges::copy(laws_.residuals(before, after, h, cells_.pointers()), sizes_.begin());
  } else if (has_cells_) {
    cells_.fill(std::numeric_limits<double>::quiet_NaN());
  }
  has_cells_ = wanted == Part::all;
}

void LatticeResiduals::take(const LatticeLevel& before, const LatticeLevel& after, double h, Part wanted) {
  sizes_.assign(names_.size(), Spread{});
  take_in_cells(before, after, h, wanted);
  if (variational_ && wanted == Part::none) {
    variational_->reset();
  } else if (variational_) {
    if (const auto sizes = variational_->take(before, after, h); sizes && wanted == Part::all) {
      std::ranges::copy(*sizes, sizes_.begin() + static_cast<std::ptrdiff_t>(laws_.count()));
    }
  }
  if (tangents_ && tangent_status_ == Status::success) {
    tangent_status_ = tangents_->take(before, after, h);
    if (tangent_status_ == Status::success && tangents_->residual() && wanted == Part::all) {
      sizes_.back() = *tangents_->residual();
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
  if (h != 0.0) {
    sizes_.assign(names_.size(), Spread{});
    take_in_cells(before, after, h, wanted);
    if (variational_) {
      variational_->reset();
    }
    if (variational_ && wanted != Part::none) {
      static_cast<void>(variational_->take(before, after, h));
    }
  }
}

}  // namespace rubato::study
