#include <rubato/formula/rolled_rounding.hpp>

#include <algorithm>
#include <cmath>
#include <unordered_map>

#include <rubato/base/wide_vectors.hpp>
#include <rubato/formula/rolled_code.hpp>
#include <rubato/formula/rounding_steps.hpp>
#include <rubato/formula/single_assignment.hpp>

namespace rubato::formula {

namespace {

/// Values and their bounds, of members of a run.
struct Rows {
  double *values, *bounds;
};

/// An instruction of which is_arithmetic(), of `width` members. What it writes is nothing that it reads of others.
template <std::size_t width>
[[gnu::always_inline]] inline void take_members(const Instruction& step, const Rows& a, const Rows& b, const Rows& c,
                                                const Rows& to) {
  rounding_steps::with_arithmetic<false>(
      step, [&]<int operands>(rounding_steps::Operands<operands>, auto operation) __attribute__((always_inline)) {
        double* __restrict const values = to.values;
        double* __restrict const bounds = to.bounds;
        for (std::size_t l = 0; l < width; ++l) {
          Rounded result;
          if constexpr (operands == 1) {
            result = operation(Rounded{a.values[l], a.bounds[l]});
          } else if constexpr (operands == 2) {
            result = operation(Rounded{a.values[l], a.bounds[l]}, Rounded{b.values[l], b.bounds[l]});
          } else {
            result = operation(Rounded{a.values[l], a.bounds[l]}, Rounded{b.values[l], b.bounds[l]},
                               Rounded{c.values[l], c.bounds[l]});
          }
          values[l] = result.value;
          bounds[l] = result.bound;
        }
      });
}
RUBATO_WIDE_VECTORS void take_many(const Instruction& step, const Rows& a, const Rows& b, const Rows& c,
                                   const Rows& to) {
  take_members<RolledRounding::many>(step, a, b, c, to);
}
RUBATO_WIDE_VECTORS void take_few(const Instruction& step, const Rows& a, const Rows& b, const Rows& c,
                                  const Rows& to) {
  take_members<RolledRounding::few>(step, a, b, c, to);
}

RUBATO_WIDE_VECTORS double magnitudes_at(const double* values, const std::uint32_t* places, std::size_t count) {
  return rounding_steps::sum_in_eights(count, 0.0, [=](std::size_t i) { return std::abs(values[places[i]]); });
}

}  // namespace

/// Gives every value of rolled code its place.
class RolledRounding::Planner {
public:
  Planner(const Bytecode& code, const SingleAssignment& assigned, const RolledCode& rolled)
      : code_(code), assigned_(assigned), rolled_(rolled), fixed_(code.input_count() + code.constants().size()) {}

  RolledRounding plan() {
    size_ = (code_.input_count() + few - 1) / few * few;
    for (std::size_t k = 0; k < code_.constants().size(); ++k) {
      constants_.push_back(room(many));
    }
    std::size_t longest = 0;
    for (const RolledCode::Phase& phase : rolled_.phases) {
      for (const RolledCode::Loop& loop : phase.loops) {
        longest = std::max(longest, loop.body.size());
      }
    }
    at_hand_ = room(longest * many);
    kept_ = room(rolled_.places);
    for (const RolledCode::Phase& phase : rolled_.phases) {
      Phase& planned = result_.phases_.emplace_back();
      for (const RolledCode::Loop& loop : phase.loops) {
        planned.loops.push_back(loop_of(loop));
      }
      for (const std::uint32_t i : phase.single) {
        planned.single.push_back(single_step(i));
      }
    }
    for (std::size_t j = 0; j < assigned_.outputs.size(); ++j) {
      const auto stored = stored_.find(static_cast<std::uint32_t>(j));
      result_.outputs_.push_back(stored != stored_.end() ? stored->second : where_alone(assigned_.outputs[j]));
    }
    result_.values_.assign(size_ / few, Line{});
    result_.bounds_.assign(size_ / few, Line{});
    for (std::size_t k = 0; k < constants_.size(); ++k) {
      std::fill_n(result_.values_.front().numbers + constants_[k], many, code_.constants()[k]);
    }
    return std::move(result_);
  }

private:
  using ValueNumber = std::uint32_t;

  std::uint32_t room(std::size_t numbers) {
    const auto first = static_cast<std::uint32_t>(size_);
    size_ += (numbers + few - 1) / few * few;
    return first;
  }
  [[nodiscard]] std::size_t operands_of(std::uint32_t i) const {
    return static_cast<std::size_t>(operand_count(code_.instructions()[i].code));
  }

  /// Of one value.
  std::uint32_t where_alone(ValueNumber v) {
    if (v < code_.input_count()) {
      return v;
    }
    if (v < fixed_) {
      return constants_[v - code_.input_count()];
    }
    if (rolled_.place[v] != RolledCode::none) {
      return kept_ + rolled_.place[v];
    }
    const auto [entry, is_new] = alone_.try_emplace(v, 0);
    if (is_new) {
      entry->second = room(1);
    }
    return entry->second;
  }

  /// Of a run from this member on, or of what is the same for all.
  Place where_of_all(ValueNumber v) {
    if (v >= fixed_) {
      return {kept_ + rolled_.place[v], true};
    }
    if (v >= code_.input_count()) {
      return {constants_[v - code_.input_count()], false};
    }
    if (!rolled_.common[v]) {
      return {v, true};
    }
    const auto known = std::ranges::find(result_.common_, v, &Spread::input);
    if (known != result_.common_.end()) {
      return {known->to, false};
    }
    result_.common_.push_back({v, room(many)});
    return {result_.common_.back().to, false};
  }

  Instruction single_step(std::uint32_t i) {
    Instruction step = code_.instructions()[i];
    std::uint32_t* const operands[] = {&step.a, &step.b, &step.c};
    for (std::size_t k = 0; k < operands_of(i); ++k) {
      *operands[k] = where_alone(assigned_.steps[i].operands[k]);
    }
    const ValueNumber v = assigned_.steps[i].first_result;
    step.target = where_alone(v);
    if (step.code == OpCode::sincos) {
      step.b = where_alone(v + 1);
    }
    return step;
  }

  Loop loop_of(const RolledCode::Loop& loop) {
    Loop result{.body = {}, .length = loop.length};
    std::unordered_map<ValueNumber, Place> made;
    for (const std::uint32_t i : loop.body) {
      Step step{.instruction = code_.instructions()[i]};
      Place* const operands[] = {&step.a, &step.b, &step.c};
      for (std::size_t k = 0; k < operands_of(i); ++k) {
        const auto here = made.find(assigned_.steps[i].operands[k]);
        *operands[k] = here != made.end() ? here->second : where_of_all(assigned_.steps[i].operands[k]);
      }
      const ValueNumber v = assigned_.steps[i].first_result;
      const bool is_kept = rolled_.place[v] != RolledCode::none;
      step.target = is_kept ? Place{kept_ + rolled_.place[v], true}
                            : Place{at_hand_ + static_cast<std::uint32_t>(made.size() * many), false};
      made.emplace(v, step.target);
      for (const RolledCode::Store& store : loop.stores) {
        if (store.value == v) {  // what is kept gives way to others before the end
          step.also = step.also == nowhere ? room(loop.length) : step.also;
          for (std::uint32_t m = 0; m < loop.length; ++m) {
            stored_[store.first + m * store.stride] = step.also + m;
          }
        }
      }
      result.body.push_back(step);
    }
    return result;
  }

  RolledRounding result_;
  const Bytecode& code_;
  const SingleAssignment& assigned_;
  const RolledCode& rolled_;
  const std::size_t fixed_;
  std::size_t size_ = 0;
  std::vector<std::uint32_t> constants_;  ///< where each stands, many times
  std::uint32_t kept_ = 0, at_hand_ = 0;
  std::unordered_map<ValueNumber, std::uint32_t> alone_;     ///< values of single instructions that are not kept
  std::unordered_map<std::uint32_t, std::uint32_t> stored_;  ///< where outputs of loops stand
};

std::optional<RolledRounding> RolledRounding::of(const Bytecode& code) {
  const SingleAssignment assigned = single_assignment(code);
  const std::optional<RolledCode> rolled = roll(code, assigned, few);
  return rolled ? std::optional(Planner(code, assigned, *rolled).plan()) : std::nullopt;
}

/// The last members at once overlap with those before: what is computed twice is the same.
void RolledRounding::run_loop(const Loop& loop) {
  double* const values = values_.front().numbers;
  double* const bounds = bounds_.front().numbers;
  const std::size_t width = loop.length >= many ? many : few;
  for (std::size_t i = 0; i < loop.length; i += width) {
    i = std::min(i, loop.length - width);
    const auto rows = [&](const Place& place) {
      const std::size_t first = place.first + (place.moves ? i : 0);
      return Rows{values + first, bounds + first};
    };
    for (const Step& step : loop.body) {
      const Rows to = rows(step.target);
      (width == many ? take_many : take_few)(step.instruction, rows(step.a), rows(step.b), rows(step.c), to);
      if (step.also != nowhere) {
        std::copy_n(to.values, width, values + step.also + i);
        std::copy_n(to.bounds, width, bounds + step.also + i);
      }
    }
  }
}

double RolledRounding::terms() const {
  return magnitudes_at(values_.front().numbers, outputs_.data() + 1, outputs_.size() - 1);
}

void RolledRounding::run(std::span<const double> inputs, std::span<const double> errors) {
  double* const values = values_.front().numbers;
  double* const bounds = bounds_.front().numbers;
  std::ranges::copy(inputs, values);
  std::ranges::copy(errors, bounds);
  for (const auto& [input, to] : common_) {
    std::fill_n(values + to, many, inputs[input]);
    std::fill_n(bounds + to, many, errors[input]);
  }
  for (const Phase& phase : phases_) {
    for (const Loop& loop : phase.loops) {
      run_loop(loop);
    }
    for (const Instruction& step : phase.single) {
      take_rounded_step(step, values, bounds);
    }
  }
}

}  // namespace rubato::formula
