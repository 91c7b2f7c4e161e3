#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <limits>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include <rubato/figures/stored.hpp>
#include <rubato/run/disagreement.hpp>

namespace rubato {

/// What a check finds: how many numbers it compared, and those that disagree.
class Disagreements {
public:
  /// Of each dataset at most this many are listed, the first ones; all are counted.
  static constexpr std::size_t most_listed = 10;

  void add(Disagreement disagreement);
  /// As many more of a dataset of which enough are listed.
  void add_unlisted(const std::string& dataset, std::size_t count);

  /// True if they are other bits; all that are not numbers are the same.
  [[nodiscard]] static bool differ(double stored, double recomputed) {
    return stored != recomputed && !(std::isnan(stored) && std::isnan(recomputed));
  }

  /// Compares a number: the same bits, or both not numbers, or a difference up to tolerance(), which is asked for only
  /// where the bits differ.
  template <typename Tolerance>
  bool compare(std::string_view dataset, std::size_t row, std::optional<std::size_t> index, double stored,
               double recomputed, Tolerance&& tolerance, std::string_view reason) {
    ++compared_;
    if (!differ(stored, recomputed)) {
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
  /// A stored state whose step from the row before was not found again: neither verified nor contradicted.
  void doubt(std::size_t row) { doubtful_.push_back(row); }
  [[nodiscard]] const std::vector<std::size_t>& doubtful() const { return doubtful_; }

  [[nodiscard]] std::size_t compared() const { return compared_; }
  [[nodiscard]] std::size_t disagreements() const { return disagreements_; }
  [[nodiscard]] const std::vector<Disagreement>& listed() const { return listed_; }
  [[nodiscard]] bool has(const std::string& dataset) const { return listed_of_.contains(dataset); }
  /// In place of the stored numbers that disagree, where there is one number in a row.
  [[nodiscard]] const figures::Corrections& corrections() const { return corrections_; }

private:
  std::size_t compared_ = 0, disagreements_ = 0;
  std::vector<std::size_t> doubtful_;
  std::vector<Disagreement> listed_;
  std::map<std::string, std::size_t> listed_of_;
  figures::Corrections corrections_;
};

/// The rounding error of a function of many numbers, where all that is known is the function. Each input is off by a
/// few units in the last place of its scale. Of few inputs each is displaced alone by 2^-26 of its scale and the
/// changes of the function are added up, which bounds what all of them together can do. Of many all are displaced at
/// once with random signs: those of a number at two or three levels go together in some attempts and against each other
/// in the others, so that neither a sum, nor a difference, nor the difference of differences goes unseen. The changes
/// are scaled down to `roundings` units.
class Rounding {
public:
  static constexpr double displacement = 1.0 / (1 << 26);
  static constexpr int displacements = 4;
  /// More inputs than this are displaced at once.
  static constexpr std::size_t few = 48;
  /// The step is solved until corrections stagnate, which leaves it a few units off; evaluating it another way leaves
  /// another few; and a formula may round numbers between that are larger than what is displaced here shows.
  static constexpr double roundings = 64.0;
  static constexpr double unit = roundings * std::numeric_limits<double>::epsilon();

  /// What a run and a check may round in the sum of both energies, K + f'(h), each once.
  [[nodiscard]] static double of_sum(double energy, double potential) {
    return 2.0 * std::numeric_limits<double>::epsilon() * (std::abs(energy) + std::abs(potential));
  }

  /// +1 or -1, at random, the same everywhere; for one number at several levels of consecutive steps (0, 1, 2) the same
  /// but for one of the levels, another in each attempt after the first.
  [[nodiscard]] static double sign(int attempt, std::uint64_t input, int level) {
    const int against = attempt == displacements - 1 ? 0 : attempt;
    std::uint64_t word =
        static_cast<std::uint64_t>(attempt + 1) * 0x9E3779B97F4A7C15 ^ (input + 1) * 0xBF58476D1CE4E5B9;
    word ^= word >> 31;
    word *= 0x94D049BB133111EB;
    return ((word >> 63) != 0) == (attempt > 0 && level == against) ? -1.0 : 1.0;
  }

  /// The tolerances of all outputs. `evaluate(inputs, outputs)`; the inputs are equal shares of numbers of `levels`,
  /// the same numbers in the same order. Of an input with scale 0 nothing is displaced.
  template <typename Evaluate>
  [[nodiscard]] static std::vector<double> tolerances(const std::vector<double>& inputs,
                                                      const std::vector<double>& scales,
                                                      std::initializer_list<int> levels, std::size_t outputs,
                                                      Evaluate&& evaluate) {
    std::vector<double> sound(outputs), moved(outputs), changes(outputs, 0.0), at = inputs;
    evaluate(at, sound);
    const std::size_t share = inputs.size() / levels.size();
    const auto level_of = [&](std::size_t i) { return levels.begin()[i / share]; };
    const auto each_change = [&](auto&& use) {
      evaluate(at, moved);
      for (std::size_t j = 0; j < outputs; ++j) {
        use(changes[j], std::abs(moved[j] - sound[j]) / displacement);
      }
      at = inputs;
    };
    if (inputs.size() <= few) {
      const int last = *std::ranges::max_element(levels);
      for (std::size_t number = 0; number < share; ++number) {
        for (int level = 0; level <= last; ++level) {
          bool any = false;
          for (std::size_t i = number; i < inputs.size(); i += share) {
            const double size = level_of(i) == level ? displacement * scales[i] : 0.0;
            at[i] += size;
            any = any || size > 0.0;
          }
          if (any) {
            each_change([](double& sum, double change) { sum += std::isfinite(change) ? change : 0.0; });
          }
        }
      }
    } else {
      for (int attempt = 0; attempt < displacements; ++attempt) {
        for (std::size_t i = 0; i < inputs.size(); ++i) {
          at[i] += sign(attempt, i % share, level_of(i)) * displacement * scales[i];
        }
        each_change([](double& largest, double change) { largest = change > largest ? change : largest; });
      }
    }
    for (std::size_t j = 0; j < outputs; ++j) {
      changes[j] = unit * (changes[j] + std::abs(sound[j]));
    }
    return changes;
  }
};

}  // namespace rubato
