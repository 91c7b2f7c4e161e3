// kill_and_resume RUBATO KILLS: kills `rubato run` and `rubato resume` with SIGKILL at so many random moments, for an
// orbit and a lattice with every = 1 and 7, and for ensembles of orbits, alone and side by side: every other time some
// time after the start, else some time after the process has added levels to the record, however long a busy machine
// takes for that. Each time an ordinary reader has to open the record; in the end it is, dataset by dataset and bit by
// bit, that of a run never stopped. Exits 0 if all of this holds.

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include <fmt/format.h>
#include <hdf5.h>

#include <rubato/record/reader.hpp>

#include "children.hpp"
#include "expect.hpp"
#include "record/sample.hpp"
#include "slow_problems.hpp"

namespace {

int kills = 20;
using children::expect;
using children::failures;

using children::start;

int wait_for(pid_t child) {
  return children::wait_for(child).status;
}

/// HDF5 alone, with its own locks, without this library.
bool opens_read_only(const std::filesystem::path& file) {
  const hid_t id = H5Fopen(file.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
  if (id < 0) {
    return false;
  }
  H5Fclose(id);
  return true;
}

/// What a record counts that may not be there yet: its levels, or members.
struct Growing {
  std::filesystem::path file;
  std::string dataset;
  std::size_t most = std::numeric_limits<std::size_t>::max();  ///< with more, no process is killed

  [[nodiscard]] std::size_t rows() const {
    return std::filesystem::exists(file) ? rubato::record::Reader(file).rows(dataset) : 0;
  }
};

/// Waits until a process has added rows to the record; false if it did not in five minutes.
bool wait_for_rows(const Growing& record, std::size_t rows) {
  using namespace std::chrono_literals;
  for (const auto end = std::chrono::steady_clock::now() + 300s; std::chrono::steady_clock::now() < end;) {
    if (record.rows() > rows) {
      return true;
    }
    std::this_thread::sleep_for(50ms);
  }
  return false;
}

/// Kills processes that run `problem`, or go on with it, into the record, until it has `most` rows; `options` are
/// theirs. Returns how many of them had added rows.
int kill_again_and_again(const std::string& program, const std::string& problem, const Growing& record,
                         const std::vector<std::string>& options, std::mt19937& random) {
  const std::string killed = record.file.string();
  // Commits come every 2 seconds; what happens about them and between two of them is to be hit.
  std::uniform_int_distribution<int> milliseconds(1, 2500);
  int grown = 0, kill = 0;
  std::size_t levels = 0;
  for (; kill < kills && levels <= record.most; ++kill) {
    const bool is_new = !std::filesystem::exists(killed);
    auto arguments = is_new ? std::vector<std::string>{"run", problem, "-o", killed, "--quiet"}
                            : std::vector<std::string>{"resume", killed, "--quiet"};
    arguments.insert(arguments.end(), options.begin(), options.end());
    const pid_t child = start(program, arguments);
    const bool after_levels = kill % 2 == 1;
    if (after_levels) {
      expect(wait_for_rows(record, levels), fmt::format("process {} adds to the record", kill + 1));
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(milliseconds(random)));
    ::kill(child, SIGKILL);
    const int status = wait_for(child);
    expect(status == -SIGKILL, fmt::format("the run is still going when it is killed; its status was {}", status));
    if (!std::filesystem::exists(killed)) {
      continue;  // killed before level 0
    }
    expect(opens_read_only(killed), fmt::format("an ordinary reader opens the record after kill {}", kill + 1));
    const std::size_t now = record.rows();
    expect(after_levels ? now > levels : now >= levels, "nothing is lost");
    if (kill % 5 == 4 && options.empty()) {
      expect(wait_for(start(program, {"check", killed})) == 0, "the record of a run that was killed can be checked");
    }
    grown += now > levels ? 1 : 0;
    levels = now;
  }
  expect(grown >= kill / 2, fmt::format("half of the {} processes added something; {} did", kill, grown));
  return grown;
}

void kill_and_resume(const std::string& program, const sample::Folder& parent, bool lattice, int every,
                     std::mt19937& random) {
  const std::filesystem::path folder = parent / fmt::format("{}{}", lattice ? "lattice" : "orbit", every);
  std::filesystem::create_directory(folder);
  const std::string problem = (folder / "problem.toml").string();
  const std::string killed = (folder / "killed.h5").string();
  const std::string never = (folder / "never.h5").string();
  (lattice ? slow_problems::write_lattice : slow_problems::write_orbit)(problem, every);
  const Growing record{killed, "/levels/t"};
  const int grown = kill_again_and_again(program, problem, record, {}, random);
  const std::size_t levels = record.rows();

  const double last = rubato::record::Reader(killed).read("/levels/t").back();
  const std::string until = fmt::format("{:.17g}", last + 12.34);
  expect(wait_for(start(program, {"resume", killed, "--until", until, "--quiet"})) == 0, "the last resume ends well");
  expect(wait_for(start(program, {"run", problem, "-o", never, "--set", "scheme.until=" + until, "--quiet"})) == 0,
         "the run never stopped ends well");
  const std::string difference = sample::difference(killed, never);
  expect(difference.empty(), "the records are the same, bit by bit: " + difference);
  fmt::print("{}, every = {}: {} kills, {} of them after new levels, {} levels at the last; {}\n",
             lattice ? "lattice" : "orbit", every, kills, grown, levels,
             difference.empty() ? "records identical" : difference);

  // The twin: a run whose step differs in the last digit is distinguished.
  const std::string other = (folder / "other.h5").string();
  expect(wait_for(start(program, {"run", problem, "-o", other, "--force", "--set", "scheme.until=" + until, "--set",
                                  "scheme.step=0.10000000000000002", "--quiet"})) == 0,
         "the run of the twin ends well");
  expect(!sample::difference(killed, other).empty(), "a run of another step is told apart");
}

void kill_and_resume_ensemble(const std::string& program, const sample::Folder& parent, bool side_by_side,
                              std::mt19937& random) {
  const std::filesystem::path folder = parent / (side_by_side ? "side_by_side" : "ensemble");
  std::filesystem::create_directory(folder);
  const std::string problem = (folder / "problem.toml").string();
  const std::string killed = (folder / "killed.h5").string();
  const std::string never = (folder / "never.h5").string();
  const std::size_t all = side_by_side ? 6000 : 1000;
  (side_by_side ? slow_problems::write_members_side_by_side : slow_problems::write_ensemble)(problem,
                                                                                             static_cast<int>(all));
  kills = std::min(kills, 20);
  // On a fast machine fewer processes are killed: four fifths are left for the last ones.
  const Growing record{killed, "/members/number", all / 5};
  // One thread, so that there are members left however fast the machine is; the run never stopped takes all.
  const int grown = kill_again_and_again(program, problem, record, {"--threads", "1"}, random);
  const std::size_t members = record.rows();
  expect(members < all, fmt::format("members are left for the last process; there were {}", members));
  expect(wait_for(start(program, {"resume", killed, "--quiet"})) == 0, "the last resume ends well");
  expect(wait_for(start(program, {"run", problem, "-o", never, "--quiet"})) == 0,
         "the ensemble never stopped ends well");
  const std::string difference = sample::difference(killed, never);
  expect(difference.empty(), "the records are the same, bit by bit: " + difference);
  expect(record.rows() == all, "all members are there");
  fmt::print("ensemble of {}{}: {} kills, {} of them after new members, {} members at the last; {}\n", all,
             side_by_side ? " side by side" : "", kills, grown, members,
             difference.empty() ? "records identical" : difference);

  // The twin: an ensemble of another seed is distinguished.
  const std::string other = (folder / "other.h5").string();
  expect(wait_for(start(program, {"run", problem, "-o", other, "--set", "ensemble.random.seed=2", "--set",
                                  "scheme.until=10", "--quiet"})) == 0,
         "the ensemble of the twin ends well");
  expect(!sample::difference(killed, other).empty(), "an ensemble of another seed is told apart");
}

}  // namespace

int main(int argc, char** argv) {
  const bool ensemble_only = argc == 4 && std::string(argv[3]) == "ensemble";
  if (argc != 3 && !ensemble_only) {
    fmt::print("usage: kill_and_resume RUBATO KILLS [ensemble]\n");
    return 2;
  }
  kills = std::atoi(argv[2]);
  try {
    const sample::Folder folder;
    std::mt19937 random(20);
    for (const bool lattice : {false, true}) {
      for (const int every : {1, 7}) {
        if (ensemble_only) {
          continue;
        }
        kill_and_resume(argv[1], folder, lattice, every, random);
      }
    }
    for (const bool side_by_side : {false, true}) {
      kill_and_resume_ensemble(argv[1], folder, side_by_side, random);
    }
  } catch (const std::exception& error) {
    fmt::print("FAILED: {}\n", error.what());
    return 1;
  }
  return failures == 0 ? 0 : 1;
}
