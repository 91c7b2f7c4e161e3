#include <catch2/catch.hpp>

#include <fstream>
#include <limits>

#include <sys/mount.h>
#include <sys/resource.h>
#include <unistd.h>

#include <hdf5.h>

#include <rubato/record/reader.hpp>

#include "sample.hpp"

using namespace rubato::record;
using Catch::Matchers::Contains;
using sample::Folder;

namespace {

/// The message of the Error that `action` throws.
template <class Action>
std::string message(Action&& action) {
  try {
    action();
  } catch (const Error& error) {
    return error.what();
  }
  return "no error";
}

void write_text(const std::filesystem::path& file, const std::string& text) {
  std::ofstream(file) << text;
}

}  // namespace

TEST_CASE("an existing file is replaced only with leave, and not before there is something to replace it") {
  const Folder folder;
  write_text(folder / "a.h5", "precious");
  CHECK_THROWS_AS(Writer::create(folder / "a.h5", sample::layout()), AlreadyExists);
  CHECK(std::filesystem::file_size(folder / "a.h5") == 8);
  {
    auto writer = Writer::create(folder / "a.h5", sample::layout(), true);
    CHECK(std::filesystem::file_size(folder / "a.h5") == 8);
  }
  CHECK(std::distance(std::filesystem::directory_iterator(folder.path()), {}) == 1);  // nothing is left beside it
  auto writer = Writer::create(folder / "a.h5", sample::layout(), true);
  const sample::Run run;
  run.write(writer);
  writer.finish(run.checkpoint(), Writer::Completion::complete);
  CHECK(Reader(folder / "a.h5").rows("/levels/t") == 1);
}

TEST_CASE("a symbolic link stays and what it leads to is written") {
  const Folder folder;
  std::filesystem::create_directory(folder / "elsewhere");
  std::filesystem::create_symlink(folder / "elsewhere", folder / "link");
  sample::write_whole(folder / "link" / "a.h5", 3);
  std::filesystem::create_symlink(folder / "elsewhere" / "a.h5", folder / "b.h5");
  auto writer = Writer::resume(folder / "b.h5", sample::layout());
  writer.finish(sample::Run{3}.checkpoint(), Writer::Completion::complete);
  CHECK(std::filesystem::is_symlink(folder / "b.h5"));
  CHECK(Reader(folder / "elsewhere" / "a.h5").rows("/levels/t") == 4);
}

TEST_CASE("a record has one writer at a time") {
  const Folder folder;
  sample::write_whole(folder / "a.h5", 3);
  {
    const auto writer = Writer::resume(folder / "a.h5", sample::layout());
    CHECK_THAT(message([&] { (void)Writer::resume(folder / "a.h5", sample::layout()); }),
               Contains("another run is writing this record"));
  }
  CHECK_NOTHROW(Writer::resume(folder / "a.h5", sample::layout()));
}

TEST_CASE("places where nothing can be written") {
  const Folder folder;
  const auto create = [&](const std::filesystem::path& file) {
    return message([&] { (void)Writer::create(file, sample::layout()); });
  };
  CHECK_THAT(create(folder / "no/such/folder.h5"), Contains("does not exist; create it"));
  write_text(folder / "file", "");
  CHECK_THAT(create(folder / "file/a.h5"), Contains("Not a directory"));
  CHECK_THAT(create(folder.path()), Contains("is not a regular file"));
  CHECK_THAT(create("/dev/full"), Contains("is not a regular file"));

  std::filesystem::create_directory(folder / "closed");
  std::filesystem::permissions(folder / "closed", std::filesystem::perms::owner_read |
                                                      std::filesystem::perms::owner_exec |
                                                      std::filesystem::perms::others_exec);
  std::filesystem::permissions(folder.path(), std::filesystem::perms::others_exec, std::filesystem::perm_options::add);
  const uid_t user = ::geteuid();
  if (user == 0)
    REQUIRE(::seteuid(65534) == 0);  // the superuser may write anywhere
  CHECK_THAT(create(folder / "closed/a.h5"), Contains("Permission denied"));
  if (user == 0)
    REQUIRE(::seteuid(user) == 0);
}

TEST_CASE("values that are not finite are refused by name") {
  const Folder folder;
  auto writer = Writer::create(folder / "a.h5", sample::layout());
  CHECK_THROWS_WITH(writer.append(sample::level_t, std::numeric_limits<double>::quiet_NaN()),
                    Contains("/levels/t") && Contains("nan"));
  CHECK_THROWS_WITH(writer.append(sample::q, std::vector{0.0, -std::numeric_limits<double>::infinity()}),
                    Contains("value 1 of row 0 of '/states/q' is -inf"));
  CHECK_NOTHROW(writer.append(sample::gamma, std::numeric_limits<double>::quiet_NaN()));
  CHECK_NOTHROW(writer.append(sample::level_t, std::numeric_limits<double>::denorm_min()));
  CHECK(writer.rows(sample::level_t) == 1);  // a refused row is not counted
}

TEST_CASE("rows of the wrong size or type are refused") {
  const Folder folder;
  auto writer = Writer::create(folder / "a.h5", sample::layout());
  CHECK_THROWS_WITH(writer.append(sample::q, 1.0), Contains("'/states/q' has 2 values, not 1"));
  CHECK_THROWS_AS(writer.append(sample::h, 1), std::invalid_argument);
  CHECK_THROWS_AS(writer.append(sample::step, 1.0), std::invalid_argument);
  CHECK_THROWS_WITH(writer.append(sample::off_law, 256), Contains("256") && Contains("/levels/off_law"));
  CHECK_NOTHROW(writer.append(sample::off_law, 255));
}

TEST_CASE("layouts that contradict themselves are refused") {
  const Folder folder;
  const auto refused = [&](auto&& change) {
    auto layout = sample::layout();
    change(layout);
    try {
      (void)Writer::create(folder / "a.h5", layout);
    } catch (const std::invalid_argument& error) {
      return std::string(error.what());
    }
    return std::string("accepted");
  };
  CHECK(refused([](Layout&) {}) == "accepted");
  CHECK_THAT(refused([](Layout& l) { l.datasets[1].path = "/levels/t"; }), Contains("declared twice"));
  CHECK_THAT(refused([](Layout& l) { l.datasets[1].path = "levels/t"; }), Contains("not an absolute path"));
  CHECK_THAT(refused([](Layout& l) { l.datasets[1].path = "/levels/gam\nma"; }), Contains("not an absolute path"));
  CHECK_THAT(refused([](Layout& l) { l.datasets[1].path = "/checkpoint/t"; }), Contains("checkpoint"));
  CHECK_THAT(refused([](Layout& l) { l.datasets[3].axis = "/levels/energy"; }), Contains("axis '/levels/energy'"));
  CHECK_THAT(refused([](Layout& l) { l.datasets[7].dimensions = {"/grid/z"}; }), Contains("no scale '/grid/z'"));
  CHECK_THAT(refused([](Layout& l) { l.datasets[1].path = "/laws/t"; }), Contains("'/laws/t' would be both"));
  CHECK_THAT(refused([](Layout& l) { l.scales[0].values = std::vector<double>{}; }), Contains("empty"));
  CHECK_THAT(refused([](Layout& l) { l.datasets[1].path = "/states"; }),
             Contains("'/states' would be both a dataset and the group of '/states/"));
}

TEST_CASE("what is not a record is refused with the reason") {
  const Folder folder;
  const auto refusal = [](const std::filesystem::path& file) {
    const std::string read = message([&] { (void)Reader(file); });
    CHECK((message([&] { (void)Writer::resume(file, sample::layout()); }) == "no error") == (read == "no error"));
    return read;
  };
  CHECK_THAT(refusal(folder / "nothing.h5"), Contains("no such file"));
  CHECK_FALSE(std::filesystem::exists(folder / "nothing.h5.partial"));
  write_text(folder / "text.h5", "not HDF5");
  CHECK_THAT(refusal(folder / "text.h5"), Contains("is not an HDF5 file"));
  CHECK_THAT(refusal(folder.path()), Contains("is not a regular file"));

  const auto attribute = [&](const char* value) {
    sample::write_whole(folder / "other.h5", 1);
    const hid_t file = H5Fopen((folder / "other.h5").c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
    H5Adelete(file, "format");
    if (value) {
      const hid_t type = H5Tcopy(H5T_C_S1);
      H5Tset_size(type, H5T_VARIABLE);
      const hid_t space = H5Screate(H5S_SCALAR);
      const hid_t id = H5Acreate2(file, "format", type, space, H5P_DEFAULT, H5P_DEFAULT);
      H5Awrite(id, type, &value);
      H5Aclose(id);
      H5Sclose(space);
      H5Tclose(type);
    }
    H5Fclose(file);
    const std::string text = refusal(folder / "other.h5");
    std::filesystem::remove(folder / "other.h5");
    return text;
  };
  CHECK_THAT(attribute(nullptr), Contains("not a record"));
  CHECK_THAT(attribute("rubato-2"), Contains("its format is 'rubato-2', this version reads 'rubato-1'"));
  CHECK(attribute("rubato-1") == "no error");  // the twin

  sample::write_whole(folder / "a.h5", 2000);
  const auto size = std::filesystem::file_size(folder / "a.h5");
  for (const auto part : {size / 4, size / 2, size - 1}) {
    std::filesystem::copy_file(folder / "a.h5", folder / "cut.h5", std::filesystem::copy_options::overwrite_existing);
    std::filesystem::resize_file(folder / "cut.h5", part);
    CHECK_THAT(refusal(folder / "cut.h5"), Contains("truncated"));
  }
}

TEST_CASE("a record has every dataset that it promises") {
  const Folder folder;
  const auto without = [&](const std::string& path, bool promises) {
    sample::write_whole(folder / "a.h5", 1);
    const hid_t file = H5Fopen((folder / "a.h5").c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
    if (!path.empty())
      H5Ldelete(file, path.c_str(), H5P_DEFAULT);
    if (!promises) {
      H5Adelete(file, "contents");
      H5Adelete(file, "checksums");
    }
    H5Fclose(file);
    const std::string text = message([&] { (void)Reader(folder / "a.h5"); });
    std::filesystem::remove(folder / "a.h5");
    return text;
  };
  CHECK(without("", true) == "no error");  // the twin
  std::vector<std::string> paths;
  for (const auto& scale : sample::layout().scales)
    paths.push_back(scale.path);
  for (const auto& dataset : sample::layout().datasets)
    paths.push_back(dataset.path);
  for (const std::string& path : paths) {
    INFO(path);
    CHECK_THAT(without(path, true), Contains("a.h5") && Contains("no dataset '" + path + "'"));
  }
  // Records of earlier versions promise nothing: what they lack is for the readers to judge.
  CHECK(without("", false) == "no error");
  CHECK(without("/levels/gamma", false) == "no error");
}

TEST_CASE("only the run that wrote a record may resume it") {
  const Folder folder;
  sample::write_whole(folder / "a.h5", 10);
  const auto resumed = [&](auto&& change) {
    auto layout = sample::layout();
    change(layout);
    return message([&] { (void)Writer::resume(folder / "a.h5", layout); });
  };
  CHECK(resumed([](Layout&) {}) == "no error");
  CHECK_THAT(resumed([](Layout& l) { l.scales[1].values = std::vector<double>(5, 0.0); }), Contains("/grid/x"));
  CHECK_THAT(resumed([](Layout& l) { l.datasets[4].type = Type::i64; }), Contains("/levels/energy"));
  CHECK_THAT(resumed([](Layout& l) { l.datasets[7].dimensions = {"/grid/y"}; }), Contains("/states/q"));
  CHECK_THAT(resumed([](Layout& l) { l.datasets.pop_back(); }), Contains("'/laws/energy' is unknown"));
  CHECK_THAT(resumed([](Layout& l) { l.datasets[4].path = "/levels/other"; }), Contains("/levels/other"));
}

TEST_CASE("a full disk leaves the published version whole") {
  const Folder folder;
  const auto disk = folder / "disk";
  std::filesystem::create_directory(disk);
  if (::mount("none", disk.c_str(), "tmpfs", 0, "size=16m") != 0) {
    WARN("skipped: a small file system could not be mounted here");
    return;
  }
  std::string text;
  std::size_t published = 0;
  {
    auto writer = Writer::create(disk / "a.h5", sample::layout(1000));
    sample::Run run{0, 1000};
    text = message([&] {
      for (; run.k < 3000; ++run.k) {
        run.write(writer);
        if (run.k % 10 == 0) {
          writer.commit(run.checkpoint());
          published = static_cast<std::size_t>(run.k) + 1;
        }
      }
    });
  }
  CHECK_THAT(text, Contains("No space left on device"));
  CHECK(published > 1);
  CHECK(Reader(disk / "a.h5").rows("/levels/t") == published);
  CHECK(Reader(disk / "a.h5").read("/states/u").size() == 3000 * ((published + 2) / 3));
  CHECK(std::distance(std::filesystem::directory_iterator(disk), {}) == 1);
  // HDF5 has not been left in a state in which nothing works.
  CHECK_NOTHROW(sample::write_whole(folder / "after.h5", 10));
  CHECK(::umount(disk.c_str()) == 0);
}
