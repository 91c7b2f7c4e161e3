#include <rubato/pde/law_evaluator.hpp>

#include <fmt/format.h>

#include <rubato/solve/small_matrices.hpp>

namespace rubato {

std::string momentum_name(bool balance, const grids::Grid& grid, int axis) {
  return fmt::format("momentum{}{}{}", balance ? "_balance" : "", grid.dimensions() == 1 ? "" : "_",
                     grid.dimensions() == 1 ? "" : grid.axis(axis).name);
}

LawTables::LawTables(const MultisymplecticSystem& s, const grids::Grid& g, const std::vector<LinearSymmetry>& stated)
    : system(s), grid(g), symmetries(stated), d(s.field_count()), directions(1 + g.dimensions()) {
  const FieldStructure& structure = system.structure();
  const auto matrix = [&](int mu) -> const Eigen::MatrixXd& { return mu == time ? s.M() : s.K(mu - 1); };
  names.emplace_back("energy");
  for (int mu = 0; mu < directions; ++mu) {
    plus.push_back(terms_of(mu == time ? structure.M_plus : structure.K_plus[static_cast<std::size_t>(mu) - 1]));
    full.push_back(terms_of(matrix(mu)));
    if (mu > 0) {
      names.push_back(momentum_name(s.has_source(mu - 1) || g.axis(mu - 1).has_walls(), g, mu - 1));
    }
  }
  for (const Eigen::VectorXd& slope : s.ramps()) {
    auto& terms = ramps.emplace_back();
    for (int mu = 0; mu < directions; ++mu) {
      terms.push_back(terms_of(solve::product(slope.transpose(), matrix(mu))));
    }
  }
  for (const LinearSymmetry& symmetry : symmetries) {
    check_symmetry(system, symmetry);
    names.push_back(symmetry.name);
    add_quadratic(symmetry.B, quadratic, quadratic_plus);
  }
  for (const Eigen::MatrixXd& G : s.turns()) {
    add_quadratic(G, turns, turns_plus);
  }
  add_affine_symmetries();
  for (int mu = 0; mu < directions; ++mu) {
    terms_[0].push_back(terms_of_currents(mu, false));
    terms_[1].push_back(terms_of_currents(mu, true));
  }
}

/// ½ΛB of each direction.
void LawTables::add_quadratic(const Eigen::MatrixXd& B, std::vector<std::vector<MatrixTerms>>& at_points,
                              std::vector<std::vector<MatrixTerms>>& between) {
  auto& points = at_points.emplace_back();
  auto& neighbours = between.emplace_back();
  const FieldStructure& structure = system.structure();
  for (int mu = 0; mu < directions; ++mu) {
    const bool in_time = mu == time;
    const Eigen::MatrixXd& half = in_time ? structure.M_plus : structure.K_plus[static_cast<std::size_t>(mu) - 1];
    const Eigen::MatrixXd product = solve::product(half, B);
    const Eigen::MatrixXd other = solve::product(B.transpose(), half);
    points.push_back(terms_of(solve::product(0.5 * (in_time ? system.M() : system.K(mu - 1)), B)));
    neighbours.push_back((product + other).isZero(0.0) ? terms_of(product) : points.back());
  }
}

/// Those whose density bᵀMz is not zero: (bᵀMz)_t + … = 0 is mass in KdV.
void LawTables::add_affine_symmetries() {
  const Eigen::MatrixXd& all = system.structure().affine_symmetries;
  std::vector<Eigen::Index> kept;
  for (Eigen::Index c = 0; c < all.cols(); ++c) {
    if (!solve::product(system.M(), all.col(c)).isZero(0.0)) {
      kept.push_back(c);
    }
  }
  for (const Eigen::Index c : kept) {
    Eigen::Index lead = 0;
    all.col(c).cwiseAbs().maxCoeff(&lead);
    names.push_back(kept.size() == 1 ? std::string("mass")
                                     : fmt::format("mass_{}", system.fields()[static_cast<std::size_t>(lead)]));
    auto& terms = linear.emplace_back();
    for (int mu = 0; mu < directions; ++mu) {
      const Eigen::MatrixXd& lambda = mu == time ? system.M() : system.K(mu - 1);
      terms.push_back(terms_of(solve::product(all.col(c).transpose(), lambda)));
    }
  }
}

}  // namespace rubato
