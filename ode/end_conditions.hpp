#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include <rubato/ode/hamiltonian.hpp>

namespace rubato {

/// Conditions g(z_0, z_N) = 0 on both end nodes of an orbit, as formulas: of each coordinate and momentum NAME, NAME_0
/// at the start and NAME_1 at the end.
///
/// There may be more conditions than unknowns as long as they agree (the energy makes one of a periodic orbit follow
/// from the others), and fewer: boundary-value solvers then take the solution nearest to their guess.
class EndConditions {
public:
  /// From equations "x_1 = 0.5" and formulas "x_1 - 0.5", which have to vanish.
  /// \throws formula::ParseError; std::invalid_argument if there is none, or a text has more than one =
  EndConditions(const Hamiltonian& hamiltonian, std::span<const std::string> equations,
                const Hamiltonian::Parameters& parameters = {});
  /// From expressions in `variables`: z_0, then z_N.
  EndConditions(std::shared_ptr<formula::Graph> graph, std::vector<formula::Expression> variables,
                std::vector<formula::Expression> values, std::vector<std::string> texts);

  /// z_N = z_0 + jump; `jump` has 2n entries, or none for 0.
  [[nodiscard]] static EndConditions periodic(const Hamiltonian& hamiltonian, std::span<const double> jump = {});
  /// A connection from the equilibrium `from` to the equilibrium `to` (2n entries each): z_0 - from in the unstable
  /// subspace of the linearised motion, z_N - to in the stable one (projection conditions; Beyn 1990).
  /// \throws std::invalid_argument with the eigenvalues unless both are hyperbolic equilibria
  [[nodiscard]] static EndConditions connection(const Hamiltonian& hamiltonian, std::span<const double> from,
                                                std::span<const double> to);

  /// The same with the constraints of H and their rates at the start, none where it has none.
  [[nodiscard]] EndConditions with_constraints(const Hamiltonian& hamiltonian) const;

  [[nodiscard]] std::size_t size() const { return texts_.size(); }
  /// Condition i, for people.
  [[nodiscard]] const std::string& text(std::size_t i) const { return texts_[i]; }
  /// g, and its derivatives in z_0 and z_N.
  void evaluate(std::span<const double> z_0, std::span<const double> z_N, Eigen::VectorXd& values,
                Eigen::MatrixXd& by_0, Eigen::MatrixXd& by_N);

private:
  void compile();

  std::shared_ptr<formula::Graph> graph_;
  std::vector<formula::Expression> variables_, values_;
  std::vector<std::string> texts_;
  std::shared_ptr<formula::ScalarEvaluator> evaluator_;  ///< values, then rows of derivatives
};

}  // namespace rubato
