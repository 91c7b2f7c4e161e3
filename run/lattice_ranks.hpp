#pragma once

#include <exception>
#include <optional>
#include <span>
#include <vector>

#include <rubato/base/state.hpp>
#include <rubato/grids/slab.hpp>
#include <rubato/problem/problem.hpp>
#include <rubato/problem/stored.hpp>
#include <rubato/ranks/communicator.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/disagreements.hpp>
#include <rubato/run/run.hpp>

/// A run on one lattice, or the check of its record, shared by the ranks of a job in slabs: all ranks do the same, each
/// with its part, as rank 0 orders it. Rank 0 alone has the record; rows of whole fields are gathered there. What the
/// record holds does not depend on the number of ranks.
namespace rubato {

/// \throws ProblemError where a run cannot be shared by the ranks of `options`, saying what can be; never where there
/// is one rank
void refuse_unshared(const Problem& problem, const RunOptions& options);

/// Ends this process, and with it the job, for what went wrong at this rank alone: others may wait for it.
[[noreturn]] void end_job(const ranks::Communicator& ranks, const std::exception& error, ExitStatus status);

/// What ranks do next: each of these takes all of them.
enum class Order : int {
  make,     ///< a observed of the problem
  start,    ///< show the start
  step,     ///< take a step and show it, or explain why not
  save,     ///< for a checkpoint
  restore,  ///< from one
  state,    ///< the energies at the present level; and show its state, if that is wanted
  last,     ///< show the last state
  finish,   ///< the statistics at the end
  check,    ///< the states of a record
  end,
};

/// The slab of this rank. While it lives, this thread's reductions are those of all ranks.
class SharedLattice {
public:
  /// \throws ProblemError at the grid if there are more ranks than planes; at the scheme if parts will not do for
  /// `tangents`
  SharedLattice(ranks::Communicator& ranks, const Problem& problem, bool tangents);

  [[nodiscard]] const grids::Slab& slab() const { return slab_; }

private:
  grids::Slab slab_;
  grids::Slab::Shared shared_;
};

/// At rank 0: calls the others to share a run, orders what they do, and ends it with them when it goes.
class LatticeLeader {
public:
  /// With `tangents`, as make_simulation() has them.
  LatticeLeader(ranks::Communicator& ranks, const Problem& problem, int threads, bool tangents);
  LatticeLeader(const LatticeLeader&) = delete;
  LatticeLeader& operator=(const LatticeLeader&) = delete;
  ~LatticeLeader();

  void order(Order order) const;
  /// A state of `size` numbers.
  void order_restore(std::size_t size) const;
  /// True if the state is reported as well.
  void order_state(bool reported) const;
  /// check_lattice() by all ranks, whose findings these are.
  [[nodiscard]] Spread check(const record::Reader& reader, const StoredLevels& levels, bool has_gamma,
                             Disagreements& findings) const;
  [[nodiscard]] const grids::Slab& slab() const { return lattice_.slab(); }

private:
  const Problem& problem_;
  SharedLattice lattice_;
};

/// Where a record has the state.
inline constexpr const char* shared_state = "/checkpoint/state";

/// The state in a record, which rank 0 reads piece by piece and hands on: no rank has more of it than its part.
class SharedState final : public StateSource {
public:
  /// \param record null at other ranks than 0
  SharedState(const grids::Slab& slab, const record::Reader* record) : slab_(slab), record_(record) {}
  void read(std::span<double> values) override;
  void read_alone(std::span<double> values) override;
  /// Throws what reading has thrown first; there were zeros after that.
  void rethrow() const;

private:
  const grids::Slab& slab_;
  const record::Reader* record_;
  std::size_t next_ = 0;  ///< in the record, behind what waits
  std::vector<double> waiting_;
  std::size_t taken_ = 0;  ///< of what waits
  std::exception_ptr thrown_;
};

/// The message by which LatticeLeader calls; what it says is for follow_leader().
inline constexpr int lattice_to_do = 100;
/// At the other ranks: does what is ordered until the end. What goes wrong at this rank alone ends the process, and
/// with it the job.
void follow_leader(ranks::Communicator& ranks, std::span<const std::byte> message);

}  // namespace rubato
