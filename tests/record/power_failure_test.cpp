// What is left of a record when the machine stops, on a file system that writes names before contents (crash/shim.cpp).

#include <catch2/catch.hpp>

#include <algorithm>
#include <cstdlib>
#include <string>

#include <fmt/format.h>

#include <rubato/record/reader.hpp>

#include "sample.hpp"

using namespace rubato::record;
using sample::Folder;

namespace {

struct Images {
  int all = 0, whole = 0;
};

/// Runs the hidden test below under the shim, and counts the images that hold a version of the record.
Images images_of_a_run(bool durable) {
  const Folder folder, images;
  const std::string command = fmt::format(
      "RUBATO_CRASH_IMAGES='{}' RUBATO_SAMPLE_RECORD='{}' RUBATO_DURABLE={} LD_PRELOAD='{}' '{}' "
      "'[.power-failure]' > /dev/null",
      images.path().string(), (folder / "a.h5").string(), durable ? 1 : 0, RUBATO_CRASH_SHIM,
      std::filesystem::read_symlink("/proc/self/exe").string());
  REQUIRE(std::system(command.c_str()) == 0);
  Images count;
  for (const auto& entry : std::filesystem::directory_iterator(images.path())) {
    if (entry.path().extension() != ".h5")
      continue;
    ++count.all;
    try {
      const Reader reader(entry.path());
      const auto level = std::get<std::vector<std::int64_t>>(reader.checkpoint().at("level")).at(0);
      count.whole += reader.rows("/levels/t") == static_cast<std::size_t>(level) + 1 ? 1 : 0;
    } catch (const Error&) {
    }
  }
  return count;
}

}  // namespace

TEST_CASE("after a power failure every image of the disk holds a version of the record") {
#if defined(__SANITIZE_ADDRESS__)
  WARN("skipped: a sanitizer has to be loaded before everything else");
#else
  const Images durable = images_of_a_run(true);
  CHECK(durable.all == 2 * 22 + 21);  // 20 commits, the first one, and the end; all but the first replace another
  CHECK(durable.whole == durable.all);
  // The twin: without waiting, only the end is safe, and what a torn image holds is found out.
  const Images quick = images_of_a_run(false);
  CHECK(quick.all == 2 * 22 + 1);
  CHECK(quick.whole == 2);
#endif
}

// Hidden: run under the shim by the test above.
TEST_CASE("writes a record in many versions", "[.power-failure]") {
  const char* const file = std::getenv("RUBATO_SAMPLE_RECORD");
  const char* const durable = std::getenv("RUBATO_DURABLE");
  REQUIRE(file != nullptr);
  REQUIRE(durable != nullptr);
  auto writer = Writer::create(file, sample::layout(), false, {.durable = *durable == '1'});
  sample::Run run;
  run.write(writer);
  writer.commit(run.checkpoint());
  for (int commit = 0; commit < 20; ++commit) {
    for (int i = 0; i < 7; ++i) {
      ++run.k;
      run.write(writer);
    }
    writer.commit(run.checkpoint());
  }
  writer.finish(run.checkpoint(), Writer::Completion::complete);
}
