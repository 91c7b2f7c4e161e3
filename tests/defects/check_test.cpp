// What is reported on a run is true: laws without a value, energies of steps before the law, records that were altered;
// and it is the same the caller that shows it.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <hdf5.h>

#include <rubato/figures/text.hpp>
#include <rubato/problem/browse.hpp>
#include <rubato/problem/problem.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/report/comparison.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/run.hpp>

#include "defects.hpp"

using namespace rubato;
using namespace rubato;
using Catch::Matchers::Contains;
using Catch::Matchers::StartsWith;
using rubato::defect_tests::defect_file;
using rubato::tests::Folder;

namespace {

Outcome run_file(const std::string& name, const std::string& file, const std::vector<std::string>& settings = {},
                 bool tangents = false) {
  return run(read_problem(name, settings), {.output = file, .overwrite = true, .threads = 1, .tangents = tangents});
}

/// All of an outcome that was found wrong, one a line.
std::string found_wrong(const Outcome& outcome) {
  std::string text;
  for (const Disagreement& disagreement : outcome.disagreements) {
    text += to_string(disagreement) + "\n";
  }
  return text;
}

bool names(const Outcome& outcome, const std::string& dataset) {
  return outcome.status == ExitStatus::contradiction &&
         std::ranges::find(outcome.disagreements, dataset, &Disagreement::dataset) != outcome.disagreements.end();
}

/// The numbers of a dataset, changed and written back through HDF5, so that its checksums are those of what it holds.
void alter(const std::string& file, const std::string& path, std::size_t index,
           const std::function<double(double)>& change) {
  const hid_t id = H5Fopen(file.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  REQUIRE(id >= 0);
  const hid_t set = H5Dopen2(id, path.c_str(), H5P_DEFAULT);
  const hid_t space = H5Dget_space(set);
  std::vector<double> values(static_cast<std::size_t>(H5Sget_simple_extent_npoints(space)));
  H5Dread(set, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data());
  values.at(index) = change(values.at(index));
  H5Dwrite(set, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data());
  H5Sclose(space);
  H5Dclose(set);
  H5Fclose(id);
}

/// The part of a JSON object from "steps" on that shows figures, which ends with what only one of them knows.
std::string figures_in(const std::string& json) {
  const std::size_t begin = json.find("\"steps\"");
  std::size_t end = json.size();
  for (const char* key : {", \"wall_seconds\"", ", \"file\"", "}, {\"file\"", "}], \"problem_differences\""}) {
    end = std::min(end, json.find(key, begin));
  }
  return json.substr(begin, end - begin);
}

/// check shows the residual of the step equation in addition.
std::string without_step_equation(Outcome outcome) {
  std::erase_if(outcome.statistics.residuals, [](const auto& residual) { return residual.name == "step_equation"; });
  return figures_in(to_json(outcome));
}

std::string lines_without(const figures::Statistics& statistics) {
  std::vector<std::string> lines;
  for (const figures::Line& line : figures::lines_of(statistics)) {
    lines.push_back(line.label + ": " + line.value);
  }
  std::ranges::sort(lines);
  return fmt::format("{}", fmt::join(lines, "\n"));
}

/// The members of a JSON object and of those in it, in alphabetical order.
std::vector<std::string> members(std::string json) {
  std::vector<std::string> all;
  for (std::size_t end = 0; end != std::string::npos;) {
    end = json.find(", ");
    std::string member = json.substr(0, end);
    std::erase_if(member, [](char c) { return c == '{' || c == '}'; });
    for (const char* group : {"\"residuals\": ", "\"totals\": ", "\"invariants\": ", "\"error\": "}) {
      if (member.starts_with(group)) {
        member = member.substr(std::string(group).size());
      }
    }
    all.push_back(member);
    json = end == std::string::npos ? "" : json.substr(end + 2);
  }
  std::ranges::sort(all);
  return all;
}

}  // namespace

TEST_CASE("levels at which Gamma has no value are counted", "[defects]") {
  // A motion to infinity: at its last levels Γ overflows.
  const Folder folder;
  const std::string file = folder / "a.h5";
  const auto run_to = [&](const char* until) {
    const std::vector<std::string> settings = {"hamiltonian.H=p^2/2 - 1.223*q^3",
                                               "initial.q=-0.4491",
                                               "initial.p=-0.7594",
                                               "scheme.lagrangian=splitting",
                                               "scheme.step=0.05",
                                               "scheme.levels=fixed",
                                               until};
    return run(read_problem("pendulum", settings), RunOptions{.output = file, .overwrite = true});
  };
  const Outcome ran = run_to("scheme.until=8");
  const record::Reader reader(file);
  const auto undefined =
      std::ranges::count_if(reader.read("/levels/gamma"), [](double g) { return !std::isfinite(g); });
  REQUIRE(undefined > 0);
  CHECK_THAT(to_json(ran), Contains(fmt::format("\"undefined\": {}", undefined)));
  CHECK_THAT(to_table(ran), Contains(fmt::format("no value in {} of {} levels", undefined, ran.statistics.steps + 1)));
  CHECK_THAT(to_json(run_to("scheme.until=2")), !Contains("undefined"));  // the twin
}

TEST_CASE("a law that has no value in some cells says in how many", "[defects]") {
  const Folder folder;
  const std::string file = folder / "a.h5";
  const Outcome ran = run_file(defect_file("undefined-law.toml"), file);
  REQUIRE(ran.status == ExitStatus::done);
  const Outcome checked = check(file);
  CHECK(checked.status == ExitStatus::done);
  const record::Reader reader(file);
  const report::Comparison comparison = report::compare(reader, reader);
  double undefined = 0.0;
  for (const double cells : reader.read("/laws/momentum_undefined")) {
    undefined += cells;
  }
  REQUIRE(undefined > 0.0);
  const std::string json = fmt::format("\"undefined\": {:.0f}", undefined);
  const std::string words = fmt::format("no value in {:.0f} of {} cells", undefined, 33 * ran.statistics.steps);
  for (const std::string& reported : {to_json(ran), to_json(checked), report::to_json(comparison)}) {
    CHECK_THAT(reported, Contains(json) && !Contains("nan"));
  }
  for (const std::string& reported : {to_table(ran), to_table(checked), report::to_table(comparison)}) {
    CHECK_THAT(reported, Contains(words) && !Contains("nan"));
  }
  CHECK_THAT(ran.warnings.front(), Contains("momentum has no value in"));
  // The twin: far from the edge of the domain every cell has a value.
  const Outcome sound =
      run_file(defect_file("undefined-law.toml"), file, {"initial.u=\"-0.005 - cos(x - 16*2*pi/33)/2\""});
  CHECK_THAT(to_json(sound), !Contains("undefined"));
  CHECK(sound.warnings.empty());
}

TEST_CASE("with fixed levels and every = 7 states off by 1e-4 are found", "[defects]") {
  const Folder folder;
  const std::string file = folder / "a.h5";
  for (const char* path : {"/states/q", "/states/p", "/states/previous/q", "/states/previous/p"}) {
    INFO(path);
    REQUIRE(run_file(defect_file("fixed7.toml"), file).status == ExitStatus::done);
    CHECK(found_wrong(check(file)).empty());
    alter(file, path, 5, [](double value) { return value + 1e-4; });
    const Outcome checked = check(file);
    CHECK(names(checked, path));
    // Not by its checksum alone: the step between the two stored levels does not solve its equation.
    CHECK_THAT(found_wrong(checked), Contains("leaves of its equation"));
  }
}

TEST_CASE("plain steps before the law are measured by its E", "[defects]") {
  const Folder folder;
  const std::string file = folder / "a.h5";
  static_cast<void>(run_file(defect_file("start-plain-90.toml"), file));
  const record::Reader reader(file);
  const std::vector<double> energy = reader.read("/levels/energy"), target = reader.read("/levels/target"),
                            off_law = reader.read("/levels/off_law");
  const figures::Statistics& reported = check(file).statistics;
  if (const auto first = std::ranges::find(off_law, 0.0); first != off_law.end()) {
    const double E = energy[static_cast<std::size_t>(first - off_law.begin())];
    CHECK(reported.energy() == E);
    double worst = 0.0;
    for (std::size_t k = 0; k < energy.size(); ++k) {
      worst = off_law[k] != 0.0 ? std::max(worst, std::abs(energy[k] - E)) : worst;
    }
    CHECK(reported.off_law_deviation() == worst);
    CHECK(std::isnan(target.front()) == (off_law.front() != 0.0));
  } else {
    CHECK_THAT(lines_without(reported), Contains("no step met the energy law"));
  }
}

TEST_CASE("where every step is off the law no deviation of 0 is told", "[defects]") {
  const Folder folder;
  const std::string file = folder / "a.h5";
  const Outcome ran = run_file(defect_file("every-step-off-law.toml"), file);
  const std::vector<double> energy = record::Reader(file).read("/levels/energy");
  const auto [least, greatest] = std::ranges::minmax(energy);
  if (ran.statistics.off_law_steps == ran.statistics.steps) {
    CHECK(ran.statistics.off_law_deviation() ==
          std::max(std::abs(least - energy.front()), std::abs(greatest - energy.front())));
    CHECK_THAT(to_table(ran), Contains("no step met the energy law"));
    CHECK_THAT(to_json(ran), !Contains("max_relative_deviation"));
  } else {
    CHECK(ran.statistics.off_law_deviation() >= 0.5 * (greatest - least) - 1e-9);
  }
  CHECK(found_wrong(check(file)).empty());
}

TEST_CASE("steps that all keep the law stray by 0 of it, of an energy of 0, too", "[defects]") {
  const Folder folder;
  const auto json = [&](const char* name, const std::vector<std::string>& settings) {
    return to_json(run_file(name, folder / (std::string(name) + ".h5"), settings));
  };
  CHECK_THAT(json("pendulum", {"initial.p=0", "hamiltonian.H=p^2/2 + 1 - cos(q)", "scheme.until=2"}),
             Contains("\"off_law\": {\"steps\": 0, \"max_deviation\": 0}"));
  // The twin: the orbit crosses places where no step keeps the energy.
  CHECK_THAT(json("pendulum-rotation", {"scheme.until=20"}),
             Contains("\"off_law\": {\"steps\": ") && !Contains("\"max_deviation\": 0}"));
}

TEST_CASE("energies that are 0 to rounding have no relative deviation", "[defects]") {
  const Folder folder;
  const Outcome ran =
      run_file("maxwell", folder / "a.h5", {"scheme.until=2", "grid.x.cells=5", "grid.y.cells=5", "grid.z.cells=5"});
  CHECK_THAT(to_json(ran), !Contains("max_relative_deviation") && Contains("\"max_deviation\""));
  CHECK_THAT(to_table(ran), !Contains("relative deviation") && Contains("absolute"));
  // The twin.
  CHECK_THAT(to_table(run_file("pendulum", folder / "a.h5", {"scheme.until=2"})), Contains("relative deviation"));
}

TEST_CASE("run, check, compare and report tell the same figures of a record", "[defects]") {
  const Folder folder;
  const std::string file = folder / "a.h5";
  struct Case {
    std::string problem;
    std::vector<std::string> settings;
  };
  const std::vector<Case> cases = {
      {"pendulum-rotation", {"scheme.until=20"}},
      {"pendulum-rotation", {"scheme.until=20", "scheme.on_singular=plain"}},
      {"kepler", {"parameters.e=0.85", "scheme.until=7"}},
      {"kepler", {"scheme.until=7", "scheme.levels=fixed"}},
      {"henon-heiles", {"scheme.until=10", "scheme.lagrangian=generating", "scheme.order=4"}},
      {"pendulum", {"scheme.max_steps=20"}},
      {"sine-gordon", {"grid.x.cells=51", "scheme.until=2"}},
      {"nls", {"grid.x.cells=51", "scheme.until=0.5", "scheme.levels=fixed"}},
      {"kdv", {"grid.x.cells=51", "scheme.until=0.2", "scheme.lagrangian=fourier"}},
      {defect_file("undefined-law.toml"), {}},
      {defect_file("start-plain-90.toml"), {}},
      {defect_file("every-step-off-law.toml"), {}},
  };
  for (const Case& one : cases) {
    for (const char* every : {"1", "3", "16"}) {
      INFO(one.problem << ", every " << every);
      std::vector<std::string> settings = one.settings;
      settings.push_back(std::string("output.every=") + every);
      const Outcome ran = run_file(one.problem, file, settings);
      const Outcome checked = check(file);
      CHECK(found_wrong(checked).empty());
      const record::Reader reader(file);
      const report::Comparison comparison = report::compare(reader, reader);
      const std::string reported = figures_in(to_json(ran));
      CHECK(members(without_step_equation(checked)) == members(reported));
      CHECK(members(figures_in(report::to_json(comparison))) == members(reported));
      // The table of a page is made of these lines.
      CHECK(lines_without(comparison.statistics[0]) == lines_without(ran.statistics));
      CHECK_THAT(to_table(ran), Contains(figures::lines_of(comparison.statistics[0])[2].value));
    }
  }
}

TEST_CASE("records that nobody altered agree with themselves", "[defects]") {
  const Folder folder;
  const std::string file = folder / "a.h5";
  for (const CatalogueItem& item : list_catalogue()) {
    const Problem problem = read_problem(item.name);
    std::vector<std::string> settings = {"scheme.max_steps=20"};
    if (item.is_lattice) {
      const auto& axes = problem.multisymplectic()->axes;
      const int cells[] = {51, 15, 5};
      for (const GridAxis& axis : axes) {
        settings.push_back(fmt::format("grid.{}.cells={}", axis.name, cells[axes.size() - 1]));
      }
      settings.front() = "scheme.max_steps=6";
    }
    for (const char* every : {"1", "3", "16"}) {
      INFO(item.name << ", every " << every);
      settings.push_back(std::string("output.every=") + every);
      static_cast<void>(run_file(item.name, file, settings));
      CHECK(found_wrong(check(file)).empty());
      static_cast<void>(resume(file, std::nullopt, {.threads = 1}));
      settings.pop_back();
    }
  }
}

TEST_CASE("energies of a custom L with a long prediction agree with their states", "[defects]") {
  // The prediction is off by the size of the state, and so was the derivative by which E was corrected.
  const Folder folder;
  const std::string file = folder / "a.h5";
  const Problem problem = parse_problem(R"toml(
[hamiltonian]
q = ["x"]
p = ["u"]
H = "(x^2 + 1)*(u^2 + 1)/2"
[initial]
x = 1.004
u = 1.175
[scheme]
lagrangian = "custom"
L = "(u_0 + u_1)/2*(x_1 - x_0)/(t_1 - t_0) - 0.5*((x_0^2 + 1)*(u_0^2 + 1)/2 + (x_1^2 + 1)*(u_1^2 + 1)/2)"
levels = "fixed"
step = -0.1816
until = -11.44
)toml",
                                        "a.toml");
  REQUIRE(run(problem, {.output = file, .threads = 1}).status == ExitStatus::lost);  // long steps on purpose
  CHECK(found_wrong(check(file)).empty());
  alter(file, "/levels/energy", 29, [](double value) { return value + 3e-12; });
  CHECK(names(check(file), "/levels/energy"));
}

TEST_CASE("linear waves with a constant in S agree with themselves", "[defects]") {
  const Folder folder;
  const std::string file = folder / "a.h5";
  for (const char* S : {"(v^2 - w^2 + u^2)/2 - 700", "(v^2 - w^2 + u^2)/2"}) {
    for (const char* stages : {"1", "3"}) {
      INFO(S << ", stages " << stages);
      REQUIRE(run_file("sine-gordon", file,
                       {std::string("multisymplectic.S=\"") + S + "\"", "grid.x.cells=31", "scheme.until=1",
                        "scheme.lagrangian=fourier", std::string("scheme.stages=") + stages})
                  .status == ExitStatus::done);
      CHECK(found_wrong(check(file)).empty());
      alter(file, "/levels/energy", 2, [](double value) { return value + 1e-4; });
      CHECK(names(check(file), "/levels/energy"));
    }
  }
}

TEST_CASE("sound records of steps that are hard to find again are not accused", "[defects]") {
  const Folder folder;
  const std::string sound = folder / "sound.h5", file = folder / "a.h5";
  for (const char* name :
       {"check-false-alarm", "check-false-alarm-3", "check-false-alarm-4", "check-false-alarm-lattice"}) {
    INFO(name);
    static_cast<void>(run_file(defect_file(fmt::format("{}.toml", name)), sound));  // one ends with status 4
    const Outcome checked = check(sound);
    CHECK(found_wrong(checked).empty());
    // What is altered is found all the same: by more than rounding, the sizes being about 1.
    const bool is_lattice = std::string(name).ends_with("lattice");
    for (const std::string path : {is_lattice ? "/states/u" : "/states/p", "/levels/energy", "/levels/node_energy"}) {
      std::filesystem::copy_file(sound, file, std::filesystem::copy_options::overwrite_existing);
      const record::Reader reader(sound);
      const std::size_t last = reader.rows(path) * reader.info(path).row_size() - 1;
      alter(file, path, last, [](double value) { return value * (1.0 + 1e-4); });
      CHECK(names(check(file), path));
    }
  }
}

TEST_CASE("runs that were resumed or replayed agree with themselves, with every scheme", "[defects]") {
  const Folder folder;
  const std::string file = folder / "a.h5";
  struct Case {
    std::string problem;
    std::vector<std::string> settings;
    bool tangents = false;
  };
  const std::vector<Case> cases = {
      {"pendulum", {"scheme.until=3"}},
      {"pendulum", {"scheme.until=3", "scheme.levels=fixed"}},
      {"pendulum-rotation", {"scheme.until=8"}},
      {"pendulum", {"scheme.until=3", "scheme.lagrangian=generating", "scheme.order=6"}},
      {"pendulum",
       {"scheme.until=3", "scheme.lagrangian=generating", "scheme.order=3", "scheme.darboux=euler-a",
        "scheme.levels=fixed"}},
      {"pendulum",
       {"scheme.until=2", "scheme.lagrangian=custom", "scheme.levels=fixed",
        "scheme.L=(p_0+p_1)/2*(q_1-q_0)/(t_1-t_0)-((p_0+p_1)/2)^2/2+(cos(q_0)+cos(q_1))/2"}},
      {"sine-gordon", {"grid.x.cells=51", "scheme.until=1"}, true},
      {"sine-gordon",
       {"grid.x.cells=51", "scheme.until=1", "scheme.lagrangian=euler-box", "scheme.levels=fixed"},
       true},
      {"sine-gordon", {"grid.x.cells=51", "scheme.until=1", "scheme.lagrangian=fourier"}},
      {"sine-gordon", {"grid.x.cells=51", "scheme.until=1", "scheme.lagrangian=leapfrog"}},
      {"bbm", {"grid.x.cells=51", "scheme.until=0.5"}},
  };
  for (const Case& one : cases) {
    for (const char* every : {"1", "3"}) {
      INFO(one.problem << ", " << fmt::format("{}", fmt::join(one.settings, ", ")) << ", every " << every);
      std::vector<std::string> settings = one.settings;
      settings.push_back(std::string("output.every=") + every);
      settings.emplace_back("scheme.max_steps=7");
      static_cast<void>(run_file(one.problem, file, settings, one.tangents));
      CHECK(found_wrong(check(file)).empty());
      settings.pop_back();
      CHECK(run_file(one.problem, file, settings, one.tangents).status == ExitStatus::done);
      const double t = record::Reader(file).read("/levels/t").back();
      CHECK(resume(file, t + 1.0, {.threads = 1}).status == ExitStatus::done);
      const Outcome replayed = check(file, {.replay = true});
      CHECK(found_wrong(replayed).empty());
      CHECK(replayed.status == ExitStatus::done);
    }
  }
}

namespace {

/// Alters numbers of two records, one at a time: `part` of every five combinations of a number and a way to alter it.
void check_altered_numbers(int part, int least) {
  const Folder folder;
  const std::string sound = folder / "sound.h5", file = folder / "a.h5";
  const double none = std::numeric_limits<double>::quiet_NaN();
  for (const bool lattice : {false, true}) {
    const Outcome ran = lattice
                            ? run_file("nls", sound, {"grid.x.cells=15", "scheme.until=0.2", "output.every=3"}, true)
                            : run_file("pendulum-rotation", sound, {"scheme.until=6", "output.every=3"});
    REQUIRE(ran.complete);
    REQUIRE(found_wrong(check(sound)).empty());
    int altered = 0, number = 0;
    const record::Reader reader(sound);
    for (const record::DatasetInfo& info : reader.datasets()) {
      if (info.is_text || info.path.starts_with("/checkpoint")) {
        continue;
      }
      const std::size_t size = info.shape.front() * info.row_size();
      for (const std::size_t index : {std::size_t{0}, size / 2, size - 1}) {
        for (const int kind : {0, 1, 2}) {
          if (info.type != record::Type::f64 ? kind != 1 : ++number % 5 >= part) {
            continue;  // the others are for another day
          }
          std::filesystem::copy_file(sound, file, std::filesystem::copy_options::overwrite_existing);
          bool same = false;
          alter(file, info.path, index, [&](double value) {
            const double changed = kind == 0   ? (value == 0.0 ? 1e-4 : value * (1.0 + 1e-4))
                                   : kind == 1 ? value + 1.0
                                               : none;
            // What is left of a law that holds is rounding, of states of size 1; part of that cannot be distinguished.
            same = std::abs(changed - value) < 1e-13 || (std::isnan(changed) && std::isnan(value));
            return changed;
          });
          if (same) {
            continue;
          }
          ++altered;
          INFO(info.path << "[" << index << "], kind " << kind);
          Outcome checked;
          try {
            checked = check(file);
          } catch (const record::Error& error) {  // no record at all: levels out of order, and the like
            CHECK_THAT(error.what(), Contains("'" + info.path + "'"));
            continue;
          }
          CHECK(checked.status == ExitStatus::contradiction);
          // Links to axes: the dataset is named by where it belongs.
          const std::string last = info.path.substr(info.path.rfind('/') + 1);
          CHECK(std::ranges::any_of(checked.disagreements, [&](const Disagreement& disagreement) {
            return disagreement.dataset == info.path || disagreement.dataset.ends_with("/" + last);
          }));
        }
      }
    }
    CHECK(altered > least);
  }
}

}  // namespace

TEST_CASE("numbers of a record that are altered are found, and their datasets named", "[defects]") {
  check_altered_numbers(1, 30);
}
TEST_CASE("every number of a record that is altered is found, and its dataset named", "[defects][long]") {
  check_altered_numbers(5, 120);
}

TEST_CASE("a record of another problem than the one written in it contradicts itself", "[defects]") {
  const Folder folder;
  const std::string file = folder / "a.h5";
  const auto write_problem = [&](const std::function<std::string(std::string)>& change) {
    const std::string text = change(record::Reader(file).header().problem);
    const char* pointer = text.c_str();
    const hid_t id = H5Fopen(file.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
    REQUIRE(H5Adelete(id, "problem") >= 0);
    const hid_t type = H5Tcopy(H5T_C_S1);
    H5Tset_size(type, H5T_VARIABLE);
    H5Tset_cset(type, H5T_CSET_UTF8);
    const hid_t space = H5Screate(H5S_SCALAR);
    const hid_t attribute = H5Acreate2(id, "problem", type, space, H5P_DEFAULT, H5P_DEFAULT);
    REQUIRE(H5Awrite(attribute, type, &pointer) >= 0);
    H5Aclose(attribute);
    H5Sclose(space);
    H5Tclose(type);
    H5Fclose(id);
  };
  const auto with = [&](const std::string& name, const std::string& setting) {
    return [name, setting](const std::string& text) { return parse_problem(text, name, std::vector{setting}).text; };
  };
  for (const char* setting : {"scheme.step=0.11", "initial.p=1.8", "hamiltonian.H=\"p^2/2 - 1.01*cos(q)\"",
                              "output.every=2", "initial.q=0.1", "scheme.levels=fixed"}) {
    INFO(setting);
    static_cast<void>(run_file("pendulum", file, {"scheme.until=3"}));
    write_problem(with(file, setting));
    CHECK(check(file).status == ExitStatus::contradiction);
  }
  static_cast<void>(run_file("sine-gordon", file, {"scheme.until=0.5", "grid.x.cells=51"}));
  write_problem(with(file, "grid.x.cells=53"));  // not even a record of it
  CHECK_THROWS_WITH(check(file), Contains("'/grid/x' has 51 values; by the problem it should have 53"));
  for (const char* setting : {"parameters.omega=0.6", "grid.x.to=21"}) {
    INFO(setting);
    static_cast<void>(run_file("sine-gordon", file, {"scheme.until=0.5", "grid.x.cells=51"}));
    write_problem(with(file, setting));
    CHECK(check(file).status == ExitStatus::contradiction);
  }
  static_cast<void>(run_file("pendulum", file, {"scheme.until=3"}));  // the twin: the same text again
  write_problem([](std::string text) { return text + "\n# a comment\n"; });
  const Outcome commented = check(file);
  CHECK(commented.disagreement_count == 1);
  CHECK_THAT(found_wrong(commented), StartsWith("attribute problem"));
}
