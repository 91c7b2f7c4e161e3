// What base offers to all, tested where arrays are.

#include <catch2/catch.hpp>

#include <limits>
#include <vector>

#include <rubato/base/all_finite.hpp>

TEST_CASE("numbers are finite if all are, however many there are") {
  constexpr double infinity = std::numeric_limits<double>::infinity(), nan = std::numeric_limits<double>::quiet_NaN();
  for (std::size_t n = 0; n < 150; ++n) {
    INFO(n);
    std::vector<double> numbers(n);
    for (std::size_t i = 0; i < n; ++i) {
      numbers[i] = i % 3 == 0 ? std::numeric_limits<double>::max() : i % 3 == 1 ? -1e-320 : -0.0;
    }
    CHECK(rubato::all_finite(numbers));
    for (std::size_t i = 0; i < n; ++i) {
      for (const double bad : {infinity, -infinity, nan, -nan}) {
        std::vector<double> spoilt = numbers;
        spoilt[i] = bad;
        CHECK_FALSE(rubato::all_finite(spoilt));
      }
    }
  }
}
