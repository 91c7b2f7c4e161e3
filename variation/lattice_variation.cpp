#include <rubato/variation/lattice_variation.hpp>

#include <algorithm>
#include <array>
#include <initializer_list>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>

#include <rubato/formula/batch.hpp>
#include <rubato/grids/arrays.hpp>
#include <rubato/grids/parallel.hpp>
#include <rubato/grids/reductions.hpp>

namespace rubato {

namespace {

using formula::Expression;
using grids::FieldSet;
using Parts = LatticeVariation::Parts;

/// Points that one call of an evaluator is given.
constexpr std::size_t piece = 4096;

/// What an operator makes of the values on both levels, apart from space: before·z_k + after·z_{k+1}.
struct TimeWeights {
  double before = 0.0;
  double after = 0.0;
};

TimeWeights weights(InTime time, double h) {
  switch (time) {
    case InTime::before: return {1.0, 0.0};
    case InTime::after: return {0.0, 1.0};
    case InTime::mean: return {0.5, 0.5};
    case InTime::difference: return {-1.0 / h, 1.0 / h};
  }
  return {};
}

/// A field in the slab has one value there, and no difference.
TimeWeights weights(const LatticeAction& action, int field, InTime time, double h) {
  if (!action.at_midpoints[static_cast<std::size_t>(field)]) {
    return weights(time, h);
  }
  return {0.0, time == InTime::difference ? 0.0 : 1.0};
}

/// Code evaluated at every cell, each thread with a copy of its own.
class GridCode {
public:
  GridCode() = default;
  GridCode(std::span<const Expression> outputs, std::span<const Expression> inputs)
      : prototype_(formula::Bytecode(outputs, inputs)) {}

  void operator()(std::size_t cells, std::span<const double* const> inputs, std::span<double* const> outputs) {
    while (evaluators_.size() < static_cast<std::size_t>(grids::thread_count())) {
      evaluators_.push_back(prototype_);
      in_.emplace_back(inputs.size());
      out_.emplace_back(outputs.size());
    }
    grids::for_each_block(cells, piece, [&](std::size_t begin, std::size_t end, std::size_t thread) {
      for (std::size_t j = 0; j < inputs.size(); ++j) {
        in_[thread][j] = inputs[j] + begin;
      }
      for (std::size_t j = 0; j < outputs.size(); ++j) {
        out_[thread][j] = outputs[j] + begin;
      }
      evaluators_[thread](end - begin, in_[thread], out_[thread]);
    });
  }

private:
  formula::BatchEvaluator prototype_;
  std::vector<formula::BatchEvaluator> evaluators_;
  std::vector<std::vector<const double*>> in_;
  std::vector<std::vector<double*>> out_;
};

}  // namespace

struct LatticeVariation::Storage {
  Storage(LatticeAction stated, const grids::Grid& g)
      : action(std::move(stated)),
        grid(g),
        stencil(g),
        inputs(static_cast<int>(action.values.size()), g.size()),
        places(static_cast<int>(action.places.size()), g.size()),
        directions(inputs),
        gradient(static_cast<int>(action.values.size() + action.places.size()), g.size()),
        currents(static_cast<int>(action.parts.size()) * currents_count(), g.size()),
        second(inputs),
        scratch(1, g.size()) {
    for (const LatticeAction::Value& value : action.values) {
      variables.push_back(value.variable);
    }
    arguments = variables;
    all_inputs = joined({&inputs, &places});
    all_directions = joined({&inputs, &places, &directions});
    for (std::size_t j = 0; j < action.places.size(); ++j) {
      arguments.push_back(action.places[j].variable);
      action.find_place(action.places[j], grid, places.field(static_cast<int>(j)));
    }
    for (int part = 0; part < static_cast<int>(action.parts.size()); ++part) {
      energies.push_back(currents.field(part * currents_count()).data());
    }
    const Expression lagrangian = action.lagrangian();
    density_code = GridCode(std::array{lagrangian}, arguments);
    std::vector<Expression> first = formula::gradient(lagrangian, arguments);
    gradient_code = GridCode(first, arguments);
    for (const Expression derivative : first) {
      read.push_back(!derivative.is_constant() || derivative.constant_value() != 0.0);
    }
    compile_currents();
    first.resize(variables.size());
    compile_second_variation(first);
  }

  [[nodiscard]] int directions_count() const { return 1 + action.dimensions; }
  [[nodiscard]] int currents_count() const { return directions_count() * directions_count(); }

  void compile_currents() {
    std::vector<Expression> outputs, energy;
    for (const LatticeAction::Part& part : action.parts) {
      const std::vector<Expression> all = action.currents(part);
      outputs.insert(outputs.end(), all.begin(), all.end());
      energy.push_back(all.front());
    }
    currents_code = GridCode(outputs, arguments);
    energy_code = GridCode(energy, arguments);
  }

  /// The gradient of (∂L/∂values)·u: the second variation applied to a direction u.
  void compile_second_variation(std::span<const Expression> first) {
    formula::Graph& graph = *action.graph;
    std::vector<Expression> both = arguments;
    Expression along = graph.constant(0.0);
    for (std::size_t j = 0; j < variables.size(); ++j) {
      both.push_back(graph.variable(fmt::format("variation of value {}", j)));
      along += first[j] * both.back();
    }
    const std::vector<Expression> rows = formula::gradient(along, variables);
    second_code = GridCode(rows, both);
  }

  /// L_o of the fields of a slab, one array for each value of the action, to which `arrays` then point: in `out`, or
  /// the field itself where L_o changes nothing.
  void gather(const FieldSet& before, const FieldSet& after, const PotentialSlopes* slopes, FieldSet& out,
              std::span<const double*> arrays) {
    for (std::size_t j = 0; j < action.values.size(); ++j) {
      const auto [field, op, variable] = action.values[j];
      const StencilOperator& o = action.operators[static_cast<std::size_t>(op)];
      const auto result = out.field(static_cast<int>(j));
      const double* in = in_time(weights(action, field, o.time, h), before.field(field), after.field(field));
      arrays[j] = result.data();
      if (o.space != grids::SpaceOperator::identity()) {
        stencil.apply(o.space, in, result.data());
      } else if (in == scratch.field(0).data()) {
        std::copy_n(in, grid.size(), result.data());
      } else {
        arrays[j] = in;
        continue;  // and has no slope, being no derivative
      }
      if (slopes != nullptr && o.time != InTime::difference && along_first_axis(o.space)) {
        const std::size_t line = grid.cells(0);
        for (std::size_t l = 0; l * line < grid.size(); ++l) {
          if (const double slope = slopes->at(field, l); slope != 0.0) {
            for (double& value : result.subspan(l * line, line)) {
              value += slope;
            }
          }
        }
      }
    }
  }

  [[nodiscard]] static bool along_first_axis(const grids::SpaceOperator& op) {
    return op.spectral_axis == 0 || op.box[0] == grids::Along::difference;
  }

  const double* in_time(TimeWeights w, std::span<const double> before, std::span<const double> after) {
    if (w.before == 0.0 && w.after == 1.0) {
      return after.data();
    }
    if (w.before == 1.0 && w.after == 0.0) {
      return before.data();
    }
    // The same two weights but for a sign: values that agree leave no rounding in a difference.
    const double ratio = w.after == 0.0 ? 0.0 : w.before / w.after;
    double* out = scratch.field(0).data();
    grids::combine(w.after, after, ratio, before, {out, grid.size()});
    return out;
  }

  /// Row `row` of out += factor · h ΔV · (L_o)ᵀ(cells), with the operator's weights on both levels.
  void gather_back(const StencilOperator& op, TimeWeights w, double factor, const double* cells, int row, Parts& out) {
    const double volume = factor * h * grid.cell_volume();
    const double* moved = cells;
    if (op.space != grids::SpaceOperator::identity()) {
      moved = scratch.field(0).data();
      stencil.apply_adjoint(op.space, cells, scratch.field(0).data());
    }
    const auto add = [&](double weight, std::span<double> to) {
      if (weight != 0.0) {
        grids::add(weight, {moved, to.size()}, to);
      }
    };
    add(volume * w.before, out.before.field(row));
    add(volume * w.after, out.after.field(row));
  }

  /// Σ_o (∂L_o z/∂z)ᵀ of one array for each value of the action.
  void back_to_values(const FieldSet& of_values, Parts& out) {
    out.before.fill(0.0);
    out.after.fill(0.0);
    for (std::size_t j = 0; j < action.values.size(); ++j) {
      if (read[j]) {
        const auto& [field, number, variable] = action.values[j];
        const StencilOperator& op = action.operators[static_cast<std::size_t>(number)];
        gather_back(op, weights(action, field, op.time, h), 1.0, of_values.field(static_cast<int>(j)).data(), field,
                    out);
      }
    }
  }

  static std::vector<const double*> joined(std::initializer_list<const FieldSet*> parts) {
    std::vector<const double*> all;
    for (const FieldSet* part : parts) {
      all.insert(all.end(), part->pointers().begin(), part->pointers().end());
    }
    return all;
  }

  void need_gradient() {
    if (!std::exchange(gradient_known, true)) {
      gradient_code(grid.size(), all_inputs, gradient.pointers());
    }
  }
  void need_currents() {
    if (!std::exchange(currents_known, true)) {
      currents_code(grid.size(), all_inputs, currents.pointers());
    }
  }

  LatticeAction action;
  grids::Grid grid;
  grids::Stencil stencil;
  std::vector<Expression> variables, arguments;  ///< the values; and the places after them
  GridCode density_code, gradient_code, energy_code, currents_code, second_code;
  FieldSet inputs;      ///< L_o z of the slab
  FieldSet places;      ///< L_o x^ν
  FieldSet directions;  ///< L_o u of a variation u
  FieldSet gradient;    ///< ∂L/∂(L_o z), then ∂L/∂(L_o x^ν)
  FieldSet currents;    ///< J^ν_ρ, of one part after the other
  FieldSet second;      ///< the second variation applied to them
  FieldSet scratch;
  std::vector<const double*> all_inputs;      ///< inputs, or the fields themselves, and places
  std::vector<const double*> all_directions;  ///< these, and directions or the fields of u
  FieldSet total;                             ///< the currents of all parts, where there are several
  std::vector<double*> energies;              ///< where J^t_t of each part goes
  std::vector<bool> read;                     ///< whether L depends on a value (the currents read all)
  double h = 0.0;
  bool gradient_known = false;
  bool currents_known = false;
};

LatticeVariation::LatticeVariation(LatticeAction action, const grids::Grid& grid) {
  if (action.dimensions != grid.dimensions()) {
    throw std::invalid_argument(fmt::format("an action in {} dimensions cannot be varied on a grid with {}",
                                            action.dimensions, grid.dimensions()));
  }
  storage_ = std::make_unique<Storage>(std::move(action), grid);
}
LatticeVariation::~LatticeVariation() = default;
LatticeVariation::LatticeVariation(LatticeVariation&&) noexcept = default;
LatticeVariation& LatticeVariation::operator=(LatticeVariation&&) noexcept = default;

const LatticeAction& LatticeVariation::action() const {
  return storage_->action;
}

void LatticeVariation::take(const FieldSet& before, const FieldSet& after, double h, const PotentialSlopes& slopes) {
  Storage& s = *storage_;
  s.h = h;
  s.gather(before, after, &slopes, s.inputs, s.all_inputs);
  s.gradient_known = false;
  s.currents_known = false;
}

double LatticeVariation::action_value() {
  Storage& s = *storage_;
  double* const density[] = {s.scratch.field(0).data()};
  s.density_code(s.grid.size(), s.all_inputs, density);
  return s.h * s.grid.cell_volume() * grids::sum(s.scratch.field(0));
}

double LatticeVariation::energy() {
  Storage& s = *storage_;
  if (!s.currents_known) {
    s.energy_code(s.grid.size(), s.all_inputs, s.energies);
  }
  const auto density = s.scratch.field(0);
  s.scratch.fill(0.0);
  for (const double* energy : s.energies) {
    grids::add(1.0, {energy, density.size()}, density);
  }
  return s.grid.cell_volume() * grids::sum(density);
}

void LatticeVariation::values(Parts& out) {
  storage_->need_gradient();
  storage_->back_to_values(storage_->gradient, out);
}

void LatticeVariation::coordinates(Parts& out) {
  Storage& s = *storage_;
  s.need_currents();
  out.before.fill(0.0);
  out.after.fill(0.0);
  const int n = s.directions_count();
  int row = 0;
  for (const LatticeAction::Part& part : s.action.parts) {
    for (int nu = 0; nu < n; ++nu) {
      for (const int derivative : part.derivatives) {
        const StencilOperator& op = s.action.operators[static_cast<std::size_t>(derivative)];
        s.gather_back(op, weights(op.time, s.h), -1.0, std::as_const(s.currents).field(row++).data(), nu, out);
      }
    }
  }
  for (std::size_t j = 0; j < s.action.places.size(); ++j) {
    s.need_gradient();
    const LatticeAction::Place& place = s.action.places[j];
    const StencilOperator& op = s.action.operators[static_cast<std::size_t>(place.op)];
    const auto number = static_cast<int>(s.action.values.size() + j);
    s.gather_back(op, weights(op.time, s.h), 1.0, std::as_const(s.gradient).field(number).data(), 1 + place.axis, out);
  }
}

const FieldSet& LatticeVariation::currents() {
  Storage& s = *storage_;
  s.need_currents();
  const int count = s.currents_count();
  if (s.currents.fields() == count) {
    return s.currents;
  }
  if (s.total.fields() == 0) {
    s.total = FieldSet(count, s.grid.size());
  }
  for (int row = 0; row < s.currents.fields(); ++row) {
    const auto from = std::as_const(s.currents).field(row);
    const auto to = s.total.field(row % count);
    if (row < count) {
      std::copy_n(from.data(), from.size(), to.data());
    } else {
      grids::add(1.0, from, to);
    }
  }
  return s.total;
}

void LatticeVariation::sources(FieldSet& out) {
  Storage& s = *storage_;
  s.need_gradient();
  out.fill(0.0);
  for (std::size_t j = 0; j < s.action.places.size(); ++j) {
    const auto from = std::as_const(s.gradient).field(static_cast<int>(s.action.values.size() + j));
    grids::add(1.0, from, out.field(1 + s.action.places[j].axis));
  }
}

void LatticeVariation::tangent(const Parts& u, Parts& out) {
  Storage& s = *storage_;
  std::ranges::copy(s.all_inputs, s.all_directions.begin());
  s.gather(u.before, u.after, nullptr, s.directions, std::span(s.all_directions).subspan(s.all_inputs.size()));
  s.second_code(s.grid.size(), s.all_directions, s.second.pointers());
  s.back_to_values(s.second, out);
}

void LatticeVariation::two_form(const Parts& u, const Parts& v, Parts& out) {
  const int fields = u.before.fields();
  Parts of_u(fields, u.before.size());
  Parts of_v(of_u);
  tangent(u, of_u);
  tangent(v, of_v);
  const auto contract = [fields](const FieldSet& a, const FieldSet& of_b, const FieldSet& b, const FieldSet& of_a,
                                 std::span<double> result) {
    std::ranges::fill(result, 0.0);
    for (int f = 0; f < fields; ++f) {
      for (std::size_t i = 0; i < result.size(); ++i) {
        result[i] += a.field(f)[i] * of_b.field(f)[i] - b.field(f)[i] * of_a.field(f)[i];
      }
    }
  };
  contract(u.before, of_v.before, v.before, of_u.before, out.before.field(0));
  contract(u.after, of_v.after, v.after, of_u.after, out.after.field(0));
}

}  // namespace rubato
