// What a level of second order costs: of `fourier` beside a pseudospectral code by hand, of the schemes on cells beside
// a leapfrog by hand, each with its own step and none with local laws.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "comparison.hpp"
#include "equations.hpp"

namespace comparison {

namespace {

constexpr int levels = 2000;

/// Microseconds a level of Rubato's, without the first step, which has what is done once; NaN where one fails, or where
/// the scheme does not have such levels.
double microseconds(const Problem& problem, std::size_t nodes, rubato::LatticeOptions options, double h,
                    rubato::Levels kind) {
  if (kind == rubato::Levels::variable && options.lagrangian == "euler-box") {
    return std::numeric_limits<double>::quiet_NaN();
  }
  options.levels = kind;
  options.step = h;
  options.until = 1e9;
  rubato::LatticeIntegrator lattice(problem.system, problem.grid(nodes), problem.initial(nodes), options);
  double start = 0.0;
  for (int k = 0; k <= levels; ++k) {
    if (lattice.step().status != rubato::Status::success) {
      return std::numeric_limits<double>::quiet_NaN();
    }
    if (k == 0) {
      start = peers::cpu_seconds();
    }
  }
  return 1e6 * (peers::cpu_seconds() - start) / levels;
}

double median(std::vector<double> values) {
  std::ranges::sort(values);
  return values[values.size() / 2];
}

rubato::LatticeOptions named(const std::string& scheme) {
  rubato::LatticeOptions options;
  options.lagrangian = scheme;
  return options;
}

struct Row {
  std::string by_hand, ours;
  std::function<double()> peer, fixed, variable;
};

}  // namespace

void second_order(int repeats) {
  const Problem breather = sine_gordon_breather(), soliton = schroedinger_soliton();
  std::vector<Row> rows;
  const auto add = [&](const Problem& problem, std::size_t nodes, double h, const std::string& by_hand,
                       const std::string& scheme, const std::function<double()>& peer) {
    const auto of = [&problem, nodes, h, scheme](rubato::Levels kind) {
      return [&problem, nodes, h, scheme, kind] { return microseconds(problem, nodes, named(scheme), h, kind); };
    };
    rows.push_back(
        {by_hand,
         problem.name + ", " + scheme + ", " + std::to_string(nodes) + " nodes, h = " + std::to_string(h).substr(0, 5),
         peer, of(rubato::Levels::fixed), of(rubato::Levels::variable)});
  };
  const auto code = [](const Problem& problem, double h, std::unique_ptr<peers::Peer> own) {
    return [&problem, h, peer = std::shared_ptr<peers::Peer>(std::move(own))] {
      peer->stand(problem.first, problem.second);
      return 1e6 * peer->go(h * levels, levels) / levels;
    };
  };
  constexpr std::size_t modes = 256, cells = 4001;
  add(breather, modes, 0.05, "Verlet", "fourier",
      code(breather, 0.05, peers::waves_and_kicks(breather.line(modes), peers::Rest::sine, "verlet")));
  add(breather, modes, 0.05, "Verlet", "splitting",
      code(breather, 0.05, peers::waves_and_kicks(breather.line(modes), peers::Rest::sine, "verlet")));
  add(soliton, modes, 0.01, "split step", "fourier",
      code(soliton, 0.01, peers::split_step(soliton.line(modes), 2.0, "verlet")));
  add(soliton, modes, 0.01, "split step", "splitting",
      code(soliton, 0.01, peers::split_step(soliton.line(modes), 2.0, "verlet")));
  const auto leapfrog = [&breather] {
    peers::Nodes end;
    return 1e6 * peers::leapfrog(breather.line(cells), breather.first, breather.second, 0.005, levels, end) / levels;
  };
  for (const char* scheme : {"euler-box", "leapfrog"}) {
    add(breather, cells, 0.005, "leapfrog", scheme, leapfrog);
  }
  std::printf(
      "\n| a level | by hand, µs | fixed levels, µs | variable levels, µs | fixed | variable |\n"
      "|---|---|---|---|---|---|\n");
  for (const Row& row : rows) {
    std::vector<double> by_hand, fixed, variable;
    for (int i = 0; i < repeats; ++i) {
      by_hand.push_back(row.peer());
      fixed.push_back(row.fixed());
      variable.push_back(row.variable());
    }
    const double peer = median(by_hand), one = median(fixed), other = median(variable);
    std::printf("| %s, beside %s | %.2f | %.2f | %.2f | **%.1f** | **%.1f** |\n", row.ours.c_str(), row.by_hand.c_str(),
                peer, one, other, one / peer, other / peer);
  }
}

}  // namespace comparison
