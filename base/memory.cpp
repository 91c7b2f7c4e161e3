#include <rubato/base/memory.hpp>

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <limits>
#include <optional>
#include <sstream>
#include <stdexcept>

#include <fmt/format.h>

namespace rubato {

namespace {

namespace fs = std::filesystem;

/// The number at the beginning of a file; nothing if there is none, as for "max".
std::optional<double> number_in(const fs::path& file) {
  std::ifstream stream(file);
  double number = 0.0;
  return stream >> number ? std::optional(number) : std::nullopt;
}

/// The number behind `key` at the beginning of a line.
std::optional<double> number_in(const fs::path& file, const std::string& key) {
  std::ifstream stream(file);
  for (std::string line; std::getline(stream, line);) {
    std::istringstream words(line);
    std::string word;
    double number = 0.0;
    if (words >> word && word == key && words >> number) {
      return number;
    }
  }
  return std::nullopt;
}

constexpr double kilobyte = 1024.0;

/// Pages of /proc/self/statm in bytes: the address space of the process, and its data.
struct Held {
  double address_space = 0.0, data = 0.0;
};

Held held(const fs::path& root) {
  std::ifstream stream(root / "proc/self/statm");
  std::array<double, 6> pages{};
  for (double& number : pages) {
    stream >> number;
  }
  const auto size = static_cast<double>(::sysconf(_SC_PAGESIZE));
  return {pages[0] * size, pages[5] * size};
}

class Least {
public:
  explicit Least(fs::path root) : root_(std::move(root)) {}

  void add_machine() {
    if (const auto free = number_in(root_ / "proc/meminfo", "MemAvailable:")) {
      add(*free * kilobyte, "free memory of this machine");
    }
  }
  void add_limits() {
    const Held now = held(root_);
    add_limit(RLIMIT_AS, now.address_space, "ulimit -v");
    add_limit(RLIMIT_DATA, now.data, "ulimit -d");
  }
  /// Every control group above a process limits it, too. Cached files are given up first.
  void add_control_groups() {
    std::ifstream stream(root_ / "proc/self/cgroup");
    for (std::string line; std::getline(stream, line);) {
      const std::size_t first = line.find(':'), second = line.find(':', first + 1);
      if (second == std::string::npos) {
        continue;
      }
      const std::string controllers = "," + line.substr(first + 1, second - first - 1) + ",";
      const bool unified = controllers == ",,";
      if (!unified && controllers.find(",memory,") == std::string::npos) {
        continue;
      }
      const fs::path top = root_ / (unified ? "sys/fs/cgroup" : "sys/fs/cgroup/memory");
      for (fs::path group = fs::path(line.substr(second + 1)).relative_path();; group = group.parent_path()) {
        const fs::path folder = top / group;
        const auto most = number_in(folder / (unified ? "memory.max" : "memory.limit_in_bytes"));
        const auto used = number_in(folder / (unified ? "memory.current" : "memory.usage_in_bytes"));
        if (most && used) {
          const auto cached = number_in(folder / "memory.stat", unified ? "file" : "total_cache");
          add(*most - *used + cached.value_or(0.0), "control group");
        }
        if (group.empty()) {
          break;
        }
      }
    }
  }

  [[nodiscard]] const AvailableMemory& found() const { return least_; }

private:
  void add(double bytes, const char* limit) {
    if (bytes < least_.bytes) {
      least_ = {std::max(bytes, 0.0), limit};
    }
  }
  void add_limit(decltype(RLIMIT_AS) resource, double used, const char* name) {
    rlimit limit{};
    if (::getrlimit(resource, &limit) == 0 && limit.rlim_cur != RLIM_INFINITY) {
      add(static_cast<double>(limit.rlim_cur) - used, name);
    }
  }

  fs::path root_;
  AvailableMemory least_{std::numeric_limits<double>::infinity(), "nothing"};
};

}  // namespace

AvailableMemory available_memory(const fs::path& root) {
  Least least(root);
  least.add_machine();
  least.add_limits();
  least.add_control_groups();
  return least.found();
}

void require_memory(double bytes, const std::string& what) {
  const AvailableMemory available = available_memory();
  if (bytes > available.bytes) {
    throw std::invalid_argument(fmt::format("{} would take {:.3g} GB of memory, and {:.3g} GB is available ({})", what,
                                            bytes * 1e-9, available.bytes * 1e-9, available.limit));
  }
}

double peak_memory() {
  return number_in("/proc/self/status", "VmHWM:").value_or(0.0) * kilobyte;
}

void fail_beyond_available_memory() {
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)  // whose shadow memory counts as data
  const double swap = number_in("/proc/meminfo", "SwapFree:").value_or(0.0) * kilobyte;
  const double most = held("/").data + available_memory().bytes + swap;
  rlimit limit{};
  if (::getrlimit(RLIMIT_DATA, &limit) == 0 && most < static_cast<double>(limit.rlim_cur)) {
    limit.rlim_cur = static_cast<rlim_t>(most);
    static_cast<void>(::setrlimit(RLIMIT_DATA, &limit));
  }
#endif
}

}  // namespace rubato
