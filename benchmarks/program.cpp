// What a run of the program costs beside its steps: starting, local laws at every level, storing every level, beside
// HDF5 alone; orbits beside loops by hand; and two threads where something else uses a processor. Prints tables of
// medians; docs/performance-tables.md has them.
//
//     build/benchmarks/benchmark_program build/rubato directory-for-records [repeats]
#include <hdf5.h>
#include <sched.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <iterator>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "peers/orbits/loop.hpp"
#include "processes.hpp"

namespace {

using namespace processes;

const std::string store_none = "output.every=1000000000", store_all = "output.every=1";

void starting(const Program& program, int repeats) {
  const auto costs = in_turns(repeats, {[&] { return program.run(with("pendulum", {"scheme.until=1"}, {})); },
                                        [&] { return program.run(with("sine-gordon", {"scheme.until=0.1"}, {})); }});
  fmt::print("\n| start, a few steps, a record | ms by the clock |\n|---|---|\n");
  fmt::print("| `pendulum` to t = 1 | {:.1f} |\n| `sine-gordon`, 401 cells, to t = 0.1 | {:.1f} |\n",
             1e3 * costs[0].wall, 1e3 * costs[1].wall);
}

void laws_and_records(const Program& program, int repeats) {
  struct Lattice {
    const char* label;
    std::vector<std::string> settings;
  };
  const Lattice lattices[] = {
      {"`box`, 401 cells, 4000 levels", {"scheme.until=200"}},
      {"`box`, 100 001 cells, 100 levels", {"grid.x.cells=100001", "scheme.step=2e-4", "scheme.until=0.02"}},
      {"`euler-box`, 4001 cells, 4000 levels",
       {"scheme.lagrangian=euler-box", "grid.x.cells=4001", "scheme.step=0.005", "scheme.until=20"}},
      {"`leapfrog`, 4001 cells, 4000 levels",
       {"scheme.lagrangian=leapfrog", "grid.x.cells=4001", "scheme.step=0.005", "scheme.until=20"}},
      {"`fourier`, 4 stages, 128 nodes, 400 levels",
       {"scheme.lagrangian=fourier", "scheme.stages=4", "grid.x.cells=128", "scheme.step=0.5", "scheme.until=200"}},
      {"`splitting`, order 4, 128 nodes, 4000 levels",
       {"scheme.lagrangian=splitting", "scheme.order=4", "grid.x.cells=128", "scheme.until=200"}}};
  fmt::print(
      "\n| sine-Gordon, fixed levels | CPU ms, no laws | with laws | and every level stored | MB | laws | storing |\n"
      "|---|---|---|---|---|---|---|\n");
  for (const auto& [label, settings] : lattices) {
    const auto run = [&](const std::vector<std::string>& more) {
      std::vector<std::string> all = settings;
      all.push_back("scheme.levels=fixed");
      return program.run(with("sine-gordon", all, more));
    };
    const auto costs = in_turns(repeats, {[&] {
                                            return run({"laws.every=false", store_none});
                                          },
                                          [&] {
                                            return run({"laws.every=1", store_none});
                                          },
                                          [&] {
                                            return run({"laws.every=1", store_all});
                                          }});
    fmt::print("| {} | {:.0f} | {:.0f} | {:.0f} | {:.0f} | **{:.2f}** | **{:.2f}** |\n", label, 1e3 * costs[0].cpu,
               1e3 * costs[1].cpu, 1e3 * costs[2].cpu, costs[2].megabytes, costs[1].cpu / costs[0].cpu,
               costs[2].cpu / costs[1].cpu);
  }
  fmt::print("\n| pendulum | CPU ms, two states stored | every level stored | MB | storing |\n|---|---|---|---|---|\n");
  const std::vector<std::string> orbit = {"scheme.step=0.1", "scheme.until=50000"};
  for (const auto& [label, scheme] :
       {std::pair<const char*, std::vector<std::string>>{"midpoint, fixed levels, 500 000 steps",
                                                         {"scheme.levels=fixed"}},
        {"midpoint, variable levels", {}},
        {"Gauss, 3 stages, fixed levels", {"scheme.lagrangian=gauss", "scheme.stages=3", "scheme.levels=fixed"}}}) {
    const auto run = [&](const std::string& every) {
      std::vector<std::string> all = scheme;
      all.push_back(every);
      return program.run(with("pendulum", orbit, all));
    };
    const auto costs = in_turns(repeats, {[&] { return run(store_none); }, [&] { return run(store_all); }});
    fmt::print("| {} | {:.0f} | {:.0f} | {:.0f} | **{:.2f}** |\n", label, 1e3 * costs[0].cpu, 1e3 * costs[1].cpu,
               costs[1].megabytes, costs[1].cpu / costs[0].cpu);
  }
}

/// Datasets of rows, written one row after the other, each a chunk: what HDF5 alone takes.
int write_plainly(const std::string& path, hsize_t rows, hsize_t cells, int datasets) {
  const std::vector<double> row(cells, 1.25);
  const hid_t access = H5Pcreate(H5P_FILE_ACCESS);
  H5Pset_libver_bounds(access, H5F_LIBVER_V110, H5F_LIBVER_LATEST);
  const hid_t file = H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, access);
  const hsize_t none[2] = {0, cells}, most[2] = {H5S_UNLIMITED, cells}, chunk[2] = {1, cells};
  const hid_t space = H5Screate_simple(2, none, most), kind = H5Pcreate(H5P_DATASET_CREATE);
  H5Pset_chunk(kind, 2, chunk);
  std::vector<hid_t> all;
  for (int i = 0; i < datasets; ++i) {
    all.push_back(
        H5Dcreate2(file, fmt::format("d{}", i).c_str(), H5T_NATIVE_DOUBLE, space, H5P_DEFAULT, kind, H5P_DEFAULT));
  }
  const hid_t memory = H5Screate_simple(2, chunk, nullptr);
  bool good = file >= 0;
  for (hsize_t r = 0; r < rows; ++r) {
    for (const hid_t dataset : all) {
      const hsize_t size[2] = {r + 1, cells}, from[2] = {r, 0};
      good = good && H5Dset_extent(dataset, size) >= 0;
      const hid_t there = H5Dget_space(dataset);
      H5Sselect_hyperslab(there, H5S_SELECT_SET, from, nullptr, chunk, nullptr);
      good = good && H5Dwrite(dataset, H5T_NATIVE_DOUBLE, memory, there, H5P_DEFAULT, row.data()) >= 0;
      H5Sclose(there);
    }
  }
  for (const hid_t dataset : all) {
    H5Dclose(dataset);
  }
  H5Sclose(memory);
  H5Pclose(kind);
  H5Sclose(space);
  H5Pclose(access);
  return good && H5Fclose(file) >= 0 ? 0 : 1;
}

void beside_plain_hdf5(const Program& program, int repeats) {
  constexpr hsize_t rows = 101, cells = 100'001;
  constexpr int datasets = 6;
  const double megabytes = 1e-6 * 8.0 * static_cast<double>(rows * cells) * datasets;
  const auto plainly = [&] {
    return measured(true, [&] { return write_plainly(program.record(), rows, cells, datasets); });
  };
  const auto run = [&](const std::string& every) {
    return [&, every] {
      return program.run(
          with("sine-gordon",
               {"grid.x.cells=100001", "scheme.step=2e-4", "scheme.until=0.02", "scheme.levels=fixed", "laws.every=1"},
               {every}));
    };
  };
  const auto costs = in_turns(repeats, {plainly, run(store_none), run(store_all)});
  std::filesystem::remove(program.record());
  const double stored = costs[2].megabytes - costs[1].megabytes, seconds = costs[2].cpu - costs[1].cpu;
  fmt::print("\n| 10⁵ cells | MB a CPU second |\n|---|---|\n");
  fmt::print("| HDF5 alone, {:.0f} MB | {:.0f} |\n", megabytes, megabytes / costs[0].cpu);
  fmt::print("| `rubato run`, {:.0f} MB more by storing every level | {:.0f} |\n", stored, stored / seconds);
}

/// Orbits of a million steps by a loop for that system and scheme, and by runs.
void beside_loops(const Program& program, int repeats) {
  constexpr long steps = 1'000'000;
  struct Orbit {
    const char *problem, *scheme;
    double step;
    std::function<bool()> by_hand;
    std::vector<std::string> settings;
  };
  using Kepler = orbits::Kepler<600>;
  using orbits::HenonHeiles;
  constexpr double short_step = 0.02, long_step = 0.1;
  const auto splitting = [](const char* problem, double step, std::function<bool()> by_hand) {
    return Orbit{problem,
                 "Blanes and Moan, order 4",
                 step,
                 std::move(by_hand),
                 {"scheme.lagrangian=splitting", "scheme.composition=blanes-moan-4"}};
  };
  const auto gauss = [](const char* problem, int stages, double step, std::function<bool()> by_hand) {
    return Orbit{problem,
                 stages == 3 ? "Gauss, 3 stages" : "Gauss, 4 stages",
                 step,
                 std::move(by_hand),
                 {"scheme.lagrangian=gauss", fmt::format("scheme.stages={}", stages)}};
  };
  const Orbit all[] = {
      splitting("kepler", short_step, [] { return orbits::split<Kepler>(steps, short_step); }),
      splitting("henon-heiles", long_step, [] { return orbits::split<HenonHeiles>(steps, long_step); }),
      gauss("kepler", 3, short_step, [] { return orbits::collocate<Kepler, 3>(steps, short_step); }),
      gauss("henon-heiles", 3, long_step, [] { return orbits::collocate<HenonHeiles, 3>(steps, long_step); }),
      gauss("kepler", 4, short_step, [] { return orbits::collocate<Kepler, 4>(steps, short_step); }),
      gauss("henon-heiles", 4, long_step, [] { return orbits::collocate<HenonHeiles, 4>(steps, long_step); })};
  fmt::print(
      "\n| 10⁶ steps | CPU ms by hand | fixed levels | every level stored | variable levels | / by hand | stored / by "
      "hand | variable / fixed |\n|---|---|---|---|---|---|---|---|\n");
  for (const Orbit& orbit : all) {
    const auto run = [&](const std::string& levels, const std::string& store) {
      std::vector<std::string> settings = orbit.settings;
      settings.insert(settings.end(), {"scheme.levels=" + levels, fmt::format("scheme.step={}", orbit.step),
                                       fmt::format("scheme.until={}", orbit.step * steps), store});
      return program.run(with(orbit.problem, settings, {}));
    };
    const auto costs =
        in_turns(repeats, {[&] { return measured(true, [&] { return orbit.by_hand() ? 0 : 1; }); },
                           [&] { return run("fixed", store_none); }, [&] { return run("fixed", store_all); },
                           [&] { return run("variable", store_none); }});
    fmt::print("| {}, {} | {:.0f} | {:.0f} | {:.0f} | {:.0f} | **{:.2f}** | **{:.2f}** | **{:.2f}** |\n", orbit.problem,
               orbit.scheme, 1e3 * costs[0].cpu, 1e3 * costs[1].cpu, 1e3 * costs[2].cpu, 1e3 * costs[3].cpu,
               costs[1].cpu / costs[0].cpu, costs[2].cpu / costs[0].cpu, costs[3].cpu / costs[1].cpu);
  }
}

void threads_beside_others(const Program& program, int repeats) {
  const pid_t busy = fork();
  if (busy == 0) {
    cpu_set_t set;
    CPU_ZERO(&set);
    CPU_SET(1, &set);
    sched_setaffinity(0, sizeof set, &set);
    [[maybe_unused]] const int nicer = nice(19);
    for (;;) {
      __asm__ volatile("");
    }
  }
  const auto run = [&](int threads) {
    return [&, threads] {
      return program.run(
          with("sine-gordon", {"grid.x.cells=100001", "scheme.step=2e-4", "scheme.until=0.02", store_none}, {}),
          threads);
    };
  };
  const auto costs = in_turns(repeats, {run(1), run(2)});
  kill(busy, SIGKILL);
  waitpid(busy, nullptr, 0);
  fmt::print(
      "\n| `box`, 10⁵ cells, variable levels, a loop of least priority on the second processor | s by the clock |\n"
      "|---|---|\n| one thread | {:.2f} |\n| two threads | {:.2f} |\n",
      costs[0].wall, costs[1].wall);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) {
    fmt::print(stderr, "benchmark_program rubato directory-for-records [repeats]\n");
    return 2;
  }
  const Program program(argv[1], argv[2]);
  const int repeats = argc > 3 ? std::max(1, std::atoi(argv[3])) : 5;
  starting(program, repeats);
  laws_and_records(program, repeats);
  beside_plain_hdf5(program, repeats);
  beside_loops(program, repeats);
  threads_beside_others(program, repeats);
}
