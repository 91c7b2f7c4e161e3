#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include <rubato/formula/batch.hpp>
#include <rubato/formula/rounding.hpp>
#include <rubato/ode/hamiltonian.hpp>
#include <rubato/variation/composition.hpp>

namespace rubato {

/// Orbits of one H side by side, on fixed levels by an explicit splitting (make_splitting_scheme): one step of all of
/// them is one formula in vectors, from z_k to z_{k+1} with its low digits, E_k, H and Γ at the new level and whatever
/// else is observed there. Each orbit has a start, a step and an end of its own, and every number is what
/// OrbitIntegrator gives for it alone, bit for bit. One in which anything is not finite is left to that.
class SplittingLanes {
public:
  /// What a quantity was along an orbit.
  struct Along {
    double first = 0.0, least = 0.0, greatest = 0.0;

    /// max |value - from|; the roundings of differences are monotone.
    [[nodiscard]] double farthest(double from) const;
  };
  struct Start {
    std::span<const double> z;  ///< 2n entries, finite
    double t = 0.0;
    double step = 0.0, until = 0.0;
  };
  struct End {
    bool alone = false;        ///< to be run alone: the rest is not known
    bool interrupted = false;  ///< by `halted`, at t
    std::size_t steps = 0;
    double t = 0.0;
    std::vector<double> z = {};        ///< at the last level
    Along energy = {};                 ///< E_k of the steps; first is E
    Along node_energy = {};            ///< H(z_k)
    Along gamma = {};                  ///< Γ(z_k), if has_gamma()
    std::vector<Along> observed = {};  ///< at the levels
    double rounding = 0.0;             ///< the largest bound of the rounding error of E_k
  };

  /// A step of one orbit, for code that watches them.
  struct Step {
    std::size_t lane = 0;  ///< the place of its start
    std::span<const double> z_0, z_1;
    double t_0 = 0.0, t_1 = 0.0, h = 0.0;
    std::span<const double> observed_0, observed_1;  ///< at both levels
  };
  enum class Verdict { go_on, end, alone };
  struct Watch {
    std::function<Verdict(const Step&)> show = {};
    /// Of these functions, of which the one after the other are observed g and dg/dt, zeros are looked for: steps in
    /// which all are clear of them (is_clear_of_zero) are not shown, but for the first.
    ///@{
    std::size_t first_function = 0;
    std::size_t functions = 0;
    ///@}
  };

  /// Of up to `width` orbits. None where a step would be a long formula (splitting_formula).
  /// \param observed formulas of H's graph and variables
  /// \param all whether to show Γ and the rounding error of E_k, too, which takes as long as the steps
  /// \throws std::invalid_argument as make_splitting_scheme()
  [[nodiscard]] static std::unique_ptr<SplittingLanes> make(const Hamiltonian& hamiltonian,
                                                            const Composition& composition,
                                                            std::span<const formula::Expression> observed,
                                                            std::size_t width, bool all = false);

  /// From each start to its end, as many of both, unless there are more than max_steps to be taken: that is for those
  /// who run it alone. Steps are taken without allocations. \param halted is asked now and then, and ends all where
  /// they are \param watch is shown steps, and may end an orbit with one \return false if it was halted
  [[nodiscard]] bool run(std::span<const Start> starts, std::size_t max_steps, std::span<End> ends,
                         const std::function<bool()>& halted = {}, const Watch* watch = nullptr);

  SplittingLanes(const SplittingLanes&) = delete;  // its parts point to each other
  SplittingLanes& operator=(const SplittingLanes&) = delete;

  [[nodiscard]] std::size_t width() const { return width_; }
  [[nodiscard]] bool has_gamma() const { return has_gamma_; }

  /// The levels of a run with this start: steps to the first at or past its end.
  [[nodiscard]] static std::size_t steps_of(const Start& start);

private:
  /// One number for each orbit, in whole vectors.
  struct alignas(64) Chunk {
    double values[8];
  };
  /// What was seen of a quantity, for all orbits: of each value x that is scale (x + constant)/scale, rounded as
  /// Integrator::reported_node() rounds it.
  struct Seen {
    double *first, *least, *greatest;
    double constant = 0.0, scale = 1.0;
  };

  SplittingLanes(std::size_t degrees_of_freedom, const Composition& composition, std::size_t width)
      : n_(degrees_of_freedom), width_(width), magnitude_(composition.magnitude()) {}

  void make_room(const Hamiltonian& hamiltonian, const Composition& composition, std::size_t observed);
  [[nodiscard]] double* row(std::size_t number) { return room_[number * width_ / 8].values; }
  void begin(std::span<const Start> starts);
  void step();
  void see_level(bool first);
  void see(const double* values, const Seen& seen, bool first);
  void measure(std::size_t lanes);
  void find_steps_to_show(const Watch& watch, bool all);
  [[nodiscard]] bool show(std::span<const Start> starts, std::size_t k, std::span<End> ends, const Watch& watch);
  void interrupt(std::span<const Start> starts, std::size_t k, std::span<End> ends) const;
  void write(std::size_t lane, const Start& start, std::size_t steps, End& end) const;

  std::size_t n_, width_;
  bool has_gamma_ = false, measures_ = false;
  double magnitude_;
  formula::BatchEvaluator whole_;   ///< (high, low, h) ↦ (high, low) of the next level, E, and what is seen there
  formula::BatchEvaluator nodes_;   ///< high ↦ what is seen there
  formula::BatchEvaluator middle_;  ///< (high, low, h) ↦ the middle of the step, and u⁻¹ of how far that may be off
  formula::SumSizeEvaluator energy_size_;
  std::vector<Chunk> room_;
  std::vector<const double*> from_[2], high_;
  std::vector<double*> to_[2], seen_at_[2], middle_at_;
  int here_ = 0;  ///< which of the two has the present level
  double *h_ = nullptr, *energy_ = nullptr, *odd_ = nullptr, *rounding_ = nullptr, *shows_ = nullptr;
  Seen energies_;
  std::vector<Seen> nodes_seen_;  ///< H, Γ if there is one, what is observed
  std::vector<double> point_, errors_;
  std::vector<double> shown_[4];  ///< z and what is observed, at both levels
  bool first_step_ = true;
};

}  // namespace rubato
