#include <rubato/problem/lattice_problem.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <exception>
#include <iterator>
#include <map>
#include <numeric>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/grids/fourier.hpp>
#include <rubato/grids/slab.hpp>
#include <rubato/grids/whole.hpp>
#include <rubato/pde/first_step.hpp>
#include <rubato/pde/mean_conditions.hpp>
#include <rubato/problem/energy_terms.hpp>
#include <rubato/problem/initial_record.hpp>
#include <rubato/problem/reader.hpp>
#include <rubato/problem/scheme_options.hpp>

namespace rubato {

namespace {

/// The field in "dx(dy(f))", or the name itself.
std::string differentiated_field(const std::string& name) {
  const std::size_t open = name.rfind('(');
  return open == std::string::npos ? name : name.substr(open + 1, name.find(')') - open - 1);
}

std::vector<std::string> fields_in(const formula::Graph& graph, std::span<const formula::Expression> expressions) {
  std::vector<std::string> fields;
  for (const formula::Expression expression : expressions) {
    for (const std::size_t variable : formula::variables_of(expression)) {
      fields.push_back(differentiated_field(graph.variable_name(variable)));
    }
  }
  return fields;
}

std::string place_of(const grids::Grid& grid, std::size_t node) {
  const auto place = grid.place(node);
  std::vector<std::string> coordinates;
  for (int a = 0; a < grid.dimensions(); ++a) {
    coordinates.push_back(
        fmt::format("{} = {:.6g}", grid.axis(a).name, grid.axis(a).node(place[static_cast<std::size_t>(a)])));
  }
  return fmt::format("{}", fmt::join(coordinates, ", "));
}

/// Evaluates the initial fields one by one.
class InitialValues {
public:
  /// \param ranks those that evaluate them together, each in its part or all of them; null for one process
  InitialValues(const Problem& problem, const grids::Grid& grid, const grids::Slab* ranks)
      : problem_(problem),
        pde_(*problem.multisymplectic()),
        grid_(grid),
        ranks_(ranks),
        values_(pde_.fields.size()),
        jumps_(make_jumps(problem)) {}

  InitialFields take() {
    if (pde_.initial_record) {
      const InitialRecord& source = *pde_.initial_record;
      std::vector<std::vector<double>> fields =
          ranks_ == nullptr ? read_initial_fields(source, grid_, pde_.fields, jumps_) : read_by_rank_0(source);
      for (std::size_t i = 0; i < fields.size(); ++i) {
        const auto field = std::ranges::find(pde_.fields, source.take[i]) - pde_.fields.begin();
        take_whole(static_cast<std::size_t>(field), std::move(fields[i]));
      }
    }
    // The reader has made sure that no field depends on itself: every round settles at least one.
    for (bool again = true; again;) {
      again = false;
      for (std::size_t f = 0; f < values_.size(); ++f) {
        again = (pde_.initial[f] && !values_[f] && !whole_.contains(static_cast<int>(f)) && evaluate(f)) || again;
      }
    }
    require_partners();
    for (const InitialSlope& slope : pde_.slopes) {
      const auto field = std::ranges::find(pde_.fields, slope.name);
      if (field != pde_.fields.end()) {  // u_t is a field, too: that of the potential's rate
        take_waves(*values_[static_cast<std::size_t>(field - pde_.fields.begin())], false);
      }
    }
    return std::move(values_);
  }

private:
  /// \return whether all that the formula needs is known, so that the field is now, too
  bool evaluate(std::size_t f) {
    const FormulaText& text = *pde_.initial[f];
    auto graph = std::make_shared<formula::Graph>();
    // The formula comes last, after all that is differentiated in it, each of those that came before.
    std::vector<formula::Expression> parts;
    parts.push_back(build_initial(text, *graph, pde_, problem_.parameters, parts));
    std::vector<const double*> known(values_.size(), nullptr);
    for (std::size_t i = 0; i < values_.size(); ++i) {
      known[i] = values_[i] ? values_[i]->data() : nullptr;
    }
    parts = jumps_.seen(parts, *graph, pde_.fields);
    for (const std::string& name : fields_in(*graph, parts)) {
      const auto needed = static_cast<std::size_t>(std::ranges::find(pde_.fields, name) - pde_.fields.begin());
      if (needed < values_.size() && known[needed] == nullptr) {
        return false;
      }
    }
    std::vector<std::string> names = pde_.fields;
    std::vector<std::vector<double>> results(parts.size());
    for (std::size_t i = 0; i < parts.size(); ++i) {
      results[i] = std::move(NodeFormula(graph, {parts[i]}, names, grid_)(known, pde_.start).front());
      if (const auto wrong = grids::first_undefined(results[i])) {
        const auto [node, value] = *wrong;
        const std::string_view what = i + 1 < parts.size() ? "what is differentiated in the initial " : "the initial ";
        throw ProblemError(text.location, fmt::format("{}{} is {} at {}", what, pde_.fields[f], value,
                                                      place_of(grids::whole_of(grid_), node)));
      }
      refresh(results[i]);
      names.push_back(expression_name(i));
      known.push_back(results[i].data());
    }
    if (std::ranges::find(pde_.slopes, pde_.fields[f], &InitialSlope::field) != pde_.slopes.end()) {
      integrate(results.back(), f);
    }
    take_whole(f, std::move(results.back()));
    return true;
  }

  /// Takes z_f, and finds z~ of the fields that turn with it as soon as all of them are there.
  void take_whole(std::size_t f, std::vector<double> values) {
    const std::vector<int> partners = jumps_.partners(static_cast<int>(f));
    whole_[static_cast<int>(f)] = std::move(values);
    if (!std::ranges::all_of(partners, [&](int partner) { return whole_.contains(partner); })) {
      return;
    }
    std::vector<double> all(jumps_.has(static_cast<int>(f)) ? values_.size() * grid_.size() : 0);
    for (const int partner : partners) {
      std::vector<double>& field = whole_.at(partner);
      if (!all.empty()) {
        std::ranges::copy(field, all.begin() + static_cast<std::ptrdiff_t>(grid_.size()) * partner);
      }
    }
    if (!all.empty()) {
      WholeFields(jumps_, grid_, static_cast<int>(values_.size())).remove(all);
    }
    for (const int partner : partners) {
      std::vector<double> field = std::move(whole_.at(partner));
      if (!all.empty()) {
        const auto first = all.begin() + static_cast<std::ptrdiff_t>(grid_.size()) * partner;
        std::copy_n(first, grid_.size(), field.begin());
      }
      values_[static_cast<std::size_t>(partner)] = std::move(field);
      whole_.erase(partner);
    }
  }

  /// A field that turns with others is given with them, and by no derivative of itself.
  void require_partners() const {
    for (const auto& [f, values] : whole_) {
      const auto& text = pde_.initial[static_cast<std::size_t>(f)];
      std::vector<std::string> partners;
      for (const int partner : jumps_.partners(f)) {
        if (!values_[static_cast<std::size_t>(partner)] && !whole_.contains(partner)) {
          partners.push_back(pde_.fields[static_cast<std::size_t>(partner)]);
        }
      }
      throw ProblemError(text ? text->location : pde_.initial_location,
                         fmt::format("{} turns from one period to the next, and so needs an initial {}, as a formula "
                                     "without derivatives of {}",
                                     pde_.fields[static_cast<std::size_t>(f)], fmt::join(partners, ", "),
                                     pde_.fields[static_cast<std::size_t>(f)]));
    }
  }

  /// Puts the antiderivative by x of mean 0 in the place of a slope.
  void integrate(std::vector<double>& values, std::size_t f) const {
    constexpr double truncation = 1e-3;  // of data that close on the period but for their tails
    if (take_waves(values, true) > truncation) {
      const InitialSlope& slope = *std::ranges::find(pde_.slopes, pde_.fields[f], &InitialSlope::field);
      throw ProblemError(pde_.initial[f]->location,
                         fmt::format("the mean of the initial {0} along x is not 0: no periodic {1} has {0} as its "
                                     "derivative by x, and the mean of the field cannot change",
                                     slope.name, slope.field));
    }
  }

  /// Keeps the waves of a slope that are derivatives by x of a grid function, or puts that function in its place.
  /// \return the largest of the waves without one that belong to a mean along x, over the largest of all
  double take_waves(std::vector<double>& values, bool integrated) const {
    grids::Fourier waves(grid_, 1);
    waves.forward(std::array<const double*, 1>{values.data()});
    double mean = 0.0, size = 0.0;
    for (std::size_t mode = 0; mode < waves.modes(); ++mode) {
      std::complex<double>& value = waves.at(0, mode);
      const std::complex<double> symbol = grids::derivative_symbol(waves.wave(mode)[0], grid_.axis(0));
      size = std::max(size, std::abs(value));
      mean = std::max(mean, waves.wave(mode)[0] == 0 ? std::abs(value) : 0.0);
      value = symbol == 0.0 ? 0.0 : integrated ? value / symbol : value;
    }
    waves.inverse(std::array<double*, 1>{values.data()});
    return size > 0.0 ? mean / size : 0.0;
  }

  /// The same at ranks, of which the first one alone reads, one field after the other.
  [[nodiscard]] std::vector<std::vector<double>> read_by_rank_0(const InitialRecord& source) const {
    const bool in_parts = grids::Slab::of(grid_) != nullptr;
    const grids::Grid& whole = in_parts ? ranks_->whole() : grid_;
    std::vector<std::vector<double>> fields;
    for (const std::string& name : source.take) {
      InitialRecord one = source;
      one.take = {name};
      for (const int partner : jumps_.partners(number_of(name))) {  // without which other cells cannot be filled
        const std::string& other = pde_.fields[static_cast<std::size_t>(partner)];
        if (other != name && std::ranges::find(source.take, other) != source.take.end()) {
          one.take.push_back(other);
        }
      }
      std::vector<double> read;
      std::exception_ptr thrown;
      if (ranks_->leads()) {
        try {
          const grids::Slab::Shared alone(nullptr);
          read = std::move(read_initial_fields(one, whole, pde_.fields, jumps_).front());
        } catch (...) {
          thrown = std::current_exception();
        }
      }
      double failed = thrown ? 1.0 : 0.0;
      ranks_->broadcast(std::span(&failed, 1));
      if (thrown) {
        std::rethrow_exception(thrown);
      }
      if (failed != 0.0) {
        throw ProblemError(source.location, "rank 0 cannot read the initial data");
      }
      if (in_parts) {
        std::vector<double>& part = fields.emplace_back(grid_.size());
        auto next = read.begin();
        ranks_->scatter(part, [&next](std::span<double> planes) {
          std::copy_n(next, planes.size(), planes.begin());
          next += std::ssize(planes);
        });
        refresh(part);
      } else {
        read.resize(whole.size());
        ranks_->broadcast(read);
        fields.push_back(std::move(read));
      }
    }
    return fields;
  }

  [[nodiscard]] int number_of(const std::string& field) const {
    return static_cast<int>(std::ranges::find(pde_.fields, field) - pde_.fields.begin());
  }

  /// What others own of the values, which derivatives across planes, or reading, leave out.
  void refresh(std::vector<double>& values) const {
    if (grids::Slab::of(grid_) != nullptr) {
      grids::FieldSet field(1, values.size());
      std::ranges::copy(values, field.field(0).begin());
      grids::refresh_ghosts(field);
      std::ranges::copy(field.field(0), values.begin());
    }
  }

  const Problem& problem_;
  const MultisymplecticProblem& pde_;
  const grids::Grid& grid_;
  const grids::Slab* ranks_;
  InitialFields values_;                           ///< periodic, as Jumps makes them
  std::map<int, std::vector<double>> whole_ = {};  ///< z of fields that wait for those that turn with them
  Jumps jumps_;
};

/// LatticeMethod::begins_in_parts() of what is given.
bool begins_in_parts(const Problem& problem, const MultisymplecticSystem& system) {
  const MultisymplecticProblem& pde = *problem.multisymplectic();
  if (!pde.slopes.empty()) {
    return false;  // slopes are integrated along whole lines
  }
  std::vector<bool> given;
  for (std::size_t f = 0; f < pde.fields.size(); ++f) {
    const bool is_read = pde.initial_record &&
                         std::ranges::find(pde.initial_record->take, pde.fields[f]) != pde.initial_record->take.end();
    given.push_back(is_read || pde.initial[f].has_value());
  }
  return make_method(problem)->begins_in_parts(system, given);
}

/// at_location() for what is made of [initial]: what is wrong with one field is wrong at its formula.
template <typename Make>
auto at_initial(const Problem& problem, const Make& make) {
  const MultisymplecticProblem& pde = *problem.multisymplectic();
  return at_location(pde.initial_location, [&] {
    try {
      return make();
    } catch (const StepPotentialError& error) {
      throw ProblemError(problem.scheme.potential_location, error.what());
    } catch (const SchemeRefusal& error) {
      throw ProblemError(problem.scheme.lagrangian_location, error.what());
    } catch (const InitialFieldError& error) {
      const auto& text = pde.initial[static_cast<std::size_t>(error.field())];
      throw ProblemError(text ? text->location : pde.initial_location, error.what());
    }
  });
}

}  // namespace

Eigen::MatrixXd dense(const Matrix& matrix) {
  using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const auto size = static_cast<Eigen::Index>(matrix.size);
  return Eigen::Map<const Rows>(matrix.entries.data(), size, size);
}

MultisymplecticSystem make_laboratory_system(const Problem& problem) {
  const MultisymplecticProblem& pde = *problem.multisymplectic();
  auto graph = std::make_shared<formula::Graph>();
  formula::Expression S = problem.build(pde.S, *graph, quantity_names(pde));
  if (pde.driven) {
    const formula::Expression t = graph->variable("t"), time = graph->variable(clock_name);
    S = formula::substitute(std::array{S}, *graph, std::array{t}, std::array{time}).front() +
        graph->variable(work_name);
  }
  std::vector<Eigen::MatrixXd> K;
  for (const Matrix& matrix : pde.K) {
    K.push_back(dense(matrix));
  }
  return at_location(pde.M.location,
                     [&] { return MultisymplecticSystem(graph, pde.fields, dense(pde.M), std::move(K), S); });
}

MultisymplecticSystem make_system_of_fields(const Problem& problem) {
  const MultisymplecticSystem laboratory = make_laboratory_system(problem);
  const std::optional<MovingFrame> frame = make_frame(problem);
  return frame ? at_location(problem.scheme.frame->location, [&] { return frame->seen(laboratory); }) : laboratory;
}

MultisymplecticSystem make_system(const Problem& problem) {
  return make_method(problem)->seen(make_jumps(problem).seen(make_system_of_fields(problem)));
}

std::optional<MovingFrame> make_frame(const Problem& problem) {
  if (!problem.scheme.frame) {
    return std::nullopt;
  }
  const StatedFrame& stated = *problem.scheme.frame;
  const MultisymplecticProblem& pde = *problem.multisymplectic();
  MovingFrame frame{.velocity = stated.velocity.value_or(std::vector<double>(pde.axes.size(), 0.0)),
                    .rate = stated.rate.value_or(0.0),
                    .start = pde.start,
                    .jumps = jumps_of(pde)};
  if (!stated.symmetry.empty()) {
    frame.B = dense(std::ranges::find(pde.symmetries, stated.symmetry, &StatedSymmetry::name)->B);
  }
  return frame;
}

grids::Grid make_grid(const Problem& problem) {
  const MultisymplecticProblem& pde = *problem.multisymplectic();
  return at_location(pde.axes.front().location, [&] {
    std::vector<grids::Axis> axes;
    for (const GridAxis& axis : pde.axes) {
      axes.push_back({.name = axis.name,
                      .from = axis.from,
                      .to = axis.to,
                      .cells = static_cast<std::size_t>(axis.nodes()),
                      .left = axis.left,
                      .right = axis.right});
    }
    return grids::Grid(std::move(axes));
  });
}

InitialFields make_initial_fields(const Problem& problem, const grids::Grid& grid) {
  return InitialValues(problem, grid, grids::Slab::of(grid)).take();
}

namespace {

/// By this rank alone, but for what rank 0 reads.
InitialFields whole_initial_fields(const Problem& problem, const grids::Grid& grid) {
  const grids::Slab* const ranks = grids::Slab::present();
  const grids::Slab::Shared alone(nullptr);
  return InitialValues(problem, grid, ranks).take();
}

}  // namespace

namespace {

/// [initial.next], evaluated as the first level is; null without it. \throws ProblemError if it has a field that L
/// leaves out
std::shared_ptr<const SecondLevel> make_second_level(const Problem& problem) {
  const MultisymplecticProblem& pde = *problem.multisymplectic();
  if (!pde.next) {
    return nullptr;
  }
  for (std::size_t f = 0; f < pde.next->fields.size(); ++f) {
    const auto& given = pde.next->fields[f];
    if (given && problem.scheme.density != nullptr && !problem.scheme.density->names(static_cast<int>(f))) {
      throw ProblemError(given->location,
                         fmt::format("L leaves {0} out, and steps give {0} from the fields that L names: leave it out "
                                     "of [initial.next], too",
                                     pde.fields[f]));
    }
  }
  Problem later = problem;
  auto& its = std::get<MultisymplecticProblem>(later.system);
  its.initial = pde.next->fields;
  its.start = pde.next->t;
  its.initial_record.reset();
  return std::make_shared<SecondLevel>(
      SecondLevel{whole_initial_fields(later, make_grid(problem)), pde.next->t - pde.start});
}

}  // namespace

LatticeOptions make_lattice_options(const Problem& problem, const MultisymplecticSystem& system) {
  const MultisymplecticProblem& pde = *problem.multisymplectic();
  const Scheme& scheme = problem.scheme;
  LatticeOptions options{.lagrangian = scheme.method,
                         .stages = scheme.stages.value_or(1),
                         .space_stages = scheme.space_stages,
                         .composition = scheme.composition,
                         .space = scheme.space,
                         .start = pde.start};
  options.density = scheme.density;
  options.sponge = make_sponge(problem);
  options.drives = make_wall_drives(problem);
  options.next = make_second_level(problem);
  set_run_options(scheme, options);
  for (const StatedSymmetry& symmetry : pde.symmetries) {
    options.symmetries.push_back({symmetry.name, dense(symmetry.B)});
    at_location(symmetry.B.location, [&] { check_symmetry(system, options.symmetries.back()); });
  }
  return options;
}

namespace {

/// Whether a run looks at the level before: for laws, what happens between levels, errors, what rests in a moving
/// frame, and rows of states.
bool reads_previous(const Problem& problem) {
  const Output& output = problem.output;
  return !problem.laws.none() || !problem.multisymplectic()->exact.empty() || !problem.events.empty() || output.any() ||
         problem.scheme.frame.has_value() || (output.states_every() > 1 && !problem.stores_evolving_alone());
}

/// Calls make(grid, initial, options) with what a lattice begins with, of all of it or of the part of a slab.
template <typename Make>
auto with_initial_fields(const Problem& problem, const MultisymplecticSystem& system, const Make& make) {
  LatticeOptions options = make_lattice_options(problem, system);
  options.keeps_previous = reads_previous(problem);
  options.slab = grids::Slab::present();
  const grids::Grid grid = make_grid(problem);
  options.initial_is_part = options.slab != nullptr && begins_in_parts(problem, system);
  const InitialFields initial = options.initial_is_part ? make_initial_fields(problem, options.slab->grid())
                                                        : whole_initial_fields(problem, grid);
  return at_initial(problem, [&] { return make(grid, initial, options); });
}

}  // namespace

namespace {

/// Times that no period has in common.
std::vector<double> times_between(double start, double end) {
  constexpr double golden = 0.6180339887498949;
  std::vector<double> times;
  for (int i = 1; i <= 8; ++i) {
    times.push_back(std::lerp(start, end, std::fmod(golden * i, 1.0)));
  }
  return times;
}

}  // namespace

LatticeIntegrator make_lattice(const Problem& problem) {
  const MultisymplecticSystem system = make_system(problem);
  return with_initial_fields(
      problem, system, [&](const grids::Grid& grid, const InitialFields& initial, LatticeOptions& options) {
        if (const auto& scheme = problem.scheme; !scheme.step) {
          options.step = choose_first_step(system, grid, initial, options, *scheme.energy_tolerance);
        }
        if (const auto& pde = *problem.multisymplectic(); pde.driven) {
          at_location(pde.S.location,
                      [&] { MeanConditions(system).check_forces(grid, times_between(options.start, options.until)); });
        }
        return LatticeIntegrator(system, grid, initial, options);
      });
}

std::unique_ptr<LatticeMethod> make_method(const Problem& problem) {
  return with_sponge(make_bare_method(problem), make_sponge(problem));
}

std::unique_ptr<LatticeMethod> make_bare_method(const Problem& problem) {
  LatticeMethodChoice choice = method_choice(problem.scheme);
  choice.next = make_second_level(problem);
  choice.drives = make_wall_drives(problem);
  return make_lattice_method(choice, make_grid(problem));
}

LatticeLevel make_initial_level(const Problem& problem, const MultisymplecticSystem& system, const grids::Grid& grid) {
  if (grids::Slab::present() != nullptr) {
    return with_initial_fields(
        problem, system, [&](const grids::Grid& whole, const InitialFields& initial, LatticeOptions& options) {
          options.step = problem.scheme.step.value_or(options.until - options.start);  // none is taken
          return LatticeLevel(LatticeIntegrator(system, whole, initial, options).level());
        });
  }
  const InitialFields initial = make_initial_fields(problem, grid);
  return at_initial(problem, [&] { return make_method(problem)->first_level(system, grid, initial).level; });
}

namespace {

/// x + c (t - t_0) for x.
std::vector<formula::Expression> at_moving_nodes(const MovingFrame& frame, const grids::Grid& grid,
                                                 formula::Graph& graph,
                                                 const std::vector<formula::Expression>& outputs) {
  std::vector<formula::Expression> coordinates, moving;
  for (int a = 0; a < grid.dimensions(); ++a) {
    coordinates.push_back(graph.variable(grid.axis(a).name));
    moving.push_back(coordinates.back() +
                     frame.velocity[static_cast<std::size_t>(a)] * (graph.variable("t") - frame.start));
  }
  return formula::substitute(outputs, graph, coordinates, moving);
}

}  // namespace

bool is_stored_alone(const MultisymplecticSystem& system, int field, const std::vector<std::string>& exact) {
  return std::ranges::any_of(mixed_fields(system.turns(), field), [&](int f) {  // which whole fields are made of
    const std::string& name = system.fields()[static_cast<std::size_t>(f)];
    return (!system.M().row(f).isZero(0.0) && !system.structure().at_midpoints(f)) ||
           std::ranges::find(exact, name) != exact.end();
  });
}

NodeTable::NodeTable(const Problem& problem, const std::vector<NamedFormula>& formulas,
                     const std::vector<std::string>& fields, const grids::Grid& grid, bool with_energy)
    : reads_fields_(!fields.empty()) {
  const Jumps jumps = make_jumps(problem);
  whole_ = WholeFields(jumps, grid, static_cast<int>(problem.multisymplectic()->fields.size()));
  std::vector<std::string> names = fields;
  std::ranges::copy(argument_names(*problem.multisymplectic()), std::back_inserter(names));
  auto graph = std::make_shared<formula::Graph>();
  std::vector<formula::Expression> outputs;
  for (const NamedFormula& formula : formulas) {
    names_.push_back(formula.name);
    outputs.push_back(problem.build(formula.formula, *graph, names, fields));
  }
  std::optional<MovingFrame> frame = make_frame(problem);
  if (frame && with_energy) {
    names_.emplace_back("laboratory_energy");
    formula::Expression energy = graph->constant(0.0);
    for (const auto& terms : energy_density_terms(make_laboratory_system(problem), grid, *graph)) {
      energy = std::accumulate(terms.begin(), terms.end(), energy);
    }
    outputs.push_back(energy);
  }
  if (outputs.empty()) {
    return;
  }
  if (frame) {
    if (!reads_fields_) {
      outputs = at_moving_nodes(*frame, grid, *graph, outputs);
    }
    laboratory_.emplace(std::move(*frame), grid);
  }
  if (reads_fields_) {
    outputs = jumps.seen(outputs, *graph, fields);
  } else {
    const MultisymplecticSystem system = make_system(problem);
    std::vector<int> of_formulas;
    std::ranges::transform(names_, std::back_inserter(of_formulas),
                           [&](const std::string& name) { return system.field(name); });
    NodalView nodal(system, grid, make_method(problem)->in_mirror().value_or(Collocation::cells));
    if (nodal.moves(of_formulas)) {
      nodal_.emplace(std::move(nodal));
    }
  }
  formula_.emplace(graph, std::move(outputs), fields, grid);
}

std::vector<std::vector<double>> NodeTable::at(const LatticeLevel& level, double t) {
  return formula_ ? (*formula_)(laboratory_ && reads_fields_ ? (*laboratory_)(level, t) : level, t)
                  : std::vector<std::vector<double>>();
}

std::vector<double> NodeTable::integrals(const LatticeLevel& level, double t) {
  return formula_ ? formula_->integrals(laboratory_ && reads_fields_ ? (*laboratory_)(level, t) : level, t)
                  : std::vector<double>();
}

NodeTable make_invariants(const Problem& problem, const MultisymplecticSystem& system, const grids::Grid& grid) {
  const MultisymplecticProblem& pde = *problem.multisymplectic();
  for (const NamedFormula& invariant : pde.invariants) {
    formula::Graph graph;
    const std::array density = {problem.build(invariant.formula, graph, quantity_names(pde), pde.fields)};
    for (const std::string& field : fields_in(graph, density)) {
      if (std::ranges::find(pde.fields, field) == pde.fields.end()) {
        continue;  // a coordinate, or the time
      }
      if (system.structure().at_midpoints(system.field(field))) {
        throw ProblemError(
            invariant.formula.location,
            fmt::format("{} exists in the middle of steps only, and invariants are taken at levels", field));
      }
    }
  }
  return {problem, pde.invariants, pde.fields, grid, !problem.laws.none()};
}

NodeTable make_exact(const Problem& problem, const MultisymplecticSystem& system, const grids::Grid& grid) {
  const MultisymplecticProblem& pde = *problem.multisymplectic();
  for (const NamedFormula& exact : pde.exact) {
    if (system.structure().at_midpoints(system.field(exact.name))) {
      throw ProblemError(
          exact.formula.location,
          fmt::format("{} exists in the middle of steps only, and errors are taken at levels", exact.name));
    }
  }
  return {problem, pde.exact, {}, grid};
}

std::vector<figures::Named<Spread>> lattice_errors(NodeTable& exact, const MultisymplecticSystem& system,
                                                   const LatticeLevel& level, double t) {
  std::vector<figures::Named<Spread>> errors;
  const std::vector<std::vector<double>> values = exact.at(level, t);
  const LatticeLevel& at_nodes = exact.at_nodes(level);
  std::optional<grids::FieldSet> turned;
  if (exact.frame() != nullptr && exact.frame()->phase(t) != 0.0) {
    turned = at_nodes.fields;
    exact.frame()->turn(t, *turned);
  }
  const grids::FieldSet& fields = turned ? *turned : at_nodes.fields;
  for (std::size_t i = 0; i < values.size(); ++i) {
    errors.push_back({exact.names()[i], {}});
    const int f = system.field(exact.names()[i]);
    const std::span<const double> field = exact.whole()(f, fields.all());
    std::vector<double> error(field.size());
    for (std::size_t node = 0; node < field.size(); ++node) {
      error[node] = std::abs(field[node] - values[i][node]);
    }
    const auto add = [&](std::span<const double> some) {
      for (const double value : some) {
        errors.back().value.add(value);
      }
    };
    if (const grids::Slab* const slab = grids::Slab::of(error.size())) {
      slab->gather(error, add);
    } else {
      add(error);
    }
  }
  return errors;
}

}  // namespace rubato
