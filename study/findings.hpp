#pragma once

#include <bit>
#include <cmath>
#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include <rubato/figures/stored.hpp>
#include <rubato/study/disagreement.hpp>

namespace rubato::study {

/// What a check finds: how many numbers it compared, and those that disagree.
class Findings {
public:
  /// Of each dataset at most this many are listed, the first ones; all are counted.
  static constexpr std::size_t most_listed = 10;

  void add(Disagreement disagreement);

  /// Compares a number: the same bits, or both not numbers, or a difference up to tolerance(), which is asked for only
  /// where the bits differ.
  template <typename Tolerance>
  bool compare(std::string_view dataset, std::size_t row, std::optional<std::size_t> index, double stored,
               double recomputed, Tolerance&& tolerance, std::string_view reason) {
    ++compared_;
    if (stored == recomputed || (std::isnan(stored) && std::isnan(recomputed))) {
      return true;
    }
    double allowed = 0.0;
    if (std::isfinite(stored) && std::isfinite(recomputed)) {
      allowed = tolerance();
      if (std::abs(stored - recomputed) <= allowed) {
        return true;
      }
    }
    add({.dataset = std::string(dataset),
         .row = row,
         .index = index,
         .stored = stored,
         .recomputed = recomputed,
         .tolerance = allowed,
         .reason = std::string(reason)});
    return false;
  }
  /// One that has to be the same to the last bit.
  bool same(std::string_view dataset, std::size_t row, std::optional<std::size_t> index, double stored,
            double recomputed, std::string_view reason) {
    return compare(
        dataset, row, index, stored, recomputed, [] { return 0.0; }, reason);
  }
  void count(std::size_t compared) { compared_ += compared; }

  [[nodiscard]] std::size_t compared() const { return compared_; }
  [[nodiscard]] std::size_t disagreements() const { return disagreements_; }
  [[nodiscard]] const std::vector<Disagreement>& listed() const { return listed_; }
  /// In place of the stored numbers that disagree, where there is one number in a row.
  [[nodiscard]] const figures::Corrections& corrections() const { return corrections_; }

private:
  std::size_t compared_ = 0, disagreements_ = 0;
  std::vector<Disagreement> listed_;
  std::map<std::string, std::size_t> listed_of_;
  figures::Corrections corrections_;
};

/// What rounding makes of a function of many numbers, where all that is known is the function. Each input is off by a
/// few units in the last place of its scale, in a direction of its own: the function is evaluated at inputs displaced
/// by 2^-26 of their scales with random signs, and its changes are scaled down to `roundings` units. Of four
/// displacements two move the two levels of a step together, as far as sums are concerned, and two against each other.
class Rounding {
public:
  static constexpr double displacement = 1.0 / (1 << 26);
  static constexpr int displacements = 4;
  /// The step is solved until corrections stagnate, which leaves it a few units off; evaluating it another way leaves
  /// another few; and a sum of four random displacements may be four times less than the worst.
  static constexpr double roundings = 64.0;
  static constexpr double unit = roundings * std::numeric_limits<double>::epsilon();

  /// +1 or -1, at random, the same everywhere; for one number at the two levels of a step the same in even attempts,
  /// and opposite in odd ones.
  [[nodiscard]] static double sign(int attempt, std::uint64_t input, bool after) {
    std::uint64_t word =
        static_cast<std::uint64_t>(attempt + 1) * 0x9E3779B97F4A7C15 ^ (input + 1) * 0xBF58476D1CE4E5B9;
    word ^= word >> 31;
    word *= 0x94D049BB133111EB;
    return ((word >> 63) != 0) == (after && attempt % 2 != 0) ? -1.0 : 1.0;
  }

  /// The tolerances of all outputs. `evaluate(inputs, outputs)`; of an input with scale 0 nothing is displaced.
  template <typename Evaluate>
  [[nodiscard]] static std::vector<double> tolerances(std::vector<double> inputs, const std::vector<double>& scales,
                                                      std::size_t outputs, Evaluate&& evaluate) {
    std::vector<double> sound(outputs), moved(outputs), result(outputs, 0.0);
    evaluate(inputs, sound);
    const std::vector<double> exact = inputs;
    const std::size_t half = (inputs.size() + 1) / 2;  // of a step: the level before
    for (int attempt = 0; attempt < displacements; ++attempt) {
      for (std::size_t i = 0; i < inputs.size(); ++i) {
        inputs[i] = exact[i] + sign(attempt, i % half, i >= half) * displacement * scales[i];
      }
      evaluate(inputs, moved);
      for (std::size_t j = 0; j < outputs; ++j) {
        const double change = std::abs(moved[j] - sound[j]) / displacement;
        result[j] = change > result[j] ? change : result[j];
      }
    }
    for (std::size_t j = 0; j < outputs; ++j) {
      result[j] = unit * (result[j] + std::abs(sound[j]));
    }
    return result;
  }
};

}  // namespace rubato::study
