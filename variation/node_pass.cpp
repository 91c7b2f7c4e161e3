#include <rubato/variation/node_pass.hpp>

#include <algorithm>
#include <utility>

#include <rubato/grids/parallel.hpp>
#include <rubato/grids/reductions.hpp>

namespace rubato {

namespace {

constexpr std::size_t block_nodes = grids::nodes_per_block;
/// Of the blocks of a thread so many at least follow each other; else codes take turns.
constexpr std::size_t least_share = 2;

}  // namespace

NodePass::NodePass(const grids::Grid& grid) : nodes_(grid.size()), slab_(grids::Slab::of(grid)) {
  if (grid.has_ghosts()) {
    ghosts_ = grids::ranges_where(grid, [&](std::size_t node) { return grid.weight(node) == 0.0; });
  }
}

void NodePass::add(NodeCode code, std::vector<int> written, std::size_t ghosts_lost) {
  Stage stage{.code = std::move(code),
              .written = std::move(written),
              .ghosts_lost = ghosts_lost,
              .first_sum = sums_.size(),
              .fields = nullptr,
              .which = {},
              .out = {}};
  for (const Stage& earlier : stages_) {
    stage.lag = std::max(stage.lag, earlier.lag);
    if (const auto reach = stage.code.reach(earlier.written); reach && *reach > 0) {
      stage.lag = std::max(stage.lag, earlier.lag + (*reach + block_nodes - 1) / block_nodes + 1);
    }
  }
  stage.sums = stage.code.outputs() - stage.written.size();
  stage.out.resize(stage.written.size());
  sums_.resize(sums_.size() + stage.sums);
  totals_.resize(sums_.size());
  of_blocks_.resize(blocks() * sums_.size());
  stages_.push_back(std::move(stage));
}

void NodePass::write(std::size_t stage, grids::FieldSet& fields, std::span<const int> which,
                     std::span<double* const> others) {
  Stage& one = stages_[stage];
  one.fields = &fields;
  one.which.assign(which.begin(), which.end());
  const auto rest = std::ranges::transform(which, one.out.begin(), [&](int f) { return fields.field(f).data(); }).out;
  std::ranges::copy(others, rest);
}

std::size_t NodePass::blocks() const {
  return (nodes_ + block_nodes - 1) / block_nodes;
}

/// Of values from node `begin` on: those of ghosts become 0, whatever they are.
void NodePass::clear_ghosts(std::span<double> values, std::size_t begin) const {
  const std::size_t end = begin + values.size();
  for (auto range = std::ranges::upper_bound(ghosts_, begin, {}, &grids::NodeRange::end);
       range != ghosts_.end() && range->begin < end; ++range) {
    const std::size_t from = std::max(range->begin, begin);
    std::ranges::fill(values.subspan(from - begin, std::min(range->end, end) - from), 0.0);
  }
}

void NodePass::evaluate(Stage& stage, std::size_t thread, std::size_t begin, std::size_t end, CompensatedSum* sums) {
  const std::span<double* const> values = std::span(scratch_[thread].of_sum).first(stage.sums);
  stage.code.evaluate(thread, begin, end, stage.out, values);
  for (std::size_t k = 0; k < stage.sums && sums != nullptr; ++k) {
    clear_ghosts({values[k], end - begin}, begin);
    grids::LaneSum sum;
    sum.add(std::span<const double>(values[k], end - begin));
    sums[stage.first_sum + k] = sum.total();
  }
}

void NodePass::evaluate_block(Stage& stage, std::size_t thread, std::size_t block) {
  evaluate(stage, thread, block * block_nodes, std::min((block + 1) * block_nodes, nodes_),
           of_blocks_.data() + block * sums_.size());
}

void NodePass::operator()(std::size_t first_stage) {
  const auto threads = static_cast<std::size_t>(grids::thread_count());
  while (scratch_.size() < threads) {
    Scratch& one = scratch_.emplace_back(grids::Buffer(sums_.size() * block_nodes), std::vector<double*>());
    for (std::size_t k = 0; k < sums_.size(); ++k) {
      one.of_sum.push_back(one.values.data() + k * block_nodes);
    }
  }
  const std::size_t lag = stages_.back().lag - stages_[first_stage].lag, share = blocks() / threads;
  if (slab_ != nullptr) {
    take_turns_of_ranks(first_stage);
  } else if (blocks() == 1 || share < (2 + least_share) * lag) {
    take_turns(first_stage);
  } else {
    follow_each_other(first_stage, threads);
  }
}

void NodePass::take_turns(std::size_t first_stage) {
  for (std::size_t s = first_stage; s < stages_.size(); ++s) {
    grids::for_each_index(blocks(), blocks() > 1,
                          [&](std::size_t block, std::size_t thread) { evaluate_block(stages_[s], thread, block); });
  }
  add_up(stages_[first_stage].first_sum);
}

/// Every thread has blocks one after the other, of which a stage leaves out as many at both ends as it follows the
/// first one by: what is there reads blocks of others, and waits for all of them.
void NodePass::follow_each_other(std::size_t first_stage, std::size_t ranges) {
  const auto first_of = [&](std::size_t range) { return blocks() * range / ranges; };
  const auto lag_of = [&](const Stage& stage) { return stage.lag - stages_[first_stage].lag; };
  grids::for_each_index(ranges, ranges > 1, [&](std::size_t range, std::size_t thread) {
    const std::size_t begin = first_of(range), end = first_of(range + 1);
    for (std::size_t block = begin; block < end; ++block) {
      for (std::size_t s = first_stage; s < stages_.size(); ++s) {
        if (const std::size_t lag = lag_of(stages_[s]); block >= begin + 2 * lag) {
          evaluate_block(stages_[s], thread, block - lag);
        }
      }
    }
  });
  for (std::size_t s = first_stage; s < stages_.size(); ++s) {
    const std::size_t lag = lag_of(stages_[s]);
    grids::for_each_index(2 * lag * ranges, lag > 0, [&](std::size_t index, std::size_t thread) {
      const std::size_t range = index / (2 * lag), place = index % (2 * lag);
      evaluate_block(stages_[s], thread, place < lag ? first_of(range) + place : first_of(range + 1) - 2 * lag + place);
    });
  }
  add_up(stages_[first_stage].first_sum);
}

void NodePass::take_turns_of_ranks(std::size_t first_stage) {
  const std::size_t first = slab_->first_node(), end = first + slab_->owned();
  std::ranges::fill(of_blocks_, CompensatedSum());
  for (std::size_t s = first_stage; s < stages_.size(); ++s) {
    Stage& stage = stages_[s];
    const auto over = [&](std::size_t from, std::size_t to, bool adds) {
      grids::for_each_block(to - from, block_nodes, [&](std::size_t a, std::size_t b, std::size_t thread) {
        evaluate(stage, thread, from + a, from + b,
                 adds ? of_blocks_.data() + (from + a - first) / block_nodes * sums_.size() : nullptr);
      });
    };
    if (stage.ghosts_lost > 0) {
      slab_->compute_and_refresh(*stage.fields, stage.which, stage.ghosts_lost,
                                 [&](std::size_t from, std::size_t to) { over(from, to, false); });
    } else {
      over(0, first, false);
      over(first, end, true);
      over(end, nodes_, false);
    }
  }
  add_up(stages_[first_stage].first_sum);
}

void NodePass::add_up(std::size_t first_sum) {
  for (std::size_t k = first_sum; k < sums_.size(); ++k) {
    totals_[k] = {};
    for (std::size_t block = 0; block < blocks(); ++block) {
      totals_[k].add(of_blocks_[block * sums_.size() + k]);
    }
  }
  const auto of_run = std::span(totals_).subspan(first_sum);
  if (slab_ != nullptr) {
    slab_->reduce(of_run, std::span(sums_).subspan(first_sum), {});
  } else {
    std::ranges::transform(of_run, sums_.begin() + static_cast<std::ptrdiff_t>(first_sum), &CompensatedSum::value);
  }
}

}  // namespace rubato
