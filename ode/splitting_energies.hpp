#pragma once

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

  const Composition* composition_;
  std::size_t n_;
  double price_;
  bool is_whole_ = false;
  std::vector<formula::BatchEvaluator> stages_;  ///< the whole step; or two parts, and one
  std::vector<Row> inputs_, outputs_;            ///< of the whole; or z and E in two places
  std::vector<Row> changes_, weights_;           ///< of parts
  std::vector<const double*> from_;
  std::vector<double*> to_;
};

}  // namespace rubato
