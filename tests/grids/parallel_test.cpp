// Loops over OpenMP's threads, and who does them.

#include <catch2/catch.hpp>

#include <atomic>
#include <cstddef>
#include <thread>
#include <vector>

#include <rubato/grids/parallel.hpp>

using namespace rubato;

namespace {

constexpr std::size_t count = 1001;

TEST_CASE("Every index is taken once, by a thread that has a number") {
  for (const bool worth_threads : {false, true}) {
    std::vector<std::atomic<int>> taken(count);
    std::vector<std::size_t> by(count, ~std::size_t{0});
    grids::for_each_index(count, worth_threads, [&](std::size_t index, std::size_t thread) {
      ++taken[index];
      by[index] = thread;
    });
    for (std::size_t index = 0; index < count; ++index) {
      REQUIRE(taken[index] == 1);
      REQUIRE(by[index] < static_cast<std::size_t>(grids::thread_count()));
    }
  }
}

TEST_CASE("What is not worth threads is done in order by the thread that asks") {
  const std::thread::id caller = std::this_thread::get_id();
  std::vector<std::size_t> order;
  bool by_caller = true;
  grids::for_each_index(count, false, [&](std::size_t index, std::size_t thread) {
    order.push_back(index);
    by_caller = by_caller && thread == 0 && std::this_thread::get_id() == caller;
  });
  CHECK(by_caller);
  REQUIRE(order.size() == count);
  for (std::size_t i = 0; i < count; ++i) {
    REQUIRE(order[i] == i);
  }
}

TEST_CASE("Threads of one loop do loops of their own alone") {
  // As members of an ensemble do: each is thread 0 of its own, whose workspaces nobody else has.
  constexpr std::size_t members = 4;
  std::vector<std::size_t> sums(members, 0);
  std::vector<char> alone(members, 1);
  grids::for_each_index(members, true, [&](std::size_t member, std::size_t) {
    const std::thread::id own = std::this_thread::get_id();
    grids::for_each_index(count, true, [&](std::size_t index, std::size_t thread) {
      sums[member] += index;
      alone[member] = alone[member] != 0 && thread == 0 && std::this_thread::get_id() == own;
    });
    grids::for_each_block(count, 10, [&](std::size_t begin, std::size_t end, std::size_t thread) {
      sums[member] += end - begin;
      alone[member] = alone[member] != 0 && thread == 0 && std::this_thread::get_id() == own;
    });
  });
  for (std::size_t member = 0; member < members; ++member) {
    CHECK(sums[member] == count * (count - 1) / 2 + count);
    CHECK(alone[member] != 0);
  }
}

}  // namespace
