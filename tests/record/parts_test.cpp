// Rows and checkpoints that come in parts, for those who have no room for the whole.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>
#include <random>

#include <rubato/record/detail/checksum.hpp>
#include <rubato/record/detail/files.hpp>
#include <rubato/record/detail/seal.hpp>
#include <rubato/record/reader.hpp>

#include "sample.hpp"

using namespace rubato::record;
using sample::Folder;

namespace {

constexpr std::size_t cells = 50'000;  // rows of 3 × 50000 doubles, 1.2 MB: chunks divide them

std::vector<double> field_of(std::int64_t k, std::size_t size = 3 * cells) {
  std::vector<double> field(size);
  for (std::size_t i = 0; i < field.size(); ++i)
    field[i] = std::sin(static_cast<double>(k) + 0.01 * static_cast<double>(i));
  return field;
}

/// Level k of sample::Run with its fields in parts of `size` numbers; `tamper` may change what is appended.
void write_in_parts(Writer& writer, std::int64_t k, std::size_t size, std::size_t row_size = 3 * cells,
                    const std::function<void(std::vector<double>&)>& tamper = {}) {
  const auto number = static_cast<double>(k);
  writer.append(sample::level_t, 0.1 * number);
  writer.append(sample::gamma, k == 0 ? NAN : std::cos(number));
  if (k > 0) {
    writer.append(sample::step, k - 1);
    writer.append(sample::h, 0.1 + 1e-3 * std::sin(number));
    writer.append(sample::energy, -0.5 + 1e-16 * number);
    writer.append(sample::off_law, k % 10 == 0);
  }
  if (k % 3 == 0) {
    writer.append(sample::state_t, 0.1 * number);
    writer.append(sample::q, std::vector{std::sin(number), std::cos(number)});
    writer.append(sample::previous_t, 0.1 * (number - 1));
    writer.append(sample::previous_q, std::vector{std::sin(number - 1), std::cos(number - 1)});
    std::vector<double> field = field_of(k, row_size);
    if (tamper)
      tamper(field);
    for (const auto dataset : {sample::u, sample::flux})
      for (std::size_t first = 0; first < field.size(); first += size)
        writer.append_part(dataset, std::span(field).subspan(first, std::min(size, field.size() - first)));
  }
  writer.end_level();
}

/// A checkpoint of sample::Run with a state of `count` numbers.
Checkpoint large_checkpoint(std::int64_t k, std::size_t count) {
  Checkpoint checkpoint = sample::Run{k}.checkpoint();
  checkpoint["state"] = field_of(k, count);
  return checkpoint;
}
CheckpointInParts in_parts(const Checkpoint& checkpoint, std::size_t size) {
  const auto& state = std::get<std::vector<double>>(checkpoint.at("state"));
  return {.name = "state",
          .size = state.size(),
          .hand_over =
              [&state, size](const CheckpointInParts::Take& take) {
                for (std::size_t first = 0; first < state.size(); first += size)
                  take(std::span(state).subspan(first, std::min(size, state.size() - first)));
              },
          .others =
              [&checkpoint] {
                Checkpoint others = checkpoint;
                others.erase("state");
                return others;
              }};
}

}  // namespace

TEST_CASE("rows in parts make the record that whole rows make") {
  const Folder folder;
  // Long rows, which go to the working file before they are whole; those that are a chunk each; short ones, of which a
  // chunk has some, or many.
  struct Case {
    std::size_t cells, part, buffer;
    int compression;
  };
  for (const Case& c : {Case{cells, 7'001, 100'000, 4}, Case{cells, 50'000, 1, 0}, Case{cells, 150'000, 1'000'000, 0},
                        Case{20'000, 7'001, 100'000, 0}, Case{20'000, 60'000, 1'500'000, 0},
                        Case{2'000, 6'000, 200'000, 0}, Case{5, 4, 1, 4}}) {
    INFO(c.cells << " cells in parts of " << c.part << " numbers");
    Layout layout = sample::layout(c.cells);
    layout.compression = c.compression;
    const CommitPolicy small{.buffer_bytes = c.buffer};
    constexpr std::int64_t last = 10;
    const auto whole = [&] {
      auto writer = Writer::create(folder / "whole.h5", layout, true);
      for (std::int64_t k = 0; k <= last; ++k)
        sample::Run{k, c.cells}.write(writer);
      writer.finish(large_checkpoint(last, 300'000), Writer::Completion::complete);
    };
    whole();
    const auto tampered = [](std::vector<double>& field) { field.back() += 1e-15; };
    for (const bool is_twin : {false, true}) {
      std::optional<Writer> begun = Writer::create(folder / "parts.h5", layout, true, small);
      for (std::int64_t k = 0; k <= 6; ++k) {
        Writer& writer = *begun;
        if (k == 3) {  // a level that is given up
          writer.append_part(sample::u, field_of(99, c.cells));
          writer.drop_level();
        }
        write_in_parts(writer, k, c.part, 3 * c.cells);
        const Checkpoint checkpoint = large_checkpoint(k, k < 4 ? 300'000 : 200'000);
        writer.commit(in_parts(checkpoint, c.part));
        CHECK(Reader(folder / "parts.h5").checkpoint() == checkpoint);
        CHECK(Reader(folder / "parts.h5").rows("/states/u") == static_cast<std::size_t>(k / 3 + 1));
      }
      begun.reset();
      Writer writer = Writer::resume(folder / "parts.h5", layout, small);
      for (std::int64_t k = 7; k <= last; ++k)
        write_in_parts(writer, k, c.part, 3 * c.cells,
                       is_twin ? tampered : std::function<void(std::vector<double>&)>());
      const Checkpoint checkpoint = large_checkpoint(last, 300'000);
      writer.stage(in_parts(checkpoint, c.part));
      writer.finish(Writer::Completion::complete);
      CHECK(sample::difference(folder / "whole.h5", folder / "parts.h5").empty() != is_twin);
      CHECK(Reader(folder / "parts.h5").checkpoint() == checkpoint);
    }
  }
}

TEST_CASE("what was given up is in no checksum of rows, chunks or the file") {
  const Folder folder;
  const detail::Session session;
  std::mt19937 random(17);
  const auto is_whole = [&](const std::filesystem::path& path) {
    const detail::Descriptor descriptor = detail::open_regular(path);
    const detail::Handle file = detail::open_file(path, H5F_ACC_RDONLY);
    return detail::integrity_of(descriptor.number()) == detail::Integrity::intact &&
           detail::altered_names(file).empty();
  };
  // Rows that are a chunk each, that chunks divide, and of which a chunk has some.
  for (const std::size_t width : {std::size_t{10'000}, cells, std::size_t{1'000}}) {
    for (const std::size_t buffer : {std::size_t{1}, std::size_t{600'000}, std::size_t{100'000'000}}) {
      INFO(width << " cells, " << buffer << " bytes wait");
      Layout layout = sample::layout(width);
      layout.compression = 0;
      const std::filesystem::path path = folder / "a.h5";
      auto writer = Writer::create(path, layout, true, {.buffer_bytes = buffer});
      const std::vector<double> wrong = field_of(99, 3 * width);
      for (std::int64_t k = 0; k <= 15; ++k) {
        if (k % 3 == 0) {  // begun with a row that is whole, half or neither, and given up
          writer.append_part(sample::u, wrong);
          if (random() % 2 == 0)
            writer.append_part(sample::flux, std::span(wrong).first(random() % (3 * width)));
          writer.drop_level();
        }
        write_in_parts(writer, k, 1 + random() % (3 * width), 3 * width);
        if (random() % 4 == 0) {
          writer.commit(large_checkpoint(k, 10));
          CHECK(is_whole(path));
        }
      }
      if (random() % 2 == 0) {  // given up at the end, where fewer rows are left than were written
        writer.append_part(sample::u, wrong);
        writer.drop_level();
      }
      writer.finish(large_checkpoint(15, 10), Writer::Completion::complete);
      CHECK(is_whole(path));
      CHECK(Reader(path).read("/states/u", 5, 1) == field_of(15, 3 * width));
    }
  }
}

TEST_CASE("parts of the last state are provisional, as the whole is") {
  const Folder folder;
  for (const bool in_parts_too : {false, true}) {
    auto writer = Writer::create(folder / "a.h5", sample::layout(cells), true, {.buffer_bytes = 1000});
    write_in_parts(writer, 0, 1000);
    const Checkpoint checkpoint = large_checkpoint(0, 10);
    writer.stage(in_parts(checkpoint, 3));
    for (const auto dataset : {sample::state_t, sample::previous_t})
      writer.append(dataset, 7.0);
    for (const auto dataset : {sample::q, sample::previous_q})
      writer.append(dataset, std::vector{1.0, 2.0});
    for (const auto dataset : {sample::u, sample::flux}) {
      const std::vector<double> field = field_of(7);
      if (in_parts_too) {
        writer.append_part(dataset, std::span(field).first(60'000));
        writer.append_part(dataset, std::span(field).subspan(60'000));
      } else {
        writer.append(dataset, field);
      }
    }
    writer.finish(Writer::Completion::complete);
    std::filesystem::rename(folder / "a.h5", folder / (in_parts_too ? "parts.h5" : "whole.h5"));
  }
  CHECK(sample::difference(folder / "whole.h5", folder / "parts.h5").empty());
  CHECK(Reader(folder / "parts.h5").read("/states/u", 1, 1) == field_of(7));
  CHECK(Writer::resume(folder / "parts.h5", sample::layout(cells)).rows(sample::u) == 1);
}

TEST_CASE("wrong parts are refused, and nothing of them is published") {
  const Folder folder;
  auto writer = Writer::create(folder / "a.h5", sample::layout(cells), false, {.buffer_bytes = 1000});
  write_in_parts(writer, 0, 5000);
  const Checkpoint checkpoint = large_checkpoint(0, 100);
  CHECK_THROWS_AS(writer.finish(Writer::Completion::complete), std::logic_error);  // with what checkpoint?
  writer.commit(in_parts(checkpoint, 30));
  std::vector<double> part(100'000, 1.0);
  writer.append_part(sample::u, part);
  CHECK_THROWS_AS(writer.end_level(), std::logic_error);
  CHECK_THROWS_AS(writer.append_part(sample::u, part), std::invalid_argument);  // longer than a row
  CHECK_THROWS_AS(writer.append(sample::u, field_of(1)), std::invalid_argument);
  CHECK_THROWS_AS(writer.append_part(sample::step, part), std::invalid_argument);
  part[7] = INFINITY;
  CHECK_THROWS_WITH(writer.append_part(sample::u, std::span(part).first(50'000)),
                    "record: value 100007 of row 1 of '/states/u' is inf");
  writer.drop_level();
  write_in_parts(writer, 3, 5000);
  for (const std::size_t announced : {99, 101}) {
    CheckpointInParts wrong = in_parts(checkpoint, 30);
    wrong.size = announced;
    CHECK_THROWS_AS(writer.stage(wrong), Error);
  }
  CHECK(Reader(folder / "a.h5").rows("/states/u") == 1);
  CHECK(Reader(folder / "a.h5").checkpoint() == checkpoint);
}

TEST_CASE("checkpoints of versions before take no room in a record") {
  const Folder folder;
  const auto size_of_record = [&](const std::function<void(Writer&, const CheckpointInParts&)>& before) {
    auto writer = Writer::create(folder / "a.h5", sample::layout(), true);
    for (const std::int64_t k : {0, 1, 2, 3}) {
      sample::Run{k}.write(writer);
      const Checkpoint checkpoint = large_checkpoint(k, 50'000 * static_cast<std::size_t>(4 - k));
      k < 3 ? before(writer, in_parts(checkpoint, 7'001)) : writer.stage(in_parts(checkpoint, 7'001));
    }
    writer.finish(Writer::Completion::complete);
    return std::filesystem::file_size(folder / "a.h5");
  };
  const auto smallest = size_of_record([](Writer&, const CheckpointInParts&) {});
  const auto committed =
      size_of_record([](Writer& writer, const CheckpointInParts& checkpoint) { writer.commit(checkpoint); });
  CHECK(committed < smallest + 10'000);
  // The twin: in the working file they would.
  const auto staged =
      size_of_record([](Writer& writer, const CheckpointInParts& checkpoint) { writer.stage(checkpoint); });
  CHECK(staged > smallest + 10'000);
}

TEST_CASE("a checkpoint is read without its large array, which is looked at all the same") {
  const Folder folder;
  {
    auto writer = Writer::create(folder / "a.h5", sample::layout());
    sample::Run{}.write(writer);
    writer.finish(large_checkpoint(0, 200'000), Writer::Completion::interrupted);
  }
  const Reader reader(folder / "a.h5");
  Checkpoint others = large_checkpoint(0, 200'000);
  others.erase("state");
  CHECK(reader.checkpoint("state") == others);
  CHECK(reader.read("/checkpoint/state", 100'000, 3)[2] == field_of(0, 200'000)[100'002]);
  CHECK(Writer::resume(Claim(folder / "a.h5"), sample::layout(), {}, "state").take_checkpoint() == others);
}
