#include <rubato/ode/splitting_lanes.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include <fmt/format.h>

#include <rubato/ode/separable.hpp>
#include <rubato/ode/splitting_formula.hpp>
#include <rubato/ode/tuning.hpp>
#include <rubato/variation/clear_of_zero.hpp>
#include <rubato/variation/run_span.hpp>
#include <rubato/variation/tuning.hpp>

namespace rubato {

namespace {

using namespace tuning::lanes_of_splitting;

using formula::Expression;

constexpr std::size_t chunk = 8;

/// H, Γ and what is observed: formulas of the Hamiltonian's variables.
std::vector<Expression> seen_at_levels(const Hamiltonian& hamiltonian, bool gamma,
                                       std::span<const Expression> observed) {
  std::vector<Expression> seen = {hamiltonian.expression()};
  if (gamma) {
    seen.push_back(hamiltonian.gamma());
  }
  seen.insert(seen.end(), observed.begin(), observed.end());
  return seen;
}

formula::BatchEvaluator scalar_batch(std::span<const Expression> outputs, std::span<const Expression> inputs) {
  return formula::BatchEvaluator(formula::Bytecode(outputs, inputs), formula::Engine::automatic,
                                 formula::BatchFunctions::scalar);
}

}  // namespace

double SplittingLanes::Along::farthest(double from) const {
  return std::max(std::abs(least - from), std::abs(greatest - from));
}

std::unique_ptr<SplittingLanes> SplittingLanes::make(const Hamiltonian& hamiltonian, const Composition& composition,
                                                     std::span<const Expression> observed, std::size_t width,
                                                     bool all) {
  if (!hamiltonian.constraints().none()) {
    return nullptr;
  }
  const Hamiltonian bare = hamiltonian.without_constant().with_own_graph();
  const Separation halves = separate(bare);
  if (!halves.separable()) {
    throw std::invalid_argument(fmt::format("a splitting needs H = T(p) + V(q); {} depends on both", halves.mixed));
  }
  const std::span variables(bare.variables());
  const std::size_t n = bare.degrees_of_freedom();
  const auto step = splitting_formula(SplittingHalf(halves.T, variables.subspan(n)),
                                      SplittingHalf(halves.V, variables.first(n)), composition);
  if (!step) {
    return nullptr;
  }
  std::unique_ptr<SplittingLanes> lanes(
      new SplittingLanes(n, composition, (std::max<std::size_t>(width, 1) + chunk - 1) / chunk * chunk));
  lanes->has_gamma_ = all && composition.has_node_law();
  const std::vector<Expression> seen =
      seen_at_levels(bare, lanes->has_gamma_, formula::substitute(observed, *bare.graph(), {}, {}));
  lanes->nodes_ = scalar_batch(seen, variables);

  std::vector<Expression> outputs = step->there.all();
  outputs.push_back(step->energy);
  const std::vector<Expression> high = step->here.high(), high_there = step->there.high();
  const auto seen_there = formula::substitute(seen, *step->graph, variables, high_there);
  outputs.insert(outputs.end(), seen_there.begin(), seen_there.end());
  lanes->whole_ = scalar_batch(outputs, step->inputs());

  lanes->measures_ = all;
  // As SplittingScheme::energy_size() has it.
  std::vector<Expression> middle, errors;
  for (std::size_t i = 0; i < 2 * n; ++i) {
    const Expression here = high[i], there = high_there[i];
    middle.push_back(0.5 * (here + there));
    errors.push_back(2.0 * (abs(middle[i]) + abs(there - here)));
  }
  middle.insert(middle.end(), errors.begin(), errors.end());
  lanes->middle_ = scalar_batch(middle, step->inputs());
  lanes->energy_size_ = formula::SumSizeEvaluator(bare.size_code());
  lanes->make_room(hamiltonian, composition, observed.size());
  return lanes;
}

void SplittingLanes::make_room(const Hamiltonian& hamiltonian, const Composition& composition, std::size_t observed) {
  const std::size_t nodes = 1 + (has_gamma_ ? 1 : 0) + observed;
  const std::size_t rows = 2 * 4 * n_ + 5 + 3 + 5 * nodes + 4 * n_;
  room_.resize(rows * width_ / chunk);
  std::size_t next = 0;
  const auto take = [&] { return row(next++); };
  for (auto& to : to_) {
    for (std::size_t i = 0; i < 4 * n_; ++i) {
      to.push_back(take());
    }
  }
  for (double** one : {&h_, &energy_, &odd_, &rounding_, &shows_}) {
    *one = take();
  }
  const auto see = [&](double constant, double scale) {
    return Seen{.first = take(), .least = take(), .greatest = take(), .constant = constant, .scale = scale};
  };
  energies_ = see(hamiltonian.constant(), 1.0);
  for (std::size_t k = 0; k < nodes; ++k) {
    const bool is_gamma = has_gamma_ && k == 1;
    nodes_seen_.push_back(see(k == 0 ? hamiltonian.constant() : 0.0, is_gamma ? composition.gamma : 1.0));
    for (auto& at : seen_at_) {
      at.push_back(take());
    }
  }
  for (std::size_t i = 0; i < 4 * n_; ++i) {
    middle_at_.push_back(take());
  }
  for (int which = 0; which < 2; ++which) {
    from_[which].assign(to_[which].begin(), to_[which].end());
    from_[which].push_back(h_);
  }
  for (int which = 0; which < 2; ++which) {
    to_[which].push_back(energy_);
    to_[which].insert(to_[which].end(), seen_at_[which].begin(), seen_at_[which].end());
  }
  for (std::size_t i = 0; i < 4; ++i) {
    shown_[i].resize(i < 2 ? 2 * n_ : observed);
  }
  high_.resize(2 * n_);
  point_.resize(2 * n_);
  errors_.resize(2 * n_);
}

std::size_t SplittingLanes::steps_of(const Start& start) {
  const double direction = start.step > 0.0 ? 1.0 : -1.0;
  const auto finished = [&](std::size_t k) {
    const double t = start.t + static_cast<double>(k) * start.step;
    return direction * (t - start.until) >= -end_slack * std::abs(start.step);
  };
  const double about = std::clamp((start.until - start.t) / start.step - 2.0, 0.0, 1e15);
  auto steps = static_cast<std::size_t>(about);
  while (!finished(steps)) {
    ++steps;
  }
  return steps;
}

bool SplittingLanes::run(std::span<const Start> starts, std::size_t max_steps, std::span<End> ends,
                         const std::function<bool()>& halted, const Watch* watch) {
  if (starts.empty() || starts.size() > width_ || starts.size() != ends.size()) {
    throw std::invalid_argument(
        fmt::format("{} starts and {} ends of orbits that have room for {}", starts.size(), ends.size(), width_));
  }
  begin(starts);
  for (std::size_t m = 0; m < starts.size(); ++m) {
    ends[m] = {};
    ends[m].steps = steps_of(starts[m]);
    ends[m].alone = ends[m].steps > max_steps;
    ends[m].z.resize(2 * n_);
    ends[m].observed.resize(nodes_seen_.size() - (has_gamma_ ? 2 : 1));
  }
  std::size_t k = 0;
  for (;;) {
    std::size_t stop = std::numeric_limits<std::size_t>::max();
    for (std::size_t m = 0; m < starts.size(); ++m) {
      if (!ends[m].alone && ends[m].steps == k) {
        write(m, starts[m], k, ends[m]);
      }
      if (!ends[m].alone && ends[m].steps > k) {
        stop = std::min(stop, ends[m].steps);
      }
    }
    if (stop == std::numeric_limits<std::size_t>::max()) {
      return true;
    }
    for (; k < stop; ++k) {
      if (k % steps_between_questions == 0 && halted && halted()) {
        interrupt(starts, k, ends);
        return false;
      }
      if (measures_ && k % tuning::size_period == 0) {
        measure(starts.size());
      }
      step();
      if (watch != nullptr) {
        find_steps_to_show(*watch, k == 0);
        stop = show(starts, k, ends, *watch) ? k + 1 : stop;
      }
    }
  }
}

/// Those that have not ended do so at level k.
void SplittingLanes::interrupt(std::span<const Start> starts, std::size_t k, std::span<End> ends) const {
  for (std::size_t m = 0; m < starts.size(); ++m) {
    if (!ends[m].alone && ends[m].steps > k) {
      ends[m].steps = k;
      ends[m].interrupted = true;
      write(m, starts[m], k, ends[m]);
    }
  }
}

/// Which orbits have a step to show: 0 for those whose functions are clear of zeros.
void SplittingLanes::find_steps_to_show(const Watch& watch, bool all) {
  double* const __restrict shows = shows_;
  const double* const __restrict h = h_;
  std::fill_n(shows, width_, all || watch.functions == 0 ? 1.0 : 0.0);
  const std::size_t first = nodes_seen_.size() - shown_[2].size() + watch.first_function;
  for (std::size_t i = 0; i < watch.functions; ++i) {
    const double* const __restrict from = seen_at_[1 - here_][first + 2 * i];
    const double* const __restrict rate_0 = seen_at_[1 - here_][first + 2 * i + 1];
    const double* const __restrict to = seen_at_[here_][first + 2 * i];
    const double* const __restrict rate_1 = seen_at_[here_][first + 2 * i + 1];
    for (std::size_t m = 0; m < width_; ++m) {
      shows[m] = is_clear_of_zero(from[m], h[m] * rate_0[m], to[m], h[m] * rate_1[m]) ? shows[m] : 1.0;
    }
  }
}

/// Every orbit that has not ended, and has something to show of step k. \return whether some are to end with it
bool SplittingLanes::show(std::span<const Start> starts, std::size_t k, std::span<End> ends, const Watch& watch) {
  const std::size_t first = nodes_seen_.size() - shown_[2].size();
  bool some_end = false;
  for (std::size_t m = 0; m < starts.size(); ++m) {
    if (shows_[m] == 0.0 || ends[m].alone || ends[m].steps <= k) {
      continue;
    }
    for (const int end : {0, 1}) {
      const int which = end == 0 ? 1 - here_ : here_;
      for (std::size_t i = 0; i < 2 * n_; ++i) {
        shown_[end][i] = to_[which][n_ + i][m];
      }
      for (std::size_t i = 0; i < shown_[2].size(); ++i) {
        shown_[2 + end][i] = seen_at_[which][first + i][m];
      }
    }
    const auto time = [&](std::size_t level) { return starts[m].t + static_cast<double>(level) * starts[m].step; };
    const Verdict verdict = watch.show({.lane = m,
                                        .z_0 = shown_[0],
                                        .z_1 = shown_[1],
                                        .t_0 = time(k),
                                        .t_1 = time(k + 1),
                                        .h = starts[m].step,
                                        .observed_0 = shown_[2],
                                        .observed_1 = shown_[3]});
    if (verdict == Verdict::alone) {
      ends[m].alone = true;
    } else if (verdict == Verdict::end) {
      ends[m].steps = k + 1;
      some_end = true;
    }
  }
  return some_end;
}

/// Lanes beyond the last orbit are like the first.
void SplittingLanes::begin(std::span<const Start> starts) {
  here_ = 0;
  first_step_ = true;
  for (std::size_t m = 0; m < width_; ++m) {
    const Start& start = starts[m < starts.size() ? m : 0];
    for (std::size_t i = 0; i < 2 * n_; ++i) {
      to_[0][n_ + i][m] = start.z[i];
      to_[0][i < n_ ? i : 2 * n_ + i][m] = 0.0;
    }
    h_[m] = start.step;
    odd_[m] = rounding_[m] = 0.0;
  }
  const auto high = from_[0].begin() + static_cast<std::ptrdiff_t>(n_);  // as SplittingState has it
  high_.assign(high, high + static_cast<std::ptrdiff_t>(2 * n_));
  nodes_(width_, high_, seen_at_[0]);
  see_level(true);
}

void SplittingLanes::step() {
  whole_(width_, from_[here_], to_[1 - here_]);
  here_ = 1 - here_;
  see(energy_, energies_, first_step_);
  see_level(false);
  first_step_ = false;
}

void SplittingLanes::see_level(bool first) {
  for (std::size_t k = 0; k < nodes_seen_.size(); ++k) {
    see(seen_at_[here_][k], nodes_seen_[k], first);
  }
}

/// A value that is not finite leaves its mark in odd_ for good.
void SplittingLanes::see(const double* __restrict values, const Seen& seen, bool first) {
  const double constant = seen.constant, scale = seen.scale;
  double* const __restrict least = seen.least;
  double* const __restrict greatest = seen.greatest;
  double* const __restrict odd = odd_;
  if (first) {
    for (std::size_t m = 0; m < width_; ++m) {
      seen.first[m] = least[m] = greatest[m] = scale * (values[m] + constant) / scale;
    }
  }
  for (std::size_t m = 0; m < width_; ++m) {
    const double value = scale * (values[m] + constant) / scale;
    least[m] = value < least[m] ? value : least[m];
    greatest[m] = value > greatest[m] ? value : greatest[m];
    odd[m] += value - value;
  }
}

/// The rounding error of E_k in the coming step, as TimeLevels has it from time to time.
void SplittingLanes::measure(std::size_t lanes) {
  middle_(width_, from_[here_], middle_at_);
  for (std::size_t m = 0; m < lanes; ++m) {
    for (std::size_t i = 0; i < 2 * n_; ++i) {
      point_[i] = middle_at_[i][m];
      errors_[i] = middle_at_[2 * n_ + i][m];
    }
    formula::SumSize size = energy_size_(point_, errors_);
    size.rounding *= magnitude_;
    odd_[m] += size.terms - size.terms;
    odd_[m] += size.rounding - size.rounding;
    rounding_[m] = std::max(rounding_[m], size.rounding);
  }
}

void SplittingLanes::write(std::size_t lane, const Start& start, std::size_t steps, End& end) const {
  double odd = odd_[lane];
  for (std::size_t i = 0; i < 2 * n_; ++i) {
    end.z[i] = from_[here_][n_ + i][lane];
    odd += end.z[i] - end.z[i];
  }
  end.alone = odd != 0.0;
  end.t = start.t + static_cast<double>(steps) * start.step;
  const auto along = [lane](const Seen& seen) {
    return Along{.first = seen.first[lane], .least = seen.least[lane], .greatest = seen.greatest[lane]};
  };
  end.energy = steps > 0 ? along(energies_) : Along{};
  end.node_energy = along(nodes_seen_[0]);
  end.gamma = has_gamma_ ? along(nodes_seen_[1]) : Along{};
  for (std::size_t k = 0; k < end.observed.size(); ++k) {
    end.observed[k] = along(nodes_seen_[k + (has_gamma_ ? 2 : 1)]);
  }
  end.rounding = rounding_[lane];
}

}  // namespace rubato
