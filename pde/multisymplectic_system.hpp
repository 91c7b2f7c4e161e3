#pragma once

#include <cstddef>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include <Eigen/Core>

#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/expression.hpp>
#include <rubato/pde/field_structure.hpp>

namespace rubato {

/// A place (row ≤ column) of the Hessian S'' whose entry is not a constant.
struct HessianEntry {
  int row = 0;
  int column = 0;
};

/// A multisymplectic equation M z_t + Σ_a K_a z_{x_a} = ∇S(z), all of M, K_a skew-symmetric (theory, section 1), stated
/// once: the fields' names, M, one K for each space direction, and S as a formula or as a generic lambda.
///
/// S may name the coordinates x, y, z of those directions besides: S(z, x), the coefficients of the medium. The law of
/// energy stays; that of momentum along x has the source ∂S/∂x at fixed z, and is a balance.
///
/// Gradient, Hessian, densities and fluxes follow from that statement, and so does the structure of the equation (which
/// fields are constrained, which are multipliers, which are bare potentials): see FieldStructure.
/// Immutable and cheap to copy; may be shared between threads.
class MultisymplecticSystem {
public:
  using Parameters = std::map<std::string, double>;
  static constexpr int most_fields = 16;

  /// S as a formula in the names `fields` and `parameters`, and in those of x, y, z that neither of them takes.
  /// \throws formula::ParseError; std::invalid_argument with the offending values if a field is named twice, there are
  /// more than 16, M or some K_a is not d × d, not finite or not skew, there are not 1 to 3 directions, or a field is
  /// not determined by the equation
  MultisymplecticSystem(std::vector<std::string> fields, Eigen::MatrixXd M, std::vector<Eigen::MatrixXd> K,
                        std::string_view S, const Parameters& parameters = {});

  /// S from an expression in a graph whose variables `fields` name the state, and x, y, z, where no field has that
  /// name, the coordinates.
  MultisymplecticSystem(std::shared_ptr<formula::Graph> graph, std::vector<std::string> fields, Eigen::MatrixXd M,
                        std::vector<Eigen::MatrixXd> K, formula::Expression S);

  /// What is known of an S whose dependence on the coordinates comes from ramps, S(z + Σ_a x_a s_a, x): see Jumps.
  struct Ramps {
    std::vector<Eigen::VectorXd> slopes;       ///< s_a, one for each direction
    std::vector<formula::Expression> sources;  ///< ∂S/∂x_a at fixed z + Σ_a x_a s_a, one for each direction
    std::vector<Eigen::MatrixXd> turns;        ///< G_a of Twists, one for each direction; none where no field turns
  };
  /// The same with ramps: by s_aᵀ(M z_t + Σ_b K_b z_{x_b}) = s_a·∇S the law of momentum along x_a is that of
  /// z + Σ_a x_a s_a, with the source that the medium has alone, and nothing of the ramps in it.
  MultisymplecticSystem(std::shared_ptr<formula::Graph> graph, std::vector<std::string> fields, Eigen::MatrixXd M,
                        std::vector<Eigen::MatrixXd> K, formula::Expression S, Ramps ramps);

  /// S as a generic lambda `(auto z)`, called once with the vector of the fields' expressions.
  template <typename Function>
  requires std::is_invocable_v<Function, std::vector<formula::Expression>> MultisymplecticSystem(
      std::vector<std::string> fields, Eigen::MatrixXd M, std::vector<Eigen::MatrixXd> K, Function&& S)
      : MultisymplecticSystem(trace(std::move(fields), std::forward<Function>(S)), std::move(M), std::move(K)) {}

  [[nodiscard]] int field_count() const { return static_cast<int>(fields_.size()); }
  [[nodiscard]] int directions() const { return static_cast<int>(K_.size()); }
  [[nodiscard]] const std::vector<std::string>& fields() const { return fields_; }
  /// The number of the field called `name`. \throws std::invalid_argument if there is none
  [[nodiscard]] int field(std::string_view name) const;
  [[nodiscard]] const Eigen::MatrixXd& M() const { return M_; }
  [[nodiscard]] const Eigen::MatrixXd& K(int direction) const { return K_[static_cast<std::size_t>(direction)]; }
  [[nodiscard]] const FieldStructure& structure() const { return *structure_; }

  /// The graph in which expression() and variables() live.
  [[nodiscard]] const std::shared_ptr<formula::Graph>& graph() const { return graph_; }
  [[nodiscard]] formula::Expression expression() const { return S_; }
  /// The fields, then the coordinates that S names: the inputs of all codes below.
  [[nodiscard]] const std::vector<formula::Expression>& variables() const { return variables_; }
  /// The axes of the coordinates that S names (0 for x, …), ascending; none where the medium is the same everywhere.
  [[nodiscard]] const std::vector<int>& coordinates() const { return coordinates_; }
  /// The slopes s_a of ramps, one for each direction; none where there are none.
  [[nodiscard]] const std::vector<Eigen::VectorXd>& ramps() const { return ramps_.slopes; }
  /// The rates G_a at which fields turn along each direction (Twists); none where none does.
  [[nodiscard]] const std::vector<Eigen::MatrixXd>& turns() const { return ramps_.turns; }
  /// True if momentum along the axis has a source, which makes a balance of its law.
  [[nodiscard]] bool has_source(int axis) const;
  /// ∂S/∂x_a at fixed z, or what Ramps have for it, for each of coordinates(): the sources of momentum.
  [[nodiscard]] const std::vector<formula::Expression>& sources() const { return sources_; }
  /// True if ∂S/∂z_f names a coordinate.
  [[nodiscard]] bool varies_in_space(int field) const { return varies_in_space_[static_cast<std::size_t>(field)]; }

  /// The constant c that was added to S (formula::separate_constant), and the system with S - c: the steps are those of
  /// the latter, c times the volume of the grid is what it adds to the energy.
  [[nodiscard]] double constant() const { return constant_; }
  [[nodiscard]] const MultisymplecticSystem& without_constant() const { return reduced_ ? *reduced_ : *this; }

  /// The system as a scheme without midpoints in time has it: every field that a level determines is at levels.
  [[nodiscard]] MultisymplecticSystem at_levels() const;

  [[nodiscard]] const formula::Bytecode& value_code() const { return *value_; }        ///< S
  [[nodiscard]] const formula::Bytecode& gradient_code() const { return *gradient_; }  ///< S, then ∇S
  /// S, ∇S, then the entries of S'' listed in varying_hessian(); the others are constants.
  [[nodiscard]] const formula::Bytecode& hessian_code() const { return *hessian_; }
  [[nodiscard]] const std::vector<HessianEntry>& varying_hessian() const { return varying_; }
  /// Those of them that vary with the fields, not with the coordinates alone.
  [[nodiscard]] const std::vector<HessianEntry>& nonlinear_hessian() const { return nonlinear_; }
  [[nodiscard]] const Eigen::MatrixXd& constant_hessian() const { return constant_hessian_; }
  /// sources()
  [[nodiscard]] const formula::Bytecode& source_code() const { return *source_; }
  /// For a formula::SumSizeEvaluator: how large the terms of S are, and the rounding error of S.
  [[nodiscard]] const formula::Bytecode& size_code() const { return *size_; }
  /// S'' in full at one point: z, then the coordinates that S names.
  [[nodiscard]] Eigen::MatrixXd hessian(std::span<const double> point) const;

private:
  struct Traced {
    std::shared_ptr<formula::Graph> graph;
    std::vector<std::string> fields;
    formula::Expression S;
  };
  template <typename Function>
  static Traced trace(std::vector<std::string> fields, Function&& S) {
    auto graph = std::make_shared<formula::Graph>();
    std::vector<formula::Expression> z;
    z.reserve(fields.size());
    for (const std::string& name : fields) {
      z.push_back(graph->variable(name));
    }
    const auto traced = S(z);
    if constexpr (formula::Scalar<std::remove_cvref_t<decltype(traced)>>) {
      return {graph, std::move(fields), graph->constant(static_cast<double>(traced))};
    } else {
      return {graph, std::move(fields), traced};
    }
  }
  static Traced parse(std::vector<std::string> fields, std::string_view S, const Parameters& parameters);
  MultisymplecticSystem(Traced traced, Eigen::MatrixXd M, std::vector<Eigen::MatrixXd> K, Ramps ramps = {});
  void check() const;
  void find_coordinates();
  void compile();

  std::shared_ptr<formula::Graph> graph_;
  std::vector<std::string> fields_;
  Eigen::MatrixXd M_;
  std::vector<Eigen::MatrixXd> K_;
  formula::Expression S_;
  Ramps ramps_;
  std::vector<formula::Expression> variables_, sources_;
  std::vector<int> coordinates_;
  std::vector<bool> varies_in_space_;
  std::vector<HessianEntry> varying_, nonlinear_;
  Eigen::MatrixXd constant_hessian_;
  double constant_ = 0.0;
  std::shared_ptr<const MultisymplecticSystem> reduced_;  ///< with S - c, if c is not 0
  std::shared_ptr<const formula::Bytecode> value_, gradient_, hessian_, size_, source_;
  std::shared_ptr<const FieldStructure> structure_;
};

}  // namespace rubato
