#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include <rubato/base/compensated_sum.hpp>
#include <rubato/grids/buffer.hpp>
#include <rubato/grids/field_set.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/grids/slab.hpp>
#include <rubato/variation/node_code.hpp>

namespace rubato {

/// Codes one after the other over all nodes, in one pass over memory: a code that reads what an earlier one writes
/// follows it by as many blocks as its neighbours are far, while these are in the cache. Of some outputs only the sum
/// over all nodes is found.
///
///     NodePass pass(grid);
///     pass.add(std::move(code), {number of an array, …});    // the first outputs; of the others the sums
///     pass.code(0).read(…); pass.write(0, {pointers});
///     pass(0);
///     pass.sums();
///
/// Results do not depend on the number of threads. Sums leave out ghosts of walls (grids::Axis::ghosts). Where `grid`
/// is the part of a rank (grids::Slab) codes take turns, ghosts of what they write are refreshed in between where this
/// is asked for, and sums are over the whole lattice.
class NodePass {
public:
  NodePass() = default;
  explicit NodePass(const grids::Grid& grid);

  /// Adds a code. \param written what its first outputs are, as the formulas number arrays
  /// \param ghosts_lost so many planes of ghosts are wrong in what it writes, and are refreshed; in fields alone
  void add(NodeCode code, std::vector<int> written, std::size_t ghosts_lost = 0);
  [[nodiscard]] std::size_t size() const { return stages_.size(); }
  [[nodiscard]] NodeCode& code(std::size_t stage) { return stages_[stage].code; }

  /// Where a stage writes from now on: fields of a set, and after these other arrays.
  void write(std::size_t stage, grids::FieldSet& fields, std::span<const int> which,
             std::span<double* const> others = {});
  /// Evaluates the stages from this one on. Collective where ranks share the lattice.
  void operator()(std::size_t first_stage);
  /// Of the outputs that are not written, stage after stage.
  [[nodiscard]] std::span<const double> sums() const { return sums_; }

private:
  struct Stage {
    NodeCode code;
    std::vector<int> written;
    std::size_t lag = 0;  ///< in blocks, behind the first stage
    std::size_t ghosts_lost = 0;
    std::size_t first_sum = 0, sums = 0;
    grids::FieldSet* fields = nullptr;
    std::vector<int> which;
    std::vector<double*> out;
  };
  [[nodiscard]] std::size_t blocks() const;
  void clear_ghosts(std::span<double> values, std::size_t begin) const;
  void evaluate(Stage& stage, std::size_t thread, std::size_t begin, std::size_t end, CompensatedSum* sums);
  /// Block number `block` of all nodes, with its sums.
  void evaluate_block(Stage& stage, std::size_t thread, std::size_t block);
  void take_turns(std::size_t first_stage);
  void take_turns_of_ranks(std::size_t first_stage);
  void follow_each_other(std::size_t first_stage, std::size_t ranges);
  void add_up(std::size_t first_sum);

  std::size_t nodes_ = 0;
  const grids::Slab* slab_ = nullptr;
  std::vector<grids::NodeRange> ghosts_;  ///< of walls
  std::vector<Stage> stages_;
  /// One thread's: a block of each output that is not written, and where these are.
  struct Scratch {
    grids::Buffer values;
    std::vector<double*> of_sum;
  };
  std::vector<Scratch> scratch_;
  std::vector<CompensatedSum> of_blocks_;  ///< [block][sum]
  std::vector<CompensatedSum> totals_;
  std::vector<double> sums_;
};

}  // namespace rubato
