#include <rubato/study/orbit_check.hpp>

#include <algorithm>
#include <cmath>

#include <Eigen/Core>

#include <fmt/format.h>

#include <rubato/ode/discrete_lagrangian.hpp>
#include <rubato/ode/integrate.hpp>
#include <rubato/study/formula_table.hpp>
#include <rubato/study/orbit_problem.hpp>
#include <rubato/variation/total_variation.hpp>

namespace rubato::study {

namespace {

/// The stored states of an orbit, row by row, each joined to (q, p).
struct StoredStates {
  std::vector<double> t, q, p;
  std::size_t n = 0;

  StoredStates(const record::Reader& reader, const std::string& group, std::size_t degrees_of_freedom)
      : t(reader.read(group + "/t")),
        q(reader.read(group + "/q")),
        p(reader.read(group + "/p")),
        n(degrees_of_freedom) {
    if (q.size() != t.size() * n || p.size() != t.size() * n) {
      throw record::Error(reader.file(), fmt::format("{}: {} times, {} coordinates and {} momenta do not fit together",
                                                     group, t.size(), q.size(), p.size()));
    }
  }

  [[nodiscard]] std::size_t rows() const { return t.size(); }

  [[nodiscard]] std::vector<double> z(std::size_t row) const {
    std::vector<double> state(q.begin() + static_cast<std::ptrdiff_t>(row * n),
                              q.begin() + static_cast<std::ptrdiff_t>((row + 1) * n));
    state.insert(state.end(), p.begin() + static_cast<std::ptrdiff_t>(row * n),
                 p.begin() + static_cast<std::ptrdiff_t>((row + 1) * n));
    return state;
  }
};

class OrbitCheck {
public:
  OrbitCheck(const record::Reader& reader, const StoredLevels& levels, const Problem& problem)
      : reader_(reader),
        levels_(levels),
        problem_(problem),
        orbit_(*problem.hamiltonian()),
        hamiltonian_(make_hamiltonian(problem)),
        law_(make_node_law(hamiltonian_, make_lagrangian(problem))),
        action_(make_action(hamiltonian_, make_lagrangian(problem))),
        invariants_(problem, orbit_.invariants, orbit_.names()),
        states_(reader, "/states", hamiltonian_.degrees_of_freedom()) {
    for (const std::string& name : invariants_.names()) {
      statistics_.invariants.push_back({name, {}});
    }
  }

  Statistics run() {
    copy_counts(reader_, levels_, statistics_);
    check_states();
    check_steps();
    check_exact();
    return std::move(statistics_);
  }

private:
  void check_states() {
    for (std::size_t row = 0; row < states_.rows(); ++row) {
      const std::vector<double> z = states_.z(row);
      const LevelNode node = law_(z.data());
      statistics_.energy_magnitude.add(std::abs(node.energy));
      statistics_.gamma.add(node.gamma);
      const std::span<const double> values = invariants_(z);
      if (row == 0) {
        statistics_.node_energy.start(node.energy);
      }
      statistics_.node_energy.add(node.energy);
      for (std::size_t i = 0; i < values.size(); ++i) {
        Deviation& deviation = statistics_.invariants[i].value;
        if (row == 0) {
          deviation.start(values[i]);
        }
        deviation.add(values[i]);
      }
    }
  }

  /// E_k = ∂A_k/∂t_k on every stored pair, and the step equation where two pairs follow each other.
  void check_steps() {
    const bool sparse = levels_.sparse;
    const StoredStates before = sparse ? StoredStates(reader_, "/states/previous", states_.n) : states_;
    if (states_.rows() != levels_.state_t.size() || before.rows() != states_.rows()) {
      throw record::Error(reader_.file(), "the states and their predecessors do not fit together");
    }
    Eigen::VectorXd gradient(static_cast<Eigen::Index>(action_->element().size()));
    std::vector<double> corners, last_corners;
    bool first = true;
    for (std::size_t row = 1; row < states_.rows(); ++row) {
      const std::size_t from = sparse ? row : row - 1;
      corners = {before.t[from]};
      const std::vector<double> z_0 = before.z(from);
      const std::vector<double> z_1 = states_.z(row);
      corners.insert(corners.end(), z_0.begin(), z_0.end());
      corners.push_back(states_.t[row]);
      corners.insert(corners.end(), z_1.begin(), z_1.end());
      action_->gradient(corners, gradient);
      const double energy = gradient[static_cast<Eigen::Index>(action_->element().coordinate(0, 0))];
      const std::size_t step = levels_.state_level[row] - 1;
      const bool bridge = levels_.bridged[step] != 0.0;
      if (first) {
        statistics_.energy = energy;
        statistics_.autonomous = is_autonomous(*action_, corners);
        first = false;
      }
      if (statistics_.autonomous) {
        double& deviation = bridge ? statistics_.bridge_deviation : statistics_.energy_deviation;
        deviation = std::max(deviation, std::abs(energy - statistics_.energy));
      } else if (!sparse && !last_corners.empty()) {
        const Incidence pair[] = {{last_corners, 1}, {corners, 0}};
        statistics_.energy_deviation =
            std::max(statistics_.energy_deviation, std::abs(coordinate_variation(*action_, pair, 0)));
      }
      if (!sparse && !last_corners.empty()) {
        const Incidence pair[] = {{last_corners, 1}, {corners, 0}};
        for (const double residual : value_variation(*action_, pair)) {
          step_equation_.add(residual);
        }
      }
      last_corners = corners;
    }
    if (step_equation_.count > 0.0) {
      statistics_.residuals.push_back({"step_equation", step_equation_});
    }
  }

  void check_exact() {
    FormulaTable exact(problem_, orbit_.exact, {"t"});
    const std::vector<std::string> names = orbit_.names();
    const std::size_t row = states_.rows() - 1;
    const std::vector<double> z = states_.z(row);
    const std::span<const double> values = exact({&states_.t[row], 1});
    for (std::size_t i = 0; i < values.size(); ++i) {
      const auto index = static_cast<std::size_t>(std::ranges::find(names, exact.names()[i]) - names.begin());
      statistics_.errors.push_back({exact.names()[i], {}});
      statistics_.errors.back().value.add(z[index] - values[i]);
    }
  }

  const record::Reader& reader_;
  const StoredLevels& levels_;
  const Problem& problem_;
  const HamiltonianProblem& orbit_;
  Hamiltonian hamiltonian_;
  NodeLaw law_;
  std::unique_ptr<DiscreteAction> action_;
  FormulaTable invariants_;
  StoredStates states_;
  MaxRms step_equation_;
  Statistics statistics_;
};

}  // namespace

Statistics check_orbit(const record::Reader& reader, const StoredLevels& levels, const Problem& problem) {
  return OrbitCheck(reader, levels, problem).run();
}

}  // namespace rubato::study
