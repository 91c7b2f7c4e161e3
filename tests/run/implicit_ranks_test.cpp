// Lattices in the plane and in space that several ranks share with implicit schemes: potentials, whose equations have a
// kernel, and collocation in boxes. Ranks are threads here; see lattice_ranks_test.cpp.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include <fmt/format.h>

#include <rubato/record/reader.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/run.hpp>

#include "run/mailboxes.hpp"
#include "run/records.hpp"
#include "run/shared_lattices.hpp"

using namespace rubato;
using namespace rubato::run_tests;

namespace {

/// Zakharov and Kuznetsov's equation: of the potential's slope there is one number for each line along x, and constants
/// along x that vary with y are a kernel.
Problem zakharov_kuznetsov(Settings more) {
  more.insert(more.begin(),
              {"initial.u=0.5 + exp(-((x - 2)^2 + (y - 1)^2)/4)", "grid.x.from=-6", "grid.x.to=6", "grid.y.from=-6",
               "grid.y.to=6", "scheme.step=0.02", "scheme.until=0.2", "output.every=2"});
  return read_problem("zakharov-kuznetsov-pulse", more);
}

/// Kadomtsev and Petviashvili's, (u_t + u u_x + u_xxx)_x + u_yy = 0, u = φ_x: derivatives in both directions see φ,
/// whose kernel is one constant and, on even numbers of cells, three sawtooths.
Problem kadomtsev_petviashvili(const Settings& more) {
  return parse_problem(R"toml(
[multisymplectic]
fields = ["phi", "u", "v", "w", "q"]
M = [["phi", "u", 0.5]]
K.x = [["phi", "w", 1], ["u", "v", -1]]
K.y = [["phi", "q", 0.5]]
S = "v^2/2 - u*w + u^3/6 - q^2/4"
[grid]
x = { from = -6, to = 6, cells = 24 }
y = { from = -6, to = 6, cells = 20 }
[initial]
u = "-0.2*x*exp(-(x^2 + y^2)/3)"
[scheme]
lagrangian = "fourier"
levels = "fixed"
step = 0.02
until = 0.2
[output]
every = 2
)toml",
                       "kp.toml", more);
}

/// The same in space, the equation of the plane for each z, and a field whose derivative along z is seen.
Problem potential_in_space(const Settings& more) {
  return parse_problem(R"toml(
[multisymplectic]
fields = ["phi", "u", "v", "w", "p", "q"]
M = [["phi", "u", 0.5]]
K.x = [["phi", "p", 1], ["u", "v", -1]]
K.y = [["u", "w", -1]]
K.z = [["u", "q", -1]]
S = "u^3/6 - p*u + (v^2 + w^2 + q^2)/2"
[grid]
x = { from = -4, to = 4, cells = 9 }
y = { from = -4, to = 4, cells = 7 }
z = { from = -4, to = 4, cells = 11 }
[initial]
u = "0.3 + exp(-((x - 1)^2 + y^2 + (z + 1)^2)/4)"
[scheme]
lagrangian = "box"
levels = "fixed"
step = 0.02
until = 0.1
[output]
every = 2
)toml",
                       "potential.toml", more);
}

/// The largest difference of u, over the largest u; infinite where there are others.
double distance(const std::string& file, const std::string& other) {
  const std::vector<double> u = record::Reader(file).read("/states/u"), v = record::Reader(other).read("/states/u");
  if (u.size() != v.size()) {
    return std::numeric_limits<double>::infinity();
  }
  double largest = 0.0, size = 0.0;
  for (std::size_t i = 0; i < u.size(); ++i) {
    largest = std::max(largest, std::isfinite(v[i]) ? std::abs(u[i] - v[i]) : std::numeric_limits<double>::infinity());
    size = std::max(size, std::abs(u[i]));
  }
  return largest / size;
}

/// What errors of the levels move u by, over the largest u: h is known to the condition of its step, where the law
/// chose it, and two runs differ by twice that.
double moved_by_levels(const std::string& file) {
  const record::Reader reader(file);
  const std::vector<double> h = reader.read("/levels/h"), condition = reader.read("/levels/step_condition"),
                            t = reader.read("/states/t"), u = reader.read("/states/u");
  double late = 0.0;
  for (std::size_t k = 0; k < h.size(); ++k) {
    late += std::isfinite(condition.at(k)) ? h[k] * condition[k] : 0.0;
  }
  const std::size_t nodes = u.size() / t.size();
  double speed = 0.0, size = 0.0;
  for (std::size_t i = nodes; i < u.size(); ++i) {
    const std::size_t level = i / nodes;
    speed = std::max(speed, std::abs(u[i] - u[i - nodes]) / (t[level] - t[level - 1]));
    size = std::max(size, std::abs(u[i]));
  }
  return 2.0 * late * speed / size;
}

struct Shared {
  std::string name;
  Problem (*make)(Settings more);
  Settings scheme;
  std::vector<int> ranks;
};

/// \param by_all numbers of ranks that are named, else by the first
void check_shared_potentials(bool by_all) {
  const auto zk = [](Settings more) { return zakharov_kuznetsov(std::move(more)); };
  const auto kp = [](Settings more) { return kadomtsev_petviashvili(more); };
  const auto space = [](Settings more) { return potential_in_space(more); };
  const auto shared = GENERATE_COPY(values<Shared>({
      {"ZK, box", zk, {"scheme.lagrangian=box", "grid.x.cells=25", "grid.y.cells=21"}, {4, 2}},
      {"ZK, box, variable levels",
       zk,
       {"scheme.lagrangian=box", "scheme.levels=variable", "grid.x.cells=25", "grid.y.cells=21"},
       {3}},
      {"ZK, fourier", zk, {"scheme.lagrangian=fourier", "grid.x.cells=24", "grid.y.cells=20"}, {2, 3}},
      {"ZK, fourier, 2 stages",
       zk,
       {"scheme.lagrangian=fourier", "scheme.stages=2", "grid.x.cells=25", "grid.y.cells=20"},
       {3}},
      {"ZK, box, 2 stages",
       zk,
       {"scheme.lagrangian=box", "scheme.stages=2", "grid.x.cells=25", "grid.y.cells=21"},
       {3}},
      {"KP, fourier", kp, {}, {2, 3}},
      {"KP, fourier, odd", kp, {"grid.y.cells=21"}, {3}},
      {"space, box", space, {}, {2, 3}},
      {"space, fourier", space, {"scheme.lagrangian=fourier", "grid.x.cells=8", "grid.z.cells=10"}, {3}},
  }));
  INFO(shared.name);
  const Folder folder;
  const Problem problem = shared.make(shared.scheme);
  const Outcome one = run(problem, {.output = folder / "one.h5", .overwrite = true, .threads = 1});
  REQUIRE(one.status == ExitStatus::done);
  // Ten steps, each of which leaves some thirty roundings: of transforms, and of linear systems, which are solved to
  // some of them. Variable levels are known to the condition of the law besides.
  const double allowed = 10 * 30 * std::numeric_limits<double>::epsilon() + moved_by_levels(folder / "one.h5");
  for (const int size : std::span(shared.ranks).first(by_all ? shared.ranks.size() : 1)) {
    INFO(size << " ranks");
    const Outcome all = with_ranks(size, [&](auto& rank) { return run(problem, on(rank, folder / "all.h5")); });
    CHECK(all.status == ExitStatus::done);
    CHECK(distance(folder / "one.h5", folder / "all.h5") <= allowed);
    CHECK(with_ranks(size, [&](auto& rank) { return check(folder / "all.h5", {.ranks = &rank}); }).status ==
          ExitStatus::done);
    CHECK(check(folder / "all.h5", {}).status == ExitStatus::done);
    // Ended, and continued: by as many ranks with the same bits, by one process to rounding.
    Settings sooner = shared.scheme;
    sooner.emplace_back("scheme.until=0.06");
    for (const int others : {size, 1}) {
      static_cast<void>(
          with_ranks(size, [&](auto& rank) { return run(shared.make(sooner), on(rank, folder / "part.h5")); }));
      const Outcome resumed = with_ranks(others, [&](auto& rank) {
        return resume(folder / "part.h5", problem.scheme.until, {.threads = 1, .ranks = &rank});
      });
      CHECK(resumed.status == ExitStatus::done);
      CHECK(distance(folder / "one.h5", folder / "part.h5") <= allowed);
      if (others == size) {
        CHECK(different_on_ranks(folder / "all.h5", folder / "part.h5") == Names{});
      }
    }
  }
  // The twin: numbers on their way from one rank to another, again and again, as Newton's method mends the rest.
  Mailboxes tampered(2);
  tampered.tamper_with([sent = 0](int, std::vector<double>& numbers) mutable {
    if (numbers.size() >= 16 && ++sent > 20) {
      numbers.front() += 1e-3;
    }
  });
  std::filesystem::remove(folder / "all.h5");
  static_cast<void>(with_ranks(tampered, [&](auto& rank) { return said_of(problem, on(rank, folder / "all.h5")); }));
  // Where the first level is not found with such numbers there is no record.
  CHECK((!std::filesystem::exists(folder / "all.h5") || distance(folder / "one.h5", folder / "all.h5") > allowed));
}

}  // namespace

TEST_CASE("potentials in the plane and in space are shared, equal to rounding, and continued with the same bits",
          "[long]") {
  check_shared_potentials(false);
}

TEST_CASE("potentials in the plane and in space are shared by more ranks, too", "[long]") {
  check_shared_potentials(true);
}

TEST_CASE("ranks say of their parts of a first level what is said of the whole") {
  const Folder folder;
  struct Case {
    Problem problem;
    std::string part;  ///< of what is said; empty: nothing is
  };
  const auto cases = std::vector<Case>{
      {kadomtsev_petviashvili({}), ""},
      // On 24 x 20 nodes 0.5 and 0.6 apart: u of 0.3 cannot be φ_x, one sawtooth along both axes and, of 1e-13, none.
      {kadomtsev_petviashvili({"initial.u=0.3*cos(2*pi*x)*cos(pi*y/0.6)"}), "holds the sawtooth (-1)^i"},
      {kadomtsev_petviashvili({"initial.u=1e-13*cos(2*pi*x)*cos(pi*y/0.6) - 0.2*x*exp(-(x^2 + y^2)/3)"}), ""},
      // A slope that jumps where the last rank's part meets the first one's.
      {zakharov_kuznetsov({"grid.x.cells=25", "grid.y.cells=21", "initial.u=y"}), "jump"},
      // Fields that contradict their constraint, which the whole is needed for.
      {zakharov_kuznetsov({"grid.x.cells=25", "grid.y.cells=21", "initial.v=1"}), "initial.v"},
      {zakharov_kuznetsov({"grid.x.cells=25", "grid.y.cells=21", "initial.p=0"}),
       "p exists in the middle of steps only"},
  };
  for (const auto& [problem, part] : cases) {
    INFO(part);
    const auto one = said_of(problem, {.output = folder / "one.h5", .overwrite = true, .threads = 1});
    const auto all = with_ranks(3, [&](auto& rank) { return said_of(problem, on(rank, folder / "all.h5")); });
    CHECK(all == one);
    CHECK(one.empty() == part.empty());
    if (!part.empty() && !one.empty()) {
      CHECK_THAT(one.front(), Catch::Contains(part));
    }
  }
}

TEST_CASE("what ranks send for a level of the box scheme in the plane is transposes, planes, and some numbers") {
  // Of 59 x 63 nodes on two ranks: a message of fields to be transformed is of the 31 or 32 planes that a rank has, 16
  // of 32 columns each, two of which are padding; of ghosts, of one plane; all others are shorter.
  constexpr std::size_t x = 59, y = 63, columns = 32, modes = x / 2 + 1;
  const Folder folder;
  struct Sent {
    double transposes = 0.0, planes = 0.0, numbers = 0.0;
  };
  const auto sent = [&](int levels) {
    Mailboxes all(2);
    Sent result;
    all.tamper_with([&](int, std::vector<double>& numbers) {
      const auto size = static_cast<double>(numbers.size());
      if (numbers.size() % (y / 2 * columns) == 0 || numbers.size() % ((y + 1) / 2 * columns) == 0) {
        result.transposes += size;
      } else if (numbers.size() % x == 0) {
        result.planes += size;
      }
    });
    const Problem problem = read_problem(
        "sine-gordon-2d", Settings{"grid.x.cells=59", "grid.y.cells=63", "scheme.levels=fixed", "scheme.step=0.05",
                                   "output.every=1000", fmt::format("scheme.until={}", 0.05 * levels)});
    static_cast<void>(with_ranks(all, [&](auto& rank) { return run(problem, uncommitted_on(rank, folder / "a.h5")); }));
    result.numbers = static_cast<double>(all.sent());
    return result;
  };
  const Sent few = sent(10), many = sent(26);  // sizes of the energy are looked at every 16th level
  const auto of_level = [&](double Sent::*what) { return (many.*what - few.*what) / 16.0 / 2.0; };
  const double transposes = of_level(&Sent::transposes), planes = of_level(&Sent::planes),
               rest = of_level(&Sent::numbers) - transposes - planes;
  INFO(transposes << " numbers of transposes, " << planes << " of planes, " << rest << " others, of a level and rank");
  CHECK(transposes > 0.0);
  CHECK(planes > 0.0);
  CHECK(rest > 0.0);
  // Padding and all else is less than a tenth of what has to be sent; and the twin, of 5 × 5 nodes.
  const double least = transposes * static_cast<double>(modes) / columns + planes;
  CHECK(transposes + planes + rest < 1.1 * least);
  CHECK(rest > 0.1 * least * 5.0 * 5.0 / (x * y));
}

TEST_CASE("ranks agree on what is said of media that do not repeat") {
  // What breaks is reported to rank 0: data that do, beside a medium that does not; a medium that does in two rows.
  const auto medium = [](const std::string& scheme, const std::string& S, const std::string& u) {
    return parse_problem(fmt::format(R"toml(
[multisymplectic]
fields = ["u", "v", "w", "s"]
M = [["u", "v", -1]]
K.x = [["u", "w", 1]]
K.y = [["u", "s", 1]]
S = "{}"
[grid]
x = {{ from = 0, to = 1, cells = 32 }}
y = {{ from = 0, to = 1, cells = 33 }}
[initial]
u = "{}"
v = 0
[scheme]
lagrangian = "{}"
levels = "fixed"
step = 0.01
until = 0.05
)toml",
                                     S, u, scheme),
                         "medium.toml");
  };
  const Folder folder;
  for (const auto& [S, u] :
       {std::pair{"(v^2 - w^2 - s^2)/2 + (1 + y)*u^2/2", "y"},
        std::pair{"(v^2 - w^2 - s^2)/2 + (1 + y)*u^2/2", "sin(2*pi*x + 1)*sin(2*pi*y) + 2"},
        std::pair{"(v^2 - w^2 - (1 + y)*s^2)/2 + (1 + y)*u^2/2", "sin(2*pi*x + 1)*sin(2*pi*y) + 2"}}) {
    INFO(S << ", " << u);
    for (const std::string scheme : {"leapfrog", "euler-box"}) {
      const Problem problem = medium(scheme, S, u);
      const auto one = said_of(problem, {.output = folder / "one.h5", .overwrite = true, .threads = 1});
      CHECK_FALSE(one.empty());
      for (const int size : {2, 3}) {
        CHECK(with_ranks(size, [&](auto& rank) { return said_of(problem, on(rank, folder / "all.h5")); }) == one);
      }
    }
  }
}

TEST_CASE("ranks choose a first step in whatever units time is, and tell output before it") {
  const Folder folder;
  const Problem problem = wave_on_torus(
      9, 7,
      {"scheme.lagrangian=leapfrog", "scheme.step=auto", "scheme.energy_tolerance=1e-4", "scheme.until=5e-10",
       "output.times=[1e-10]", R"(verdict.accept=["energy", "law", "spectrum", "period", "resolution"])"});
  const Outcome one = run(problem, {.output = folder / "one.h5", .threads = 1});
  REQUIRE(one.status == ExitStatus::done);
  const Outcome all = with_ranks(2, [&](auto& rank) { return run(problem, on(rank, folder / "all.h5")); });
  CHECK(all.status == ExitStatus::done);
  const auto first_step = [&](const char* file) { return record::Reader(folder / file).read("/levels/h").front(); };
  CHECK(first_step("all.h5") == Approx(first_step("one.h5")));
}
