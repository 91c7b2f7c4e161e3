#include <rubato/pde/cell_sweep_storage.hpp>

#include <algorithm>
#include <utility>

namespace rubato {

CellSweep::Storage::Storage(const MultisymplecticSystem& s, const grids::Grid& grid, Collocation collocation)
    : system(s),
      blocks(grid, collocation == Collocation::cells),
      gather(grid),
      d(s.field_count()),
      dimensions(grid.dimensions()),
      nodes(grid.size()),
      volume(grid.cell_volume()),
      at_corners(collocation == Collocation::corners),
      M(terms_of(s.M())),
      constant_hessian(terms_of(s.constant_hessian())),
      places(s, grid, collocation.points == Collocation::Points::cells ? Within::centre : Within::node),
      differentiated(static_cast<std::size_t>(d)),
      in_energy(static_cast<std::size_t>(d)),
      results(blocks.count()) {
  for (int a = 0; a < dimensions; ++a) {
    inverse_spacing[a] = 1.0 / grid.spacing(a);
    cells[a] = grid.cells(a);
    K.push_back(terms_of(s.K(a)));
    K_plus.push_back(terms_of(s.structure().K_plus[static_cast<std::size_t>(a)]));
    for (const MatrixTerm& term : K.back()) {
      differentiated[static_cast<std::size_t>(term.column)][static_cast<std::size_t>(a)] = true;
    }
    for (const MatrixTerm& term : K_plus.back()) {
      in_energy[static_cast<std::size_t>(term.row)][static_cast<std::size_t>(a)] = true;
    }
  }
  if (collocation.has_elements()) {
    elements = std::make_unique<ElementOperators>(grid, collocation.stages);
    places = elements->space().places(s, grid);
  } else if (collocation == Collocation::nodes) {
    nodal = std::make_unique<NodeDerivative>(grid, collocation);
  }
  if (at_corners || (grids::Slab::of(grid) != nullptr && !blocks.are_of_whole())) {
    by_node = grids::FieldSet(rows_by_node, grid.size());
  }
  if (blocks.are_of_whole()) {
    pieces.assign(2, {.terms = {}, .sizes = std::vector<double>(size_count())});
  }
}

void CellSweep::Storage::make(std::span<const double* const> fields, const std::vector<std::array<bool, 3>>& wanted,
                              Made& made) const {
  if (made.derivative.empty() && !fields.empty() && (nodal != nullptr || elements != nullptr)) {
    for (int a = 0; a < dimensions; ++a) {
      made.derivative.emplace_back(d, nodes);
    }
    made.mean = grids::FieldSet(elements != nullptr ? d : 0, nodes);
  }
  for (std::size_t f = 0; f < fields.size(); ++f) {
    if (fields[f] == nullptr) {
      continue;
    }
    const int field = static_cast<int>(f);
    if (elements != nullptr) {
      (*elements)(fields[f], made.mean.field(field).data(),
                  wanted[f][0] ? made.derivative[0].field(field).data() : nullptr);
    }
    for (std::size_t a = 0; nodal != nullptr && a < made.derivative.size(); ++a) {
      if (wanted[f][a]) {
        (*nodal)(static_cast<int>(a), fields[f], made.derivative[a].field(field).data());
      }
    }
  }
}

void CellSweep::Storage::take_backward_difference(const double* field, int axis, const CellBlocks::Block& block,
                                                  double* out) const {
  const double scale = inverse_spacing[axis];
  if (axis == 0) {
    const double* const line = field + block.line * blocks.line;
    const auto take = [=](std::size_t i, std::size_t before) { return scale * (line[i] - line[before]); };
    const std::size_t begin = block.begin;
    out[0] = take(begin, begin == 0 ? blocks.line - 1 : begin - 1);
    for (std::size_t c = 1; c < block.count; ++c) {
      out[c] = take(begin + c, begin + c - 1);
    }
    return;
  }
  const std::size_t stride = axis == 1 ? 1 : cells[1], place = block.line / stride % cells[axis];
  const std::size_t before = place == 0 ? block.line + (cells[axis] - 1) * stride : block.line - stride;
  const double *const here = field + block.offset, *const there = field + before * blocks.line + block.begin;
  for (std::size_t c = 0; c < block.count; ++c) {
    out[c] = scale * (here[c] - there[c]);
  }
}

void CellSweep::give_back() {
  const auto forget = [](grids::FieldSet& fields) {
    for (int f = 0; f < fields.fields(); ++f) {
      fields.forget(f);
    }
  };
  forget(storage_->by_node);
  for (Storage::Made* const made : {&storage_->of_point, &storage_->of_rate}) {
    std::ranges::for_each(made->derivative, forget);
    forget(made->mean);
  }
}

std::unique_ptr<CellSweep::Storage::Workspace> CellSweep::Storage::make_workspace() const {
  auto work = std::make_unique<Workspace>();
  const std::size_t varying = system.varying_hessian().size();
  const auto fields = static_cast<std::size_t>(d);
  const std::size_t arrays = 2 * fields * (1 + static_cast<std::size_t>(dimensions)) + 1 + fields + varying;
  work->memory = grids::Buffer(arrays * block_size);
  double* next = work->memory.data();
  const auto take = [&next] { return std::exchange(next, next + block_size); };
  for (std::size_t f = 0; f < fields; ++f) {
    work->mean.push_back(take());
    work->rate_mean.push_back(take());
    auto& difference = work->difference.emplace_back();
    auto& rate_difference = work->rate_difference.emplace_back();
    for (std::size_t a = 0; a < static_cast<std::size_t>(dimensions); ++a) {
      difference[a] = differentiated[f][a] ? take() : nullptr;
      rate_difference[a] = differentiated[f][a] ? take() : nullptr;
    }
    work->inputs.push_back(work->mean.back());
  }
  work->inputs.resize(fields + places.count());
  for (std::size_t j = 0; j < 1 + fields + varying; ++j) {
    work->outputs.push_back(take());
  }
  work->gradient = formula::BatchEvaluator(system.gradient_code());
  work->hessian = formula::BatchEvaluator(system.hessian_code());
  work->size = formula::RoundingEvaluator(system.size_code());
  work->cell.resize(work->inputs.size());
  work->cell_error.resize(work->inputs.size());
  work->sizes.resize(size_count());
  return work;
}

/// A and D_a of the point on a block, the potentials' slopes included, and where it is.
void CellSweep::Storage::gather_point(std::size_t block, Workspace& work, std::span<const double* const> point,
                                      const PotentialSlopes& slopes) const {
  const CellBlocks::Block at = blocks[block];
  places.put(at.offset, std::span(work.inputs).subspan(static_cast<std::size_t>(d)));
  for (int f = 0; f < d; ++f) {
    const auto i = static_cast<std::size_t>(f);
    take(point[i], f, of_point, at, work.mean[i], work.difference[i]);
    if (const double slope = slopes.at(f, at.line); slope != 0.0 && work.difference[i][0] != nullptr) {
      for (std::size_t c = 0; c < at.count; ++c) {
        work.difference[i][0][c] += slope;
      }
    }
  }
}

}  // namespace rubato
