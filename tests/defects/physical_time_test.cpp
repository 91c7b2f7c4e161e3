// With time_scale everything that a user reads is of the physical time and of the energy H.

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <catch2/catch.hpp>

#include <rubato/record/reader.hpp>
#include <rubato/report/page.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/run.hpp>

#include "defects.hpp"
#include "folder.hpp"
#include "report/page_reader.hpp"

using namespace rubato;
using rubato::defect_tests::defect_file;
using rubato::record::Reader;

namespace {

const std::string file = "user-time-scale-bodies.toml";

Outcome run_bodies(const std::string& record, std::vector<std::string> settings) {
  settings.insert(settings.end(), {"output.interval=0.5", "events.level=a2"});
  return run(read_problem(defect_file(file), settings), {.output = record, .overwrite = true, .threads = 1});
}

/// The last of seven coordinates in every row.
std::vector<double> clock_of(const Reader& reader, const std::string& path) {
  const std::vector<double> q = reader.read(path);
  std::vector<double> times;
  for (std::size_t i = 6; i < q.size(); i += 7) {
    times.push_back(q[i]);
  }
  return times;
}

}  // namespace

TEST_CASE("in fictitious time table, output, events and page have the physical time and energy") {
  const tests::Folder folder;
  const std::string record = folder / "eight.h5";
  const Outcome ran = run_bodies(record, {});
  REQUIRE(ran.status == ExitStatus::done);
  const Reader reader(record);
  const std::vector<double> levels = reader.read("/levels/time"), states = clock_of(reader, "/states/q");
  CHECK(levels == states);
  // The twin: the levels themselves are of the fictitious time, which is another one.
  CHECK(std::abs(reader.read("/levels/t").back() - levels.back()) > 1.0);

  CHECK(ran.statistics.clock == levels.back());
  CHECK_THAT(to_table(ran), Catch::Contains(fmt::format("to t = {:.10g}, in fictitious time", levels.back())));
  CHECK_THAT(to_json(ran), Catch::Contains(fmt::format("\"t\": {:.17g}", levels.back())));
  // H of the figure eight, as a sum of three kinetic energies and three distances; the scheme is of order 8.
  REQUIRE(ran.statistics.invariants.front().name == "energy");
  CHECK(std::abs(ran.statistics.invariants.front().value.initial + 1.2871419917) < 1e-7);
  CHECK(ran.statistics.invariants.front().value.max() < 1e-6);

  const std::vector<double> output = reader.read("/output/t"), at_output = clock_of(reader, "/output/q");
  REQUIRE(output.size() == static_cast<std::size_t>(levels.back() / 0.5) + 1);
  for (std::size_t i = 0; i < output.size(); ++i) {
    CHECK(output[i] == 0.5 * static_cast<double>(i));
    CHECK(std::abs(at_output[i] - output[i]) <=
          8.0 * 2.3e-16 * levels.back());  // located to four roundings of the time
  }
  CHECK(reader.read("/events/level/t") == clock_of(reader, "/events/level/q"));
  CHECK(reader.rows("/events/level/t") > 1);

  const std::string data = sample::data_of(report::page(reader, {}));
  const std::vector<double> curve = sample::numbers_after(data, {R"("times":)", R"("levels":)"});
  CHECK(std::ranges::equal(curve, levels));
  for (const char* name : {"a1", "b2", "c1", "time"}) {
    CHECK(data.find(fmt::format(R"("name":"{}","group":"q")", name)) != std::string::npos);
  }
}

TEST_CASE("in fictitious time records are checked, continued and thinned like others") {
  const tests::Folder folder;
  for (const std::vector<std::string>& settings :
       {std::vector<std::string>{}, {"output.every=7"}, {"levels.every=5", "output.every=3"}}) {
    const std::string straight = folder / "straight.h5", stopped = folder / "stopped.h5";
    REQUIRE(run_bodies(straight, settings).status == ExitStatus::done);
    CHECK(check(straight).status == ExitStatus::done);
    CHECK(check(straight, {.replay = true}).status == ExitStatus::done);
    std::vector<std::string> shorter = settings;
    shorter.emplace_back("scheme.until=3");
    REQUIRE(run_bodies(stopped, shorter).status == ExitStatus::done);
    CHECK(resume(stopped, 6.32591398, {.threads = 1}).status == ExitStatus::done);
    for (const char* path : {"/levels/time", "/output/t", "/output/q", "/events/level/t", "/laws/energy"}) {
      CHECK(Reader(stopped).read(path) == Reader(straight).read(path));
    }
  }
}

TEST_CASE("states at physical times are those of a run in physical time") {
  const tests::Folder folder;
  const std::string fictitious = folder / "s.h5", physical = folder / "t.h5";
  REQUIRE(run_bodies(fictitious, {}).status == ExitStatus::done);
  const std::size_t rows = Reader(fictitious).rows("/output/t");
  Problem plain =
      read_problem(defect_file(file), std::vector<std::string>{"-hamiltonian.time_scale", "scheme.step=0.01",
                                                               "output.interval=0.5", "scheme.until=12"});
  REQUIRE(run(plain, {.output = physical, .overwrite = true, .threads = 1}).status == ExitStatus::done);
  const std::vector<double> in_s = Reader(fictitious).read("/output/q", rows - 1, 1),
                            in_t = Reader(physical).read("/output/q", rows - 1, 1);
  for (std::size_t i = 0; i < 6; ++i) {
    CHECK(std::abs(in_s[i] - in_t[i]) < 1e-6);  // Gauss, order 8, in steps of a hundredth of the period
  }
}
