#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/figures/text.hpp>
#include <rubato/formula/parse.hpp>
#include <rubato/problem/keys.hpp>
#include <rubato/problem/reader.hpp>

namespace rubato {
namespace {

const std::vector<std::string> all_axes(axis_letters.begin(), axis_letters.end());

/// Reads M, K.x or a symmetry's B: triples (row, column, value) or a full array.
class MatrixReader {
public:
  MatrixReader(const std::vector<std::string>& fields, const Parameters& parameters)
      : fields_(fields), parameters_(parameters) {}

  /// Each triple also gives the transposed entry its opposite; a full array has to be skew.
  [[nodiscard]] Matrix skew(const Value& value, const std::string& what) const {
    Matrix matrix = read(value, what, true);
    for (std::size_t i = 0; i < matrix.size; ++i) {
      for (std::size_t j = 0; j <= i; ++j) {
        if (matrix(i, j) != -matrix(j, i)) {
          throw ProblemError(value.location,
                             i == j ? fmt::format("{} is not skew: its diagonal entry [{}, {}] is {}, and has to be 0",
                                                  what, fields_[i], fields_[i], matrix(i, i))
                                    : fmt::format("{} is not skew: [{}, {}] is {} and [{}, {}] is {}", what, fields_[j],
                                                  fields_[i], matrix(j, i), fields_[i], fields_[j], matrix(i, j)));
        }
      }
    }
    return matrix;
  }

  [[nodiscard]] Matrix general(const Value& value, const std::string& what) const { return read(value, what, false); }

private:
  [[nodiscard]] std::optional<std::size_t> field(const std::string& name) const {
    const auto found = std::find(fields_.begin(), fields_.end(), name);
    return found == fields_.end() ? std::nullopt : std::optional(static_cast<std::size_t>(found - fields_.begin()));
  }

  /// Three items of which the first two are names of anything but a parameter: a row of numbers does not begin so.
  [[nodiscard]] bool is_triple(const Value& row) const {
    const auto* items = row.array();
    return items != nullptr && items->size() == 3 && is_label((*items)[0]) && is_label((*items)[1]);
  }

  [[nodiscard]] bool is_label(const Value& value) const {
    const std::string* text = value.string();
    return text != nullptr && is_identifier(*text) && !formula::is_reserved_name(*text) &&
           parameters_.find(*text) == nullptr;
  }

  [[nodiscard]] Matrix read(const Value& value, const std::string& what, bool skew) const {
    const auto& rows = read_array(value, what, "[row, column, value], or of the rows of the whole matrix");
    const std::size_t d = fields_.size();
    Matrix matrix{d, std::vector<double>(d * d, 0.0), value.location};
    const auto triples = static_cast<std::size_t>(
        std::count_if(rows.begin(), rows.end(), [this](const Value& row) { return is_triple(row); }));
    if (triples == rows.size()) {
      read_triples(rows, what, skew, matrix);
    } else if (triples > 0) {
      const auto odd = std::find_if(rows.begin(), rows.end(), [this](const Value& row) { return !is_triple(row); });
      throw ProblemError(odd->location, fmt::format("{} mixes [row, column, value] with something else; write every "
                                                    "entry so, or the full {}×{} array",
                                                    what, d, d));
    } else {
      read_rows(rows, what, matrix);
    }
    return matrix;
  }

  void read_triples(const Value::Array& triples, const std::string& what, bool skew, Matrix& matrix) const {
    std::vector<bool> given(matrix.size * matrix.size, false);
    for (const Value& triple : triples) {
      const auto& items = *triple.array();
      const std::size_t row = index(items[0], what), column = index(items[1], what);
      if (skew && row == column) {
        throw ProblemError(triple.location,
                           fmt::format("{}: [{}, {}] is on the diagonal, which is zero in a skew matrix", what,
                                       fields_[row], fields_[column]));
      }
      if (given[row * matrix.size + column]) {
        throw ProblemError(triple.location,
                           fmt::format("{}: [{}, {}] is given twice{}", what, fields_[row], fields_[column],
                                       skew ? " (a triple also sets the transposed entry, to the "
                                              "opposite)"
                                            : ""));
      }
      given[row * matrix.size + column] = true;
      matrix(row, column) = read_number(items[2], what, parameters_);
      if (skew) {
        given[column * matrix.size + row] = true;
        matrix.entries[column * matrix.size + row] = -matrix(row, column);  // transposed
      }
    }
  }

  [[nodiscard]] std::size_t index(const Value& label, const std::string& what) const {
    const auto found = field(*label.string());
    if (!found) {
      const auto nearest = formula::nearest_name(*label.string(), fields_);
      throw ProblemError(label.location,
                         fmt::format("{}: {} is not a field; {}", what, *label.string(),
                                     nearest ? fmt::format("did you mean {}?", *nearest)
                                             : fmt::format("the fields are {}", fmt::join(fields_, ", "))));
    }
    return *found;
  }

  void read_rows(const Value::Array& rows, const std::string& what, Matrix& matrix) const {
    const auto refuse = [&](const Location& location, std::size_t count, std::string_view of) {
      throw ProblemError(location, fmt::format("{}: expected {} {} (one per field), got {}; or write triples "
                                               "[\"row\", \"column\", value]",
                                               what, matrix.size, of, count));
    };
    if (rows.size() != matrix.size) {
      refuse(matrix.location, rows.size(), "rows");
    }
    for (std::size_t i = 0; i < matrix.size; ++i) {
      const auto& items = read_array(rows[i], what, "numbers");
      if (items.size() != matrix.size) {
        refuse(rows[i].location, items.size(), "numbers in this row");
      }
      for (std::size_t j = 0; j < matrix.size; ++j) {
        matrix(i, j) = read_number(items[j], what, parameters_);
      }
    }
  }

  const std::vector<std::string>& fields_;
  const Parameters& parameters_;
};

std::vector<GridAxis> read_grid(Section& root, const Section& owner, std::span<const std::string> fields,
                                const Parameters& parameters) {
  auto grid = root.take_section("grid");
  if (!grid) {
    throw ProblemError(owner.location(),
                       "there is no [grid]: give one, such as x = { from = -20, to = 20, cells = 401 }");
  }
  std::vector<GridAxis> axes;
  std::optional<std::string> gap;
  for (const std::string& name : all_axes) {
    auto section = grid->take_section(name);
    if (!section) {
      gap = gap.value_or(name);
      continue;
    }
    if (gap) {
      throw ProblemError(section->location(), fmt::format("[grid] has {} and no {}; name its directions x, y, z, in "
                                                          "this order",
                                                          name, *gap));
    }
    GridAxis axis;
    axis.name = name;
    axis.location = section->location();
    axis.from = read_number(section->require("from", "where the period begins").value, "from", parameters);
    axis.to = read_number(section->require("to", "where the period ends").value, "to", parameters);
    axis.cells = read_integer(section->require("cells", "how many cells the period has").value, "cells", parameters, 3);
    axis.jumps = read_jumps(*section, fields, parameters);
    axis.twists = read_twists(*section, parameters);
    read_walls(*section, fields, axis);
    axis.sponge = read_sponge(*section, axis, parameters);
    section->finish();
    if (!(axis.from < axis.to) || !std::isfinite(axis.to - axis.from)) {
      throw ProblemError(axis.location,
                         fmt::format("grid.{}: from = {} has to be less than to = {}", name, axis.from, axis.to));
    }
    axes.push_back(axis);
  }
  grid->finish();
  if (axes.empty()) {
    throw ProblemError(grid->location(), "[grid] has no direction; give x = { from = …, to = …, cells = … }");
  }
  return axes;
}

/// K.x, K.y, K.z: one for each direction of the grid.
std::vector<Matrix> read_K(Section& section, const std::vector<std::string>& axes, const MatrixReader& matrices) {
  const Entry& entry = section.require("K", R"(one matrix per direction, such as K.x = [["u", "w", 1]])");
  if (entry.value.table() == nullptr) {
    throw ProblemError(entry.location, "K: write K.x = …, and K.y, K.z in more dimensions");
  }
  Section table(*entry.value.table(), entry.location, "[multisymplectic.K]");
  std::vector<Matrix> K;
  for (const std::string& axis : all_axes) {
    const Entry* matrix = table.take(axis);
    const bool in_grid = std::find(axes.begin(), axes.end(), axis) != axes.end();
    if (matrix != nullptr && !in_grid) {
      throw ProblemError(matrix->location, fmt::format("K.{0} is given, but [grid] has no {0}", axis));
    }
    if (matrix == nullptr && in_grid) {
      throw ProblemError(entry.location, fmt::format("[grid] has {0}, but K.{0} is not given", axis));
    }
    if (matrix != nullptr) {
      K.push_back(matrices.skew(matrix->value, "K." + axis));
    }
  }
  table.finish();
  return K;
}

/// [initial]: a formula for some of the fields, in the grid's coordinates and in derivatives of other initial fields.
class InitialReader {
public:
  InitialReader(MultisymplecticProblem& pde, const NameList& fields, const Parameters& parameters)
      : pde_(pde), fields_(fields), parameters_(parameters), needs_(fields.names.size()) {}

  void read(Section& section) {
    pde_.initial_location = section.location();
    if (const Entry* time = section.take("t")) {
      pde_.start = read_number(time->value, "t", parameters_);
    }
    auto next = section.take_section("next");
    auto values = take_values(section, fields_);
    take_slopes(section, values);
    read_record(section);
    for (const Value* value : values) {
      const std::string& name = fields_.names[pde_.initial.size()];
      pde_.initial.push_back(value == nullptr ? std::nullopt : std::optional(read_formula(*value, name)));
    }
    section.finish();
    for (std::size_t i = 0; i < values.size(); ++i) {
      if (pde_.initial[i]) {
        find_needs(i);
      }
    }
    refuse_cycles();
    if (next) {
      read_next(*next);
    }
  }

private:
  /// Fields that are given by their derivatives by x.
  void take_slopes(Section& section, std::vector<const Value*>& values) {
    std::vector<InitialSlope> given;
    for (const InitialSlope& slope : pde_.slopes) {
      const Entry* const entry = section.take(slope.name);
      if (entry == nullptr) {
        continue;
      }
      const auto field = std::ranges::find(fields_.names, slope.field) - fields_.names.begin();
      if (values[static_cast<std::size_t>(field)] != nullptr) {
        throw ProblemError(entry->location,
                           fmt::format("{0} is the derivative of {1} by x, and both are given: leave one of them out",
                                       slope.name, slope.field));
      }
      values[static_cast<std::size_t>(field)] = &entry->value;
      given.push_back(slope);
    }
    pde_.slopes = std::move(given);
  }

  void read_next(Section& section) {
    NextLevel next{.t = read_number(section.require("t", "the time of the second level").value, "t", parameters_),
                   .fields = {},
                   .location = section.location()};
    const Parameters known = with_time(parameters_, next.t, section.location());
    for (const Value* value : take_values(section, fields_)) {
      const std::string& name = fields_.names[next.fields.size()];
      next.fields.push_back(value == nullptr ? std::nullopt : std::optional(read_formula(*value, name)));
      if (next.fields.back()) {
        formula::Graph graph;
        std::vector<formula::Expression> parts;
        static_cast<void>(build_initial(*next.fields.back(), graph, pde_, known, parts));
      }
    }
    section.finish();
    pde_.next = std::move(next);
  }

  [[nodiscard]] bool is_taken(const std::string& field) const {
    const auto& record = pde_.initial_record;
    return record && std::ranges::find(record->take, field) != record->take.end();
  }

  /// from, at and take, which were completed before.
  void read_record(Section& section) {
    const Entry* from = section.take("from");
    const Entry* at = section.take("at");
    const Entry* take = section.take("take");
    if (from == nullptr) {
      for (const Entry* entry : {at, take}) {
        if (entry != nullptr) {
          throw ProblemError(entry->location, fmt::format("{} says what to take of a record: give its name, from = "
                                                          "\"old.h5\", too",
                                                          entry->key));
        }
      }
      return;
    }
    if (at == nullptr) {
      throw ProblemError(from->location, "from with take needs at, the time of a stored level");
    }
    InitialRecord record{.file = read_string(from->value, "from"),
                         .at = read_number(at->value, "at", parameters_),
                         .location = from->value.location};
    for (const Value& name : read_array(take->value, "take", "names of fields")) {
      const std::string& field = read_string(name, "take");
      if (std::ranges::find(fields_.names, field) == fields_.names.end()) {
        throw ProblemError(
            name.location,
            fmt::format("take: there is no field {} here; name those that there are, of {}, and give the others", field,
                        fmt::join(fields_.names, ", ")));
      }
      if (find(section.entries(), field) != nullptr) {
        throw ProblemError(name.location, fmt::format("{} is given by a formula, and taken from a record", field));
      }
      record.take.push_back(field);
    }
    pde_.initial_record = std::move(record);
  }

  /// Which other fields the formula of field i differentiates.
  void find_needs(std::size_t i) {
    const FormulaText& text = *pde_.initial[i];
    formula::Graph graph;
    std::vector<formula::Expression> parts;
    parts.push_back(build_initial(text, graph, pde_, parameters_, parts));
    const std::vector<std::string> arguments = argument_names(pde_);
    for (const formula::Expression part : parts) {
      for (const std::size_t variable : formula::variables_of(part)) {
        const std::string& name = graph.variable_name(variable);
        if (std::ranges::find(arguments, name) == arguments.end() && name.find(' ') == std::string::npos) {
          need(i, name);  // neither a coordinate, nor a derivative of one of the parts
        }
      }
    }
  }

  /// The formula of field i names a field, or a derivative of one.
  void need(std::size_t i, const std::string& name) {
    const FormulaText& text = *pde_.initial[i];
    const std::size_t open = name.rfind('(');
    if (open == std::string::npos) {
      throw ProblemError(text.location, fmt::format("the initial {} names the field {}: only its derivatives, such as "
                                                    "dx({}), are available here",
                                                    fields_.names[i], name, name));
    }
    const std::string field = name.substr(open + 1, name.find(')') - open - 1);
    const auto other =
        static_cast<std::size_t>(std::find(fields_.names.begin(), fields_.names.end(), field) - fields_.names.begin());
    if (!pde_.initial[other] && !is_taken(field)) {
      throw ProblemError(text.location, fmt::format("the initial {} holds {}, but [initial] gives no {}",
                                                    fields_.names[i], name, field));
    }
    needs_[i].push_back(other);
  }

  void refuse_cycles() const {
    std::vector<bool> known(needs_.size(), false);
    for (std::size_t round = 0; round < needs_.size();
         ++round) {  // each round settles at least one field, or none can be
      for (std::size_t i = 0; i < needs_.size(); ++i) {
        known[i] = std::all_of(needs_[i].begin(), needs_[i].end(), [&](std::size_t other) { return known[other]; });
      }
    }
    const auto stuck = std::find(known.begin(), known.end(), false);
    if (stuck != known.end()) {
      const auto i = static_cast<std::size_t>(stuck - known.begin());
      throw ProblemError(pde_.initial[i]->location,
                         fmt::format("the initial {} depends on its own derivatives", fields_.names[i]));
    }
  }

  MultisymplecticProblem& pde_;
  const NameList& fields_;
  const Parameters& parameters_;
  std::vector<std::vector<std::size_t>> needs_;
};

bool is_built_in_law(std::string_view name) {
  static constexpr std::array<std::string_view, 7> laws = {"energy",
                                                           "momentum",
                                                           "variational_energy",
                                                           "variational_momentum",
                                                           "multisymplectic",
                                                           figures::energy_lost_name,
                                                           figures::wall_work_name};
  return std::ranges::find(laws, name) != laws.end() || name.starts_with("momentum_") ||
         name.starts_with("variational_momentum_");  // in two and three dimensions
}

/// The record has LAW_max and LAW_rms for every law.
void check_invariant_names(const std::vector<NamedFormula>& invariants, const std::vector<StatedSymmetry>& symmetries) {
  for (const auto& [name, formula] : invariants) {
    std::string_view law = name;
    if (!law.ends_with("_max") && !law.ends_with("_rms")) {
      continue;
    }
    law.remove_suffix(4);
    if (is_built_in_law(law) || std::ranges::find(symmetries, law, &StatedSymmetry::name) != symmetries.end()) {
      throw ProblemError(formula.location, fmt::format("\"{}\" cannot name an invariant: {}", name, name_of_record));
    }
  }
}

/// Fields are datasets of the group /states.
void check_field_names(const Value::Array& fields) {
  static constexpr std::array<std::string_view, 3> names_in_record = {"level", "previous", "midpoints"};
  for (const Value& field : fields) {
    if (std::ranges::find(names_in_record, *field.string()) != names_in_record.end()) {
      throw ProblemError(field.location,
                         fmt::format("\"{}\" cannot name a field: {}", *field.string(), name_of_record));
    }
  }
}

std::vector<StatedSymmetry> read_symmetries(Section& root, const MatrixReader& matrices) {
  // The names share a table with the built-in laws, and a group of the record with what their axes are called.
  static constexpr std::array<std::string_view, 7> axes = {"t", "x", "y", "z", "x_cell", "y_cell", "z_cell"};
  std::vector<StatedSymmetry> symmetries;
  if (const auto section = root.take_section("symmetries")) {
    for (const Entry& entry : section->entries()) {
      if (!is_identifier(entry.key)) {
        refuse_name(entry, "a symmetry", malformed_name);
      }
      if (is_built_in_law(entry.key)) {
        refuse_name(entry, "a symmetry", "a built-in law has that name");
      }
      if (std::ranges::find(axes, entry.key) != axes.end()) {
        refuse_name(entry, "a symmetry", name_of_record);
      }
      symmetries.push_back({entry.key, matrices.general(entry.value, entry.key)});
    }
  }
  return symmetries;
}

void enlarge(Matrix& matrix, std::size_t by) {
  Matrix larger{matrix.size + by, std::vector<double>((matrix.size + by) * (matrix.size + by), 0.0), matrix.location};
  for (std::size_t i = 0; i < matrix.size; ++i) {
    for (std::size_t j = 0; j < matrix.size; ++j) {
      larger(i, j) = matrix(i, j);
    }
  }
  matrix = std::move(larger);
}

/// A driven system, S(z, x, t), in its extended phase space: S(z, x, time) + minus_work with two more fields, the same
/// at every node and in it, time_t = 1, minus_work_t = -∂S/∂t. Its law of energy is the balance of the driven one.
void extend_by_time(MultisymplecticProblem& pde) {
  const std::size_t clock = pde.fields.size(), work = clock + 1;
  pde.driven = true;
  pde.fields.insert(pde.fields.end(), {std::string(clock_name), std::string(work_name)});
  enlarge(pde.M, 2);
  pde.M(work, clock) = 1.0;
  pde.M(clock, work) = -1.0;
  for (Matrix& K : pde.K) {
    enlarge(K, 2);
  }
  for (StatedSymmetry& symmetry : pde.symmetries) {
    enlarge(symmetry.B, 2);
  }
  pde.initial.emplace_back(FormulaText{fmt::format("{:.17g}", pde.start), pde.S.location});
  pde.initial.emplace_back(FormulaText{"0", pde.S.location});
  if (pde.next) {
    pde.next->fields.emplace_back(FormulaText{fmt::format("{:.17g}", pde.next->t), pde.S.location});
    pde.next->fields.emplace_back();
  }
}

}  // namespace

formula::Expression build_initial(const FormulaText& text, formula::Graph& graph, const MultisymplecticProblem& pde,
                                  const Parameters& parameters, std::vector<formula::Expression>& differentiated) {
  const std::vector<std::string> axes = pde.axis_names(), arguments = argument_names(pde);
  return build_formula(text, graph,
                       {.names = arguments,
                        .differentiable = pde.fields,
                        .axes = axes,
                        .periods = pde.axes,
                        .differentiated = &differentiated},
                       parameters);
}

std::vector<std::string> MultisymplecticProblem::axis_names() const {
  std::vector<std::string> names;
  for (const GridAxis& axis : axes) {
    names.push_back(axis.name);
  }
  return names;
}

double MultisymplecticProblem::nodes() const {
  double nodes = 1.0;
  for (const GridAxis& axis : axes) {
    nodes *= static_cast<double>(axis.nodes());
  }
  return nodes;
}

bool MultisymplecticProblem::has_walls() const {
  return std::ranges::any_of(axes, &GridAxis::has_walls);
}

bool MultisymplecticProblem::has_drives() const {
  return std::ranges::any_of(axes, [](const GridAxis& axis) { return !axis.drives.empty(); });
}

bool MultisymplecticProblem::has_jumps() const {
  return std::ranges::any_of(axes, [](const GridAxis& axis) { return !axis.jumps.empty(); });
}

bool MultisymplecticProblem::has_twists() const {
  return std::ranges::any_of(axes, [](const GridAxis& axis) { return !axis.twists.empty(); });
}

const StatedSponge* MultisymplecticProblem::sponge() const {
  const auto axis = std::ranges::find_if(axes, [](const GridAxis& one) { return one.sponge.has_value(); });
  return axis == axes.end() ? nullptr : &*axis->sponge;
}

Names names_of_lattice(const Section& root) {
  Names taken;
  taken.know_sizes(root);
  taken.reserve("t", "it is the time");
  for (const std::string& axis : all_axes) {
    taken.reserve(axis, "it is a coordinate of the grid");
    taken.reserve("d" + axis, "it is a derivative");
  }
  return taken;
}

void read_multisymplectic(Section& root, Section& section, Problem& problem, std::vector<InitialSlope> slopes) {
  Names taken = names_of_lattice(root);
  const Value& names = section.require("fields", R"(the names of the fields, such as ["u", "v", "w"])").value;
  const NameList fields = read_names(names, "fields", "a field", taken);
  check_field_names(*names.array());
  problem.parameters = read_parameters(root, taken);
  auto& parameters = problem.parameters;

  MultisymplecticProblem pde;
  pde.fields = fields.names;
  pde.slopes = std::move(slopes);
  pde.axes = read_grid(root, section, pde.fields, parameters);
  const auto axes = pde.axis_names();
  const std::vector<std::string> quantities = quantity_names(pde);
  std::vector<formula::Expression> differentiated;  // where such a definition is used decides whether there is dx(f)
  std::vector<std::string> definable = quantities;
  std::ranges::copy(corner_names(pde.fields, static_cast<int>(axes.size())), std::back_inserter(definable));
  add_definitions(root, taken,
                  {.names = definable,
                   .differentiable = pde.fields,
                   .axes = axes,
                   .periods = pde.axes,
                   .differentiated = &differentiated},
                  parameters);
  const MatrixReader matrices(pde.fields, parameters);
  pde.M = matrices.skew(section.require("M", R"(the matrix of z_t, such as [["u", "v", -1]])").value, "M");
  pde.K = read_K(section, axes, matrices);
  pde.S = read_formula(section.require("S", "a formula of the fields").value, "S");
  const bool driven = names_time(pde.S, {.names = quantities, .periods = pde.axes}, parameters);
  section.finish();
  if (driven) {
    for (const std::string_view name : {clock_name, work_name}) {
      taken.declare(name, "one of the pair that an S of t adds, time and minus_work", pde.S.location);
    }
  }

  auto initial = root.take_section("initial");
  if (!initial) {  // [exact] at the start
    const Entry* const exact = find(root.entries(), "exact");
    if (exact == nullptr || exact->value.table() == nullptr) {
      throw ProblemError(section.location(),
                         "there is no [initial]: give a formula for the fields, such as u = \"cos(x)\", or [exact]");
    }
    initial.emplace(*exact->value.table(), exact->location, "[initial]");
  }
  InitialReader(pde, fields, parameters).read(*initial);
  pde.invariants = read_invariants(
      root, {.names = quantities, .differentiable = pde.fields, .axes = axes, .periods = pde.axes}, parameters);
  pde.exact = read_exact(root, std::array{fields}, argument_names(pde), parameters);
  pde.symmetries = read_symmetries(root, matrices);
  check_invariant_names(pde.invariants, pde.symmetries);
  if (driven) {
    extend_by_time(pde);
  }
  problem.system = std::move(pde);
  check_jumps(problem);
  check_walls(problem);
}

}  // namespace rubato
