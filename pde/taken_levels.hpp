#pragma once

#include <functional>
#include <utility>
#include <vector>

#include <rubato/base/state.hpp>
#include <rubato/pde/initial_level.hpp>

namespace rubato {

/// The level that a scheme stands at, the one before it where that is read, and room for the next one. Fields that
/// follow from others may be *derived*: steps neither read nor write them, and they take memory only in a level that
/// was asked for.
class TakenLevels {
public:
  /// \param first has all fields \param found those that are not derived \param write(level) gives it those that are
  TakenLevels(LatticeLevel first, std::vector<int> derived, std::vector<int> found,
              std::function<void(LatticeLevel&)> write);

  /// With all fields.
  ///@{
  [[nodiscard]] const LatticeLevel& level() const;
  [[nodiscard]] const LatticeLevel& previous() const { return whole(before_); }
  ///@}
  /// As steps have them.
  ///@{
  [[nodiscard]] LatticeLevel& here() { return here_.level; }
  [[nodiscard]] const LatticeLevel& here() const { return here_.level; }
  /// The fields of the level, null for those that are derived.
  [[nodiscard]] std::vector<const double*> found_here() const;
  [[nodiscard]] LatticeLevel& before() { return before_.level; }
  [[nodiscard]] const grids::FieldSet& trial() const { return trial_; }
  [[nodiscard]] grids::FieldSet& trial() {
    trial_is_free_ = false;
    return trial_;
  }
  ///@}

  /// Nobody reads the level before from now on.
  void forget_previous();
  [[nodiscard]] bool keeps_previous() const { return keeps_previous_; }

  /// The trial becomes the level, and that the one before.
  void accept();
  /// The level, or the one before, is another one, of which steps have the fields, or has all of them.
  ///@{
  void replace(bool has_all) { here_.has_all = has_all || derived_.empty(); }
  void replace_before(bool has_all) { before_.has_all = has_all || derived_.empty(); }
  ///@}
  /// Before a step: what was asked for is given back where memory is short.
  void leave();

  void save(StateWriter& state) const;
  void restore(StateReader& state);

private:
  struct Kept {
    LatticeLevel level;
    bool has_all = true;
  };
  const LatticeLevel& whole(Kept& kept) const;
  void forget_derived(grids::FieldSet& fields) const;

  std::vector<int> derived_, found_;
  std::function<void(LatticeLevel&)> write_;
  mutable Kept here_, before_;
  mutable grids::FieldSet trial_;
  bool keeps_previous_ = true;
  mutable bool trial_is_free_ = true;
};

}  // namespace rubato
