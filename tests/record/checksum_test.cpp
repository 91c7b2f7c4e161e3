#include <algorithm>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/base/checksum.hpp>

namespace rubato {
namespace {

Checksum of(std::string_view text) {
  Checksum checksum;
  checksum.add(std::as_bytes(std::span(text)));
  return checksum;
}

TEST_CASE("checksums are CRC-64/XZ") {
  CHECK(of("").value() == 0);
  CHECK(of("123456789").value() == 0x995DC9BBDF1939FA);  // the check value of the CRC catalogue
}

TEST_CASE("checksums of many bytes at once are those of few at a time, wherever they begin and end") {
  std::string text;
  for (std::uint32_t i = 0, x = 7; i < 3000; ++i)
    text += static_cast<char>((x = x * 1664525 + 1013904223) >> 24);
  const auto bytes = std::as_bytes(std::span(text));
  for (std::size_t count = 0; count < 700; ++count) {
    const auto some = bytes.subspan(count % 17, count < 350 ? count : 4 * count - 300);
    Checksum at_once, piecewise;
    at_once.add(some.first(some.size() / 3));  // goes on from a state that is not the first
    at_once.add(some.subspan(some.size() / 3));
    for (std::size_t at = 0; at < some.size(); at += 5)
      piecewise.add(some.subspan(at, std::min<std::size_t>(5, some.size() - at)));
    CHECK(at_once.value() == piecewise.value());
    CHECK(at_once.bytes() == some.size());
  }
  // The twin: one bit, in each of the places that go side by side.
  for (const std::size_t place : {0U, 15U, 16U, 40U, 63U, 64U, 1000U, 2999U}) {
    std::string altered = text;
    altered[place] = static_cast<char>(altered[place] ^ 16);
    CHECK(of(altered).value() != of(text).value());
  }
}

TEST_CASE("a checksum is put together out of those of pieces, wherever they are cut") {
  std::string text;
  for (std::uint32_t i = 0, x = 1; i < 5000; ++i)
    text += static_cast<char>((x = x * 1664525 + 1013904223) >> 24);
  const Checksum whole = of(text);
  for (const std::size_t cut : {0U, 1U, 7U, 8U, 9U, 2500U, 4096U, 4999U, 5000U}) {
    Checksum first = of(text.substr(0, cut));
    const Checksum second = of(text.substr(cut));
    Checksum swapped = second;
    swapped.append(first);
    first.append(second);
    CHECK(first.value() == whole.value());
    CHECK(first.bytes() == whole.bytes());
    // The twin: pieces in another order are other bytes.
    CHECK((swapped.value() == whole.value()) == (cut == 0 || cut == text.size()));
  }
  // Going on from a value, as from one that a record has, with single bytes and with pieces.
  Checksum resumed(of(text.substr(0, 1234)).value());
  resumed.append(of(text.substr(1234, 1000)));
  resumed.add(std::as_bytes(std::span(text).subspan(2234)));
  CHECK(resumed.value() == whole.value());
  Checksum altered = resumed;
  text[3000] = static_cast<char>(text[3000] ^ 1);
  CHECK(of(text).value() != altered.value());
}

}  // namespace
}  // namespace rubato
