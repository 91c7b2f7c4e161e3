#include <rubato/ode/splitting_passes.hpp>

#include <algorithm>
#include <memory>
#include <tuple>

#include <fmt/format.h>

namespace rubato {

namespace {

using formula::Bytecode;
using formula::Expression;
using formula::ScalarEvaluator;

/// Lengths of parts in front of a state, at most; and numbers behind it, V and T.
constexpr std::size_t most_lengths = 3, values_behind = 2;

enum class Part { kick, kick_by_kept, drift };

/// How the numbers of a state stand: as those of a SplittingState, or those that a kick moves before those that a drift
/// does.
enum class Order { level, between };

struct PassCode {
  std::vector<Part> parts;
  Order from, to;
};

void append(std::vector<Expression>& all, const std::vector<Expression>& further) {
  all.insert(all.end(), further.begin(), further.end());
}

std::vector<Expression> in_order(const SplittingState& z, Order order) {
  const std::vector<Expression> q = z.positions(), p = z.momenta();
  const auto& [first, second] = order == Order::level ? std::tie(q, p) : std::tie(p, q);
  std::vector<Expression> all = first;
  append(all, second);
  return all;
}

/// (the lengths of the parts, z in its parts, ∇V where it is kept) ↦ (z in its parts, V and T where there is a kick): V
/// at the kick, T at the momenta before it. Of one kick alone the outputs are what it moves, ∇V, V and T.
Bytecode code_of(const PassCode& pass, const SplittingHalf& T, const SplittingHalf& V) {
  formula::Graph graph;
  const std::size_t n = V.variables.size();
  const auto named = [&](const char* name, std::size_t count) {
    std::vector<Expression> variables;
    for (std::size_t i = 0; i < count; ++i) {
      variables.push_back(graph.variable(fmt::format("{}{}", name, i)));
    }
    return variables;
  };
  SplittingState z(n, graph);
  const std::vector<Expression> lengths = named("length", pass.parts.size());
  std::vector<Expression> inputs = lengths, kept, values;
  append(inputs, in_order(z, pass.from));
  if (pass.parts.front() == Part::kick_by_kept) {
    kept = named("f", n);
    append(inputs, kept);
  }
  const bool is_kick = pass.parts.size() == 1;
  for (std::size_t k = 0; k < pass.parts.size(); ++k) {
    if (pass.parts[k] == Part::kick_by_kept) {
      z.move_along(kept, false, lengths[k]);
    } else if (pass.parts[k] == Part::drift) {
      z.move(T, true, lengths[k]);
    } else {
      const Expression before = T.at(std::span<const Expression>(z.momenta()).first(n), graph)[0];
      const std::vector<Expression> value = z.move(V, false, lengths[k]);
      if (is_kick) {
        values.assign(value.begin() + 1, value.end());
      }
      values.insert(values.end(), {value[0], before});
    }
  }
  std::vector<Expression> outputs = is_kick ? z.momenta() : in_order(z, pass.to);
  append(outputs, values);
  return {outputs, inputs};
}

}  // namespace

SplittingPasses::SplittingPasses(const SplittingHalf& T, const SplittingHalf& V, const Composition& composition)
    : composition_(&composition), n_(V.variables.size()), kicks_first_(!composition.parts.front().drift) {
  const auto half = static_cast<std::ptrdiff_t>(2 * n_);
  const auto place_of = [&](Order order) { return order == Order::level ? 0 : -half; };
  const auto pass_of = [&](const PassCode& pass) {
    return Pass{.evaluate = ScalarEvaluator(code_of(pass, T, V)),
                .parts = pass.parts.size(),
                .from = place_of(pass.from),
                .to = place_of(pass.to) + (pass.parts.size() == 1 ? half : 0)};
  };
  const Order order = kicks_first_ ? Order::between : Order::level;
  if (kicks_first_) {
    V_.emplace(V.code);
    first_ = pass_of({{Part::kick_by_kept, Part::drift}, Order::level, order});
    last_ = pass_of({{Part::kick}, order, Order::level});
  } else {
    first_ = pass_of({{Part::drift, Part::kick, Part::drift}, Order::level, order});
    T_.emplace(Bytecode(std::span(T.outputs).first(1), T.variables));
  }
  if (composition.parts.size() > 3) {
    inner_ = pass_of({{Part::kick, Part::drift}, order, order});
  }
  // What is written to one is not to stand where the next numbers of another are read from, by the last twelve bits of
  // addresses, which is all that processors look at before they let a load go ahead of a store.
  constexpr std::size_t line = 8, page = 512, third = 21 * line;
  const std::size_t before = most_lengths + 2 * n_, behind = (SplittingState::parts + 1) * n_ + values_behind;
  const std::size_t size = before + behind;
  memory_.resize(4 * (size + page) + line);
  void* begin = memory_.data();
  std::size_t space = memory_.size() * sizeof(double);
  auto* const first = static_cast<double*>(std::align(line * sizeof(double), size * sizeof(double), begin, space));
  std::size_t next = 0;
  const auto take = [&](std::size_t remainder) {
    next += before;
    next += (remainder + page - next % page) % page;
    double* const room = first + next;
    next += behind;
    return room;
  };
  between_[0] = take(0);
  between_[1] = take(third);
  levels_ = {take(2 * third), take(2 * third)};
}

std::array<std::span<double>, 2> SplittingPasses::levels() {
  const std::size_t size = SplittingState::parts * n_;
  return {std::span(levels_[0], size), std::span(levels_[1], size)};
}

/// Where a step begins and it is not kept from the step before.
void SplittingPasses::know_potential(double* level) {
  std::optional<double>& potential = potential_of(level);
  if (!potential) {
    const double* const values = V_->at(level + n_);
    std::copy_n(values + 1, n_, level + SplittingState::parts * n_);
    potential = values[0];
  }
}

double SplittingPasses::operator()(double h, double* here, double* there) {
  std::span<const Composition::Part> parts(composition_->parts);
  double energy = 0.0, potential = 0.0;
  std::optional<double> drifted;  // with the p that stands there, and is not in E yet
  if (kicks_first_) {
    know_potential(here);
    energy += parts.front().length * *potential_of(here);
  }
  for (double* from = here; !parts.empty();) {
    Pass& pass = from == here ? first_ : parts.size() == last_.parts ? last_ : inner_;
    const std::span<const Composition::Part> gone = parts.first(pass.parts);
    parts = parts.subspan(pass.parts);
    double* const to = parts.size() <= last_.parts ? there : from == between_[0] ? between_[1] : between_[0];
    double* const inputs = from + pass.from - gone.size();
    for (std::size_t k = 0; k < gone.size(); ++k) {
      inputs[k] = (gone[k].drift ? gone[k].length : -gone[k].length) * h;
    }
    const std::span<double> outputs(to + pass.to, pass.evaluate.code().output_count());
    pass.evaluate({inputs, pass.evaluate.code().input_count()}, outputs);
    const double* const values = outputs.last(values_behind).data();  // V and T
    const bool has_kept = kicks_first_ && from == here;               // a kick that is in E already
    for (const Composition::Part& part : gone.subspan(has_kept ? 1 : 0)) {
      if (part.drift) {
        drifted = part.length;
      } else {
        if (drifted) {
          energy += *drifted * values[1];
        }
        potential = values[0];
        energy += part.length * potential;
      }
    }
    from = to;
  }
  if (kicks_first_) {
    potential_of(there) = potential;
  } else {
    energy += *drifted * *T_->at(there + 2 * n_);
  }
  return energy;
}

}  // namespace rubato
