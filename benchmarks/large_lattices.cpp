// Lattices of millions of cells: a step of `rubato run`, as the difference of two runs that differ in their number of
// steps alone, beside a loop or an FFTW code by hand for that equation and scheme, and beside the memory's bandwidth.
// Prints tables of medians; docs/performance-tables.md has them.
//
//     build/benchmarks/benchmark_large_lattices build/rubato directory-for-records [repeats [nodes-3D [nodes-2D]]]
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <string>
#include <vector>

#include <fmt/format.h>

#include "peers/large.hpp"
#include "processes.hpp"

namespace {

using namespace processes;
using peers::Pace, peers::Torus;

constexpr double step = 0.02;

/// The problem of a code by hand, as users write it.
std::string problem_file(const std::string& directory, const std::string& name, const Torus& torus, bool schroedinger) {
  const char* const axes[] = {"x", "y", "z"};
  std::string laplace, grid, initial = "0.5";
  for (int a = 0; a < torus.dimensions; ++a) {
    laplace += fmt::format(" + {0}_{1}{1}", schroedinger ? "psi" : "u", axes[a]);
    grid += fmt::format("{} = {{ from = 0, to = {}, cells = {} }}\n", axes[a], torus.length, torus.nodes);
    initial += fmt::format("*cos(2*pi*{}/{})", axes[a], torus.length);
  }
  const std::string path = directory + "/" + name + ".toml";
  std::ofstream(path) << fmt::format(
      "title = \"{}\"\n[field]\nequation = \"{}\"\n[grid]\n{}[initial]\n{}\n[scheme]\nlevels = \"fixed\"\nstep = {}\n"
      "[output]\nstates = false\n[laws]\nevery = false\n",
      name,
      schroedinger ? fmt::format("i*psi_t{} - abs2(psi)*psi = 0", laplace)
                   : fmt::format("u_tt = {} - u - u^3", laplace.substr(3)),
      grid, schroedinger ? fmt::format("psi = \"{}\"", initial) : fmt::format("u = \"{}\"\nu_t = 0", initial), step);
  return path;
}

struct Row {
  const char* label;
  std::string problem;
  Torus torus;
  std::vector<std::string> settings;
  int few, many;  ///< steps of the two runs
  std::function<Pace(int steps)> by_hand;
};

/// Of one step, and of the start with the record.
struct Step {
  double cpu, wall, start, memory;
};

Step step_of(const Program& program, const Row& row, const std::vector<std::string>& more, int threads) {
  const auto run = [&](int steps) {
    std::vector<std::string> settings = row.settings;
    settings.push_back(fmt::format("scheme.until={}", step * steps));
    return program.run(with(row.problem, settings, more), threads);
  };
  const Cost few = run(row.few), many = run(row.many);
  const int steps = row.many - row.few;
  const double cpu = (many.cpu - few.cpu) / steps;
  return {cpu, (many.wall - few.wall) / steps, few.cpu - row.few * cpu, many.memory};
}

double median_of(const std::vector<Step>& steps, double Step::*part) {
  std::vector<double> values;
  for (const Step& one : steps) {
    values.push_back(one.*part);
  }
  return median(values);
}

void beside_loops(const Program& program, const std::vector<Row>& rows, int repeats) {
  fmt::print(
      "\n| one thread | ns a cell and step by hand | `rubato run` | bytes a cell | start, steps | / by hand |\n"
      "|---|---|---|---|---|---|\n");
  for (const Row& row : rows) {
    std::vector<Step> ours;
    std::vector<double> theirs;
    for (int turn = 0; turn < repeats; ++turn) {
      if (row.by_hand) {
        theirs.push_back(row.by_hand(row.many).cpu);
      }
      ours.push_back(step_of(program, row, {}, 1));
    }
    const double cells = static_cast<double>(row.torus.size()), cpu = median_of(ours, &Step::cpu);
    fmt::print("| {} | {} | {:.2f} | {:.0f} | {:.1f} | {} |\n", row.label,
               theirs.empty() ? "" : fmt::format("{:.2f}", 1e9 * median(theirs) / cells), 1e9 * cpu / cells,
               1e6 * median_of(ours, &Step::memory) / cells, median_of(ours, &Step::start) / cpu,
               theirs.empty() ? "" : fmt::format("**{:.2f}**", cpu / median(theirs)));
    std::fflush(stdout);
  }
}

void laws(const Program& program, const std::vector<Row>& rows, int repeats) {
  fmt::print(
      "\n| one thread | ns a cell and step | with all local laws at every level | / without |\n|---|---|---|---|\n");
  for (const Row& row : rows) {
    std::vector<Step> without, with_laws;
    for (int turn = 0; turn < repeats; ++turn) {
      without.push_back(step_of(program, row, {}, 1));
      with_laws.push_back(step_of(program, row, {"laws.every=1"}, 1));
    }
    const double cells = static_cast<double>(row.torus.size());
    const double a = median_of(without, &Step::cpu), b = median_of(with_laws, &Step::cpu);
    fmt::print("| {} | {:.2f} | {:.2f} | **{:.2f}** |\n", row.label, 1e9 * a / cells, 1e9 * b / cells, b / a);
    std::fflush(stdout);
  }
}

/// Of a step that moves 32 bytes a cell: three arrays, one of them read before it is written.
void threads(const Program& program, const std::vector<Row>& rows, int repeats) {
  constexpr double bytes = 32.0;
  fmt::print(
      "\n| `leapfrog`, by the clock | triad, GB/s | by hand, ns a cell | `rubato run` | of the triad | gain by hand | "
      "gain |\n|---|---|---|---|---|---|---|\n");
  for (const Row& row : rows) {
    std::vector<double> theirs[2];
    std::vector<Step> ours[2];
    for (int turn = 0; turn < repeats; ++turn) {
      for (const int count : {1, 2}) {
        theirs[count - 1].push_back(peers::leapfrog(row.torus, step, row.many, count).wall);
        ours[count - 1].push_back(step_of(program, row, {}, count));
      }
    }
    const double cells = static_cast<double>(row.torus.size());
    for (const int count : {1, 2}) {
      const double hand = median(theirs[count - 1]), wall = median_of(ours[count - 1], &Step::wall);
      const double bandwidth = peers::triad_bandwidth(count);
      fmt::print("| {}, {} | {:.1f} | {:.2f} | {:.2f} | {:.0f} % | {:.2f} | **{:.2f}** |\n", row.label,
                 count == 1 ? "one thread" : "two threads", 1e-9 * bandwidth, 1e9 * hand / cells, 1e9 * wall / cells,
                 100.0 * bytes * cells / wall / bandwidth, median(theirs[0]) / hand,
                 median_of(ours[0], &Step::wall) / wall);
    }
    std::fflush(stdout);
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) {
    fmt::print(stderr, "benchmark_large_lattices rubato directory-for-records [repeats [nodes-3D [nodes-2D]]]\n");
    return 2;
  }
  const std::string directory = argv[2];
  const Program program(argv[1], directory);
  const int repeats = argc > 3 ? std::max(1, std::atoi(argv[3])) : 3;
  const auto nodes = [&](int place, int otherwise) {
    return static_cast<std::size_t>(argc > place ? std::max(4, std::atoi(argv[place])) : otherwise);
  };
  // Stable for the leapfrog: h < dx/√d.
  const std::size_t n3 = nodes(4, 192), n2 = nodes(5, 3000);
  const Torus volume{3, n3, 0.1 * static_cast<double>(n3)}, plane{2, n2, 0.1 * static_cast<double>(n2)};
  const Torus small_plane{2, n2 / 3, 0.1 * static_cast<double>(n2 / 3)};
  const std::string wave3 = problem_file(directory, "waves in a volume", volume, false),
                    wave2 = problem_file(directory, "waves in a plane", plane, false),
                    nls3 = problem_file(directory, "Schroedinger in a volume", volume, true),
                    nls2 = problem_file(directory, "Schroedinger in a plane", small_plane, true),
                    small_wave2 = problem_file(directory, "waves in a small plane", small_plane, false);

  const auto loop = [](const Torus& torus) {
    return [torus](int steps) { return peers::leapfrog(torus, step, steps); };
  };
  const std::string order4 = "blanes-moan-4";
  const auto splitting = [&](bool differences) {
    return std::vector<std::string>{"scheme.lagrangian=splitting", "scheme.composition=" + order4,
                                    fmt::format("scheme.space={}", differences ? "differences" : "fourier")};
  };
  const auto waves = [&](const Torus& torus, bool differences) {
    return [=](int steps) { return peers::waves_and_kicks(torus, order4, differences, step, steps); };
  };
  const auto turns = [&](const Torus& torus) {
    return [=](int steps) { return peers::split_step(torus, order4, step, steps); };
  };
  const std::vector<std::string> leapfrog = {"scheme.lagrangian=leapfrog"}, euler_box = {"scheme.lagrangian=euler-box"};
  const std::vector<Row> explicit_rows = {{"`leapfrog`, volume", wave3, volume, leapfrog, 20, 120, loop(volume)},
                                          {"`leapfrog`, plane", wave2, plane, leapfrog, 20, 120, loop(plane)},
                                          {"`euler-box`, volume", wave3, volume, euler_box, 20, 120, loop(volume)},
                                          {"`euler-box`, plane", wave2, plane, euler_box, 20, 120, loop(plane)}};
  std::vector<Row> rows = explicit_rows;
  for (const Row& row : std::vector<Row>{
           {"`splitting`, differences, volume", wave3, volume, splitting(true), 2, 8, waves(volume, true)},
           {"the same beside drifts and kicks by differences", wave3, volume, splitting(true), 2, 8,
            [=](int steps) { return peers::drifts_and_kicks(volume, order4, step, steps); }},
           {"`splitting`, differences, small plane", small_wave2, small_plane, splitting(true), 5, 25,
            waves(small_plane, true)},
           {"`splitting`, spectral, volume", wave3, volume, splitting(false), 2, 8, waves(volume, false)},
           {"`splitting`, spectral, small plane", small_wave2, small_plane, splitting(false), 5, 25,
            waves(small_plane, false)},
           {"`splitting`, Schrödinger, volume", nls3, volume, splitting(false), 2, 8, turns(volume)},
           {"`splitting`, Schrödinger, small plane", nls2, small_plane, splitting(false), 5, 25, turns(small_plane)},
           {"`fourier`, one stage, small plane", small_wave2, small_plane, {"scheme.lagrangian=fourier"}, 3, 13, {}},
           {"`fourier`, two stages, small plane",
            small_wave2,
            small_plane,
            {"scheme.lagrangian=fourier", "scheme.stages=2"},
            3,
            13,
            {}}}) {
    rows.push_back(row);
  }
  fmt::print(
      "volume: {0}³, plane: {1}², small plane: {2}² nodes; u_tt = Δu - u - u³, i ψ_t + Δψ - |ψ|²ψ = 0; fixed levels\n",
      n3, n2, n2 / 3);
  beside_loops(program, rows, repeats);
  laws(program, explicit_rows, repeats);
  threads(program, {explicit_rows[0], explicit_rows[1]}, repeats);
}
