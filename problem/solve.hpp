#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <rubato/ode/end_conditions.hpp>
#include <rubato/problem/problem.hpp>

namespace rubato {

class Section;

/// [solve]: a boundary-value problem of an orbit, whose guess is [initial] integrated over [scheme], or formulas of t.
/// Further guesses may follow. Or a periodic orbit of a lattice, whose guess is [initial] integrated.
struct StatedSolve {
  /// What `ends` says.
  enum class Ends {
    periodic,    ///< z_N = z_0 + jump
    symmetric,   ///< half of a periodic orbit: the names of `mirror` vanish at both ends of it
    connection,  ///< from the equilibrium `from` to the equilibrium `to`
    conditions,  ///< formulas of both ends
  };
  /// "left = right", or a formula that vanishes.
  struct Condition {
    FormulaText left;
    std::optional<FormulaText> right = {};
    std::string text;  ///< for people
  };

  /// continue = { parameter = "mu", to = 0.3 }: a branch of solutions is followed.
  struct Continuation {
    enum class Kind { duration, energy, parameter };
    Kind kind = Kind::parameter;
    std::string parameter = {};  ///< of [parameters]
    double to = 0.0;
    std::optional<double> step = {};
    std::size_t most_points = 500;
    Location location = {};
  };

  Ends ends = Ends::periodic;
  std::vector<Condition> conditions;
  std::vector<double> jump;         ///< of q, then p; empty for none
  std::vector<std::size_t> mirror;  ///< places in q, then p
  std::vector<double> from, to;     ///< of q, then p
  std::optional<double> duration;   ///< absent: free
  std::optional<double> energy;     ///< absent: free
  bool energy_of_start = false;     ///< energy = "initial": H at [initial]
  std::size_t steps = 0;
  /// What Newton's method begins from: formulas of t for q, then p, or numbers, which are integrated.
  struct Start {
    std::vector<FormulaText> formulas;
    std::vector<double> z;  ///< where there are no formulas
  };
  std::vector<Start> starts;  ///< tried in order; at least one, but none of lattices, which begin from [initial]
  std::optional<Continuation> continuation;
  double tolerance = 1e-12;
  std::size_t most_iterations = 100;
  Location location, ends_location, duration_location, energy_location;

  /// Periodic, or symmetric: its orbit closes, and has Floquet multipliers.
  [[nodiscard]] bool closes() const { return ends == Ends::periodic || ends == Ends::symmetric; }
  [[nodiscard]] bool has_energy() const { return energy || energy_of_start; }
};

inline constexpr std::array<std::string_view, 3> ends_words = {"periodic", "symmetric", "connection"};
inline constexpr std::array<std::string_view, 1> free_words = {"free"};
inline constexpr std::array<std::string_view, 2> solve_energy_words = {"free", "initial"};

/// [solve], if there is one; needs the rest of the problem. \throws ProblemError
[[nodiscard]] std::shared_ptr<const StatedSolve> read_solve(Section& root, const Problem& problem);

/// The conditions on the ends of the orbit that is solved for: of a symmetric one those of its half.
/// \throws ProblemError at the place in [solve]
[[nodiscard]] EndConditions make_end_conditions(const Problem& problem, const Hamiltonian& hamiltonian);

/// The system of a problem in which an entry of [parameters] is one more coordinate, the last one. Its momentum, which
/// begins at 0, does not occur in H, so that it is constant. \throws ProblemError as make_end_conditions_beside()
[[nodiscard]] Hamiltonian make_hamiltonian_beside(const Problem& problem, const std::string& parameter);
/// The conditions of make_end_conditions() for that system. \param held the parameter at the start; free without it
/// \throws ProblemError at [solve] continue for a connection, and where another number of the problem follows from the
/// parameter: it would not change along a branch
[[nodiscard]] EndConditions make_end_conditions_beside(const Problem& problem, const std::string& parameter,
                                                       const Hamiltonian& hamiltonian,
                                                       std::optional<double> held = std::nullopt);

}  // namespace rubato
