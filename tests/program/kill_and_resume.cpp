// kill_and_resume RUBATO KILLS: kills `rubato run` and `rubato resume` with SIGKILL at so many random moments, for an
// orbit and a lattice with every = 1 and 7: every other time some time after the start, else some time after the
// process has added levels to the record, however long a busy machine takes for that. Each time an ordinary reader has
// to open the record; in the end it is, dataset by dataset and bit by bit, that of a run never stopped. Exits 0 if all
// of this holds.

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
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

/// The levels in a record that may not be there yet.
std::size_t levels_in(const std::filesystem::path& file) {
  return std::filesystem::exists(file) ? rubato::record::Reader(file).rows("/levels/t") : 0;
}

/// Waits until a process has added levels to the record; false if it did not in five minutes.
bool wait_for_levels(const std::filesystem::path& file, std::size_t levels) {
  using namespace std::chrono_literals;
  for (const auto end = std::chrono::steady_clock::now() + 300s; std::chrono::steady_clock::now() < end;) {
    if (levels_in(file) > levels) {
      return true;
    }
    std::this_thread::sleep_for(50ms);
  }
  return false;
}

void kill_and_resume(const std::string& program, const sample::Folder& parent, bool lattice, int every,
                     std::mt19937& random) {
  const std::filesystem::path folder = parent / fmt::format("{}{}", lattice ? "lattice" : "orbit", every);
  std::filesystem::create_directory(folder);
  const std::string problem = (folder / "problem.toml").string();
  const std::string killed = (folder / "killed.h5").string();
  const std::string never = (folder / "never.h5").string();
  (lattice ? slow_problems::write_lattice : slow_problems::write_orbit)(problem, every);

  // Commits come every 2 seconds; what happens about them and between two of them is to be hit.
  std::uniform_int_distribution<int> milliseconds(1, 2500);
  int grown = 0;
  std::size_t levels = 0;
  for (int kill = 0; kill < kills; ++kill) {
    const bool is_new = !std::filesystem::exists(killed);
    const auto arguments = is_new ? std::vector<std::string>{"run", problem, "-o", killed, "--quiet"}
                                  : std::vector<std::string>{"resume", killed, "--quiet"};
    const pid_t child = start(program, arguments);
    const bool after_levels = kill % 2 == 1;
    if (after_levels) {
      expect(wait_for_levels(killed, levels), fmt::format("process {} adds levels to the record", kill + 1));
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(milliseconds(random)));
    ::kill(child, SIGKILL);
    const int status = wait_for(child);
    expect(status == -SIGKILL, fmt::format("the run is still going when it is killed; its status was {}", status));
    if (!std::filesystem::exists(killed)) {
      continue;  // killed before level 0
    }
    expect(opens_read_only(killed), fmt::format("an ordinary reader opens the record after kill {}", kill + 1));
    const std::size_t now = levels_in(killed);
    expect(after_levels ? now > levels : now >= levels, "no level is lost");
    if (kill % 5 == 4) {
      expect(wait_for(start(program, {"check", killed})) == 0, "the record of a run that was killed can be checked");
    }
    grown += now > levels ? 1 : 0;
    levels = now;
  }
  expect(grown >= kills / 2, fmt::format("half of the {} processes added levels; {} did", kills, grown));

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

  // The twin: a run whose step differs in the last digit is told apart.
  const std::string other = (folder / "other.h5").string();
  expect(wait_for(start(program, {"run", problem, "-o", other, "--force", "--set", "scheme.until=" + until, "--set",
                                  "scheme.step=0.10000000000000002", "--quiet"})) == 0,
         "the run of the twin ends well");
  expect(!sample::difference(killed, other).empty(), "a run of another step is told apart");
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) {
    fmt::print("usage: kill_and_resume RUBATO KILLS\n");
    return 2;
  }
  kills = std::atoi(argv[2]);
  try {
    const sample::Folder folder;
    std::mt19937 random(20);
    for (const bool lattice : {false, true}) {
      for (const int every : {1, 7}) {
        kill_and_resume(argv[1], folder, lattice, every, random);
      }
    }
  } catch (const std::exception& error) {
    fmt::print("FAILED: {}\n", error.what());
    return 1;
  }
  return failures == 0 ? 0 : 1;
}
