#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include <catch2/catch.hpp>
#include <rubato/ode/state_kernels.hpp>

namespace {

using Numbers = std::vector<double>;

/// high + low + change, in two parts, as the comments say it.
void add_plainly(double& high, double& low, double change) {
  const double sum = high + change, part = sum - high;
  const double rest = low + ((high - (sum - part)) + (change - part));
  high = sum + rest;
  low = rest - (high - sum);
}

}  // namespace

TEST_CASE("kernels over states do what their loops say, bit for bit, of every length") {
  std::mt19937_64 engine(15);
  std::normal_distribution<double> normal;
  for (std::size_t n = 0; n < 70; ++n) {
    const auto numbers = [&](double size) {
      Numbers all(n);
      std::ranges::generate(all, [&] { return size * normal(engine); });
      return all;
    };
    const Numbers high = numbers(1.0), low = numbers(1e-17), delta = numbers(1e-2);
    INFO(n);

    Numbers added = high, rest = low;
    rubato::add_to_state(n, delta.data(), added.data(), rest.data());
    std::size_t wrong = 0, twins = 0;
    for (std::size_t i = 0; i < n; ++i) {
      double expected = high[i], expected_rest = low[i];
      add_plainly(expected, expected_rest, delta[i]);
      wrong += added[i] == expected && rest[i] == expected_rest ? 0 : 1;
      // The twin: Kahan's sum, of three operations less, is another here and there.
      const double change = low[i] + delta[i], sum = high[i] + change;
      twins += sum != expected || change - (sum - high[i]) != expected_rest ? 1 : 0;
    }
    CHECK(wrong == 0);
    CHECK((n < 20 || twins > 0));

    Numbers middle(n), errors(n);
    rubato::middle_of_states(n, high.data(), delta.data(), middle.data(), errors.data());
    for (std::size_t i = 0; i < n; ++i) {
      const double mean = 0.5 * (high[i] + delta[i]);
      CHECK(middle[i] == mean);
      CHECK(errors[i] == 2.0 * (std::abs(mean) + std::abs(delta[i] - high[i])));
      CHECK(errors[i] != 2.0 * std::abs(mean));  // the twin
    }
  }
}
