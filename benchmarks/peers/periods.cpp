// Ten thousand periods of a breather and of a soliton on a ring: how far phase and shape are off, and what
// energy and charge do, by Rubato and by codes written by hand, at about equal cost. One thread.
// docs/performance-tables.md has what it prints.
//
//     build/benchmarks/benchmark_periods [periods]
#include <omp.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <memory>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "comparison.hpp"
#include "cpu_clock.hpp"

using rubato::LatticeIntegrator;
using rubato::LatticeOptions;
using rubato::Levels;
using rubato::Status;

namespace {

using Pair = std::pair<double, double>;  // u and u_t, or p and q

/// A solution that repeats, and what is conserved.
struct Periodic {
  std::string name;
  double from, length, period;
  std::size_t nodes;
  rubato::MultisymplecticSystem system;
  std::vector<int> fields;  ///< of the system: the pair
  std::vector<int> given;   ///< as InitialFields has them: 0 for none, 1 and 2 for the pair
  /// At (x, t), turned by an angle where the equation has that symmetry.
  std::function<Pair(double x, double t, double angle)> exact;
  bool turns;
  /// Energy; and charge, or 0.
  std::function<Pair(const std::vector<Pair>& values, double spacing, const std::vector<Pair>& slopes)> conserved;
};

Periodic breather() {
  const double omega = 0.5, gamma = std::sqrt(0.75);
  const auto u = [=](double x, double t) {
    return 4 * std::atan(gamma / omega * std::sin(omega * t) / std::cosh(gamma * x));
  };
  const auto u_t = [=](double x, double t) {
    const double tangent = gamma / omega * std::sin(omega * t) / std::cosh(gamma * x);
    return 4 * gamma * std::cos(omega * t) / std::cosh(gamma * x) / (1 + tangent * tangent);
  };
  return {.name = "sine-Gordon breather of frequency 1/2 on (-20, 20)",
          .from = -20,
          .length = 40,
          .period = 2 * std::numbers::pi / omega,
          .nodes = 112,
          .system = rubato::MultisymplecticSystem({"u", "v", "w"}, comparison::skew(3, {{0, 1, -1}}),
                                                  {comparison::skew(3, {{0, 2, 1}})}, "(v^2 - w^2)/2 + 1 - cos(u)"),
          .fields = {0, 1},
          .given = {1, 2, 0},
          .exact =
              [=](double x, double t, double) {
                return Pair{u(x, t), u_t(x, t)};
              },
          .turns = false,
          .conserved =
              [](const std::vector<Pair>& z, double spacing, const std::vector<Pair>& slopes) {
                double energy = 0.0;
                for (std::size_t i = 0; i < z.size(); ++i) {
                  energy +=
                      (z[i].second * z[i].second + slopes[i].first * slopes[i].first) / 2 + 1 - std::cos(z[i].first);
                }
                return Pair{spacing * energy, 0.0};
              }};
}

/// i ψ_t + ψ_xx + 2|ψ|²ψ = 0: a soliton that goes round. (Two that are bound to each other, 2 sech x, show nothing of
/// schemes: whatever is off grows with the square and the cube of time, and that of the grid is the first to show.)
Periodic travelling_soliton() {
  const double length = 30, c = 2 * std::numbers::pi * 5 / length, velocity = 2 * c;
  const auto psi = [=](double x, double t) {
    const double y = std::remainder(x - velocity * t, length);
    return std::polar(1 / std::cosh(y), c * x + (1 - c * c) * t);
  };
  return {.name = "Schroedinger soliton that goes round a ring of length 30",
          .from = -15,
          .length = length,
          .period = length / velocity,
          .nodes = 112,
          .system = rubato::MultisymplecticSystem({"p", "q", "v", "w"}, comparison::skew(4, {{0, 1, 1}}),
                                                  {comparison::skew(4, {{0, 2, -1}, {1, 3, -1}})},
                                                  "(v^2 + w^2)/2 + (p^2 + q^2)^2/2"),
          .fields = {0, 1},
          .given = {1, 2, 0, 0},
          .exact =
              [=](double x, double t, double angle) {
                const peers::Complex value = psi(x, t) * std::polar(1.0, angle);
                return Pair{value.real(), value.imag()};
              },
          .turns = true,
          .conserved =
              [](const std::vector<Pair>& z, double spacing, const std::vector<Pair>& slopes) {
                double energy = 0.0, charge = 0.0;
                for (std::size_t i = 0; i < z.size(); ++i) {
                  const double square = z[i].first * z[i].first + z[i].second * z[i].second;
                  energy += slopes[i].first * slopes[i].first + slopes[i].second * slopes[i].second - square * square;
                  charge += square;
                }
                return Pair{spacing * energy, spacing * charge};
              }};
}

double node(const Periodic& problem, std::size_t i) {
  return problem.from + problem.length * static_cast<double>(i) / static_cast<double>(problem.nodes);
}

std::vector<Pair> derivative(const Periodic& problem, const std::vector<Pair>& values) {
  const std::size_t n = values.size();
  const peers::Line line{problem.from, problem.length, n};
  peers::ComplexTransform transform(n);
  for (std::size_t i = 0; i < n; ++i) {
    transform.x[i] = {values[i].first, values[i].second};
  }
  peers::Modes modes(n);
  transform.forward(modes);
  for (std::size_t k = 0; k < n; ++k) {
    modes[k] *= peers::Complex(0.0, line.wave(k) / static_cast<double>(n));
  }
  transform.inverse(modes);
  std::vector<Pair> slopes;
  for (std::size_t i = 0; i < n; ++i) {
    slopes.emplace_back(transform.x[i].real(), transform.x[i].imag());
  }
  return slopes;
}

/// What a run has come to.
struct Sample {
  double t = 0.0;
  std::vector<Pair> values;
};

/// Phase and angle that bring the exact solution nearest, by least squares from those of the sample before.
class Fit {
public:
  explicit Fit(const Periodic& problem) : problem_(problem) {}
  /// \return the largest difference that is left
  double operator()(const Sample& sample) {
    constexpr double small = 1e-5;
    double largest = 0.0;
    for (int pass = 0; pass < 12; ++pass) {
      double a = 0.0, b = 0.0, c = 0.0, f = 0.0, g = 0.0;
      largest = 0.0;
      for (std::size_t i = 0; i < sample.values.size(); ++i) {
        const double x = node(problem_, i);
        const auto at = [&](double shift, double turn) {
          return problem_.exact(x, sample.t + delay + shift, angle + turn);
        };
        const Pair now = at(0, 0), later = at(small, 0), sooner = at(-small, 0), left = at(0, small),
                   right = at(0, -small);
        const double away[] = {sample.values[i].first - now.first, sample.values[i].second - now.second};
        const double of_time[] = {(later.first - sooner.first) / (2 * small),
                                  (later.second - sooner.second) / (2 * small)};
        const double of_angle[] = {(left.first - right.first) / (2 * small),
                                   (left.second - right.second) / (2 * small)};
        for (int e = 0; e < 2; ++e) {
          a += of_time[e] * of_time[e];
          b += of_time[e] * of_angle[e];
          c += of_angle[e] * of_angle[e];
          f += of_time[e] * away[e];
          g += of_angle[e] * away[e];
        }
        largest = std::max(largest, std::hypot(away[0], away[1]));
      }
      const double determinant = problem_.turns ? a * c - b * b : a;
      delay += problem_.turns ? (c * f - b * g) / determinant : f / a;
      angle += problem_.turns ? (a * g - b * f) / determinant : 0.0;
    }
    return largest;
  }
  double delay = 0.0, angle = 0.0;

private:
  const Periodic& problem_;
};

/// Goes on to about a time. False: it cannot.
using Runner = std::function<bool(double until, Sample& sample)>;

void print_row(const Periodic& problem, int periods, const std::string& name, const std::string& steps,
               const Runner& run) {
  constexpr int samples = 400;
  Fit fit(problem);
  Sample sample;
  std::vector<double> energies, charges;
  double shape = 0.0, seconds = 0.0;
  const auto observe = [&] {
    const double spacing = problem.length / static_cast<double>(problem.nodes);
    const auto [energy, charge] = problem.conserved(sample.values, spacing, derivative(problem, sample.values));
    energies.push_back(energy);
    charges.push_back(charge);
  };
  for (std::size_t i = 0; i < problem.nodes; ++i) {
    sample.values.push_back(problem.exact(node(problem, i), 0.0, 0.0));
  }
  observe();
  for (int s = 1; s <= samples; ++s) {
    const double begin = peers::cpu_seconds();
    if (!run(problem.period * periods * s / samples, sample) || !std::isfinite(sample.values.front().first)) {
      std::printf("| %-30s | %9s | ended at %.0f periods |\n", name.c_str(), steps.c_str(), sample.t / problem.period);
      return;
    }
    seconds += peers::cpu_seconds() - begin;
    shape = fit(sample);
    observe();
  }
  const auto away = [](const std::vector<double>& values) {
    double largest = 0.0;
    for (const double value : values) {
      largest = std::max(largest, std::abs(value - values.front()));
    }
    return largest / std::abs(values.front());
  };
  const auto mean = [](auto from, auto to) {
    double sum = 0.0;
    for (auto at = from; at != to; ++at) {
      sum += *at;
    }
    return sum / static_cast<double>(to - from);
  };
  const auto eighth = static_cast<std::ptrdiff_t>(energies.size() / 8);
  const double drift =
      (mean(energies.end() - eighth, energies.end()) - mean(energies.begin(), energies.begin() + eighth)) /
      std::abs(energies.front());
  std::printf("| %-30s | %9s | %7.1f | %9.1e | %8.1e | %8.1e | %9.1e |", name.c_str(), steps.c_str(), seconds,
              fit.delay / problem.period, shape, away(energies), drift);
  if (charges.front() != 0.0) {
    std::printf(" %7.1e |", away(charges));
  }
  std::printf("\n");
  std::fflush(stdout);
}

void peer_row(const Periodic& problem, int periods, const std::string& name, int steps,
              std::unique_ptr<peers::Peer> peer) {
  peer->stand([&](double x) { return problem.exact(x, 0, 0).first; },
              [&](double x) { return problem.exact(x, 0, 0).second; });
  int periods_done = 0;
  print_row(problem, periods, name + ", by hand", std::to_string(steps), [&](double until, Sample& sample) {
    const int whole = static_cast<int>(std::lround(until / problem.period));
    peer->go((whole - periods_done) * problem.period, (whole - periods_done) * steps);
    periods_done = whole;
    sample.t = whole * problem.period;
    const peers::Series first = peer->solution(), second = problem.turns ? first : peer->rate();
    for (std::size_t i = 0; i < problem.nodes; ++i) {
      const peers::Complex a = first(node(problem, i));
      sample.values[i] = {a.real(), problem.turns ? a.imag() : second(node(problem, i)).real()};
    }
    return true;
  });
}

void our_row(const Periodic& problem, int periods, int steps, LatticeOptions options, Levels levels) {
  options.levels = levels;
  options.step = problem.period / steps;
  options.until = problem.period * periods;
  rubato::InitialFields initial;
  for (const int which : problem.given) {
    if (which == 0) {
      initial.emplace_back(std::nullopt);
      continue;
    }
    std::vector<double> values;
    for (std::size_t i = 0; i < problem.nodes; ++i) {
      const Pair pair = problem.exact(node(problem, i), 0, 0);
      values.push_back(which == 1 ? pair.first : pair.second);
    }
    initial.emplace_back(std::move(values));
  }
  LatticeIntegrator lattice(problem.system,
                            rubato::grids::Grid({{"x", problem.from, problem.from + problem.length, problem.nodes}}),
                            initial, options);
  const std::string scheme =
      options.lagrangian == "splitting" ? options.composition : "Gauss " + std::to_string(options.stages);
  const auto run = [&](double until, Sample& sample) {
    while (!lattice.finished() && lattice.t() < until - 0.5 * options.step) {
      if (lattice.step().status != Status::success) {
        return false;
      }
    }
    sample.t = lattice.t();
    const auto a = lattice.field(problem.fields[0]), b = lattice.field(problem.fields[1]);
    for (std::size_t i = 0; i < problem.nodes; ++i) {
      sample.values[i] = {a[i], b[i]};
    }
    return true;
  };
  print_row(problem, periods, scheme + (levels == Levels::fixed ? ", equal steps" : ", levels"),
            (levels == Levels::fixed ? "" : "~") + std::to_string(steps), run);
}

void print_head(const Periodic& problem, int periods) {
  std::printf(
      "\n%s, %d periods\n\n| scheme | steps a period | CPU s | phase / period | shape | energy, most | energy, drift "
      "|%s\n"
      "|---|---|---|---|---|---|---|%s\n",
      problem.name.c_str(), periods, problem.turns ? " charge |" : "", problem.turns ? "---|" : "");
}

}  // namespace

int main(int argc, char** argv) {
  omp_set_num_threads(1);
  const int periods = argc > 1 ? std::max(400, std::atoi(argv[1]) / 400 * 400) : 10000;
  {
    const Periodic problem = breather();
    print_head(problem, periods);
    const peers::Line line{problem.from, problem.length, problem.nodes};
    for (const auto& [name, steps] : {std::pair{"verlet", 384}, {"blanes-moan-4", 64}, {"kahan-li-8", 24}}) {
      peer_row(problem, periods, name, steps, peers::waves_and_kicks(line, peers::Rest::sine, name));
    }
    our_row(problem, periods, 64, comparison::splitting("blanes-moan-4"), Levels::fixed);
    our_row(problem, periods, 24, comparison::splitting("kahan-li-8"), Levels::fixed);
    our_row(problem, periods, 24, comparison::splitting("blanes-moan-4"), Levels::variable);
    our_row(problem, periods, 12, comparison::splitting("kahan-li-8"), Levels::variable);
  }
  {
    const Periodic problem = travelling_soliton();
    print_head(problem, periods);
    const peers::Line line{problem.from, problem.length, problem.nodes};
    for (const auto& [name, steps] : {std::pair{"blanes-moan-4", 640}, {"kahan-li-8", 240}}) {
      peer_row(problem, periods, name, steps, peers::split_step(line, 2.0, name));
    }
    for (const auto& [name, steps] : {std::pair{"ETDRK4", 640}, {"IFDOP853", 240}}) {
      peer_row(problem, periods, name, steps, peers::schroedinger(line, 2.0, name));
    }
    our_row(problem, periods, 640, comparison::splitting("blanes-moan-4"), Levels::fixed);
    our_row(problem, periods, 240, comparison::splitting("kahan-li-8"), Levels::fixed);
    our_row(problem, periods, 240, comparison::splitting("blanes-moan-4"), Levels::variable);
    our_row(problem, periods, 120, comparison::splitting("kahan-li-8"), Levels::variable);
  }
}
