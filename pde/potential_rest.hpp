#pragma once

#include <memory>
#include <span>
#include <vector>

#include <Eigen/Core>

#include <rubato/formula/expression.hpp>
#include <rubato/grids/field_set.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/pde/multisymplectic_system.hpp>

namespace rubato {

/// N = S - ½ zᵀLz as a formula of some of the fields, the others 0, and of the coordinates that S names.
struct PotentialRest {
  std::shared_ptr<formula::Graph> graph;
  std::vector<formula::Expression> variables;  ///< one for each of the fields
  std::vector<formula::Expression> inputs;     ///< these, then the coordinates
  formula::Expression value;
};
/// `fields`: numbers of the fields that N is to be a formula of.
[[nodiscard]] PotentialRest rest_of_potential(const MultisymplecticSystem& system, const Eigen::MatrixXd& L,
                                              std::span<const int> fields);

/// L, the part ½ zᵀLz of S that splittings leave to the waves: the mean of S''(0) over the nodes, its constant entries
/// as they are, 0 where an entry is not finite everywhere. Of sines and cosines of linear combinations of the fields it
/// has nothing: no place of their period is singled out, and where S is periodic a wave may stand at any u = 2πn.
[[nodiscard]] Eigen::MatrixXd hessian_of_waves(const MultisymplecticSystem& system, const grids::Grid& grid);
/// S'' at the fields of a level with one value of each varying entry, the one that the fourth powers of the differences
/// from it are least with: between the mean and the middle of its range. 0 where an entry is not finite everywhere. An
/// iteration with the exact inverse T of the linear part contracts by |T (S'' - L̄)|, which is at most
/// |T|_p |S'' - L̄|_p for every p >= 2, T a function of the waves and S'' of the places (the inequality of Kato, Seiler
/// and Simon): the mean is best for p = 2, that is where T singles few waves out, the middle for p = ∞, where T is
/// about the same for many. `fields`: of a level, without what it does not have.
[[nodiscard]] Eigen::MatrixXd middle_hessian(const MultisymplecticSystem& system, const grids::Grid& grid,
                                             const grids::FieldSet& fields);

/// True if S beyond ½ zᵀLz depends on a field: S'' varies with it, or ∂S/∂z_f names a coordinate.
[[nodiscard]] bool is_in_rest(const MultisymplecticSystem& system, int field);

/// ∇S(0): the linear terms of S, of fields that are not in the rest. Not finite where S is not defined there.
[[nodiscard]] std::vector<double> potential_slopes_at_zero(const MultisymplecticSystem& system);

}  // namespace rubato
