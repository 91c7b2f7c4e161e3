#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include <rubato/formula/batch.hpp>
#include <rubato/grids/field_set.hpp>
#include <rubato/pde/linear_waves.hpp>
#include <rubato/pde/wave_loops.hpp>
#include <rubato/pde/wave_rows.hpp>
#include <rubato/variation/composition.hpp>

namespace rubato {

/// exp(τA) of LinearWaves on every wave, for the lengths τ of a composition's drifts.
class WavePropagators {
public:
  /// For one τ.
  struct Propagator {
    double tau = 0.0;
    std::size_t used = 0;    ///< for which step last
    WaveRows entries;        ///< row·size + column; none before the first; of real pairs without im
    grids::FieldSet mended;  ///< of real pairs, by their first field: what rounding has left of their determinant
  };

  /// \param waves has to outlive this
  explicit WavePropagators(const LinearWaves& waves);

  /// Makes room for steps of this composition, and those of steps of length h: so steps allocate nothing, whatever
  /// their lengths are, and the first one takes as long as others.
  void prepare(const Composition& composition, double h);
  /// Those of a step of length h. Products of one length with h have the same bits, be they numbers or not.
  void make(const Composition& composition, double h);
  /// Of a part of that step, which is a drift.
  [[nodiscard]] Propagator& of_part(std::size_t part) { return propagators_[of_parts_[part]]; }
  /// Of a real pair.
  [[nodiscard]] PairMatrices turns(Propagator& propagator, int x, int y) const;

private:
  [[nodiscard]] bool turns_without_diagonal() const;
  void find_frequencies();
  void fill(double tau, WaveRows& entries);
  void fill_by_frequencies(std::span<const std::size_t> places);
  void fill_missing();
  void make_room(Propagator& propagator) const;
  [[nodiscard]] std::size_t place_of(double tau);

  const LinearWaves& waves_;
  bool is_one_cosine_;            ///< whether both diagonal entries of each pair are one row
  grids::FieldSet frequencies_;   ///< ω of each group and wave, where the pairs turn and are few; none elsewhere
  grids::FieldSet of_sines_;      ///< of each such group what multiplies sin(ωτ) in its matrix: b, then c
  formula::BatchEvaluator turn_;  ///< cosine and sine of an angle
  std::size_t at_once_ = 1;       ///< of how many τ
  grids::FieldSet angles_;        ///< of the waves, their cosines and sines
  std::vector<Propagator> propagators_;
  std::size_t replaced_ = 0, steps_prepared_ = 0;
  std::vector<std::size_t> of_parts_;  ///< places of the propagators of the last step's parts
  std::vector<std::size_t> missing_;   ///< places of those to be filled
};

}  // namespace rubato
