#include <algorithm>
#include <array>
#include <functional>
#include <stdexcept>
#include <utility>

#include <rubato/formula/batch.hpp>
#include <rubato/grids/arrays.hpp>
#include <rubato/grids/buffer.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/grids/whole.hpp>
#include <rubato/pde/law_evaluator.hpp>
#include <rubato/pde/node_derivative.hpp>
#include <rubato/pde/placed_coordinates.hpp>
#include <rubato/pde/same_bits.hpp>
#include <rubato/pde/tuning.hpp>

namespace rubato {

namespace {

using namespace tuning::node_laws;

constexpr int in_time = LawTables::time;

/// The laws at the nodes. What is differentiated is most of their cost, so that it is little: densities of a level
/// once, for the two steps that it is a level of; fields where a current has their derivative, in time too; and fluxes,
/// which are summed over the stages before.
class NodeLaws final : public LawEvaluator {
public:
  NodeLaws(LawTables tables, Collocation collocation, std::shared_ptr<StageSource> stages);

  void share(std::shared_ptr<StageSource> stages) override { points_.share(std::move(stages)); }
  [[nodiscard]] const LawTables& tables() const override { return tables_; }
  std::vector<Spread> residuals(const LatticeLevel& before, const LatticeLevel& after, double h,
                                std::span<double* const> residuals) override;
  std::vector<double> totals(const LatticeLevel& level) override;
  Spread multisymplectic_residual(const TangentLevels&, const TangentLevels&, double, double*) override {
    throw std::invalid_argument("the law of two tangent solutions is one of schemes on cells");
  }

private:
  /// One thread's.
  struct Workspace {
    grids::Buffer memory;
    formula::BatchEvaluator S, source;
    double* S_values = nullptr;
    const double* zero = nullptr;
    std::vector<double*> sloped;  ///< derivatives along x with the slopes of potentials, as differentiated_
    std::vector<double*> currents, sources;
    std::vector<const double*> inputs, partner;             ///< z, then coordinates; z⁺
    std::vector<std::array<const double*, 4>> derivatives;  ///< of each field
  };

  /// J_a, and the sources of momentum, ∂S/∂x_a at fixed z.
  struct Fluxes {
    std::vector<grids::FieldSet> along;  ///< [axis], of each law
    grids::FieldSet sources;             ///< of each coordinate that S names
  };

  void find_differentiated();
  void prepare_workspaces();
  void differentiate(const grids::FieldSet& values);
  void point_at(Workspace& work, const grids::FieldSet& z, const grids::FieldSet* rate, const PotentialSlopes& slopes,
                std::size_t line, std::size_t begin, std::size_t count) const;
  void take_level(const LatticeLevel& level, bool with_fluxes);
  void prepare(Fluxes& fluxes);
  void add_fluxes_of_point(double weight, const grids::FieldSet& z, const PotentialSlopes& slopes, Fluxes& sum);
  void add_fluxes_of_level(double weight);
  template <typename Use>
  void for_each_block_of_nodes(Use&& use);

  LawTables tables_;
  CellBlocks blocks_;
  NodeDerivative derivative_;
  StepPoints points_;
  PlacedCoordinates coordinates_;
  std::vector<Workspace> workspaces_;
  std::vector<int> differentiated_;           ///< fields, the rows of every Λ₊
  std::vector<grids::FieldSet> derivatives_;  ///< [axis], as differentiated_
  std::vector<grids::FieldSet> following_;    ///< [axis], all fields: z⁺, with one-sided differences alone
  grids::FieldSet known_;                     ///< the level whose densities are known, and perhaps fluxes
  PotentialSlopes known_slopes_;
  bool densities_are_known_ = false, fluxes_are_known_ = false;
  grids::FieldSet density_, sum_;  ///< of each law
  Fluxes at_level_, of_step_;
};

NodeLaws::NodeLaws(LawTables tables, Collocation collocation, std::shared_ptr<StageSource> stages)
    : tables_(std::move(tables)),
      blocks_(tables_.grid),
      derivative_(tables_.grid, collocation),
      points_(tables_.system, tables_.grid, std::move(stages)),
      known_(tables_.d, tables_.grid.size()),
      density_(static_cast<int>(tables_.names.size()), tables_.grid.size()) {
  find_differentiated();
  const auto axes = static_cast<std::size_t>(tables_.grid.dimensions());
  derivatives_.assign(axes, grids::FieldSet(static_cast<int>(differentiated_.size()), tables_.grid.size()));
  if (derivative_.one_sided()) {
    following_.assign(axes, known_);
  }
  if (!tables_.system.coordinates().empty()) {
    coordinates_ = PlacedCoordinates(tables_.system, tables_.grid, Within::node);
  }
}

void NodeLaws::find_differentiated() {
  std::vector<bool> in_fluxes;
  for (int f = 0; f < tables_.d; ++f) {
    const auto is_row = [f](const MatrixTerms& terms) {
      return std::ranges::any_of(terms, [f](const MatrixTerm& term) { return term.row == f; });
    };
    const bool is_differentiated = std::ranges::any_of(tables_.plus, is_row);
    if (is_differentiated) {
      differentiated_.push_back(f);
    }
    in_fluxes.push_back(is_differentiated);  // in time as well: the flux of momentum along x has z_tᵀM₊z
  }
  points_.ask_rates_of(in_fluxes);
}

void NodeLaws::prepare_workspaces() {
  const auto fields = static_cast<std::size_t>(tables_.d);
  while (workspaces_.size() < static_cast<std::size_t>(grids::thread_count())) {
    Workspace& work = workspaces_.emplace_back();
    const std::size_t coordinates = tables_.system.coordinates().size();
    work.memory = grids::Buffer((2 + differentiated_.size() + tables_.names.size() + coordinates) * CellBlocks::most);
    double* next = work.memory.data();
    const auto take = [&next] { return std::exchange(next, next + CellBlocks::most); };
    std::fill_n(next, CellBlocks::most, 0.0);
    work.zero = take();
    work.S_values = take();
    std::ranges::generate_n(std::back_inserter(work.sloped), std::ssize(differentiated_), take);
    std::ranges::generate_n(std::back_inserter(work.currents), std::ssize(tables_.names), take);
    std::ranges::generate_n(std::back_inserter(work.sources), static_cast<std::ptrdiff_t>(coordinates), take);
    work.inputs.resize(tables_.system.variables().size());
    work.partner.resize(fields);
    work.derivatives.resize(fields);
    work.S = formula::BatchEvaluator(tables_.system.value_code());
    if (coordinates > 0) {
      work.source = formula::BatchEvaluator(tables_.system.source_code());
    }
  }
}

/// Calls use(workspace, line, begin, count, offset) for every block of nodes, in parallel.
template <typename Use>
void NodeLaws::for_each_block_of_nodes(Use&& use) {
  prepare_workspaces();
  grids::for_each_block(blocks_.count(), blocks_at_once, [&](std::size_t first, std::size_t last, std::size_t thread) {
    for (std::size_t block = first; block < last; ++block) {
      const std::size_t line = block / blocks_.per_line, begin = block % blocks_.per_line * CellBlocks::most;
      use(workspaces_[thread], line, begin, std::min(CellBlocks::most, blocks_.line - begin),
          line * blocks_.line + begin);
    }
  });
}

void NodeLaws::differentiate(const grids::FieldSet& values) {
  std::array<const double*, MultisymplecticSystem::most_fields> in{};
  for (std::size_t i = 0; i < differentiated_.size(); ++i) {
    in[i] = values.field(differentiated_[i]).data();
  }
  for (std::size_t a = 0; a < derivatives_.size(); ++a) {
    derivative_(static_cast<int>(a), std::span(in).first(differentiated_.size()), derivatives_[a].pointers());
  }
  for (std::size_t a = 0; a < following_.size(); ++a) {
    for (int f = 0; f < tables_.d; ++f) {
      derivative_.next(static_cast<int>(a), values.field(f).data(), following_[a].field(f).data());
    }
  }
}

/// The block's z, derivatives and S; without rates, at a level: fields at midpoints are not there, nor in the
/// densities.
void NodeLaws::point_at(Workspace& work, const grids::FieldSet& z, const grids::FieldSet* rate,
                        const PotentialSlopes& slopes, std::size_t line, std::size_t begin, std::size_t count) const {
  const std::size_t offset = line * blocks_.line + begin;
  for (int f = 0; f < tables_.d; ++f) {
    const auto i = static_cast<std::size_t>(f);
    const bool absent = rate == nullptr && tables_.system.structure().at_midpoints(f);
    work.inputs[i] = absent ? work.zero : z.field(f).data() + offset;
    work.derivatives[i][in_time] = rate == nullptr ? nullptr : rate->field(f).data() + offset;
  }
  for (std::size_t r = 0; r < differentiated_.size(); ++r) {
    const int f = differentiated_[r];
    const bool absent = rate == nullptr && tables_.system.structure().at_midpoints(f);
    for (std::size_t a = 0; a < derivatives_.size(); ++a) {
      const double* along = absent ? work.zero : derivatives_[a].field(static_cast<int>(r)).data() + offset;
      if (const double slope = a == 0 && !absent ? slopes.at(f, line) : 0.0; slope != 0.0) {
        std::transform(along, along + count, work.sloped[r], [slope](double value) { return value + slope; });
        along = work.sloped[r];
      }
      work.derivatives[static_cast<std::size_t>(f)][1 + a] = along;
    }
  }
  coordinates_.put(offset, std::span(work.inputs).subspan(static_cast<std::size_t>(tables_.d)));
  double* const out[] = {work.S_values};
  work.S(count, work.inputs, out);
}

/// J_t of the level into density_; with fluxes, if levels are points of the quadrature, these into at_level_.
void NodeLaws::take_level(const LatticeLevel& level, bool with_fluxes) {
  bool is_known = densities_are_known_ && same_bits(std::as_const(known_).all(), level.fields.all()) &&
                  known_slopes_.of_field == level.slopes.of_field;
  if (points_.stages() != nullptr || !derivative_.one_sided()) {  // which all ranks of a lattice find together
    is_known = grids::agreed_by_all(tables_.grid, is_known);
  }
  with_fluxes = with_fluxes && points_.end_weight() != 0.0;
  if (is_known && (fluxes_are_known_ || !with_fluxes)) {
    return;
  }
  differentiate(level.fields);
  for_each_block_of_nodes(
      [&](Workspace& work, std::size_t line, std::size_t begin, std::size_t count, std::size_t offset) {
        point_at(work, level.fields, nullptr, level.slopes, line, begin, count);
        tables_.currents(in_time, count,
                         {.z = std::span(work.inputs).first(static_cast<std::size_t>(tables_.d)),
                          .derivatives = work.derivatives,
                          .S = work.S_values,
                          .partner = {}},
                         work.currents);
        for (int l = 0; l < density_.fields(); ++l) {
          std::copy_n(work.currents[static_cast<std::size_t>(l)], count, density_.field(l).data() + offset);
        }
      });
  if (with_fluxes) {
    points_.take_rates(level);
    prepare(at_level_);
    add_fluxes_of_point(1.0, level.fields, level.slopes, at_level_);
  }
  known_.copy_from(level.fields);
  known_slopes_ = level.slopes;
  densities_are_known_ = true;
  fluxes_are_known_ = with_fluxes;
}

void NodeLaws::prepare(Fluxes& fluxes) {
  if (fluxes.along.empty()) {
    fluxes.along.assign(derivatives_.size(), density_);
    fluxes.sources = grids::FieldSet(static_cast<int>(tables_.system.coordinates().size()), density_.size());
  }
  for (grids::FieldSet& flux : fluxes.along) {
    flux.fill(0.0);
  }
  fluxes.sources.fill(0.0);
}

/// sum += weight times those of z, whose derivatives are made, with the rates of points_.
void NodeLaws::add_fluxes_of_point(double weight, const grids::FieldSet& z, const PotentialSlopes& slopes,
                                   Fluxes& sum) {
  for_each_block_of_nodes(
      [&](Workspace& work, std::size_t line, std::size_t begin, std::size_t count, std::size_t offset) {
        point_at(work, z, &points_.rate(), slopes, line, begin, count);
        const auto add = [&](const double* from, double* to) {
          for (std::size_t c = 0; c < count; ++c) {
            to[offset + c] += weight * from[c];
          }
        };
        for (std::size_t a = 0; a < sum.along.size(); ++a) {
          for (std::size_t f = 0; f < work.partner.size() && !following_.empty(); ++f) {
            work.partner[f] = std::as_const(following_[a]).field(static_cast<int>(f)).data() + offset;
          }
          tables_.currents(static_cast<int>(1 + a), count,
                           {.z = std::span(work.inputs).first(static_cast<std::size_t>(tables_.d)),
                            .derivatives = work.derivatives,
                            .S = work.S_values,
                            .partner = std::span(work.partner).first(following_.empty() ? 0 : work.partner.size())},
                           work.currents);
          for (std::size_t l = 0; l < work.currents.size(); ++l) {
            add(work.currents[l], sum.along[a].pointers()[l]);
          }
        }
        if (!work.sources.empty()) {
          work.source(count, work.inputs, work.sources);
          for (std::size_t c = 0; c < work.sources.size(); ++c) {
            add(work.sources[c], sum.sources.pointers()[c]);
          }
        }
      });
}

/// of_step_ += weight times the level's.
void NodeLaws::add_fluxes_of_level(double weight) {
  if (weight == 0.0) {
    return;
  }
  for (std::size_t a = 0; a < of_step_.along.size(); ++a) {
    grids::add(weight, std::as_const(at_level_.along[a]).all(), of_step_.along[a].all());
  }
  grids::add(weight, std::as_const(at_level_.sources).all(), of_step_.sources.all());
}

std::vector<Spread> NodeLaws::residuals(const LatticeLevel& before, const LatticeLevel& after, double h,
                                        std::span<double* const> residuals) {
  if (sum_.fields() == 0) {
    sum_ = density_;
  }
  prepare(of_step_);
  take_level(before, true);
  sum_.copy_from(density_);
  add_fluxes_of_level(points_.end_weight());
  points_.for_each(before, after, h, [&](double weight) {
    differentiate(points_.z());
    add_fluxes_of_point(weight, points_.z(), after.slopes, of_step_);
  });
  take_level(after, true);
  add_fluxes_of_level(points_.end_weight());
  for (std::size_t a = 0; a < of_step_.along.size(); ++a) {
    grids::FieldSet& flux = of_step_.along[a];
    derivative_(static_cast<int>(a), std::as_const(flux).pointers(), flux.pointers());
  }
  grids::difference_quotient(std::as_const(density_).all(), sum_.all(), h, sum_.all());
  for (const grids::FieldSet& flux : of_step_.along) {
    grids::add(1.0, flux.all(), sum_.all());
  }
  for (std::size_t c = 0; c < tables_.system.coordinates().size(); ++c) {
    const auto source = std::as_const(of_step_.sources).field(static_cast<int>(c));
    const auto sum = sum_.field(1 + tables_.system.coordinates()[c]);
    std::ranges::transform(sum, source, sum.begin(), std::minus<>());
  }
  return write_residuals(sum_, residuals);
}

std::vector<double> NodeLaws::totals(const LatticeLevel& level) {
  take_level(level, false);
  return grids::integrals(tables_.grid, density_);
}

}  // namespace

std::unique_ptr<LawEvaluator> make_node_laws(LawTables tables, Collocation collocation,
                                             std::shared_ptr<StageSource> stages) {
  const auto make = [collocation](LawTables of, std::shared_ptr<StageSource> over) -> std::unique_ptr<LawEvaluator> {
    return std::make_unique<NodeLaws>(std::move(of), collocation, std::move(over));
  };
  if (stages != nullptr || collocation != Collocation::corners) {
    return make(std::move(tables), std::move(stages));
  }
  return make_compact_laws(std::move(tables), collocation,
                           [make](LawTables of) { return make(std::move(of), nullptr); });
}

}  // namespace rubato
