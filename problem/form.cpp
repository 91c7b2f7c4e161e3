#include <rubato/problem/form.hpp>

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <optional>
#include <regex>
#include <span>
#include <stdexcept>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/formula/latex.hpp>
#include <rubato/pde/dispersion.hpp>
#include <rubato/pde/lattice_method.hpp>
#include <rubato/pde/multisymplectic_form.hpp>
#include <rubato/pde/point_symmetries.hpp>
#include <rubato/problem/lattice_problem.hpp>
#include <rubato/problem/reader.hpp>

namespace rubato {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using formula::Expression;

constexpr std::string_view form_letters = "txyz";

/// The name of a field's derivative: u_t of u, u_tx of u_t.
std::string rate_name(const std::string& field, std::size_t direction) {
  const std::size_t bar = field.rfind('_');
  const bool is_derivative = bar != std::string::npos && bar > 0 && bar + 1 < field.size() &&
                             field.find_first_not_of(form_letters, bar + 1) == std::string::npos;
  return fmt::format("{}{}{}", field, is_derivative ? "" : "_", form_letters[direction]);
}

class FormWriter {
public:
  FormWriter(const Problem& problem, const MultisymplecticSystem& system, bool as_latex)
      : problem_(problem),
        pde_(*problem.multisymplectic()),
        system_(system),
        graph_(*system.graph()),
        d_(system.field_count()),
        slopes_(
            formula::gradient(system.expression(), std::span(system.variables()).first(static_cast<std::size_t>(d_)))),
        as_latex_(as_latex) {
    for (std::size_t mu = 0; mu <= static_cast<std::size_t>(system.directions()); ++mu) {
      auto& of_direction = rates_.emplace_back();
      for (const std::string& field : system.fields()) {
        of_direction.push_back(graph_.variable(rate_name(field, mu)));
      }
    }
  }

  [[nodiscard]] std::string write() {
    densities();
    equations();
    structure();
    symmetries();
    dispersion();
    if (!as_latex_) {
      title("Schemes");
      for (const LatticeMethodEntry& entry : lattice_methods()) {
        out_ += fmt::format("  {:<10} {}\n", entry.name, verdict_of(entry));
      }
    }
    return std::move(out_);
  }

private:
  void title(std::string_view text) {
    out_ += fmt::format("{}{}{}\n", out_.empty() ? "" : "\n", as_latex_ ? "% " : "", text);
  }
  [[nodiscard]] std::string text_of(Expression e) const {
    return as_latex_ ? formula::to_latex(e) : formula::to_string(e);
  }
  void line(std::string_view left, Expression right, std::string_view note = {}) {
    out_ += as_latex_ ? fmt::format("\\[ {} = {} \\]\n", left, text_of(right))
                      : fmt::format("  {} = {}{}{}\n", left, text_of(right), note.empty() ? "" : "    ", note);
  }
  /// A field that has the name of the derivative that it is needs no saying so.
  void equation(Expression left, Expression right) {
    if (!(left == right)) {
      line(text_of(left), right);
    }
  }
  void say(const std::string& sentence) { out_ += fmt::format("{}{}\n", as_latex_ ? "% " : "  ", sentence); }

  [[nodiscard]] Expression field(Index i) const { return system_.variables()[static_cast<std::size_t>(i)]; }
  [[nodiscard]] const MatrixXd& matrix(std::size_t mu) const {
    return mu == 0 ? system_.M() : system_.K(static_cast<int>(mu) - 1);
  }
  [[nodiscard]] const MatrixXd& plus(std::size_t mu) const {
    const FieldStructure& structure = system_.structure();
    return mu == 0 ? structure.M_plus : structure.K_plus[mu - 1];
  }
  /// aᵀ M b.
  [[nodiscard]] Expression form(const MatrixXd& M, const std::function<Expression(Index)>& a,
                                const std::function<Expression(Index)>& b) const {
    Expression sum = graph_.constant(0.0);
    for (Index i = 0; i < d_; ++i) {
      for (Index j = 0; j < d_; ++j) {
        if (M(i, j) != 0.0) {
          sum = sum + M(i, j) * (a(i) * b(j));
        }
      }
    }
    return sum;
  }
  [[nodiscard]] std::function<Expression(Index)> fields() const {
    return [this](Index i) { return field(i); };
  }
  [[nodiscard]] std::function<Expression(Index)> rates(std::size_t mu) const {
    return [this, mu](Index i) { return rates_[mu][static_cast<std::size_t>(i)]; };
  }

  void densities() {
    title("Densities, up to divergences");
    Expression L = graph_.constant(0.0), H = system_.expression();
    for (std::size_t mu = 0; mu < rates_.size(); ++mu) {
      const MatrixXd upper = matrix(mu).triangularView<Eigen::StrictlyUpper>();
      L = L + form(upper, fields(), rates(mu));
      H = mu == 0 ? H : H + form(plus(mu), rates(mu), fields());
    }
    if (!pde_.density.empty() && !as_latex_) {
      out_ += fmt::format("  L = {}    {}\n", pde_.density, "as stated, or found");
    }
    line("L", L - system_.expression(), "of first order");
    line("H", H, "the energy of a level is its integral");
  }

  void equations() {
    title("Equations, M z_t + K z_x = grad S(z), and S");
    line("S", system_.expression());
    for (Index i = 0; i < d_; ++i) {
      row(VectorXd::Unit(d_, i), 0);
    }
    if (!as_latex_) {
      say("M, K and S as a problem file has them: --as toml");
    }
  }
  /// The combination n of rows, from a direction on, with the sign that its first derivative has +.
  void row(const VectorXd& n, std::size_t from) {
    double sign = 0.0;
    for (std::size_t mu = from; mu < rates_.size() && sign == 0.0; ++mu) {
      const VectorXd entries = matrix(mu).transpose() * n;
      for (Index j = 0; j < d_ && sign == 0.0; ++j) {
        sign = entries(j) > 0.0 ? 1.0 : entries(j) < 0.0 ? -1.0 : 0.0;
      }
    }
    sign = sign == 0.0 ? 1.0 : sign;
    Expression right = graph_.constant(0.0);
    for (Index i = 0; i < d_; ++i) {
      right = n(i) != 0.0 ? right + sign * n(i) * slopes_[static_cast<std::size_t>(i)] : right;
    }
    equation(left_side(sign * n, from), right);
  }
  /// nᵀ(M z_t + Σ K_a z_{x_a}), from a direction on.
  [[nodiscard]] Expression left_side(const VectorXd& n, std::size_t from) const {
    Expression sum = graph_.constant(0.0);
    for (std::size_t mu = from; mu < rates_.size(); ++mu) {
      const VectorXd row = matrix(mu).transpose() * n;
      for (Index j = 0; j < d_; ++j) {
        if (row(j) != 0.0) {
          sum = sum + row(j) * rates(mu)(j);
        }
      }
    }
    return sum;
  }

  void structure() {
    const FieldStructure& structure = system_.structure();
    title("Constraints: rows without a derivative by t");
    for (Index c = 0; c < structure.kernel.cols(); ++c) {
      row(structure.kernel.col(c), 1);
    }
    if (structure.kernel.cols() == 0) {
      say("none");
    }
    list("multipliers, which exist in the middle of steps only", structure.multiplier);
    list("potentials, which are free up to a constant", structure.potential);
  }
  void list(std::string_view what, const std::vector<bool>& chosen) {
    std::vector<std::string> names;
    for (std::size_t f = 0; f < chosen.size(); ++f) {
      if (chosen[f]) {
        names.push_back(system_.fields()[f]);
      }
    }
    if (!names.empty()) {
      say(fmt::format("{}: {}", what, fmt::join(names, ", ")));
    }
  }

  void symmetries() {
    title("Symmetries and their conserved densities");
    const std::string_view balance = ", with a source: a balance";
    say(fmt::format("translation in t: energy, H{}", pde_.driven ? balance : ""));
    for (std::size_t mu = 1; mu < rates_.size(); ++mu) {
      const auto& varying = system_.coordinates();
      const bool varies = std::ranges::find(varying, static_cast<int>(mu) - 1) != varying.end();
      say(fmt::format("translation in {}: momentum{}", form_letters[mu], varies ? balance : ""));
      line("density", -form(plus(0), rates(mu), fields()));
    }
    for (const StatedSymmetry& symmetry : pde_.symmetries) {
      const MatrixXd B = dense(symmetry.B);
      say(fmt::format("linear, z -> exp(s B) z: {}", symmetry.name));
      line("density", form(0.5 * (system_.M() * B), fields(), fields()));
    }
    const MatrixXd& affine = system_.structure().affine_symmetries;
    for (Index c = 0; c < affine.cols(); ++c) {
      const VectorXd row = system_.M().transpose() * affine.col(c);
      Expression density = graph_.constant(0.0);
      for (Index j = 0; j < d_; ++j) {
        density = row(j) != 0.0 ? density + row(j) * field(j) : density;
      }
      say(fmt::format("affine, {}: mass", shift_text(affine.col(c))));
      line("density", density);
    }
    if (pde_.driven) {
      return;
    }
    for (const Scaling& scaling : scalings(system_)) {
      say(scaling_text(scaling));
    }
    for (int a = 0; a < system_.directions(); ++a) {
      if (const auto found = galilei_transformation(system_, a)) {
        say(galilei_text(*found));
      }
    }
  }
  [[nodiscard]] std::string shift_text(const VectorXd& b) const {
    std::vector<std::string> parts;
    for (Index i = 0; i < d_; ++i) {
      if (b(i) != 0.0) {
        parts.push_back(fmt::format("{0} -> {0} + {1}s", system_.fields()[static_cast<std::size_t>(i)],
                                    b(i) == 1.0 ? "" : fmt::format("{}*", b(i))));
      }
    }
    return fmt::format("{}", fmt::join(parts, ", "));
  }
  /// "(1/3)", of numbers that have a small denominator.
  [[nodiscard]] static std::string fraction(double x) {
    for (const int denominator : {1, 2, 3, 4, 5, 6, 8, 12}) {
      const double numerator = std::round(x * denominator);
      if (std::abs(x * denominator - numerator) < 1e-9) {
        return denominator == 1 ? fmt::format("({})", numerator) : fmt::format("({}/{})", numerator, denominator);
      }
    }
    return fmt::format("({})", x);
  }
  [[nodiscard]] std::string scaling_text(const Scaling& scaling) const {
    std::vector<std::string> parts;
    const auto put = [&](std::string_view name, double exponent) {
      if (exponent != 0.0) {
        parts.push_back(fmt::format("{0} -> {1} {0}", name, exponent == 1.0 ? "l" : "l^" + fraction(exponent)));
      }
    };
    for (std::size_t mu = 0; mu < rates_.size(); ++mu) {
      put(form_letters.substr(mu, 1), scaling.directions(static_cast<Index>(mu)));
    }
    for (Index i = 0; i < d_; ++i) {
      put(system_.fields()[static_cast<std::size_t>(i)], scaling.fields(i));
    }
    const double multiplier = scaling.multiplier();
    return fmt::format("scaling, {}: {}", fmt::join(parts, ", "),
                       multiplier == 0.0 ? "the action stays as it is"
                                         : fmt::format("the action is multiplied by l^{}: solutions go to solutions, "
                                                       "without a conserved density",
                                                       fraction(multiplier)));
  }
  [[nodiscard]] std::string galilei_text(const GalileiTransformation& found) const {
    std::vector<std::string> parts;
    const Expression x = graph_.variable(form_letters.substr(static_cast<std::size_t>(found.direction) + 1, 1));
    for (Index i = 0; i < d_; ++i) {
      Expression change = graph_.constant(found.c(i));
      for (Index j = 0; j < d_; ++j) {
        change = found.C(i, j) != 0.0 ? change + found.C(i, j) * field(j) : change;
        change = found.B(i, j) != 0.0 ? change + found.B(i, j) * (x * field(j)) : change;
      }
      change = found.b(i) != 0.0 ? change + found.b(i) * x : change;
      if (!change.is_constant(0.0)) {
        parts.push_back(fmt::format("{0} -> {0} + v*({1})", system_.fields()[static_cast<std::size_t>(i)],
                                    formula::to_string(change)));
      }
    }
    return fmt::format("Galilei, {0} -> {0} + v*t, to first order in v{1}{2}", formula::to_string(x),
                       parts.empty() ? "" : ": ", fmt::join(parts, ", "));
  }

  void dispersion() {
    title("Waves exp(i(k x - omega t)) about 0");
    try {
      const DispersionRelation relation = dispersion_relation(system_, graph_);
      equation(relation.left, relation.right);
    } catch (const std::invalid_argument& error) {
      say(error.what());
    }
  }

  /// Whether a scheme takes the problem, on few cells.
  [[nodiscard]] std::string verdict_of(const LatticeMethodEntry& entry) const {
    constexpr std::int64_t most_cells = 33;
    Problem problem = problem_;
    auto& pde = std::get<MultisymplecticProblem>(problem.system);
    problem.scheme.lagrangian = LagrangianName::of_lattice;
    problem.scheme.method = entry.name;
    problem.scheme.stages.reset();
    problem.scheme.composition = "golden";
    problem.scheme.space = space_words.front();
    problem.scheme.space_stages = 1;
    problem.scheme.density.reset();
    problem.scheme.frame.reset();
    const auto dimensions = static_cast<int>(pde.axes.size());
    try {
      const auto method = make_method(problem);
      if (const std::string_view reason = method->other_dimensions(dimensions); !reason.empty()) {
        return fmt::format("no: {}", reason);
      }
      for (GridAxis& axis : pde.axes) {
        axis.cells = static_cast<std::int64_t>(
            method->count_near(static_cast<std::size_t>(std::min(axis.cells, most_cells)), dimensions));
      }
      const MultisymplecticSystem system = make_system(problem);
      const grids::Grid grid = make_grid(problem);
      static_cast<void>(
          method->scheme(system, grid, make_initial_level(problem, system, grid), problem.scheme.step.value_or(1e-3)));
      const std::string_view fixed = method->fixed_levels_only();
      return fixed.empty() ? "yes" : fmt::format("yes, with fixed levels: {}", fixed);
    } catch (const ProblemError& error) {
      return fmt::format("no: {}", error.reason());
    } catch (const std::exception& error) {
      return fmt::format("no: {}", error.what());
    }
  }

  const Problem& problem_;
  const MultisymplecticProblem& pde_;
  const MultisymplecticSystem& system_;
  formula::Graph& graph_;
  Index d_;
  std::vector<Expression> slopes_;  ///< ∇S
  bool as_latex_;
  std::vector<std::vector<Expression>> rates_;  ///< of each field, by direction
  std::string out_;
};

/// [multisymplectic] of a problem that states it, with numbers in place of parameters.
std::string stated_form(const Problem& problem, const MultisymplecticSystem& system) {
  const MultisymplecticProblem& pde = *problem.multisymplectic();
  MultisymplecticForm form;
  form.fields = pde.fields;
  form.fields.resize(pde.fields.size() - (pde.driven ? 2 : 0));  // without the pair that an S of t adds
  const auto graph = std::make_shared<formula::Graph>();
  form.S = problem.build(pde.S, *graph, quantity_names(pde));
  const auto d = static_cast<Index>(form.fields.size());
  for (std::size_t mu = 0; mu <= static_cast<std::size_t>(system.directions()); ++mu) {
    const MatrixXd& matrix = mu == 0 ? system.M() : system.K(static_cast<int>(mu) - 1);
    for (Index i = 0; i < d; ++i) {
      for (Index j = i + 1; j < d; ++j) {
        if (matrix(i, j) != 0.0) {
          form.terms.at(mu).push_back({static_cast<std::size_t>(i), static_cast<std::size_t>(j), matrix(i, j)});
        }
      }
    }
  }
  const Location& place = pde.S.location;
  const std::vector<std::string> axes = pde.axis_names();
  return write_document({Value::Table{{"multisymplectic", place, form_table(form, axes, place)}}, place});
}

/// The text with numbers as they were meant: 0.3 for 0.30000000000000004, the sum of what a problem states.
std::string with_plain_numbers(const std::string& text) {
  static const std::regex long_number(R"([0-9]+\.[0-9]{13,}(e[+-]?[0-9]+)?)");
  constexpr double rounding = 1e-15;
  std::string plain;
  std::size_t done = 0;
  for (std::sregex_iterator found(text.begin(), text.end(), long_number), none; found != none; ++found) {
    const double number = std::stod(found->str()), near = std::stod(fmt::format("{:.13g}", number));
    plain += text.substr(done, static_cast<std::size_t>(found->position()) - done);
    plain += std::abs(near - number) <= rounding * number ? fmt::format("{}", near) : found->str();
    done = static_cast<std::size_t>(found->position() + found->length());
  }
  return plain + text.substr(done);
}

}  // namespace

std::string form_of(const Problem& problem, FormStyle style) {
  const MultisymplecticProblem* pde = problem.multisymplectic();
  if (pde == nullptr) {
    throw std::invalid_argument("--form is of field equations, [field] or [multisymplectic]; this is an orbit");
  }
  const MultisymplecticSystem system = make_laboratory_system(problem);
  if (style == FormStyle::toml) {
    return pde->derived.empty() ? stated_form(problem, system) : pde->derived;
  }
  return with_plain_numbers(FormWriter(problem, system, style == FormStyle::latex).write());
}

}  // namespace rubato
