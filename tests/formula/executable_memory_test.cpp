#include <rubato/formula/executable_memory.hpp>

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <optional>
#include <set>
#include <thread>
#include <vector>

#include <sys/wait.h>
#include <unistd.h>
#include <catch2/catch.hpp>

#if defined(__x86_64__)

using rubato::formula::ExecutableMemory;

namespace {

/// "mov eax, number; ret", and `more` bytes that are never reached.
std::vector<std::byte> code_of(std::int32_t number, std::size_t more = 0) {
  std::vector<std::byte> code(6 + more, std::byte{0xcc});
  code[0] = std::byte{0xb8};
  std::memcpy(&code[1], &number, sizeof number);
  code[5] = std::byte{0xc3};
  return code;
}

std::int32_t call(const ExecutableMemory& memory) {
  return std::bit_cast<std::int32_t (*)()>(memory.begin())();
}

std::vector<ExecutableMemory> codes(std::int32_t first, std::int32_t count, std::size_t more) {
  std::vector<ExecutableMemory> all;
  for (std::int32_t i = 0; i < count; ++i) {
    std::optional<ExecutableMemory> memory = ExecutableMemory::with(code_of(first + i, more));
    if (memory) {
      all.push_back(std::move(*memory));
    }
  }
  return all;
}

bool are_themselves(const std::vector<ExecutableMemory>& all, std::int32_t first) {
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (call(all[i]) != first + static_cast<std::int32_t>(i)) {
      return false;
    }
  }
  return true;
}

}  // namespace

TEST_CASE("codes stand at multiples of 64 bytes, each at its own, and outlive those that share their pages") {
  // 300 of some 1000 bytes are more than the first pages hold, and one of 3 MB more than any that codes share.
  std::vector<ExecutableMemory> all = codes(1000, 300, 1000);
  REQUIRE(all.size() == 300);
  const std::optional<ExecutableMemory> large = ExecutableMemory::with(code_of(7, 3'000'000));
  REQUIRE(large);
  CHECK(call(*large) == 7);
  std::set<const std::byte*> places;
  for (const ExecutableMemory& memory : all) {
    CHECK(std::bit_cast<std::uintptr_t>(memory.begin()) % 64 == 0);
    places.insert(memory.begin());
  }
  CHECK(places.size() == 300);
  CHECK(are_themselves(all, 1000));
  const ExecutableMemory last = all.back();
  all.clear();
  CHECK(call(last) == 1299);
  const std::vector<ExecutableMemory> others = codes(5000, 100, 1000);
  CHECK(call(last) == 1299);
  CHECK(are_themselves(others, 5000));
}

TEST_CASE("codes are added from many threads at once") {
  std::vector<std::vector<ExecutableMemory>> all(4);
  std::vector<std::thread> threads;
  for (std::int32_t i = 0; i < 4; ++i) {
    threads.emplace_back([i, &mine = all[static_cast<std::size_t>(i)]] { mine = codes(10000 * i, 200, 300); });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  for (std::int32_t i = 0; i < 4; ++i) {
    REQUIRE(all[static_cast<std::size_t>(i)].size() == 200);
    CHECK(are_themselves(all[static_cast<std::size_t>(i)], 10000 * i));
  }
}

TEST_CASE("a process made by fork() writes its codes into pages of its own") {
  const std::vector<ExecutableMemory> before = codes(100, 3, 0);
  std::array<int, 2> pipe_ends{};
  REQUIRE(pipe(pipe_ends.data()) == 0);
  const pid_t child = fork();
  REQUIRE(child >= 0);
  char signal = 0;
  if (child == 0) {
    const bool reported = read(pipe_ends[0], &signal, 1) == 1;  // there are codes of the other process in the meantime
    const std::vector<ExecutableMemory> mine = codes(200, 3, 0);
    _exit(reported && are_themselves(before, 100) && mine.size() == 3 && are_themselves(mine, 200) ? 0 : 1);
  }
  const std::vector<ExecutableMemory> after = codes(300, 3, 0);
  CHECK(write(pipe_ends[1], &signal, 1) == 1);
  int status = -1;
  REQUIRE(waitpid(child, &status, 0) == child);
  CHECK(status == 0);
  CHECK(are_themselves(before, 100));
  CHECK(are_themselves(after, 300));
  close(pipe_ends[0]);
  close(pipe_ends[1]);
}

#endif
