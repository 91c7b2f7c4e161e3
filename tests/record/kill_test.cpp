#include <catch2/catch.hpp>

#include <array>
#include <csignal>
#include <random>

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <hdf5.h>

#include <rubato/record/reader.hpp>

#include "sample.hpp"

using namespace rubato::record;
using sample::Folder;

namespace {

constexpr std::int64_t last_level = 60000;

/// A pipe through which a child reports the levels that it has appended.
class Beats {
public:
  static constexpr std::int64_t levels = 50;  ///< of one beat

  Beats() { REQUIRE(::pipe2(ends_.data(), O_CLOEXEC) == 0); }
  Beats(const Beats&) = delete;
  Beats& operator=(const Beats&) = delete;
  ~Beats() {
    ::close(ends_[0]);
    ::close(ends_[1]);
  }
  void send() const { static_cast<void>(::write(ends_[1], "", 1)); }
  void wait_for(int count) const {
    for (char beat = 0; count > 0; --count)
      REQUIRE(::read(ends_[0], &beat, 1) == 1);
  }

private:
  std::array<int, 2> ends_{};
};

/// Goes on from whatever is there, committing all the time, and never comes back. Exit status 0 when the run is done; a
/// child that is to be killed waits for it at the last level, if it gets that far.
[[noreturn]] void run_in_child(const std::filesystem::path& file, const Beats* to_be_killed) {
  try {
    constexpr CommitPolicy often{
        .interval = std::chrono::seconds(0), .times_last_commit = 0.0, .buffer_bytes = 50000, .durable = false};
    const bool is_new = !std::filesystem::exists(file);
    auto writer =
        is_new ? Writer::create(file, sample::layout(), false, often) : Writer::resume(file, sample::layout(), often);
    sample::Run run;
    if (is_new) {
      run.write(writer);
      writer.commit(run.checkpoint());
    } else {
      const auto checkpoint = Reader(file).checkpoint();
      run.k = std::get<std::vector<std::int64_t>>(checkpoint.at("level")).at(0);
    }
    if (to_be_killed != nullptr)
      to_be_killed->send();
    while (run.k < last_level) {
      ++run.k;
      run.write(writer);
      if (to_be_killed != nullptr && run.k % Beats::levels == 0)
        to_be_killed->send();
      if (run.k % 1500 == 0)
        writer.commit(run.checkpoint());
    }
    while (to_be_killed != nullptr) {
      to_be_killed->send();
      ::usleep(1000);
    }
    writer.finish(run.checkpoint(), Writer::Completion::complete);
    { const Writer done = std::move(writer); }  // gives up its claim: _exit() destroys nothing
    ::_exit(0);
  } catch (...) {
    ::_exit(1);
  }
}

/// An ordinary reader: HDF5 alone, with its own locks, without this library.
bool opens_read_only(const std::filesystem::path& file) {
  const hid_t id = H5Fopen(file.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
  if (id < 0)
    return false;
  H5Fclose(id);
  return true;
}

/// Every dataset has the rows of the level that the checkpoint names, and those rows have the right values.
void check_whole(const std::filesystem::path& file) {
  const Reader reader(file);
  const auto level = std::get<std::vector<std::int64_t>>(reader.checkpoint().at("level")).at(0);
  const auto levels = static_cast<std::size_t>(level) + 1;
  CHECK(reader.rows("/levels/t") == levels);
  CHECK(reader.rows("/levels/h") == levels - 1);
  CHECK(reader.rows("/states/u") == (levels + 2) / 3);
  const auto t = reader.read("/levels/t");
  std::size_t wrong = 0;
  for (std::size_t k = 0; k < t.size(); ++k)
    wrong += t[k] != 0.1 * static_cast<double>(k);
  CHECK(wrong == 0);
}

}  // namespace

TEST_CASE("a record killed at 24 random moments is always whole and ends bit for bit the same") {
  const Folder folder;
  const auto file = folder / "killed.h5";
  std::mt19937 random(20);  // a fixed seed; the machine's load makes the moments random all the same
  // Most children get past a commit, which comes after 1500 levels, and 24 of them stay short of the last level.
  std::uniform_int_distribution<int> beats(1, 2 * static_cast<int>(last_level / Beats::levels) / 24);
  std::uniform_int_distribution<useconds_t> microseconds(0, 1000);  // then the kill is not always behind a beat
  int kills = 0;
  int seen_whole = 0;
  std::size_t rows_at_kill = 0;
  while (true) {
    const Beats beat;
    const pid_t child = ::fork();
    if (child == 0)
      run_in_child(file, kills < 24 ? &beat : nullptr);
    if (kills < 24) {
      beat.wait_for(beats(random));
      ::usleep(microseconds(random));
      ::kill(child, SIGKILL);
    }
    int status = 0;
    ::waitpid(child, &status, 0);
    if (!WIFSIGNALED(status)) {
      REQUIRE(WEXITSTATUS(status) == 0);
      break;
    }
    ++kills;
    REQUIRE(opens_read_only(file));
    check_whole(file);
    ++seen_whole;
    const auto rows = Reader(file).rows("/levels/t");
    CHECK(rows >= rows_at_kill);
    rows_at_kill = rows;
  }
  INFO("rows at the last kill: " << rows_at_kill);
  CHECK(kills == 24);
  CHECK(seen_whole == kills);
  CHECK(std::distance(std::filesystem::directory_iterator(folder.path()), {}) == 1);  // nothing is left beside it

  sample::write_whole(folder / "never.h5", last_level);
  CHECK(sample::difference(file, folder / "never.h5").empty());
}

TEST_CASE("a plain read-only open refuses what writing in place leaves behind") {
  // The twin of the test above: a writer that appends to the published file itself, killed in the middle. It shows that
  // `opens_read_only` can fail, and why versions are renamed into place.
  const Folder folder;
  const auto file = folder / "in-place.h5";
  sample::write_whole(file, 1000);
  const pid_t child = ::fork();
  if (child == 0) {
    const hid_t access = H5Pcreate(H5P_FILE_ACCESS);
    H5Pset_libver_bounds(access, H5F_LIBVER_V110, H5F_LIBVER_V110);
    const hid_t id = H5Fcreate(file.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, access);
    H5Gcreate2(id, "levels", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    H5Fflush(id, H5F_SCOPE_GLOBAL);
    ::kill(::getpid(), SIGKILL);
  }
  ::waitpid(child, nullptr, 0);
  H5E_auto2_t print = nullptr;
  void* data = nullptr;
  H5Eget_auto2(H5E_DEFAULT, &print, &data);
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
  CHECK_FALSE(opens_read_only(file));
  H5Eset_auto2(H5E_DEFAULT, print, data);
  CHECK_THROWS_AS(Reader(file), Error);
}
