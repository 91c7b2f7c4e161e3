#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/SparseCore>

#include <rubato/base/status.hpp>
#include <rubato/ode/end_conditions.hpp>
#include <rubato/ode/segment_equation.hpp>
#include <rubato/variation/step_potential.hpp>

namespace rubato {

/// An orbit between two ends: N + 1 nodes of 2n numbers, and the N distances between their levels.
struct NodesOfOrbit {
  std::size_t dimension = 0;  ///< 2n
  std::vector<double> z;      ///< node after node
  std::vector<double> h;

  [[nodiscard]] std::size_t segments() const { return h.size(); }
  [[nodiscard]] std::span<const double> node(std::size_t k) const {
    return std::span(z).subspan(k * dimension, dimension);
  }
  [[nodiscard]] double duration() const;
};

/// A linear condition on the unknowns: coefficients · u = value.
struct LinearCondition {
  Eigen::SparseVector<double> coefficients;
  double value = 0.0;
};

/// The equations of a stationary point of 𝕊 = Σ A(z_k, z_{k+1}, h_k) - f(h_k) over all nodes and levels:
///
///     the equations of the segments (SegmentEquation),
///     K_k + f'(h_k) = K_{k-1} + f'(h_{k-1})       with free levels;  h_k/ρ_k = h_{k-1}/ρ_{k-1} with prescribed ratios,
///     g(z_0, z_N) = 0                             (EndConditions, and the constraints of H at the start),
///     Σ h_k = T                                   if the duration T is given,
///     Σ h_k K_k = E* Σ h_k                        if the energy E* is given,
///
/// in the unknowns z_k, h_k, and the running sums of h_k and h_k K_k, so that no row or column of the matrix is long:
/// its factors then have O(N) entries. K is the discrete energy without a step potential; with one, E* is still a value
/// of K, so that it does not depend on the choice of f.
///
/// A branch of solutions has one more unknown, its parameter, which is the duration or the energy (or a coordinate of
/// the start, see start_form()).
///
/// Unknowns and rows are scaled: each coordinate and momentum by its largest value on the guess, energies by the size
/// of the terms of H, the levels by the mean step, their sums by the duration.
class StationaryAction {
public:
  enum class Levels { prescribed, free };
  enum class Parameter { none, duration, energy };
  struct Targets {
    std::optional<double> duration = std::nullopt, energy = std::nullopt;
    Parameter parameter = Parameter::none;  ///< takes the place of a target
  };

  /// \param guess for the scales, and the ratios of prescribed levels. Everything referred to has to live as long.
  StationaryAction(const Hamiltonian& hamiltonian, SegmentEquation& segments, const EndConditions& ends,
                   Targets targets, const NodesOfOrbit& guess, Levels levels, const StepPotential& potential = {});

  [[nodiscard]] Eigen::Index unknowns() const { return parameter_place() + (has_parameter() ? 1 : 0); }
  /// \param orbit where the steps are defined: else its running sums are taken as 0
  [[nodiscard]] Eigen::VectorXd pack(const NodesOfOrbit& orbit);
  /// Linear: of a direction the changes of nodes and levels.
  [[nodiscard]] NodesOfOrbit unpack(const Eigen::VectorXd& u) const;

  /// What u leaves of the equations, and of further linear ones; the matrix of derivatives if `jacobian` is not null.
  /// \return Status::undefined outside the domain of H, or that of a step's own equations, and singular where a level
  /// comes before the one that it follows, or the orbit has next to no duration; failed_segment() then
  Status evaluate(const Eigen::VectorXd& u, Eigen::VectorXd& residual, Eigen::SparseMatrix<double>* jacobian,
                  std::span<const LinearCondition> further = {});
  [[nodiscard]] std::size_t failed_segment() const { return failed_; }

  /// The linear form that gives the parameter of a branch, and component i of the first node.
  ///@{
  [[nodiscard]] Eigen::SparseVector<double> parameter_form() const;
  [[nodiscard]] Eigen::SparseVector<double> start_form(std::size_t i) const;
  ///@}

  /// The conditions are the last rows: those of the ends, then duration and energy.
  [[nodiscard]] Eigen::Index first_condition() const { return end_row(); }
  /// An equation, for people: "the step from level 3, in the equation of q" or "the end condition q_1 = 2".
  [[nodiscard]] std::string describe(Eigen::Index row) const;

private:
  struct Rows;
  void add_values(Eigen::Index k, Rows& rows) const;
  void add_energy(Eigen::Index k, Eigen::Index row, double factor, double by_h, Rows& rows) const;
  void add_levels(const NodesOfOrbit& orbit, Rows& rows) const;
  void add_sums(const NodesOfOrbit& orbit, const Eigen::VectorXd& u, Rows& rows) const;
  void add_targets(const Eigen::VectorXd& u, Rows& rows) const;
  [[nodiscard]] bool add_ends(const NodesOfOrbit& orbit, Rows& rows);
  [[nodiscard]] bool linearise(const NodesOfOrbit& orbit, Status& status);

  [[nodiscard]] Eigen::Index size() const { return static_cast<Eigen::Index>(scales_.size()); }
  [[nodiscard]] Eigen::Index steps() const { return static_cast<Eigen::Index>(ratios_.size()); }
  [[nodiscard]] bool free() const { return levels_ == Levels::free; }
  [[nodiscard]] bool has_parameter() const { return targets_.parameter != Parameter::none; }
  [[nodiscard]] bool has_energy() const { return targets_.energy || targets_.parameter == Parameter::energy; }
  [[nodiscard]] bool has_time() const {
    return has_energy() || targets_.duration || targets_.parameter == Parameter::duration;
  }
  // Unknowns: z_0 … z_N, h_0 … h_{N-1}, the sums of h up to each node but the first, those of h K, the parameter.
  [[nodiscard]] Eigen::Index level_place(Eigen::Index k) const { return size() * (steps() + 1) + k; }
  [[nodiscard]] Eigen::Index time_place(Eigen::Index node) const { return level_place(steps()) + node - 1; }
  [[nodiscard]] Eigen::Index sum_place(Eigen::Index node) const {
    return level_place(steps()) + (has_time() ? steps() : 0) + node - 1;
  }
  [[nodiscard]] Eigen::Index parameter_place() const { return sum_place(1) + (has_energy() ? steps() : 0); }
  // Rows, in this order: value equations (of segments, or of interior nodes), levels, sums of h, sums of h K, ends,
  // targets.
  [[nodiscard]] Eigen::Index value_rows() const { return size() * (segments_.is_action() ? steps() - 1 : steps()); }
  [[nodiscard]] Eigen::Index time_row() const { return value_rows() + steps() - 1; }
  [[nodiscard]] Eigen::Index sum_row() const { return time_row() + (has_time() ? steps() : 0); }
  [[nodiscard]] Eigen::Index end_row() const { return sum_row() + (has_energy() ? steps() : 0); }
  [[nodiscard]] Eigen::Index target_row() const { return end_row() + static_cast<Eigen::Index>(ends_.size()); }
  [[nodiscard]] bool has_duration_row() const { return targets_.duration || targets_.parameter == Parameter::duration; }
  [[nodiscard]] Eigen::Index rows() const {
    return target_row() + (has_duration_row() ? 1 : 0) + (has_energy() ? 1 : 0);
  }

  const Hamiltonian& hamiltonian_;
  SegmentEquation& segments_;
  EndConditions ends_;
  Targets targets_;
  Levels levels_;
  StepPotential potential_;
  std::vector<double> ratios_;
  Eigen::VectorXd scales_, row_scales_, end_scales_;  ///< of a node, of the equations of a segment, of conditions
  double energy_scale_ = 1.0, step_scale_ = 1.0, duration_scale_ = 1.0;
  std::vector<SegmentRows> linearised_;  ///< where it was evaluated last
  std::size_t failed_ = 0;
};

/// The size of the terms of H along an orbit.
[[nodiscard]] double energy_scale(const Hamiltonian& hamiltonian, const NodesOfOrbit& orbit);

}  // namespace rubato
