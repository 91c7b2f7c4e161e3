#include <rubato/variation/composition.hpp>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>

#include <fmt/format.h>

namespace rubato {

namespace {

using CompositionParts = std::vector<Composition::Part>;

/// A palindrome from its first half, the middle part last: kinds alternate, beginning with `drift`.
CompositionParts palindrome(bool drift, const std::vector<double>& half) {
  CompositionParts parts;
  for (std::size_t i = 0; i < half.size(); ++i, drift = !drift) {
    parts.push_back({drift, half[i]});
  }
  for (std::size_t i = half.size() - 1; i-- > 0;) {
    parts.push_back(parts[i]);
  }
  return parts;
}

/// The same, from all but the last of its own drifts and all but the last of the kicks between them, which sum to 1.
CompositionParts completed_palindrome(const std::vector<double>& drifts, std::vector<double> kicks) {
  kicks.push_back(0.5 - std::accumulate(kicks.begin(), kicks.end(), 0.0));
  std::vector<double> half;
  for (std::size_t i = 0; i < drifts.size(); ++i) {
    half.push_back(drifts[i]);
    half.push_back(kicks[i]);
  }
  half.push_back(1.0 - 2.0 * std::accumulate(drifts.begin(), drifts.end(), 0.0));
  return palindrome(true, half);
}

/// Verlet steps of these lengths and back; kicks that meet are one.
CompositionParts of_verlet(const std::vector<double>& half) {
  std::vector<double> lengths = half;
  for (std::size_t i = half.size() - 1; i-- > 0;) {
    lengths.push_back(half[i]);
  }
  CompositionParts parts = {{false, 0.5 * lengths.front()}};
  for (std::size_t i = 0; i < lengths.size(); ++i) {
    const double next = i + 1 < lengths.size() ? lengths[i + 1] : 0.0;
    parts.push_back({true, lengths[i]});
    parts.push_back({false, 0.5 * (lengths[i] + next)});
  }
  return parts;
}

std::vector<Composition> make_compositions() {
  const double golden = (3.0 - std::sqrt(5.0)) / 4.0;
  const double suzuki = 1.0 / (4.0 - std::cbrt(4.0));
  return {
      {"golden", 2, "theory, section 8.2", palindrome(true, {golden, 0.5, 1.0 - 2.0 * golden}),
       -0.5 * (7.0 - 3.0 * std::sqrt(5.0))},
      {"verlet", 2, "Störmer 1907, Verlet 1967", of_verlet({1.0})},
      {"suzuki-4", 4, "Suzuki, Phys. Lett. A 146 (1990)", of_verlet({suzuki, suzuki, 1.0 - 4.0 * suzuki})},
      {"blanes-moan-4", 4, "Blanes and Moan, J. Comput. Appl. Math. 142 (2002)",
       completed_palindrome({0.0792036964311957, 0.353172906049774, -0.0420650803577195},
                            {0.209515106613362, -0.143851773179818})},
      {"kahan-li-6", 6, "Kahan and Li, Math. Comp. 66 (1997), s9odr6a",
       of_verlet({0.39216144400731413927925056, 0.33259913678935943859974864, -0.70624617255763935980996482,
                  0.08221359629355080023149045, 0.79854399093482996339895035})},
      {"kahan-li-8", 8, "Kahan and Li, Math. Comp. 66 (1997), s17odr8a",
       of_verlet({0.13020248308889008087881763, 0.56116298177510838456196441, -0.38947496264484728640807860,
                  0.15884190655515560089621075, -0.39590389413323757733623154, 0.18453964097831570709183254,
                  0.25837438768632204729397911, 0.29501172360931029887096624, -0.60550853383003451169892108})},
      {.name = "blanes-moan-rkn-6",
       .order = 6,
       .source = "Blanes and Moan, J. Comput. Appl. Math. 142 (2002), SRKN 14 a",
       .parts = completed_palindrome({0.0378593198406116, 0.102635633102435, -0.0258678882665587, 0.314241403071447,
                                      -0.130144459517415, 0.106417700369543, -0.00879424312851058},
                                     {0.09171915262446165, 0.183983170005006, -0.05653436583288827,
                                      0.004914688774712854, 0.143761127168358, 0.328567693746804}),
       .of_quadratic_kinetic_energy = true},
  };
}

}  // namespace

double Composition::magnitude() const {
  double drifts = 0.0, kicks = 0.0;
  for (const Part& part : parts) {
    (part.drift ? drifts : kicks) += std::abs(part.length);
  }
  return std::max(drifts, kicks);
}

bool Composition::is_of_verlet_steps() const {
  constexpr double rounding = 1e-15;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    if (parts[i].drift) {
      continue;
    }
    const double around = (i > 0 ? parts[i - 1].length : 0.0) + (i + 1 < parts.size() ? parts[i + 1].length : 0.0);
    if (!(std::abs(parts[i].length - 0.5 * around) <= rounding)) {
      return false;
    }
  }
  return !parts.empty() && !parts.front().drift && !parts.back().drift;
}

std::vector<std::string_view> compositions_of_verlet_steps() {
  std::vector<std::string_view> names;
  for (const Composition& one : compositions()) {
    if (one.is_of_verlet_steps()) {
      names.push_back(one.name);
    }
  }
  return names;
}

std::span<const Composition> compositions() {
  static const std::vector<Composition> all = make_compositions();
  return all;
}

const Composition& composition(std::string_view name) {
  const auto all = compositions();
  const auto found = std::ranges::find(all, name, &Composition::name);
  if (found == all.end()) {
    std::string names;
    for (const Composition& one : all) {
      names += fmt::format("{}{}", names.empty() ? "" : ", ", one.name);
    }
    throw std::invalid_argument(fmt::format("there is no composition \"{}\"; there are {}", name, names));
  }
  return *found;
}

const Composition& composition_of_order(int order) {
  switch (order) {
    case 2: return composition("golden");
    case 4: return composition("blanes-moan-4");
    case 6: return composition("kahan-li-6");
    case 8: return composition("kahan-li-8");
    default:
      throw std::invalid_argument(
          fmt::format("there is no composition of order {}; there are those of order 2, 4, 6 and 8", order));
  }
}

}  // namespace rubato
