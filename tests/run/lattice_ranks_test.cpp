// One lattice shared by several ranks: here threads that pass numbers in memory. tests/program/ranks.sh has the same
// with MPI.

#include <catch2/catch.hpp>

#include <array>
#include <bit>
#include <chrono>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <functional>
#include <limits>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sys/mount.h>

#include <rubato/grids/fourier.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/grids/slab.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/lattice_ranks.hpp>
#include <rubato/solve/cyclic_block.hpp>
#include <rubato/solve/cyclic_parts.hpp>

#include "run/mailboxes.hpp"
#include "run/records.hpp"
#include "run/shared_lattices.hpp"

using namespace rubato;
using namespace rubato;
using namespace rubato::run_tests;
using Catch::Contains;

namespace {

/// A run that fails does so on three ranks as on one, with the same message and record. `folder` has neither yet.
void check_fails_alike(const Problem& problem, const Folder& folder) {
  const Outcome one = run(problem, {.output = folder / "one.h5", .threads = 1});
  REQUIRE(one.status == ExitStatus::failed);
  const Outcome all = with_ranks(3, [&](auto& rank) { return run(problem, on(rank, folder / "all.h5")); });
  CHECK(all.status == ExitStatus::failed);
  CHECK(all.message == one.message);
  CHECK(different_on_ranks(folder / "one.h5", folder / "all.h5") == Names{});
}

}  // namespace

namespace {

/// The schemes that ranks share with the same bits, with fixed levels and, where they have them, with variable ones;
/// and invariants with derivatives, along planes and across them.
const std::vector<Settings> shared_schemes = {
    {},
    {"scheme.lagrangian=leapfrog"},
    {"scheme.lagrangian=leapfrog", "scheme.levels=variable"},
    {"scheme.lagrangian=leapfrog", "invariants.mass=dy(u)^2 + v*dx(dy(a)) + dx(u)*dy(dy(u))"}};

}  // namespace

TEST_CASE("the record of a lattice is the same for every number of ranks") {
  const Settings scheme = GENERATE(from_range(shared_schemes));
  INFO(fmt::format("{}", fmt::join(scheme, " ")));
  const Folder folder;
  struct Case {
    std::size_t x, y;
    std::vector<int> ranks;
  };
  // 9 × 7: parts thinner than their ghosts; 40 × 37: one block of reductions; 90 × 101: three.
  for (const Case& torus : {Case{9, 7, {2, 3, 7}}, Case{40, 37, {2, 5}}, Case{90, 101, {2, 3, 4}}}) {
    const Problem problem = wave_on_torus(torus.x, torus.y, scheme);
    const Outcome one = run(problem, {.output = folder / "one.h5", .overwrite = true, .threads = 1});
    REQUIRE(one.status == ExitStatus::done);
    for (const int size : torus.ranks) {
      INFO(torus.x << " x " << torus.y << " nodes on " << size << " ranks");
      const Outcome all = with_ranks(size, [&](auto& rank) { return run(problem, on(rank, folder / "all.h5")); });
      CHECK(all.status == ExitStatus::done);
      CHECK(different_on_ranks(folder / "one.h5", folder / "all.h5") == Names{});
      CHECK(differences_on_ranks(one, all) == Names{});
      CHECK(all.warnings == one.warnings);
    }
  }
  CHECK(check(folder / "all.h5").status == ExitStatus::done);

  // The twin: one number of a plane on its way to a neighbour.
  Mailboxes tampered(3);
  tampered.tamper_with([sent = 0](int, std::vector<double>& numbers) mutable {
    if (numbers.size() == 90 && ++sent == 50) {
      numbers.front() += 1e-9;
      numbers.back() += 1e-9;
    }
  });
  static_cast<void>(with_ranks(
      tampered, [&](auto& rank) { return run(wave_on_torus(90, 101, scheme), on(rank, folder / "all.h5")); }));
  CHECK_FALSE(different_on_ranks(folder / "one.h5", folder / "all.h5").empty());
}

TEST_CASE("lattices on a line and in space are shared as well") {
  const std::string scheme = GENERATE("euler-box", "leapfrog");
  const Folder folder;
  const std::vector<Problem> problems = {
      read_problem("sine-gordon", Settings{"scheme.lagrangian=" + scheme, "scheme.levels=fixed", "scheme.step=0.02",
                                           "scheme.until=0.5", "invariants.topological_charge=dx(u)^2 + v*dx(dx(u))"}),
      wave_in_space({"scheme.lagrangian=" + scheme, "invariants.mass=dz(u)^2 + dy(dz(dx(v)))*u"})};
  for (const Problem& problem : problems) {
    INFO(problem.name);
    const Outcome one = run(problem, {.output = folder / "one.h5", .overwrite = true, .threads = 1});
    const Outcome all = with_ranks(3, [&](auto& rank) { return run(problem, on(rank, folder / "all.h5")); });
    CHECK(all.status == ExitStatus::done);
    CHECK(different_on_ranks(folder / "one.h5", folder / "all.h5") == Names{});
    CHECK(differences_on_ranks(one, all) == Names{});
  }
}

TEST_CASE("a shared lattice is continued on other numbers of ranks") {
  const Settings scheme = GENERATE(from_range(shared_schemes));
  const Folder folder;
  Settings ended = scheme;
  ended.emplace_back("scheme.until=0.11");
  const Problem whole = wave_on_torus(40, 37, scheme), part = wave_on_torus(40, 37, ended);
  static_cast<void>(run(whole, {.output = folder / "one.h5", .threads = 1}));
  for (const auto& [before, after] : {std::pair{4, 2}, std::pair{1, 3}, std::pair{3, 1}}) {
    INFO("from " << before << " ranks to " << after);
    static_cast<void>(with_ranks(before, [&](auto& rank) { return run(part, on(rank, folder / "all.h5")); }));
    const Outcome resumed =
        with_ranks(after, [&](auto& rank) { return resume(folder / "all.h5", 0.3, {.threads = 1, .ranks = &rank}); });
    CHECK(resumed.status == ExitStatus::done);
    CHECK(different_on_ranks(folder / "one.h5", folder / "all.h5") == Names{});
  }
  // Interrupted at rank 0 after some steps: the record is whole, and is continued.
  std::atomic<bool> stop = false;
  RunOptions options{.output = folder / "all.h5", .overwrite = true, .threads = 1, .interrupt = &stop};
  options.progress = [&stop](const Progress& progress) { stop = progress.steps >= 3; };
  options.progress_interval = std::chrono::milliseconds(0);
  const Outcome stopped = with_ranks(3, [&](auto& rank) {
    RunOptions own = options;
    own.ranks = &rank;
    return run(whole, own);
  });
  CHECK(stopped.status == ExitStatus::interrupted);
  CHECK(with_ranks(2, [&](auto& rank) {
          return resume(folder / "all.h5", {}, {.threads = 1, .ranks = &rank});
        }).status == ExitStatus::done);
  CHECK(different_on_ranks(folder / "one.h5", folder / "all.h5") == Names{});
}

namespace {

void require_checked_together(const std::string& every) {
  const Settings scheme = GENERATE(from_range(shared_schemes));
  INFO(fmt::format("{}, every {}", fmt::join(scheme, " "), every));
  const Folder folder;
  const std::string file = folder / "checked.h5";
  Settings settings = scheme;
  settings.insert(settings.end(), {"output.every=" + every, "scheme.until=0.11", "laws.fields=true"});
  static_cast<void>(run(wave_on_torus(13, 11, settings), {.output = file, .threads = 1}));
  const auto reported = [](const Outcome& outcome) {
    std::vector<std::string> all = {to_json(outcome)};
    for (const Disagreement& found : outcome.disagreements) {
      all.push_back(to_string(found));
    }
    all.insert(all.end(), outcome.warnings.begin(), outcome.warnings.end());
    return all;
  };
  const auto found_by = [&](int size) {
    return reported(with_ranks(size, [&](auto& rank) { return check(file, {.ranks = &rank}); }));
  };
  const auto sound = check(file);
  CHECK(sound.status == ExitStatus::done);
  for (const int size : {2, 3, 11}) {
    CHECK(found_by(size) == reported(sound));
  }
  CHECK(found_by(12) == reported(sound));  // more ranks than planes: rank 0 alone
  // It is shared, and what goes wrong on the way is found: planes of u on their way to rank 1.
  Mailboxes tampered(3);
  tampered.tamper_with([sent = 0](int from, std::vector<double>& numbers) mutable {
    if (from == 0 && numbers.size() == 4 * 13 && ++sent == 12) {
      numbers.front() += 1e-3;
    }
  });
  CHECK(with_ranks(tampered, [&](auto& rank) { return check(file, {.ranks = &rank}); }).status ==
        ExitStatus::contradiction);

  // What is altered is found by all, wherever it is: more than are listed, in the parts of two ranks; what is not a
  // number; the start; a law in a cell; one number of a step, of a level, of the grid.
  const std::string whole = folder / "whole.h5";
  std::filesystem::copy_file(file, whole);
  const auto altered = [&](const std::string& dataset, const std::vector<std::size_t>& indices, double change) {
    INFO(dataset);
    std::filesystem::copy_file(whole, file, std::filesystem::copy_options::overwrite_existing);
    for (const std::size_t index : indices) {
      falsify(file, dataset, index, change);
    }
    const Outcome one = check(file);
    CHECK(one.status == ExitStatus::contradiction);
    for (const int size : {2, 3}) {
      CHECK(found_by(size) == reported(one));
    }
  };
  constexpr std::size_t nodes = 13 * 11;
  std::vector<std::size_t> many;
  for (std::size_t i = 20; i < 120; i += 7) {
    many.push_back(nodes + i);
  }
  altered("/states/u", many, 1e-3);
  altered("/states/u", {2 * nodes - 1}, 1e-8);
  altered("/states/v", {nodes + 100}, std::nan(""));
  altered("/states/u", {70}, 1e-3);
  altered("/laws/fields/energy", {nodes + 142}, 1e-2);
  altered("/laws/fields/energy", {nodes + 5, nodes + 142}, 1e-2);
  altered("/levels/energy", {2}, 1e-6);
  altered("/laws/mass", {1}, 1e-6);
  altered("/grid/y", {10}, 1e-3);
}

}  // namespace

TEST_CASE("ranks check the record of a lattice together, and find what one finds") {
  require_checked_together("1");
}

TEST_CASE("ranks check the record of a lattice of which few levels are stored together", "[long]") {
  require_checked_together("3");
}

TEST_CASE("the box scheme on a line is the same for every number of ranks, resumed and checked on others") {
  struct Case {
    std::string name, cells, until;
    std::vector<int> ranks;
  };
  // KdV has a potential whose mean is held, and one with a slope; sine-Gordon a field that is not solved for;
  // Boussinesq neither. 33: one block of sums for both ranks; 8193: two levels of the elimination are shared.
  const auto [name, cells, until, ranks] =
      GENERATE(Case{"kdv", "33", "0.05", {2}}, Case{"kdv", "257", "0.05", {2, 3, 4, 7}},
               Case{"kdv", "8193", "0.015", {2, 3}}, Case{"sine-gordon", "301", "0.5", {2, 5}},
               Case{"boussinesq", "401", "0.5", {3, 4}}, Case{"camassa-holm", "201", "0.05", {2, 4}});
  const std::string levels = GENERATE("fixed", "variable");
  INFO(name << " on " << cells << " cells, " << levels << " levels");
  const Folder folder;
  const auto problem = [&, &name = name, &cells = cells](const std::string& end) {
    return line(name, {"grid.x.cells=" + cells, "scheme.levels=" + levels, "scheme.until=" + end});
  };
  const Problem whole = problem(until);
  const Outcome one = run(whole, {.output = folder / "one.h5", .threads = 1});
  REQUIRE(one.status == ExitStatus::done);
  const Outcome sound = check(folder / "one.h5");
  REQUIRE(sound.status == ExitStatus::done);
  for (const int size : ranks) {
    INFO(size << " ranks");
    const Outcome all = with_ranks(size, [&](auto& rank) { return run(whole, on(rank, folder / "all.h5")); });
    CHECK(all.status == ExitStatus::done);
    CHECK(different_on_ranks(folder / "one.h5", folder / "all.h5") == Names{});
    CHECK(differences_on_ranks(one, all) == Names{});
    CHECK(all.warnings == one.warnings);
    const Outcome checked = with_ranks(size, [&](auto& rank) { return check(folder / "one.h5", {.ranks = &rank}); });
    CHECK(to_json(checked) == to_json(sound));
    // Ended, and continued on another number.
    const int after = size == 2 ? 1 : 2;
    const std::string part = folder / "part.h5";
    static_cast<void>(with_ranks(size, [&](auto& rank) { return run(problem("0.006"), on(rank, part)); }));
    const Outcome resumed =
        with_ranks(after, [&](auto& rank) { return resume(part, whole.scheme.until, {.threads = 1, .ranks = &rank}); });
    CHECK(resumed.status == ExitStatus::done);
    CHECK(different_on_ranks(folder / "one.h5", part) == Names{});
  }
}

TEST_CASE("what goes from rank to rank on a line is what the record is made of") {
  const Folder folder;
  const Problem kdv = line("kdv", {"grid.x.cells=1001", "scheme.until=0.05"});
  static_cast<void>(run(kdv, {.output = folder / "one.h5", .threads = 1}));
  // Twins, each the numbers of another message: a correction at the last node of a part (which has either sign, as no
  // maxima have); the records that are left of 31 chunks, of KdV's four unknowns and one condition; the nodes that
  // separate them; what a sweep has come to at the end of a part (2 sums of two numbers, 13 maxima, and of the block
  // that goes on behind it 2 sums in nine parts, 17 maxima); and in all.
  constexpr std::size_t record = 2 * 16 + 4 * 2 + 2 * 4 + 2, head = 3, ghosts = 4;
  for (const std::size_t size :
       {ghosts, 31 * record, head + 4 * 32, std::size_t{2 * 2 + 13 + 2 * 9 + 17}, std::size_t{2 + 13}}) {
    INFO(size);
    Mailboxes tampered(2);
    int found = 0;
    tampered.tamper_with([&found, size](int, std::vector<double>& numbers) {
      const bool is_it = numbers.size() == size && (size != ghosts || std::ranges::min(numbers) < 0.0);
      if (is_it && ++found >= 20) {
        for (double& number : numbers) {
          number *= 1.001;
        }
      }
    });
    static_cast<void>(with_ranks(tampered, [&](auto& rank) { return run(kdv, on(rank, folder / "all.h5")); }));
    CHECK(found >= 20);
    CHECK_FALSE(different_on_ranks(folder / "one.h5", folder / "all.h5").empty());
  }
}

TEST_CASE("ranks find what one finds in a falsified record of a line, and are stopped by what stops one") {
  const Folder folder;
  const std::string file = folder / "line.h5";
  const Problem kdv = line("kdv", {"grid.x.cells=129", "scheme.until=0.05", "output.every=1", "laws.fields=true"});
  for (const auto& [dataset, index, change] : {std::tuple{"/states/u", 129 * 3 + 40, 1e-6},
                                               {"/states/u", 129 * 3 + 100, 1e-6},
                                               {"/states/midpoints/w", 129 * 2 + 65, 1e-3},
                                               {"/laws/fields/mass", 129 * 2 + 128, 1e-3},
                                               {"/levels/energy", 3, 1e-6},
                                               {"/laws/totals/momentum", 2, 1e-6}}) {
    INFO(dataset);
    static_cast<void>(run(kdv, {.output = file, .overwrite = true, .threads = 1}));
    falsify(file, dataset, static_cast<std::size_t>(index), change);
    const Outcome one = check(file);
    CHECK(one.status == ExitStatus::contradiction);
    for (const int size : {2, 4}) {
      const Outcome all = with_ranks(size, [&](auto& rank) { return check(file, {.ranks = &rank}); });
      CHECK(to_json(all) == to_json(one));
      CHECK(all.message == one.message);
    }
  }
  // A step much too long: the iteration does not converge, anywhere.
  const Problem wild = line("kdv", {"grid.x.cells=129", "scheme.step=40", "scheme.until=4000"});
  check_fails_alike(wild, folder);
}

namespace {

/// A bordered cyclic system with two right-hand sides, of random numbers; what each rank has of it is a piece.
struct CyclicSystem {
  static constexpr std::size_t d = 3, k = 1, columns = 2;
  std::size_t cells;
  double scale;
  std::vector<std::vector<double>> numbers;  ///< two entries, a border's column and row, d · columns right-hand sides

  /// \param scale of the first row: where it is small, that is refined
  explicit CyclicSystem(std::size_t of, double scale_of_first = 1.0)
      : cells(of), scale(scale_of_first), numbers(4 + d * columns, std::vector<double>(of)) {
    double x = 0.4;
    for (auto& row : numbers) {
      for (double& value : row) {
        value = x = 3.9 * x * (1.0 - x);
      }
    }
    for (const std::size_t row : {4UL, 4 + d}) {
      for (double& value : numbers[row]) {
        value *= scale;
      }
    }
  }

  /// Solves what begins at a cell: solution, border's solution, outcome.
  std::vector<double> solve(std::size_t first, std::size_t count, solve::CyclicCheck check,
                            const grids::Slab* slab = nullptr) const {
    solve::CyclicBlockSolver solver(d, cells, k, columns, slab);
    const auto at = [&](std::size_t row) { return numbers[row].data() + first; };
    const solve::CyclicBidiagonal matrix{d,
                                         count,
                                         {-3 * scale, scale, 0, 0.5, -2, 0, 0, 1, -4},
                                         {2 * scale, 0, 0.3 * scale, 0, 1.5, 0, 1, 0, 3},
                                         {{0, 2, scale, scale, at(0)}, {1, 1, 1, 0.5, at(1)}}};
    const solve::CyclicBorder border{k, {{0.5 * scale}, {1.0, at(2)}, {0.0}}, {{0.0}, {0.25, at(3)}, {0.0}}, {0.125}};
    std::vector<const double*> rhs;
    std::vector<double*> solution;
    std::vector<double> result((count + 1) * d * columns), y(k * columns);
    for (std::size_t j = 0; j < d * columns; ++j) {
      rhs.push_back(at(4 + j));
      solution.push_back(result.data() + j * (count + 1));
    }
    const solve::CyclicOutcome outcome =
        solver.solve(matrix, border, rhs, std::vector<double>{1.0, -2.0}, solution, y, check);
    result.insert(result.end(), y.begin(), y.end());
    result.insert(result.end(), {static_cast<double>(outcome.status), outcome.rcond_estimate, outcome.backward_error,
                                 outcome.refined ? 1.0 : 0.0, outcome.fallback ? 1.0 : 0.0});
    return result;
  }
};

}  // namespace

TEST_CASE("ranks solve a cyclic system together with the bits of one, at whatever level parts end") {
  // One, two and three levels of chunks of 16; the first ones longer by one cell.
  const std::size_t cells = GENERATE(35, 1003, 8199, 135007);
  const auto check = GENERATE(solve::CyclicCheck::every_solve, solve::CyclicCheck::left_to_caller);
  // A small equation is refined, and one that is empty needs the general method, if it has a solution at all.
  const double scale = GENERATE(1.0, 1e-7, 0.0);
  if (scale == 0.0 && cells > 2000) {
    return;  // the general method takes its time
  }
  const CyclicSystem system(cells, scale);
  const std::vector<double> whole = system.solve(0, cells, check);
  constexpr std::size_t rows = CyclicSystem::d * CyclicSystem::columns;
  const auto status_of = [](const std::vector<double>& result) { return static_cast<Status>(*(result.end() - 5)); };
  const bool has_solution = scale != 0.0, is_checked = check == solve::CyclicCheck::every_solve;
  REQUIRE((status_of(whole) == Status::success) == has_solution);
  REQUIRE((*(whole.end() - 2) == 1.0) == (scale == 1e-7 && is_checked));  // refined
  for (const int size : {1, 2, 3, 7}) {
    if (cells / 16 < static_cast<std::size_t>(size)) {
      continue;
    }
    INFO(cells << " cells, " << size << " ranks");
    const auto parts = solve::cyclic_parts(CyclicSystem::d, cells, size).first_cells.front();
    Mailboxes all(size);
    std::vector<std::vector<double>> found(static_cast<std::size_t>(size));
    std::vector<std::thread> threads;
    for (int rank = 0; rank < size; ++rank) {
      threads.emplace_back([&, rank] {
        Mailboxes::Rank mine(all, rank);
        const grids::Slab slab(mine, grids::Grid({{"x", 0.0, 1.0, cells}}), {1, 1}, parts);
        found[static_cast<std::size_t>(rank)] = system.solve(slab.number_of_first(), slab.owned(), check, &slab);
      });
    }
    for (std::thread& thread : threads) {
      thread.join();
    }
    std::size_t wrong = 0;
    for (std::size_t r = 0; r < found.size(); ++r) {
      if (!has_solution) {
        CHECK(status_of(found[r]) == Status::ill_conditioned);
        continue;
      }
      const std::size_t first = parts[r], count = parts[r + 1] - first;
      for (std::size_t j = 0; j < rows; ++j) {
        for (std::size_t i = 0; i <= count; ++i) {
          wrong += found[r][j * (count + 1) + i] == whole[j * (cells + 1) + (first + i) % cells] ? 0 : 1;
        }
      }
      // y and the outcome
      wrong += std::equal(found[r].begin() + static_cast<std::ptrdiff_t>((count + 1) * rows), found[r].end(),
                          whole.begin() + static_cast<std::ptrdiff_t>((cells + 1) * rows))
                   ? 0
                   : 1;
    }
    CHECK(wrong == 0);
    if (size == 3) {  // the twin: parts that end elsewhere
      Mailboxes::Rank mine(all, 0);
      const grids::Slab slab(mine, grids::Grid({{"x", 0.0, 1.0, cells}}), {1, 1}, {0, 1, 2, cells});
      CHECK_THROWS_AS(solve::CyclicBlockSolver(CyclicSystem::d, cells, 1, 1, &slab), std::logic_error);
    }
  }
}

TEST_CASE("parts of a line end at chunks, and are nearly equal") {
  for (const std::size_t cells : {std::size_t{1000001}, std::size_t{12345}, std::size_t{401}}) {
    for (const int size : {1, 2, 3, 4, 10}) {
      const auto parts = solve::cyclic_parts(4, cells, size).first_cells.front();
      std::size_t least = cells, most = 0;
      for (std::size_t r = 0; r + 1 < parts.size(); ++r) {
        least = std::min(least, parts[r + 1] - parts[r]);
        most = std::max(most, parts[r + 1] - parts[r]);
      }
      INFO(cells << " cells, " << size << " ranks: " << least << " to " << most);
      // Sixteen cells of the last level and one more of them; with few cells parts are of few chunks, one more or less.
      CHECK(most <= least + std::max<std::size_t>(17, least / 16 + 1));
      CHECK(parts.back() == cells);
    }
  }
  CHECK(solve::cyclic_parts(4, 1000001, 4).shared == 3);
  CHECK_THROWS_AS(solve::cyclic_parts(4, 63, 4), std::invalid_argument);
}

TEST_CASE("a first level is the same whether ranks make it in parts or whole, and so is what is said of it") {
  const Folder folder;
  // Data that do not repeat, across planes and along them; derivatives along planes, and across them, which all ranks
  // take together; an equation that is ill-posed, which is seen at the least and the greatest value.
  for (const Settings& settings :
       {Settings{"initial.u=exp(y/3)*sin(pi*x/3)"}, Settings{"initial.u=x^3*cos(2*pi*(y - 0.3)/6.7)"},
        Settings{"initial.v=dx(dx(u))"}, Settings{"initial.v=dx(dy(u))*cos(dy(u))"},
        Settings{"multisymplectic.S=(v^2 - a^2 - b^2)/2 + (1 - cos(u))*a^2"}}) {
    INFO(settings.front());
    const Problem problem = wave_on_torus(40, 37, settings);
    const auto one = said_of(problem, {.output = folder / "one.h5", .overwrite = true, .threads = 1});
    const auto all = with_ranks(3, [&](auto& rank) { return said_of(problem, on(rank, folder / "all.h5")); });
    CHECK(all == one);
    CHECK(one.empty() == settings.front().starts_with("initial.v"));
    if (std::filesystem::exists(folder / "one.h5")) {
      CHECK(different_on_ranks(folder / "one.h5", folder / "all.h5") == Names{});
    }
    std::filesystem::remove(folder / "one.h5");
  }
  // Of splittings the fields that follow are made of waves: the same to rounding, of some ten transforms and of wave
  // numbers up to 40 on values up to 3. Where one is given, it has to agree, in the whole.
  for (const std::string space : {"differences", "fourier"}) {
    for (const std::string& setting : {std::string("initial.u=exp(y/3)*sin(pi*x/3)"), std::string("initial.v=dy(u)"),
                                       std::string("initial.a=dx(u)"), std::string("initial.a=1")}) {
      INFO(space << ", " << setting);
      const Problem problem =
          wave_on_torus(40, 37, {"scheme.lagrangian=splitting", "scheme.space=" + space, "scheme.until=0.01", setting});
      const auto one = said_of(problem, {.output = folder / "one.h5", .overwrite = true, .threads = 1});
      const auto all = with_ranks(3, [&](auto& rank) { return said_of(problem, on(rank, folder / "all.h5")); });
      CHECK(all == one);
      for (const std::string field : {"u", "v", "a", "b"}) {
        if (setting != "initial.a=1") {
          const std::vector<double> expected = record::Reader(folder / "one.h5").read("/states/" + field);
          const std::vector<double> found = record::Reader(folder / "all.h5").read("/states/" + field);
          REQUIRE(found.size() == expected.size());
          double largest = 0.0;
          for (std::size_t i = 0; i < 40 * 37; ++i) {
            largest = std::max(largest, std::abs(found[i] - expected[i]));
          }
          CHECK(largest <= 10 * 40 * 3 * 8 * std::numeric_limits<double>::epsilon());
        }
      }
      std::filesystem::remove(folder / "one.h5");
      std::filesystem::remove(folder / "all.h5");
    }
  }
  // Undefined at nodes of the last rank alone.
  const Problem wrong = wave_on_torus(9, 12, {"initial.u=log(6 - y)"});
  std::vector<std::string> said;
  for (const int size : {1, 3}) {
    try {
      static_cast<void>(with_ranks(size, [&](auto& rank) { return run(wrong, on(rank, folder / "never.h5")); }));
    } catch (const ProblemError& error) {
      said.emplace_back(error.what());
    }
  }
  REQUIRE(said.size() == 2);
  CHECK(said[0] == said[1]);
  CHECK_THAT(said[0], Contains("nan at x = -1, y = 6.44"));
}

namespace {

enum class Ranks { some, more };

/// That `scheme` is shared, on planes and in space, equal to rounding, and continued with the same bits.
void require_shared_to_rounding(const Settings& scheme, const std::string& levels, Ranks ranks) {
  const Folder folder;
  const auto settings = [&](Settings more) {
    for (const std::string& setting : scheme) {
      more.push_back("scheme." + setting);
    }
    more.push_back("scheme.levels=" + levels);
    more.emplace_back(R"(verdict.accept=["energy", "law", "spectrum", "period", "resolution"])");
    if (scheme.back() != "space=differences") {  // derivatives take all ranks, too
      more.emplace_back("invariants.mass=v*dx(u) + " + std::string(levels == "fixed" ? "dx(dy(u))^2" : "dy(b)^2"));
    }
    return more;
  };
  const auto read = [&](const std::string& file, const std::string& path) {
    return record::Reader(folder / file).read(path);
  };
  const auto u_of = [&](const std::string& file) { return read(file, "/states/u"); };
  struct Case {
    std::function<Problem(const Settings&)> make;
    std::vector<int> ranks;
  };
  // 9 × 7: more ranks than groups of columns; 41 × 37: rows are transformed in other pairs; in space by rows.
  const auto sizes_of = [&](std::vector<int> usual, const std::vector<int>& others) {
    if (ranks == Ranks::more) {
      usual.insert(usual.end(), others.begin(), others.end());
    }
    return usual;
  };
  for (const auto& [make, sizes] :
       {Case{[&](const Settings& more) { return wave_on_torus(9, 7, settings(more)); }, sizes_of({5}, {2, 3})},
        Case{[&](const Settings& more) { return wave_on_torus(41, 37, settings(more)); }, sizes_of({}, {2, 4})},
        Case{[&](const Settings& more) { return wave_in_space(settings(more)); }, sizes_of({2}, {3})}}) {
    if (sizes.empty()) {
      continue;
    }
    const Problem problem = make({});
    const Outcome one = run(problem, {.output = folder / "one.h5", .overwrite = true, .threads = 1});
    REQUIRE(one.status == ExitStatus::done);
    const std::vector<double> expected = u_of("one.h5");
    // Some thirty steps of some ten transforms and kicks, or of stages that are known to as many roundings, each of
    // which rounds by some ε of the largest value; and levels whose times are known as well as the step condition says,
    // in either run, while u moves at the rate v.
    double scale = 0.0, late = 0.0, rate = 0.0;
    for (const double u : expected) {
      scale = std::max(scale, std::abs(u));
    }
    if (levels == "variable") {
      const auto condition = read("one.h5", "/levels/step_condition"), h = read("one.h5", "/levels/h");
      for (std::size_t k = 0; k < h.size(); ++k) {
        late += std::isfinite(condition[k]) ? 2.0 * condition[k] * h[k] : 0.0;
      }
      for (const double v : read("one.h5", "/states/v")) {
        rate = std::max(rate, std::abs(v));
      }
    }
    const double allowed = 30 * 10 * 8 * std::numeric_limits<double>::epsilon() * scale + late * rate;
    const auto is_close = [&](const std::string& file) {
      const std::vector<double> found = u_of(file);
      bool close = found.size() == expected.size();
      for (std::size_t i = 0; close && i < found.size(); ++i) {
        close = std::abs(found[i] - expected[i]) <= allowed;
      }
      return close;
    };
    for (const int size : sizes) {
      INFO(scheme.back() << ", " << levels << " levels, " << problem.source << ", " << expected.size() << " values, "
                         << size << " ranks");
      const Outcome all = with_ranks(size, [&](auto& rank) { return run(problem, on(rank, folder / "all.h5")); });
      CHECK(all.status == ExitStatus::done);
      CHECK(is_close("all.h5"));
      CHECK(with_ranks(size, [&](auto& rank) { return check(folder / "all.h5", {.ranks = &rank}); }).status ==
            ExitStatus::done);
      // Ended, and continued: by as many ranks with the same bits, by others to rounding.
      for (const int others : {size, 3}) {
        static_cast<void>(with_ranks(
            size, [&](auto& rank) { return run(make({"scheme.until=0.11"}), on(rank, folder / "part.h5")); }));
        const Outcome resumed = with_ranks(others, [&](auto& rank) {
          return resume(folder / "part.h5", problem.scheme.until, {.threads = 1, .ranks = &rank});
        });
        CHECK(resumed.status == ExitStatus::done);
        CHECK(is_close("part.h5"));
        if (others == size) {
          CHECK(different_on_ranks(folder / "all.h5", folder / "part.h5") == Names{});
        }
      }
    }
    // The twin: waves on their way to the rank that has them.
    Mailboxes tampered(2);
    tampered.tamper_with([sent = 0](int, std::vector<double>& numbers) mutable {
      if (numbers.size() >= 32 && numbers.size() % 8 == 0 && ++sent > 20) {
        numbers.front() += 1e-3;
      }
    });
    static_cast<void>(with_ranks(tampered, [&](auto& rank) { return run(problem, on(rank, folder / "all.h5")); }));
    CHECK_FALSE(is_close("all.h5"));
  }
}

const Settings by_differences{"lagrangian=splitting", "composition=golden", "space=differences"};
const Settings by_waves{"lagrangian=splitting", "composition=golden", "space=fourier"};
const Settings with_stages{"lagrangian=fourier", "stages=2"}, with_one{"lagrangian=fourier"}, of_box{"lagrangian=box"};

}  // namespace

TEST_CASE("schemes with transforms are shared, equal to rounding, and continued with the same bits") {
  const auto [scheme, levels] =
      GENERATE(std::pair(by_differences, "variable"), std::pair(by_waves, "fixed"), std::pair(with_stages, "variable"),
               std::pair(with_one, "fixed"), std::pair(of_box, "variable"));
  require_shared_to_rounding(scheme, levels, Ranks::some);
}

TEST_CASE("schemes with transforms are shared by more ranks and with the other kind of levels, too", "[long]") {
  const Settings scheme = GENERATE(by_differences, by_waves, with_stages, with_one, of_box);
  const std::string levels = GENERATE("fixed", "variable");
  require_shared_to_rounding(scheme, levels, Ranks::more);
}

TEST_CASE("ranks take long steps of collocation by Newton's method, and continue them with the same bits") {
  const Folder folder;
  const auto torus = [](const std::string& until, double displaced = 0.0) {
    return wave_on_torus(
        21, 19,
        {"scheme.lagrangian=fourier", "scheme.stages=2", "scheme.step=2", "scheme.until=" + until, "output.every=1",
         R"(verdict.accept=["energy", "law", "spectrum", "period", "resolution"])",
         "multisymplectic.S=(v^2 - a^2 - b^2)/2 + u^4/4",
         fmt::format("initial.u={:.17g}*sin(pi*x/3)*exp(cos(2*pi*(y - 0.3)/6.7))", 3.0 * (1.0 + displaced))});
  };
  const Outcome one = run(torus("6"), {.output = folder / "one.h5", .threads = 1});
  REQUIRE(one.status == ExitStatus::done);
  REQUIRE(one.statistics.all_iterations > 3.0 * 201.0);  // more sweeps than the fixed point is given
  const auto distance = [&](const std::string& file) {
    const record::Reader expected(folder / "one.h5"), found(folder / file);
    const std::vector<double> u = expected.read("/states/u"), v = found.read("/states/u");
    double largest = u.size() == v.size() ? 0.0 : std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < std::min(u.size(), v.size()); ++i) {
      largest = std::max(largest, std::abs(u[i] - v[i]));
    }
    return largest;
  };
  // Stages are known to some tens of roundings, and so far do data lead apart that differ by as many.
  static_cast<void>(run(torus("6", 45.0 * std::numeric_limits<double>::epsilon()),
                        {.output = folder / "moved.h5", .overwrite = true, .threads = 1}));
  const double allowed = distance("moved.h5");
  for (const int size : {1, 2, 3}) {
    const Outcome all = with_ranks(size, [&](auto& rank) { return run(torus("6"), on(rank, folder / "all.h5")); });
    CHECK(all.status == ExitStatus::done);
    CHECK(distance("all.h5") <= allowed);
    static_cast<void>(with_ranks(size, [&](auto& rank) { return run(torus("4"), on(rank, folder / "part.h5")); }));
    static_cast<void>(
        with_ranks(size, [&](auto& rank) { return resume(folder / "part.h5", 6.0, {.threads = 1, .ranks = &rank}); }));
    CHECK(different_on_ranks(folder / "all.h5", folder / "part.h5") == Names{});
    CHECK(with_ranks(size, [&](auto& rank) { return check(folder / "all.h5", {.ranks = &rank}); }).status ==
          ExitStatus::done);
  }
  // The twin: data that differ by much more.
  static_cast<void>(run(torus("6", 1e-10), {.output = folder / "moved.h5", .overwrite = true, .threads = 1}));
  CHECK(distance("moved.h5") > allowed);
}

TEST_CASE("a shared run that leaves the domain of its formulas ends as it would on one rank") {
  const Folder folder;
  // Far beyond the CFL condition: the numbers overflow.
  const Problem problem = wave_on_torus(12, 11, {"scheme.step=3", "scheme.until=3000"});
  check_fails_alike(problem, folder);
}

TEST_CASE("what ranks cannot share is refused, with its place, before anything is written") {
  const Folder folder;
  const auto refusal = [&](const Problem& problem, int size = 2) -> std::string {
    try {
      static_cast<void>(with_ranks(size, [&](auto& rank) { return run(problem, on(rank, folder / "never.h5")); }));
    } catch (const ProblemError& error) {
      return error.what();
    }
    return "";
  };
  const auto torus = [](const Settings& settings) { return wave_on_torus(9, 7, settings); };
  const auto check_that_methods_are_named = [&](const Problem& problem) {
    CHECK_THAT(refusal(problem), Contains("2 ranks cannot share this run") && Contains("without mpirun") &&
                                     Contains(R"(a line is shared with lagrangian = "box" with one stage, )"
                                              R"("euler-box", "leapfrog";)"));
  };
  // On a line: with stages; with fewer cells than chunks of the elimination for all, which have 16 for KdV's four
  // unknowns and the same for what sine-Gordon solves for.
  check_that_methods_are_named(line("kdv", {"scheme.stages=2"}));
  check_that_methods_are_named(line("kdv", {"scheme.space_stages=3", "grid.x.cells=63"}));
  CHECK_THAT(refusal(line("kdv", {"grid.x.cells=49"}), 4),
             Contains("kdv.toml") && Contains("4 ranks cannot share a line of 49 cells: each has to have 16") &&
                 Contains("start 3 at most"));
  CHECK_THAT(refusal(line("sine-gordon", {"grid.x.cells=31"})), Contains("each has to have 16 of them; start one"));
  CHECK_THAT(refusal(read_problem("sine-gordon", Settings{"scheme.lagrangian=splitting"})),
             Contains("transforms along a line take the whole of it"));
  CHECK_THAT(refusal(torus({}), 8), Contains("8 ranks cannot share a lattice of 7 planes across y"));
  // What the scheme itself refuses, and what all ranks find at the start, is said once.
  CHECK_THAT(refusal(read_problem("kdv", Settings{"scheme.lagrangian=euler-box", "scheme.levels=fixed"})),
             Contains("euler-box is not explicit for this system"));
  // Waves that have no solution are those of one rank alone.
  CHECK_THAT(refusal(parse_problem(R"toml(
[multisymplectic]
fields = ["u", "v", "a", "c", "d"]
M = [["u", "v", -1]]
K.x = [["u", "a", 1], ["c", "d", 1]]
K.y = [["u", "c", 1e-3]]
S = "(v^2 - a^2)/2 + 1 - cos(u)"
[grid]
x = { from = -1, to = 5, cells = 41 }
y = { from = 0, to = 7, cells = 39 }
[initial]
u = "sin(pi*x/3)"
v = 0
[scheme]
lagrangian = "splitting"
levels = "fixed"
step = 0.01
until = 0.1
)toml",
                                   "waves.toml", Settings{}),
                     3),
             Contains("waves.toml:15:15") && Contains("on the wave number 0 it cannot"));
  CHECK_THAT(refusal(torus({"initial.a=1"})), Contains("torus.toml:") || Contains("initial.a=1"));
  CHECK_FALSE(std::filesystem::exists(folder / "never.h5"));
}

TEST_CASE("sums and maxima over slabs have the bits of those over the whole") {
  // Two arrays of 100 × 97 nodes: five blocks, the third across the seam of the arrays; two of each array.
  const grids::Grid grid({{"x", 0.0, 1.0, 100}, {"y", 0.0, 1.0, 97}});
  grids::FieldSet whole(2, grid.size());
  for (std::size_t i = 0; i < whole.all().size(); ++i) {
    whole.all()[i] = std::sin(static_cast<double>(i * i % 1013)) * std::pow(10.0, static_cast<double>(i % 17));
  }
  const auto reduce = [](const grids::FieldSet& fields) {
    const auto all = fields.all(), one = fields.field(1);
    return std::vector<double>{
        grids::sum(all),     grids::sum(one), grids::dot(one, fields.field(0)), grids::max_abs(all),
        grids::max_abs(one), grids::rms(one), grids::magnitudes(all).squares,   grids::magnitudes(one).max};
  };
  const std::vector<double> expected = reduce(whole);
  for (const int size : {1, 2, 3, 8, 97}) {
    INFO(size << " ranks");
    Mailboxes all(size);
    std::vector<std::vector<double>> found(static_cast<std::size_t>(size));
    std::vector<std::thread> threads;
    for (int rank = 0; rank < size; ++rank) {
      threads.emplace_back([&, rank] {
        Mailboxes::Rank mine(all, rank);
        const grids::Slab slab(mine, grid, {2, 2});
        const grids::Slab::Shared shared(&slab);
        grids::FieldSet part(2, slab.size());
        for (int f = 0; f < 2; ++f) {
          slab.take_part(whole.field(f), part.field(f));
        }
        const grids::FieldSet before = part;
        slab.refresh(part);  // ghosts that are right already stay so
        auto& result = found[static_cast<std::size_t>(rank)];
        result = reduce(part);
        if (std::memcmp(before.all().data(), part.all().data(), part.all().size_bytes()) != 0) {
          result.clear();
        }
      });
    }
    for (std::thread& thread : threads) {
      thread.join();
    }
    for (const std::vector<double>& result : found) {
      CHECK(result == expected);
    }
  }
}

TEST_CASE("derivatives of a lattice have the bits of those on one rank, whoever takes them") {
  // Lines of even and of odd length, more ranks than lines across planes, and a line, which one rank takes.
  const std::vector<std::vector<grids::Axis>> lattices = {{{"x", 0.0, 1.0, 21}, {"y", -1.0, 1.0, 16}},
                                                          {{"x", 0.0, 1.0, 3}, {"y", -1.0, 1.0, 45}},
                                                          {{"x", 0.0, 1.0, 6}, {"y", 0.0, 2.0, 5}, {"z", 0.0, 3.0, 11}},
                                                          {{"x", 0.0, 2.0, 64}}};
  constexpr int fields = 3;
  for (const auto& axes : lattices) {
    const grids::Grid grid(axes);
    const int last = grid.dimensions() - 1;
    grids::FieldSet whole(fields, grid.size());
    for (std::size_t i = 0; i < whole.all().size(); ++i) {
      whole.all()[i] = std::sin(static_cast<double>(i * i % 1013)) * std::pow(10.0, static_cast<double>(i % 7));
    }
    // Across planes, then along x, of two fields where they are, of all three into others.
    const auto derive = [&](const grids::Grid& on, grids::FieldSet& values) {
      const grids::SpectralDerivative derivative(on);
      derivative(last, std::as_const(values).pointers().first(2), values.pointers().first(2));
      grids::FieldSet next = values;
      derivative(0, std::as_const(values).pointers(), next.pointers());
      derivative(last, std::as_const(next).pointers(), values.pointers());
    };
    grids::FieldSet expected = whole;
    derive(grid, expected);
    for (const int size : {1, 2, 5, 11}) {
      const auto is_right = [&](const Mailboxes::Tamper& tamper) {
        Mailboxes all(size);
        all.tamper_with(tamper);
        std::vector<char> right(static_cast<std::size_t>(size), 0);
        std::vector<std::thread> threads;
        for (int rank = 0; rank < size; ++rank) {
          threads.emplace_back([&, rank] {
            Mailboxes::Rank mine(all, rank);
            const grids::Slab slab(mine, grid, {2, 2});
            const grids::Slab::Shared shared(&slab);
            grids::FieldSet part(fields, slab.size()), result(fields, slab.size());
            for (int f = 0; f < fields; ++f) {
              slab.take_part(whole.field(f), part.field(f));
              slab.take_part(expected.field(f), result.field(f));
            }
            derive(slab.grid(), part);
            bool same = true;
            for (int f = 0; f < fields; ++f) {
              same = same && std::memcmp(part.field(f).data() + slab.first_node(),
                                         result.field(f).data() + slab.first_node(), 8 * slab.owned()) == 0;
            }
            right[static_cast<std::size_t>(rank)] = same ? 1 : 0;
          });
        }
        for (std::thread& thread : threads) {
          thread.join();
        }
        return std::ranges::count(right, 1) == size;
      };
      INFO(grid.dimensions() << " dimensions, " << grid.size() << " nodes, " << size << " ranks");
      CHECK(is_right([](int, std::vector<double>&) {}));
      if (size > 1) {  // the twin: one number of one message
        CHECK_FALSE(is_right([sent = 0](int, std::vector<double>& numbers) mutable {
          if (++sent == 2) {
            numbers.back() += 1.0;
          }
        }));
      }
    }
  }
}

TEST_CASE("what neighbours wait for is computed first, and the rest while it is on its way") {
  const grids::Grid grid({{"x", 0.0, 1.0, 5}, {"y", 0.0, 1.0, 40}});
  constexpr std::size_t ghosts = 3, plane = 5;
  const std::vector<int> which = {0};
  for (const int size : {1, 2, 3, 8}) {  // 8: parts of five planes, that have no inside
    INFO(size << " ranks");
    Mailboxes all(size);
    // Which nodes were computed when a rank sent, in pieces; and whether each of all was once.
    std::vector<std::size_t> sent_after(static_cast<std::size_t>(size), 0);
    std::vector<std::size_t> computed(static_cast<std::size_t>(size), 0);
    all.tamper_with([&](int from, std::vector<double>&) {
      auto& after = sent_after[static_cast<std::size_t>(from)];
      after = after == 0 ? computed[static_cast<std::size_t>(from)] : after;
    });
    std::vector<char> right(static_cast<std::size_t>(size), 0);
    std::vector<std::thread> threads;
    for (int rank = 0; rank < size; ++rank) {
      threads.emplace_back([&, rank] {
        Mailboxes::Rank mine(all, rank);
        const grids::Slab slab(mine, grid, {ghosts, ghosts});
        const auto r = static_cast<std::size_t>(rank);
        const auto value = [&](std::size_t node) {
          return static_cast<double>((slab.number_of_first() + grid.size() + node - slab.first_node()) % grid.size());
        };
        grids::FieldSet fields(1, slab.size());
        std::size_t twice = 0;
        slab.compute_and_refresh(fields, which, 1, [&](std::size_t begin, std::size_t end) {
          for (std::size_t i = begin; i < end; ++i) {
            twice += fields.field(0)[i] != 0.0 ? 1 : 0;
            // As a step leaves it: wrong in the outermost ghosts.
            fields.field(0)[i] = i < plane || i + plane >= slab.size() ? -1.0 : 1.0 + value(i);
          }
          computed[r] += end - begin;
        });
        bool is_right = twice == 0;
        for (std::size_t i = 0; i < slab.size(); ++i) {
          is_right = is_right && fields.field(0)[i] == 1.0 + value(i);
        }
        right[r] = is_right ? 1 : 0;
      });
    }
    for (std::thread& thread : threads) {
      thread.join();
    }
    for (std::size_t r = 0; r < right.size(); ++r) {
      CHECK(right[r] == 1);
      if (size == 2 || size == 3) {
        CHECK(sent_after[r] == 2 * ghosts * plane);  // before all else
      }
      CHECK(computed[r] == (40U / right.size() + (r < 40 % right.size() ? 1 : 0) + 2 * ghosts) * plane);
    }
    if (size == 8) {
      CHECK(sent_after[0] == computed[0]);  // the twin: nothing was left to do meanwhile
    }
  }
}

TEST_CASE("rows and checkpoints go to the record, and come from it, in parts") {
  const Folder folder;
  // Slab::planes_at_once(): as many planes as a megabyte has, of which either rank owns more.
  constexpr std::size_t x = 1000, y = 310, part = (std::size_t{1} << 17) / x * x;
  const std::string scheme = GENERATE("euler-box", "splitting");
  const auto torus = [&](double until) {
    return wave_on_torus(x, y, {"scheme.lagrangian=" + scheme, fmt::format("scheme.until={}", until), "output.every=3"},
                         scheme == "splitting");
  };
  std::size_t largest = 0;
  Mailboxes all(2);
  all.tamper_with([&largest](int, std::vector<double>& numbers) { largest = std::max(largest, numbers.size()); });
  static_cast<void>(with_ranks(all, [&](auto& rank) { return run(torus(0.05), on(rank, folder / "whole.h5")); }));
  static_cast<void>(with_ranks(all, [&](auto& rank) { return run(torus(0.02), on(rank, folder / "part.h5")); }));
  static_cast<void>(
      with_ranks(all, [&](auto& rank) { return resume(folder / "part.h5", 0.05, {.threads = 1, .ranks = &rank}); }));
  CHECK(different_on_ranks(folder / "part.h5", folder / "whole.h5") == Names{});
  if (scheme == "euler-box") {  // which sends nothing else that is large
    CHECK(largest <= part);
    CHECK(largest > part / 2);
    static_cast<void>(run(torus(0.05), {.output = folder / "one.h5", .threads = 1}));
    CHECK(different_on_ranks(folder / "one.h5", folder / "whole.h5") == Names{});
  }

  // The twin: one number of the last planes.
  Mailboxes tampered(2);
  tampered.tamper_with([](int, std::vector<double>& numbers) {
    if (numbers.size() == x * y % part) {
      numbers.back() += 1e-12;
    }
  });
  static_cast<void>(with_ranks(tampered, [&](auto& rank) { return run(torus(0.05), on(rank, folder / "other.h5")); }));
  CHECK_FALSE(different_on_ranks(folder / "other.h5", folder / "whole.h5").empty());
}

TEST_CASE("a full disk ends a shared run with its place, and the record stays what it was") {
  const Folder folder;
  const std::string disk = folder / "disk";
  std::filesystem::create_directory(disk);
  const auto with_disk = [&](const std::string& size, const auto& use) {
    if (::mount("none", disk.c_str(), "tmpfs", 0, size.c_str()) != 0) {
      return false;
    }
    struct Mounted {
      const std::string& disk;
      ~Mounted() { ::umount(disk.c_str()); }
    } mounted{disk};
    use();
    return true;
  };
  const Problem problem = wave_on_torus(150, 120, {"output.every=1", "scheme.until=0.2"});
  const std::string file = disk + "/full.h5";
  const auto begun = [&](double until) {
    static_cast<void>(run(wave_on_torus(150, 120, {"output.every=1", fmt::format("scheme.until={}", until)}),
                          {.output = folder / "begun.h5", .overwrite = true, .threads = 1}));
  };
  std::string said;
  const auto goes_on = [&] {
    said.clear();
    std::filesystem::copy_file(folder / "begun.h5", file);
    try {
      static_cast<void>(with_ranks(3, [&](auto& rank) { return resume(file, 0.2, {.threads = 1, .ranks = &rank}); }));
    } catch (const record::Error& error) {
      said = error.what();
    }
    CHECK(std::distance(std::filesystem::directory_iterator(disk), {}) == 1);
    CHECK(check(file).status == ExitStatus::done);
    std::filesystem::copy_file(file, folder / "kept.h5", std::filesystem::copy_options::overwrite_existing);
  };
  begun(0.02);
  // Full with the second copy of what was begun, with rows, with the checkpoint at the end.
  const auto bytes = std::filesystem::file_size(folder / "begun.h5");
  for (const double copies : {1.5, 2.2, 2.7, 4.0}) {
    INFO("room for " << copies << " records of " << bytes << " bytes");
    if (!with_disk(fmt::format("size={:.0f}", copies * static_cast<double>(bytes)), goes_on)) {
      WARN("skipped: a small file system could not be mounted here");
      return;
    }
    CHECK_THAT(said, Contains(file) && Contains("No space left on device"));
    CHECK(different_on_ranks(folder / "begun.h5", folder / "kept.h5") == Names{});
  }
  // What was kept goes on elsewhere, and the twin: a disk that is large enough.
  static_cast<void>(run(problem, {.output = folder / "one.h5", .threads = 1}));
  static_cast<void>(
      with_ranks(2, [&](auto& rank) { return resume(folder / "kept.h5", 0.2, {.threads = 1, .ranks = &rank}); }));
  CHECK(different_on_ranks(folder / "one.h5", folder / "kept.h5") == Names{});
  REQUIRE(with_disk("size=300m", goes_on));
  CHECK(said.empty());
  CHECK(different_on_ranks(folder / "one.h5", folder / "kept.h5") == Names{});
}

TEST_CASE("what ranks send for a level of a scheme in Fourier space is transposes, and some numbers") {
  // Of 60 × 64 nodes: of 31 waves of a row, with padding 32, each rank has a part, and so of the 60 lines across
  // planes. A message of fields to be transformed is a multiple of the one, of derivatives of the other.
  constexpr std::size_t x = 60, y = 64, width = 32;
  const auto size = GENERATE(2, 4);
  const std::string scheme = GENERATE("splitting", "fourier", "midpoint");
  const auto ranks = static_cast<std::size_t>(size);
  const std::size_t waves = 2 * y / ranks * width / ranks, lines = y / ranks * x / ranks;
  struct Sent {
    std::size_t waves = 0, lines = 0, numbers = 0, messages = 0;
    double sweeps = 0.0;
  };
  const Folder folder;
  const auto sent = [&](int levels) {
    Mailboxes all(size);
    Sent result;
    all.tamper_with([&](int, std::vector<double>& numbers) {
      if (numbers.size() % waves == 0) {
        result.waves += numbers.size() / waves;
      } else if (numbers.size() % lines == 0) {
        result.lines += numbers.size() / lines;
      }
    });
    Settings settings = {"scheme.lagrangian=" + (scheme == "midpoint" ? "fourier" : scheme),
                         fmt::format("scheme.until={}", 0.01 * levels), "output.every=1000"};
    if (scheme == "fourier") {
      settings.emplace_back("scheme.stages=2");
    }
    const Problem problem = wave_on_torus(x, y, settings);
    result.sweeps = with_ranks(all, [&](auto& rank) {
                      return run(problem, uncommitted_on(rank, folder / "a.h5"));
                    }).statistics.all_iterations;
    result.numbers = all.sent();
    result.messages = all.exchanges();
    return result;
  };
  const Sent few = sent(10), many = sent(26);  // between levels that sizes of the energy are looked at
  // How many times the waves, or the lines, of a whole field are sent for a level: each rank sends to all others.
  const double times = 16.0 * size * (size - 1);
  const double fields = static_cast<double>(many.waves - few.waves) / times;
  const double derivatives = static_cast<double>(many.lines - few.lines) / times;
  if (scheme == "splitting") {
    // Of a step two kicks, each there and back (4), the energy (1) and the fields at its end (4); of the laws the waves
    // of u and v there, and the rate of u, which is all that fluxes have, back (3).
    CHECK(fields == 12.0);
    // Of u and of the flux of three laws, there and back.
    CHECK(derivatives == 8.0);
  } else if (scheme == "midpoint") {
    // Of each sweep u there and back; of a step u and v at its start (2) and their increments (2), and for its level
    // u there and its derivatives back (3).
    CHECK(fields == 2.0 * (many.sweeps - few.sweeps) / 16.0 + 7.0);
    // As above, of u in the middle for the laws (2), and of u, for the energy of the level (2).
    CHECK(derivatives == 12.0);
  } else {
    // Of each sweep u at two stages, there and back; of a step and its level as before (7), and at two stages the
    // fields and the rate of u, of the laws (10).
    CHECK(fields == 4.0 * (many.sweeps - few.sweeps) / 16.0 + 17.0);
    // As above, and of u at two stages, and of u, for the energy of the level.
    CHECK(derivatives == 14.0);
  }
  const auto transposes = [&](double of_waves, double of_lines) {
    return (size - 1) * (fields * of_waves + derivatives * of_lines);
  };
  const double numbers = static_cast<double>(many.numbers - few.numbers) / 16.0 / size;
  const double rest = numbers - transposes(static_cast<double>(waves), static_cast<double>(lines));
  const double messages = static_cast<double>(many.messages - few.messages) / 16.0 / size;
  INFO(numbers << " numbers a level and rank, of which " << rest << " are no transposes, in " << messages
               << " messages");
  CHECK(rest > 0.0);
  CHECK(rest < 150.0);
  CHECK(messages < (scheme == "splitting" ? 80.0 : 120.0));
  // Padding and all else is less than a tenth of what has to be sent; and the twin, of 5 × 5 nodes.
  const auto least = [&](std::size_t nodes) {
    const auto n = static_cast<double>(nodes), p = static_cast<double>(size);
    return transposes(2.0 * static_cast<double>(nodes / 2 + 1) * n / p / p, n * n / p / p);
  };
  const double padding = transposes(static_cast<double>(waves), 0.0) * (1.0 - 31.0 / 32.0);
  CHECK(padding + rest < 0.1 * least(60));
  CHECK(rest > 0.1 * least(5));
}

TEST_CASE("what ranks send for a level is a plane of what moves to each neighbour, or waves, and some numbers") {
  // Of nodes in a plane and of ranks as many as stated; between levels that the record stores, so that nothing but
  // planes, waves, sums and orders goes from rank to rank.
  struct Case {
    std::string scheme;
    std::size_t nodes;
    int ranks;
  };
  const auto [scheme, nodes, size] =
      GENERATE(Case{"euler-box", 64, 2}, Case{"euler-box", 64, 3}, Case{"euler-box", 64, 4}, Case{"leapfrog", 64, 2},
               Case{"leapfrog", 64, 3}, Case{"leapfrog", 64, 4}, Case{"splitting", 64, 2}, Case{"splitting", 64, 4});
  const Folder folder;
  const auto sent = [&, scheme = scheme, nodes = nodes, size = size](int levels) {
    Mailboxes all(size);
    // Rank 0 sends orders and what sums and maxima are in the end, to all others along a tree.
    std::size_t results = 0;
    all.tamper_with([&, planes = 2 * nodes / (size == 2 ? 1 : 2)](int from, std::vector<double>& numbers_sent) {
      results += from == 0 && numbers_sent.size() != planes ? numbers_sent.size() : 0;
    });
    const Problem problem = wave_on_torus(
        nodes, nodes,
        {"scheme.lagrangian=" + scheme, fmt::format("scheme.until={}", 0.01 * levels), "output.every=1000"},
        scheme == "splitting");
    static_cast<void>(with_ranks(all, [&](auto& rank) { return run(problem, uncommitted_on(rank, folder / "a.h5")); }));
    return std::array{all.sent(), all.exchanges(), results / std::bit_width(static_cast<unsigned>(size - 1))};
  };
  const auto [few, few_times, few_results] = sent(10);
  const auto [many, many_times, many_results] = sent(26);  // between levels that sizes of the energy are looked at
  const double numbers = static_cast<double>(many - few) / 16.0 / size;  // a level and rank
  const double planes = 2.0 * static_cast<double>(nodes);                // of u, one to each neighbour
  const double messages = static_cast<double>(many_times - few_times) / 16.0 / size;
  INFO(scheme << ", " << size << " ranks: " << numbers << " numbers a level and rank in " << messages << " messages");
  if (scheme == "splitting") {
    // The waves of a field that go to other ranks; 36 columns of which 33 are modes.
    const double waves = 2.0 * 36.0 * static_cast<double>(nodes) / size * (size - 1) / size;
    CAPTURE(numbers / waves);
    CHECK(numbers < 40.0 * waves);
    return;
  }
  CHECK(numbers >= planes);
  CHECK(numbers - planes < 300.0);
  CHECK(messages < 20.0);
  // The least that would do: of each rank but one its part of each sum and maximum to another, and the result back; and
  // an order. It does not depend on how long planes are.
  const double share = static_cast<double>(size - 1) / size;
  const double results = static_cast<double>(many_results - few_results) / 16.0 - 1.0;
  const double least = share * (2.0 * results + 1.0);
  CAPTURE(least);
  CHECK(least < numbers - planes);
  for (const double long_planes : {2.0 * 255, 2.0 * 1023}) {
    CHECK(long_planes + numbers - planes < 1.1 * (long_planes + least));
  }
  // The twin: planes so short that sums count.
  const double short_planes = 2.0 * 8;
  CHECK_FALSE(short_planes + numbers - planes < 1.1 * (short_planes + least));
}

namespace {

/// KdV, fixed levels, between levels that the record stores.
void check_what_is_sent_on_a_line(std::size_t cells, int size, double step) {
  const auto parts = solve::cyclic_parts(4, cells, size);
  const auto& left = parts.first_cells.back();
  const Folder folder;
  std::size_t iterations = 0;
  const auto sent = [&](int levels) {
    Mailboxes all(size);
    const Problem problem =
        line("kdv", {fmt::format("grid.x.cells={}", cells), fmt::format("scheme.step={}", step), "output.every=1000",
                     "levels.every=1", fmt::format("scheme.until={}", step * levels)});
    static_cast<void>(with_ranks(all, [&](auto& rank) { return run(problem, uncommitted_on(rank, folder / "a.h5")); }));
    const auto counts = record::Reader(folder / "a.h5").read("/levels/iterations");
    iterations = 0;
    for (const double count : counts) {
      iterations += static_cast<std::size_t>(count);
    }
    return std::array{all.sent(), all.exchanges(), iterations};
  };
  const auto [few, few_times, few_iterations] = sent(10);
  const auto [many, many_times, many_iterations] = sent(26);
  // Each iteration but the last of a level solves.
  const double sweeps = static_cast<double>(many_iterations - few_iterations) / 16.0, solves = sweeps - 1.0;
  const double numbers = static_cast<double>(many - few) / 16.0 / size;
  const double messages = static_cast<double>(many_times - few_times) / 16.0 / size;
  INFO(cells << " cells, " << size << " ranks: " << numbers << " numbers a level and rank in " << messages
             << " messages, " << solves << " solves");
  // In each solve the records of all ranks but rank 0, of 50 numbers, with their solutions of four; and of the solution
  // the nodes before and behind a part, of four fields (rank 0 solves for the one behind its own), the unknown of the
  // border, and whether it is one.
  const double others = static_cast<double>(size - 1) / size;
  const double of_parts = 54.0 * static_cast<double>(left.back() - left[1]) / size, ghosts = 4.0 + (4.0 + 2.0) * others;
  // Sums and maxima, of which the least is one number from each rank but one and one back: of each sweep two sums,
  // whether all is finite, three maxima of each of four rows; of each solve what its residual is judged by (21 and the
  // border's row), and the largest of the correction and of the increment of four fields; of a level the energy's
  // slope (2, and whether it is finite), totals of three laws, sums and maxima of the residuals of these and of two
  // variational laws, the largest of four increments; and on four things all agree. And an order.
  const double results = sweeps * 15.0 + solves * 30.0 + 3.0 + 3.0 + 6.0 + 4.0 + 4.0 + 4.0;
  const double least = solves * (of_parts + ghosts) + (2.0 * results + 1.0) * others;
  CAPTURE(of_parts, least);
  CHECK(numbers > least);
  CHECK(numbers < 1.1 * least);
  // The twin: with as many ghosts behind a part as a block of cells has.
  CHECK_FALSE(numbers + solves * 4.0 * 255.0 < 1.1 * least);
  CHECK(messages < 40.0);
}

}  // namespace

TEST_CASE("what ranks send for a level of a line is what is left of their parts, ghosts, and some numbers") {
  // Parts end at chunks of one level of the elimination with 1001 cells, of two with 8193 on 2 ranks.
  const auto [cells, size] = GENERATE(std::pair{1001, 2}, std::pair{1001, 3}, std::pair{1001, 4}, std::pair{8193, 2});
  check_what_is_sent_on_a_line(static_cast<std::size_t>(cells), size, 0.005);
}

TEST_CASE("what ranks send for a level of a line of a million cells is no more", "[long]") {
  // Of three levels of the elimination.
  check_what_is_sent_on_a_line(1'000'001, GENERATE(2, 3, 4), 0.001);
}
