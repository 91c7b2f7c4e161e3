#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include <rubato/formula/changed_term.hpp>
#include <rubato/grids/field_set.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/grids/slab.hpp>
#include <rubato/pde/initial_level.hpp>
#include <rubato/pde/mirror_signs.hpp>
#include <rubato/pde/multisymplectic_system.hpp>
#include <rubato/pde/wall_ghosts.hpp>

namespace rubato {

/// The space between walls as a part of a ring on which z goes on in mirrors: about a node 0 of a wall
///
///     z_f(-x) = r_f z_f(x) where r_f = 1,    z_f(-x) = 2 z_f(0) - z_f(x) where r_f = -1.
///
/// Two walls with the same signs make a ring of twice the length, others of four times. A solution on the ring that
/// begins so stays so if the scheme is the same in the mirror, and is the solution between the walls.
///
/// Schemes whose nodes read few neighbours take the short ring: the nodes between the walls, and beyond them no more of
/// the mirrors than a step reads (WallGhosts), so that nodes within never meet its seam. Both walls may hold different
/// values there, and S need not be the same in the mirror. Where ranks share the space between the walls they share the
/// short ring as well: a rank next to a wall has the ghosts of that, too.
class Mirrors {
public:
  /// \param collocation of the scheme \param ghosts beyond each wall of the short ring; 0: the ring of mirrors
  /// \param of_ranks the ghosts of its parts, where `grid` is the part of a rank
  /// \throws SchemeRefusal as MirrorSigns
  Mirrors(const MultisymplecticSystem& system, const grids::Grid& grid, Collocation collocation, std::size_t ghosts = 0,
          grids::Ghosts of_ranks = {});

  [[nodiscard]] const grids::Grid& grid() const { return grid_; }
  [[nodiscard]] const grids::Grid& ring() const { return ring_; }
  /// While it lives this thread's reductions are those of the ring, where ranks share it.
  [[nodiscard]] grids::Slab::Shared on_ring() const {
    return grids::Slab::Shared(slab_ == nullptr ? grids::Slab::present() : slab_.get());
  }
  [[nodiscard]] bool is_short() const { return ghosts_.has_value(); }
  /// How often the space between the walls is in the ring, for sums over it; of the short one they are 1.
  [[nodiscard]] double copies() const { return copies_; }
  /// +1, or -1 where the wall holds the field at its value there.
  [[nodiscard]] int sign(int axis, int field, grids::End wall) const { return mirrors_.sign(axis, field, wall); }
  /// As FieldMirrors has it.
  [[nodiscard]] int offset(int axis, int field) const { return mirrors_.offset(axis, field); }

  /// Of one field. Of ranks each has what it owns, and no more.
  void extend(int field, std::span<const double> between, std::span<double> ring) const;
  /// Collective where ranks share the ring.
  void extend(const grids::FieldSet& between, grids::FieldSet& ring) const;
  [[nodiscard]] LatticeLevel extended(const LatticeLevel& between) const;
  /// Straight lines between two walls that hold a field at different values, on which no ring closes.
  enum class Slope { kept, left_out };
  /// Of one field on the ring of mirrors, where nothing needs to be stored, the line along an axis that begins at a
  /// node.
  void read_line(int field, std::span<const double> between, int axis, std::size_t first, Slope slope,
                 std::span<double> line) const;
  void restrict(std::span<const double> ring, std::span<double> between) const;
  void restrict(const grids::FieldSet& ring, grids::FieldSet& between) const;
  /// Fields and nodes between the walls that these hold.
  [[nodiscard]] const std::vector<std::pair<int, std::size_t>>& held() const { return held_; }
  /// The same but for the values that walls hold, which stay as they are.
  void restrict_within(const grids::FieldSet& ring, grids::FieldSet& between) const;

private:
  void share_ring(const grids::Slab& between, grids::Ghosts of_ranks);
  /// A place of the ring along an axis in terms of those between the walls: sign times the value at `place`, and parts
  /// of the first and the last one, where these are held.
  struct Image {
    std::size_t place = 0;
    double sign = 1.0, of_first = 0.0, of_last = 0.0;
  };
  [[nodiscard]] Image image(int axis, int field, std::size_t place) const;
  [[nodiscard]] bool holds_both_ends(int axis, int field) const;
  void continue_line(int axis, int field, Slope slope, std::span<double> line) const;
  /// Calls use(in between, in the ring) with the first nodes of each line between the walls.
  template <class Use>
  void for_each_line(const Use& use) const;

  grids::Grid grid_, ring_;
  std::shared_ptr<const grids::Slab> slab_;  ///< of the short ring, where ranks share it
  std::array<std::size_t, 3> first_{};       ///< the node of ring_ at which that of grid_ begins, along each axis
  FieldMirrors mirrors_;
  std::optional<WallGhosts> ghosts_;  ///< of the short ring
  double copies_ = 1.0;
  std::vector<std::pair<int, std::size_t>> held_;  ///< fields and nodes
  mutable std::vector<double> held_values_;
};

/// Looks at random z for a term that z_f -> 2 c_f - z_f changes, for the fields f whose sign is -1; nothing where S is
/// the same.
[[nodiscard]] std::optional<formula::ChangedTerm> find_changed_term(const MultisymplecticSystem& system,
                                                                    std::span<const int> signs,
                                                                    std::span<const double> centre);

}  // namespace rubato
