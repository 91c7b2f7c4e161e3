#include <rubato/ode/boundary_value.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include <fmt/format.h>

#include <rubato/ode/increment.hpp>
#include <rubato/ode/integrate.hpp>
#include <rubato/ode/tuning.hpp>
#include <rubato/solve/damped_least_squares.hpp>

namespace rubato {

namespace {

using namespace tuning::boundary_value;

/// Of the duration of the guess: a search that fails below it is reported as one that ended in no orbit.
constexpr double collapse = 0.1;

using Eigen::Index;
using Eigen::VectorXd;

void check_guess(const Hamiltonian& hamiltonian, const NodesOfOrbit& guess) {
  const std::size_t size = 2 * hamiltonian.degrees_of_freedom();
  if (guess.dimension != size || guess.h.empty() || guess.z.size() != size * (guess.segments() + 1)) {
    throw std::invalid_argument(
        fmt::format("a guess has at least one step, and {} numbers at each of its nodes; this one has {} steps and {} "
                    "numbers",
                    size, guess.segments(), guess.z.size()));
  }
  const double sign = guess.h.front();
  if (!std::ranges::all_of(guess.h, [sign](double h) { return std::isfinite(h) && h * sign > 0.0; }) ||
      !std::ranges::all_of(guess.z, [](double z) { return std::isfinite(z); })) {
    throw std::invalid_argument("a guess has finite numbers, and steps that all go forward or all go backward");
  }
}

/// η at the middles of the steps, from E_k - (H_k + H_{k+1})/2 = (s+1) h^s η (theory, section 8).
std::vector<double> curvatures(const Hamiltonian& hamiltonian, const NodesOfOrbit& orbit,
                               std::span<const double> energies, int order) {
  HamiltonianEvaluator evaluator(hamiltonian);
  std::vector<double> eta;
  double before = evaluator.value(orbit.node(0).data());
  for (std::size_t k = 0; k < orbit.segments(); ++k) {
    const double after = evaluator.value(orbit.node(k + 1).data());
    eta.push_back((energies[k] - 0.5 * (before + after)) / ((order + 1) * std::pow(std::abs(orbit.h[k]), order)));
    before = after;
  }
  return eta;
}

/// The potential of free levels on an orbit found with equal ones, and the lengths that the step law then has.
struct LevelPlan {
  StepPotential potential;
  std::vector<double> h;
};

LevelPlan plan_levels(const Hamiltonian& hamiltonian, const NodesOfOrbit& orbit, std::span<const double> energies,
                      int order, const StepPotentialChoice& choice) {
  LevelPlan plan{.potential = {}, .h = orbit.h};
  const std::vector<double> eta = curvatures(hamiltonian, orbit, energies, order);
  const auto [least, most] = std::ranges::minmax(eta);
  const double size = std::max(std::abs(least), std::abs(most)), h = std::abs(orbit.h.front());
  if (size == 0.0) {  // at an equilibrium: the law leaves every length as it is
    return plan;
  }
  const double sign = std::abs(least) > most ? -1.0 : 1.0;
  const double off = (order + 1) * size * std::pow(h, order);
  switch (choice.kind) {
    case StepPotentialChoice::Kind::none: break;
    case StepPotentialChoice::Kind::stated: plan.potential = choice.potential; break;
    case StepPotentialChoice::Kind::given:
      plan.potential = make_step_potential(
          {.order = order, .step = h, .eta = {eta.front()}, .energy_size = energy_scale(hamiltonian, orbit)},
          choice.kappa, choice.exponent);
      break;
    case StepPotentialChoice::Kind::automatic:
    case StepPotentialChoice::Kind::usual:
      if (order >= first_high_order) {
        const double strength = std::max(nearly_equal * off, least_potential * energy_scale(hamiltonian, orbit));
        plan.potential = {.strength = sign * strength, .length = h, .exponent = static_cast<double>(order)};
      } else if (!(std::min(std::abs(least), std::abs(most)) > margin * size && least * most > 0.0)) {
        plan.potential = {
            .strength = sign * weight_of_potential * off, .length = h, .exponent = static_cast<double>(order)};
      }
      break;
  }
  // (η + f''/(s(s+1)h^(s-1))) h^(s+1) is constant where f' is a multiple of h^s; for others it is a start.
  const double mu = plan.potential.slope(h) / (order * (order + 1) * std::pow(h, order - 1));
  double sum = 0.0;
  for (std::size_t k = 0; k < eta.size(); ++k) {
    const double bracket = std::max((eta[k] + mu) / (sign * size + mu), smallest_bracket);
    plan.h[k] = std::pow(bracket, -1.0 / (order + 1));
    sum += plan.h[k];
  }
  const double scale = orbit.duration() / sum;
  for (double& length : plan.h) {
    length *= scale;
  }
  return plan;
}

/// The orbit on levels whose lengths are in the proportions of `lengths` where it has been: by cubics through nodes
/// with their slopes.
NodesOfOrbit at_levels(const Hamiltonian& hamiltonian, const NodesOfOrbit& orbit, std::span<const double> lengths) {
  HamiltonianEvaluator evaluator(hamiltonian);
  const std::size_t size = orbit.dimension, n = size / 2, steps = orbit.segments();
  const auto slope_at = [&](std::size_t k) {
    std::vector<double> gradient(size), slope(size);
    evaluator.gradient(orbit.node(k).data(), gradient.data());
    for (std::size_t i = 0; i < n; ++i) {
      slope[i] = gradient[n + i];
      slope[n + i] = -gradient[i];
    }
    return slope;
  };
  // `lengths` is a density on the old levels: new level number j lies where ∫ dk/lengths has come to j/N of its whole.
  std::vector<double> density = {0.0}, time = {0.0};
  for (std::size_t k = 0; k < steps; ++k) {
    density.push_back(density.back() + orbit.h[k] / lengths[k]);
    time.push_back(time.back() + orbit.h[k]);
  }
  NodesOfOrbit moved{.dimension = size, .z = {}, .h = {}};
  double last = 0.0;
  std::size_t k = 0;
  for (std::size_t j = 0; j <= steps; ++j) {
    const double wanted = density.back() * static_cast<double>(j) / static_cast<double>(steps);
    while (k + 1 < steps && (wanted - density[k + 1]) * density.back() > 0.0) {
      ++k;
    }
    const double x = j == steps ? 1.0 : (wanted - density[k]) / (density[k + 1] - density[k]), h = orbit.h[k];
    const std::vector<double> before = slope_at(k), after = slope_at(k + 1);
    for (std::size_t i = 0; i < size; ++i) {
      const double z_0 = orbit.node(k)[i], z_1 = orbit.node(k + 1)[i];
      moved.z.push_back((1.0 + 2.0 * x) * (1.0 - x) * (1.0 - x) * z_0 + x * x * (3.0 - 2.0 * x) * z_1 +
                        h * x * (1.0 - x) * ((1.0 - x) * before[i] - x * after[i]));
    }
    const double t = j == steps ? time.back() : time[k] + x * h;
    if (j > 0) {
      moved.h.push_back(t - last);
    }
    last = t;
  }
  return moved;
}

/// K_k of every step; NaN where it is not defined.
std::vector<double> energies_of(SegmentEquation& segments, const NodesOfOrbit& orbit) {
  SegmentRows rows;
  std::vector<double> energies;
  for (std::size_t k = 0; k < orbit.segments(); ++k) {
    const bool defined = segments.evaluate(orbit.node(k), orbit.node(k + 1), orbit.h[k], rows) == Status::success;
    energies.push_back(defined ? rows.energy : std::numeric_limits<double>::quiet_NaN());
  }
  return energies;
}

/// Fills in what follows from the nodes and levels.
void describe_solution(SegmentEquation& segments, BoundaryValueSolution& solution) {
  const NodesOfOrbit& orbit = solution.orbit;
  solution.energy = energies_of(segments, orbit);
  double sum = 0.0, conserved = 0.0;
  for (std::size_t k = 0; k < orbit.segments(); ++k) {
    sum += orbit.h[k] * solution.energy[k];
    solution.energy[k] += solution.potential.energy(orbit.h[k]);
    conserved += solution.energy[k];
  }
  solution.mean_energy = sum / orbit.duration();
  solution.conserved = conserved / static_cast<double>(orbit.segments());
}

}  // namespace

namespace {

/// The equations of a stationary action, with further linear ones.
class WithConditions final : public solve::Equations {
public:
  WithConditions(StationaryAction& action, std::span<const LinearCondition> further)
      : action_(action), further_(further) {}
  Status evaluate(const VectorXd& u, VectorXd& residual, bool with_derivatives) override {
    return action_.evaluate(u, residual, with_derivatives ? &jacobian_ : nullptr, further_);
  }
  Status factor(double damping) override { return solver_.factor(jacobian_, damping); }
  Status solve(const VectorXd& r, VectorXd& x) override { return solver_.solve(r, x); }
  [[nodiscard]] std::string describe(Index row) const override { return action_.describe(row); }
  [[nodiscard]] std::string describe_failure() const override {
    return fmt::format("the step from level {}", action_.failed_segment());
  }

private:
  StationaryAction& action_;
  std::span<const LinearCondition> further_;
  Eigen::SparseMatrix<double> jacobian_;
  solve::DampedLeastSquares solver_;
};

}  // namespace

bool find_stationary(StationaryAction& equations, std::span<const LinearCondition> further, int stage,
                     const BoundaryValueOptions& options, VectorXd& u, BoundaryValueSolution& solution) {
  WithConditions all(equations, further);
  const solve::NewtonSearch search =
      solve::find_zero(all, options.tolerance, options.most_iterations, stage, u, solution.history);
  solution.status = search.status;
  solution.residual = search.residual;
  solution.worst = search.worst;
  return search.status == Status::success;
}

NodesOfOrbit guess_by_integrating(const Hamiltonian& hamiltonian, const SegmentLagrangian& lagrangian,
                                  std::span<const double> z_0, double h, std::size_t steps) {
  const std::size_t n = z_0.size() / 2;
  const bool has_map = method_of(lagrangian).scheme != nullptr;
  const Orbit orbit = integrate(hamiltonian,
                                {.q = {z_0.begin(), z_0.begin() + static_cast<std::ptrdiff_t>(n)},
                                 .p = {z_0.begin() + static_cast<std::ptrdiff_t>(n), z_0.end()}},
                                {.lagrangian = has_map ? lagrangian : SegmentLagrangian(Midpoint{}),
                                 .step = h,
                                 .until = h * static_cast<double>(steps),
                                 .levels = Levels::fixed,
                                 .max_steps = steps});
  NodesOfOrbit guess{.dimension = z_0.size(), .z = {}, .h = orbit.h};
  for (std::size_t k = 0; k < orbit.t.size(); ++k) {
    const auto q = orbit.q_at(k), p = orbit.p_at(k);
    guess.z.insert(guess.z.end(), q.begin(), q.end());
    guess.z.insert(guess.z.end(), p.begin(), p.end());
  }
  return guess;
}

BoundaryValueSolution boundary_value_residual(const Hamiltonian& hamiltonian, EndConditions ends,
                                              const NodesOfOrbit& orbit, const StepPotential& potential,
                                              const BoundaryValueOptions& options) {
  check_guess(hamiltonian, orbit);
  const auto segments = make_segment_equation(hamiltonian, options.lagrangian);
  BoundaryValueSolution solution{.orbit = orbit, .potential = potential};
  StationaryAction equations(
      hamiltonian, *segments, ends, {.duration = options.duration, .energy = options.energy}, orbit,
      options.levels == Levels::variable ? StationaryAction::Levels::free : StationaryAction::Levels::prescribed,
      potential);
  VectorXd residual;
  solution.status = equations.evaluate(equations.pack(orbit), residual, nullptr);
  if (solution.status != Status::success) {
    solution.worst = fmt::format("the step from level {}", equations.failed_segment());
    return solution;
  }
  describe_solution(*segments, solution);
  Index row = 0;
  solution.residual = residual.cwiseAbs().maxCoeff(&row);
  solution.worst = equations.describe(row);
  solution.status = solution.residual <= options.tolerance ? Status::success : Status::not_converged;
  return solution;
}

BoundaryValueSolution solve_boundary_value(const Hamiltonian& hamiltonian, EndConditions ends,
                                           const NodesOfOrbit& guess, const BoundaryValueOptions& options) {
  check_guess(hamiltonian, guess);
  const auto segments = make_segment_equation(hamiltonian, options.lagrangian);
  const StationaryAction::Targets targets{.duration = options.duration, .energy = options.energy};
  BoundaryValueSolution solution{.orbit = guess, .potential = {}};
  const auto search = [&](StationaryAction::Levels levels, int stage) {
    StationaryAction equations(hamiltonian, *segments, ends, targets, solution.orbit, levels, solution.potential);
    VectorXd u = equations.pack(solution.orbit);
    const bool found = find_stationary(equations, {}, stage, options, u, solution);
    solution.orbit = equations.unpack(u);
    return found;
  };
  const auto give_up = [&](std::string_view where) {
    describe_solution(*segments, solution);
    const solve::NewtonSearch end{solution.status, solution.residual, solution.worst};
    solution.message = fmt::format("{}: {}", where, end.message(solution.history.size()));
    if (const double shrunk = solution.orbit.duration() / guess.duration(); shrunk < collapse) {
      solution.message += fmt::format(
          "; the orbit shrank to {:.2g} of the time of the guess: there may be none that meets all conditions", shrunk);
    }
    return solution;
  };
  if (!search(StationaryAction::Levels::prescribed, 0)) {
    return give_up("with equal levels");
  }
  if (options.levels == Levels::variable) {
    if (!segments->is_action()) {
      const LevelPlan plan = plan_levels(hamiltonian, solution.orbit, energies_of(*segments, solution.orbit),
                                         segments->order(), options.potential);
      solution.orbit = at_levels(hamiltonian, solution.orbit, plan.h);
      if (!search(StationaryAction::Levels::prescribed, 1)) {
        return give_up("with levels by the step law");
      }
      solution.potential = plan.potential;
    } else if (options.potential.kind == StepPotentialChoice::Kind::stated) {
      solution.potential = options.potential.potential;
    }
    if (!search(StationaryAction::Levels::free, 2)) {
      return give_up("with free levels");
    }
  }
  describe_solution(*segments, solution);
  return solution;
}

}  // namespace rubato
