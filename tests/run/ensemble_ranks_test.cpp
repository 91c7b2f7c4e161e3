// Members of an ensemble run by several ranks: here threads that pass messages in memory. tests/program/ranks.sh has
// the same with MPI.

#include <catch2/catch.hpp>

#include <atomic>
#include <cstdint>
#include <string>
#include <vector>

#include <rubato/ranks/packet.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/converge.hpp>
#include <rubato/run/ensemble.hpp>
#include <rubato/run/ensemble_ranks.hpp>

#include "problem/problem_texts.hpp"
#include "run/mailboxes.hpp"
#include "run/records.hpp"

using namespace rubato;
using namespace rubato::run_tests;
using Catch::Contains;

namespace {

Problem shared(const std::string& ensemble, const std::vector<std::string>& settings = {}) {
  return parse_problem(pendulum + "[ensemble]\n" + ensemble + "\n", "t.toml", settings);
}

/// So long that no rank is through with all of them while another one waits for a processor.
Problem twenty_members() {
  return shared("random = { count = 20, seed = 3, initial.p = \"normal(0, 1)\", parameters.k = \"uniform(1, 2)\" }",
                {"scheme.until=300", "events.top=p", "output.interval=7"});
}

/// Of one thread each.
RunOptions on(ranks::Communicator& ranks, const std::string& file) {
  return {.output = file, .overwrite = true, .threads = 1, .ranks = &ranks};
}

/// Runs an ensemble on ranks and calls `tamper` with each result that another rank hands in. Members go to who asks
/// first, so that rank 0 may have run all of them before another rank starts: then once more.
/// \return the outcome, and how many results others handed in
std::pair<EnsembleOutcome, int> run_with_help(
    int size, const Problem& problem, const std::string& file,
    const Mailboxes::Censor& tamper = [](ranks::Message&) {}) {
  EnsembleOutcome outcome;
  int handed_in = 0;
  for (int attempt = 0; attempt == 0 || (size > 1 && handed_in == 0 && attempt < 100); ++attempt) {
    outcome = with_ranks(
        size, [&](auto& rank) { return run_ensemble(problem, on(rank, file)); },
        [&](ranks::Message& message) {
          if (message.from > 0 && message.bytes.size() > 200) {
            ++handed_in;
            tamper(message);
          }
        });
  }
  return {std::move(outcome), handed_in};
}

}  // namespace

TEST_CASE("the record of an ensemble is the same for every number of ranks") {
  const Folder folder;
  const Problem problem = twenty_members();
  const EnsembleOutcome one = run_ensemble(problem, {.output = folder / "one.h5", .threads = 1});
  for (const int size : {1, 2, 3, 4, 25}) {  // the last has more ranks than there are members
    INFO(size << " ranks");
    const auto [all, handed_in] = run_with_help(size, problem, folder / "all.h5");
    CHECK(all.finished == 20);
    CHECK(different_datasets(folder / "one.h5", folder / "all.h5") == Names{});
    CHECK(to_json(all).substr(0, 400) == to_json(one).substr(0, 400));
    CHECK((handed_in > 0) == (size > 1));  // they do help
  }
  // The twin: one bit of what a rank sends back, the last of its first figure. Before it are the member, its status, a
  // text of no length, and how many figures there are.
  constexpr std::size_t first_figure = 4 * sizeof(std::uint64_t);
  run_with_help(3, problem, folder / "all.h5",
                [](ranks::Message& message) { message.bytes[first_figure] ^= std::byte{1}; });
  CHECK_FALSE(different_datasets(folder / "one.h5", folder / "all.h5").empty());
}

TEST_CASE("an ensemble is checked, interrupted and continued on other numbers of ranks") {
  const Folder folder;
  const Problem problem = twenty_members();
  static_cast<void>(run_ensemble(problem, {.output = folder / "one.h5", .threads = 1}));

  // The last rank is interrupted when it asks for its first member. The others may have run all members before rank 0
  // reads of it: then once more.
  EnsembleOutcome stopped;
  for (int attempt = 0; attempt == 0 || (stopped.status == ExitStatus::done && attempt < 100); ++attempt) {
    std::atomic<bool> stop = false;
    stopped = with_ranks(
        3, [&](auto& rank) { return run_ensemble(problem, on(rank, folder / "all.h5")); },
        [&](ranks::Message& message) { stop = stop || message.from == 2; }, &stop);
  }
  CHECK(stopped.status == ExitStatus::interrupted);
  CHECK_THAT(stopped.message, Contains("continue with `rubato resume"));
  REQUIRE(stopped.finished < 20);
  CHECK(record::Reader(folder / "all.h5").rows("/members/number") == stopped.finished);

  const EnsembleOutcome resumed =
      with_ranks(2, [&](auto& rank) { return resume_ensemble(folder / "all.h5", {.threads = 1, .ranks = &rank}); });
  CHECK(resumed.status == ExitStatus::done);
  CHECK(different_datasets(folder / "one.h5", folder / "all.h5") == Names{});

  const auto check = [&] {
    return with_ranks(4, [&](auto& rank) { return check_ensemble(folder / "all.h5", {.threads = 1, .ranks = &rank}); });
  };
  CHECK(check().status == ExitStatus::done);
  falsify(folder / "all.h5", "/members/last/p", 11, 1e-12);
  CHECK_THAT(check().message, Contains("/members/last/p of member 11"));
}

TEST_CASE("what goes wrong at a rank ends the whole as it would at one process") {
  const Folder folder;
  // Members that fail are reported; they do not end the others.
  const Problem failing = shared("grid = { scheme.max_steps = [1000, 5, 1000, 1000] }");
  const EnsembleOutcome outcome =
      with_ranks(3, [&](auto& rank) { return run_ensemble(failing, on(rank, folder / "a.h5")); });
  CHECK(outcome.statuses == std::vector{ExitStatus::done, ExitStatus::failed, ExitStatus::done, ExitStatus::done});
  CHECK_THAT(outcome.message, Contains("1 of 4 members ended early") && Contains("max_steps = 5 reached"));

  // A result that is cut off on its way.
  const Problem problem = twenty_members();
  const auto cut = [](ranks::Message& message) { message.bytes.resize(100); };
  CHECK_THROWS_WITH(run_with_help(2, problem, folder / "b.h5", cut), Contains("shorter than it says"));

  // Another version of the program: the first text of the work.
  const auto other_version = [](ranks::Message& message) {
    if (message.from == 0 && message.bytes.size() > 200) {
      message.bytes[8] ^= std::byte{1};
    }
  };
  CHECK_THROWS_WITH(with_ranks(
                        2, [&](auto& rank) { return run_ensemble(problem, on(rank, folder / "c.h5")); }, other_version),
                    Contains("on rank 1") && Contains("all have to be the same"));

  // A scheme that refuses the system, as only those see who run the member.
  const Problem refused = read_problem(
      "kdv", std::vector<std::string>{"ensemble={ grid = { scheme.lagrangian = [\"box\", \"leapfrog\"] } }",
                                      "scheme.until=0.1"});
  for (const int size : {1, 2, 3}) {
    CHECK_THROWS_WITH(with_ranks(size, [&](auto& rank) { return run_ensemble(refused, on(rank, folder / "d.h5")); }),
                      Contains("leapfrog is for equations of wave type"));
  }
}

TEST_CASE("an orbit is not shared by ranks, and says so before anything is written") {
  const Folder folder;
  const Problem orbit = parse_problem(pendulum, "t.toml");
  CHECK_THROWS_WITH(with_ranks(2, [&](auto& rank) { return run(orbit, on(rank, folder / "a.h5")); }),
                    Contains("t.toml:") && Contains("2 ranks cannot share") && Contains("without mpirun"));
  CHECK_THROWS_AS(with_ranks(2, [&](auto& rank) { return converge(orbit, {}, {.ranks = &rank}); }), ProblemError);
  CHECK_FALSE(std::filesystem::exists(folder / "a.h5"));
  // One rank is nobody else.
  CHECK(with_ranks(1, [&](auto& rank) { return run(orbit, on(rank, folder / "a.h5")); }).status == ExitStatus::done);
  CHECK_THROWS_WITH(with_ranks(2, [&](auto& rank) { return resume(folder / "a.h5", 200.0, {.ranks = &rank}); }),
                    Contains("a.h5") && Contains("without mpirun"));
}

TEST_CASE("packets hold what was put in, bit by bit, and nothing is read beyond their end") {
  const std::vector<double> numbers = {0.1, -0.0, std::nan("7"), 5e-324};
  ranks::Packet packet;
  packet.number(7).text("Γ").numbers(numbers).text("").numbers({});
  ranks::PacketReader reader(packet.bytes());
  CHECK(reader.number() == 7);
  CHECK(reader.text() == "Γ");
  const std::vector<double> read = reader.numbers();
  REQUIRE(read.size() == 4);
  CHECK(std::memcmp(read.data(), numbers.data(), sizeof(double) * 4) == 0);
  CHECK(reader.text().empty());
  CHECK(reader.numbers().empty());
  CHECK_THROWS_AS(reader.number(), std::runtime_error);
  for (std::size_t size = 0; size < packet.bytes().size() - 16; ++size) {
    ranks::PacketReader cut(packet.bytes().first(size));
    CHECK_THROWS_AS((cut.number(), cut.text(), cut.numbers()), std::runtime_error);
  }
  // A length beyond all bounds asks for no memory.
  const ranks::Packet long_text = std::move(ranks::Packet().number(~std::uint64_t{0} / 8));
  CHECK_THROWS_AS(ranks::PacketReader(long_text.bytes()).numbers(), std::runtime_error);
}
