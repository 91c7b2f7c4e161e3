#include <rubato/pde/inverse_problem.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <map>
#include <numeric>
#include <optional>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/SVD>

#include <rubato/formula/sum.hpp>
#include <rubato/pde/field_structure.hpp>
#include <rubato/pde/polynomials.hpp>

namespace rubato {

namespace {

using formula::Expression;
using formula::Operation;

/// A field or a derivative of one.
struct Jet {
  std::size_t field = 0;
  DerivativeOrder order = {};
  auto operator<=>(const Jet&) const = default;
};
using JetMonomial = std::vector<Jet>;  ///< ascending, with repetitions
using JetPolynomial = std::map<JetMonomial, double>;

int total(const Jet& jet) {
  return total_order(jet.order);
}

void add(JetPolynomial& sum, JetMonomial monomial, double coefficient) {
  std::ranges::sort(monomial);
  double& place = sum[monomial];
  place += coefficient;
  constexpr double rounding = 1e-13;  // of coefficients that cancel
  if (std::abs(place) <= rounding * std::abs(coefficient)) {
    sum.erase(monomial);
  }
}
void add(JetPolynomial& sum, const JetPolynomial& other, double factor) {
  for (const auto& [monomial, coefficient] : other) {
    add(sum, monomial, factor * coefficient);
  }
}

Jet shifted(Jet jet, std::size_t mu, int by = 1) {
  jet.order.at(mu) += by;
  return jet;
}

/// D_mu of a polynomial.
JetPolynomial differentiated(const JetPolynomial& polynomial, std::size_t mu) {
  JetPolynomial result;
  for (const auto& [monomial, coefficient] : polynomial) {
    for (std::size_t i = 0; i < monomial.size(); ++i) {
      JetMonomial moved = monomial;
      moved[i] = shifted(moved[i], mu);
      add(result, moved, coefficient);
    }
  }
  return result;
}

/// δL/δu of a field: Σ_J (-D)^J ∂L/∂u_J.
JetPolynomial euler_operator(const JetPolynomial& L, std::size_t field) {
  std::map<DerivativeOrder, JetPolynomial> partial;
  for (const auto& [monomial, coefficient] : L) {
    for (std::size_t i = 0; i < monomial.size(); ++i) {
      if (monomial[i].field == field) {
        JetMonomial rest = monomial;
        rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(i));
        add(partial[monomial[i].order], rest, coefficient);
      }
    }
  }
  JetPolynomial sum;
  for (auto& [order, polynomial] : partial) {
    double sign = 1.0;
    for (std::size_t mu = 0; mu < order.size(); ++mu) {
      for (int n = 0; n < order[mu]; ++n) {
        polynomial = differentiated(polynomial, mu);
        sign = -sign;
      }
    }
    add(sum, polynomial, sign);
  }
  return sum;
}

/// The direction by which one differentiates more often than the other by most: φ φ_xxyy is to become (φ_xy)², not
/// φ_xx φ_yy, whose derivatives need twice the fields. Of equal ones the last of x, y, z, and t before these.
std::size_t most_apart(const DerivativeOrder& more, const DerivativeOrder& less) {
  std::size_t found = last_direction(more);
  for (std::size_t mu = more.size(); mu-- > 0;) {
    if (more.at(mu) - less.at(mu) > more.at(found) - less.at(found)) {
      found = mu;
    }
  }
  return found;
}

/// The same density with derivatives moved by parts: of two factors to both alike; of more, one that occurs once is
/// taken off where it is the highest.
JetPolynomial reduced(const JetPolynomial& L) {
  JetPolynomial left = L, result;
  while (!left.empty()) {
    const auto [monomial, coefficient] = *left.begin();
    left.erase(left.begin());
    const auto highest = std::ranges::max_element(monomial, {}, total);
    const bool is_high = highest != monomial.end() && total(*highest) >= 2;
    if (is_high && monomial.size() == 2) {
      const Jet other = monomial[highest == monomial.begin() ? 1 : 0];
      if (total(*highest) - total(other) >= 2) {
        const std::size_t mu = most_apart(highest->order, other.order);
        add(left, JetMonomial{shifted(*highest, mu, -1), shifted(other, mu)}, -coefficient);
        continue;
      }
    } else if (is_high && monomial.size() > 2) {
      const std::size_t mu = last_direction(highest->order);
      const Jet lower = shifted(*highest, mu, -1);
      const auto stays = std::ranges::count_if(monomial, [&](const Jet& jet) {  // as high as it would get by this
        return jet != lower && total(jet) + 1 >= total(*highest);
      });
      if (stays > 1) {  // beside the highest itself
        add(result, monomial, coefficient);
        continue;
      }
      JetMonomial others;
      int power = 0;
      for (const Jet& jet : monomial) {
        power += jet == lower ? 1 : 0;
        if (jet != lower && jet != *highest) {
          others.push_back(jet);
        }
      }
      // c lower^k D(lower) others = D(c lower^(k+1)/(k+1) others) - c lower^(k+1)/(k+1) D(others).
      for (const auto& [moved, factor] : differentiated(JetPolynomial{{others, 1.0}}, mu)) {
        JetMonomial whole = moved;
        whole.insert(whole.end(), static_cast<std::size_t>(power) + 1, lower);
        add(left, whole, -coefficient * factor / (power + 1));
      }
      continue;
    }
    add(result, monomial, coefficient);
  }
  return result;
}

/// G with D_x G = polynomial, if there is one.
std::optional<JetPolynomial> integrated_by_x(JetPolynomial polynomial) {
  JetPolynomial G;
  constexpr int most_terms = 1000;
  for (int n = 0; n < most_terms && !polynomial.empty(); ++n) {
    const auto order_by_x = [](const Jet& jet) { return jet.order[1]; };
    const auto highest_of = [&](const auto& entry) {
      return entry.first.empty() ? -1 : order_by_x(*std::ranges::max_element(entry.first, {}, order_by_x));
    };
    const auto [monomial, coefficient] = *std::ranges::max_element(polynomial, {}, highest_of);
    const auto highest = std::ranges::max_element(monomial, {}, order_by_x);
    if (monomial.empty() || order_by_x(*highest) < 1 ||
        std::ranges::count(monomial, order_by_x(*highest), order_by_x) != 1) {
      return std::nullopt;
    }
    const Jet lower = shifted(*highest, 1, -1);
    JetMonomial whole = monomial;
    std::erase(whole, *highest);
    const auto power = std::ranges::count(whole, lower);
    whole.push_back(lower);
    JetPolynomial term;
    add(term, whole, coefficient / static_cast<double>(power + 1));
    add(G, term, 1.0);
    add(polynomial, differentiated(term, 1), -1.0);
  }
  return polynomial.empty() ? std::optional(G) : std::nullopt;
}

/// The same polynomial of the potential of a field, u = φ_x.
JetPolynomial of_potential(const JetPolynomial& polynomial, std::size_t field) {
  JetPolynomial result;
  for (const auto& [monomial, coefficient] : polynomial) {
    JetMonomial moved = monomial;
    std::ranges::transform(moved, moved.begin(),
                           [field](const Jet& jet) { return jet.field == field ? shifted(jet, 1) : jet; });
    add(result, moved, coefficient);
  }
  return result;
}

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
    return undamped();
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

  FieldDensity undamped() {
    if (auto found = in_any_order(rows_, std::nullopt)) {
      return *std::move(found);
    }
    for (std::size_t f = 0; f < rows_.size(); ++f) {
      if (auto found = by_potential(f)) {
        return *std::move(found);
      }
    }
    refuse();
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
      for (std::size_t f = 0; f < rows.size() && !potential; ++f) {
        JetPolynomial difference = euler_operator(L, f);
        add(difference, rows[f].terms, -factors[f]);
        remember(without_rounding(std::move(difference)));
      }
      return std::nullopt;
    }
    Expression rest = graph_.constant(0.0);
    for (std::size_t f = 0; f < rows.size(); ++f) {
      for (const Expression term : rows[f].others) {
        const auto integral = antiderivative(term, f);
        if (!integral) {
          return std::nullopt;
        }
        rest = rest + factors[f] * *integral;
      }
    }
    return density_from(reduced(L), rest, potential);
  }

  /// The factors a of the rows E with which Σ a_g L_g has the rows a_f E_f, L_g of E_g alone: linear equations, one for
  /// each monomial of each row. If they have no solution without zeros, those that come nearest to one.
  struct Factors {
    std::vector<double> values;
    bool are_exact = false;
  };
  [[nodiscard]] static Factors factors_of(const std::vector<Row>& rows, const std::vector<JetPolynomial>& of_rows) {
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
    Eigen::MatrixXd matrix = Eigen::MatrixXd::Zero(std::max<Eigen::Index>(n, std::ssize(equations)), n);
    for (std::size_t i = 0; i < equations.size(); ++i) {
      matrix.row(static_cast<Eigen::Index>(i)) = equations[i].transpose();
    }
    constexpr double rounding = 1e-12;
    const Eigen::JacobiSVD<Eigen::MatrixXd> svd(matrix, Eigen::ComputeFullV);
    const Eigen::Index kernel = (svd.singularValues().array() <= rounding * size).count();
    // Equations that share nothing have a factor each; the first row of each is taken as it is.
    const Eigen::MatrixXd basis =
        kernel > 0 ? column_echelon(svd.matrixV().rightCols(kernel)) : svd.matrixV().rightCols(1);
    Eigen::VectorXd factors = basis.rowwise().sum();
    factors /= factors(0) != 0.0 ? factors(0) : 1.0;
    return {{factors.begin(), factors.end()}, kernel > 0 && (factors.array() != 0.0).all()};
  }
  [[nodiscard]] static JetPolynomial without_rounding(JetPolynomial difference) {
    constexpr double rounding = 1e-12;
    double size = 0.0;
    for (const auto& [monomial, coefficient] : difference) {
      size = std::max(size, std::abs(coefficient));
    }
    std::erase_if(difference, [&](const auto& entry) { return std::abs(entry.second) <= rounding * size; });
    return difference;
  }

  /// ∫ term du_f, of a term that depends on no other field.
  [[nodiscard]] std::optional<Expression> antiderivative(Expression term, std::size_t f) {
    const Expression u = graph_.variable(stated_.fields[f]);
    const std::vector<std::size_t> variables = formula::variables_of(term);
    for (std::size_t g = 0; g < stated_.fields.size(); ++g) {
      const std::size_t number = graph_.node(graph_.variable(stated_.fields[g]).index()).a;
      if (g != f && std::ranges::find(variables, number) != variables.end()) {
        return std::nullopt;
      }
    }
    auto integral = integral_of(term, u);
    if (!integral) {
      without_integral_ = formula::to_string(term);
      return std::nullopt;
    }
    // 0 at u = 0, where that is a number: 1 - cos(u).
    const Expression zero = graph_.constant(0.0);
    const Expression at_zero =
        formula::substitute(std::array{*integral}, graph_, std::array{u}, std::array{zero}).front();
    return at_zero.is_constant() ? *integral - at_zero : *integral;
  }
  [[nodiscard]] Expression field(std::size_t f) const { return graph_.variable(stated_.fields[f]); }
  [[nodiscard]] bool has(Expression e, Expression u) const {
    const std::vector<std::size_t> variables = formula::variables_of(e);
    return std::ranges::find(variables, graph_.node(u.index()).a) != variables.end();
  }
  [[nodiscard]] std::optional<Expression> integral_of(Expression e, Expression u) {
    if (!has(e, u)) {
      return e * u;
    }
    if (e == u) {
      return 0.5 * pow(u, 2.0);
    }
    const formula::Node node = graph_.node(e.index());
    const Expression a(&graph_, node.a), b(&graph_, node.b);
    const auto scaled = [&](std::optional<Expression> integral, Expression factor) {
      return integral ? std::optional(factor * *integral) : std::nullopt;
    };
    switch (node.operation) {
      case Operation::add:
      case Operation::subtract: {
        const auto one = integral_of(a, u), other = integral_of(b, u);
        if (!one || !other) {
          return std::nullopt;
        }
        return node.operation == Operation::add ? *one + *other : *one - *other;
      }
      case Operation::negate: return scaled(integral_of(a, u), graph_.constant(-1.0));
      case Operation::multiply:
        return !has(a, u) ? scaled(integral_of(b, u), a) : !has(b, u) ? scaled(integral_of(a, u), b) : std::nullopt;
      case Operation::divide: return !has(b, u) ? scaled(integral_of(a, u), 1.0 / b) : std::nullopt;
      case Operation::max:
      case Operation::min: {  // one-sided: a rope that only pulls
        const Expression other = a.is_constant(0.0) ? b : a;
        const Expression slope = formula::derivative(other, u);
        if ((!a.is_constant(0.0) && !b.is_constant(0.0)) || has(slope, u)) {
          return std::nullopt;
        }
        return pow(e, 2.0) / (2.0 * slope);
      }
      default: break;
    }
    // A function of a u + b.
    const Expression slope = formula::derivative(a, u);
    if (has(slope, u)) {
      return std::nullopt;
    }
    switch (node.operation) {
      case Operation::power:
        if (b.is_constant(-1.0)) {
          return log(abs(a)) / slope;
        }
        if (b.is_constant()) {
          return pow(a, b.constant_value() + 1.0) / ((b.constant_value() + 1.0) * slope);
        }
        return std::nullopt;
      case Operation::sqrt: return pow(a, 1.5) / (1.5 * slope);
      case Operation::tan: return -log(abs(cos(a))) / slope;
      case Operation::tanh: return log(cosh(a)) / slope;
      case Operation::log: return a * (log(a) - 1.0) / slope;
      case Operation::sin: return -cos(a) / slope;
      case Operation::cos: return sin(a) / slope;
      case Operation::exp: return exp(a) / slope;
      case Operation::sinh: return cosh(a) / slope;
      case Operation::cosh: return sinh(a) / slope;
      default: return std::nullopt;
    }
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
      density.fields.push_back("potential_" + stated_.fields[*potential]);
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

  [[nodiscard]] std::string text_of(const JetMonomial& monomial) const {
    std::vector<std::string> factors;
    for (const Jet& jet : monomial) {
      factors.push_back(total(jet) == 0 ? stated_.fields[jet.field]
                                        : derivative_name(stated_.fields[jet.field], jet.order));
    }
    return fmt::format("{}", fmt::join(factors, "*"));
  }
  void remember(const JetPolynomial& difference) {
    if (without_lagrangian_.empty() && !difference.empty()) {
      const auto worst =
          std::ranges::max_element(difference, {}, [](const auto& entry) { return std::abs(entry.second); });
      without_lagrangian_ = text_of(worst->first);
    }
  }
  /// Of a single equation of first order in time a linear term of even order in space; or none.
  [[nodiscard]] std::string even_derivative() const {
    std::string even;
    bool moves = false;
    for (const auto& [monomial, coefficient] : rows_.front().terms) {
      if (monomial.size() != 1) {
        continue;
      }
      const Jet& jet = monomial.front();
      if (jet.order[0] > 1) {
        return "";
      }
      moves = moves || jet.order[0] == 1;
      if (jet.order[0] == 0 && total(jet) > 0 && total(jet) % 2 == 0 && even.empty()) {
        even = text_of(monomial);
      }
    }
    return moves ? even : "";
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
    throw std::invalid_argument(
        fmt::format("there is no Lagrangian of these fields, nor of a potential of one, nor with a factor exp(a t): no "
                    "density has the term {} in its equations",
                    without_lagrangian_.empty() ? "that joins two equations" : without_lagrangian_));
  }

  const FieldEquations& stated_;
  formula::Graph& graph_;
  std::vector<Jet> jets_;
  std::map<formula::NodeIndex, std::size_t> number_;
  std::vector<Row> rows_;
  double damping_ = 0.0;
  std::string without_integral_, without_lagrangian_;
};

}  // namespace

FieldDensity density_of(const FieldEquations& equations) {
  return InverseProblem(equations).density();
}

}  // namespace rubato
