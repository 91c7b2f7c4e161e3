#include "splittings.hpp"

#include <cmath>

namespace orbits {

namespace {

using Parts = std::vector<rubato::Composition::Part>;

/// A palindrome, whose kinds alternate, from its first half and the middle.
Parts mirrored(bool drift, std::vector<double> half) {
  Parts parts;
  for (const double length : half) {
    parts.push_back({drift, length});
    drift = !drift;
  }
  for (std::size_t i = half.size() - 1; i-- > 0;) {
    parts.push_back(parts[i]);
  }
  return parts;
}

/// Verlet steps of these lengths, and back to the first.
Parts verlet_steps(std::vector<double> lengths) {
  for (std::size_t i = lengths.size() - 1; i-- > 0;) {
    lengths.push_back(lengths[i]);
  }
  Parts parts = {{false, 0.5 * lengths.front()}};
  for (std::size_t i = 0; i < lengths.size(); ++i) {
    parts.push_back({true, lengths[i]});
    parts.push_back({false, 0.5 * (lengths[i] + (i + 1 < lengths.size() ? lengths[i + 1] : 0.0))});
  }
  return parts;
}

double sum(const std::vector<double>& values) {
  double result = 0.0;
  for (const double value : values) {
    result += value;
  }
  return result;
}

/// From lengths of drifts and kicks up to the middle, which has what is left of 1 (its own kind), and the part before
/// it what is left of ½.
Parts completed(bool drift, std::vector<double> own, std::vector<double> other) {
  other.push_back(0.5 - sum(other));
  own.push_back(1.0 - 2.0 * sum(own));
  std::vector<double> half;
  for (std::size_t i = 0; i < other.size(); ++i) {
    half.push_back(own[i]);
    half.push_back(other[i]);
  }
  half.push_back(own.back());
  return mirrored(drift, half);
}

}  // namespace

const std::vector<rubato::Composition>& more_compositions() {
  static const std::vector<rubato::Composition> all = [] {
    const double triple = 1.0 / (2.0 - std::cbrt(2.0));
    const std::vector<double> six = {0.784513610477560, 0.235573213359357, -1.17767998417887};
    std::vector<double> yoshida = six;
    yoshida.push_back(1.0 - 2.0 * sum(six));
    return std::vector<rubato::Composition>{
        {"yoshida-4", 4, "Yoshida, Phys. Lett. A 150 (1990)", verlet_steps({triple, 1.0 - 2.0 * triple})},
        {"yoshida-6", 6, "the same, solution A", verlet_steps(yoshida)},
        // For forces that do not depend on velocities and kinetic energies that are quadratic alone.
        {"blanes-moan-rkn-6b", 6, "Blanes and Moan, J. Comput. Appl. Math. 142 (2002), SRKN 11 b",
         completed(
             false,
             {0.0414649985182624, 0.198128671918067, -0.0400061921041533, 0.0752539843015807, -0.0115113874206879},
             {0.123229775946271, 0.290553797799558, -0.127049212625417, -0.246331761062075, 0.357208872795928})}};
  }();
  return all;
}

const std::vector<rubato::Composition>& planetary_compositions() {
  static const std::vector<rubato::Composition> all = {
      {"Wisdom-Holman", 2, "Wisdom and Holman, Astron. J. 102 (1991)", mirrored(true, {0.5, 1.0})},
      {"Kepler, SABA 3", 2, "Laskar and Robutel, Celest. Mech. Dyn. Astron. 80 (2001)",
       mirrored(true, {0.1 * (5.0 - std::sqrt(15.0)), 5.0 / 18.0, 0.1 * std::sqrt(15.0), 4.0 / 9.0})},
      {"Kepler, ABA 864", 4, "Blanes et al., Appl. Numer. Math. 68 (2013)",
       mirrored(true, {0.0711334264982231177779387300061549964174, 0.183083687472197221961703757166430291072,
                       0.241153427956640098736487795326289649618, 0.310782859898574869507522291054262796375,
                       0.521411761772814789212136078067994229991, -0.0265646185119588006972121379164987592663,
                       -0.333698616227678005726562603400438876027, 0.0653961422823734184559721793911134363710})},
      {"Kepler, Blanes-Moan 4", 4, "as blanes-moan-4", rubato::composition("blanes-moan-4").parts},
      {"Kepler, Kahan-Li 8", 8, "as kahan-li-8", rubato::composition("kahan-li-8").parts}};
  return all;
}

}  // namespace orbits
