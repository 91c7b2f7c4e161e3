#include <rubato/pde/wave_propagators.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <complex>
#include <cstdint>

#include <rubato/pde/tuning.hpp>
#include <rubato/solve/small_matrices.hpp>

namespace rubato {

namespace {

using namespace tuning::wave_splitting;

using Complex = std::complex<double>;
using Eigen::Index;
using Eigen::MatrixXcd;
using formula::Expression;

/// sinh(√δ τ)/√δ and cosh(√δ τ).
struct Waves {
  Complex sine, cosine;
};
Waves waves_of(Complex delta, double tau) {
  if (std::abs(delta.imag()) <= 1e-14 * std::abs(delta.real()) && delta.real() < 0.0) {
    const double omega = std::sqrt(-delta.real());
    return {std::sin(omega * tau) / omega, std::cos(omega * tau)};
  }
  const Complex root = std::sqrt(delta);
  const Complex x = root * tau;
  const Complex sine = std::abs(x) < 1e-4 ? tau * (1.0 + x * x / 6.0) : std::sinh(x) / root;
  return {sine, std::cosh(x)};
}

bool are_same_bits(double a, double b) {
  return std::bit_cast<std::uint64_t>(a) == std::bit_cast<std::uint64_t>(b);
}

/// How many lengths a composition's drifts have.
std::size_t different_drifts(const Composition& composition) {
  std::vector<double> lengths;
  for (const Composition::Part& part : composition.parts) {
    if (part.drift) {
      lengths.push_back(part.length);
    }
  }
  std::ranges::sort(lengths);
  return static_cast<std::size_t>(std::ranges::unique(lengths).begin() - lengths.begin());
}

}  // namespace

WavePropagators::WavePropagators(const LinearWaves& waves)
    : waves_(waves),
      is_one_cosine_(turns_without_diagonal()),
      propagators_(waves.count() > many_waves ? propagators_of_many_waves : most_propagators) {
  find_frequencies();
}

/// True if A is of real pairs alone, without diagonal entries: exp(τA) has one cosine for both fields.
bool WavePropagators::turns_without_diagonal() const {
  return waves_.has_real_pairs() && std::ranges::all_of(waves_.groups(), [&](const std::vector<int>& group) {
           return group.size() == 2 && !waves_.has_diagonal(group.front()) && !waves_.has_diagonal(group.back());
         });
}

/// Groups of two fields that turn into each other with a frequency for each wave: sines and cosines in vectors.
void WavePropagators::find_frequencies() {
  const auto A = [&](int row, int column, std::size_t w) { return waves_.generator(row, column, w).real(); };
  frequencies_ = grids::FieldSet();
  if (!is_one_cosine_ || waves_.count() > many_waves) {  // these are filled in several threads
    return;
  }
  grids::FieldSet frequencies(static_cast<int>(waves_.groups().size()), waves_.count());
  for (std::size_t g = 0; g < waves_.groups().size(); ++g) {
    const int x = waves_.groups()[g].front(), y = waves_.groups()[g].back();
    for (std::size_t w = 0; w < frequencies.size(); ++w) {
      const double squared = -A(x, y, w) * A(y, x, w);
      if (!(squared >= 0.0)) {
        return;
      }
      frequencies.field(static_cast<int>(g))[w] = std::sqrt(squared);
    }
  }
  const std::size_t waves = waves_.count();
  grids::FieldSet of_sines(2 * frequencies.fields(), waves);
  for (std::size_t g = 0; g < waves_.groups().size(); ++g) {
    const int x = waves_.groups()[g].front(), y = waves_.groups()[g].back(), row = 2 * static_cast<int>(g);
    for (std::size_t w = 0; w < waves; ++w) {
      const double omega = std::as_const(frequencies).field(static_cast<int>(g))[w];
      of_sines.field(row)[w] = A(x, y, w) / (omega == 0.0 ? 1.0 : omega);
      of_sines.field(row + 1)[w] = A(y, x, w) / (omega == 0.0 ? 1.0 : omega);
    }
  }
  formula::Graph graph;
  const Expression angle = graph.variable("angle");
  turn_ = formula::BatchEvaluator(formula::Bytecode(std::array{cos(angle), sin(angle)}, std::array{angle}));
  frequencies_ = std::move(frequencies);
  of_sines_ = std::move(of_sines);
  at_once_ = std::clamp<std::size_t>(angles_at_once / std::max<std::size_t>(1, waves), 1, most_drifts);
  angles_ = grids::FieldSet(3, (at_once_ * waves + 7) / 8 * 8);  // whole vectors
}

void WavePropagators::fill_by_frequencies(std::span<const std::size_t> places) {
  const std::size_t waves = waves_.count();
  double* const angle = angles_.field(0).data();
  const double *const cosine = std::as_const(angles_).field(1).data(), *const sine =
                                                                           std::as_const(angles_).field(2).data();
  for (std::size_t first = 0; first < places.size(); first += at_once_) {
    const auto some = places.subspan(first, std::min(at_once_, places.size() - first));
    for (std::size_t g = 0; g < waves_.groups().size(); ++g) {
      const double* const omega = std::as_const(frequencies_).field(static_cast<int>(g)).data();
      for (std::size_t i = 0; i < some.size(); ++i) {
        rubato::multiply(propagators_[some[i]].tau, omega, waves, angle + i * waves);
      }
      const double* const in[] = {angle};
      double* const out[] = {angles_.field(1).data(), angles_.field(2).data()};
      turn_((some.size() * waves + 7) / 8 * 8, in, out);
      const int row = 2 * static_cast<int>(g);
      for (std::size_t i = 0; i < some.size(); ++i) {
        Propagator& E = propagators_[some[i]];
        const int x = waves_.groups()[g].front(), y = waves_.groups()[g].back();
        make_turns(E.tau, omega, cosine + i * waves, sine + i * waves, std::as_const(of_sines_).field(row).data(),
                   std::as_const(of_sines_).field(row + 1).data(), waves, turns(E, x, y));
      }
    }
  }
}

void WavePropagators::fill(double tau, WaveRows& entries) {
  for_each_wave_block(waves_.count(), [&](std::size_t begin, std::size_t end) {
    for (const std::vector<int>& members : waves_.groups()) {
      const auto n = static_cast<Index>(members.size());
      MatrixXcd A(n, n), E(n, n);
      for (std::size_t w = begin; w < end; ++w) {
        for (Index i = 0; i < n; ++i) {
          for (Index j = 0; j < n; ++j) {
            A(i, j) = waves_.generator(members[static_cast<std::size_t>(i)], members[static_cast<std::size_t>(j)], w);
          }
        }
        if (n == 2) {
          const Complex mean = 0.5 * (A(0, 0) + A(1, 1)), half = 0.5 * (A(0, 0) - A(1, 1));
          const Waves waves = waves_of(half * half + A(0, 1) * A(1, 0), tau);
          const Complex factor = mean == 0.0 ? 1.0 : std::exp(mean * tau);
          E(0, 0) = factor * (waves.cosine + waves.sine * half);
          E(1, 1) = factor * (waves.cosine - waves.sine * half);
          E(0, 1) = factor * waves.sine * A(0, 1);
          E(1, 0) = factor * waves.sine * A(1, 0);
        } else {
          E = solve::exponential_of(tau * A);
        }
        for (Index i = 0; i < n; ++i) {
          for (Index j = 0; j < n; ++j) {
            if (is_one_cosine_ && i == 1 && j == 1) {
              continue;
            }
            const auto row = static_cast<std::size_t>(members[static_cast<std::size_t>(i)] * waves_.size() +
                                                      members[static_cast<std::size_t>(j)]);
            entries.re.pointers()[row][w] = E(i, j).real();
            if (!waves_.has_real_pairs()) {
              entries.im.pointers()[row][w] = E(i, j).imag();
            }
          }
        }
      }
    }
  });
}

PairMatrices WavePropagators::turns(Propagator& propagator, int x, int y) const {
  const int z = is_one_cosine_ ? std::min(x, y) : y;
  const int first = is_one_cosine_ ? z : x;
  const auto entry = [&](int row, int column) {
    return propagator.entries.re.pointers()[static_cast<std::size_t>(row * waves_.size() + column)];
  };
  return {entry(first, first), entry(x, y), entry(y, x), entry(z, z),
          propagator.mended.pointers()[static_cast<std::size_t>(std::min(x, y))]};
}

void WavePropagators::make_room(Propagator& propagator) const {
  if (propagator.entries.re.fields() == 0) {
    propagator.entries.re = grids::FieldSet(waves_.size() * waves_.size(), waves_.count());
    propagator.entries.im =
        grids::FieldSet(waves_.has_real_pairs() ? 0 : waves_.size() * waves_.size(), waves_.count());
    propagator.mended = grids::FieldSet(waves_.has_real_pairs() ? waves_.size() : 0, waves_.count());
  }
}

/// Of the one for this τ, known or to be filled. None that the step under way has found is given away.
std::size_t WavePropagators::place_of(double tau) {
  const std::size_t room = propagators_.size();
  for (std::size_t back = 1; back <= room; ++back) {  // the newest first
    const std::size_t place = (replaced_ + room - back) % room;
    if (Propagator& known = propagators_[place]; known.used > 0 && are_same_bits(known.tau, tau)) {
      known.used = steps_prepared_;
      return place;
    }
  }
  std::size_t place = room, passed = 0;
  while (passed < room && propagators_[replaced_ % room].used == steps_prepared_) {
    ++replaced_;
    ++passed;
  }
  if (passed < room) {
    place = replaced_++ % room;
  } else {
    propagators_.emplace_back();
  }
  Propagator& anew = propagators_[place];
  make_room(anew);
  anew.tau = tau;
  anew.used = steps_prepared_;
  missing_.push_back(place);
  return place;
}

void WavePropagators::fill_missing() {
  if (frequencies_.fields() > 0) {
    fill_by_frequencies(missing_);
  } else {
    for (const std::size_t place : missing_) {
      Propagator& E = propagators_[place];
      fill(E.tau, E.entries);
      for (const std::vector<int>& group : waves_.groups()) {
        if (waves_.has_real_pairs() && group.size() == 2) {
          mend_turns(waves_.count(), turns(E, group.front(), group.back()));
        }
      }
    }
  }
  missing_.clear();
}

/// Products of one length with h have the same bits, be they numbers or not.
void WavePropagators::make(const Composition& composition, double h) {
  const std::size_t parts = composition.parts.size();
  bool known = of_parts_.size() == parts;
  for (std::size_t i = 0; i < parts && known; ++i) {
    const Composition::Part& part = composition.parts[i];
    known = !part.drift || are_same_bits(propagators_[of_parts_[i]].tau, part.length * h);
  }
  if (known) {
    return;
  }
  of_parts_.resize(parts);
  missing_.reserve(parts);
  ++steps_prepared_;
  for (std::size_t i = 0; i < parts; ++i) {
    const Composition::Part& part = composition.parts[i];
    of_parts_[i] = part.drift ? place_of(part.length * h) : 0;
  }
  fill_missing();
}

void WavePropagators::prepare(const Composition& composition, double h) {
  // Those of a step and, where they are short, of the one tried before it; a step looks for no others.
  propagators_.resize((waves_.count() > many_waves ? 1 : 2) * different_drifts(composition));
  for (Propagator& propagator : propagators_) {
    make_room(propagator);
  }
  of_parts_.clear();
  make(composition, h);
}

}  // namespace rubato
