#include <catch2/catch.hpp>

#include <cstdlib>
#include <limits>
#include <thread>

#include <hdf5.h>

#include <rubato/record/reader.hpp>

#include "sample.hpp"

using namespace rubato::record;
using sample::Folder;

TEST_CASE("what is written is read back") {
  const Folder folder;
  sample::write_whole(folder / "a.h5", 100);

  const Reader reader(folder / "a.h5");
  const auto layout = sample::layout();
  CHECK(reader.header().format == "rubato-1");
  CHECK(reader.header().title == layout.title);
  CHECK(reader.header().problem == layout.problem);
  CHECK(reader.header().threads == 2);
  CHECK(reader.header().finished);

  CHECK(reader.rows("/levels/t") == 101);
  CHECK(reader.rows("/levels/h") == 100);
  CHECK(reader.rows("/states/u") == 34);
  CHECK(reader.read("/levels/t")[7] == 0.1 * 7.0);
  CHECK(std::isnan(reader.read("/levels/gamma")[0]));
  CHECK(reader.read_integers("/levels/step")[99] == 99);
  CHECK(reader.read_integers("/levels/off_law")[9] == 1);
  CHECK(reader.read_integers("/levels/off_law")[10] == 0);
  CHECK(reader.read("/levels/off_law")[9] == 1.0);
  CHECK(reader.read_strings("/states/coordinate") == std::vector<std::string>{"θ", "q2"});
  CHECK(reader.read("/grid/x").size() == 5);

  const auto info = reader.info("/states/u");
  CHECK(info.shape == std::vector<std::size_t>{34, 3, 5});
  CHECK(info.dimensions == std::vector<std::string>{"t", "y", "x"});
  CHECK(info.row_size() == 15);
  CHECK(info.grows);
  CHECK(reader.read("/states/u", 32, 1)[4] == std::sin(96 + 0.01 * 4));
  CHECK_THROWS_AS(reader.read("/states/u", 33, 2), Error);
  CHECK(reader.has("/states/previous/q"));
  CHECK(reader.has("/laws/t"));
  CHECK_FALSE(reader.has("/nothing/here"));
  CHECK_THROWS_AS(reader.read("/nothing/here"), Error);
  CHECK_THROWS_AS(reader.read_integers("/levels/h"), Error);
  CHECK_THROWS_AS(reader.read("/states/coordinate"), Error);

  const Checkpoint expected = sample::Run{100}.checkpoint();
  CHECK(reader.checkpoint() == expected);
  CHECK_FALSE(std::filesystem::exists(folder / "a.h5.partial"));
  CHECK_FALSE(std::filesystem::exists(folder / "a.h5.next"));
}

TEST_CASE("how often a run commits and flushes does not show in its record") {
  const Folder folder;
  // 40000 levels: more than two chunks of single numbers (16384 rows), so that whole chunks and tails both occur.
  constexpr std::int64_t last = 40000;
  sample::write_whole(folder / "rarely.h5", last);
  sample::write_whole(folder / "often.h5", last,
                      {.interval = std::chrono::milliseconds(20), .times_last_commit = 0, .buffer_bytes = 100000});
  CHECK(sample::difference(folder / "rarely.h5", folder / "often.h5").empty());
  // Only whole chunks enter the working file, so that many versions leave no dead space; 2 % are for its bookkeeping.
  const auto rarely = static_cast<double>(std::filesystem::file_size(folder / "rarely.h5"));
  const auto often = static_cast<double>(std::filesystem::file_size(folder / "often.h5"));
  CHECK(std::abs(often / rarely - 1) < 0.02);
}

TEST_CASE("short records are small, and grow beyond what was expected of them") {
  const Folder folder;
  const auto write = [&](const char* name, std::optional<std::size_t> expected, std::int64_t last) {
    Layout layout = sample::layout();
    layout.compression = 0;
    for (Dataset& dataset : layout.datasets)
      dataset.expected_rows = expected;
    auto writer = Writer::create(folder / name, layout, false);
    sample::Run run;
    for (; run.k < last; ++run.k)
      run.write(writer);
    run.write(writer);
    writer.finish(run.checkpoint(), Writer::Completion::complete);
    return std::filesystem::file_size(folder / name);
  };
  // For each of twelve datasets a chunk of 4 KiB, and as much again of headers, index and attached scales.
  CHECK(write("short.h5", 11, 10) < 2 * 12 * 4096 + 20000);
  // The twin: whole chunks of 128 KiB, or of 16384 numbers.
  CHECK(write("unknown.h5", std::nullopt, 10) > 10 * (std::uintmax_t{128} << 10));
  static_cast<void>(write("long.h5", 11, 40000));
  sample::write_whole(folder / "whole.h5", 40000);
  CHECK(sample::difference(folder / "long.h5", folder / "whole.h5").empty());
  // Continued in the chunks that it has, whatever the layout of its end expects.
  {
    Layout layout = sample::layout();
    auto writer = Writer::resume(folder / "short.h5", layout);
    for (sample::Run run{10}; run.k < 40000;) {
      ++run.k;
      run.write(writer);
      if (run.k == 40000)
        writer.finish(run.checkpoint(), Writer::Completion::complete);
    }
  }
  CHECK(sample::difference(folder / "short.h5", folder / "whole.h5").empty());
}

TEST_CASE("the comparison of records sees one bit, a sign of zero and a missing row") {
  const Folder folder;
  sample::write_whole(folder / "a.h5", 50);
  const auto changed = [&](auto&& change) {
    std::filesystem::copy_file(folder / "a.h5", folder / "b.h5", std::filesystem::copy_options::overwrite_existing);
    const hid_t file = H5Fopen((folder / "b.h5").c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
    const hid_t dataset = H5Dopen2(file, "/levels/t", H5P_DEFAULT);
    change(dataset);
    H5Dclose(dataset);
    H5Fclose(file);
    return sample::difference(folder / "a.h5", folder / "b.h5");
  };
  const auto set = [](std::size_t place, double value) {
    return [=](hid_t dataset) {
      std::vector<double> t(51);
      H5Dread(dataset, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, t.data());
      t[place] = std::isnan(value) ? std::nextafter(t[place], 1e9) : value;
      H5Dwrite(dataset, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, t.data());
    };
  };
  CHECK(changed([](hid_t) {}).empty());
  CHECK(changed(set(50, NAN)) == "/levels/t: the values differ");
  CHECK(changed(set(0, -0.0)) == "/levels/t: the values differ");
  CHECK_THROWS_WITH(changed([](hid_t dataset) {
                      const hsize_t rows = 50;
                      H5Dset_extent(dataset, &rows);
                    }),
                    Catch::Matchers::Contains("dataset '/levels/t': it should have 51 rows, but has 50"));
}

TEST_CASE("only whole levels are published") {
  const Folder folder;
  auto writer = Writer::create(folder / "a.h5", sample::layout());
  CHECK_FALSE(std::filesystem::exists(folder / "a.h5"));
  sample::Run run;
  run.write(writer);
  writer.append(sample::level_t, 0.1);  // the beginning of a level that is not complete
  writer.commit(run.checkpoint());
  CHECK(Reader(folder / "a.h5").rows("/levels/t") == 1);
  CHECK_FALSE(Reader(folder / "a.h5").header().finished);
  CHECK_THROWS_AS(writer.end_level(), std::logic_error);  // the twin: gamma has no row yet
  writer.append(sample::gamma, 1.0);
  writer.end_level();
  writer.commit(run.checkpoint());
  CHECK(Reader(folder / "a.h5").rows("/levels/t") == 2);
}

TEST_CASE("a reader keeps the version that it opened") {
  const Folder folder;
  auto writer = Writer::create(folder / "a.h5", sample::layout());
  sample::Run run;
  run.write(writer);
  writer.commit(run.checkpoint());
  const Reader early(folder / "a.h5");
  for (run.k = 1; run.k < 4; ++run.k)
    run.write(writer);
  writer.finish(run.checkpoint(), Writer::Completion::complete);
  CHECK(early.rows("/levels/t") == 1);
  CHECK(early.read("/levels/t").size() == 1);
  CHECK(Reader(folder / "a.h5").rows("/levels/t") == 4);
}

TEST_CASE("a finished or interrupted run is resumed as if it had never stopped") {
  const Folder folder;
  sample::write_whole(folder / "whole.h5", 20000);
  sample::write_whole(folder / "parts.h5", 17000);  // past one chunk of 16384 rows
  for (const std::int64_t last : {17001, 19000, 20000}) {
    auto layout = sample::layout();
    layout.problem = "until " + std::to_string(last);
    const auto checkpoint = Reader(folder / "parts.h5").checkpoint();
    auto writer = Writer::resume(folder / "parts.h5", layout);
    sample::Run run{std::get<std::vector<std::int64_t>>(checkpoint.at("level")).at(0)};
    CHECK(writer.rows(sample::level_t) == static_cast<std::size_t>(run.k) + 1);
    while (run.k < last) {
      ++run.k;
      run.write(writer);
    }
    writer.finish(run.checkpoint(), Writer::Completion::interrupted);
    CHECK(Reader(folder / "parts.h5").header().problem == layout.problem);
    CHECK_FALSE(Reader(folder / "parts.h5").header().finished);
  }
  CHECK(sample::difference(folder / "whole.h5", folder / "parts.h5").empty());
}

TEST_CASE("large rows are divided into chunks and survive") {
  const Folder folder;
  constexpr std::size_t cells = 200'000;  // rows of 3 × 200000 doubles, 4.8 MB
  sample::write_whole(folder / "a.h5", 6, {}, cells);
  const Reader reader(folder / "a.h5");
  const auto field = reader.read("/states/u", 2, 1);
  REQUIRE(field.size() == 3 * cells);
  CHECK(field[599'999] == std::sin(6 + 0.01 * 599'999));
}

TEST_CASE("writers and readers work in parallel threads") {
  const Folder folder;
  sample::write_whole(folder / "alone.h5", 3000);
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i)
    threads.emplace_back([&folder, i] {
      sample::write_whole(folder / (std::to_string(i) + ".h5"), 3000, {std::chrono::milliseconds(50), 0, 1000});
    });
  for (auto& thread : threads)
    thread.join();
  for (int i = 0; i < 4; ++i)
    CHECK(sample::difference(folder / "alone.h5", folder / (std::to_string(i) + ".h5")).empty());
}

// Hidden: run by other_readers.py, which names the file.
TEST_CASE("writes a record for other programs to read", "[.other-readers]") {
  const char* file = std::getenv("RUBATO_SAMPLE_RECORD");
  REQUIRE(file != nullptr);
  sample::write_whole(file, 30);
}
