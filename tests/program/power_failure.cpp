// power_failure RUBATO IMAGES: what a power failure leaves of records on a file system that reorders what it writes.
// `rubato run`, `resume` and `run --force` write the records of an orbit and a lattice on ext4, mounted as lazily as it
// can be, on a disk that keeps all requests (disk.hpp). For IMAGES random moments a disk is then made of which the
// power failed at that moment, mounted, and looked at: under the name of each record there has to be a version, no
// older than one that was waited for, `check` agrees with it, `resume` goes on from it to the record of a run never
// stopped, bit by bit, and nothing else is damaged. The twin is output.durable = false, which has to fail. Nothing is
// seen of the mounts from outside, and they end with this process, however it ends. Exits 77 where it may not mount.

#include <algorithm>
#include <array>
#include <chrono>
#include <compare>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <mutex>
#include <optional>
#include <random>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <sched.h>
#include <sys/mount.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <rubato/record/reader.hpp>

#include "children.hpp"
#include "disk.hpp"
#include "expect.hpp"
#include "record/sample.hpp"
#include "slow_problems.hpp"

namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

using children::expect;
using children::failures;

void command(const std::string& line) {
  if (std::system(line.c_str()) != 0) {
    throw std::runtime_error("this failed: " + line);
  }
}

/// A disk that is mounted while this lives.
class Mounted {
public:
  Mounted(const Disk& disk, const fs::path& folder, const std::string& options) : folder_(folder) {
    command(fmt::format("mount -t ext4 -o loop,noatime,{} '{}' '{}'", options, disk.file().string(), folder.string()));
  }
  Mounted(const Mounted&) = delete;
  Mounted& operator=(const Mounted&) = delete;
  ~Mounted() { static_cast<void>(std::system(fmt::format("umount '{}'", folder_.string()).c_str())); }

private:
  fs::path folder_;
};

/// Which version of a record: of the first run and its `resume`, or of the run that replaced it.
struct Version {
  int run = -1;  ///< -1: there is none
  std::size_t levels = 0;
  auto operator<=>(const Version&) const = default;
};

constexpr std::array steps = {"0.1", "0.2"};  // of the two runs

Version version_in(const fs::path& file) {
  if (!fs::exists(file)) {
    return {};
  }
  const rubato::record::Reader reader(file);
  const bool replaced = reader.header().problem.find(fmt::format("step = {}\n", steps[1])) != std::string::npos;
  return {replaced ? 1 : 0, reader.rows("/levels/t")};
}

/// What is done with one record.
struct Subject {
  std::string program, name, until, later;

  [[nodiscard]] std::string record() const { return name + ".h5"; }
  [[nodiscard]] std::string problem() const { return name + ".toml"; }
  [[nodiscard]] std::vector<std::string> run(const fs::path& folder, int number, const std::string& end,
                                             bool durable) const {
    return {"run",     folder / problem(),
            "-o",      folder / record(),
            "--set",   fmt::format("scheme.step={}", steps.at(static_cast<std::size_t>(number))),
            "--set",   "scheme.until=" + end,
            "--set",   fmt::format("output.durable={}", durable),
            "--quiet", "--force"};
  }
  [[nodiscard]] std::vector<std::string> resume(const fs::path& folder) const {
    return {"resume", folder / record(), "--until", later, "--quiet"};
  }
};

/// Writes one record, and knows which of its versions have been waited for.
class Witness {
public:
  Witness(const Subject& subject, const fs::path& folder, const Disk& disk)
      : subject_(subject), folder_(folder), disk_(disk) {}

  void write(bool durable) {
    watch(subject_.run(folder_, 0, subject_.until, durable));
    watch(subject_.resume(folder_));
    watch(subject_.run(folder_, 1, subject_.until, durable));
  }

  [[nodiscard]] const Subject& subject() const { return subject_; }
  /// A version that a power failure after so many requests must not take.
  [[nodiscard]] Version promised(std::size_t requests) const {
    Version version;
    for (const Promise& promise : promises_) {
      version = promise.requests <= requests ? promise.version : version;
    }
    return version;
  }

private:
  struct Promise {
    std::size_t requests;
    Version version;
  };

  /// Versions are made every two seconds: a process that sleeps most of the time makes many of a small record.
  void watch(const std::vector<std::string>& arguments) {
    const pid_t child = children::start(subject_.program, arguments);
    int status = 0;
    for (std::this_thread::sleep_for(40ms); ::waitpid(child, &status, WNOHANG) == 0;
         std::this_thread::sleep_for(40ms)) {
      ::kill(child, SIGSTOP);
      std::this_thread::sleep_for(1s);
      look(false);
      std::this_thread::sleep_for(1s);
      ::kill(child, SIGCONT);
    }
    look(true);
    const std::lock_guard lock(looking);
    expect(status == 0, fmt::format("rubato {} of the {} ends well: {}", arguments[0], subject_.name, status));
  }

  /// A process has waited for the version before the one that is seen; and for that one, too, when it ended.
  void look(bool ended) {
    const std::lock_guard lock(looking);
    const Version now = version_in(folder_ / subject_.record());
    if (now != seen_) {
      before_ = std::exchange(seen_, now);
    }
    promises_.push_back({disk_.requests(), ended ? seen_ : before_});
  }

  static inline std::mutex looking;  // HDF5 knows nothing of threads

  Subject subject_;
  fs::path folder_;
  const Disk& disk_;
  Version seen_, before_;
  std::vector<Promise> promises_;
};

/// Looks at what is under the name of a record.
class Judge {
public:
  /// Makes the records of runs never stopped, in a folder with the problem files.
  Judge(const Subject& subject, const fs::path& folder) : subject_(subject), folder_(folder) {
    for (const int number : {0, 1}) {
      const auto arguments = subject.run(folder, number, subject.later, true);
      expect(children::wait_for(children::start(subject.program, arguments)).status == 0, "a run never stopped");
      fs::rename(folder / subject.record(), whole(number));
    }
  }

  /// The version in this folder, which `check` agrees with and `resume` goes on from (the folder is changed); nothing
  /// if there is a file, but no such version in it. What was found once is not looked at again, but every tenth time.
  std::optional<Version> version(const fs::path& folder) {
    if (!fs::exists(folder / subject_.record())) {
      return Version{};
    }
    const auto [known, is_new] = known_.try_emplace(children::contents(folder / subject_.record()));
    if (is_new || ++asked_ % 10 == 0) {
      known->second = found(folder);
    }
    return known->second;
  }

  [[nodiscard]] std::size_t different() const {
    return static_cast<std::size_t>(
        std::ranges::count_if(known_, [](const auto& entry) { return entry.second.has_value(); }));
  }

private:
  [[nodiscard]] fs::path whole(int run) const { return folder_ / fmt::format("{}-{}.h5", subject_.name, run); }

  [[nodiscard]] std::optional<Version> found(const fs::path& folder) const {
    const auto status = [&](const std::vector<std::string>& arguments) {
      return children::wait_for(children::start(subject_.program, arguments)).status;
    };
    const fs::path record = folder / subject_.record();
    if (status({"check", record}) != 0) {
      return {};
    }
    const Version version = version_in(record);
    if (status(subject_.resume(folder)) != 0 || !sample::difference(record, whole(version.run)).empty()) {
      return {};
    }
    for (const auto& entry : fs::directory_iterator(folder)) {
      const std::string name = entry.path().filename();
      if (name != subject_.record() && name.starts_with(subject_.record())) {
        return {};  // `resume` removes what the one before it left
      }
    }
    return version;
  }

  Subject subject_;
  fs::path folder_;
  std::map<std::string, std::optional<Version>> known_;
  int asked_ = 0;
};

/// What was found after power failures.
struct Disagreements {
  int versions = 0;    ///< under the name of a record a version, as new as it has to be
  int none_yet = 0;    ///< nothing, when no version had been waited for
  int older = 0;       ///< an older version, or nothing where there was one
  int unreadable = 0;  ///< something that is no version
  int others_damaged = 0;

  [[nodiscard]] std::string text() const {
    return fmt::format(
        "{} hold a version, {} are not there yet, {} have lost versions, {} are none; other files: {} damaged",
        versions, none_yet, older, unreadable, others_damaged);
  }
};

/// Whether all that does not belong to the records is there and as it was.
bool others_are_whole(const fs::path& folder, const fs::path& original) {
  return std::ranges::all_of(fs::directory_iterator(original), [&](const auto& entry) {
    return children::contents(folder / entry.path().filename()) == children::contents(entry.path());
  });
}

class Test {
public:
  Test(const std::string& program, int images) : images_(images) {
    for (const char* name : {"fuse", "mounted", "original", "whole"}) {
      fs::create_directory(folder_ / name);
    }
    for (const char* name : {"original", "whole"}) {
      slow_problems::write_orbit(folder_ / name / "orbit.toml", 1);
      slow_problems::write_lattice(folder_ / name / "lattice.toml", 1);
    }
    std::ofstream(folder_ / "original/other") << std::string(1'000'000, 'x');
    const std::string empty = folder_ / "empty";
    command(fmt::format("truncate -s 48M '{0}' && /sbin/mkfs.ext4 -q -F -d '{1}' '{0}'", empty,
                        (folder_ / "original").string()));
    formatted_ = children::contents(empty);
    for (const Subject& subject : {Subject{program, "orbit", "800", "1100"}, Subject{program, "lattice", "25", "32"}}) {
      subjects_.push_back(subject);
      judges_.emplace_back(subject, folder_ / "whole");
    }
  }

  Disagreements findings(const std::string& options, bool durable) {
    Disk disk(folder_ / "fuse");
    disk.insert({formatted_.begin(), formatted_.end()});
    std::vector<Witness> witnesses;
    for (const Subject& subject : subjects_) {
      witnesses.emplace_back(subject, mounted_, disk);
    }
    const History history = written(disk, options, witnesses, durable);
    Disagreements findings;
    std::uniform_int_distribution<std::size_t> moment(0, history.requests.size());
    for (int image = 0; image < images_; ++image) {
      const std::size_t requests = moment(random_);
      const std::size_t piece = image % 2 == 0 ? 4096 : 512;
      const double kept = std::array{0.0, 0.5, 0.9}.at(random_() % 3);
      disk.insert(history.contents_after(requests, piece, kept, random_));
      look_at(disk, options, requests, witnesses, findings);
    }
    fmt::print("{}, durable = {}: {} images, {} requests; of records: {}\n", options, durable, images_,
               history.requests.size(), findings.text());
    std::fflush(stdout);
    return findings;
  }

  [[nodiscard]] std::size_t different_versions() const {
    std::size_t sum = 0;
    for (const Judge& judge : judges_) {
      sum += judge.different();
    }
    return sum;
  }

private:
  [[nodiscard]] History written(const Disk& disk, const std::string& options, std::vector<Witness>& witnesses,
                                bool durable) const {
    const Mounted mount(disk, mounted_, options);
    std::vector<std::jthread> threads;
    for (Witness& witness : witnesses) {
      threads.emplace_back([&witness, durable] { witness.write(durable); });
    }
    threads.clear();
    return disk.history();
  }

  void look_at(const Disk& disk, const std::string& options, std::size_t requests,
               const std::vector<Witness>& witnesses, Disagreements& findings) {
    {
      const Mounted mount(disk, mounted_, options);
      findings.others_damaged += others_are_whole(mounted_, folder_ / "original") ? 0 : 1;
      for (std::size_t i = 0; i < witnesses.size(); ++i) {
        const std::optional<Version> version = judges_[i].version(mounted_);
        const Version promised = witnesses[i].promised(requests);
        if (!version) {
          ++findings.unreadable;
        } else if (*version < promised) {
          ++findings.older;
        } else {
          ++(*version == Version{} ? findings.none_yet : findings.versions);
        }
      }
    }
    command(fmt::format("/sbin/e2fsck -fn '{}' > '{}' 2>&1", disk.file().string(), (folder_ / "e2fsck").string()));
  }

  sample::Folder folder_;
  fs::path mounted_ = folder_ / "mounted";
  int images_;
  std::mt19937 random_{11};
  std::string formatted_;
  std::vector<Subject> subjects_;
  std::vector<Judge> judges_;
};

int all(const std::string& program, int images) {
  ::setenv("OMP_NUM_THREADS", "1", 1);
  try {
    Test test(program, images);
    // Without auto_da_alloc ext4 does not wait by itself for what is renamed.
    for (const char* mode : {"data=writeback,commit=300", "data=writeback,commit=1", "data=ordered,commit=1"}) {
      const std::string options = std::string("noauto_da_alloc,") + mode;
      const Disagreements waited = test.findings(options, true);
      expect(waited.older + waited.unreadable + waited.others_damaged == 0, options + ": every image has the records");
      expect(waited.versions > images, options + ": most images are of moments when there is a record");
      const Disagreements twin = test.findings(options, false);
      expect(twin.older + twin.unreadable > 0, options + ": without waiting versions are lost");
      expect(twin.others_damaged == 0, options + ": other files are whole without waiting, too");
    }
    fmt::print("{} different versions\n", test.different_versions());
  } catch (const std::exception& error) {
    fmt::print("FAILED: {}\n", error.what());
    return 1;
  }
  return failures == 0 ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) {
    fmt::print("usage: power_failure RUBATO IMAGES\n");
    return 2;
  }
  for (const char* needed : {"/dev/fuse", "/dev/loop-control", "/sbin/mkfs.ext4"}) {
    if (::access(needed, F_OK) != 0) {
      fmt::print("skipped: there is no {}\n", needed);
      return 77;
    }
  }
  if (::unshare(CLONE_NEWNS | CLONE_NEWPID) != 0) {
    fmt::print("skipped: this user may not mount\n");
    return 77;
  }
  // The first process of a namespace takes all others in it along when it ends, and the last one the mounts.
  const pid_t first = ::fork();
  if (first == 0) {
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (::mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr) != 0) {
      return 1;
    }
    return all(argv[1], std::atoi(argv[2]));
  }
  return children::wait_for(first).status;
}
