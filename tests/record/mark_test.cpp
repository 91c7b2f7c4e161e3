// The checksum of a whole file in the mark at its end.

#include <cstddef>
#include <fstream>
#include <random>
#include <string>

#include <catch2/catch.hpp>

#include <rubato/record/detail/checksum.hpp>
#include <rubato/record/detail/files.hpp>

#include "sample.hpp"

namespace {

using namespace rubato;
using record::detail::Integrity;
using record::detail::TemporaryFile;

std::string random_text(std::size_t size) {
  std::mt19937 random(3);
  std::string text(size, ' ');
  for (char& c : text)
    c = static_cast<char>(random());
  return text;
}

TEST_CASE("a file is marked with the checksum of all its bytes") {
  for (const std::size_t size : {0U, 7U, 500'000U}) {
    const sample::Folder folder;
    TemporaryFile file(folder / "a.h5", "partial");
    file.append(random_text(size));
    CHECK(record::detail::integrity_of(file.descriptor()) == Integrity::unknown);
    mark(file);
    CHECK(record::detail::size_of(file.descriptor()) == size + 24);
    CHECK(record::detail::integrity_of(file.descriptor()) == Integrity::intact);
    if (size > 0) {  // the twin: another byte is noticed
      std::fstream bytes(file.path(), std::ios::in | std::ios::out | std::ios::binary);
      bytes.seekg(static_cast<std::streamoff>(size / 2));
      const char other = static_cast<char>(bytes.get() ^ 1);
      bytes.seekp(static_cast<std::streamoff>(size / 2));
      bytes.put(other);
      bytes.close();
      CHECK(record::detail::integrity_of(file.descriptor()) == Integrity::damaged);
    }
  }
}

}  // namespace
