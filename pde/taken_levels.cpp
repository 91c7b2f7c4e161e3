#include <rubato/pde/taken_levels.hpp>

#include <array>

#include <rubato/grids/slab.hpp>

namespace rubato {

TakenLevels::TakenLevels(LatticeLevel first, std::vector<int> derived, std::vector<int> found,
                         std::function<void(LatticeLevel&)> write)
    : derived_(std::move(derived)),
      found_(std::move(found)),
      write_(std::move(write)),
      here_{std::move(first)},
      before_{{grids::FieldSet(here_.level.fields.fields(), here_.level.fields.size()), here_.level.slopes}},
      trial_(here_.level.fields.fields(), here_.level.fields.size()) {}

const LatticeLevel& TakenLevels::whole(Kept& kept) const {
  if (!kept.has_all) {
    write_(kept.level);
    kept.has_all = true;
  }
  return kept.level;
}

const LatticeLevel& TakenLevels::level() const {
  if (!here_.has_all && !keeps_previous_ && trial_is_free_) {
    for (const int f : found_) {
      trial_.forget(f);  // in turn for the derived fields
    }
  }
  return whole(here_);
}

std::vector<const double*> TakenLevels::found_here() const {
  std::vector<const double*> fields(static_cast<std::size_t>(trial_.fields()), nullptr);
  for (const int f : found_) {
    fields[static_cast<std::size_t>(f)] = std::as_const(here_.level.fields).field(f).data();
  }
  return fields;
}

void TakenLevels::forget_previous() {
  keeps_previous_ = false;
  before_.level.fields = {};
}

void TakenLevels::forget_derived(grids::FieldSet& fields) const {
  for (const int f : derived_) {
    fields.forget(f);
  }
}

void TakenLevels::leave() {
  if (!keeps_previous_ && !derived_.empty() && here_.has_all) {
    forget_derived(here_.level.fields);
    here_.has_all = false;
  }
}

void TakenLevels::accept() {
  std::swap(here_.level.fields, trial_);
  if (keeps_previous_) {
    std::swap(before_.level.fields, trial_);
    if (before_.has_all) {
      forget_derived(trial_);
    }
    before_.has_all = here_.has_all;
  }
  here_.has_all = derived_.empty();
  trial_is_free_ = true;
}

void TakenLevels::save(StateWriter& state) const {
  grids::save_whole(state, here_.level.fields, found_);
  if (keeps_previous_) {
    grids::save_whole(state, before_.level.fields, found_);
  }
}

void TakenLevels::restore(StateReader& state) {
  grids::restore_whole(state, here_.level.fields, found_);
  if (keeps_previous_) {
    grids::restore_whole(state, before_.level.fields, found_);
  }
  replace(false);
  replace_before(false);
}

}  // namespace rubato
