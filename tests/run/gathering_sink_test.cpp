#include <cmath>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/record/error.hpp>
#include <rubato/run/gathering_sink.hpp>

#include "run/mailboxes.hpp"

namespace rubato {
namespace {

using run_tests::Mailboxes;

/// Keeps what it gets.
class Kept final : public RowSink {
public:
  explicit Kept(InParts wish) : wish_(std::move(wish)) {}
  using RowSink::append;
  void append(record::Column column, std::span<const double> row) override {
    rows.at(column.number).assign(row.begin(), row.end());
  }
  void append(record::Column /*column*/, std::span<const std::int64_t> /*row*/) override {}
  InParts in_parts(std::span<const record::Column> columns) override {
    asked += columns.size();
    return wish_;
  }
  void append_checksum(record::Column column, const Checksum& row) override { checksums.at(column.number) = row; }

  std::vector<std::vector<double>> rows = std::vector<std::vector<double>>(4);
  std::vector<std::optional<Checksum>> checksums = std::vector<std::optional<Checksum>>(4);
  std::size_t asked = 0;

private:
  InParts wish_;
};

constexpr std::size_t columns = 130, planes = 127;  // a row of 128 KiB and a little more

record::Layout layout() {
  record::Layout layout;
  layout.scales = {{.path = "/grid/x", .values = std::vector<double>(columns)},
                   {.path = "/grid/y", .values = std::vector<double>(planes)},
                   {.path = "/grid/short", .values = std::vector<double>(1)}};
  for (const char* path : {"/u", "/v"})
    layout.add({.path = path, .axis = "/t", .dimensions = {"/grid/y", "/grid/x"}});
  layout.add({.path = "/t", .axis = "/t"});
  layout.add({.path = "/w", .axis = "/t", .dimensions = {"/grid/y", "/grid/x"}, .may_be_undefined = true});
  return layout;
}

double value(int field, std::size_t node) {
  return std::sin(static_cast<double>(node) + field);
}

/// Every rank appends the fields' parts of a row, and t; the sink is rank 0's.
void append_on(int ranks, RowSink& sink, const std::function<double(int, std::size_t)>& value) {
  Mailboxes all(ranks);
  std::vector<std::thread> others;
  std::exception_ptr thrown;
  const auto one = [&](int rank) {
    Mailboxes::Rank communicator(all, rank);
    const grids::Grid whole({{"x", 0.0, 1.0, columns}, {"y", 0.0, 1.0, planes}});
    const grids::Slab slab(communicator, whole, {1, 2});
    const record::Layout columns_of_rows = layout();
    GatheringSink gathering(slab, columns_of_rows, rank == 0 ? &sink : nullptr);
    for (const std::size_t column : {0U, 1U, 3U}) {
      std::vector<double> part(slab.size(), std::numeric_limits<double>::quiet_NaN());  // ghosts are nobody's business
      for (std::size_t i = 0; i < slab.owned(); ++i)
        part[slab.first_node() + i] = value(static_cast<int>(column), slab.number_of_first() + i);
      gathering.append(record::Column{column}, std::span<const double>(part));
    }
    gathering.append(record::Column{2}, 0.5);
    gathering.finish();
    if (rank == 0) {
      try {
        gathering.rethrow();
      } catch (...) {
        thrown = std::current_exception();
      }
    }
  };
  for (int rank = 1; rank < ranks; ++rank)
    others.emplace_back(one, rank);
  one(0);
  for (std::thread& other : others)
    other.join();
  if (thrown)
    std::rethrow_exception(thrown);
}

std::vector<double> whole_row(int field) {
  std::vector<double> row(columns * planes);
  for (std::size_t i = 0; i < row.size(); ++i)
    row[i] = value(field, i);
  return row;
}

TEST_CASE("long rows of parts come as numbers, or as the checksum of all of them") {
  using Wanted = RowSink::InParts::Wanted;
  for (const int ranks : {2, 3, 5}) {
    CAPTURE(ranks);
    Kept numbers({});
    append_on(ranks, numbers, value);
    Kept checksums({.wanted = Wanted::checksum, .file = {}, .rows = {}});
    append_on(ranks, checksums, value);
    // These ranks cannot write a file together, whatever the sink wants.
    Kept written({.wanted = Wanted::written, .file = "/nowhere/at/all", .rows = {7, 7, 7}});
    append_on(ranks, written, value);
    for (const std::size_t column : {0U, 1U, 3U}) {
      const std::vector<double> row = whole_row(static_cast<int>(column));
      CHECK(numbers.rows[column] == row);
      CHECK(written.rows[column] == row);
      CHECK(checksums.rows[column].empty());
      Checksum checksum;
      checksum.add(std::as_bytes(std::span(row)));
      REQUIRE(checksums.checksums[column]);
      CHECK(checksums.checksums[column]->value() == checksum.value());
      CHECK(checksums.checksums[column]->bytes() == checksum.bytes());
    }
    CHECK(checksums.rows[2] == std::vector{0.5});  // a short row comes as it is
    CHECK(checksums.asked == 3);
    // The twin: one bit of one number.
    Kept altered({.wanted = Wanted::checksum, .file = {}, .rows = {}});
    append_on(ranks, altered, [](int field, std::size_t node) {
      return node == 9999 && field == 1 ? std::nextafter(value(field, node), 2.0) : value(field, node);
    });
    CHECK(altered.checksums[0]->value() == checksums.checksums[0]->value());
    CHECK(altered.checksums[1]->value() != checksums.checksums[1]->value());
  }
}

TEST_CASE("numbers of a part that are not finite are refused as those of a row, where they may not be") {
  using Wanted = RowSink::InParts::Wanted;
  const auto undefined = [](int in) {
    return [in](int field, std::size_t node) {
      return field == in && (node == 12345 || node == 16000) ? std::numeric_limits<double>::infinity()
                                                             : value(field, node);
    };
  };
  for (const int ranks : {2, 4}) {
    Kept sink({.wanted = Wanted::checksum, .file = {}, .rows = {4, 5, 6}});
    CHECK_THROWS_MATCHES(append_on(ranks, sink, undefined(1)), record::NotFinite,
                         Catch::Matchers::Message("record: value 12345 of row 5 of '/v' is inf"));
    CHECK_FALSE(sink.checksums[0]);  // nothing of that level
    Kept other({.wanted = Wanted::checksum, .file = {}, .rows = {4, 5, 6}});
    append_on(ranks, other, undefined(3));
    CHECK(other.checksums[3]);
  }
}

}  // namespace
}  // namespace rubato
