#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <utility>

#include <rubato/base/compensated_sum.hpp>
#include <rubato/formula/batch.hpp>
#include <rubato/grids/buffer.hpp>
#include <rubato/grids/parallel.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/pde/face_gather.hpp>
#include <rubato/pde/law_evaluator.hpp>
#include <rubato/pde/placed_coordinates.hpp>
#include <rubato/pde/space_collocation.hpp>

namespace rubato {

namespace {

constexpr std::size_t block_size = CellBlocks::most;
constexpr int time = LawTables::time;

CompensatedSum sum_from(CompensatedSum sum, std::span<const double> terms) {
  for (const double term : terms) {
    sum.add(term);
  }
  return sum;
}

/// The fields on the faces of one block: means and derivatives in the directions within the face, and S.
struct Faces {
  std::vector<double*> mean;
  std::vector<std::array<double*, 4>> derivative;               ///< of each field in direction μ
  std::vector<std::array<const double*, 4>> derivative_inputs;  ///< the same
  double* S = nullptr;
  std::vector<double*> currents;      ///< of each law
  std::vector<double*> sources;       ///< of each coordinate that S names
  std::vector<const double*> inputs;  ///< of the codes of S: the means, then the coordinates
};

struct Workspace {
  grids::Buffer memory;
  formula::BatchEvaluator S, source;
  Faces faces;
};

/// What the laws are computed with: the operators on faces, in blocks of cells.
struct FaceOperators : LawTables {
  SharedCellBlocks blocks;
  FaceGather gather;
  std::vector<std::unique_ptr<Workspace>> workspaces;
  StepPoints points;
  grids::FieldSet sum;                                         ///< of each law
  std::unique_ptr<ElementOperators> elements;                  ///< in elements only: of cells the laws are a mean of
  grids::FieldSet at_points, derivatives;                      ///< in elements, of the fields in use
  std::vector<std::vector<double>> sums;                       ///< [law][block]: of densities
  std::array<grids::FieldSet, 2> pieces;                       ///< of the first and the last block here: densities
  PlacedCoordinates at_cells;                                  ///< in their middles
  std::array<std::vector<PlacedCoordinates>, 2> placed_faces;  ///< [upper][axis]: on the faces normal to an axis

  FaceOperators(LawTables tables, Collocation collocation, std::shared_ptr<StageSource> stages)
      : LawTables(std::move(tables)), blocks(grid), gather(grid), points(system, grid, std::move(stages)) {
    if (collocation.has_elements()) {
      elements = std::make_unique<ElementOperators>(grid, collocation.stages);
      at_points = grids::FieldSet(d, grid.size());
      derivatives = at_points;
    }
    if (!system.coordinates().empty()) {
      place_faces();
    }
    sums.assign(names.size(), std::vector<double>(blocks.count()));
    if (blocks.are_of_whole()) {
      pieces.fill(grids::FieldSet(static_cast<int>(names.size()), block_size));
    }
  }

  void place_faces() {
    at_cells =
        elements != nullptr ? elements->space().places(system, grid) : PlacedCoordinates(system, grid, Within::centre);
    for (const bool upper : {false, true}) {
      for (int a = 0; a < grid.dimensions(); ++a) {
        grids::BoxOperator place{Within::centre, Within::centre, Within::centre};
        place[static_cast<std::size_t>(a)] = upper ? Within::next : Within::node;
        placed_faces[upper ? 1 : 0].emplace_back(system, grid, place);
      }
    }
  }
  /// The coordinates on the faces normal to `mu`.
  [[nodiscard]] const PlacedCoordinates& places(int mu, bool upper) const {
    const auto& along = placed_faces[upper ? 1 : 0];
    return mu == time || along.empty() ? at_cells : along[static_cast<std::size_t>(mu) - 1];
  }

  void prepare_workspaces() {
    while (workspaces.size() < static_cast<std::size_t>(grids::thread_count())) {
      auto work = std::make_unique<Workspace>();
      const auto fields = static_cast<std::size_t>(d);
      const std::size_t arrays =
          fields * (1 + static_cast<std::size_t>(directions)) + 1 + names.size() + system.coordinates().size();
      work->memory = grids::Buffer(arrays * block_size);
      double* next = work->memory.data();
      const auto take = [&next] { return std::exchange(next, next + block_size); };
      for (std::size_t f = 0; f < fields; ++f) {
        work->faces.mean.push_back(take());
        auto& derivative = work->faces.derivative.emplace_back();
        for (int mu = 0; mu < directions; ++mu) {
          derivative[static_cast<std::size_t>(mu)] = take();
        }
        auto& inputs = work->faces.derivative_inputs.emplace_back();
        std::ranges::copy(derivative, inputs.begin());
      }
      work->faces.S = take();
      for (std::size_t l = 0; l < names.size(); ++l) {
        work->faces.currents.push_back(take());
      }
      for (std::size_t c = 0; c < system.coordinates().size(); ++c) {
        work->faces.sources.push_back(take());
      }
      work->faces.inputs.assign(work->faces.mean.begin(), work->faces.mean.end());
      work->faces.inputs.resize(system.variables().size());
      work->S = formula::BatchEvaluator(system.value_code());
      if (!system.coordinates().empty()) {
        work->source = formula::BatchEvaluator(system.source_code());
      }
      workspaces.push_back(std::move(work));
    }
  }

  [[nodiscard]] grids::FieldSet& piece(std::size_t block) { return pieces[block == 0 ? 0 : 1]; }

  /// The operations along x, y, z on the faces normal to `mu` that differentiate in `nu` (nu = mu: none).
  void face(const double* field, std::size_t line, std::size_t begin, std::size_t count, int mu, bool upper, int nu,
            double* out) const {
    FaceOperation operations[3] = {FaceOperation::average, FaceOperation::average, FaceOperation::average};
    if (mu != time) {
      operations[mu - 1] = upper ? FaceOperation::second : FaceOperation::first;
    }
    if (nu != mu && nu != time) {
      operations[nu - 1] = FaceOperation::difference;
    }
    gather(field, line, begin, count, operations, out);
  }

  /// Means, derivatives and S on one side of the cells of a block.
  void fill(Workspace& work, std::size_t line, std::size_t begin, std::size_t count, int mu, bool upper,
            const grids::FieldSet& values, const PotentialSlopes& slopes) const {
    Faces& faces = work.faces;
    for (int f = 0; f < d; ++f) {
      const auto i = static_cast<std::size_t>(f);
      if (mu == time && system.structure().at_midpoints(f)) {  // not there at levels, and not in the densities
        std::fill_n(faces.mean[i], count, 0.0);
        for (int nu = 0; nu < directions; ++nu) {
          std::fill_n(faces.derivative[i][static_cast<std::size_t>(nu)], count, 0.0);
        }
        continue;
      }
      const std::size_t offset = line * blocks.line + begin;
      const bool in_element = elements != nullptr && mu == time;
      if (in_element) {
        std::copy_n(at_points.field(f).data() + offset, count, faces.mean[i]);
      } else {
        face(values.field(f).data(), line, begin, count, mu, upper, mu, faces.mean[i]);
      }
      for (int nu = 0; nu < directions; ++nu) {
        if (nu == mu) {
          continue;
        }
        double* derivative = faces.derivative[i][static_cast<std::size_t>(nu)];
        if (in_element) {
          std::copy_n(std::as_const(derivatives).field(f).data() + offset, count, derivative);
        } else {
          const grids::FieldSet& from = nu == time ? points.rate() : values;
          face(from.field(f).data(), line, begin, count, mu, upper, nu, derivative);
        }
        if (const double slope = nu == 1 ? slopes.at(f, line) : 0.0; slope != 0.0) {
          for (std::size_t c = 0; c < count; ++c) {
            derivative[c] += slope;
          }
        }
      }
    }
    put_places(work, line, begin, mu, upper);
    double* const outputs[] = {faces.S};
    work.S(count, faces.inputs, outputs);
  }

  void put_places(Workspace& work, std::size_t line, std::size_t begin, int mu, bool upper) const {
    std::vector<const double*>& inputs = work.faces.inputs;
    places(mu, upper).put(line * blocks.line + begin, std::span(inputs).subspan(work.faces.mean.size()));
  }

  /// total[1 + a] -= weight · ∂S/∂x_a in the middle of the cells of a block and of the step: the sources of momentum.
  void subtract_sources(Workspace& work, std::size_t line, std::size_t begin, std::size_t count, double weight,
                        std::span<double* const> total) const {
    Faces& faces = work.faces;
    if (faces.sources.empty()) {
      return;
    }
    for (int f = 0; f < d; ++f) {
      const auto i = static_cast<std::size_t>(f);
      if (elements != nullptr) {
        std::copy_n(at_points.field(f).data() + line * blocks.line + begin, count, faces.mean[i]);
      } else {
        face(points.z().field(f).data(), line, begin, count, time, false, time, faces.mean[i]);
      }
    }
    put_places(work, line, begin, time, false);
    work.source(count, faces.inputs, faces.sources);
    for (std::size_t c = 0; c < faces.sources.size(); ++c) {
      double* out = total[1 + static_cast<std::size_t>(system.coordinates()[c])];
      for (std::size_t i = 0; i < count; ++i) {
        out[i] -= weight * weight_of(line * blocks.line + begin + i) * faces.sources[c][i];
      }
    }
  }

  /// Of a density in sums over the grid.
  [[nodiscard]] double weight_of(std::size_t cell) const {
    return elements == nullptr ? 1.0 : elements->space().weights()[cell];
  }

  /// In cells: total += factor · J_μ on one side of them.
  void add_currents(Workspace& work, std::size_t line, std::size_t begin, std::size_t count, int mu, bool upper,
                    double factor, const LatticeLevel& before, const LatticeLevel& after,
                    std::span<double* const> total) const {
    prepare_currents(work, line, begin, count, mu, upper, before, after);
    const bool weighted = elements != nullptr && mu == time;
    for (std::size_t l = 0; l < names.size(); ++l) {
      for (std::size_t c = 0; weighted && c < count; ++c) {
        total[l][c] += factor * weight_of(begin + c) * work.faces.currents[l][c];
      }
      for (std::size_t c = 0; !weighted && c < count; ++c) {
        total[l][c] += factor * work.faces.currents[l][c];
      }
    }
  }
  /// In cells: total += weight · (Σ_a D_aJ_a - the sources) at the point of the step.
  void add_cell_fluxes(Workspace& work, std::size_t line, std::size_t begin, std::size_t count, double weight,
                       const LatticeLevel& level, std::span<double* const> total) const {
    for (int mu = 1; mu < directions; ++mu) {
      const double inverse = weight / spacing(mu, 0.0);
      for (const bool upper : {false, true}) {
        add_currents(work, line, begin, count, mu, upper, upper ? inverse : -inverse, level, level, total);
      }
    }
    subtract_sources(work, line, begin, count, weight, total);
  }

  /// In elements: A z and D z at their points.
  void take_points(const grids::FieldSet& values) {
    for (int f = 0; elements != nullptr && f < d; ++f) {
      (*elements)(values.field(f).data(), at_points.field(f).data(), derivatives.field(f).data());
    }
  }

  /// Residuals in the cells, into sum[law].
  void residuals_in_cells(const LatticeLevel& before, const LatticeLevel& after, double h) {
    sum.fill(0.0);
    const auto for_each = [&](auto&& add) {
      for_each_block_of_cells(
          [&](std::size_t, std::size_t line, std::size_t begin, std::size_t count, Workspace& work) {
            std::vector<double*> out(names.size());
            for (std::size_t l = 0; l < names.size(); ++l) {
              out[l] = sum.pointers()[l] + line * blocks.line + begin;
            }
            add(work, line, begin, count, out);
          });
    };
    for (const bool upper : {false, true}) {
      take_points((upper ? after : before).fields);
      for_each([&](Workspace& work, std::size_t line, std::size_t begin, std::size_t count, auto& out) {
        add_currents(work, line, begin, count, time, upper, (upper ? 1.0 : -1.0) / h, before, after, out);
      });
    }
    points.for_each(before, after, h, [&](double weight) {
      take_points(points.z());
      for_each([&](Workspace& work, std::size_t line, std::size_t begin, std::size_t count, auto& out) {
        add_cell_fluxes(work, line, begin, count, weight, after, out);
      });
    });
    spread_over_elements(sum);
  }

  /// The law of an element is the mean of what its cells have: fluxes at the nodes within cancel.
  void spread_over_elements(grids::FieldSet& residuals) const {
    if (elements == nullptr) {
      return;
    }
    const auto stages_in_space = static_cast<std::size_t>(elements->space().rule().stages);
    for (int l = 0; l < residuals.fields(); ++l) {
      const auto values = residuals.field(l);
      for (std::size_t first = 0; first < values.size(); first += stages_in_space) {
        const auto element = values.subspan(first, stages_in_space);
        double mean = 0.0;
        for (const double value : element) {
          mean += value / static_cast<double>(stages_in_space);
        }
        std::ranges::fill(element, mean);
      }
    }
  }

  void prepare_currents(Workspace& work, std::size_t line, std::size_t begin, std::size_t count, int mu, bool upper,
                        const LatticeLevel& before, const LatticeLevel& after) const {
    const grids::FieldSet& values = mu != time ? points.z() : upper ? after.fields : before.fields;
    fill(work, line, begin, count, mu, upper, values, after.slopes);
    const Faces& faces = work.faces;
    LawTables::currents(mu, count,
                        {.z = std::span(faces.inputs).first(static_cast<std::size_t>(d)),
                         .derivatives = faces.derivative_inputs,
                         .S = faces.S,
                         .partner = {}},
                        faces.currents);
  }

  /// Calls use(block, line, begin, count, workspace) for every block of cells, in parallel.
  template <typename Use>
  void for_each_block_of_cells(Use&& use) {
    prepare_workspaces();
    grids::for_each_index(blocks.count(), blocks.count() > 8, [&](std::size_t block, std::size_t thread) {
      const CellBlocks::Block at = blocks[block];
      use(block, at.line, at.begin, at.count, *workspaces[thread]);
    });
  }
};

class EdgeLaws final : public LawEvaluator {
public:
  EdgeLaws(LawTables tables, Collocation collocation, std::shared_ptr<StageSource> stages)
      : operators_(std::move(tables), collocation, std::move(stages)) {}

  void share(std::shared_ptr<StageSource> stages) override { operators_.points.share(std::move(stages)); }

  [[nodiscard]] const LawTables& tables() const override { return operators_; }
  std::vector<Spread> residuals(const LatticeLevel& before, const LatticeLevel& after, double h,
                                std::span<double* const> residuals) override;
  std::vector<double> totals(const LatticeLevel& level) override;
  Spread multisymplectic_residual(const TangentLevels& u, const TangentLevels& v, double h, double* residual) override;

private:
  FaceOperators operators_;
};

std::vector<Spread> EdgeLaws::residuals(const LatticeLevel& before, const LatticeLevel& after, double h,
                                        std::span<double* const> residuals) {
  FaceOperators& s = operators_;
  if (s.sum.fields() == 0) {
    s.sum = grids::FieldSet(static_cast<int>(s.names.size()), s.grid.size());
  }
  s.residuals_in_cells(before, after, h);
  return write_residuals(s.sum, residuals);
}

std::vector<double> EdgeLaws::totals(const LatticeLevel& level) {
  FaceOperators& s = operators_;
  const std::size_t laws = s.names.size();
  s.take_points(level.fields);
  s.for_each_block_of_cells(
      [&](std::size_t block, std::size_t line, std::size_t begin, std::size_t count, Workspace& work) {
        s.prepare_currents(work, line, begin, count, time, false, level, level);
        for (std::size_t l = 0; l < laws; ++l) {
          double* const terms = work.faces.currents[l];
          for (std::size_t c = 0; c < count; ++c) {
            terms[c] *= s.weight_of(line * s.blocks.line + begin + c);
          }
          if (s.blocks[block].is_piece()) {
            std::copy_n(terms, count, s.piece(block).field(static_cast<int>(l)).data());
          } else {
            s.sums[l][block] = sum_from({}, {terms, count}).value();
          }
        }
      });
  const auto go_on = [&s](std::size_t block, std::span<double> carried) {
    for (std::size_t l = 0; l < s.names.size(); ++l) {
      const auto before = carried.subspan(2 * l, 2);
      const auto terms = std::as_const(s.piece(block)).field(static_cast<int>(l)).first(s.blocks[block].count);
      const CompensatedSum sum = sum_from(CompensatedSum(before[0], before[1]), terms);
      before[0] = sum.high;
      before[1] = sum.low;
      s.sums[l][block] = sum.value();
    }
  };
  std::vector<double> totals(laws);
  s.blocks.total(
      2 * laws, go_on, totals, [&s](std::size_t block, std::size_t law) { return s.sums[law][block]; }, {},
      [](std::size_t, std::size_t) { return 0.0; });
  for (double& total : totals) {
    total *= s.grid.cell_volume();
  }
  return totals;
}

Spread EdgeLaws::multisymplectic_residual(const TangentLevels& u, const TangentLevels& v, double h, double* residual) {
  FaceOperators& s = operators_;
  const StageSource* stages = s.points.stages();
  const bool over_stages = stages != nullptr;
  if (over_stages &&
      (u.stages.size() != static_cast<std::size_t>(stages->count()) || v.stages.size() != u.stages.size())) {
    throw std::invalid_argument("the law of two tangent solutions of Gauss collocation needs their stages, on cells");
  }
  std::vector<grids::FieldSet> middles;  // of the step, where it has no stages
  for (const TangentLevels* tangent : {&u, &v}) {
    s.points.take_middle(tangent->before, tangent->after, h);
    middles.push_back(s.points.z());
  }
  grids::FieldSet sum(1, s.grid.size());
  sum.fill(0.0);
  grids::FieldSet left_points(s.elements != nullptr ? s.d : 0, s.grid.size()), right_points = left_points;
  const auto add = [&](const grids::FieldSet& left_fields, const grids::FieldSet& right_fields, int mu, bool upper,
                       double factor) {
    const bool in_element = s.elements != nullptr && mu == time;
    for (int f = 0; in_element && f < s.d; ++f) {
      (*s.elements)(left_fields.field(f).data(), left_points.field(f).data(), nullptr);
      (*s.elements)(right_fields.field(f).data(), right_points.field(f).data(), nullptr);
    }
    s.for_each_block_of_cells(
        [&](std::size_t, std::size_t line, std::size_t begin, std::size_t count, Workspace& work) {
          const std::size_t offset = line * s.blocks.line + begin;
          for (const MatrixTerm& term : s.full[static_cast<std::size_t>(mu)]) {
            const double* left = work.faces.S;
            const double* right = work.faces.mean[0];
            if (in_element) {
              left = std::as_const(left_points).field(term.row).data() + offset;
              right = std::as_const(right_points).field(term.column).data() + offset;
            } else {
              s.face(left_fields.field(term.row).data(), line, begin, count, mu, upper, mu, work.faces.S);
              s.face(right_fields.field(term.column).data(), line, begin, count, mu, upper, mu, work.faces.mean[0]);
            }
            double* to = sum.pointers()[0] + offset;
            for (std::size_t c = 0; c < count; ++c) {
              to[c] += (in_element ? s.weight_of(offset + c) : 1.0) * factor * term.value * left[c] * right[c];
            }
          }
        });
  };
  const std::size_t points = over_stages ? u.stages.size() : 1;
  for (int mu = 0; mu < s.directions; ++mu) {
    for (const bool upper : {false, true}) {
      const auto factor = [&](double weight) { return (upper ? 1.0 : -1.0) * weight / s.spacing(mu, h); };
      for (std::size_t i = 0; i < (mu == time ? 1 : points); ++i) {
        if (mu == time) {
          add(upper ? u.after : u.before, upper ? v.after : v.before, mu, upper, factor(1.0));
        } else if (over_stages) {
          add(u.stages[i], v.stages[i], mu, upper, factor(stages->weight(static_cast<int>(i))));
        } else {
          add(middles[0], middles[1], mu, upper, factor(1.0));
        }
      }
    }
  }
  s.spread_over_elements(sum);
  if (residual != nullptr) {
    std::ranges::copy(std::as_const(sum).field(0), residual);
  }
  return grids::magnitudes(std::as_const(sum).field(0));
}

}  // namespace

std::unique_ptr<LawEvaluator> make_edge_laws(LawTables tables, Collocation collocation,
                                             std::shared_ptr<StageSource> stages) {
  const auto make = [collocation](LawTables of, std::shared_ptr<StageSource> over) -> std::unique_ptr<LawEvaluator> {
    return std::make_unique<EdgeLaws>(std::move(of), collocation, std::move(over));
  };
  if (stages != nullptr || collocation.has_elements()) {
    return make(std::move(tables), std::move(stages));
  }
  return make_compact_laws(std::move(tables), collocation,
                           [make](LawTables of) { return make(std::move(of), nullptr); });
}

}  // namespace rubato
