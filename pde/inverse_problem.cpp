#include <rubato/pde/inverse_problem.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <map>
#include <numeric>
#include <optional>
#include <random>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/Core>

#include <rubato/formula/branches.hpp>
#include <rubato/formula/sum.hpp>
#include <rubato/pde/antiderivative.hpp>
#include <rubato/pde/field_structure.hpp>
#include <rubato/pde/jet_polynomial.hpp>
#include <rubato/pde/polynomials.hpp>
#include <rubato/pde/random_points.hpp>
#include <rubato/solve/small_matrices.hpp>

namespace rubato {

namespace {

using formula::Expression;

class InverseProblem {
public:
  explicit InverseProblem(const FieldEquations& stated)
      : stated_(stated), graph_(*stated.graph), rows_(stated.equations.size()) {
    if (stated.equations.size() != stated.fields.size()) {
      throw std::invalid_argument(fmt::format("there are {} equations for {} fields ({}): give one for each",
                                              stated.equations.size(), stated.fields.size(),
                                              fmt::join(stated.fields, ", ")));
    }
    if (stated.fields.empty()) {
      throw std::invalid_argument("there is no equation with a derivative of a field, such as u_tt");
    }
    name_jets();
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      take_apart(stated.equations[i], rows_[i]);
    }
  }

  FieldDensity density() {
    damping_ = take_damping().value_or(0.0);
    if (auto found = undamped()) {
      return *std::move(found);
    }
    refuse();
  }

private:
  struct Row {
    JetPolynomial terms;             ///< with constant coefficients
    std::vector<Expression> others;  ///< terms without derivatives that are something else
  };

  /// u_tt + a u_t has the density of u_tt times exp(a t), if no other term is differentiated by t. Takes the term out.
  [[nodiscard]] std::optional<double> take_damping() {
    if (rows_.size() != 1) {
      return std::nullopt;
    }
    JetPolynomial& terms = rows_.front().terms;
    const auto first = terms.find({Jet{0, {1, 0, 0, 0}}}), second = terms.find({Jet{0, {2, 0, 0, 0}}});
    const auto moving = std::ranges::count_if(terms, [](const auto& entry) {
      return std::ranges::any_of(entry.first, [](const Jet& jet) { return jet.order[0] > 0; });
    });
    if (first == terms.end() || second == terms.end() || moving != 2) {
      return std::nullopt;
    }
    const double damping = first->second / second->second;
    terms.erase(first);
    return damping;
  }

  [[nodiscard]] std::optional<FieldDensity> undamped() {
    auto found = in_any_order(rows_, std::nullopt);
    for (std::size_t f = 0; f < rows_.size() && !found; ++f) {
      found = by_potential(f);
    }
    return found;
  }

  /// Rows are the equations of the fields in some order.
  [[nodiscard]] std::optional<FieldDensity> in_any_order(const std::vector<Row>& rows,
                                                         std::optional<std::size_t> potential) {
    std::vector<std::size_t> order(rows.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    do {
      std::vector<Row> of_fields;
      for (const std::size_t row : order) {
        of_fields.push_back(rows[row]);
      }
      if (auto found = directly(of_fields, potential)) {
        return found;
      }
    } while (std::ranges::next_permutation(order).found);
    return std::nullopt;
  }

  /// With field f as ∂_x of what is varied, one of the equations as it is or integrated by x.
  [[nodiscard]] std::optional<FieldDensity> by_potential(std::size_t f) {
    std::vector<Row> rows = rows_;
    for (Row& row : rows) {
      if (std::ranges::any_of(row.others, [&](Expression term) { return has(term, field(f)); })) {
        return std::nullopt;
      }
      row.terms = of_potential(row.terms, f);
    }
    if (auto found = in_any_order(rows, f)) {
      return found;
    }
    for (std::size_t r = 0; r < rows.size(); ++r) {
      const auto integral = rows[r].others.empty() ? integrated_by_x(rows[r].terms) : std::nullopt;
      if (!integral) {
        continue;
      }
      std::vector<Row> integrated = rows;
      integrated[r].terms = *integral;
      if (auto found = in_any_order(integrated, f)) {
        return found;
      }
    }
    return std::nullopt;
  }

  void name_jets() {
    for (std::size_t f = 0; f < stated_.fields.size(); ++f) {
      jets_.push_back({f, {}});
      number_.emplace(graph_.variable(stated_.fields[f]).index(), jets_.size() - 1);
    }
    for (const auto& [field, order, variable] : stated_.derivatives) {
      jets_.push_back({field, order});
      number_.emplace(variable.index(), jets_.size() - 1);
    }
  }

  void take_apart(Expression equation, Row& row) {
    for (const Expression term : formula::terms_of(equation, formula::Products::expanded)) {
      Polynomials polynomials(graph_, number_);
      const auto polynomial = polynomials(term);
      const bool is_constant =
          polynomial && std::ranges::all_of(*polynomial, [](const auto& entry) { return entry.second.is_constant(); });
      if (is_constant) {
        for (const auto& [monomial, coefficient] : *polynomial) {
          JetMonomial jets;
          for (const std::size_t i : monomial) {
            jets.push_back(jets_[i]);
          }
          add(row.terms, jets, coefficient.constant_value());
        }
        continue;
      }
      const std::vector<std::size_t> variables = formula::variables_of(term);
      for (const auto& [field, order, variable] : stated_.derivatives) {
        if (std::ranges::find(variables, graph_.node(variable.index()).a) != variables.end()) {
          throw std::invalid_argument(
              fmt::format("the term {} has derivatives, and is no polynomial with constant coefficients: state the "
                          "density, L or H, in place of the equation",
                          formula::to_string(term)));
        }
      }
      row.others.push_back(term);
    }
  }

  /// Row f as the equation of field f, which is the derivative of a potential if it is the one that is given.
  [[nodiscard]] std::optional<FieldDensity> directly(const std::vector<Row>& rows,
                                                     std::optional<std::size_t> potential) {
    std::vector<JetPolynomial> of_rows;  // Vainberg's formula for each of them
    for (std::size_t f = 0; f < rows.size(); ++f) {
      JetPolynomial& L = of_rows.emplace_back();
      for (const auto& [monomial, coefficient] : rows[f].terms) {
        JetMonomial with_u = monomial;
        with_u.push_back({f, {}});
        add(L, with_u, coefficient / static_cast<double>(monomial.size() + 1));
      }
    }
    const auto [factors, are_exact] = factors_of(rows, of_rows);
    JetPolynomial L;
    for (std::size_t f = 0; f < rows.size(); ++f) {
      add(L, of_rows[f], factors[f]);
    }
    if (!are_exact) {
      return std::nullopt;
    }
    const auto rest = potential_of(rows, factors, potential);
    if (!rest) {
      return std::nullopt;
    }
    const JetPolynomial low = reduced(L);
    return density_from(potential ? with_derivatives_of(low, *potential) : low, *rest, potential);
  }

  /// The factors a of the rows E with which Σ a_g L_g has the rows a_f E_f, L_g of E_g alone: linear equations, one for
  /// each monomial of each row.
  struct Factors {
    std::vector<double> values;
    bool are_exact = false;
  };
  [[nodiscard]] Factors factors_of(const std::vector<Row>& rows, const std::vector<JetPolynomial>& of_rows) const {
    const auto n = static_cast<Eigen::Index>(rows.size());
    std::vector<Eigen::VectorXd> equations;
    double size = 0.0;
    for (std::size_t f = 0; f < rows.size(); ++f) {
      std::map<JetMonomial, Eigen::VectorXd> by_monomial;
      const auto put = [&](const JetPolynomial& polynomial, std::size_t g, double factor) {
        for (const auto& [monomial, coefficient] : polynomial) {
          const auto place = by_monomial.try_emplace(monomial, Eigen::VectorXd::Zero(n)).first;
          place->second(static_cast<Eigen::Index>(g)) += factor * coefficient;
          size = std::max(size, std::abs(coefficient));
        }
      };
      for (std::size_t g = 0; g < rows.size(); ++g) {
        put(euler_operator(of_rows[g], f), g, 1.0);
      }
      put(rows[f].terms, f, -1.0);
      std::ranges::transform(by_monomial, std::back_inserter(equations),
                             &std::pair<const JetMonomial, Eigen::VectorXd>::second);
    }
    // The other terms have a potential: ∂(a_f g_f)/∂u_h = ∂(a_h g_h)/∂u_f.
    for (std::size_t f = 0; f < rows.size(); ++f) {
      for (std::size_t h = 0; h < f; ++h) {
        for (const auto& slopes : values_of({slope_of(rows[f], h), slope_of(rows[h], f)})) {
          Eigen::VectorXd& equation = equations.emplace_back(Eigen::VectorXd::Zero(n));
          equation(static_cast<Eigen::Index>(f)) = slopes[0];
          equation(static_cast<Eigen::Index>(h)) = -slopes[1];
          size = std::max({size, std::abs(slopes[0]), std::abs(slopes[1])});
        }
      }
    }
    Eigen::MatrixXd matrix = Eigen::MatrixXd::Zero(std::max<Eigen::Index>(n, std::ssize(equations)), n);
    for (std::size_t i = 0; i < equations.size(); ++i) {
      matrix.row(static_cast<Eigen::Index>(i)) = equations[i].transpose();
    }
    constexpr double rounding = 1e-12;
    const auto [values, vectors] = solve::singular_values(matrix);
    const Eigen::Index kernel = (values.array() <= rounding * size).count();
    // Equations that share nothing have a factor each; the first row of each is taken as it is.
    const Eigen::MatrixXd basis = kernel > 0 ? column_echelon(vectors.rightCols(kernel)) : vectors.rightCols(1);
    Eigen::VectorXd factors = basis.rowwise().sum();
    factors /= factors(0) != 0.0 ? factors(0) : 1.0;
    factors = factors.unaryExpr(&nearest_twelfth);
    return {{factors.begin(), factors.end()}, kernel > 0 && (factors.array() != 0.0).all()};
  }
  [[nodiscard]] Expression slope_of(const Row& row, std::size_t f) const {
    Expression sum = graph_.constant(0.0);
    for (const Expression term : row.others) {
      sum = sum + formula::derivative(term, field(f));
    }
    return sum;
  }

  /// V with ∂V/∂u_f, or ∂V/∂φ where u_f = φ_x, the sum of the other terms of row f times its factor, found field by
  /// field.
  [[nodiscard]] std::optional<Expression> potential_of(const std::vector<Row>& rows, const std::vector<double>& factors,
                                                       std::optional<std::size_t> potential) {
    const auto varied = [&](std::size_t f) { return f == potential ? graph_.variable(potential_name(f)) : field(f); };
    const Expression zero = graph_.constant(0.0);
    Expression V = zero;
    std::vector<Expression> before;
    for (std::size_t f = 0; f < rows.size(); ++f) {
      std::vector<Expression> parts;
      for (const Expression term : rows[f].others) {
        parts.push_back(factors[f] * term);
      }
      if (has(V, varied(f))) {
        parts.push_back(-formula::derivative(V, varied(f)));
      }
      if (!vanishes(parts)) {
        // What V lacks depends on no field before this one.
        for (const Expression part :
             formula::substitute(parts, graph_, before, std::vector<Expression>(before.size(), zero))) {
          const auto integral = antiderivative(part, varied(f));
          if (!integral) {
            without_integral_ = formula::to_string(part);
            return std::nullopt;
          }
          // 0 at u = 0, where that is a number: 1 - cos(u).
          const Expression at_zero =
              formula::substitute(std::array{*integral}, graph_, std::array{varied(f)}, std::array{zero}).front();
          V = V + (at_zero.is_constant() && std::isfinite(at_zero.constant_value()) ? *integral - at_zero : *integral);
        }
      }
      before.push_back(varied(f));
    }
    return V;
  }
  /// Values of formulas, on other branches, at random points where all of them are finite.
  [[nodiscard]] static std::vector<std::vector<double>> values_of(const std::vector<Expression>& all) {
    std::vector<std::vector<double>> found;
    for (formula::ScalarEvaluator& evaluate : formula::evaluators_on_branches(all)) {
      std::mt19937_64 random(20);
      std::uniform_real_distribution<double> value(0.1, 1.4);
      std::vector<double> point(evaluate.code().input_count()), values(all.size());
      constexpr int points = 20;
      for (int n = 0; n < points; ++n) {
        std::ranges::generate(point, [&] { return value(random); });
        evaluate(point, values);
        if (std::ranges::all_of(values, [](double v) { return std::isfinite(v); })) {
          found.push_back(values);
        }
      }
    }
    return found;
  }
  [[nodiscard]] static bool vanishes(const std::vector<Expression>& parts) {
    constexpr double rounding = 1e-11;
    const std::vector<std::vector<double>> found = values_of(parts);
    return !found.empty() && std::ranges::all_of(found, [](const std::vector<double>& values) {
      double sum = 0.0, size = 0.0;
      for (const double v : values) {
        sum += v;
        size += std::abs(v);
      }
      return std::abs(sum) <= rounding * size;
    });
  }
  [[nodiscard]] std::string potential_name(std::size_t f) const { return "potential_" + stated_.fields[f]; }
  [[nodiscard]] Expression field(std::size_t f) const { return graph_.variable(stated_.fields[f]); }
  [[nodiscard]] bool has(Expression e, Expression u) const {
    const std::vector<std::size_t> variables = formula::variables_of(e);
    return std::ranges::find(variables, graph_.node(u.index()).a) != variables.end();
  }

  /// The density with the sign that is wanted. A field that is ∂_x of what is varied has that as another field, its
  /// potential.
  [[nodiscard]] FieldDensity density_from(const JetPolynomial& L, Expression rest,
                                          std::optional<std::size_t> potential) {
    FieldDensity density;
    density.graph = stated_.graph;
    density.fields = stated_.fields;
    density.dimensions = stated_.dimensions;
    if (potential) {
      density.potentials.push_back({*potential, density.fields.size()});
      density.fields.push_back(potential_name(*potential));
    }
    const double sign = sign_of(L, potential.has_value());
    std::map<Jet, Expression> named;
    Expression sum = sign * rest;
    if (damping_ != 0.0) {
      sum = scale(density, sum);
    }
    for (const auto& [monomial, coefficient] : damping_ != 0.0 ? scaled(L) : L) {
      Expression product = graph_.constant(sign * coefficient);
      if (damping_ != 0.0 && monomial.size() != 2) {
        product = product * exp(damping_ * (1.0 - static_cast<double>(monomial.size()) / 2.0) * graph_.variable("t"));
      }
      for (auto from = monomial.begin(); from != monomial.end();) {
        const auto to = std::upper_bound(from, monomial.end(), *from);
        Jet jet = *from;
        if (potential == jet.field && jet.order[1] > 0) {
          jet = shifted(jet, 1, -1);
        } else if (potential == jet.field) {
          jet.field = density.potentials.front().potential;
        }
        product = product * pow(variable_of(jet, density, named), static_cast<double>(to - from));
        from = to;
      }
      sum = sum + product;
    }
    density.L = sum;
    return density;
  }
  /// Makes the density one of w = exp(at/2) u. \return exp(at) times the rest of L, of w
  [[nodiscard]] Expression scale(FieldDensity& density, Expression rest) {
    const Expression t = graph_.variable("t"), u = field(0);
    density.damping = damping_;
    density.fields.front() = "scaled_" + stated_.fields.front();
    const Expression w = graph_.variable(density.fields.front());
    return exp(damping_ * t) *
           formula::substitute(std::array{rest}, graph_, std::array{u}, std::array{exp(-0.5 * damping_ * t) * w})
               .front();
  }
  /// exp(at) u_t² is (w_t - aw/2)², which is w_t² + a²w²/4 but for a derivative by t.
  [[nodiscard]] JetPolynomial scaled(const JetPolynomial& L) const {
    JetPolynomial result = L;
    const auto square = L.find({Jet{0, {1, 0, 0, 0}}, Jet{0, {1, 0, 0, 0}}});
    if (square != L.end()) {
      add(result, JetMonomial{Jet{0, {}}, Jet{0, {}}}, 0.25 * damping_ * damping_ * square->second);
    }
    return result;
  }
  [[nodiscard]] Expression variable_of(const Jet& jet, FieldDensity& density, std::map<Jet, Expression>& named) {
    if (total(jet) == 0) {
      return graph_.variable(density.fields[jet.field]);
    }
    const auto found = named.find(jet);
    if (found != named.end()) {
      return found->second;
    }
    const Expression variable = graph_.variable(derivative_name(density.fields[jet.field], jet.order));
    density.derivatives.push_back({jet.field, jet.order, variable});
    return named.emplace(jet, variable).first->second;
  }
  /// Squares u_t² are positive; where there are none, the squares of the highest derivatives by x are negative.
  [[nodiscard]] static double sign_of(const JetPolynomial& L, bool of_potential) {
    double by_t = 0.0, by_x = 0.0;
    int highest = of_potential ? 1 : 0;
    for (const auto& [monomial, coefficient] : L) {
      if (monomial.size() != 2 || monomial[0] != monomial[1]) {
        continue;
      }
      const Jet& jet = monomial.front();
      if (jet.order[0] > 0) {
        by_t += coefficient;
      } else if (total(jet) > highest) {
        highest = total(jet);
        by_x = coefficient;
      } else if (total(jet) == highest) {
        by_x += coefficient;
      }
    }
    return by_t != 0.0 ? (by_t > 0.0 ? 1.0 : -1.0) : by_x > 0.0 ? -1.0 : 1.0;
  }

  [[nodiscard]] std::string text_of(const JetMonomial& monomial, double coefficient = 1.0) const {
    std::vector<std::string> factors;
    if (coefficient != 1.0) {
      factors.push_back(fmt::format("{:g}", coefficient));
    }
    for (const Jet& jet : monomial) {
      factors.push_back(total(jet) == 0 ? stated_.fields[jet.field]
                                        : derivative_name(stated_.fields[jet.field], jet.order));
    }
    return fmt::format("{}", fmt::join(factors, "*"));
  }
  /// Of a single equation of first order in time a linear term whose order in space is even, or as odd as that of the
  /// derivative by t: u_xx beside u_t, u_xxx beside u_xt; or none.
  [[nodiscard]] std::string even_derivative() const {
    std::optional<int> moving;
    for (const auto& [monomial, coefficient] : rows_.front().terms) {
      for (const Jet& jet : monomial) {
        if (jet.order[0] > 1) {
          return "";
        }
        if (jet.order[0] == 1 && monomial.size() == 1) {
          moving = total(jet) - 1;
        }
      }
    }
    for (const auto& [monomial, coefficient] : rows_.front().terms) {
      const int order = total(monomial.front());
      if (moving && monomial.size() == 1 && monomial.front().order[0] == 0 && order > *moving &&
          (order - *moving) % 2 == 0) {
        return text_of(monomial);
      }
    }
    return "";
  }
  [[noreturn]] void refuse() const {
    if (!without_integral_.empty()) {
      throw std::invalid_argument(
          fmt::format("{} has no integral in closed form here: state the density, L or H", without_integral_));
    }
    if (const std::string dissipation = rows_.size() == 1 ? even_derivative() : ""; !dissipation.empty()) {
      throw std::invalid_argument(fmt::format(
          "{0} beside a first derivative by t is diffusion (or growth): no action in {1} or a potential of it has "
          "that, whatever factor of t it is given. An odd derivative in its place, or a second one by t, has an action",
          dissipation, stated_.fields.front()));
    }
    throw std::invalid_argument(fmt::format(
        "no Lagrangian was found: none of these fields, none of a potential of one of them, and none with a factor "
        "exp(a t), which is tried for one equation with u_tt + a u_t: {}{}",
        culprit(), remedy()));
  }
  /// The term, or one of each of two equations, without which the rest has a density; rather not differentiated by t.
  [[nodiscard]] std::string culprit() const {
    struct Term {
      std::size_t row = 0;
      std::optional<JetMonomial> monomial;
      std::size_t other = 0;
      std::string text;
    };
    std::vector<Term> terms, moving;
    for (std::size_t r = 0; r < rows_.size(); ++r) {
      for (const auto& [monomial, coefficient] : rows_[r].terms) {
        const bool moves = std::ranges::any_of(monomial, [](const Jet& jet) { return jet.order[0] > 0; });
        (moves ? moving : terms).push_back({r, monomial, 0, text_of(monomial, std::abs(coefficient))});
      }
      for (std::size_t i = 0; i < rows_[r].others.size(); ++i) {
        terms.push_back({r, std::nullopt, i, formula::to_string(rows_[r].others[i])});
      }
    }
    terms.insert(terms.end(), moving.begin(), moving.end());
    const auto drop = [](InverseProblem& problem, const Term& term) {
      Row& row = problem.rows_[term.row];
      if (term.monomial) {
        row.terms.erase(*term.monomial);
      } else {
        row.others.erase(row.others.begin() + static_cast<std::ptrdiff_t>(term.other));
      }
    };
    constexpr std::size_t most_rows = 4, most_of_pairs = 2;  // n! orders of the equations are tried for each
    if (rows_.size() > most_rows) {
      return "no density has all of these terms";
    }
    for (const Term& term : terms) {
      InverseProblem rest = *this;
      drop(rest, term);
      if (rest.undamped()) {
        return fmt::format("no density has the term {}, without which the rest has one", term.text);
      }
    }
    for (const Term& term : terms) {
      for (const Term& other : terms) {
        InverseProblem rest = *this;
        if (rows_.size() <= most_of_pairs && term.row < other.row &&
            (drop(rest, term), drop(rest, other), rest.undamped())) {
          return fmt::format("no density has the terms {} and {}, without which the rest has one", term.text,
                             other.text);
        }
      }
    }
    return "no density has all of these terms, nor all but one";
  }
  /// Equations of first order in time may have a Hamiltonian all the same.
  [[nodiscard]] std::string remedy() const {
    const bool are_first = std::ranges::all_of(rows_, [](const Row& row) {
      int highest = 0;
      for (const auto& [monomial, coefficient] : row.terms) {
        for (const Jet& jet : monomial) {
          highest = std::max(highest, jet.order[0]);
        }
      }
      return highest == 1;
    });
    return are_first ? ". If they are u_t = D(dH/du), give H and the operator D as structure, such as \"dx\"" : "";
  }

  const FieldEquations& stated_;
  formula::Graph& graph_;
  std::vector<Jet> jets_;
  std::map<formula::NodeIndex, std::size_t> number_;
  std::vector<Row> rows_;
  double damping_ = 0.0;
  std::string without_integral_;
};

}  // namespace

FieldDensity density_of(const FieldEquations& equations) {
  return InverseProblem(equations).density();
}

}  // namespace rubato
