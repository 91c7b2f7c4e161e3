#include <rubato/ode/open_directions.hpp>

#include <algorithm>
#include <cmath>
#include <optional>

#include <rubato/ode/tuning.hpp>
#include <rubato/solve/singular_vectors.hpp>
#include <rubato/solve/small_matrices.hpp>

namespace rubato {

namespace {

using namespace tuning::open_directions;

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// The equations at an orbit, with levels in its ratios, and their matrix as that of functions of the time.
class Linearised {
public:
  Linearised(const Hamiltonian& hamiltonian, SegmentEquation& segments, const EndConditions& ends,
             const NodesOfOrbit& orbit, const BoundaryValueOptions& options)
      : orbit_(orbit),
        equations_(hamiltonian, segments, ends, {.duration = options.duration, .energy = options.energy}, orbit,
                   StationaryAction::Levels::prescribed) {
    VectorXd residual;
    Eigen::SparseMatrix<double> jacobian;
    if (equations_.evaluate(equations_.pack(orbit), residual, &jacobian) != Status::success) {
      return;
    }
    // N∫|.|² of an equation of every step, and |.|² of a condition: their ratio does not depend on N.
    VectorXd weights = VectorXd::Ones(jacobian.rows());
    weights.tail(jacobian.rows() - equations_.first_condition()).setConstant(1.0 / std::sqrt(steps()));
    matrix_ = weights.asDiagonal() * jacobian;
    vectors_ =
        solve::smallest_singular_vectors(*matrix_, static_cast<Index>(std::min(orbit.dimension + 2, most_directions)));
  }

  [[nodiscard]] bool defined() const { return vectors_.has_value(); }
  [[nodiscard]] Index count() const { return vectors_->values.size(); }
  /// Singular value i, in units that do not depend on N.
  [[nodiscard]] double value(Index i) const { return vectors_->values[i] * steps(); }
  /// The changes of nodes and levels along direction i, of about the size of the orbit.
  [[nodiscard]] NodesOfOrbit direction(Index i) const {
    return equations_.unpack(vectors_->vectors.col(i) * std::sqrt(steps()));
  }

  /// The conditions with a share in the combinations that nearly vanish, as many as there are directions.
  [[nodiscard]] std::vector<std::string> dependent(Index directions) const {
    std::vector<std::string> names;
    const auto left = solve::smallest_singular_vectors(matrix_->transpose(), directions);
    if (!left) {
      return names;
    }
    const Index first = equations_.first_condition();
    const VectorXd shares = left->vectors.bottomRows(matrix_->rows() - first).rowwise().norm();
    for (Index i = 0; i < shares.size(); ++i) {
      if (shares[i] > least_share * shares.maxCoeff()) {
        names.push_back(equations_.describe(first + i));
      }
    }
    return names;
  }

private:
  [[nodiscard]] double steps() const { return static_cast<double>(orbit_.segments()); }

  const NodesOfOrbit& orbit_;
  StationaryAction equations_;
  std::optional<Eigen::SparseMatrix<double>> matrix_;
  std::optional<solve::SingularVectors> vectors_;
};

/// The change of the energy along a direction, its mean over the nodes.
double change_of_energy(const Hamiltonian& hamiltonian, const NodesOfOrbit& orbit, const NodesOfOrbit& direction) {
  HamiltonianEvaluator evaluator(hamiltonian);
  std::vector<double> gradient(orbit.dimension);
  double sum = 0.0;
  for (std::size_t k = 0; k <= orbit.segments(); ++k) {
    evaluator.gradient(orbit.node(k).data(), gradient.data());
    for (std::size_t i = 0; i < orbit.dimension; ++i) {
      sum += gradient[i] * direction.node(k)[i];
    }
  }
  return sum / static_cast<double>(orbit.segments() + 1);
}

}  // namespace

OpenDirections open_directions(const Hamiltonian& hamiltonian, const EndConditions& ends, const NodesOfOrbit& solution,
                               const NodesOfOrbit& halved, const BoundaryValueOptions& options, OpenAlong which) {
  OpenDirections result;
  const auto segments = make_segment_equation(hamiltonian, options.lagrangian);
  const Linearised fine(hamiltonian, *segments, ends, halved, options);
  if (!fine.defined()) {
    return result;
  }
  std::optional<Linearised> coarse;
  const auto is_settled = [&](double value) {
    if (!coarse) {
      coarse.emplace(hamiltonian, *segments, ends, solution, options);
    }
    bool settled = false;
    for (Index i = 0; coarse->defined() && i < coarse->count(); ++i) {
      settled = settled || (value > settling * coarse->value(i) && coarse->value(i) > settling * value);
    }
    return settled;
  };
  std::vector<Index> open;
  for (Index i = 0; i < fine.count(); ++i) {
    if (const double value = fine.value(i); value < rounding || (value < small_value && !is_settled(value))) {
      open.push_back(i);
    }
  }
  if (open.empty()) {
    return result;
  }
  const auto count = static_cast<Index>(open.size());
  MatrixXd changes(2, count);
  const double energy = energy_scale(hamiltonian, halved);
  for (Index i = 0; i < count; ++i) {
    const NodesOfOrbit direction = fine.direction(open[static_cast<std::size_t>(i)]);
    changes(0, i) = direction.duration() / halved.duration();
    changes(1, i) = change_of_energy(hamiltonian, halved, direction) / energy;
  }
  result.duration = changes.row(0).norm() > visible_change;
  result.energy = changes.row(1).norm() > visible_change;
  if (which == OpenAlong::any) {
    result.count = open.size();
    result.dependent = fine.dependent(count);
  } else {
    result.count = static_cast<std::size_t>((solve::singular_values(changes).values.array() > visible_change).count());
  }
  return result;
}

}  // namespace rubato
