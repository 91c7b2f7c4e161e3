#include <rubato/study/lattice_residuals.hpp>

#include <limits>
#include <utility>

namespace rubato::study {

namespace {

constexpr std::uint64_t first_seed = 1;
constexpr std::uint64_t second_seed = 2;

}  // namespace

LatticeResiduals::LatticeResiduals(LocalLaws& laws, const MultisymplecticSystem& system, const grids::Grid& grid,
                                   Wanted wanted)
    : laws_(laws), count_(grid.size()), names_(laws.names()), cells_(static_cast<int>(laws.count()), grid.size()) {
  cells_.fill(std::numeric_limits<double>::quiet_NaN());
  if (wanted.variational) {
    variational_.emplace(laws, grid);
    names_.insert(names_.end(), variational_->names().begin(), variational_->names().end());
  }
  if (wanted.tangents) {
    const grids::FieldSet u = random_tangent(system, grid, first_seed);
    tangents_.emplace(Tangents{TangentStep(system, grid), u, random_tangent(system, grid, second_seed), u, u});
    names_.emplace_back("multisymplectic");
  }
  sizes_.resize(names_.size());
}

MaxRms LatticeResiduals::size_of(const LawSize& size) const {
  const double count = static_cast<double>(count_);
  return {size.max(), size.rms() * size.rms() * count, count};
}

void LatticeResiduals::take(const LatticeLevel& before, const LatticeLevel& after, double h) {
  sizes_.assign(names_.size(), MaxRms{});
  std::size_t next = 0;
  for (const LawSize& size : laws_.residuals(before, after, h, cells_.pointers())) {
    sizes_[next++] = size_of(size);
  }
  if (variational_) {
    if (const auto sizes = variational_->take(before, after, h)) {
      for (std::size_t i = 0; i < sizes->size(); ++i) {
        sizes_[next + i] = size_of((*sizes)[i]);
      }
    }
    next += variational_->names().size();
  }
  if (tangents_ && tangent_status_ == Status::success) {
    sizes_[next] = take_tangents(before, after, h);
  }
}

MaxRms LatticeResiduals::take_tangents(const LatticeLevel& before, const LatticeLevel& after, double h) {
  Tangents& t = *tangents_;
  for (const auto& [now, next] : {std::pair{&t.u, &t.next_u}, std::pair{&t.v, &t.next_v}}) {
    tangent_status_ = t.step(before, after, h, *now, *next);
    if (tangent_status_ != Status::success) {
      return {};
    }
  }
  const LawSize size = laws_.multisymplectic_residual(t.u, t.next_u, t.v, t.next_v, h);
  std::swap(t.u, t.next_u);
  std::swap(t.v, t.next_v);
  return size_of(size);
}

void LatticeResiduals::save(StateWriter& state) const {
  if (tangents_) {
    state.write(static_cast<double>(tangent_status_));
    state.write(tangents_->u.all());
    state.write(tangents_->v.all());
  }
}

void LatticeResiduals::restore(StateReader& state, const LatticeLevel& before, const LatticeLevel& after, double h) {
  if (tangents_) {
    tangent_status_ = static_cast<Status>(static_cast<int>(state.read()));
    state.read(tangents_->u.all());
    state.read(tangents_->v.all());
  }
  if (h != 0.0) {
    laws_.residuals(before, after, h, cells_.pointers());
    if (variational_) {
      variational_->reset();
      static_cast<void>(variational_->take(before, after, h));
    }
  }
}

}  // namespace rubato::study
