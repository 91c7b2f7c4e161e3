#include <rubato/formula/loop_evaluator.hpp>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <type_traits>
#include <utility>

#include <rubato/base/wide_vectors.hpp>
#include <rubato/formula/batch_kernel.hpp>

namespace rubato::formula {

// ---- values ---------------------------------------------------------------------------------------------------------

namespace {

/// The iterations, in blocks: body(pieces, count), where there is room for the pieces.
template <typename Piece, typename Body>
void for_each_block(const Iterations& iterations, std::vector<Piece>& pieces, Body body) {
  constexpr std::size_t most = batch::block_points;
  pieces.clear();
  std::size_t filled = 0;
  const auto lengths = iterations.lengths();
  for (std::size_t stretch = 0; stretch < lengths.size(); ++stretch) {
    for (std::size_t done = 0; done < lengths[stretch];) {
      const std::size_t count = std::min(most - filled, lengths[stretch] - done);
      pieces.push_back({stretch, done, count, filled});
      done += count;
      filled += count;
      if (filled == most) {
        body(std::span<const Piece>(pieces), filled);
        pieces.clear();
        filled = 0;
      }
    }
  }
  if (filled > 0) {
    body(std::span<const Piece>(pieces), filled);
  }
}

/// Calls body with the stride, as a constant where it is a small one: then the compiler makes loops over vectors.
template <typename Body>
[[gnu::always_inline]] inline void with_stride(std::ptrdiff_t stride, Body body) {
  switch (stride) {
    case 0: body(std::integral_constant<std::ptrdiff_t, 0>()); break;
    case 1: body(std::integral_constant<std::ptrdiff_t, 1>()); break;
    case 2: body(std::integral_constant<std::ptrdiff_t, 2>()); break;
    case 3: body(std::integral_constant<std::ptrdiff_t, 3>()); break;
    default: body(stride);
  }
}

RUBATO_WIDE_VECTORS void gather(const double* __restrict from, std::ptrdiff_t stride, std::ptrdiff_t count,
                                double* __restrict to) {
  with_stride(stride, [=] [[gnu::always_inline]] (auto step) {
    for (std::ptrdiff_t i = 0; i < count; ++i) {
      to[i] = from[i * step];
    }
  });
}

RUBATO_WIDE_VECTORS void scatter(const double* __restrict from, std::ptrdiff_t stride, std::ptrdiff_t count,
                                 double* __restrict to) {
  with_stride(stride, [=] [[gnu::always_inline]] (auto step) {
    for (std::ptrdiff_t i = 0; i < count; ++i) {
      to[i * step] += from[i];
    }
  });
}

RUBATO_WIDE_VECTORS double sum_by_eights(const double* values, std::size_t count) {
  constexpr std::size_t lanes = batch::widest_vector;
  EightLanes sums = {}, next = {};
  std::size_t i = 0;
  for (; i + lanes <= count; i += lanes) {
    std::memcpy(&next, values + i, sizeof(next));
    sums += next;
  }
  double rest = 0.0;
  for (; i < count; ++i) {
    rest += values[i];
  }
  return rest + (((sums[0] + sums[4]) + (sums[2] + sums[6])) + ((sums[1] + sums[5]) + (sums[3] + sums[7])));
}

}  // namespace

LoopEvaluator::LoopEvaluator(std::shared_ptr<const LoopProgram> program, Engine engine)
    : program_(std::move(program)), rest_(program_->rest, engine), values_(program_->value_count) {
  std::size_t most = 0;
  for (const LoopProgram::Stage& from : program_->stages) {
    Stage stage{.arguments = ScalarEvaluator(from.arguments, engine), .loops = {}};
    most = std::max(most, from.arguments.output_count());
    for (const LoopCode& code : from.loops) {
      const std::size_t slots = code.slots.size(), terms = code.targets.size();
      stage.loops.push_back({.code = &code,
                             .body = BatchEvaluator(code.body, engine),
                             .values = std::vector<double>((slots + terms) * batch::block_points),
                             .slots = std::vector<const double*>(slots),
                             .terms = std::vector<double*>(terms),
                             .sums = std::vector<CompensatedSum>(terms),
                             .pieces = {}});
      stage.loops.back().pieces.reserve(batch::block_points);
    }
    stages_.push_back(std::move(stage));
  }
  arguments_.resize(most);
}

void LoopEvaluator::operator()(const double* inputs, double* outputs) {
  double* next = std::copy_n(inputs, stages_.front().arguments.code().input_count(), values_.data());
  for (Stage& stage : stages_) {
    stage.arguments({values_.data(), stage.arguments.code().input_count()},
                    {arguments_.data(), stage.arguments.code().output_count()});
    for (Runner& runner : stage.loops) {
      run(runner, arguments_.data(), next);
      next += runner.code->output_count;
    }
  }
  rest_(values_, {outputs, rest_.code().output_count()});
}

void LoopEvaluator::run(Runner& runner, const double* arguments, double* outputs) {
  const LoopCode& code = *runner.code;
  const Iterations& iterations = *code.iterations;
  std::fill_n(outputs, code.output_count, 0.0);
  const auto room = [&](std::size_t number) { return runner.values.data() + number * batch::block_points; };
  for (std::size_t k = 0; k < code.slots.size(); ++k) {
    runner.slots[k] = room(k);
    if (!code.slots[k].column) {
      std::fill_n(room(k), batch::block_points, arguments[code.slots[k].offset]);
    }
  }
  for (std::size_t s = 0; s < code.targets.size(); ++s) {
    runner.sums[s] = {};
    runner.terms[s] = room(code.slots.size() + s);
  }
  for_each_block(iterations, runner.pieces, [&](std::span<const Runner::Piece> pieces, std::size_t count) {
    for (std::size_t k = 0; k < code.slots.size(); ++k) {
      if (!code.slots[k].column) {
        continue;
      }
      for (const Runner::Piece& piece : pieces) {
        const std::ptrdiff_t stride = iterations.column(piece.stretch, *code.slots[k].column).stride;
        const double* const from = arguments + code.slots[k].at(iterations, piece.stretch, piece.first);
        gather(from, stride, static_cast<std::ptrdiff_t>(piece.count), room(k) + piece.at);
      }
    }
    runner.body(count, runner.slots, runner.terms);
    for (std::size_t s = 0; s < code.targets.size(); ++s) {
      const Loop::Place& target = code.targets[s];
      if (!target.column) {
        runner.sums[s].add(sum_by_eights(runner.terms[s], count));
        continue;
      }
      for (const Runner::Piece& piece : pieces) {
        const std::ptrdiff_t stride = iterations.column(piece.stretch, *target.column).stride;
        const double* const from = runner.terms[s] + piece.at;
        double* const to = outputs + target.at(iterations, piece.stretch, piece.first);
        if (stride == 0) {
          *to += sum_by_eights(from, piece.count);
        } else {
          scatter(from, stride, static_cast<std::ptrdiff_t>(piece.count), to);
        }
      }
    }
  });
  for (std::size_t s = 0; s < code.targets.size(); ++s) {
    if (!code.targets[s].column) {
      outputs[code.targets[s].offset] += runner.sums[s].value();
    }
  }
}

// ---- bounds of rounding errors --------------------------------------------------------------------------------------

LoopRounding::LoopRounding(std::shared_ptr<const LoopProgram> program)
    : program_(std::move(program)),
      rest_(program_->rest),
      values_(program_->value_count),
      bounds_(program_->value_count) {
  for (const LoopProgram::Stage& from : program_->stages) {
    Stage stage{.arguments = RoundingEvaluator(from.arguments), .bodies = {}};
    for (const LoopCode& code : from.loops) {
      stage.bodies.emplace_back(code.body);
    }
    stages_.push_back(std::move(stage));
  }
}

void LoopRounding::operator()(std::span<const double> inputs, std::span<const double> errors) {
  std::ranges::copy(inputs, values_.begin());
  std::ranges::copy(errors, bounds_.begin());
  std::size_t known = inputs.size();
  for (std::size_t i = 0; i < stages_.size(); ++i) {
    RoundingEvaluator& arguments = stages_[i].arguments;
    arguments.run(std::span(values_).first(known), std::span(bounds_).first(known));
    arguments_.resize(arguments.output_count());
    errors_.resize(arguments.output_count());
    for (std::size_t k = 0; k < arguments.output_count(); ++k) {
      arguments_[k] = arguments.value(k);
      errors_[k] = arguments.bound(k);
    }
    for (std::size_t l = 0; l < stages_[i].bodies.size(); ++l) {
      const LoopCode& code = program_->stages[i].loops[l];
      run(code, stages_[i].bodies[l], known);
      known += code.output_count;
    }
  }
  rest_.run(values_, bounds_);
}

void LoopRounding::run(const LoopCode& code, RoundingEvaluator& body, std::size_t first_output) {
  /// A block's sum by eights, those eight, and the compensated sum of the blocks.
  constexpr double additions = batch::block_points / batch::widest_vector + 3 + 2;
  const Iterations& iterations = *code.iterations;
  double* const values = values_.data() + first_output;
  double* const bounds = bounds_.data() + first_output;
  std::fill_n(values, code.output_count, 0.0);
  std::fill_n(bounds, code.output_count, 0.0);
  slots_.resize(code.slots.size());
  slot_errors_.resize(code.slots.size());
  for (std::size_t stretch = 0; stretch < iterations.lengths().size(); ++stretch) {
    for (std::size_t k = 0; k < iterations.lengths()[stretch]; ++k) {
      for (std::size_t j = 0; j < code.slots.size(); ++j) {
        const auto at = static_cast<std::size_t>(code.slots[j].at(iterations, stretch, k));
        slots_[j] = arguments_[at];
        slot_errors_[j] = errors_[at];
      }
      body.run(slots_, slot_errors_);
      for (std::size_t s = 0; s < code.targets.size(); ++s) {
        const std::int64_t at = code.targets[s].at(iterations, stretch, k);
        values[at] += body.value(s);
        bounds[at] +=
            body.bound(s) + (code.targets[s].column ? std::abs(values[at]) : additions * std::abs(body.value(s)));
      }
    }
  }
}

}  // namespace rubato::formula
