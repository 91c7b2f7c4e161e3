#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include <Eigen/LU>

#include <catch2/catch.hpp>

#include <rubato/grids/reductions.hpp>
#include <rubato/pde/euler_box_map.hpp>
#include <rubato/pde/lattice_actions.hpp>
#include <rubato/pde/lattice_method.hpp>
#include <rubato/variation/lattice_variation.hpp>
#include <rubato/variation/total_variation.hpp>

#include "cell_action.hpp"
#include "mesh_cases.hpp"

using namespace rubato;
using namespace rubato::tests;
using grids::FieldSet;
using Parts = LatticeVariation::Parts;

namespace {

double largest(const FieldSet& fields) {
  return grids::max_abs(fields.all());
}

FieldSet sum(const FieldSet& a, const FieldSet& b) {
  FieldSet result(a);
  for (std::size_t i = 0; i < result.all().size(); ++i) {
    result.all()[i] += b.all()[i];
  }
  return result;
}

MultisymplecticSystem wave_equation_3d() {
  return make_system({"u", "v", "a", "b", "c"}, {{"u", "v", -1}}, {{{"u", "a", 1}}, {{"u", "b", 1}}, {{"u", "c", 1}}},
                     "(v^2 - a^2 - b^2 - c^2)/2 + 1 - cos(u)");
}

struct Case {
  MultisymplecticSystem system;
  grids::Grid grid;
};

std::vector<Case> cases() {
  const grids::Grid line({{"x", 0, 2, 7}});
  const grids::Grid plane({{"x", 0, 2, 5}, {"y", -1, 1, 7}});
  const grids::Grid block({{"x", 0, 2, 3}, {"y", -1, 1, 5}, {"z", 0, 1, 3}});
  return {{sine_gordon(), line},
          {wave_equation("0"), line},
          {schroedinger(2), line},
          {korteweg_de_vries(6, 1), line},
          {good_boussinesq(), line},
          {dirac(1, 1), line},
          {wave_equation_2d("1 - cos(u)"), plane},
          {wave_equation_3d(), block}};
}

bool lives_at_midpoints(const MultisymplecticSystem& system) {
  bool some = false;
  for (int f = 0; f < system.field_count(); ++f) {
    some = some || system.structure().at_midpoints(f);
  }
  return some;
}

/// Corner data of the cell (k, i) in FormulaAction's order, from three levels of a line.
std::vector<double> corners(const std::array<FieldSet, 3>& levels, const std::array<double, 3>& t,
                            const grids::Grid& grid, std::size_t k, std::size_t i) {
  std::vector<double> result;
  for (std::size_t c = 0; c < 4; ++c) {
    const std::size_t level = k + c / 2;
    result.push_back(t[level]);
    result.push_back(static_cast<double>(i + c % 2) * grid.spacing(0));
    for (int f = 0; f < levels[level].fields(); ++f) {
      result.push_back(levels[level].field(f)[(i + c % 2) % grid.size()]);
    }
  }
  return result;
}

}  // namespace

// Step sizes 0.1 to 0.3, spacings 0.2 to 0.7, values of order 1: variations are sums of some dozen terms of order 1.
constexpr double rounding = 1e-13;

TEST_CASE("the variations on the mesh are those of the cell's action as a function of its corners") {
  for (const auto& system : {sine_gordon(), schroedinger(2), dirac(1, 1)}) {
    const grids::Grid grid({{"x", 0, 2, 7}});
    const int d = system.field_count();
    const std::array levels{random_fields(d, 7, 1), random_fields(d, 7, 2), random_fields(d, 7, 3)};
    const std::array<double, 3> t{0.3, 0.42, 0.61};
    LatticeVariation mesh(box_action(system), grid);
    std::array values_of{Parts(d, 7), Parts(d, 7)};
    std::array places_of{Parts(2, 7), Parts(2, 7)};
    for (std::size_t k = 0; k < 2; ++k) {
      mesh.take(levels[k], levels[k + 1], t[k + 1] - t[k]);
      mesh.values(values_of[k]);
      mesh.coordinates(places_of[k]);
    }
    const FieldSet values = sum(values_of[0].after, values_of[1].before);
    const FieldSet places = sum(places_of[0].after, places_of[1].before);

    FormulaAction cell = box_cell_action(system);
    double worst = 0.0;
    double twin = 0.0;  // the neighbour's variation is another
    for (std::size_t i = 1; i < 7; ++i) {
      std::vector<std::vector<double>> data;
      for (std::size_t k = 0; k < 2; ++k) {
        for (std::size_t left = 0; left < 2; ++left) {
          data.push_back(corners(levels, t, grid, k, i - 1 + left));
        }
      }
      const Incidence elements[] = {{data[0], 3}, {data[1], 2}, {data[2], 1}, {data[3], 0}};
      const Eigen::VectorXd expected = value_variation(cell, elements);
      for (int f = 0; f < d; ++f) {
        worst = std::max(worst, std::abs(values.field(f)[i] - expected[f]));
        twin = std::max(twin, std::abs(values.field(f)[i - 1] - expected[f]));
      }
      for (int nu = 0; nu < 2; ++nu) {
        const double place = coordinate_variation(cell, elements, static_cast<std::size_t>(nu));
        worst = std::max(worst, std::abs(places.field(nu)[i] - place));
      }
    }
    CHECK(worst < rounding);
    CHECK(twin > 1e6 * rounding);
  }
}

TEST_CASE("variations of values and of the step are the derivatives of the action") {
  // Central differences of width 2e-5 of an action of order 1: truncation 1e-10, rounding 1e-11.
  constexpr double width = 1e-5;
  constexpr double tolerance = 1e-8;
  for (const auto& [system, grid] : cases()) {
    for (const LatticeAction& action : actions_of(system)) {
      LatticeVariation mesh(action, grid);
      const int d = system.field_count();
      FieldSet before = random_fields(d, grid.size(), 4);
      FieldSet after = random_fields(d, grid.size(), 5);
      const double h = 0.2;
      Parts variations(d, grid.size());
      mesh.take(before, after, h);
      mesh.values(variations);
      const double energy = mesh.energy();
      for (int f = 0; f < d; ++f) {
        for (const std::size_t node : {std::size_t{0}, grid.size() / 2, grid.size() - 1}) {
          for (FieldSet* level : {&before, &after}) {
            double& value = level->field(f)[node];
            const double old = value;
            double sides[2];
            for (int side = 0; side < 2; ++side) {
              value = old + (side == 0 ? -width : width);
              mesh.take(before, after, h);
              sides[side] = mesh.action_value();
            }
            value = old;
            const FieldSet& variation = level == &before ? variations.before : variations.after;
            CHECK(std::abs((sides[1] - sides[0]) / (2 * width) - variation.field(f)[node]) < tolerance);
          }
        }
      }
      mesh.take(before, after, h + width);
      const double longer = mesh.action_value();
      mesh.take(before, after, h - width);
      const double slope = (longer - mesh.action_value()) / (2 * width);
      CHECK(std::abs(slope + energy) < 10 * tolerance);
      CHECK(std::abs(slope - energy) > 1e3 * tolerance);  // the twin: the other sign
    }
  }
}

TEST_CASE("the times of all nodes of a level vary the action by its discrete energy") {
  for (const auto& [system, grid] : cases()) {
    for (const LatticeAction& action : actions_of(system)) {
      LatticeVariation mesh(action, grid);
      const int d = system.field_count();
      const FieldSet before = random_fields(d, grid.size(), 6), after = random_fields(d, grid.size(), 7);
      mesh.take(before, after, 0.2);
      Parts places(1 + grid.dimensions(), grid.size());
      mesh.coordinates(places);
      CHECK(std::abs(grids::sum(std::as_const(places.before).field(0)) - mesh.energy()) < 10 * rounding);
      CHECK(std::abs(grids::sum(std::as_const(places.after).field(0)) + mesh.energy()) < 10 * rounding);
    }
  }
}

namespace {

/// The action of one slab on a mesh whose nodes lie anywhere near a rectangle's, written out from theory, section 5:
/// Σ_cells h ΔV [Σ_μ zᵀΛ_μ(det F · F⁻¹D)_μ z - det F · S(z)], with ½Λ and the means of the box, or Λ₊ and the base
/// corner.
class MovedMesh {
public:
  MovedMesh(const MultisymplecticSystem& system, const grids::Grid& grid, bool corners, double h)
      : system_(system), grid_(grid), corners_(corners), h_(h), S_(system.value_code()) {}

  /// `moves`: of the nodes of both levels, by how much each coordinate is off the rectangle's.
  double operator()(const std::array<FieldSet, 2>& z, const std::array<FieldSet, 2>& moves) {
    double sum = 0.0;
    const int n = 1 + grid_.dimensions();
    for (std::size_t cell = 0; cell < grid_.size(); ++cell) {
      Eigen::MatrixXd F = Eigen::MatrixXd::Identity(n, n);
      std::vector<Eigen::VectorXd> D;
      for (int rho = 0; rho < n; ++rho) {
        D.push_back(difference(z, cell, rho));
        F.row(rho) += difference(moves, cell, rho).transpose();
      }
      const Eigen::VectorXd place = corners_ ? at(z, cell, 0, {}) : mean(z, cell);
      const Eigen::MatrixXd scaled_inverse = F.determinant() * F.inverse();
      double S = 0.0;
      S_({place.data(), static_cast<std::size_t>(place.size())}, {&S, 1});
      double density = -F.determinant() * S;
      for (int mu = 0; mu < n; ++mu) {
        const FieldStructure& structure = system_.structure();
        const Eigen::MatrixXd full = 0.5 * (mu == 0 ? system_.M() : system_.K(mu - 1));
        const Eigen::MatrixXd& plus = mu == 0 ? structure.M_plus : structure.K_plus[static_cast<std::size_t>(mu) - 1];
        for (int rho = 0; rho < n; ++rho) {
          density += scaled_inverse(mu, rho) * place.dot((corners_ ? plus : full) * D[static_cast<std::size_t>(rho)]);
        }
      }
      sum += h_ * grid_.cell_volume() * density;
    }
    return sum;
  }

private:
  using Offset = std::array<std::size_t, 3>;

  static Eigen::VectorXd column(const FieldSet& fields, std::size_t node) {
    Eigen::VectorXd result(fields.fields());
    for (int f = 0; f < fields.fields(); ++f) {
      result[f] = fields.field(f)[node];
    }
    return result;
  }
  [[nodiscard]] Eigen::VectorXd at(const std::array<FieldSet, 2>& z, std::size_t cell, std::size_t level,
                                   Offset offset) const {
    auto place = grid_.place(cell);
    for (int a = 0; a < 3; ++a) {
      const auto i = static_cast<std::size_t>(a);
      place[i] = (place[i] + offset[i]) % grid_.cells(a);
    }
    return column(z[level], grid_.index(place[0], place[1], place[2]));
  }
  /// Σ over the corners of a cell, those beyond along direction `signed_direction` with +, the others with -.
  [[nodiscard]] Eigen::VectorXd corner_sum(const std::array<FieldSet, 2>& z, std::size_t cell,
                                           int signed_direction) const {
    Eigen::VectorXd sum = Eigen::VectorXd::Zero(z[0].fields());
    for (unsigned corner = 0; corner < (2U << grid_.dimensions()); ++corner) {
      const Offset offset{corner >> 1 & 1, corner >> 2 & 1, corner >> 3 & 1};
      const bool beyond = signed_direction < 0 || (corner >> signed_direction & 1) == 1;
      sum += (beyond ? 1.0 : -1.0) * at(z, cell, corner & 1, offset);
    }
    return sum;
  }
  [[nodiscard]] Eigen::VectorXd mean(const std::array<FieldSet, 2>& z, std::size_t cell) const {
    return corner_sum(z, cell, -1) / (2U << grid_.dimensions());
  }
  [[nodiscard]] Eigen::VectorXd difference(const std::array<FieldSet, 2>& z, std::size_t cell, int rho) const {
    const double spacing = rho == 0 ? h_ : grid_.spacing(rho - 1);
    if (!corners_) {
      return corner_sum(z, cell, rho) / ((1U << grid_.dimensions()) * spacing);
    }
    Offset offset{};
    if (rho > 0) {
      offset[static_cast<std::size_t>(rho) - 1] = 1;
    }
    return (at(z, cell, rho == 0 ? 1 : 0, offset) - at(z, cell, 0, {})) / spacing;
  }

  const MultisymplecticSystem& system_;
  grids::Grid grid_;
  bool corners_;
  double h_;
  formula::ScalarEvaluator S_;
};

}  // namespace

TEST_CASE("variations of places are the derivatives of the action on a mesh whose nodes move") {
  // Central differences of width 2e-5 of an action of order 1: truncation 1e-10, rounding 1e-11.
  constexpr double width = 1e-5;
  constexpr double tolerance = 1e-8;
  for (const auto& [system, grid] : cases()) {
    const auto& potential = system.structure().potential;
    if (lives_at_midpoints(system) || std::ranges::find(potential, true) != potential.end()) {
      continue;  // stated by another form of the action, the same for the equations but not on a moved mesh
    }
    for (const bool corners : {false, true}) {
      const double h = 0.2;
      const int n = 1 + grid.dimensions();
      const std::array z{random_fields(system.field_count(), grid.size(), 8),
                         random_fields(system.field_count(), grid.size(), 9)};
      std::array moves{FieldSet(n, grid.size()), FieldSet(n, grid.size())};
      MovedMesh moved(system, grid, corners, h);
      LatticeVariation mesh(corners ? euler_box_action(system) : box_action(system), grid);
      mesh.take(z[0], z[1], h);
      CHECK(std::abs(moved(z, moves) - mesh.action_value()) < rounding * static_cast<double>(grid.size()));
      Parts parts(n, grid.size());
      mesh.coordinates(parts);
      for (std::size_t level = 0; level < 2; ++level) {
        const FieldSet& places = level == 0 ? parts.before : parts.after;
        for (int nu = 0; nu < n; ++nu) {
          for (const std::size_t node : {std::size_t{0}, grid.size() / 2, grid.size() - 1}) {
            double& move = moves[level].field(nu)[node];
            move = width;
            const double forward = moved(z, moves);
            move = -width;
            const double slope = (forward - moved(z, moves)) / (2 * width);
            move = 0.0;
            CHECK(std::abs(slope - places.field(nu)[node]) < tolerance);
            CHECK(std::abs(slope - places.field(nu)[(node + 1) % grid.size()]) > tolerance);  // a twin
          }
        }
      }
    }
  }
}

namespace {

/// The same for the wave equation's leapfrog: h ΔV Σ over the triangles of a node, of a node itself and one neighbour
/// along time and every axis, det F [½ u_t² - ½ |∇u|² + cos u - 1] with ∇ = F⁻¹D, in their mean.
double moved_triangles(const grids::Grid& grid, double h, const std::array<FieldSet, 2>& z,
                       const std::array<FieldSet, 2>& moves) {
  const int n = 1 + grid.dimensions();
  double sum = 0.0;
  for (std::size_t node = 0; node < grid.size(); ++node) {
    for (unsigned triangle = 0; triangle < (1U << n); ++triangle) {
      const std::size_t level = triangle & 1;
      Eigen::MatrixXd F = Eigen::MatrixXd::Identity(n, n);
      Eigen::VectorXd D(n);
      for (int rho = 0; rho < n; ++rho) {
        auto place = grid.place(node);
        const bool back = rho > 0 ? (triangle >> rho & 1) != 0 : level == 1;
        if (rho > 0) {
          const std::size_t cells = grid.cells(rho - 1);
          auto& i = place[static_cast<std::size_t>(rho) - 1];
          i = (i + (back ? cells - 1 : 1)) % cells;
        }
        const std::size_t there = grid.index(place[0], place[1], place[2]);
        const std::size_t level_there = rho == 0 ? 1 - level : level;
        const double length = (back ? -1.0 : 1.0) * (rho == 0 ? h : grid.spacing(rho - 1));
        D[rho] = (z[level_there].field(0)[there] - z[level].field(0)[node]) / length;
        for (int nu = 0; nu < n; ++nu) {
          F(rho, nu) += (moves[level_there].field(nu)[there] - moves[level].field(nu)[node]) / length;
        }
      }
      const Eigen::VectorXd gradient = F.inverse() * D;
      const double kinetic = gradient[0] * gradient[0] - gradient.tail(n - 1).squaredNorm();
      sum += F.determinant() * (0.5 * kinetic + std::cos(z[level].field(0)[node]) - 1.0);
    }
  }
  return h * grid.cell_volume() * sum / (1U << n);
}

}  // namespace

TEST_CASE("the leapfrog's action is that of Marsden, Patrick and Shkoller, on a mesh whose nodes move, too") {
  constexpr double width = 1e-5;
  constexpr double tolerance = 1e-8;
  const double h = 0.2;
  for (const auto& [system, grid] : cases()) {
    if (system.fields()[0] != "u" || system.fields()[1] != "v" || system.constant_hessian()(1, 1) != 1.0 ||
        system.nonlinear_hessian().empty()) {
      continue;
    }
    INFO(grid.dimensions());
    LatticeVariation mesh(*make_lattice_method({.name = "leapfrog"})->action(system), grid);
    const int n = 1 + grid.dimensions();
    const std::array z{random_fields(system.field_count(), grid.size(), 40),
                       random_fields(system.field_count(), grid.size(), 41)};
    std::array moves{FieldSet(n, grid.size()), FieldSet(n, grid.size())};
    mesh.take(z[0], z[1], h);
    CHECK(std::abs(moved_triangles(grid, h, z, moves) - mesh.action_value()) <
          rounding * static_cast<double>(grid.size()));
    Parts parts(n, grid.size());
    mesh.coordinates(parts);
    for (std::size_t level = 0; level < 2; ++level) {
      const FieldSet& places = level == 0 ? parts.before : parts.after;
      for (int nu = 0; nu < n; ++nu) {
        const std::size_t node = grid.size() / 2;
        double& move = moves[level].field(nu)[node];
        move = width;
        const double forward = moved_triangles(grid, h, z, moves);
        move = -width;
        const double slope = (forward - moved_triangles(grid, h, z, moves)) / (2 * width);
        move = 0.0;
        CHECK(std::abs(slope - places.field(nu)[node]) < tolerance);
        CHECK(std::abs(slope - places.field(nu)[node + 1]) > tolerance);  // a twin
      }
    }
  }
}

TEST_CASE("the two-form of any two variations sums to zero over both levels of a slab") {
  for (const auto& [system, grid] : cases()) {
    for (const LatticeAction& action : actions_of(system)) {
      LatticeVariation mesh(action, grid);
      const int d = system.field_count();
      const auto pair = [&](unsigned seed) {
        Parts result(d, grid.size());
        result.before = random_fields(d, grid.size(), seed);
        result.after = random_fields(d, grid.size(), seed + 1);
        return result;
      };
      const Parts levels = pair(20);
      mesh.take(levels.before, levels.after, 0.2);
      const Parts u = pair(22), v = pair(24);
      Parts form(1, grid.size());
      mesh.two_form(u, v, form);
      const double lower = grids::sum(form.before.field(0));
      CHECK(std::abs(lower + grids::sum(form.after.field(0))) < 10 * rounding);
      mesh.two_form(u, pair(26), form);  // the twin: another V
      CHECK(std::abs(lower + grids::sum(form.after.field(0))) > 1e6 * rounding);
    }
  }
}

TEST_CASE("varying the values of the euler-box action gives its map") {
  for (const auto& [system, grid] :
       {Case{sine_gordon(), grids::Grid({{"x", 0, 2, 8}})}, Case{schroedinger(2), grids::Grid({{"x", 0, 2, 8}})}}) {
    const int d = system.field_count();
    EulerBoxMap map(system, grid);
    FieldSet first = random_fields(d, grid.size(), 30);
    REQUIRE(map.start(first) == Status::success);
    FieldSet second(first), third(first);
    const double h = 0.03;
    double energy = 0.0;
    REQUIRE(map.advance(h, first, second, energy) == Status::success);
    REQUIRE(map.advance(h, second, third, energy) == Status::success);
    map.write_derived(second);
    map.write_derived(third);
    LatticeVariation mesh(euler_box_action(system), grid);
    Parts into(d, grid.size()), from(into);
    mesh.take(first, second, h);
    mesh.values(into);
    mesh.take(second, third, h);
    mesh.values(from);
    CHECK(largest(sum(into.after, from.before)) < rounding);
    for (int f = 0; f < d; ++f) {
      third.field(f)[3] += 1e-6;  // the twin
    }
    mesh.take(second, third, h);
    mesh.values(from);
    CHECK(largest(sum(into.after, from.before)) > 1e-9);
  }
}
