#include <rubato/problem/problem.hpp>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <memory>

#include <fmt/format.h>

#include <rubato/catalogue/catalogue.hpp>
#include <rubato/problem/effective.hpp>
#include <rubato/problem/keys.hpp>
#include <rubato/problem/reader.hpp>
#include <rubato/problem/solve.hpp>

namespace rubato {
namespace {

constexpr std::size_t largest_file = 64 << 20;

/// The bytes of a file; absent if there is no such file.
/// \throws FileError if there is one and it cannot be read, or is neither a regular file nor standard input nor an open
/// pipe
std::optional<std::string> read_file(const std::string& path) {
  std::error_code ignored;
  const std::filesystem::file_status status = std::filesystem::status(path, ignored);
  const bool is_open = path == "/dev/stdin" ||
                       (std::filesystem::is_fifo(status) && (path.starts_with("/dev/") || path.starts_with("/proc/")));
  if (std::filesystem::exists(status) && !std::filesystem::is_regular_file(status) && !is_open) {
    throw FileError(fmt::format("{}: is not a regular file", path));
  }
  errno = 0;
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path.c_str(), "rb"), &std::fclose);
  if (!file && (errno == ENOENT || errno == ENOTDIR || errno == ENAMETOOLONG)) {
    return std::nullopt;
  }
  std::string text;
  std::string block(1 << 16, '\0');
  while (file) {
    const std::size_t count = std::fread(block.data(), 1, block.size(), file.get());
    text.append(block, 0, count);
    if (text.size() > largest_file) {
      throw ProblemError({path, 0, 0}, fmt::format("larger than {} MB; is this a problem file?", largest_file >> 20));
    }
    if (count < block.size()) {
      break;
    }
  }
  if (!file || std::ferror(file.get()) != 0) {
    throw FileError(fmt::format("{}: cannot be read: {}", path, std::strerror(errno)));
  }
  return text;
}

void read_laws(Section& root, Problem& problem) {
  auto section = root.take_section("laws");
  if (!section) {
    return;
  }
  problem.laws.location = section->location();
  if (const Entry* every = section->take("every")) {
    problem.laws.location = every->value.location;
    const bool* word = std::get_if<bool>(&every->value.data);
    const bool off = every->value.string() != nullptr && *every->value.string() == "off";
    if (word != nullptr && *word) {
      throw ProblemError(every->value.location, "every = true: write every = 1, or false for none of the laws");
    }
    if (const auto* zero = std::get_if<std::int64_t>(&every->value.data); zero != nullptr && *zero == 0) {
      throw ProblemError(every->value.location, "every = 0: write every = false for none of the laws");
    }
    problem.laws.every = word != nullptr || off ? 0 : read_integer(every->value, "every", problem.parameters, 1);
  }
  if (const Entry* fields = section->take("fields")) {
    problem.laws.fields = read_boolean(fields->value, "fields");
    if (problem.laws.fields && problem.multisymplectic() == nullptr) {
      throw ProblemError(fields->value.location, "fields = true: an orbit has no cells; leave it out");
    }
    if (problem.laws.fields && problem.laws.none()) {
      throw ProblemError(fields->value.location, "fields = true asks for laws, and every = false takes none");
    }
  }
  section->finish();
  if (problem.laws.none()) {
    std::visit([](auto& system) { system.invariants.clear(); }, problem.system);
  }
}

/// [verdict] accept.
std::vector<figures::ReasonKind> read_accepted(Section& root) {
  std::vector<figures::ReasonKind> accepted;
  auto section = root.take_section("verdict");
  if (!section) {
    return accepted;
  }
  if (const Entry* accept = section->take("accept")) {
    const Value::Array* words = accept->value.array();
    if (words == nullptr) {
      throw ProblemError(accept->value.location, "accept has to be a list of words, as [\"spectrum\"]");
    }
    for (const Value& word : *words) {
      accepted.push_back(static_cast<figures::ReasonKind>(read_word(word, "accept", figures::reason_words)));
    }
  }
  section->finish();
  return accepted;
}

void read_output(Section& root, Problem& problem) {
  problem.output.file = problem.name + ".h5";
  problem.output.file_location = root.location();
  if (auto section = root.take_section("output")) {
    if (const Entry* file = section->take("file")) {
      problem.output.file = read_string(file->value, "file");
      problem.output.file_location = file->value.location;
      if (problem.output.file.empty()) {
        throw ProblemError(file->value.location, "file: the name is empty");
      }
    }
    if (const Entry* every = section->take("every")) {
      problem.output.every = read_integer(every->value, "every", problem.parameters, 1);
    }
    if (const Entry* durable = section->take("durable")) {
      problem.output.durable = read_boolean(durable->value, "durable");
    }
    if (const Entry* compression = section->take("compression")) {
      const std::int64_t level = read_integer(compression->value, "compression", problem.parameters, 0);
      if (level > record::most_compression) {
        throw ProblemError(compression->value.location,
                           fmt::format("compression = {}: it goes from 0, none, to {}, most and slowest", level,
                                       record::most_compression));
      }
      problem.output.compression = static_cast<int>(level);
    }
    read_output_times(*section, problem);
    section->finish();
  }
}

/// [levels]; without it as many levels have rows as have states.
void read_levels(Section& root, Problem& problem) {
  problem.levels.every = problem.output.every;
  if (auto section = root.take_section("levels")) {
    if (const Entry* every = section->take("every")) {
      problem.levels.every = read_integer(every->value, "every", problem.parameters, 1);
    }
    section->finish();
  }
}

/// A misspelt table says more than a missing one, so that all names are looked at first.
void check_tables(Section root) {
  for (const std::string_view key : keys_of("")) {
    static_cast<void>(root.take(key));
  }
  root.finish();
}

/// [hamiltonian], [lagrangian], [multisymplectic] or [field], whichever is there.
void read_system(Section& root, Problem& problem) {
  std::optional<Section> found;
  const auto take = [&](std::string_view key) {
    auto section = root.take_section(key);
    if (section && found) {
      throw ProblemError(section->location(),
                         fmt::format("{} and [{}] in one problem; keep one of them", found->name(), key));
    }
    if (section) {
      found = std::move(section);
    }
  };
  take("hamiltonian");
  take("lagrangian");
  take("multisymplectic");
  take("field");
  if (!found) {
    throw ProblemError(
        root.location(),
        "there is none of [hamiltonian], [lagrangian], [multisymplectic] and [field]; `rubato show pendulum` "
        "prints a complete problem to start from");
  }
  if (found->name() == "[hamiltonian]") {
    read_hamiltonian(root, *found, problem);
  } else if (found->name() == "[lagrangian]") {
    read_lagrangian(root, *found, problem);
  } else if (found->name() == "[field]") {
    read_field(root, *found, problem);
  } else {
    read_multisymplectic(root, *found, problem);
  }
  if (problem.multisymplectic() != nullptr) {
    check_twists(problem);
  }
  if (const Entry* constraints = root.take("constraints"); constraints != nullptr && problem.hamiltonian() == nullptr) {
    throw ProblemError(constraints->location,
                       "[constraints] is for orbits ([hamiltonian] or [lagrangian]); a constraint "
                       "of a lattice is a row of S; leave it out");
  }
}

Problem read_effective(EffectiveDocument document, const std::string& source) {
  if (document.root.table()->empty()) {
    throw ProblemError(document.root.location,
                       "the file is empty; `rubato show pendulum` prints a complete problem to "
                       "start from");
  }
  Problem problem;
  problem.source = source;
  problem.name = std::filesystem::path(source).stem().string();
  problem.text = std::move(document.text);

  Section root(*document.root.table(), document.root.location, "");
  check_tables(root);
  const Entry* title = root.take("title");
  problem.title = title == nullptr ? problem.name : read_string(title->value, "title");
  read_system(root, problem);
  problem.scheme = read_scheme(root, problem);
  read_laws(root, problem);
  problem.accepted = read_accepted(root);
  read_output(root, problem);
  read_levels(root, problem);
  problem.events = read_events(root, problem);
  check_sponge(problem);
  problem.solve = read_solve(root, problem);
  check_constrained(problem);
  problem.ensemble = read_ensemble(root, problem.parameters);
  if (problem.ensemble) {
    problem.ensemble->common = without(problem.text, source, "ensemble");
  } else if (problem.scheme.frame && problem.scheme.frame->is_fitted()) {
    return read_effective(effective_document(problem.text, source, fitted_frame(problem)), source);
  }
  return problem;
}

}  // namespace

double Problem::start() const {
  const auto* ode = hamiltonian();
  return ode != nullptr ? ode->initial.t : multisymplectic()->start;
}

std::optional<std::size_t> Problem::clock() const {
  const auto* ode = hamiltonian();
  return ode != nullptr && !output.in_fictitious_time ? ode->clock() : std::nullopt;
}

double Problem::clock_start() const {
  const auto place = clock();
  return place ? hamiltonian()->initial.q[*place] : start();
}

formula::Expression Problem::build(const FormulaText& formula, formula::Graph& graph,
                                   std::span<const std::string> names,
                                   std::span<const std::string> differentiable) const {
  const auto* pde = multisymplectic();
  const auto axes = pde != nullptr ? pde->axis_names() : std::vector<std::string>();
  const auto periods = pde != nullptr ? std::span<const GridAxis>(pde->axes) : std::span<const GridAxis>();
  return build_formula(
      formula, graph, {.names = names, .differentiable = differentiable, .axes = axes, .periods = periods}, parameters);
}

formula::Expression Problem::build_quantity(const FormulaText& formula, formula::Graph& graph,
                                            std::span<const std::string> names,
                                            std::span<const std::string> differentiable,
                                            std::vector<formula::Expression>& integrands) const {
  const auto axes = multisymplectic()->axis_names();
  return build_formula(formula, graph,
                       {.names = names,
                        .differentiable = differentiable,
                        .axes = axes,
                        .integrands = &integrands,
                        .periods = multisymplectic()->axes},
                       parameters);
}

Problem parse_problem(std::string_view text, const std::string& source, std::span<const std::string> settings) {
  Problem problem = parse_recorded(text, source, settings);
  if (problem.scheme.outdated) {
    throw ProblemError(*problem.scheme.outdated,
                       "bridges are not available: with a step potential, which is the default, every step keeps the "
                       "energy; leave this out, or write on_singular = \"plain\" or \"stop\"");
  }
  return problem;
}

Problem parse_recorded(std::string_view text, const std::string& source, std::span<const std::string> settings) {
  return read_effective(effective_document(text, source, settings), source);
}

Problem member_problem(const Problem& problem, std::size_t member) {
  const Ensemble& ensemble = *problem.ensemble;
  std::vector<std::string> settings;
  for (std::size_t i = 0; i < ensemble.paths.size(); ++i) {
    settings.push_back(fmt::format("{}={}", ensemble.paths[i], ensemble.values[member][i]));
  }
  try {
    EffectiveDocument document = effective_document(ensemble.common, problem.source, settings);
    return read_effective(std::move(document), problem.source);
  } catch (const ProblemError& error) {
    throw ProblemError(ensemble.location,
                       fmt::format("member {} ({}): {}", member, ensemble.described(member), error.what()));
  }
}

Problem read_problem(const std::string& problem, std::span<const std::string> settings) {
  if (problem == "-") {
    return parse_problem(read_file("/dev/stdin").value_or(""), "stdin", settings);
  }
  std::error_code ignored;
  const bool is_folder = std::filesystem::is_directory(problem, ignored);
  if (!is_folder) {
    if (const auto text = read_file(problem)) {
      return parse_problem(*text, problem, settings);
    }
  }
  if (const auto entry = catalogue::find(problem)) {
    return parse_problem(entry->text, problem + ".toml (built-in)", settings);
  }
  throw ProblemError(
      {problem.empty() ? "\"\"" : problem, 0, 0},
      is_folder ? "this is a folder, not a problem file" : "there is no such file" + catalogue_suggestion(problem));
}

}  // namespace rubato
