// Arrays are zero at the start, and take memory where something is written alone.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cstdint>
#include <fstream>
#include <utility>

#include <unistd.h>

#include <rubato/grids/buffer.hpp>
#include <rubato/grids/field_set.hpp>

using namespace rubato;

namespace {

/// Bytes of memory that this process holds now.
double resident() {
  std::ifstream file("/proc/self/statm");
  double size = 0.0, pages = 0.0;
  file >> size >> pages;
  return pages * static_cast<double>(::sysconf(_SC_PAGESIZE));
}

bool is_aligned(const double* place) {
  return reinterpret_cast<std::uintptr_t>(place) % grids::Buffer::alignment == 0;
}

}  // namespace

TEST_CASE("An array of any size is aligned and zero, also where another one was") {
  // Of the heap, and mappings of their own.
  for (const std::size_t size : {1U, 7U, 1000U, 100'003U, 524'287U, 524'288U, 1'000'001U}) {
    for (int again = 0; again < 2; ++again) {
      grids::Buffer buffer(size);
      REQUIRE(buffer.size() == size);
      CHECK(is_aligned(buffer.data()));
      CHECK(std::ranges::all_of(buffer.span(), [](double value) { return value == 0.0; }));
      std::ranges::fill(buffer.span(), 1.0);
      const double* const place = buffer.data();
      const grids::Buffer moved = std::move(buffer);
      CHECK(moved.data() == place);
      CHECK(moved[size - 1] == 1.0);
    }
  }
  CHECK(grids::Buffer(0).data() == nullptr);
  CHECK_THROWS_AS(grids::Buffer(~std::size_t{0} / sizeof(double)), std::bad_alloc);
  CHECK_THROWS_AS(grids::Buffer(std::size_t{1} << 58), std::bad_alloc);
}

TEST_CASE("Fields that nothing is written to take no memory") {
  constexpr std::size_t nodes = 1'000'000;
  constexpr double bytes_of_field = 8.0 * nodes;
  const double before = resident();
  grids::FieldSet fields(10, nodes);
  CHECK(resident() - before < 0.5 * bytes_of_field);
  std::ranges::fill(fields.field(3), 1.0);
  // The twin; pages of 2 MiB reach into the neighbours.
  CHECK(resident() - before > 0.9 * bytes_of_field);
  CHECK(resident() - before < 2.0 * bytes_of_field);
}
