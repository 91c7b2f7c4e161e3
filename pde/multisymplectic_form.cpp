#include <rubato/pde/multisymplectic_form.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <optional>
#include <set>
#include <stdexcept>
#include <utility>

#include <Eigen/Core>

#include <fmt/format.h>

#include <rubato/pde/natural_sizes.hpp>
#include <rubato/pde/polynomials.hpp>
#include <rubato/solve/small_matrices.hpp>

namespace rubato {

namespace {

using formula::Expression;

constexpr std::string_view letters = "txyz";

class FormDerivation {
public:
  explicit FormDerivation(const FieldDensity& density)
      : graph_(*density.graph), dimensions_(density.dimensions), L_(density.L), S_(graph_.constant(0.0)) {
    form_.fields = density.fields;
    for (std::size_t f = 0; f < density.fields.size(); ++f) {
      known_[{f, {}}] = f;
    }
    for (const auto& [field, potential] : density.potentials) {
      known_[{potential, {0, 1, 0, 0}}] = field;
      constrain(potential, 1, field);
    }
    state_derivatives(density);
  }

  MultisymplecticForm derive() {
    std::optional<Polynomial> polynomial;
    do {
      polynomial = polynomial_of_derivatives();
    } while (!polynomial);
    const Polynomial terms = *polynomial;
    for (const auto& [monomial, coefficient] : terms) {
      if (monomial.empty()) {
        S_ = S_ - coefficient;
      } else if (monomial.size() == 1) {
        add_linear(monomial.front(), coefficient);
      }
    }
    add_quadratic(terms);
    form_.S = S_;
    for (std::size_t mu = 0; mu < letters.size(); ++mu) {
      for (const auto& [place, value] : entries_[mu]) {
        if (value != 0.0) {
          form_.terms[mu].push_back({place.first, place.second, value});
        }
      }
    }
    return std::move(form_);
  }

private:
  /// ∂_mu of a field.
  struct First {
    std::size_t field = 0, mu = 0;
    auto operator<=>(const First&) const = default;
  };

  [[nodiscard]] Expression variable(std::size_t field) { return graph_.variable(form_.fields[field]); }

  /// \param meaning what the field is, for the message where its name is taken
  std::size_t add_field(std::string name, const std::string& meaning) {
    if (std::ranges::find(form_.fields, name) != form_.fields.end()) {
      throw std::invalid_argument(fmt::format(
          "the name {} is taken, and the form needs a field of that name, {}; give it another name", name, meaning));
    }
    form_.fields.push_back(std::move(name));
    return form_.fields.size() - 1;
  }

  /// L has the term value·a·∂_mu b: ½ zᵀM z_t with M_ab = value = -M_ba, up to a total derivative.
  void add_term(std::size_t mu, std::size_t a, std::size_t b, double value) {
    if (a != b) {
      entries_[mu][{std::min(a, b), std::max(a, b)}] += a < b ? value : -value;
    }
  }
  /// `field` is ∂_mu of another: λ(∂_mu other - field).
  void constrain(std::size_t other, std::size_t mu, std::size_t field) {
    const std::size_t multiplier = add_field(
        "multiplier_" + form_.fields[field],
        fmt::format("Lagrange multiplier of {} = {}_{}", form_.fields[field], form_.fields[other], letters[mu]));
    add_term(mu, multiplier, other, 1.0);
    S_ = S_ + variable(multiplier) * variable(field);
  }

  /// The field that a derivative of a field of the density is, which it becomes here if it is none yet.
  std::size_t field_of(std::size_t base, const DerivativeOrder& order) {
    if (const auto found = known_.find({base, order}); found != known_.end()) {
      return found->second;
    }
    const auto [parent, mu] = outermost(base, order);
    const std::string name = derivative_name(form_.fields[base], order);
    const std::size_t field = add_field(name, fmt::format("the derivative {}_{}", form_.fields[parent], letters[mu]));
    known_[{base, order}] = field;
    constrain(parent, mu, field);
    return field;
  }
  /// A derivative as the first derivative of a field: by t, if it has one, else by the last direction.
  First outermost(std::size_t base, DerivativeOrder order) {
    const std::size_t mu = last_direction(order);
    --order.at(mu);
    return {field_of(base, order), mu};
  }

  /// Puts first derivatives of fields in place of all derivatives, and fields in place of those that are some.
  void state_derivatives(const FieldDensity& density) {
    std::vector<Expression> from, to;
    // Those that are differentiated again become fields first.
    std::vector<FieldDensity::Derivative> all = density.derivatives;
    std::ranges::stable_sort(all, std::greater{}, [](const auto& one) { return total_order(one.order); });
    for (const auto& one : all) {
      for (std::size_t a = static_cast<std::size_t>(dimensions_) + 1; a < one.order.size(); ++a) {
        if (one.order[a] > 0) {
          throw std::invalid_argument(fmt::format("{} is a derivative by {}, which the grid has not",
                                                  derivative_name(density.fields[one.field], one.order), letters[a]));
        }
      }
      if (total_order(one.order) > 1) {
        static_cast<void>(outermost(one.field, one.order));
      }
    }
    for (const auto& one : all) {
      from.push_back(one.variable);
      if (const auto found = known_.find({one.field, one.order}); found != known_.end()) {
        to.push_back(variable(found->second));
      } else {
        to.push_back(first_derivative(outermost(one.field, one.order), one.field, one.order));
      }
    }
    L_ = substituted(from, to);
  }
  [[nodiscard]] Expression substituted(std::span<const Expression> from, std::span<const Expression> to) {
    return from.empty() ? L_ : formula::substitute(std::array{L_}, graph_, from, to).front();
  }

  /// The variable that stands for a first derivative.
  Expression first_derivative(First first, std::size_t base, const DerivativeOrder& order) {
    const auto found = std::ranges::find(firsts_, first, &Named::first);
    if (found != firsts_.end()) {
      return found->variable;
    }
    firsts_.push_back(
        {first, base, order, graph_.variable(fmt::format("d{} of {}", first.mu, form_.fields[first.field]))});
    return firsts_.back().variable;
  }

  /// L as a polynomial of first derivatives that the form can have; nothing if some of them had to become fields.
  [[nodiscard]] std::optional<Polynomial> polynomial_of_derivatives() {
    std::map<formula::NodeIndex, std::size_t> number;
    for (std::size_t i = 0; i < firsts_.size(); ++i) {
      number.emplace(firsts_[i].variable.index(), i);
    }
    Polynomials polynomials(graph_, number);
    std::optional<Polynomial> result = polynomials(L_);
    std::set<std::size_t> promoted;
    if (!result) {
      promoted = polynomials.others();
    } else {
      for (const auto& [monomial, coefficient] : *result) {
        find_promoted(monomial, coefficient, promoted);
      }
      if (promoted.empty()) {
        find_singular(*result, promoted);
      }
    }
    if (promoted.empty()) {
      return result;
    }
    promote(promoted);
    return std::nullopt;
  }

  void find_promoted(const Monomial& monomial, Expression coefficient, std::set<std::size_t>& promoted) {
    const bool fits = monomial.empty() || (monomial.size() == 1 && is_affine(coefficient)) ||
                      (monomial.size() == 2 && coefficient.is_constant());
    if (fits) {
      return;
    }
    // The derivatives in space, where that leaves a polynomial of degree one; else all.
    bool any = false;
    for (const std::size_t i : monomial) {
      if (firsts_[i].first.mu != 0) {
        promoted.insert(i);
        any = true;
      }
    }
    if (!any) {
      promoted.insert(monomial.begin(), monomial.end());
    }
  }
  /// Of the fields alone, with constant coefficients.
  [[nodiscard]] bool is_affine(Expression e) {
    const std::vector<std::size_t> variables = formula::variables_of(e);
    const bool of_fields = std::ranges::all_of(variables, [this](std::size_t number) {
      return std::ranges::find(form_.fields, graph_.variable_name(number)) != form_.fields.end();
    });
    return of_fields && std::ranges::all_of(slopes_of(e), [](Expression slope) { return slope.is_constant(); });
  }
  [[nodiscard]] std::vector<Expression> slopes_of(Expression e) {
    std::vector<Expression> variables;
    for (std::size_t f = 0; f < form_.fields.size(); ++f) {
      variables.push_back(variable(f));
    }
    return formula::gradient(e, variables);
  }

  /// The matrix A of the quadratic terms; of `used`, the numbers of the derivatives in them.
  [[nodiscard]] Eigen::MatrixXd quadratic_terms(const Polynomial& polynomial, std::vector<std::size_t>& used) const {
    const auto n = static_cast<Eigen::Index>(firsts_.size());
    Eigen::MatrixXd A = Eigen::MatrixXd::Zero(n, n);
    for (const auto& [monomial, coefficient] : polynomial) {
      if (monomial.size() == 2) {
        const auto i = static_cast<Eigen::Index>(monomial[0]), j = static_cast<Eigen::Index>(monomial[1]);
        const double value = coefficient.constant_value();
        A(i, j) += value;
        A(j, i) += value;
      }
    }
    for (Eigen::Index i = 0; i < n; ++i) {
      if (!A.row(i).isZero(0.0)) {
        used.push_back(static_cast<std::size_t>(i));
      }
    }
    return A;
  }

  /// Where A has no inverse the momenta do not give the derivatives: those in space become fields, or all.
  void find_singular(const Polynomial& polynomial, std::set<std::size_t>& promoted) const {
    std::vector<std::size_t> used;
    const Eigen::MatrixXd A = quadratic_terms(polynomial, used);
    if (used.empty()) {
      return;
    }
    // In units, powers of two, in which no entry is small because of them: -c² of u_x² beside 1 of u_t².
    const Eigen::MatrixXd among = A(used, used);
    Eigen::VectorXd units(among.rows());
    std::ranges::transform(natural_sizes(among.cwiseAbs()), units.begin(),
                           [](double size) { return std::exp2(std::round(std::log2(size))); });
    const Eigen::MatrixXd scaled = units.asDiagonal() * among * units.asDiagonal();
    const double rounding = std::numeric_limits<double>::epsilon() * static_cast<double>(used.size());
    if (solve::quotient(scaled, scaled, rounding)) {
      return;
    }
    std::ranges::copy_if(used, std::inserter(promoted, promoted.end()),
                         [this](std::size_t i) { return firsts_[i].first.mu != 0; });
    if (promoted.empty()) {
      promoted.insert(used.begin(), used.end());
    }
  }

  /// These derivatives become fields.
  void promote(const std::set<std::size_t>& promoted) {
    std::vector<Expression> from, to;
    std::vector<Named> left;
    for (std::size_t i = 0; i < firsts_.size(); ++i) {
      if (promoted.contains(i)) {
        from.push_back(firsts_[i].variable);
        to.push_back(variable(field_of(firsts_[i].base, firsts_[i].order)));
      } else {
        left.push_back(firsts_[i]);
      }
    }
    firsts_ = std::move(left);
    L_ = substituted(from, to);
  }

  void add_linear(std::size_t number, Expression coefficient) {
    const auto& [field, mu] = firsts_[number].first;
    const std::vector<Expression> slopes = slopes_of(coefficient);
    for (std::size_t f = 0; f < slopes.size(); ++f) {
      if (const double slope = slopes[f].constant_value(); slope != 0.0) {
        add_term(mu, f, field, slope);
      }
    }
  }
  void add_quadratic(const Polynomial& polynomial) {
    std::vector<std::size_t> used;
    const Eigen::MatrixXd A = quadratic_terms(polynomial, used);
    std::map<std::size_t, std::size_t> equal;  // the field that equals each derivative
    for (const std::size_t i : used) {
      const Named& one = firsts_[i];
      equal[i] = add_field(derivative_name(form_.fields[one.base], one.order),
                           fmt::format("the derivative {}_{}", form_.fields[one.first.field], letters[one.first.mu]));
    }
    for (const std::size_t i : used) {
      for (const std::size_t j : used) {
        const double value = A(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j));
        if (value == 0.0) {
          continue;
        }
        add_term(firsts_[j].first.mu, equal[i], firsts_[j].first.field, value);
        if (i == j) {
          S_ = S_ + 0.5 * value * formula::pow(variable(equal[i]), 2.0);
        } else if (i < j) {
          S_ = S_ + value * variable(equal[i]) * variable(equal[j]);
        }
      }
    }
  }

  struct Named {
    First first;
    std::size_t base = 0;  ///< the field of the density that it is a derivative of
    DerivativeOrder order = {};
    Expression variable;
  };

  formula::Graph& graph_;
  int dimensions_;
  Expression L_, S_;
  MultisymplecticForm form_;
  std::map<std::pair<std::size_t, DerivativeOrder>, std::size_t> known_;  ///< derivatives that are fields
  std::vector<Named> firsts_;
  std::array<std::map<std::pair<std::size_t, std::size_t>, double>, 4> entries_;
};

}  // namespace

int total_order(const DerivativeOrder& order) {
  return std::accumulate(order.begin(), order.end(), 0);
}

std::size_t last_direction(const DerivativeOrder& order) {
  std::size_t mu = 0;
  for (std::size_t a = 1; order[0] == 0 && a < order.size(); ++a) {
    mu = order[a] > 0 ? a : mu;
  }
  return mu;
}

std::string derivative_name(std::string_view field, const DerivativeOrder& order) {
  std::string name(field);
  name += '_';
  for (const std::size_t mu : {1U, 2U, 3U, 0U}) {
    name.append(static_cast<std::size_t>(order[mu]), letters[mu]);
  }
  return name;
}

std::optional<NamedDerivative> derivative_named(std::string_view name, const std::vector<std::string>& fields) {
  for (std::size_t f = 0; f < fields.size(); ++f) {
    const std::string begin = fields[f] + "_";
    if (!name.starts_with(begin) || name.size() == begin.size()) {
      continue;
    }
    const std::string_view suffix = name.substr(begin.size());
    if (suffix.find_first_not_of(letters) != std::string_view::npos) {
      continue;
    }
    NamedDerivative found{std::string(name), f, {}};
    for (const char letter : suffix) {
      ++found.order.at(letters.find(letter));
    }
    return found;
  }
  return std::nullopt;
}

MultisymplecticForm multisymplectic_form(const FieldDensity& density) {
  return FormDerivation(density).derive();
}

}  // namespace rubato
