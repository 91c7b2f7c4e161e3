#include <algorithm>
#include <cmath>
#include <memory>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/formula/parse.hpp>
#include <rubato/pde/linear_symmetries.hpp>
#include <rubato/problem/keys.hpp>
#include <rubato/problem/reader.hpp>
#include <rubato/variation/random_values.hpp>

namespace rubato {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;

/// The generators z' = X(z) of symmetries of an orbit, and their momentum maps J, dJ = X_q dp - X_p dq.
class SymmetryReader {
public:
  SymmetryReader(HamiltonianProblem& orbit, const Parameters& parameters)
      : orbit_(orbit),
        parameters_(parameters),
        names_(orbit.names()),
        n_(orbit.q.size()),
        pairs_(n_ - (orbit.fictitious_time || orbit.driven ? 1 : 0)) {}

  void read(Section& section) {
    bool find = false;
    Location place;
    for (const Entry& entry : Value::Table(section.entries())) {
      const Entry& taken = *section.take(entry.key);
      if (entry.key == "find") {
        find = read_boolean(taken.value, "find");
        place = taken.location;
      } else {
        read_generator(taken);
      }
    }
    section.finish();
    if (find) {
      find_linear(place);
    }
  }

private:
  void read_generator(const Entry& entry) {
    if (!is_identifier(entry.key)) {
      refuse_name(entry, "a symmetry", malformed_name);
    }
    if (!is_free(entry.key)) {
      throw ProblemError(entry.location,
                         fmt::format("{} is an entry of [invariants], too: its momentum map is reported "
                                     "under that name; rename one of them",
                                     entry.key));
    }
    if (entry.value.table() == nullptr) {
      throw ProblemError(
          entry.value.location,
          fmt::format("{} has to be a generator, such as {} = {{ x = \"-y\", y = \"x\" }}", entry.key, entry.key));
    }
    std::vector<FormulaText> components(2 * n_, FormulaText{"0", entry.value.location});
    bool of_momenta = false;
    for (const Entry& component : *entry.value.table()) {
      const auto found = std::ranges::find(names_, component.key);
      const auto place = static_cast<std::size_t>(found - names_.begin());
      if (found == names_.end() || place % n_ >= pairs_) {
        const auto nearest = formula::nearest_name(component.key, names_);
        throw ProblemError(component.location,
                           fmt::format("{} is no coordinate or momentum of the problem{}", component.key,
                                       nearest ? fmt::format("; did you mean {}?", *nearest) : ""));
      }
      components[place] = read_formula(component.value, component.key);
      of_momenta = of_momenta || place >= n_;
    }
    if (std::ranges::all_of(components, [](const FormulaText& X) { return X.text == "0"; })) {
      throw ProblemError(entry.value.location,
                         fmt::format("{0} moves nothing: write the rates of what it moves, as {0} = {{ {1} = \"1\" }}",
                                     entry.key, names_.front()));
    }
    of_momenta ? add_linear(entry, components) : add_lifted(entry, components);
  }

  /// X on coordinates, lifted to momenta: J = Σ p_i X_i(q).
  void add_lifted(const Entry& entry, const std::vector<FormulaText>& components) {
    std::string text;
    for (std::size_t i = 0; i < n_; ++i) {
      check_formula(components[i], {orbit_.q}, parameters_);
      if (components[i].text != "0") {
        text += fmt::format("{}{}*({})", text.empty() ? "" : " + ", orbit_.p[i], components[i].text);
      }
    }
    add(entry.key, text, entry.value.location);
  }

  /// X(z) = Bz + b on both: J = ½(p·(X_q + b_q) - q·(X_p + b_p)), where the form of B and dp∧dq is symmetric.
  void add_linear(const Entry& entry, const std::vector<FormulaText>& components) {
    formula::Graph graph;
    std::vector<formula::Expression> variables, X;
    for (const std::string& name : names_) {
      variables.push_back(graph.variable(name));
    }
    MatrixXd B(static_cast<Index>(2 * n_), static_cast<Index>(2 * n_));
    for (std::size_t i = 0; i < 2 * n_; ++i) {
      X.push_back(build_formula(components[i], graph, {names_}, parameters_));
      if (!formula::hessian_entries(X[i], variables).empty()) {
        throw ProblemError(components[i].location,
                           fmt::format("{} gives momenta, too, and then has to be linear: {} is not. Leave the momenta "
                                       "out: they are moved as the coordinates say",
                                       entry.key, components[i].text));
      }
    }
    const auto at_zero = [](std::size_t) { return 0.0; };
    const std::vector<double> b = values_at(X, at_zero);
    for (std::size_t i = 0; i < 2 * n_; ++i) {
      const std::vector<double> row = values_at(formula::gradient(X[i], variables), at_zero);
      B.row(static_cast<Index>(i)) = Eigen::Map<const Eigen::RowVectorXd>(row.data(), B.cols());
    }
    const auto n = static_cast<Index>(n_);
    MatrixXd form(2 * n, 2 * n);  // of J: ∇J = (-X_p, X_q)
    form.topRows(n) = -B.bottomRows(n);
    form.bottomRows(n) = B.topRows(n);
    const double size = std::max(form.cwiseAbs().maxCoeff(), 1e-300);
    for (Index i = 0; i < 2 * n; ++i) {
      for (Index j = 0; j < i; ++j) {
        if (std::abs(form(i, j) - form(j, i)) > 1e-12 * size) {
          throw ProblemError(
              entry.value.location,
              fmt::format("{} is no canonical motion: the derivatives of its components by {} and {} do not fit "
                          "together, so that it has no momentum map. Leave the momenta out: they are moved as the "
                          "coordinates say",
                          entry.key, names_[static_cast<std::size_t>(i)], names_[static_cast<std::size_t>(j)]));
        }
      }
    }
    std::string text;
    for (std::size_t i = 0; i < n_; ++i) {
      for (const auto& [name, at, sign] : {std::tuple(orbit_.p[i], i, "+"), std::tuple(orbit_.q[i], n_ + i, "-")}) {
        if (components[at].text != "0") {
          text += fmt::format(" {} 0.5*{}*(({}) + {:.17g})", sign, name, components[at].text, b[at]);
        }
      }
    }
    add(entry.key, "0" + text, entry.value.location);
  }

  /// All linear symmetries of H beside those that are stated and its own flow, as linear_1, linear_2 …
  void find_linear(const Location& place) {
    constexpr std::size_t most_pairs = MultisymplecticSystem::most_fields / 2;
    if (orbit_.L || pairs_ != n_ || n_ > most_pairs) {
      throw ProblemError(place,
                         fmt::format("linear symmetries are found of an H that does not name t, without "
                                     "time_scale and with at most {} coordinates: leave find out, and state them",
                                     most_pairs));
    }
    // M z' = ∇H with M = J⁻¹: an equation without space.
    auto graph = std::make_shared<formula::Graph>();
    const formula::Expression H = build_formula(orbit_.H, *graph, {names_}, parameters_);
    const auto n = static_cast<Index>(n_);
    MatrixXd M = MatrixXd::Zero(2 * n, 2 * n);
    M.topRightCorner(n, n) = -MatrixXd::Identity(n, n);
    M.bottomLeftCorner(n, n).setIdentity();
    const MultisymplecticSystem system(graph, names_, M, {MatrixXd::Zero(2 * n, 2 * n)}, H);
    std::vector<MatrixXd> known = stated_;
    if (const auto own = own_flow(H)) {
      known.push_back(*own);
    }
    std::size_t number = 0;
    for (const MatrixXd& B : LinearSymmetries(system).beside(known)) {
      const MatrixXd form = M * B;  // ∇J = MBz
      std::string text;
      for (Index i = 0; i < 2 * n; ++i) {
        for (Index j = 0; j <= i; ++j) {
          if (const double factor = form(i, j) * (i == j ? 0.5 : 1.0); factor != 0.0) {
            text += fmt::format("{}{:.17g}*{}*{}", text.empty() ? "" : " + ", factor,
                                names_[static_cast<std::size_t>(j)], names_[static_cast<std::size_t>(i)]);
          }
        }
      }
      std::string name;
      do {
        name = fmt::format("linear_{}", ++number);
      } while (!is_free(name));
      add(name, text.empty() ? "0" : text, place);
    }
  }

  /// B of z' = J∇H, where that is linear.
  [[nodiscard]] std::optional<MatrixXd> own_flow(formula::Expression H) const {
    std::vector<formula::Expression> variables;
    for (const std::string& name : names_) {
      variables.push_back(H.graph()->variable(name));
    }
    const auto n = static_cast<Index>(n_);
    MatrixXd second = MatrixXd::Zero(2 * n, 2 * n);
    for (const formula::HessianEntry& entry : formula::hessian_entries(H, variables)) {
      if (!entry.value.is_constant()) {
        return std::nullopt;
      }
      const auto row = static_cast<Index>(entry.row), column = static_cast<Index>(entry.column);
      second(row, column) = second(column, row) = entry.value.constant_value();
    }
    MatrixXd B(2 * n, 2 * n);
    B.topRows(n) = second.bottomRows(n);
    B.bottomRows(n) = -second.topRows(n);
    return B;
  }

  [[nodiscard]] bool is_free(std::string_view name) const {
    return std::ranges::find(orbit_.invariants, name, &NamedFormula::name) == orbit_.invariants.end();
  }
  void add(const std::string& name, const std::string& momentum_map, const Location& place) {
    orbit_.invariants.push_back({name, {momentum_map, place}});
    orbit_.symmetries.push_back(name);
    remember(momentum_map);
  }
  /// The quadratic ones, of which what is found is not to be a combination.
  void remember(const std::string& momentum_map) {
    formula::Graph graph;
    const formula::Expression J = build_formula({momentum_map, {}}, graph, {names_}, parameters_);
    std::vector<formula::Expression> variables;
    for (const std::string& name : names_) {
      variables.push_back(graph.variable(name));
    }
    if (const auto B = own_flow(J)) {
      stated_.push_back(*B);
    }
  }

  HamiltonianProblem& orbit_;
  const Parameters& parameters_;
  std::vector<std::string> names_;
  std::size_t n_, pairs_;  ///< pairs_: without that of the time
  std::vector<MatrixXd> stated_;
};

}  // namespace

void read_orbit_symmetries(Section& root, HamiltonianProblem& orbit, const Parameters& parameters) {
  if (auto section = root.take_section("symmetries")) {
    SymmetryReader(orbit, parameters).read(*section);
  }
}

}  // namespace rubato
