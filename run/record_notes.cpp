#include <rubato/run/record_notes.hpp>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <tuple>

#include <fmt/format.h>

#include <rubato/base/limits.hpp>
#include <rubato/formula/bytecode.hpp>
#include <rubato/pde/law_evaluator.hpp>
#include <rubato/pde/multisymplectic_form.hpp>
#include <rubato/pde/placed_coordinates.hpp>
#include <rubato/problem/lattice_problem.hpp>
#include <rubato/problem/stored.hpp>

namespace rubato {

namespace {

constexpr double roundings = 4.0;

/// |f| + Σ |∂f/∂z_i| |z_i|.
class Magnitude {
public:
  Magnitude(formula::Expression f, const std::vector<formula::Expression>& variables) : size_(variables.size()) {
    std::vector<formula::Expression> outputs{f};
    std::ranges::copy(formula::gradient(f, variables), std::back_inserter(outputs));
    evaluator_ = formula::ScalarEvaluator(formula::Bytecode(outputs, variables));
  }

  double operator()(std::span<const double> z) {
    std::ranges::copy(z, evaluator_.inputs().begin());
    evaluator_.run();
    double sum = std::abs(evaluator_.output(0));
    for (std::size_t i = 0; i < size_; ++i) {
      sum += std::abs(evaluator_.output(1 + i) * z[i]);
    }
    return sum;
  }

private:
  std::size_t size_;
  formula::ScalarEvaluator evaluator_;
};

/// Stored levels that are looked at: the last of every sixteenth part, but not the first of all.
std::vector<std::size_t> sample(std::size_t rows) {
  constexpr std::size_t most = 16;
  std::vector<std::size_t> chosen;
  for (std::size_t i = 1; i <= std::min(most, rows - 1); ++i) {
    chosen.push_back(i * (rows - 1) / std::min(most, rows - 1));
  }
  return chosen;
}

/// The largest level seen of each dataset; what is not finite shows nothing.
class RecordedLevels {
public:
  void see(const std::string& dataset, double magnitude) {
    if (std::isfinite(magnitude) && magnitude > 0.0) {
      double& level = levels_[dataset];
      level = std::max(level, roundings * epsilon * magnitude);
    }
  }
  [[nodiscard]] std::map<std::string, double> take() { return std::move(levels_); }

private:
  std::map<std::string, double> levels_;
};

/// H, or q_dot·∂L/∂q_dot - L.
formula::Expression energy_formula(const Problem& problem, formula::Graph& graph) {
  const HamiltonianProblem& ode = *problem.hamiltonian();
  if (!ode.L) {
    return problem.build(ode.H, graph, ode.names());
  }
  const formula::Expression L = problem.build(*ode.L, graph, ode.lagrangian_names());
  formula::Expression energy = -L;
  for (const std::string& name : ode.q_dot) {
    const formula::Expression velocity = graph.variable(name);
    energy += velocity * formula::derivative(L, velocity);
  }
  return energy;
}

std::map<std::string, double> orbit_levels(const record::Reader& reader, const Problem& problem) {
  const HamiltonianProblem& ode = *problem.hamiltonian();
  formula::Graph graph;
  std::vector<formula::Expression> variables;
  const std::vector<std::string> names = ode.formula_names();
  for (const std::string& name : names) {
    variables.push_back(graph.variable(name));
  }
  Magnitude energy(energy_formula(problem, graph), variables);
  std::vector<std::pair<std::string, Magnitude>> invariants;
  for (const NamedFormula& invariant : ode.invariants) {
    invariants.emplace_back("/laws/" + invariant.name,
                            Magnitude(problem.build(invariant.formula, graph, names), variables));
  }
  RecordedLevels levels;
  for (const std::size_t row : sample(reader.rows("/states/t"))) {
    std::vector<double> z = reader.read("/states/q", row, 1);
    if (ode.L) {
      std::ranges::copy(reader.read("/states/q_dot", row, 1), std::back_inserter(z));
    }
    std::ranges::copy(reader.read("/states/p", row, 1), std::back_inserter(z));
    if (z.size() != variables.size()) {
      throw record::Error(reader.file(), "the states are not those of its problem");
    }
    const double size = energy(z);
    levels.see("/levels/energy", size);
    levels.see("/levels/node_energy", size);
    for (auto& [dataset, magnitude] : invariants) {
      levels.see(dataset, magnitude(z));
    }
  }
  return levels.take();
}

class LatticeLevels {
public:
  LatticeLevels(const Problem& problem, const MultisymplecticSystem& system)
      : tables_(system, make_grid(problem), make_lattice_options(problem, system).symmetries),
        S_(system.expression(), system.variables()),
        invariants_(make_invariants(problem, system, tables_.grid)),
        level_(make_initial_level(problem, system, tables_.grid)),
        problem_(problem),
        places_(system, tables_.grid, Within::node),
        z_(system.variables().size()) {}

  std::map<std::string, double> take(const record::Reader& reader) {
    const StoredLevels stored(reader, problem_);
    for (const std::size_t row : sample(stored.state_level.size())) {
      load(reader, row);
      see_laws(std::abs(stored.evolving_alone ? stored.h.back() : stored.state_t[row] - stored.t_before(row)));
      see_invariants(stored.state_t[row]);
    }
    return levels_.take();
  }

private:
  void load(const record::Reader& reader, std::size_t row) {
    InitialFields stored(static_cast<std::size_t>(level_.fields.fields()));
    for (int f = 0; f < level_.fields.fields(); ++f) {
      const std::string& name = tables_.system.fields()[static_cast<std::size_t>(f)];
      const bool at_midpoints = tables_.system.structure().at_midpoints(f);
      const std::string path = (at_midpoints ? "/states/midpoints/" : "/states/") + name;
      if (problem_.stores_evolving_alone() && !reader.has(path)) {
        continue;
      }
      std::vector<double> values = reader.read(path, row, 1);
      if (values.size() != tables_.grid.size()) {
        throw record::Error(reader.file(), "the states are not those of its problem");
      }
      std::ranges::copy(values, level_.fields.field(f).begin());
      stored[static_cast<std::size_t>(f)] = std::move(values);
    }
    WholeFields(make_jumps(problem_), tables_.grid, level_.fields.fields()).remove(level_.fields.all(), [&](int f) {
      return stored[static_cast<std::size_t>(f)].has_value();
    });
    for (int f = 0; f < level_.fields.fields(); ++f) {
      if (auto& values = stored[static_cast<std::size_t>(f)]) {
        std::ranges::copy(std::as_const(level_.fields).field(f), values->begin());
      }
    }
    if (!std::ranges::all_of(stored, [](const auto& values) { return values.has_value(); })) {
      level_ = make_method(problem_)->first_level(tables_.system, tables_.grid, stored).level;
    }
  }

  void see_invariants(double t) {
    const std::vector<std::vector<double>> densities = invariants_.at(level_, t);
    for (std::size_t i = 0; i < densities.size(); ++i) {
      double sum = 0.0;
      for (const double density : densities[i]) {
        sum += tables_.grid.cell_volume() * std::abs(density);
      }
      levels_.see("/laws/" + invariants_.names()[i], sum);
    }
  }

  void see_laws(double h) {
    std::vector<double> totals(tables_.names.size(), 0.0), largest(tables_.names.size(), 0.0);
    for (std::size_t node = 0; node < tables_.grid.size(); ++node) {
      const auto fields = static_cast<std::size_t>(level_.fields.fields());
      for (std::size_t f = 0; f < fields; ++f) {
        z_[f] = level_.fields.field(static_cast<int>(f))[node];
      }
      for (std::size_t c = 0; c < places_.count(); ++c) {
        z_[fields + c] = places_.value(c, node);
      }
      const std::vector<double> sizes = sizes_at_node(h);
      for (std::size_t law = 0; law < sizes.size(); ++law) {
        totals[law] += tables_.grid.cell_volume() * h * sizes[law];
        largest[law] = std::max(largest[law], sizes[law]);
      }
    }
    for (std::size_t law = 0; law < totals.size(); ++law) {
      const std::string& name = tables_.names[law];
      levels_.see("/laws/totals/" + name, totals[law]);
      for (const char* dataset : {"/laws/fields/{}", "/laws/{}_max", "/laws/{}_rms"}) {
        levels_.see(fmt::format(fmt::runtime(dataset), name), largest[law]);
      }
      if (law < static_cast<std::size_t>(tables_.directions)) {  // translations have variational laws, too
        levels_.see(fmt::format("/laws/variational_{}_max", name), largest[law]);
        levels_.see(fmt::format("/laws/variational_{}_rms", name), largest[law]);
      }
    }
    levels_.see("/levels/energy", totals.front());
    levels_.see("/levels/node_energy", totals.front());
  }

  /// Σ |z_i Λ_ij z_j|.
  [[nodiscard]] double quadratic(const MatrixTerms& terms) const {
    double sum = 0.0;
    for (const MatrixTerm& term : terms) {
      sum += std::abs(term.value * z_[static_cast<std::size_t>(term.row)] * z_[static_cast<std::size_t>(term.column)]);
    }
    return sum;
  }

  /// Of the divergence of each law.
  [[nodiscard]] std::vector<double> sizes_at_node(double h) {
    std::vector<double> sizes;
    std::vector<double> plus;
    for (const MatrixTerms& terms : tables_.plus) {
      plus.push_back(quadratic(terms));
    }
    const double S = S_(z_);
    const auto spacing = [&](int mu) { return tables_.spacing(mu, h); };
    for (int nu = 0; nu < tables_.directions; ++nu) {
      double size = S / spacing(nu);
      for (int mu = 0; mu < tables_.directions; ++mu) {
        size += mu == nu ? 0.0 : 2.0 * plus[static_cast<std::size_t>(mu)] / (spacing(mu) * spacing(nu));
      }
      sizes.push_back(size);
    }
    const auto add = [&](const auto& symmetries, const auto& current) {
      for (const std::vector<MatrixTerms>& terms : symmetries) {
        double size = 0.0;
        for (int mu = 0; mu < tables_.directions; ++mu) {
          size += current(terms[static_cast<std::size_t>(mu)]) / spacing(mu);
        }
        sizes.push_back(size);
      }
    };
    add(tables_.quadratic, [&](const MatrixTerms& terms) { return quadratic(terms); });
    add(tables_.linear, [&](const MatrixTerms& terms) {
      double sum = 0.0;
      for (const MatrixTerm& term : terms) {
        sum += std::abs(term.value * z_[static_cast<std::size_t>(term.column)]);
      }
      return sum;
    });
    return sizes;
  }

  LawTables tables_;
  Magnitude S_;
  NodeTable invariants_;
  LatticeLevel level_;
  const Problem& problem_;
  PlacedCoordinates places_;
  std::vector<double> z_;
  RecordedLevels levels_;
};

/// Whether S is c f²/2 + (what does not depend on f).
bool is_square_in(const MultisymplecticSystem& system, int f) {
  const auto varies = [f](const HessianEntry& entry) { return entry.row == f || entry.column == f; };
  const Eigen::MatrixXd& constant = system.constant_hessian();
  return std::ranges::none_of(system.varying_hessian(), varies) && constant(f, f) != 0.0 &&
         (constant.row(f).array() != 0.0).count() == 1;
}

std::vector<std::string> field_order(const Problem& problem, const MultisymplecticSystem& system) {
  const std::vector<NamedFormula>& exact = problem.multisymplectic()->exact;
  const FieldStructure& structure = system.structure();
  std::vector<int> order(static_cast<std::size_t>(system.field_count()));
  std::iota(order.begin(), order.end(), 0);
  std::ranges::stable_sort(order, {}, [&](int f) {
    const auto number = static_cast<std::size_t>(f);
    const bool has_exact = std::ranges::find(exact, system.fields()[number], &NamedFormula::name) != exact.end();
    return std::tuple(!has_exact, structure.at_midpoints(f), structure.algebraic[number] ? 1 : 0,
                      static_cast<bool>(structure.potential[number]), is_square_in(system, f));
  });
  std::vector<std::string> names;
  std::ranges::transform(order, std::back_inserter(names),
                         [&](int f) { return system.fields()[static_cast<std::size_t>(f)]; });
  return names;
}

std::vector<std::string> auxiliary_fields(const MultisymplecticProblem& pde) {
  std::vector<std::string> names;
  if (!pde.derived.empty()) {
    std::ranges::copy_if(pde.fields, std::back_inserter(names), [&](const std::string& name) {
      const auto derivative = derivative_named(name, pde.fields);
      return name.starts_with("multiplier_") || name.starts_with("potential_") ||
             (derivative && derivative->order[0] == 0);
    });
  }
  return names;
}

}  // namespace

RecordNotes notes_on(const record::Reader& reader) {
  const Problem problem = stored_problem(reader);
  if (problem.multisymplectic() == nullptr) {
    return {.fields = {}, .auxiliary = {}, .rounding = orbit_levels(reader, problem)};
  }
  const MultisymplecticSystem system = make_system(problem);
  return {.fields = field_order(problem, system),
          .auxiliary = auxiliary_fields(*problem.multisymplectic()),
          .rounding = LatticeLevels(problem, system).take(reader)};
}

}  // namespace rubato
