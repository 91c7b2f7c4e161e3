// The checksum of a whole file, of which what is known of pieces is not read again.

#include <cstddef>
#include <random>
#include <span>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/record/detail/checksum.hpp>
#include <rubato/record/detail/files.hpp>

#include "sample.hpp"

namespace {

using namespace rubato;
using record::detail::Integrity;
using record::detail::KnownPiece;
using record::detail::TemporaryFile;

std::string random_text(std::size_t size) {
  std::mt19937 random(3);
  std::string text(size, ' ');
  for (char& c : text)
    c = static_cast<char>(random());
  return text;
}

KnownPiece piece_of(const std::string& text, std::size_t place, std::size_t size) {
  KnownPiece piece{place, {}};
  piece.checksum.add(std::as_bytes(std::span(text)).subspan(place, size));
  return piece;
}

Integrity marked(const std::string& text, const std::vector<KnownPiece>& known) {
  const sample::Folder folder;
  TemporaryFile file(folder / "a.h5", "partial");
  file.append(text);
  mark(file, known);
  CHECK(record::detail::size_of(file.descriptor()) == text.size() + 24);
  return record::detail::integrity_of(file.descriptor());
}

TEST_CASE("a file is marked with the checksum of all its bytes, whichever of them are known") {
  const std::string text = random_text(500'000);
  const auto piece = [&](std::size_t place, std::size_t size) { return piece_of(text, place, size); };
  CHECK(marked(text, {}) == Integrity::intact);
  CHECK(marked(text, {piece(0, 500'000)}) == Integrity::intact);
  CHECK(marked(text, {piece(400'000, 100'000), piece(0, 7), piece(7, 3), piece(1000, 200'000)}) == Integrity::intact);
  CHECK(marked("", {}) == Integrity::intact);
  // Pieces that overlap others, or go beyond the end, are those of something else.
  CHECK(marked(text, {piece(10, 100), piece(50, 1000), piece(2000, 10)}) == Integrity::intact);
  KnownPiece beyond = piece(0, 100'000);
  beyond.place = 450'000;
  CHECK(marked(text, {beyond}) == Integrity::intact);
  beyond.place = 600'000;
  CHECK(marked(text, {beyond}) == Integrity::intact);
  // The twin: what was known is what is sealed, so that other bytes in the file are noticed when it is read.
  std::string other = text;
  other[1234] = static_cast<char>(other[1234] ^ 1);
  CHECK(marked(text, {piece_of(other, 1000, 5000)}) == Integrity::damaged);
}

}  // namespace
