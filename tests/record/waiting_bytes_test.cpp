#include <algorithm>
#include <cstddef>
#include <cstring>
#include <random>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/record/detail/waiting_bytes.hpp>

namespace {

using rubato::record::detail::WaitingBytes;

TEST_CASE("bytes that wait are what came and has not left, whatever was expected") {
  std::mt19937 random(11);
  for (const std::size_t expected : {0, 1, 5000, 1 << 20, 8 << 20}) {
    WaitingBytes waiting(expected);
    std::vector<std::byte> other;  // the same by a vector alone
    std::size_t most = 0;
    for (int round = 0; round < 400; ++round) {
      std::vector<std::byte> some(random() % 20'000);
      for (std::byte& byte : some)
        byte = static_cast<std::byte>(random());
      if (round % 3 == 0 && !some.empty())
        std::memcpy(waiting.append(some.size()), some.data(), some.size());
      else
        waiting.append(some);
      other.insert(other.end(), some.begin(), some.end());
      most = std::max(most, other.size());
      if (random() % 16 == 0) {
        const std::size_t left = random() % (other.size() + 1);
        waiting.drop_front(left);
        other.erase(other.begin(), other.begin() + static_cast<std::ptrdiff_t>(left));
      }
      if (random() % 16 == 0) {
        const std::size_t kept = random() % (other.size() + 1);
        waiting.keep_front(kept);
        other.resize(kept);
      }
      REQUIRE(waiting.size() == other.size());
      REQUIRE(waiting.empty() == other.empty());
      REQUIRE((other.empty() || std::memcmp(waiting.data(), other.data(), other.size()) == 0));
    }
    CHECK(most > 100'000);  // beyond what some of them expected
  }
}

}  // namespace
