#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <cstring>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include <unistd.h>

#include <rubato/base/little_endian.hpp>
#include <rubato/record/detail/checksum.hpp>
#include <rubato/record/detail/files.hpp>
#include <rubato/record/detail/hdf5.hpp>

namespace rubato::record::detail {

namespace {

constexpr std::size_t width = 8;  // bytes of a number

void append_little_endian(std::string& text, std::uint64_t value) {
  for (std::size_t i = 0; i < width; ++i)
    text += static_cast<char>((value >> (8 * i)) & 0xFF);
}

constexpr std::string_view signature("RUBATO\0\1", width);
constexpr std::size_t mark_size = 3 * width;

void read_exactly(int descriptor, std::span<std::byte> bytes, std::uint64_t place) {
  while (!bytes.empty()) {
    const ssize_t count = ::pread(descriptor, bytes.data(), bytes.size(), static_cast<off_t>(place));
    if (count < 0 && errno == EINTR)
      continue;
    if (count < 0)
      throw Failure("cannot be read: " + std::generic_category().message(errno));
    if (count == 0)
      throw Failure("became shorter while it was read");
    bytes = bytes.subspan(static_cast<std::size_t>(count));
    place += static_cast<std::uint64_t>(count);
  }
}

/// The checksum of the first `size` bytes.
std::uint64_t checksum_of(int descriptor, std::uint64_t size) {
  constexpr std::uint64_t longest = std::uint64_t{1} << 17;
  std::vector<std::byte> block(std::min(longest, size));
  Checksum checksum;
  for (std::uint64_t place = 0; place < size; place += block.size()) {
    const auto part = std::span(block).first(std::min<std::uint64_t>(block.size(), size - place));
    read_exactly(descriptor, part, place);
    checksum.add(part);
  }
  return checksum.value();
}

}  // namespace

Integrity integrity_of(int descriptor) {
  const std::uint64_t size = size_of(descriptor);
  if (size < mark_size)
    return Integrity::unknown;
  std::array<std::byte, mark_size> end{};
  read_exactly(descriptor, end, size - mark_size);
  const bool is_marked =
      std::memcmp(end.data(), signature.data(), width) == 0 && little_endian(end.data() + width) == size - mark_size;
  if (!is_marked)
    return Integrity::unknown;
  return checksum_of(descriptor, size - mark_size) == little_endian(end.data() + 2 * width) ? Integrity::intact
                                                                                            : Integrity::damaged;
}

void mark(TemporaryFile& file) {
  const std::uint64_t size = size_of(file.descriptor());
  std::string text(signature);
  append_little_endian(text, size);
  append_little_endian(text, checksum_of(file.descriptor(), size));
  file.append(text);
}

}  // namespace rubato::record::detail
