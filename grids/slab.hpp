#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <functional>
#include <span>
#include <vector>

#include <rubato/base/compensated_sum.hpp>
#include <rubato/base/spread.hpp>
#include <rubato/base/state.hpp>
#include <rubato/grids/field_set.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/ranks/communicator.hpp>

namespace rubato::grids {

/// How many planes of its neighbours a rank has copies of: before those that it owns, and after them.
struct Ghosts {
  std::size_t before = 0, after = 0;
};

/// The part of a lattice that one of several ranks has: consecutive planes across the last axis, which it owns, and
/// beyond them on either side ghosts, planes that others own. A field of the part is an array of grid(), a grid like
/// any other: what reads neighbours reads those in the ghosts, and is right as far from the seam of that grid as ghosts
/// are right. refresh() makes them right. What the owned nodes hold is then the same, bit by bit, as on one rank.
///
/// Reductions (grids/reductions.hpp) of a thread that has a slab, over arrays of the part, are over the owned nodes of
/// all ranks: collective calls. Each rank sums up what it owns, and the compensated sums are added up along a tree.
class Slab {
public:
  /// \param first_planes of each rank, and how many planes there are, in increasing order; with none, planes are shared
  /// out as evenly as can be, the first ranks having one more where they do not go up
  /// \throws std::invalid_argument if there are more ranks than planes
  Slab(ranks::Communicator& ranks, const Grid& whole, Ghosts ghosts, std::vector<std::size_t> first_planes = {});

  /// The same parts with other ghosts.
  [[nodiscard]] Slab with_ghosts(Ghosts ghosts) const { return {ranks_, whole_, ghosts, first_planes_}; }

  [[nodiscard]] const Grid& whole() const { return whole_; }
  [[nodiscard]] const Grid& grid() const { return grid_; }
  [[nodiscard]] bool leads() const { return ranks_.rank() == 0; }
  [[nodiscard]] int rank() const { return ranks_.rank(); }
  [[nodiscard]] int ranks() const { return ranks_.size(); }
  [[nodiscard]] ranks::Communicator& communicator() const { return ranks_; }
  /// Nodes of grid(), ghosts and all.
  [[nodiscard]] std::size_t size() const { return grid_.size(); }
  /// The first owned one of them, and how many are owned: consecutive ones.
  ///@{
  [[nodiscard]] std::size_t first_node() const { return ghosts_.before * plane_; }
  [[nodiscard]] std::size_t owned() const { return planes(ranks_.rank()) * plane_; }
  ///@}
  [[nodiscard]] bool owns(std::size_t node) const { return node >= first_node() && node - first_node() < owned(); }
  /// What a rank owns.
  ///@{
  [[nodiscard]] std::size_t first_plane(int rank) const { return first_planes_[static_cast<std::size_t>(rank)]; }
  [[nodiscard]] std::size_t planes(int rank) const { return first_plane(rank + 1) - first_plane(rank); }
  ///@}
  /// The first owned node's number in the whole lattice; and who owns a node of that, and where in its part.
  ///@{
  [[nodiscard]] std::size_t number_of_first() const { return first_plane(ranks_.rank()) * plane_; }
  [[nodiscard]] int owner_of(std::size_t number) const { return owner(number / plane_); }
  [[nodiscard]] std::size_t node_of(std::size_t number) const { return first_node() + number - number_of_first(); }
  ///@}

  /// Copies what others own into the ghosts of every field.
  void refresh(FieldSet& fields) const;
  void refresh(FieldSet& fields, std::span<const int> which) const;
  /// The same of some fields, and of the `outer` ghosts on each side that are farthest out: those that a step made
  /// wrong which reads so many neighbours.
  void refresh(FieldSet& fields, std::span<const int> which, std::size_t outer) const;
  /// Calls compute(begin, end) for pieces of all nodes of the part, which sets some fields there, and refreshes ghosts
  /// as above: the nodes that others wait for come first, and the rest while these are on their way.
  template <class Compute>
  void compute_and_refresh(FieldSet& fields, std::span<const int> which, std::size_t outer,
                           const Compute& compute) const {
    const std::size_t first = first_node(), end = first + owned(),
                      edge = std::max(ghosts_.before, ghosts_.after) * plane_;
    if (owned() <= 2 * edge) {
      compute(std::size_t{0}, size());
      refresh(fields, which, outer);
      return;
    }
    compute(first, first + edge);
    compute(end - edge, end);
    begin_refresh(fields, which, outer);
    compute(std::size_t{0}, first);
    compute(first + edge, end - edge);
    compute(end, size());
    end_refresh(fields, which, outer);
  }
  /// Out of an array of the whole lattice, ghosts and all.
  void take_part(std::span<const double> whole, std::span<double> part) const;
  /// The whole lattice, at rank 0; nothing at others. Or of `planes` planes from `first` on their `columns` values from
  /// `column` on, plane by plane: what does not take room for more.
  ///@{
  [[nodiscard]] std::vector<double> gathered(std::span<const double> part) const {
    return gathered(part, {0, whole_.size() / plane_}, {0, plane_});
  }
  struct Range {
    std::size_t first = 0, count = 0;
  };
  [[nodiscard]] std::vector<double> gathered(std::span<const double> part, Range planes, Range columns) const;
  ///@}
  /// The whole lattice at rank 0, some planes at a time in their order: with what `use` is called there. And out of
  /// such, which `fill` makes there, what each rank owns; ghosts stay as they were.
  ///@{
  using Use = std::function<void(std::span<const double>)>;
  using Fill = std::function<void(std::span<double>)>;
  void gather(std::span<const double> part, const Use& use) const;
  void scatter(std::span<double> part, const Fill& fill) const;
  ///@}
  /// So many planes of `numbers` numbers go to or from rank 0 at a time: about a megabyte.
  [[nodiscard]] static std::size_t planes_at_once(std::size_t numbers) {
    return std::max<std::size_t>(1, (std::size_t{1} << 17) / std::max<std::size_t>(1, numbers));
  }
  /// To every rank, from every rank, this one as well; nothing where there is nothing.
  void exchange_all(const std::vector<std::vector<double>>& out, std::vector<std::vector<double>>& in) const;
  /// To the rank with the parts behind, which is rank 0 for the last, as many from the rank with those before.
  void pass_on(std::span<const double> out, std::span<double> in) const;
  /// Calls add() at one rank after the other, in the order of their parts, each of which goes on from the numbers that
  /// the one before has left; what the last one leaves are the numbers of all. So a sum is made of terms in an order
  /// that does not depend on how many ranks there are, at the cost of that many messages, one after the other.
  void in_turn(std::span<double> numbers, const std::function<void()>& add) const;
  /// The same, of which the last rank alone has the numbers of all.
  void pass_along(std::span<double> numbers, const std::function<void()>& add) const;
  /// The compensated sum, and the largest, NaN if one is, of all ranks' numbers.
  ///@{
  [[nodiscard]] double sum_over_ranks(double here) const;
  [[nodiscard]] double largest_over_ranks(double here) const;
  ///@}
  /// As many numbers of every rank, one rank's after the other's, at rank 0; nothing at others.
  [[nodiscard]] std::vector<double> collected(std::span<const double> few) const;
  /// One rank's values at all ranks, along a tree.
  void broadcast(std::span<double> values, int root = 0) const;

  /// For reductions: `totals` of the sums of all ranks, which are used up, and of `largest` the largest of all, NaN if
  /// one is; along a tree and back, with two messages of each rank but one.
  void reduce(std::span<CompensatedSum> sums, std::span<double> totals, std::span<double> largest) const;
  /// Of values that are not all finite.
  [[nodiscard]] Spread magnitudes(std::span<const double> values) const;

  /// Lets this thread's reductions be those of a slab, while it lives; of none, with null.
  class Shared {
  public:
    explicit Shared(const Slab* slab) : before_(present_) { present_ = slab; }
    Shared(const Shared&) = delete;
    Shared& operator=(const Shared&) = delete;
    ~Shared() { present_ = before_; }

  private:
    const Slab* before_;
  };
  /// The slab that this thread has; null for none.
  [[nodiscard]] static const Slab* present() { return present_; }
  /// The same where `count` values are arrays of its part.
  [[nodiscard]] static const Slab* of(std::size_t count) {
    return present_ != nullptr && count > 0 && count % present_->size() == 0 ? present_ : nullptr;
  }
  /// The same where `grid` is its part.
  [[nodiscard]] static const Slab* of(const Grid& grid) {
    return present_ != nullptr && present_->size() == grid.size() && grid.axes().back().of != 0 ? present_ : nullptr;
  }

private:
  /// refresh() in two parts, between which no ghost is read.
  ///@{
  void begin_refresh(const FieldSet& fields, std::span<const int> which, std::size_t outer) const;
  void end_refresh(FieldSet& fields, std::span<const int> which, std::size_t outer) const;
  ///@}
  [[nodiscard]] int owner(std::size_t plane) const;
  /// Which of some planes a rank owns.
  [[nodiscard]] Range owned_of(Range planes, int rank) const;
  /// A plane of the part that goes to, or comes from, another rank.
  struct GhostPlane {
    std::size_t place;
    std::size_t from_edge;  ///< how many ghosts there are beyond it where it is one
  };
  template <class Copy>
  std::size_t for_ghosts(const std::vector<GhostPlane>& planes, std::span<const int> which, std::size_t outer,
                         const Copy& copy) const;
  /// The planes of the whole lattice that are a rank's ghosts, in their order.
  [[nodiscard]] std::vector<std::size_t> ghost_planes(int rank) const;

  inline static thread_local const Slab* present_ = nullptr;

  ranks::Communicator& ranks_;
  Grid whole_;
  Ghosts ghosts_;
  std::size_t plane_;
  std::vector<std::size_t> first_planes_;
  Grid grid_;
  /// For refresh(): planes of the part that go to, and come from, each rank.
  std::vector<std::vector<GhostPlane>> send_, receive_;
  mutable std::vector<std::vector<double>> out_, in_;
  mutable std::vector<double> sums_;  ///< what goes from rank to rank in reduce()
};

/// Ghosts of fields that were changed, as Slab::refresh(); nothing for a thread without a slab.
///@{
void refresh_ghosts(FieldSet& fields, std::span<const int> which, std::size_t outer);
void refresh_ghosts(FieldSet& fields, std::span<const int> which);
void refresh_ghosts(FieldSet& fields);
/// Slab::compute_and_refresh(); without a slab compute(0, all nodes).
template <class Compute>
void compute_and_refresh(FieldSet& fields, std::span<const int> which, std::size_t outer, const Compute& compute) {
  if (const Slab* const slab = Slab::of(fields.size())) {
    slab->compute_and_refresh(fields, which, outer, compute);
  } else {
    compute(std::size_t{0}, fields.size());
  }
}
///@}
/// Saves what a rank has of numbers that Slab, or Transposition, gathers and scatters, as those of all ranks, in a
/// record; and restores it out of `of` such numbers. All ranks call the same.
///@{
template <class Shared>
void save_in_parts(StateWriter& state, const Shared& shared, std::span<const double> part) {
  shared.gather(part, [&](std::span<const double> planes) { state.write(planes); });
}
template <class Shared>
void restore_in_parts(StateReader& state, const Shared& shared, std::size_t of, std::span<double> part) {
  state.require(of);
  shared.scatter(part, [&](std::span<double> planes) { state.read_alone(planes.size(), planes); });
  if (!shared.leads()) {
    state.read_alone(of, {});
  }
}
///@}
/// Saves fields: for a record as those of the whole lattice, the same for every number of ranks (at rank 0; others save
/// nothing), and restores them, from the same at every rank; to go back to as this rank has them.
///@{
void save_whole(StateWriter& state, const FieldSet& fields);
void restore_whole(StateReader& state, FieldSet& fields);
void save_whole(StateWriter& state, const FieldSet& fields, std::span<const int> which);
void restore_whole(StateReader& state, FieldSet& fields, std::span<const int> which);
///@}

}  // namespace rubato::grids
