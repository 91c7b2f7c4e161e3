// The memory that is available, from a folder with files like those of /proc and /sys.

#include <catch2/catch.hpp>

#include <filesystem>
#include <fstream>
#include <string>

#include <rubato/base/memory.hpp>

#include "sample.hpp"

using namespace rubato;

namespace {

void write(const std::filesystem::path& file, const std::string& text) {
  std::filesystem::create_directories(file.parent_path());
  std::ofstream(file) << text;
}

}  // namespace

TEST_CASE("the memory that is available is the least of the machine's and that of every control group") {
  const sample::Folder root;
  write(root / "proc/meminfo", "MemTotal:       8000 kB\nMemFree:        1000 kB\nMemAvailable:   4000 kB\n");
  CHECK(available_memory(root.path()).bytes == 4000.0 * 1024.0);
  CHECK(available_memory(root.path()).limit == "free memory of this machine");
  // Version 2: the group above has less room, cached files count as room, and the innermost one has no limit.
  write(root / "proc/self/cgroup", "0::/a/b\n");
  write(root / "sys/fs/cgroup/a/b/memory.max", "max\n");
  write(root / "sys/fs/cgroup/a/b/memory.current", "5000\n");
  CHECK(available_memory(root.path()).bytes == 4000.0 * 1024.0);
  write(root / "sys/fs/cgroup/a/memory.max", "100000\n");
  write(root / "sys/fs/cgroup/a/memory.current", "70000\n");
  write(root / "sys/fs/cgroup/a/memory.stat", "anon 60000\nfile 10000\n");
  CHECK(available_memory(root.path()).bytes == 40000.0);
  CHECK(available_memory(root.path()).limit == "control group");
  // Version 1, in a container that does not see the path of its group.
  write(root / "proc/self/cgroup", "9:cpu:/other\n8:blkio,memory:/docker/1\n");
  write(root / "sys/fs/cgroup/memory/memory.limit_in_bytes", "30000\n");
  write(root / "sys/fs/cgroup/memory/memory.usage_in_bytes", "29000\n");
  CHECK(available_memory(root.path()).bytes == 1000.0);
  // Never negative.
  write(root / "sys/fs/cgroup/memory/memory.usage_in_bytes", "31000\n");
  CHECK(available_memory(root.path()).bytes == 0.0);
}
