#include <algorithm>
#include <array>
#include <stdexcept>
#include <utility>

#include <rubato/grids/reductions.hpp>
#include <rubato/pde/lattice_actions.hpp>
#include <rubato/pde/law_codes.hpp>
#include <rubato/pde/law_evaluator.hpp>
#include <rubato/variation/lattice_variation.hpp>
#include <rubato/variation/node_variation.hpp>

namespace rubato {

namespace {

using formula::Expression;
using grids::FieldSet;
using Level = NodeVariation::Level;

/// The laws of euler-box: forward differences of the currents J^ν_ρ that its action has by variation, at the base
/// corners, in two passes: the fluxes in space, then residuals. J^ν_t reads one level alone. The law of two tangent
/// solutions is its two-form at a node between two slabs.
class EulerBoxLaws final : public LawEvaluator {
  [[nodiscard]] auto reads_level(const PotentialSlopes& slopes) const {
    return [this, &slopes](NodeCode& code, const FieldSet& level) { variation_.read(code, level, level, 1.0, slopes); };
  }

public:
  explicit EulerBoxLaws(LawTables tables)
      : tables_(std::move(tables)), variation_(euler_box_action(tables_.system), tables_.grid) {
    find_currents();
    const std::vector<Expression> before = currents(LawTables::time);
    const std::vector<Expression> densities = at_upper_level(before);
    std::vector<Expression> sums = densities;
    for (std::size_t law = 0; law < sums.size(); ++law) {
      sums[law] = variation_.rate() * (sums[law] - before[law]);
    }
    const std::vector<Expression> fluxes = LawCodes::add_differences(
        tables_.grid.dimensions(), [&](int a) { return currents(1 + a); },
        [&](int array, int a) { return variation_.difference_of_other(array, a); }, sums);
    for (const LatticeAction::Place& place : variation_.action().places) {
      const auto momentum = static_cast<std::size_t>(1 + place.axis);
      if (tables_.ramps.empty()) {
        sums[momentum] += variation_.by_place(place);
      } else if (tables_.system.has_source(place.axis)) {
        sums[momentum] = sums[momentum] - source_at(place);
      }
    }
    codes_ = {variation_, tables_.grid, densities, fluxes, sums};
  }

  [[nodiscard]] const LawTables& tables() const override { return tables_; }

  std::vector<Spread> residuals(const LatticeLevel& before, const LatticeLevel& after, double h,
                                std::span<double* const> residuals) override {
    return take(before, after, h, residuals, false);
  }
  std::vector<Spread> next_residuals(const LatticeLevel& before, const LatticeLevel& after, double h,
                                     std::span<double* const> residuals) override {
    return take(before, after, h, residuals, true);
  }

  std::vector<double> totals(const LatticeLevel& level) override {
    return codes_.totals(tables_.grid, tables_.names.size(), level, reads_level(level.slopes));
  }
  std::vector<double> totals_after(const LatticeLevel& after) override {
    return codes_.totals_after(tables_.grid, tables_.names.size(), after, reads_level(after.slopes));
  }

  Spread multisymplectic_residual(const TangentLevels& u, const TangentLevels& v, double h, double* residual) override {
    if (u.earlier == nullptr || v.earlier == nullptr) {
      throw std::invalid_argument("the multisymplectic law of euler-box needs tangent solutions at three levels");
    }
    using Parts = LatticeVariation::Parts;
    const auto pair = [](const FieldSet& lower, const FieldSet& upper) {
      Parts levels(lower.fields(), lower.size());
      levels.before = lower;
      levels.after = upper;
      return levels;
    };
    // S'' is symmetric and drops out at every node.
    LatticeVariation form(euler_box_action(tables_.system, false), tables_.grid);
    form.take(u.before, u.after, h);
    Parts into(1, tables_.grid.size()), from(into);
    form.two_form(pair(*u.earlier, u.before), pair(*v.earlier, v.before), into);
    form.two_form(pair(u.before, u.after), pair(v.before, v.after), from);
    FieldSet& sum = from.before;
    const double inverse = 1.0 / (h * tables_.grid.cell_volume());
    for (std::size_t i = 0; i < sum.size(); ++i) {
      sum.field(0)[i] = inverse * (sum.field(0)[i] + into.after.field(0)[i]);
    }
    if (residual != nullptr) {
      std::ranges::copy(sum.field(0), residual);
    }
    return grids::magnitudes(std::as_const(sum).field(0));
  }

private:
  std::vector<Spread> take(const LatticeLevel& before, const LatticeLevel& after, double h,
                           std::span<double* const> residuals, bool follows) {
    const auto read = [&](NodeCode& code) {
      variation_.read(code, before.fields, after.fields, h, after.slopes,
                      {&codes_.of_fluxes, &codes_.levels.lower(), &codes_.levels.upper()});
    };
    return codes_.take(tables_.grid, tables_.names.size(), before, after, follows, reads_level(after.slopes), read,
                       residuals);
  }

  /// J^ν_ρ, the sum over the parts of the action.
  void find_currents() {
    currents_.resize(static_cast<std::size_t>(tables_.directions * tables_.directions));
    for (const LatticeAction::Part& part : variation_.action().parts) {
      const std::vector<Expression> of_part = variation_.currents(part);
      for (std::size_t i = 0; i < of_part.size(); ++i) {
        add_weighted(currents_[i], 1.0, of_part[i]);
      }
    }
  }
  /// J_μ of all laws, of symmetries with z at the lower level.
  [[nodiscard]] std::vector<Expression> currents(int mu) {
    std::vector<Expression> sums(tables_.names.size());
    for (int nu = 0; nu < tables_.directions; ++nu) {
      sums[static_cast<std::size_t>(nu)] = currents_[static_cast<std::size_t>(nu * tables_.directions + mu)];
    }
    for (const LawTerm& term : tables_.terms_of_currents(mu, false)) {
      if (term.law >= static_cast<std::size_t>(tables_.directions) || term.of_seam) {
        const Expression left = variation_.node(Level::before, term.left.field);
        add_weighted(sums[term.law], term.factor,
                     term.right ? left * variation_.node(Level::before, term.right->field) : left);
      }
    }
    for (Expression& sum : sums) {
      sum = sum.valid() ? sum : variation_.graph().constant(0.0);
    }
    return sums;
  }
  /// The source that the medium has along the axis of a place, at the base corner.
  [[nodiscard]] Expression source_at(const LatticeAction::Place& place) {
    const MultisymplecticSystem& system = tables_.system;
    const LatticeAction& action = variation_.action();
    std::vector<Expression> from, to;
    for (const LatticeAction::Value& value : action.values) {
      if (value.op == place.op) {
        from.push_back(system.variables()[static_cast<std::size_t>(value.field)]);
        to.push_back(value.variable);
      }
    }
    Expression source;
    for (std::size_t c = 0; c < system.coordinates().size(); ++c) {
      if (system.coordinates()[c] == place.axis) {
        source = system.sources()[c];
      }
      const auto same = std::ranges::find(action.places, system.coordinates()[c], &LatticeAction::Place::axis);
      from.push_back(system.variables()[static_cast<std::size_t>(tables_.d) + c]);
      to.push_back(same->variable);
    }
    return variation_.in_cell(formula::substitute(std::array{source}, *action.graph, from, to).front());
  }
  /// The same with the upper level in the lower one's place.
  [[nodiscard]] std::vector<Expression> at_upper_level(std::span<const Expression> of_lower) {
    std::vector<Expression> from, to;
    for (int f = 0; f < tables_.d; ++f) {
      for (int a = -1; a < tables_.grid.dimensions(); ++a) {
        std::array<int, 3> offset{};
        if (a >= 0) {
          offset[static_cast<std::size_t>(a)] = 1;
        }
        from.push_back(variation_.node(Level::before, f, offset));
        to.push_back(variation_.node(Level::after, f, offset));
      }
    }
    return formula::substitute(of_lower, variation_.graph(), from, to);
  }

  LawTables tables_;
  NodeVariation variation_;
  std::vector<Expression> currents_;  ///< J^ν_ρ in ν·(1 + dimensions) + ρ
  LawCodes codes_;
};

}  // namespace

std::unique_ptr<LawEvaluator> make_euler_box_laws(LawTables tables) {
  return std::make_unique<EulerBoxLaws>(std::move(tables));
}

}  // namespace rubato
