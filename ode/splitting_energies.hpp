#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include <rubato/formula/batch.hpp>
#include <rubato/ode/splitting_formula.hpp>
#include <rubato/variation/level_scheme.hpp>

namespace rubato {

/// E_k of steps of several lengths from one level, by an explicit splitting: side by side in vectors, where one step
/// alone waits for one result after the other. The formulas are those of the step; of sine, exponential and their like
/// the vectors' own are taken (BatchEvaluator), so that results are those of single steps to rounding, and the same on
/// every machine.
class SplittingEnergies {
public:
  static constexpr std::size_t count = LevelScheme::abreast;

  SplittingEnergies(const SplittingHalf& T, const SplittingHalf& V, const Composition& composition);
  // The stages are bound to the rows.
  SplittingEnergies(const SplittingEnergies&) = delete;
  SplittingEnergies& operator=(const SplittingEnergies&) = delete;

  /// What they take, in steps of one length: told from the formulas, so that it is the same on every machine.
  /// Infinite where nothing is gained: long steps, and those of which formulas go in vectors by themselves.
  [[nodiscard]] double price() const { return price_; }
  /// At z, 2n entries, without its low digits. price() is finite.
  void operator()(std::span<const double> z, std::span<const double, count> h, std::span<double, count> energies);

private:
  /// One number for each length.
  struct alignas(64) Row {
    double values[count];
  };
  void by_parts(std::span<const double, count> h, std::span<double, count> energies);
  void make_rows(std::size_t count_of_rows);
  void bind(formula::BatchEvaluator& stage, std::span<Row> from, std::span<Row> to);

  const Composition* composition_;
  std::size_t n_;
  double price_;
  bool is_whole_ = false;
  /// The whole step; or of two parts, and of the last one alone, each from the first place to the second and back.
  std::vector<formula::BatchEvaluator> stages_;
  std::vector<Row> memory_;
  std::array<std::span<Row>, 2> rows_;  ///< of the whole z and h, and E; or z, E and what parts take in two places
};

}  // namespace rubato
