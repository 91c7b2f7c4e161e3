#include <rubato/ode/splitting_passes.hpp>

#include <algorithm>
#include <memory>

#include <fmt/format.h>

namespace rubato {

namespace {

using formula::Bytecode;
using formula::Expression;
using formula::ScalarEvaluator;

/// Where a state ends: the lengths h of a pass, of the kick and of the drift; and then V and T where it began.
constexpr std::size_t tail = 2;

/// (z in its parts, the two lengths) ↦ (z in its parts, V, T), without those numbers that a part alone leaves as they
/// are.
Bytecode parts_code(const SplittingHalf& T, const SplittingHalf& V, bool kicks, bool drifts) {
  formula::Graph graph;
  const std::size_t n = V.variables.size();
  SplittingState z(n, graph);
  std::vector<Expression> inputs = z.all();
  const Expression kick = graph.variable("kick"), drift = graph.variable("drift");
  inputs.insert(inputs.end(), {kick, drift});
  std::vector<Expression> values;
  if (kicks) {
    const Expression before = T.at(std::span(inputs).subspan(2 * n, n), graph)[0];
    values = {z.move(V, false, kick), before};
  }
  if (drifts) {
    z.move(T, true, drift);
  }
  std::vector<Expression> outputs = z.all();
  const auto half = outputs.begin() + static_cast<std::ptrdiff_t>(2 * n);
  if (!drifts) {
    outputs.erase(outputs.begin(), half);
  } else if (!kicks) {
    outputs.erase(half, outputs.end());
  }
  outputs.insert(outputs.end(), values.begin(), values.end());
  return {outputs, inputs};
}

}  // namespace

SplittingPasses::SplittingPasses(const SplittingHalf& T, const SplittingHalf& V, const Composition& composition)
    : composition_(&composition), n_(V.variables.size()), pass_(parts_code(T, V, true, true)) {
  if (composition.parts.front().drift) {
    drift_.emplace(parts_code(T, V, false, true));
    T_.emplace(Bytecode(std::span(T.outputs).first(1), T.variables));
  } else {
    kick_.emplace(parts_code(T, V, true, false));
  }
  // What is written to one is not to stand where the next numbers of another are read from, by the last twelve bits of
  // addresses, which is all that processors look at before they let a load go ahead of a store.
  constexpr std::size_t line = 8, page = 512, third = 21 * line;
  const std::size_t size = SplittingState::parts * n_ + tail;
  memory_.resize(4 * (size + page) + line);
  void* begin = memory_.data();
  std::size_t space = memory_.size() * sizeof(double);
  auto* const first = static_cast<double*>(std::align(line * sizeof(double), size * sizeof(double), begin, space));
  std::size_t next = 0;
  const auto take = [&](std::size_t remainder) {
    next += (remainder + page - next % page) % page;
    double* const room = first + next;
    next += size;
    return room;
  };
  between_[0] = take(0);
  between_[1] = take(third);
  levels_ = {take(2 * third), take(2 * third)};
}

std::array<std::span<double>, 2> SplittingPasses::levels() {
  const std::size_t size = SplittingState::parts * n_ + tail;
  return {std::span(levels_[0], size), std::span(levels_[1], size)};
}

double SplittingPasses::operator()(double h, double* here, double* there) {
  std::span<const Composition::Part> parts(composition_->parts);
  const std::size_t size = SplittingState::parts * n_ + tail, half = 2 * n_;
  double* from = here;
  const auto go = [&](ScalarEvaluator& evaluate, double kick, double drift, std::span<double> to) {
    from[size - 2] = -(kick * h);
    from[size - 1] = drift * h;
    evaluate({from, size}, to);
  };
  double energy = 0.0;
  std::optional<double> drifted;  // with the p that stands there, and is not in E yet
  if (drift_) {
    std::copy_n(here + half, half, between_[1] + half);
    go(*drift_, 0.0, parts.front().length, {between_[1], half});
    from = between_[1];
    drifted = parts.front().length;
    parts = parts.subspan(1);
  }
  const auto add = [&](double kick, const double* to) {
    if (drifted) {
      energy += *drifted * to[size - 1];
    }
    energy += kick * to[size - 2];
  };
  for (; parts.size() > 1; parts = parts.subspan(2)) {
    double* const to = parts.size() == 2 ? there : from == between_[0] ? between_[1] : between_[0];
    go(pass_, parts[0].length, parts[1].length, {to, size});
    from = to;
    add(parts[0].length, to);
    drifted = parts[1].length;
  }
  if (kick_) {
    std::copy_n(from, half, there);
    go(*kick_, parts.front().length, 0.0, {there + half, size - half});
    add(parts.front().length, there);
  } else {
    energy += *drifted * *T_->at(there + half);
  }
  return energy;
}

}  // namespace rubato
