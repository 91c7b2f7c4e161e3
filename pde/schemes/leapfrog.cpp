#include <algorithm>
#include <array>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include <rubato/pde/action_scheme.hpp>
#include <rubato/pde/lattice_method.hpp>
#include <rubato/pde/law_evaluator.hpp>
#include <rubato/pde/matrix_terms.hpp>
#include <rubato/pde/static_condensation.hpp>

namespace rubato {

namespace {

/// A field u with its momentum v: the row of v is m u_t = a v + b.
struct MovingPair {
  int u = 0, v = 0;
  double m = 0.0;
  LinearRow row;  ///< a and b
};

/// A field w that differences along one axis give: Σ_u K(w, u) δu = c w + b. δ is δ⁺ where K₊ has these entries, else
/// δ⁻.
struct SlopeField {
  int w = 0, axis = 0;
  bool forward = true;
  MatrixTerms terms;
  LinearRow row;
};

/// A system of wave type: S = T(v) + W(w) + V(u, x), T and W quadratic, sums of squares.
struct WaveType {
  std::vector<MovingPair> pairs;
  std::vector<SlopeField> slopes;
};

[[noreturn]] void refuse_leapfrog(const MultisymplecticSystem& system, int field, const std::string& reason) {
  throw SchemeRefusal(fmt::format("leapfrog is for equations of wave type, and here {} {}; take lagrangian = \"box\"",
                                  system.fields()[static_cast<std::size_t>(field)], reason));
}

SlopeField slope_field(const MultisymplecticSystem& system, int w, const std::vector<bool>& moves) {
  SlopeField slope{.w = w, .terms = {}, .row = *linear_row(system, w)};
  for (int a = 0; a < system.directions(); ++a) {
    for (const MatrixTerm& term : terms_of(system.K(a).row(w))) {
      const bool forward = system.structure().K_plus[static_cast<std::size_t>(a)](w, term.column) != 0.0;
      const bool other = !slope.terms.empty() && (slope.axis != a || slope.forward != forward);
      if (!moves[static_cast<std::size_t>(term.column)] || other) {
        refuse_leapfrog(system, w, "is not the derivative of moving fields along one axis");
      }
      slope.axis = a;
      slope.forward = forward;
      slope.terms.push_back({w, term.column, term.value});
    }
  }
  return slope;
}

/// \throws SchemeRefusal if the system is not of wave type
WaveType wave_type(const MultisymplecticSystem& system) {
  const int d = system.field_count();
  std::vector<bool> moves(static_cast<std::size_t>(d), false);
  for (int f = 0; f < d; ++f) {
    const bool momentum = in_no_K(system, f) && linear_row(system, f).has_value();
    moves[static_cast<std::size_t>(f)] = !system.M().row(f).isZero(0.0) && !momentum;
  }
  WaveType waves;
  for (int f = 0; f < d; ++f) {
    const auto neighbours = terms_of(system.M().row(f));
    if (neighbours.empty()) {
      if (!linear_row(system, f)) {
        refuse_leapfrog(system, f,
                        "is not given by differences alone, its row of the equation being nonlinear or naming other "
                        "fields (as [grid] phase "
                        "makes it do)");
      }
      waves.slopes.push_back(slope_field(system, f, moves));
    } else if (neighbours.size() != 1 ||
               moves[static_cast<std::size_t>(f)] == moves[static_cast<std::size_t>(neighbours.front().column)]) {
      refuse_leapfrog(system, f, "and what M couples it with are not one field and its momentum");
    } else if (!moves[static_cast<std::size_t>(f)]) {
      waves.pairs.push_back({neighbours.front().column, f, neighbours.front().value, *linear_row(system, f)});
    } else {
      for (int a = 0; a < system.directions(); ++a) {
        for (const MatrixTerm& term : terms_of(system.K(a).row(f))) {
          if (!system.M().row(term.column).isZero(0.0)) {
            refuse_leapfrog(system, f, "is coupled in space with a field that has an equation of motion");
          }
        }
      }
    }
  }
  return waves;
}

/// The discrete Lagrangian of Marsden, Patrick and Shkoller (Comm. Math. Phys. 199, 1998): on the triangle of a node
/// and its neighbours in time and along the axes, L(u, u_t, u_x) at the node and at the differences to these
/// neighbours; the mean over all triangles of a node within the slab. L is that of ½ zᵀ(M z_t + Σ K_a z_{x_a}) - S with
/// v and w put in from their rows: Σ m u_t v + Σ K(w, u) u_x w - S.
LatticeAction leapfrog_action(const MultisymplecticSystem& system) {
  const WaveType waves = wave_type(system);
  const int n = system.directions();
  LatticeActionBuilder build(system.field_count(), n);
  const unsigned corners = 1U << n;
  for (const InTime level : {InTime::before, InTime::after}) {
    const int node = build.add({level, grids::SpaceOperator::identity()});
    for (unsigned corner = 0; corner < corners; ++corner) {
      build.add_derivative({InTime::difference, grids::SpaceOperator::identity()});
      for (int a = 0; a < n; ++a) {
        build.add_derivative({level, (corner >> a & 1U) != 0 ? grids::SpaceOperator::forward_difference(a)
                                                             : grids::SpaceOperator::backward_difference(a)});
      }
      std::vector<formula::Expression> z(system.variables().size());
      formula::Expression density = build.graph().constant(0.0);
      for (const MovingPair& pair : waves.pairs) {
        const formula::Expression rate = pair.m * build.derivative(pair.u, 0);
        z[static_cast<std::size_t>(pair.u)] = build.value(pair.u, node);
        z[static_cast<std::size_t>(pair.v)] = (rate - pair.row.b) / pair.row.a;
        density += rate * z[static_cast<std::size_t>(pair.v)];
      }
      for (const SlopeField& slope : waves.slopes) {
        formula::Expression sum = build.graph().constant(0.0);
        for (const MatrixTerm& term : slope.terms) {
          sum += term.value * build.derivative(term.column, 1 + slope.axis);
        }
        z[static_cast<std::size_t>(slope.w)] = (sum - slope.row.b) / slope.row.a;
        density += sum * z[static_cast<std::size_t>(slope.w)];
      }
      for (std::size_t c = 0; c < system.coordinates().size(); ++c) {
        z[static_cast<std::size_t>(system.field_count()) + c] = build.place(system.coordinates()[c], node);
      }
      density -= formula::substitute(std::array{system.expression()}, build.graph(), system.variables(), z).front();
      build.add_part(density / (2.0 * corners));
    }
  }
  return build.finish();
}

/// Its moving fields, in their order.
std::vector<int> moving_fields(const MultisymplecticSystem& system) {
  std::vector<int> fields;
  for (const MovingPair& pair : wave_type(system).pairs) {
    fields.push_back(pair.u);
  }
  std::ranges::sort(fields);
  return fields;
}

StatedAction stated_leapfrog(const MultisymplecticSystem& system, std::shared_ptr<const WallDrives> drives) {
  return {.action = leapfrog_action(system.without_constant()),
          .is_symmetric = true,
          .cell_equations = {},
          .drives = std::move(drives)};
}

/// Leapfrog in time and space, from leapfrog_action() alone: step, energy, equation, tangent and laws are variations of
/// it. With the momenta m v ΔV at the levels,
///
///     m v_k ΔV = -∂𝕊/∂u_k,    m v_{k+1} ΔV = ∂𝕊/∂u_{k+1},
///
/// of which the first is linear in u_{k+1}; the fields w are differences of u at each level.
class LeapfrogMethod final : public LatticeMethod {
public:
  explicit LeapfrogMethod(std::shared_ptr<const WallDrives> drives) : drives_(std::move(drives)) {}

  /// A step reads one neighbour of u and renews its ghost farthest out, so that other fields are right one ghost less
  /// far; laws take the divergence of currents that are made of differences.
  [[nodiscard]] grids::Ghosts ghosts(const MultisymplecticSystem&) const override { return {3, 3}; }
  [[nodiscard]] std::optional<Collocation> in_mirror() const override { return Collocation::corners; }
  [[nodiscard]] std::size_t wall_ghosts(const MultisymplecticSystem& system) const override {
    return ghosts(system).before;
  }
  [[nodiscard]] std::optional<LatticeAction> action(const MultisymplecticSystem& system) const override {
    return leapfrog_action(system);
  }
  [[nodiscard]] InitialLevel first_level(const MultisymplecticSystem& system, const grids::Grid& grid,
                                         const InitialFields& given) const override {
    static_cast<void>(wave_type(system));  // which says what is wrong in terms of this scheme
    return prepare_initial_level(system, grid, given, Collocation::corners);
  }
  [[nodiscard]] std::unique_ptr<ConstrainedFields> constrained_fields(const MultisymplecticSystem& system,
                                                                      const grids::Grid& grid) const override {
    return make_constrained_fields(system, grid, Collocation::corners);
  }
  [[nodiscard]] std::unique_ptr<LatticeScheme> scheme(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                      LatticeLevel first, double first_step) const override {
    return make_action_scheme(system, grid, stated_leapfrog(system, drives_), nullptr, std::move(first), first_step);
  }
  [[nodiscard]] std::unique_ptr<LawEvaluator> laws(LawTables tables) const override {
    std::vector<int> moving = moving_fields(tables.system);
    return make_action_laws(make_node_laws(std::move(tables), Collocation::corners), std::move(moving));
  }
  [[nodiscard]] std::unique_ptr<StepEquation> equation(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                       const LatticeLevel& first, double first_step) const override {
    return make_action_equation(system, grid, stated_leapfrog(system, drives_), nullptr, first, first_step);
  }
  [[nodiscard]] std::unique_ptr<TangentStep> tangents(const MultisymplecticSystem& system,
                                                      const grids::Grid& grid) const override {
    return make_action_tangents(system, grid, stated_leapfrog(system, nullptr));
  }

private:
  std::shared_ptr<const WallDrives> drives_;
};

}  // namespace

LatticeMethodEntry leapfrog_method() {
  return {.name = "leapfrog",
          .summary = "second differences in time and space, explicit; wave equations",
          .make = [](const LatticeMethodChoice& choice) -> std::unique_ptr<LatticeMethod> {
            return std::make_unique<LeapfrogMethod>(choice.drives);
          }};
}

}  // namespace rubato
