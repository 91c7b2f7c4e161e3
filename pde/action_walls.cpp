#include <algorithm>
#include <array>
#include <vector>

#include <rubato/base/compensated_sum.hpp>
#include <rubato/grids/slab.hpp>
#include <rubato/pde/action_step.hpp>
#include <rubato/pde/mirror_signs.hpp>

namespace rubato {

void ActionStep::find_held() {
  const MultisymplecticSystem& system = rows_.system();
  const grids::Grid& grid = rows_.grid();
  is_loose_.resize(static_cast<std::size_t>(system.field_count()));
  if (!grid.has_ghosts()) {
    return;
  }
  const FieldMirrors mirrors(system, grid, Collocation::corners);
  for (int f = 0; f < system.field_count(); ++f) {
    for (const PlaceNumbers& numbers : mirrors.loose(grid, f)) {
      Expression& product = is_loose_[static_cast<std::size_t>(f)];
      const Expression factor = rows_.variation().along_axis(numbers);
      product = product.valid() ? product * factor : factor;
    }
  }
}

int ActionStep::place_of_driven(int field) const {
  if (!driven_nodes_) {
    return -1;
  }
  const std::vector<int>& fields = driven_nodes_->fields();
  const auto found = std::ranges::find(fields, field);
  return found == fields.end() ? -1 : static_cast<int>(found - fields.begin());
}

formula::Expression ActionStep::where_loose(int field, Expression value) {
  const Expression loose = is_loose_[static_cast<std::size_t>(field)];
  if (!loose.valid()) {
    return value;
  }
  NodeVariation& variation = rows_.variation();
  const int driven = place_of_driven(field);
  const Expression held = driven < 0 ? variation.node(NodeVariation::Level::before, field)
                                     : variation.other(rows_.kept() + 2 * rows_.system().field_count() + driven);
  return loose * value + (1.0 - loose) * held;
}

void ActionStep::drive(double t) {
  for (const DrivenNodes::Node& node : driven_nodes_->nodes()) {
    const DrivenNodes::Values values = driven_nodes_->at(node, t);
    driven_.field(place_of_driven(node.u))[node.node] = values.u;
    driven_.field(place_of_driven(node.row.v))[node.node] = values.v;
  }
}

ActionStep::Work ActionStep::work(double h, const LatticeLevel& before, const grids::FieldSet& after) {
  if (!driven_nodes_) {
    return {};
  }
  const int d = rows_.system().field_count();
  NodeCode& forces = made(codes_.on_walls, [&] {
    std::vector<Expression> values;
    for (const auto level : {NodeVariation::Level::before, NodeVariation::Level::after}) {
      for (int f = 0; f < d; ++f) {
        values.push_back(rows_.variation().values_between_walls(level, f));
      }
    }
    return values;
  });
  read(forces, h, before, after, no_momenta_);
  std::vector<double> values(2 * static_cast<std::size_t>(d));
  std::vector<double*> out;
  for (double& value : values) {
    out.push_back(&value);
  }
  const grids::Slab* const slab = grids::Slab::of(after.size());
  std::array<CompensatedSum, 2> sums;
  for (const DrivenNodes::Node& node : driven_nodes_->nodes()) {
    if (slab != nullptr && !slab->owns(node.node)) {
      continue;
    }
    forces.evaluate(0, node.node, node.node + 1, {}, out);
    const auto u = static_cast<std::size_t>(node.u);
    const auto part = [&](double force, double v) {
      return -volume_ * (force + node.weight * node.row.m * v) * node.row.rate(v);
    };
    const double v_before = before.fields.field(node.row.v)[node.node], v_after = after.field(node.row.v)[node.node];
    sums[0].add(part(values[u], v_before));
    sums[1].add(-part(-values[u + static_cast<std::size_t>(d)], v_after));
  }
  std::array<double, 2> totals = {sums[0].value(), sums[1].value()};
  if (slab != nullptr) {
    slab->reduce(sums, totals, {});
  }
  return {.before = totals[0], .after = totals[1]};
}

}  // namespace rubato
