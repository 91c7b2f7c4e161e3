#pragma once

#include <vector>

#include <rubato/base/state.hpp>
#include <rubato/formula/batch.hpp>
#include <rubato/grids/field_set.hpp>
#include <rubato/grids/fourier.hpp>
#include <rubato/pde/cell_sweep.hpp>
#include <rubato/pde/initial_level.hpp>
#include <rubato/pde/linear_waves.hpp>
#include <rubato/pde/multisymplectic_system.hpp>
#include <rubato/pde/placed_coordinates.hpp>
#include <rubato/pde/wave_propagators.hpp>
#include <rubato/pde/wave_rows.hpp>
#include <rubato/variation/composition.hpp>

namespace rubato {

/// A splitting of S = ½ zᵀLz + N(x), L = hessian_of_waves(), x the fields with an equation of motion (theory, sections
/// 8 and 8.3): the flow of the waves, M z_t + Σ_a K_a ∂_a z = Lz, is exact on every wave, and that of M z_t = ∇N(x) at
/// every node. Both are multisymplectic, and so are compositions of them (Ryland, McLachlan, Frank
/// 2007). Two kinds of N have an exact flow here:
///
/// - *kicks*, where no field that N depends on is moved by it: N(u) of a wave equation moves v alone;
/// - *turns*, where it moves pairs of fields around: N(|ψ|²) of Schrödinger equations.
///
/// Beside turns, fields that N depends on and does not move may kick others (the time of a driven system). Linear terms
/// of S go with the waves where they move fields that the waves leave alone: time_t = 1.
///
/// With drifts a_i of the waves and kicks b_i of N the Hamiltonian that generates the composition in h is
/// K = Σ a_i X_1 + Σ b_i X_2, X_1 the energy of the waves, X_2 = Σ ΔV N, each on its own part of the step.
class WaveSplitting {
public:
  /// \throws SchemeRefusal where the linear part cannot be solved for the fields without an
  /// equation of motion (KdV and other potential forms), where N depends on one of these, or where its flow is neither
  /// a kick nor a turn
  /// On the grid of a slab, of the whole lattice (grids::Fourier); fields and rates come with their ghosts then.
  /// \param collocation nodes: Σ K_a ∂_a; corners: Σ K₊δ_a⁺ - K₊ᵀδ_a⁻, second differences of wave equations
  WaveSplitting(const MultisymplecticSystem& system, const grids::Grid& grid,
                Collocation collocation = Collocation::nodes);

  /// \throws SchemeRefusal if the composition is not of its order here: one of Nyström's kind beside turns. Of kicks
  /// [N, [N, [N, L]]] = 0, for L is of degree two in what they move, and N does not depend on that.
  void check(const Composition& composition) const;

  /// See WavePropagators.
  void prepare(const Composition& composition, double h) { propagators_.prepare(composition, h); }

  /// Stands at a level. \throws SchemeRefusal if a potential has a mean slope
  void stand(const LatticeLevel& level);
  /// Goes a step of length h from there; false if a value is not finite.
  [[nodiscard]] bool step(const Composition& composition, double h, bool with_generator = true);
  /// K of that step, if it was asked for.
  [[nodiscard]] double generator() const { return generator_; }
  /// Stands where it led. The waves go on as they are: two transforms of each field are saved, and a kick there that
  /// was the last is the first of the next step.
  void accept();
  /// 𝓔 where it led, and where it stands.
  ///@{
  [[nodiscard]] double energy();
  [[nodiscard]] double energy_here();
  ///@}
  /// All fields where it led, where it stands, and where it stood before accept().
  ///@{
  void fields(grids::FieldSet& fields) { write(moved_, At::led, fields); }
  void fields_here(grids::FieldSet& fields) { write(x_, At::here, fields); }
  void fields_before(grids::FieldSet& fields) { write(before_, At::nowhere, fields); }
  ///@}
  /// Those without an equation of motion, where it stands.
  void others_here(grids::FieldSet& fields) { write_others(x_, fields); }
  /// fields_before() is not asked for.
  void forget_before() { keeps_before_ = false; }
  /// Gives back the memory of the last step, and of what is known of N, which is found again where it is needed.
  void give_back();
  /// Their rates where it led, and where it stands; 0 for fields without equation of motion, and for those that are not
  /// asked for (empty: all are).
  ///@{
  void rates(grids::FieldSet& rates, const std::vector<bool>& asked = {}) {
    write_rates(moved_, At::led, rates, asked);
  }
  void rates_here(grids::FieldSet& rates, const std::vector<bool>& asked = {}) {
    write_rates(x_, At::here, rates, asked);
  }
  ///@}

  /// The waves where it stands, and what is known of the energy there.
  void save(StateWriter& state) const;
  void restore(StateReader& state);

private:
  enum class Flow { none, kick, turn };
  /// Of which waves something is known.
  enum class At { nowhere, here, led };
  /// A real pair of rows: y, if one of them, is what a varying field kicks.
  struct Pair {
    int x, y;
    int kicked_by = -1;  ///< number of the varying field; none
    double rate = 0.0;   ///< by which
  };
  /// A kick that no turn takes along: field p by varying field v.
  struct Kick {
    int p;
    std::size_t v;
    double rate;
  };

  void compile_rest();
  void classify();
  [[nodiscard]] bool is_turn() const;
  void find_pairs();
  [[nodiscard]] double drift(WavePropagators::Propagator& E, bool with_energy);
  [[nodiscard]] double turn_pairs(WavePropagators::Propagator& E, bool with_energy);
  [[nodiscard]] bool kick(double tau);
  [[nodiscard]] bool kick_from_here(double tau);
  void kick_by(std::size_t v, const WaveRows& slopes, double tau);
  void kick_before_turn(const WaveRows& slopes, double tau);
  void finish_kick();
  [[nodiscard]] double evaluate(formula::BatchEvaluator& code, std::span<const double* const> inputs,
                                grids::FieldSet& outputs) const;
  [[nodiscard]] bool evaluate_rest(const WaveRows& rows, At at);
  void write(const WaveRows& rows, At at, grids::FieldSet& fields);
  void write_others(const WaveRows& rows, grids::FieldSet& fields);
  void to_fields(const WaveRows& rows, std::span<const int> which, std::span<const int> to, grids::FieldSet& fields);
  void write_rates(const WaveRows& rows, At at, grids::FieldSet& rates, const std::vector<bool>& asked);
  void forget();

  MultisymplecticSystem system_;
  grids::Grid grid_;
  grids::Fourier fourier_;
  LinearWaves waves_;
  WavePropagators propagators_;
  /// Where all groups are real pairs, and X_1 = ½ Σ (G_xx |x|² + G_yy |y|²): kick, energy and turn are one pass.
  std::vector<Pair> pairs_;
  std::vector<Kick> loose_kicks_;
  const WaveRows* kicking_rows_ = nullptr;  ///< of a kick that the next turn takes along, and its τ; null: none
  double kicking_tau_ = 0.0;
  std::vector<int> varying_;          ///< places of the evolving fields that N depends on
  std::vector<std::size_t> kicking_;  ///< of turns: those of varying_ that are not turned
  bool keeps_before_ = true;
  bool moved_begins_with_varying_ = false;  ///< varying_ is 0, 1, …
  Flow flow_ = Flow::none;
  PlacedCoordinates places_;
  formula::BatchEvaluator rest_;   ///< N and ∇N of the varying fields, in the coordinates
  formula::BatchEvaluator turns_;  ///< of the same and τ: N, and where they are turned to
  WaveRows x_, before_, moved_, next_, work_;
  WaveRows rest_rows_;                 ///< of ∇N
  WaveRows first_kick_;                ///< the same where it stands
  grids::FieldSet values_;             ///< the varying fields at the nodes, then τ
  std::vector<const double*> inputs_;  ///< the varying fields, the coordinates, τ
  grids::FieldSet outputs_;            ///< ∇N
  grids::FieldSet turned_;             ///< where they are turned to
  double rest_energy_ = 0.0;           ///< Σ ΔV N as last evaluated
  double constant_rest_ = 0.0;         ///< the same where N depends on no field
  At rest_at_ = At::nowhere;           ///< what values_ and outputs_ are of
  bool rest_energy_is_known_ = false;  ///< rest_energy_ is of moved_
  bool rest_rows_are_known_ = false;   ///< rest_rows_ are of moved_
  bool first_kick_is_known_ = false, first_energy_is_known_ = false;
  double first_energy_ = 0.0;  ///< Σ ΔV N where it stands
  double generator_ = 0.0;
};

}  // namespace rubato
