// What another program does to a record is seen wherever it is opened, when the mark at the file's end is gone.

#include <catch2/catch.hpp>

#include <algorithm>
#include <filesystem>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <hdf5.h>
#include <hdf5_hl.h>

#include <rubato/record/reader.hpp>

#include "sample.hpp"

using namespace rubato::record;
using Catch::Matchers::Contains;
using sample::Folder;

namespace {

using Change = std::function<void(hid_t)>;

/// Opens a file for writing, changes it, and closes it; HDF5 takes the mark at its end away.
void alter(const std::filesystem::path& file, const Change& change) {
  const hid_t id = H5Fopen(file.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  REQUIRE(id >= 0);
  change(id);
  REQUIRE(H5Fclose(id) >= 0);
}

void add_note(hid_t object, const char* name) {
  const hid_t space = H5Screate(H5S_SCALAR);
  const hid_t note = H5Acreate2(object, name, H5T_IEEE_F64LE, space, H5P_DEFAULT, H5P_DEFAULT);
  REQUIRE(note >= 0);
  H5Aclose(note);
  H5Sclose(space);
}

void set_text(hid_t object, const char* name, const char* text) {
  if (H5Aexists(object, name) > 0) {
    H5Adelete(object, name);
  }
  const hid_t type = H5Tcopy(H5T_C_S1), space = H5Screate(H5S_SCALAR);
  H5Tset_size(type, H5T_VARIABLE);
  H5Tset_cset(type, H5T_CSET_UTF8);
  const hid_t id = H5Acreate2(object, name, type, space, H5P_DEFAULT, H5P_DEFAULT);
  REQUIRE(H5Awrite(id, type, &text) >= 0);
  H5Aclose(id);
  H5Sclose(space);
  H5Tclose(type);
}

void set_integer(hid_t object, const char* name, std::int64_t value) {
  const hid_t id = H5Aopen(object, name, H5P_DEFAULT);
  REQUIRE(H5Awrite(id, H5T_NATIVE_INT64, &value) >= 0);
  H5Aclose(id);
}

/// A change of one dataset.
Change of(const std::string& path, const std::function<void(hid_t)>& change) {
  return [=](hid_t file) {
    const hid_t dataset = H5Dopen2(file, path.c_str(), H5P_DEFAULT);
    REQUIRE(dataset >= 0);
    change(dataset);
    H5Dclose(dataset);
  };
}

/// The last number becomes another.
void change_value(hid_t dataset) {
  const hid_t space = H5Dget_space(dataset);
  std::vector<double> values(static_cast<std::size_t>(H5Sget_simple_extent_npoints(space)));
  H5Dread(dataset, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data());
  values.back() = values.back() == 0.0 ? 1.0 : 0.0;
  REQUIRE(H5Dwrite(dataset, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()) >= 0);
  H5Sclose(space);
}

void change_name(hid_t dataset) {
  const hid_t type = H5Tcopy(H5T_C_S1);
  H5Tset_size(type, H5T_VARIABLE);
  H5Tset_cset(type, H5T_CSET_UTF8);
  const std::vector<const char*> names{"q2", "θ"};
  REQUIRE(H5Dwrite(dataset, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, names.data()) >= 0);
  H5Tclose(type);
}

Change hard_link(const std::string& target, const std::string& path) {
  return [=](hid_t file) {
    H5Ldelete(file, path.c_str(), H5P_DEFAULT);
    REQUIRE(H5Lcreate_hard(file, target.c_str(), file, path.c_str(), H5P_DEFAULT, H5P_DEFAULT) >= 0);
  };
}

Change swap(const std::string& a, const std::string& b) {
  return [=](hid_t file) {
    const auto move = [&](const std::string& from, const std::string& to) {
      REQUIRE(H5Lmove(file, from.c_str(), file, to.c_str(), H5P_DEFAULT, H5P_DEFAULT) >= 0);
    };
    move(a, "/levels/aside");
    move(b, a);
    move("/levels/aside", b);
  };
}

/// Puts another record's group or dataset in place of this one's.
Change take(const std::filesystem::path& other, const std::string& path) {
  return [=](hid_t file) {
    const hid_t from = H5Fopen(other.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
    H5Ldelete(file, path.c_str(), H5P_DEFAULT);
    REQUIRE(H5Ocopy(from, path.c_str(), file, path.c_str(), H5P_DEFAULT, H5P_DEFAULT) >= 0);
    H5Fclose(from);
  };
}

void add_dataset(hid_t file) {
  const hsize_t count = 3;
  const hid_t space = H5Screate_simple(1, &count, nullptr);
  H5Dclose(H5Dcreate2(file, "/levels/more", H5T_IEEE_F64LE, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT));
  H5Sclose(space);
}

/// What opening it throws.
std::string refusal(const std::filesystem::path& file) {
  try {
    const Reader reader(file);
  } catch (const Error& error) {
    return error.what();
  }
  return "nothing";
}

}  // namespace

TEST_CASE("what a run says of itself cannot be replaced") {
  const Folder folder;
  const auto file = folder / "a.h5";
  const auto said = [&](const Change& change) {
    std::filesystem::remove(file);
    sample::write_whole(file, 20);
    alter(file, change);
    return refusal(file);
  };
  // The twins: nothing but an attribute that no record has.
  CHECK(said([](hid_t id) { add_note(id, "note"); }) == "nothing");
  CHECK(said(of("/levels/h", [](hid_t id) { add_note(id, "note"); })) == "nothing");
  const auto only = [&](const char* name) {
    return Reader(file, Altered::reported).altered() == std::vector<std::string>{name};
  };
  for (const char* name : {"title", "problem", "version", "compiler", "contents"}) {
    const std::string expected = fmt::format("a.h5: attribute '{}' is not what was written", name);
    CHECK_THAT(said([&](hid_t id) { set_text(id, name, "/levels/t"); }), Contains(expected));
    CHECK(only(name));
  }
  for (const char* name : {"threads", "finished"}) {
    const std::string expected = fmt::format("a.h5: attribute '{}' is not what was written", name);
    CHECK_THAT(said([&](hid_t id) { set_integer(id, name, name[0] == 't' ? 7 : 0); }), Contains(expected));
    CHECK(only(name));
  }
  CHECK_THAT(said([](hid_t id) { H5Adelete(id, "contents"); }), Contains("attribute 'contents'"));
  // The seal itself: another's, one with a line less, none of the kind.
  for (const char* text : {"x", "0123456789abcdef", "0123456789abcdef attribute title", ""}) {
    CHECK_THAT(said([&](hid_t id) { set_text(id, "checksums", text); }), Contains("a.h5: attribute '"));
  }
  CHECK_THAT(said(add_dataset), Contains("a.h5: dataset '/levels/more' has no checksum"));
}

TEST_CASE("no dataset can be altered, or stand in another's place") {
  const Folder folder;
  const auto file = folder / "a.h5", longer = folder / "b.h5", other = folder / "c.h5";
  sample::write_whole(longer, 23);
  sample::write_whole(other, 20);
  alter(other, of("/levels/h", change_value));
  const auto meddle = [&](const Change& change) {
    std::filesystem::remove(file);
    sample::write_whole(file, 20);
    alter(file, change);
  };
  using Paths = std::vector<std::string>;
  const auto reported = [&] { return Reader(file, Altered::reported).altered(); };
  meddle([](hid_t id) { add_note(id, "note"); });
  CHECK(reported().empty());  // the twin

  for (const auto& dataset : sample::layout().datasets) {
    if (dataset.axis == dataset.path) {
      continue;  // linked elsewhere: below
    }
    INFO(dataset.path);
    for (const auto& change : std::vector<Change>{
             of(dataset.path, change_value), of(dataset.path, [](hid_t id) { set_text(id, "description", "another"); }),
             of(dataset.path, [](hid_t id) { H5Adelete(id, "DIMENSION_LIST"); })}) {
      meddle(change);
      CHECK(reported() == Paths{dataset.path});
      CHECK_THAT(refusal(file), Contains(fmt::format("a.h5: dataset '{}' is not what was written", dataset.path)));
    }
  }
  const std::vector<std::pair<Change, Paths>> changes{
      {of("/levels/t", change_value), {"/levels/t"}},
      {of("/grid/x", change_value), {"/grid/x", "/laws/x", "/states/x"}},
      {of("/states/coordinate", change_name), {"/states/coordinate", "/states/previous/coordinate"}},
      {of("/grid/x", [](hid_t id) { set_text(id, "description", "another"); }), {"/grid/x", "/laws/x", "/states/x"}},
      {of("/grid/x", [](hid_t id) { H5Adelete(id, "NAME"); }), {"/grid/x", "/laws/x", "/states/x"}},
      {of("/levels/h", [](hid_t id) { set_integer(id, "rows", 19); }), {"/levels/h"}},
      {swap("/levels/h", "/levels/energy"), {"/levels/energy", "/levels/h"}},
      {swap("/states/q", "/states/previous/q"), {"/states/previous/q", "/states/q"}},
      {take(other, "/levels/h"), {"/levels/h"}},
      {take(longer, "/checkpoint"), {"/checkpoint"}},
      {[](hid_t id) {
         const hid_t group = H5Gopen2(id, "/checkpoint", H5P_DEFAULT);
         H5Adelete(group, "checksum");
         H5Gclose(group);
       },
       {"/checkpoint"}},
  };
  for (const auto& [change, paths] : changes) {
    meddle(change);
    CHECK(reported() == paths);
    CHECK_THAT(refusal(file), Contains(fmt::format("'{}' is not what was written", paths.front())));
  }
  meddle(take(longer, "/levels"));
  CHECK_THAT(refusal(file), Contains("dataset '/levels/"));
  meddle(hard_link("/levels/t", "/states/t"));
  CHECK_THAT(refusal(file), Contains("a.h5: ") && Contains("'/states/t'"));
  // The same numbers from another file are the same record, and one without checksums is of a version before them.
  meddle(of("/levels/h", change_value));
  alter(file, [](hid_t id) { H5Adelete(id, "checksums"); });
  CHECK(refusal(file) == "nothing");
}

TEST_CASE("every version of a record has the checksums of what it holds") {
  const Folder folder;
  const auto file = folder / "a.h5";
  const auto holds = [&] {
    std::filesystem::copy_file(file, folder / "b.h5", std::filesystem::copy_options::overwrite_existing);
    alter(folder / "b.h5", [](hid_t id) { add_note(id, "note"); });
    CHECK(Reader(folder / "b.h5", Altered::reported).altered().empty());
    // The twin: of what it holds now.
    alter(folder / "b.h5", of("/levels/energy", change_value));
    CHECK(Reader(folder / "b.h5", Altered::reported).altered() == std::vector<std::string>{"/levels/energy"});
  };
  sample::Run run;
  const auto go_to = [&](Writer& writer, std::int64_t last, std::int64_t every) {
    while (run.k < last) {
      ++run.k;
      run.write(writer);
      if (run.k % every == 0) {
        writer.commit(run.checkpoint());
        holds();
      }
    }
  };
  {
    auto writer = Writer::create(file, sample::layout(), false, {.buffer_bytes = 100000});
    run.write(writer);
    writer.commit(run.checkpoint());
    go_to(writer, 40000, 9000);  // beyond two chunks of 16384 rows, of which some are in the file already
    writer.append(sample::level_t, -1.0);
    writer.drop_level();
    writer.append(sample::state_t, 0.1 * static_cast<double>(run.k));  // provisional, dropped by the next run
    writer.append(sample::q, std::vector{7.0, 7.0});
    writer.append(sample::u, std::vector<double>(15, 7.0));
    writer.append(sample::flux, std::vector<double>(15, 7.0));
    writer.finish(run.checkpoint(), Writer::Completion::interrupted);
    holds();
  }
  for (const std::int64_t last : {40001, 40100, 60000}) {
    auto writer = Writer::resume(file, sample::layout());
    go_to(writer, last, 9000);
    writer.finish(run.checkpoint(), Writer::Completion::complete);
    holds();
  }
}
