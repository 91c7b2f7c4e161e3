// Chunks that are written past HDF5's filter are the bytes that HDF5 makes itself.

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <random>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <catch2/catch.hpp>

#include <rubato/record/detail/chunks.hpp>

#include "sample.hpp"

namespace {

using namespace rubato::record;
using rubato::Checksum;
using sample::Folder;
using Bytes = std::vector<std::byte>;

/// As fletcher32() describes it.
std::uint32_t by_definition(const Bytes& bytes) {
  std::uint64_t sum = 0, weighted = 0;
  bool all_zero = true;
  for (std::size_t i = 0; i < bytes.size(); i += 2) {
    const auto low = i + 1 < bytes.size() ? std::to_integer<unsigned>(bytes[i + 1]) : 0;
    const unsigned number = 256 * std::to_integer<unsigned>(bytes[i]) + low;
    sum += number;
    weighted = (weighted + sum) % 0xFFFF;
    all_zero = all_zero && number == 0;
  }
  const auto half = [&](std::uint64_t value) {
    const std::uint64_t rest = value % 0xFFFF;
    return static_cast<std::uint32_t>(rest == 0 && !all_zero ? 0xFFFF : rest);
  };
  return half(weighted) << 16 | half(sum);
}

detail::Handle make_dataset(hid_t file, const char* name, Type type, const std::vector<hsize_t>& sizes,
                            const std::vector<hsize_t>& chunk, bool compressed = false) {
  const auto rank = static_cast<int>(sizes.size());
  const detail::Handle space(H5Screate_simple(rank, sizes.data(), nullptr), H5Sclose, "making a space");
  const detail::Handle properties(H5Pcreate(H5P_DATASET_CREATE), H5Pclose, "making properties");
  H5Pset_chunk(properties, rank, chunk.data());
  if (compressed)
    H5Pset_deflate(properties, 1);
  H5Pset_fletcher32(properties);
  return {H5Dcreate2(file, name, detail::stored_type(type), space, H5P_DEFAULT, properties, H5P_DEFAULT), H5Dclose,
          "making a dataset"};
}

Bytes stored_chunk(hid_t dataset, const std::vector<hsize_t>& first) {
  hsize_t size = 0;
  detail::check(H5Dget_chunk_storage_size(dataset, first.data(), &size), "looking at a chunk");
  Bytes bytes(size);
  std::uint32_t filters = 0;
  detail::check(H5Dread_chunk(dataset, H5P_DEFAULT, first.data(), &filters, bytes.data()), "reading a chunk");
  return bytes;
}

/// What is there in a file.
Bytes bytes_at(const std::filesystem::path& file, std::uint64_t place, std::size_t count) {
  Bytes bytes(count);
  std::ifstream stream(file, std::ios::binary);
  stream.seekg(static_cast<std::streamoff>(place));
  stream.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(count));
  return bytes;
}

Bytes random_bytes(std::size_t size, std::mt19937& random) {
  Bytes bytes(size);
  std::ranges::generate(bytes, [&] { return static_cast<std::byte>(random()); });
  return bytes;
}

}  // namespace

TEST_CASE("Fletcher's checksum is the one of its definition and of HDF5") {
  const Folder folder;
  std::mt19937 random(5);
  const detail::Session session;
  const detail::Handle file = detail::create_file(folder / "a.h5");
  const auto by_hdf5 = [&](const Bytes& bytes) {
    static int number = 0;
    const detail::Handle dataset =
        make_dataset(file, fmt::format("d{}", ++number).c_str(), Type::u8, {bytes.size()}, {bytes.size()});
    H5Dwrite(dataset, H5T_NATIVE_UINT8, H5S_ALL, H5S_ALL, H5P_DEFAULT, bytes.data());
    H5Dflush(dataset);
    const Bytes stored = stored_chunk(dataset, {0});
    REQUIRE(stored.size() == bytes.size() + 4);
    std::uint32_t checksum = 0;
    std::memcpy(&checksum, stored.data() + bytes.size(), 4);
    return checksum;
  };
  // About the ends of rounds of 32 bytes, of blocks of 256 rounds, and of HDF5's own blocks of 720.
  for (const std::size_t size : {1, 2, 3, 31, 32, 33, 63, 64, 719, 720, 721, 8191, 8192, 8193, 8224, 100'001}) {
    CAPTURE(size);
    for (const Bytes& bytes : {random_bytes(size, random), Bytes(size, std::byte{0}), Bytes(size, std::byte{0xFF})}) {
      const std::uint32_t checksum = detail::fletcher32(bytes);
      CHECK(checksum == by_definition(bytes));
      CHECK(checksum == by_hdf5(bytes));
      Bytes other = bytes;
      other[random() % size] ^= std::byte{0x40};
      CHECK(detail::fletcher32(other) != checksum);
    }
  }
  // Sums that are multiples of 2^16 - 1, of numbers that are not.
  for (const std::vector<unsigned char>& values :
       {std::vector<unsigned char>{0x80, 0, 0x7F, 0xFF}, {0xFF, 0xFE, 0, 1}, {0, 1, 0xFF, 0xFD, 0, 1}}) {
    Bytes bytes(values.size());
    std::memcpy(bytes.data(), values.data(), values.size());
    CHECK((detail::fletcher32(bytes) & 0xFFFF) == 0xFFFF);
    CHECK(detail::fletcher32(bytes) == by_hdf5(bytes));
  }
}

TEST_CASE("chunks that are written whole are those that HDF5 writes") {
  struct Case {
    Type type;
    std::vector<hsize_t> sizes, chunk;
  };
  const auto& [type, sizes, chunk] = GENERATE(Case{Type::f64, {7}, {3}}, Case{Type::f64, {6, 11}, {2, 11}},
                                              Case{Type::f64, {3, 11}, {1, 4}}, Case{Type::f64, {3, 10, 6}, {1, 4, 6}},
                                              Case{Type::i32, {9, 2, 2}, {4, 2, 2}}, Case{Type::u8, {33}, {11}});
  const Folder folder;
  std::mt19937 random(7);
  const detail::Session session;
  const detail::Handle file = detail::create_file(folder / "a.h5");
  const detail::Handle ours = make_dataset(file, "ours", type, sizes, chunk),
                       theirs = make_dataset(file, "theirs", type, sizes, chunk);
  std::size_t row_bytes = detail::size_of(type);
  for (std::size_t i = 1; i < sizes.size(); ++i)
    row_bytes *= sizes[i];
  const Bytes bytes = random_bytes(row_bytes * sizes[0], random);
  Bytes waiting = bytes;  // with room behind, which is given back as it was
  waiting.resize(bytes.size() + detail::ChunkWriter::room_behind, std::byte{0x55});
  const Bytes before = waiting;
  const hid_t memory = detail::memory_type(type);
  H5Dwrite(theirs, memory, H5S_ALL, H5S_ALL, H5P_DEFAULT, bytes.data());
  H5Dflush(theirs);
  auto chunks = detail::ChunkWriter::of(ours, type);
  REQUIRE(chunks);
  std::size_t place = 0, written = 0;
  for (std::size_t count; (count = chunks->bytes_at(place)) > 0 && place + count <= bytes.size(); ++written) {
    if (count > 1)
      CHECK(chunks->bytes_at(place + 1) == 0);
    Checksum known, sum;
    known.add(std::span(bytes).subspan(place, count));
    if (written % 2 == 0)
      sum = known;
    chunks->write(place, std::span(waiting).subspan(place, count), &sum);
    CHECK(waiting == before);
    const std::size_t plane = row_bytes / (sizes.size() > 1 ? sizes[1] : 1);
    std::vector<hsize_t> first(sizes.size(), 0);
    first[0] = place / row_bytes;
    if (first.size() > 1)
      first[1] = place % row_bytes / plane;
    const Bytes stored = stored_chunk(ours, first);
    CHECK(stored == stored_chunk(theirs, first));
    Checksum of_stored;
    of_stored.add(stored);
    CHECK(sum.value() == of_stored.value());
    CHECK(sum.bytes() == stored.size());
    const auto piece = chunks->find(place, sum);
    REQUIRE(piece);
    CHECK(bytes_at(folder / "a.h5", piece->place, stored.size()) == stored);
    CHECK_FALSE(chunks->find(place, known));  // has fewer bytes than the chunk
    place += count;
  }
  const hsize_t whole = sizes[0] - sizes[0] % chunk[0];  // rows
  CHECK(place == whole * row_bytes);
  CHECK(written > 1);
  Bytes read(place);
  detail::read_rows(ours, memory, 0, whole, read.data());
  CHECK(std::equal(read.begin(), read.end(), bytes.begin()));

  // The twin: a checksum that is another is noticed.
  const std::vector<hsize_t> first(sizes.size(), 0);
  Bytes stored = stored_chunk(ours, first);
  stored.back() ^= std::byte{1};
  H5Dwrite_chunk(ours, H5P_DEFAULT, 0, first.data(), stored.size(), stored.data());
  CHECK_THROWS_AS(detail::read_rows(ours, memory, 0, 1, read.data()), detail::Failure);
}

TEST_CASE("chunks with other filters, or that are no pieces of rows, are left to HDF5") {
  const Folder folder;
  const detail::Session session;
  const detail::Handle file = detail::create_file(folder / "a.h5");
  CHECK(detail::ChunkWriter::of(make_dataset(file, "a", Type::f64, {4, 6}, {2, 6}), Type::f64));
  CHECK_FALSE(detail::ChunkWriter::of(make_dataset(file, "b", Type::f64, {4, 6}, {2, 6}, true), Type::f64));
  CHECK_FALSE(detail::ChunkWriter::of(make_dataset(file, "c", Type::f64, {4, 6}, {2, 3}), Type::f64));
  CHECK_FALSE(detail::ChunkWriter::of(make_dataset(file, "d", Type::f64, {4, 6, 6}, {1, 6, 3}), Type::f64));
  CHECK_FALSE(detail::ChunkWriter::of(make_dataset(file, "e", Type::f64, {4, 6}, {2, 6}), Type::i64));
}
