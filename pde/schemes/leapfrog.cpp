#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include <rubato/base/all_finite.hpp>
#include <rubato/base/wide_vectors.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/grids/slab.hpp>
#include <rubato/grids/stencil.hpp>
#include <rubato/pde/corner_energy.hpp>
#include <rubato/pde/family_lattice.hpp>
#include <rubato/pde/lattice_method.hpp>
#include <rubato/pde/matrix_terms.hpp>
#include <rubato/pde/static_condensation.hpp>
#include <rubato/variation/lattice_variation.hpp>
#include <rubato/variation/node_variation.hpp>

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
  const auto acts_in_space = [&](int f) {
    bool any = false;
    for (int a = 0; a < system.directions(); ++a) {
      any = any || !system.K(a).row(f).isZero(0.0);
    }
    return any;
  };
  std::vector<bool> moves(static_cast<std::size_t>(d), false);
  for (int f = 0; f < d; ++f) {
    const bool momentum = !acts_in_space(f) && linear_row(system, f).has_value();
    moves[static_cast<std::size_t>(f)] = !system.M().row(f).isZero(0.0) && !momentum;
  }
  WaveType waves;
  for (int f = 0; f < d; ++f) {
    const auto neighbours = terms_of(system.M().row(f));
    if (neighbours.empty()) {
      if (!linear_row(system, f)) {
        refuse_leapfrog(system, f, "is not given by differences, its row of the equation being nonlinear");
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
/// v and w put in from their rows: Σ m u_t v + Σ K(w, u) u_x w - S; or without V.
LatticeAction leapfrog_action(const MultisymplecticSystem& system, bool with_V = true) {
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
        z[static_cast<std::size_t>(pair.u)] = with_V ? build.value(pair.u, node) : build.graph().constant(1.0);
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

/// u = u of before + factor (m v + momentum + h force), at these nodes.
RUBATO_WIDE_VECTORS void move(double factor, double m, double momentum, double h, const double* before, const double* v,
                              const double* force, std::size_t begin, std::size_t end, double* u) {
#pragma GCC ivdep
  for (std::size_t i = begin; i < end; ++i) {
    u[i] = before[i] + factor * (m * v[i] + momentum + h * force[i]);
  }
}

/// The map of levels that the action states, by formulas of its variation at a node. With the momenta m v ΔV at the
/// levels,
///
///     m v_k ΔV = -∂𝕊/∂u_k,    m v_{k+1} ΔV = ∂𝕊/∂u_{k+1},
///
/// of which the first is linear in u_{k+1}, with the factor m²ΔV/(a h), and what is left of it at u_{k+1} = u_k was
/// found when u_k was: the leapfrog. The fields w are differences of u at each level.
class LeapfrogStep {
public:
  LeapfrogStep(const MultisymplecticSystem& system, const grids::Grid& grid)
      : pairs_(wave_type(system).pairs),
        volume_(grid.cell_volume()),
        variation_(leapfrog_action(system), grid),
        density_(1, grid.size()) {
    using Level = NodeVariation::Level;
    std::vector<formula::Expression> forces, outputs, level(static_cast<std::size_t>(system.field_count()));
    for (const MovingPair& pair : pairs_) {
      moving_.push_back(pair.u);
      told_.push_back(pair.v);
      outputs.push_back(variation_.values(Level::after, pair.u) / pair.m);
      level[static_cast<std::size_t>(pair.u)] = variation_.node(Level::after, pair.u);
      level[static_cast<std::size_t>(pair.v)] = outputs.back();
    }
    for (const SlopeField& slope : wave_type(system).slopes) {
      formula::Expression sum = formula::constant_like(variation_.step(), -slope.row.b / slope.row.a);
      for (const MatrixTerm& term : slope.terms) {
        sum += term.value / slope.row.a * variation_.difference(Level::after, term.column, slope.axis, slope.forward);
      }
      told_.push_back(slope.w);
      outputs.push_back(sum);
      level[static_cast<std::size_t>(slope.w)] = sum;
    }
    for (const MovingPair& pair : pairs_) {
      const auto [momentum, force] = variation_.at_rest(pair.u);
      momentum_at_rest_.push_back(momentum.constant_value());  // the row of v being linear in it
      forces.push_back(force);
    }
    outputs.push_back(variation_.energy());
    if (const formula::Expression density = density_of_level(system, level); density.valid()) {
      outputs.push_back(density);
      density_of_level_ = density_;
    }
    levels_ = variation_.keep(0, forces, {&outputs});
    code_ = variation_.code(outputs);
    momenta_.resize(moving_.size());
    largest_.resize(moving_.size());
  }

  /// Neighbours along an axis that u at the new level is made of; its momentum and differences are made of as many of
  /// its own. So ghosts of u that are right at every level, but for those farthest out, which each step renews, leave
  /// the other fields right one ghost less far.
  static constexpr std::size_t reach = 1;

  /// false if a value is not finite.
  [[nodiscard]] bool advance(double h, const LatticeLevel& before, grids::FieldSet& after) {
    if (!force_is_known_) {
      find_level(before.fields, before.slopes);
      levels_.go_on();
      force_is_known_ = true;
    }
    grids::compute_and_refresh(after, moving_, reach, [&](std::size_t begin, std::size_t end) {
      for (std::size_t p = 0; p < pairs_.size(); ++p) {
        const auto& [u, v, m, row] = pairs_[p];
        const double *const from = before.fields.field(u).data(), *const momentum = before.fields.field(v).data(),
                            *const force = levels_.lower().field(static_cast<int>(p)).data();
        double* const to = after.field(u).data();
        grids::for_each_block(end - begin, grids::nodes_per_block, [&](std::size_t first, std::size_t last) {
          move(h * row.a / (m * m), m, momentum_at_rest_[p], h, from, momentum, force, begin + first, begin + last, to);
        });
      }
    });
    evaluate(before.fields, after, h, before.slopes, after);
    return is_finite(after);
  }
  /// The last step leads to the level that the next is taken from.
  void accept() {
    levels_.go_on();
    stands_at_end_ = true;
  }
  /// The next step is taken from another level.
  void forget() { force_is_known_ = stands_at_end_ = false; }

  /// E_k = -∂𝕊/∂h of the last step.
  [[nodiscard]] double energy() const { return volume_ * grids::sum(density_.field(0)); }
  /// 𝓔 of the level that it leads to, if its density is made of what the step has there; and of the level that the next
  /// is taken from, if that is the same.
  ///@{
  [[nodiscard]] std::optional<double> energy_at_end() const {
    return density_of_level_.fields() == 0 ? std::nullopt
                                           : std::optional(volume_ * grids::sum(density_of_level_.field(0)));
  }
  [[nodiscard]] std::optional<double> energy_at_start() const {
    return stands_at_end_ ? energy_at_end() : std::nullopt;
  }
  ///@}

private:
  /// CornerEnergy of the upper level by what the fields are made of, so that S is evaluated once. Of fields that are
  /// told here there are no differences, and of coordinates no values: then empty.
  [[nodiscard]] formula::Expression density_of_level(const MultisymplecticSystem& system,
                                                     std::span<const formula::Expression> level) {
    if (!system.coordinates().empty() || !std::ranges::all_of(level, &formula::Expression::valid)) {
      return {};
    }
    return CornerEnergy::density(system, level, [&](int field, int axis) {
      const bool moves = std::ranges::find(moving_, field) != moving_.end();
      return moves ? variation_.difference(NodeVariation::Level::after, field, axis, false) : formula::Expression();
    });
  }

  /// What a level says alone: what a step begins from, and functions.
  void find_level(const grids::FieldSet& fields, const PotentialSlopes& slopes) {
    levels_.take(fields, [&](NodeCode& code, const grids::FieldSet& level) {
      variation_.read(code, level, level, 1.0, slopes);
    });
  }
  /// Momenta and differences at the upper level, into `out`; what the next step begins from; and the energy.
  void evaluate(const grids::FieldSet& lower, const grids::FieldSet& upper, double h, const PotentialSlopes& slopes,
                grids::FieldSet& out) {
    stands_at_end_ = false;
    find_level(upper, slopes);
    outputs_.clear();
    for (const int f : told_) {
      outputs_.push_back(out.field(f).data());
    }
    outputs_.push_back(density_.field(0).data());
    if (density_of_level_.fields() > 0) {
      outputs_.push_back(density_of_level_.field(0).data());
    }
    variation_.read(code_, lower, upper, h, slopes, {&levels_.lower(), &levels_.upper()});
    code_(outputs_);
  }

  /// Whether the momenta of a level are.
  [[nodiscard]] bool is_finite(const grids::FieldSet& fields) {
    std::ranges::transform(pairs_, momenta_.begin(), [&](const MovingPair& pair) { return fields.field(pair.v); });
    grids::max_abs(momenta_, largest_);
    return all_finite(largest_);
  }

  std::vector<MovingPair> pairs_;
  double volume_;  ///< of a cell
  NodeVariation variation_;
  NodeCode code_;
  std::vector<int> moving_, told_;  ///< the fields u; those that the code tells
  std::vector<double> momentum_at_rest_;
  LevelValues levels_;                ///< the forces of slabs at rest first
  grids::FieldSet density_;           ///< of E
  grids::FieldSet density_of_level_;  ///< of 𝓔 at the upper level, or none
  bool force_is_known_ = false, stands_at_end_ = false;
  std::vector<double*> outputs_;
  std::vector<std::span<const double>> momenta_;
  std::vector<double> largest_;
};

/// What two levels leave of the equations, and the linearised map, by passes of the variation over the lattice: apart
/// from LeapfrogStep.
class LeapfrogVariation {
public:
  LeapfrogVariation(const MultisymplecticSystem& system, const grids::Grid& grid)
      : waves_(wave_type(system)),
        line_(grid.cells(0)),
        volume_(grid.cell_volume()),
        variation_(leapfrog_action(system), grid),
        stencil_(grid),
        parts_(system.field_count(), grid.size()),
        scratch_(1, grid.size()) {
    for (const MovingPair& pair : waves_.pairs) {
      moving_.push_back(pair.u);
    }
  }

  /// Over a step that was taken. false if a value is not finite.
  [[nodiscard]] bool tangent(double h, const LatticeLevel& before, const LatticeLevel& after,
                             const grids::FieldSet& u_before, grids::FieldSet& u_after) {
    variation_.take(before.fields, after.fields, h, before.slopes);
    LatticeVariation::Parts direction(parts_);
    direction.before.copy_from(u_before);
    const auto vary = [&] {
      direction.after.copy_from(u_after);
      variation_.tangent(direction, parts_);
    };
    u_after.copy_from(u_before);
    vary();  // at u_t = 0
    grids::compute_and_refresh(u_after, moving_, LeapfrogStep::reach, [&](std::size_t begin, std::size_t end) {
      for (const MovingPair& pair : waves_.pairs) {
        const auto u = u_after.field(pair.u);
        const auto v = u_before.field(pair.v);
        const auto rest = std::as_const(parts_.before).field(pair.u);
        const double inverse = h * pair.row.a / (pair.m * pair.m);
        for (std::size_t i = begin; i < end; ++i) {
          u[i] += inverse * (pair.m * v[i] + rest[i] / volume_);
        }
      }
    });
    vary();
    bool is_finite = true;
    for (const MovingPair& pair : waves_.pairs) {
      const auto v = u_after.field(pair.v);
      const auto momentum = std::as_const(parts_.after).field(pair.u);
      const double factor = pair.m * volume_;
      std::ranges::transform(momentum, v.begin(), [factor](double value) { return value / factor; });
      is_finite = is_finite && std::isfinite(grids::max_abs(u_after.field(pair.v)));
    }
    for (const SlopeField& slope : waves_.slopes) {
      differentiate(slope, u_after, nullptr, u_after.field(slope.w));
    }
    return is_finite;
  }

  /// E_k = -∂𝕊/∂h of the slab that residual() has seen last.
  [[nodiscard]] double energy() { return variation_.energy(); }

  /// What two levels leave of the equations: of u and v divided by h, in the units of the rows of M z_t, of w at
  /// `after`.
  void residual(double h, const LatticeLevel& before, const LatticeLevel& after, grids::FieldSet& rows) {
    variation_.take(before.fields, after.fields, h, before.slopes);
    variation_.values(parts_);
    for (const MovingPair& pair : waves_.pairs) {
      const auto from = std::as_const(parts_.before).field(pair.u), into = std::as_const(parts_.after).field(pair.u);
      const auto v_0 = before.fields.field(pair.v), v_1 = after.fields.field(pair.v);
      const auto of_u = rows.field(pair.u), of_v = rows.field(pair.v);
      for (std::size_t i = 0; i < of_u.size(); ++i) {
        of_u[i] = (pair.m * v_0[i] + from[i] / volume_) / h;
        of_v[i] = (pair.m * v_1[i] - into[i] / volume_) / h;
      }
    }
    for (const SlopeField& slope : waves_.slopes) {
      const auto out = rows.field(slope.w);
      differentiate(slope, after.fields, &after.slopes, out);
      for (std::size_t i = 0; i < out.size(); ++i) {
        out[i] = slope.row.a * (after.fields.field(slope.w)[i] - out[i]);
      }
    }
  }

private:
  /// out = w of a level's u; without `slopes` its linear part alone.
  void differentiate(const SlopeField& slope, const grids::FieldSet& fields, const PotentialSlopes* slopes,
                     std::span<double> out) {
    using grids::SpaceOperator;
    const SpaceOperator difference =
        slope.forward ? SpaceOperator::forward_difference(slope.axis) : SpaceOperator::backward_difference(slope.axis);
    std::ranges::fill(out, slopes != nullptr ? -slope.row.b / slope.row.a : 0.0);
    for (const MatrixTerm& term : slope.terms) {
      const auto du = scratch_.field(0);
      stencil_.apply(difference, fields.field(term.column).data(), du.data());
      const double factor = term.value / slope.row.a;
      for (std::size_t begin = 0; begin < out.size(); begin += line_) {
        const bool sloping = slopes != nullptr && slope.axis == 0;
        const double mean = sloping ? slopes->at(term.column, begin / line_) : 0.0;
        for (std::size_t i = begin; i < begin + line_; ++i) {
          out[i] += factor * (du[i] + mean);
        }
      }
    }
  }

  WaveType waves_;
  std::vector<int> moving_;  ///< the fields u: what differences along the axes are taken of
  std::size_t line_;         ///< cells along the first axis
  double volume_;            ///< of one
  LatticeVariation variation_;
  grids::Stencil stencil_;
  LatticeVariation::Parts parts_;
  grids::FieldSet scratch_;
};

class LeapfrogLattice final : public FamilyLattice {
public:
  LeapfrogLattice(const MultisymplecticSystem& system, const grids::Grid& grid, LatticeLevel first)
      : FamilyLattice(system, grid, std::move(first), Collocation::corners),
        step_(system, grid),
        trial_(level_.fields),
        previous_(level_) {}

  [[nodiscard]] bool solves_fully() const override { return true; }
  [[nodiscard]] Status advance(double h, double) override {
    forget_trial();
    count_iterations(1);
    if (!step_.advance(h, level_, trial_)) {
      return Status::undefined;
    }
    const double energy = step_.energy();
    set_trial(h, energy);
    return std::isfinite(energy) ? Status::success : Status::undefined;
  }
  [[nodiscard]] const LatticeLevel* previous() const override { return &previous_; }
  void accept() override {
    std::swap(level_.fields, trial_);
    std::swap(previous_.fields, trial_);
    step_.accept();
    grow_older();
    move();
  }
  void stand(const LatticeLevel& level, const LatticeLevel&, double) override {
    level_.fields.copy_from(level.fields);
    step_.forget();
    start_level();
  }
  void save(StateWriter& state) const override { save_level(state); }
  void restore(StateReader& state) override {
    restore_level(state);
    step_.forget();
  }

private:
  [[nodiscard]] double energy_at_end() const override {
    const auto known = step_.energy_at_end();
    return known ? *known : energy_of(trial_);
  }
  [[nodiscard]] double energy_at_start() const override {
    const auto known = step_.energy_at_start();
    return known ? *known : energy_of(level_.fields);
  }

  LeapfrogStep step_;
  grids::FieldSet trial_;
  LatticeLevel previous_;
};

class LeapfrogEquation final : public FamilyEquation {
public:
  LeapfrogEquation(const MultisymplecticSystem& system, const grids::Grid& grid)
      : FamilyEquation(system, grid, Collocation::corners), variation_(system, grid) {}

  [[nodiscard]] StepLaw measure(const LatticeLevel& before, const LatticeLevel& after, double h) override {
    StepLaw law = unknown();
    variation_.residual(h, before, after, rows_);
    law.energy = variation_.energy();
    law.residual = grids::magnitudes(rows().all());
    return law;
  }

private:
  LeapfrogVariation variation_;
};

class LeapfrogTangents final : public TangentStep {
public:
  LeapfrogTangents(const MultisymplecticSystem& system, const grids::Grid& grid) : variation_(system, grid) {}

  [[nodiscard]] Status operator()(const LatticeLevel& before, const LatticeLevel& after, double h,
                                  const grids::FieldSet& u_before, grids::FieldSet& u_after) override {
    return variation_.tangent(h, before, after, u_before, u_after) ? Status::success : Status::undefined;
  }

private:
  LeapfrogVariation variation_;
};

/// The laws at nodes; and of two tangent solutions, with ω = m (U_u V_v - U_v V_u) at a level and Ω the two-form of the
/// slab's action at the node, at both levels together a divergence in space: (ω_{k+1} - ω_k)/h - Ω/(h ΔV).
class LeapfrogLaws final : public LawsWithTangents {
public:
  explicit LeapfrogLaws(LawTables of)
      : LawsWithTangents(make_node_laws(std::move(of), Collocation::corners)),
        pairs_(wave_type(tables().system).pairs),
        volume_(tables().grid.cell_volume()) {}

  Spread multisymplectic_residual(const TangentLevels& u, const TangentLevels& v, double h, double* residual) override {
    LatticeVariation::Parts of_u(u.before.fields(), u.before.size()), of_v(of_u), form(1, u.before.size());
    of_u.before = u.before;
    of_u.after = u.after;
    of_v.before = v.before;
    of_v.after = v.after;
    if (!variation_) {  // large, and nothing else uses it
      variation_.emplace(leapfrog_action(tables().system, false), tables().grid);
    }
    variation_->take(u.before, u.after, h);  // S'' is symmetric and drops out at every node: of any fields
    variation_->two_form(of_u, of_v, form);
    const auto sum = form.after.field(0);
    for (std::size_t i = 0; i < sum.size(); ++i) {
      sum[i] = -(sum[i] + form.before.field(0)[i]) / (h * volume_);
      for (const MovingPair& pair : pairs_) {
        const auto omega = [&](const grids::FieldSet& a, const grids::FieldSet& b) {
          return pair.m * (a.field(pair.u)[i] * b.field(pair.v)[i] - a.field(pair.v)[i] * b.field(pair.u)[i]);
        };
        sum[i] += (omega(u.after, v.after) - omega(u.before, v.before)) / h;
      }
    }
    if (residual != nullptr) {
      std::ranges::copy(sum, residual);
    }
    return grids::magnitudes(sum);
  }

private:
  std::vector<MovingPair> pairs_;
  double volume_;
  std::optional<LatticeVariation> variation_;
};

/// Leapfrog in time and space, from leapfrog_action() alone: step, energy, equation and variational laws are variations
/// of it.
class LeapfrogMethod final : public LatticeMethod {
public:
  /// Laws take the divergence of currents that are made of differences.
  [[nodiscard]] grids::Ghosts ghosts(const MultisymplecticSystem&) const override {
    constexpr std::size_t planes = 2 + LeapfrogStep::reach;
    return {planes, planes};
  }
  [[nodiscard]] std::optional<LatticeAction> action(const MultisymplecticSystem& system) const override {
    return leapfrog_action(system);
  }
  [[nodiscard]] InitialLevel first_level(const MultisymplecticSystem& system, const grids::Grid& grid,
                                         const InitialFields& given) const override {
    static_cast<void>(wave_type(system));  // which says what is wrong in terms of this scheme
    return prepare_initial_level(system, grid, given, Collocation::corners);
  }
  [[nodiscard]] std::unique_ptr<LatticeScheme> scheme(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                      LatticeLevel first, double) const override {
    return std::make_unique<LeapfrogLattice>(system, grid, std::move(first));
  }
  [[nodiscard]] std::unique_ptr<LawEvaluator> laws(LawTables tables) const override {
    return std::make_unique<LeapfrogLaws>(std::move(tables));
  }
  [[nodiscard]] std::unique_ptr<StepEquation> equation(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                       const LatticeLevel&, double) const override {
    return std::make_unique<LeapfrogEquation>(system, grid);
  }
  [[nodiscard]] std::unique_ptr<TangentStep> tangents(const MultisymplecticSystem& system,
                                                      const grids::Grid& grid) const override {
    return std::make_unique<LeapfrogTangents>(system, grid);
  }
};

}  // namespace

LatticeMethodEntry leapfrog_method() {
  return {.name = "leapfrog",
          .summary = "second differences in time and space, explicit; wave equations",
          .make = [](const LatticeMethodChoice&) -> std::unique_ptr<LatticeMethod> {
            return std::make_unique<LeapfrogMethod>();
          }};
}

}  // namespace rubato
