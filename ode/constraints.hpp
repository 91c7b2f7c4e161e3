#pragma once

#include <map>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/expression.hpp>
#include <rubato/formula/rounding.hpp>

namespace rubato {

/// Holonomic constraints g(q) = 0 of an orbit, each with a name (theory, section 13). Immutable and cheap to copy; may
/// be shared between threads.
///
/// Along the motion the hidden constraints hold as well, dg/dt = G q' = 0 with G = ∂g/∂q. The rows of G have to be
/// linearly independent along the orbit.
class Constraints {
public:
  Constraints() = default;  ///< none

  /// Names with formulas in the names `q` and `parameters`. \throws formula::ParseError; std::invalid_argument as below
  Constraints(const std::vector<std::string>& q, const std::vector<std::pair<std::string, std::string>>& formulas,
              const std::map<std::string, double>& parameters = {});
  /// Expressions of a graph in its variables `q`. \throws std::invalid_argument if a name stands twice, or there are
  /// more constraints than coordinates
  Constraints(std::shared_ptr<formula::Graph> graph, std::span<const formula::Expression> q,
              std::vector<std::string> names, std::span<const formula::Expression> values);

  [[nodiscard]] std::size_t count() const { return stated_ ? stated_->names.size() : 0; }
  [[nodiscard]] bool none() const { return count() == 0; }
  [[nodiscard]] const std::vector<std::string>& names() const { return stated_->names; }

  /// g as expressions of a graph in its variables q.
  ///@{
  [[nodiscard]] std::span<const formula::Expression> variables() const { return stated_->variables; }
  [[nodiscard]] std::span<const formula::Expression> values() const { return stated_->values; }
  ///@}

  /// An entry of a matrix that does not vanish identically.
  struct Place {
    std::size_t row, column;
  };
  /// Of q: g, and then the entries of G at places(), row by row.
  [[nodiscard]] const formula::Bytecode& code() const { return stated_->code; }
  [[nodiscard]] const std::vector<Place>& places() const { return stated_->places; }
  /// Of q, then μ: the upper triangle of ∂²(μᵀg)/∂q∂q at second_places().
  [[nodiscard]] const formula::Bytecode& second_code() const { return stated_->second; }
  [[nodiscard]] const std::vector<Place>& second_places() const { return stated_->second_places; }
  /// Of q, then v: ∂(G v)/∂q at rate_places().
  [[nodiscard]] const formula::Bytecode& rate_code() const { return stated_->rate; }
  [[nodiscard]] const std::vector<Place>& rate_places() const { return stated_->rate_places; }

private:
  struct Stated {
    std::shared_ptr<formula::Graph> graph;
    std::vector<std::string> names;
    std::vector<formula::Expression> variables, values;
    formula::Bytecode code, second, rate;
    std::vector<Place> places, second_places, rate_places;
  };

  std::shared_ptr<const Stated> stated_;
};

/// g and G at one point. Holds work space: one per thread. No allocation after construction.
class ConstraintEvaluator {
public:
  explicit ConstraintEvaluator(const Constraints& constraints);

  /// At q (n entries).
  void evaluate(const double* q);
  [[nodiscard]] const Eigen::VectorXd& g() const { return g_; }
  /// ∂g/∂q, a row for each constraint; and its entries at Constraints::places().
  ///@{
  [[nodiscard]] const Eigen::MatrixXd& G() const { return G_; }
  [[nodiscard]] const Eigen::VectorXd& entries() const { return entries_; }
  ///@}
  [[nodiscard]] bool is_finite() const { return g_.allFinite() && entries_.allFinite(); }

  /// p -= Gᵀμ with these entries of G.
  void kick(const Eigen::Ref<const Eigen::VectorXd>& entries, const Eigen::VectorXd& mu, double* p) const;

  /// What is left of g = 0 at q, or of G v = 0.
  struct Left {
    double in_roundings = 0.0;  ///< in units of what the rounding errors of q, or of v, leave
    double relative = 0.0;      ///< to G times the largest |q|, or |v|
  };
  [[nodiscard]] Left left(const double* q) const { return left_of(g_, q); }
  /// \param rates G v
  [[nodiscard]] Left left(const Eigen::VectorXd& rates, const double* v) const { return left_of(rates, v); }

  /// The name of a constraint whose gradient depends on those of the others; empty if G has full rank.
  [[nodiscard]] std::string dependent() const;

private:
  [[nodiscard]] Left left_of(const Eigen::VectorXd& values, const double* factors) const;

  Constraints constraints_;
  formula::ScalarEvaluator evaluator_;
  Eigen::VectorXd g_, entries_;
  Eigen::MatrixXd G_;
  std::vector<std::size_t> ends_;  ///< of each row, in places()
};

/// Second derivatives of constraints at one point. Holds work space: one per thread. No allocation after construction.
class ConstraintCurvature {
public:
  explicit ConstraintCurvature(const Constraints& constraints);

  /// block += ∂²(μᵀg)/∂q∂q at q.
  void add_to(const double* q, const Eigen::Ref<const Eigen::VectorXd>& mu, Eigen::Ref<Eigen::MatrixXd> block);
  /// ∂(G v)/∂q at q, a row for each constraint.
  [[nodiscard]] const Eigen::MatrixXd& of_rates(const double* q, const double* v);

private:
  Constraints constraints_;
  formula::ScalarEvaluator second_, rate_;
  Eigen::VectorXd inputs_;  ///< q, then μ or v
  Eigen::MatrixXd rates_;
};

/// Moves q along G, by Newton's method, to where g = 0 to rounding, and leaves `at` there. \return false if that fails
[[nodiscard]] bool approach_constraints(ConstraintEvaluator& at, Eigen::VectorXd& q);
/// Requires initial data that satisfy g(q) = 0 to rounding, with independent gradients. \throws std::invalid_argument
/// with the sizes, and the nearest q that satisfies them (Newton's method along G) as the remedy
void check_constraints(const Constraints& constraints, std::span<const std::string> q_names, std::span<const double> q);
/// Throws std::invalid_argument: G v is not 0 at the start. `projection` lists momenta or velocities that satisfy it;
/// empty where none were found.
[[noreturn]] void refuse_start_off_hidden(const Constraints& constraints, const Eigen::VectorXd& rates,
                                          const std::string& projection);
/// Why a step fails near q: the gradient of the constraint of that name depends on others; empty for no name.
[[nodiscard]] std::string dependence_near(const std::string& name, std::span<const std::string> q_names,
                                          const Eigen::VectorXd& q);
/// "x = 1, y = 2", with all digits of the numbers.
[[nodiscard]] std::string listed(std::span<const std::string> names, const Eigen::VectorXd& values);

}  // namespace rubato
