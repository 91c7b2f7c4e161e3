// Locks, and file systems that have none.

#include <catch2/catch.hpp>

#include <cerrno>
#include <optional>
#include <string>
#include <vector>

#include <sys/file.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <rubato/record/error.hpp>
#include <rubato/record/reader.hpp>

#include "sample.hpp"

using namespace rubato::record;
using Catch::Matchers::Contains;
using sample::Folder;

namespace {

int refused_with = 0;  ///< what flock() fails with; 0: it is the system's

}  // namespace

// In place of the C library's.
extern "C" int flock(int descriptor, int operation) {
  if (refused_with != 0) {
    errno = refused_with;
    return -1;
  }
  return static_cast<int>(::syscall(SYS_flock, descriptor, operation));
}

TEST_CASE("a file system without locks is named, and written without one where that is asked for") {
  const Folder folder;
  const auto file = folder / "a.h5";
  for (const int error : {ENOLCK, ENOSYS, EOPNOTSUPP, 524}) {
    refused_with = error;
    INFO(error);
    CHECK_THROWS_WITH(Writer::create(file, sample::layout(), true), Contains("has no locks; --no-lock writes without"));
    CHECK(std::filesystem::is_empty(folder.path()));
    {
      auto writer = Writer::create(file, sample::layout(), true, {.locking = Locking::no});
      sample::Run run;
      run.write(writer);
      writer.finish(run.checkpoint(), Writer::Completion::complete);
    }
    CHECK(Reader(file).rows("/levels/t") == 1);  // reading takes no lock
    CHECK_THROWS_WITH(Claim(file), Contains("has no locks"));
    CHECK(Claim(file, Locking::no).file() == file);
    std::filesystem::remove(file);
  }
  refused_with = EIO;  // the twin: another failure is no lack of locks
  CHECK_THROWS_WITH(Claim(file), !Contains("has no locks"));
  refused_with = 0;
  const Claim claim(file);
  CHECK_THROWS_WITH(Claim(file), Contains("another run is writing this record"));
}

TEST_CASE("a folder that does not exist is named, with the remedy") {
  const Folder folder;
  const auto missing = folder / "x" / "y" / "a.h5";
  CHECK_THROWS_WITH(Writer::create(missing, sample::layout()),
                    Contains("the folder '" + missing.parent_path().string() + "' does not exist; create it"));
  std::filesystem::create_directories(missing.parent_path());
  CHECK_NOTHROW(Writer::create(missing, sample::layout()));
}

TEST_CASE("the rows that are expected have a size") {
  Layout layout = sample::layout();
  for (Dataset& dataset : layout.datasets) {
    dataset.expected_rows = 1000;
  }
  double values = 0.0;
  for (const Dataset& dataset : layout.datasets) {
    double row = dataset.type == Type::u8 ? 1.0 : dataset.type == Type::i32 ? 4.0 : 8.0;
    for (const std::string& path : dataset.dimensions) {
      const auto scale =
          std::find_if(layout.scales.begin(), layout.scales.end(), [&](const Scale& at) { return at.path == path; });
      row *= static_cast<double>(std::visit([](const auto& all) { return all.size(); }, scale->values));
    }
    values += row;
  }
  const auto datasets = static_cast<double>(layout.datasets.size());
  constexpr double header = 2048.0, page = 4096.0;
  layout.compression = 1;
  CHECK(expected_bytes(layout) == 1000.0 * values + header * datasets);
  const std::vector<std::optional<std::size_t>> fewer(layout.datasets.size(), 10);
  CHECK(expected_bytes(layout, fewer) == 10.0 * values + header * datasets);
  // In whole chunks, where they are not compressed: of as many rows as are expected, or a page.
  layout.compression = 0;
  CHECK(*expected_bytes(layout) >= 1000.0 * values + header * datasets);
  CHECK(*expected_bytes(layout) < 1000.0 * values + (header + page) * datasets);
  CHECK(*expected_bytes(layout, fewer) > 10.0 * values + header * datasets);
  layout.datasets.front().expected_rows.reset();
  CHECK_FALSE(expected_bytes(layout).has_value());
}
