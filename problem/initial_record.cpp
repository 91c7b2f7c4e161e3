#include <rubato/problem/initial_record.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <iterator>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/pde/moving_frame.hpp>
#include <rubato/problem/initial_arrays.hpp>
#include <rubato/problem/initial_table.hpp>
#include <rubato/problem/keys.hpp>
#include <rubato/problem/lattice_problem.hpp>
#include <rubato/problem/reader.hpp>
#include <rubato/problem/stored.hpp>
#include <rubato/record/arrays.hpp>
#include <rubato/record/reader.hpp>

namespace rubato {

namespace {

void (*probe_source)(const std::filesystem::path& file) = nullptr;

/// A stored level of another run.
struct StoredState {
  std::size_t row = 0;
  double t = 0.0;
};

template <typename Action>
auto at_source(const Location& location, const Action& action) {
  try {
    return action();
  } catch (const record::NoSuchGroup& error) {
    throw ProblemError(location, fmt::format("from: {}", error.what()));
  } catch (const record::Error& error) {
    throw FileError(ProblemError(location, fmt::format("from: {}", error.what())).what());
  }
}

/// The one nearest to `at`, or the last.
StoredState find_state(const record::Reader& reader, const std::optional<double>& at, const Location& location) {
  const std::vector<double> t = reader.read("/states/t");
  if (t.empty()) {
    throw ProblemError(location, fmt::format("from: {} has no state", reader.file().string()));
  }
  if (!at) {
    return {t.size() - 1, t.back()};
  }
  if ((*at - t.front()) * (*at - t.back()) > 1e-9 * std::abs(t.back() - t.front()) * std::abs(*at)) {
    throw ProblemError(
        location, fmt::format("at = {} is outside of the record, which goes from {} to {}", *at, t.front(), t.back()));
  }
  const auto nearest = std::ranges::min_element(t, {}, [&](double time) { return std::abs(time - *at); });
  return {static_cast<std::size_t>(nearest - t.begin()), *nearest};
}

void put(Value::Table& table, const std::string& key, Value value, const Location& location) {
  value.location = location;
  if (Entry* entry = find(table, key)) {
    entry->value = std::move(value);
  } else {
    table.push_back({key, location, std::move(value)});
  }
}

/// The names that a problem declares in a list, the base names of vectors among them.
std::vector<NameList::Group> declared(const Section& root, const Value::Table& section, const char* key) {
  const Entry* list = find(section, key);
  if (list == nullptr || list->value.array() == nullptr) {
    return {};
  }
  Names names;
  names.know_sizes(root);
  return read_names(list->value, key, "a name", names).groups;
}

/// `system`: [hamiltonian], or, with `velocities` in place of momenta, [lagrangian].
void take_orbit(const Section& root, Value::Table& initial, const Value::Table& system, bool velocities,
                const record::Reader& reader, const StoredState& state, const Location& location) {
  const auto has = [&](const char* path) {
    if (!reader.has(path)) {
      throw ProblemError(location, fmt::format("from: {} is not the record of an orbit{}", reader.file().string(),
                                               velocities ? " that is stated by L ([lagrangian])" : ""));
    }
  };
  for (const auto& [key, dot, names_path, path] :
       {std::tuple("q", "", "/states/coordinate", "/states/q"),
        velocities ? std::tuple("q", "_dot", "/states/velocity", "/states/q_dot")
                   : std::tuple("p", "", "/states/momentum", "/states/p")}) {
    has(names_path);
    const std::vector<std::string> names = reader.read_strings(names_path);
    const std::vector<double> values = reader.read(path, state.row, 1);
    for (const NameList::Group& group : declared(root, system, key)) {
      if (find(initial, group.base + dot) != nullptr) {
        continue;  // what the user says goes first
      }
      for (std::size_t i = 1; i <= group.count; ++i) {
        const std::string name = (group.is_vector ? fmt::format("{}{}", group.base, i) : group.base) + dot;
        const auto found = std::ranges::find(names, name);
        if (found != names.end() && find(initial, name) == nullptr) {
          put(initial, name, {values[static_cast<std::size_t>(found - names.begin())], {}}, location);
        }
      }
    }
  }
}

/// The fields that a problem gives itself: the others follow from its constraints.
std::vector<std::string> given_fields(const MultisymplecticProblem& pde) {
  std::vector<std::string> names;
  const std::size_t own = pde.fields.size() - (pde.driven ? 2 : 0);  // time and minus_work begin anew
  for (std::size_t f = 0; f < own; ++f) {
    if (pde.initial[f] || (pde.initial_record && std::ranges::find(pde.initial_record->take, pde.fields[f]) !=
                                                     pde.initial_record->take.end())) {
      names.push_back(pde.fields[f]);
    }
  }
  return names;
}

/// What the columns of a table give: of a lattice the names of fields, of an orbit the numbers of its one row.
void resolve_table(const std::string& file, bool lattice, Value::Table& initial, const Location& location) {
  const InitialTable table = read_table(file, location);
  if (const Entry* at = find(initial, "at")) {
    throw ProblemError(at->location, "at is a time of a record; a table has one state, and t says when it is");
  }
  if (lattice) {
    Value::Array names;
    for (const std::string& name : table.names) {
      const bool is_place = std::ranges::find(axis_letters, name) != axis_letters.end();
      if (!is_place && find(initial, name) == nullptr) {
        names.push_back({name, location});
      }
    }
    put(initial, "at", {0.0, {}}, location);
    put(initial, "take", {std::move(names), {}}, location);
    return;
  }
  if (table.lines.size() != 1) {
    throw ProblemError(location,
                       fmt::format("from: {} has {} rows; the start of an orbit is one", file, table.lines.size()));
  }
  std::erase_if(initial, [](const Entry& entry) { return entry.key == "from"; });
  for (std::size_t i = 0; i < table.names.size(); ++i) {
    if (find(initial, table.names[i]) == nullptr) {
      put(initial, table.names[i], {table.columns[i].front(), {}}, location);
    }
  }
}

/// What datasets of another program give: of a lattice the names of its fields, of an orbit the numbers.
void resolve_arrays(const std::string& from, const Section& root, const Entry* orbit, bool velocities,
                    const std::optional<double>& time, Value::Table& initial, const Location& location) {
  const auto level = level_of_arrays(from, time, location);
  if (!level && time) {
    throw ProblemError(
        location, fmt::format("at = {} is the time of a level; {} has no dataset t, and so no levels", *time, from));
  }
  if (level && find(initial, "t") == nullptr) {
    put(initial, "t", {*level, {}}, location);
  }
  const auto is_given = [&initial](const std::string& name) { return find(initial, name) != nullptr; };
  std::size_t taken = 0;
  if (orbit == nullptr) {
    const Entry* lattice = find(root.entries(), "multisymplectic");
    Value::Array names;
    for (const NameList::Group& group : declared(root, *lattice->value.table(), "fields")) {
      for (std::size_t i = 1; i <= group.count; ++i) {
        const std::string name = group.is_vector ? fmt::format("{}{}", group.base, i) : group.base;
        if (!is_given(name) && !is_given(group.base) && !names_in_arrays(from, std::array{name}).empty()) {
          names.push_back({name, location});
        }
      }
    }
    taken = names.size();
    put(initial, "at", {level.value_or(0.0), {}}, location);
    put(initial, "take", {std::move(names), {}}, location);
  } else {
    std::erase_if(initial, [](const Entry& entry) { return entry.key == "from" || entry.key == "at"; });
    for (const auto& [key, dot] : {std::pair("q", ""), velocities ? std::pair("q", "_dot") : std::pair("p", "")}) {
      for (const NameList::Group& group : declared(root, *orbit->value.table(), key)) {
        const std::string base = group.base + dot;
        const auto component = [&](std::size_t i) { return fmt::format("{}{}{}", group.base, i, dot); };
        if (is_given(base)) {
          continue;  // what the user says goes first
        }
        const bool whole = !names_in_arrays(from, std::array{base}).empty();
        const auto numbers = whole ? numbers_of_array(from, base, group.count, level, location) : std::vector<double>();
        for (std::size_t i = 1; i <= group.count; ++i) {
          const std::string name = group.is_vector ? component(i) : base;
          if (is_given(name) || (!whole && names_in_arrays(from, std::array{name}).empty())) {
            continue;
          }
          const double value = whole ? numbers[i - 1] : numbers_of_array(from, name, 1, level, location).front();
          put(initial, name, {value, {}}, location);
          ++taken;
        }
      }
    }
  }
  if (taken == 0) {
    throw ProblemError(location, fmt::format("from: {} is no record, and has no dataset of a name that is needed here; "
                                             "it has {}",
                                             from, list_of_arrays(from)));
  }
}

}  // namespace

namespace {

/// The time of the level that is taken where none is named: the last; 0 where it has none.
double time_of(const std::string& file, const Location& location) {
  if (is_table(file)) {
    return 0.0;
  }
  return is_array_source(file) ? level_of_arrays(file, {}, location).value_or(0.0)
                               : find_state(record::Reader(file), std::nullopt, location).t;
}

/// Fields of a level of a moving frame at the nodes of the laboratory. \param which their numbers
/// \throws record::Error where one turns with a field that is not stored
std::vector<std::vector<double>> laboratory_fields(const record::Reader& reader, const MultisymplecticProblem& pde,
                                                   MovingFrame frame, const Jumps& jumps, const grids::Grid& grid,
                                                   const StoredState& state, std::span<const int> which) {
  const int count = static_cast<int>(pde.fields.size());
  LatticeLevel level{.fields = grids::FieldSet(count, grid.size()), .slopes = {}};
  for (int f = 0; f < count; ++f) {
    const std::string path = "/states/" + pde.fields[static_cast<std::size_t>(f)];
    if (reader.has(path)) {
      std::ranges::copy(reader.read(path, state.row, 1), level.fields.field(f).begin());
    } else if (frame.phase(state.t) != 0.0 &&
               std::ranges::any_of(which, [&](int g) { return g != f && frame.B(g, f) != 0.0; })) {
      throw record::Error(reader.file(), path + " is missing, and others turn with it");
    }
  }
  WholeFields whole(jumps, grid, count);
  whole.remove(level.fields.all());
  LaboratoryView laboratory(std::move(frame), grid);
  const LatticeLevel& moved = laboratory(level, state.t);
  std::vector<std::vector<double>> fields;
  for (const int f : which) {
    const std::span<const double> values = whole(f, moved.fields.all());
    fields.emplace_back(values.begin(), values.end());
  }
  return fields;
}

}  // namespace

void probe_sources_with(void (*probe)(const std::filesystem::path& file)) {
  probe_source = probe;
}

bool resolve_initial_record(Value& root) {
  Entry* section = find(*root.table(), "initial");
  Value::Table* initial = section == nullptr ? nullptr : section->value.table();
  Entry* from = initial == nullptr ? nullptr : find(*initial, "from");
  if (from == nullptr) {
    return false;
  }
  const Location location = from->value.location;
  const std::string file = read_string(from->value, "from");
  const Entry* at = find(*initial, "at");
  const bool is_resolved = find(*initial, "take") != nullptr && at != nullptr;
  if (!is_resolved && !is_table(file) && probe_source != nullptr &&
      std::filesystem::is_regular_file(read_array_source(file).file)) {
    at_source(location, [&] { probe_source(read_array_source(file).file); });
  }
  const Entry* lagrangian = find(*root.table(), "lagrangian");
  const Entry* orbit = lagrangian != nullptr ? lagrangian : find(*root.table(), "hamiltonian");
  const bool equation = find(*root.table(), "field") != nullptr;
  const bool lattice = equation || find(*root.table(), "multisymplectic") != nullptr;
  if (!lattice && (orbit == nullptr || orbit->value.table() == nullptr)) {
    throw ProblemError(location, "from needs a system: [hamiltonian], [lagrangian], [multisymplectic] or [field]");
  }
  if (const Entry* take = find(*initial, "take")) {
    if (!lattice) {
      throw ProblemError(take->location, "take is for lattices; an orbit takes all coordinates and momenta there are");
    }
    const bool is_new = at == nullptr || find(*initial, "t") == nullptr;
    if (at == nullptr) {
      put(*initial, "at", {at_source(location, [&] { return time_of(file, location); }), {}}, location);
    }
    if (find(*initial, "t") == nullptr) {
      put(*initial, "t", {find(*initial, "at")->value}, location);
    }
    return is_new;
  }
  const std::optional<double> time = at == nullptr ? std::nullopt : std::optional(read_number(at->value, "at", {}));
  const Location time_location = at == nullptr ? location : at->value.location;
  if (is_table(file)) {
    resolve_table(file, lattice, *initial, location);
    return true;
  }
  at_source(location, [&] {
    if (is_array_source(file)) {
      if (equation) {
        throw ProblemError(location, fmt::format("from: say which fields {} has, take = [\"u\", \"u_t\"] for instance; "
                                                 "its datasets are {}",
                                                 file, list_of_arrays(file)));
      }
      resolve_arrays(file, Section(*root.table(), root.location, ""), lattice ? nullptr : orbit, lagrangian != nullptr,
                     time, *initial, location);
      return;
    }
    const record::Reader reader(file);
    const Problem other = stored_problem(reader);
    const StoredState state = find_state(reader, time, time_location);
    // The start is the time of that level, unless the user says another.
    if (find(*initial, "t") == nullptr) {
      put(*initial, "t", {state.t, {}}, location);
    }
    if (!lattice) {
      std::erase_if(*initial, [](const Entry& entry) { return entry.key == "from" || entry.key == "at"; });
      take_orbit(Section(*root.table(), root.location, ""), *initial, *orbit->value.table(), lagrangian != nullptr,
                 reader, state, location);
      return;
    }
    if (other.multisymplectic() == nullptr) {
      throw ProblemError(location, fmt::format("from: {} is not the record of a lattice", file));
    }
    put(*initial, "at", {state.t, {}}, location);
    Value::Array names;
    for (const std::string& name : given_fields(*other.multisymplectic())) {
      if (find(*initial, name) == nullptr && reader.has("/states/" + name)) {
        names.push_back({name, location});
      }
    }
    put(*initial, "take", {std::move(names), {}}, location);
  });
  return true;
}

std::vector<std::vector<double>> read_initial_fields(const InitialRecord& source, const grids::Grid& grid,
                                                     std::span<const std::string> names, const Jumps& jumps) {
  const auto number = [&](const std::string& name) {
    return static_cast<int>(std::ranges::find(names, name) - names.begin());
  };
  if (!source.arrays.empty()) {
    std::vector<std::vector<double>> fields;
    for (const std::string& name : source.take) {
      const std::span<const double> values = source.arrays.at(name);
      fields.emplace_back(values.begin(), values.end());
    }
    return fields;
  }
  std::vector<int> numbers;
  std::ranges::transform(source.take, std::back_inserter(numbers), number);
  std::vector<FieldOnGrid> fields;
  if (is_table(source.file) && !source.own_start) {
    const InitialTable table = read_table(source.file, source.location);
    for (const std::string& name : source.take) {
      fields.push_back(field_of_table(table, source.file, name, grid, source.location));
    }
    return at_source(source.location, [&] { return jumps.resampled(numbers, fields, grid); });
  }
  return at_source(source.location, [&] {
    if (!source.own_start && is_array_source(source.file)) {
      for (const std::string& name : source.take) {
        fields.push_back(field_of_arrays(source.file, name, source.at, grid, source.location));
      }
      return jumps.resampled(numbers, fields, grid);
    }
    const record::Reader reader(source.file);
    const StoredState state = source.own_start ? StoredState{} : find_state(reader, source.at, source.location);
    const Problem other = stored_problem(reader);
    const MultisymplecticProblem* pde = other.multisymplectic();
    if (pde == nullptr) {
      throw ProblemError(source.location, fmt::format("from: {} is not the record of a lattice", source.file));
    }
    const grids::Grid old = make_grid(other);
    const auto box = [](const grids::Grid& of) {
      std::vector<std::string> sides;
      for (const grids::Axis& axis : of.axes()) {
        sides.push_back(
            fmt::format("{} from {} to {}{}", axis.name, axis.from, axis.to, axis.has_walls() ? " between walls" : ""));
      }
      return fmt::format("{}", fmt::join(sides, ", "));
    };
    if (box(old) != box(grid)) {
      throw ProblemError(source.location,
                         fmt::format("from: {} has {}, and this problem {}: only the number of cells may differ",
                                     source.file, box(old), box(grid)));
    }
    std::vector<int> others;
    for (const std::string& name : source.take) {
      if (!reader.has("/states/" + name)) {
        throw ProblemError(source.location, fmt::format("from: {} has no field {} at its levels", source.file, name));
      }
      others.push_back(static_cast<int>(std::ranges::find(pde->fields, name) - pde->fields.begin()));
    }
    // The first state is of the laboratory, whatever the frame.
    const Jumps of_record = make_jumps(other);
    std::optional<MovingFrame> frame = state.row == 0 ? std::nullopt : make_frame(other);
    if (frame) {
      const std::vector<std::vector<double>> moved =
          laboratory_fields(reader, *pde, std::move(*frame), of_record, old, state, others);
      std::ranges::transform(moved, std::back_inserter(fields), [&](const auto& values) {
        return FieldOnGrid{values, old};
      });
    } else {
      std::ranges::transform(source.take, std::back_inserter(fields), [&](const std::string& name) {
        return FieldOnGrid{reader.read("/states/" + name, state.row, 1), old};
      });
    }
    return of_record.resampled(others, fields, grid);
  });
}

}  // namespace rubato
