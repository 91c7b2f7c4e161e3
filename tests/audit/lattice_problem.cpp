#include "audit/lattice_problem.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "audit/quadrature.hpp"
#include "audit/random.hpp"

namespace audit {

namespace {

const std::vector<std::string> axis_names = {"x", "y"};

class Generator {
public:
  explicit Generator(std::uint64_t number) : random_(number + 1'000'000) {}

  LatticeProblem make() {
    switch (random_.below(10)) {
      case 0:
      case 1:
      case 2: wave(); break;
      case 3: plane_wave(); break;
      case 4:
      case 5: schroedinger(); break;
      case 6: dirac(); break;
      case 7: coupled_waves(); break;
      default: korteweg_de_vries(); break;
    }
    choose_scheme();
    make_grid();
    choose_levels();
    return problem_;
  }

private:
  static Expression field(std::size_t i) { return Expression::variable(i); }
  static Expression square(const Expression& a) { return Expression::raised(a, 2); }

  void declare(std::vector<std::string> fields, std::size_t dimensions = 1) {
    problem_.fields = std::move(fields);
    problem_.slaved.assign(problem_.fields.size(), false);
    problem_.midpoint_only.assign(problem_.fields.size(), false);
    problem_.K.resize(dimensions);
    problem_.axes.resize(dimensions);
    for (Axis& axis : problem_.axes) {
      axis.from = random_.between(-4, 2);
      axis.to = axis.from + random_.between(3, 12);
    }
  }

  /// A few waves.
  Expression profile(double amplitude) {
    Expression sum = random_.chance(0.3) ? Expression(random_.between(-amplitude, amplitude)) : Expression(0.0);
    for (std::size_t a = 0; a < problem_.axes.size(); ++a) {
      const Axis& axis = problem_.axes[a];
      for (std::size_t terms = 1 + random_.below(2); terms-- > 0;) {
        const double number = static_cast<double>(1 + random_.below(2)) * 2 * std::acos(-1.0) / axis.length();
        const Expression phase = number * (Expression::variable(a) - axis.from) + random_.between(0, 6);
        sum = sum + random_.between(-amplitude, amplitude) * sin(phase);
      }
    }
    return sum;
  }

  void start_with(std::size_t which, double amplitude) { problem_.initial.emplace_back(which, profile(amplitude)); }

  /// A potential of u, bounded from below or not.
  Expression well(const Expression& u) {
    Expression sum = random_.between(-0.5, 1) * square(u);
    switch (random_.below(4)) {
      case 0: return sum + random_.between(0.1, 1) * Expression::raised(u, 4);
      case 1: return sum - random_.between(0.2, 1.5) * cos(random_.between(0.5, 1.5) * u);
      case 2: return sum + random_.between(-0.2, 0.2) * Expression::raised(u, 3) + 0.2 * Expression::raised(u, 4);
      default: return sum;
    }
  }

  void wave() {
    problem_.family = "nonlinear wave";
    declare({"u", "v", "w"});
    problem_.M = {{0, 1, -random_.between(0.5, 2)}};
    problem_.K[0] = {{0, 2, random_.between(0.5, 2)}};
    problem_.S =
        random_.between(0.3, 1) * square(field(1)) - random_.between(0.3, 1) * square(field(2)) + well(field(0));
    problem_.slaved[2] = true;
    start_with(0, 1.0);
    start_with(1, 0.7);
  }

  void plane_wave() {
    problem_.family = "nonlinear wave in the plane";
    declare({"u", "v", "a", "b"}, 2);
    problem_.M = {{0, 1, -1}};
    problem_.K[0] = {{0, 2, 1}};
    problem_.K[1] = {{0, 3, random_.between(0.5, 1.5)}};
    problem_.S = (square(field(1)) - square(field(2)) - square(field(3))) / 2.0 + well(field(0));
    problem_.slaved[2] = problem_.slaved[3] = true;
    start_with(0, 0.8);
    start_with(1, 0.5);
  }

  void schroedinger() {
    problem_.family = "Schrödinger";
    declare({"p", "q", "v", "w"});
    problem_.M = {{0, 1, random_.between(0.6, 1.6)}};
    problem_.K[0] = {{0, 2, -1}, {1, 3, -1}};
    problem_.S = (square(field(2)) + square(field(3))) / 2.0 +
                 random_.between(-0.6, 0.8) * square(square(field(0)) + square(field(1)));
    problem_.turns = true;
    if (random_.chance(0.5)) {
      problem_.turns = false;  // and is no kick either
      problem_.S = problem_.S + random_.between(-0.2, 0.2) * Expression::raised(field(0), 3);
    }
    problem_.slaved[2] = problem_.slaved[3] = true;
    start_with(0, 0.8);
    start_with(1, 0.6);
  }

  void dirac() {
    problem_.family = "Dirac";
    problem_.turns = true;
    declare({"p1", "q1", "p2", "q2"});
    problem_.M = {{0, 1, 1}, {2, 3, 1}};
    problem_.K[0] = {{0, 3, 1}, {1, 2, -1}};  // K[p2,q1] = 1, by the upper triangle
    const Expression difference = square(field(0)) + square(field(1)) - square(field(2)) - square(field(3));
    problem_.S = random_.between(-1, 1) * difference + random_.between(-0.4, 0.4) * square(difference);
    for (std::size_t i = 0; i < 4; ++i) {
      start_with(i, 0.6);
    }
  }

  void coupled_waves() {
    problem_.family = "coupled waves";
    declare({"u1", "u2", "v1", "v2", "w1", "w2"});
    problem_.M = {{0, 2, -1}, {1, 3, -1}};
    problem_.K[0] = {{0, 4, 1}, {1, 5, random_.between(0.5, 1.5)}};
    problem_.S = (square(field(2)) + square(field(3)) - square(field(4)) - square(field(5))) / 2.0 + well(field(0)) +
                 well(field(1)) + random_.between(-0.5, 0.5) * cos(field(0) - field(1));
    problem_.slaved[4] = problem_.slaved[5] = true;
    for (std::size_t i = 0; i < 4; ++i) {
      start_with(i, 0.6);
    }
  }

  void korteweg_de_vries() {
    problem_.family = "Korteweg-de Vries";
    declare({"phi", "u", "v", "w"});
    const double gamma = random_.between(0.3, 1.2);
    problem_.M = {{0, 1, 0.5}};
    problem_.K[0] = {{0, 3, 1}, {1, 2, -gamma}};
    problem_.S =
        square(field(2)) / 2.0 - field(1) * field(3) + random_.between(0.1, 1) * Expression::raised(field(1), 3);
    problem_.slaved[0] = problem_.slaved[2] = true;
    problem_.midpoint_only[3] = true;
    problem_.potential = 0;
    problem_.derivative_of_potential = 1;
    start_with(1, 0.7);
  }

  void choose_scheme() {
    const double which = random_.unit();
    problem_.lagrangian = which < 0.55 ? LatticeProblem::Lagrangian::box : LatticeProblem::Lagrangian::fourier;
    if (which > 0.85 && problem_.family.find("wave") != std::string::npos) {
      problem_.lagrangian = LatticeProblem::Lagrangian::euler_box;
    }
    const bool kicks = problem_.family.find("wave") != std::string::npos;
    const double family = random_.unit();
    if (family < 0.3 && (kicks || problem_.turns)) {
      problem_.lagrangian = LatticeProblem::Lagrangian::splitting;
      problem_.composition =
          random_.one_of({"golden", "verlet", "suzuki-4", "blanes-moan-4", "kahan-li-6", "kahan-li-8"});
      if (kicks && random_.chance(0.15)) {
        problem_.composition = "blanes-moan-rkn-6";
      }
      problem_.differences = random_.chance(0.35);
    } else if (family < 0.65) {
      problem_.lagrangian =
          random_.chance(0.35) ? LatticeProblem::Lagrangian::box : LatticeProblem::Lagrangian::fourier;
      problem_.stages = 2 + static_cast<int>(random_.below(random_.chance(0.7) ? 3 : 7));
    }
  }

  void choose_step_potential() {
    using Kind = PotentialRule::Kind;
    PotentialRule& rule = problem_.step_potential;
    const double which = random_.unit();
    if (which < 0.15) {
      rule.kind = Kind::automatic;
    } else if (which < 0.3) {
      rule.kind = Kind::given;
      rule.kappa = random_.between(1.1, 4);
      rule.exponent = random_.chance(0.5) ? problem_.order_of_scheme() + random_.one_of({1, 2, 4})
                                          : problem_.order_of_scheme() * random_.between(1.2, 3);
    } else if (which < 0.55) {
      rule.kind = Kind::none;
    }
    if (rule.kind == Kind::automatic && random_.chance(0.2)) {
      rule.largest_step = Random::short_number(std::abs(problem_.step) * random_.between(1, 4));
    }
  }

  void make_grid() {
    for (Axis& axis : problem_.axes) {
      axis.cells = problem_.axes.size() == 1 ? 2 * (6 + random_.below(20)) + 1 : 2 * (3 + random_.below(4)) + 1;
      const bool even_is_fine = problem_.lagrangian != LatticeProblem::Lagrangian::box && !problem_.potential;
      axis.cells += even_is_fine && random_.chance(0.4) ? 1 : 0;
    }
  }

  void choose_levels() {
    const bool explicit_scheme = problem_.lagrangian == LatticeProblem::Lagrangian::euler_box;
    problem_.fixed = explicit_scheme || random_.chance(0.2);
    const int direction = random_.chance(0.75) ? 1 : -1;
    problem_.step = direction * (explicit_scheme ? 0.3 * problem_.axes[0].width() : random_.decades(-2.3, -0.7));
    problem_.step = Random::short_number(problem_.step);
    problem_.start_time = random_.chance(0.2) ? random_.between(-5, 5) : 0.0;
    problem_.until = problem_.start_time + Random::short_number(problem_.step * random_.between(10, 60));
    problem_.every = random_.one_of({1, 1, 3, 16});
    if (random_.chance(0.2)) {
      problem_.tolerance = random_.decades(-13, -7);
      problem_.tolerance_given = true;
    }
    if (!problem_.fixed) {
      choose_step_potential();
    }
    if (!explicit_scheme && random_.chance(0.25)) {
      problem_.on_singular = random_.chance(0.5) ? "plain" : "stop";
    }
    if (random_.chance(0.4)) {
      const Expression t = Expression::variable(problem_.axes.size());
      problem_.exact = profile(1.0) + random_.between(-0.5, 0.5) * sin(t + Expression::variable(0));
    }
    if (random_.chance(0.15)) {
      problem_.S = problem_.S + random_.sign() * random_.decades(-1, 3);
      problem_.family += ", a constant in S";
    }
  }

  Random random_;
  LatticeProblem problem_;
};

std::string entries(const std::vector<MatrixEntry>& matrix, const std::vector<std::string>& fields) {
  std::vector<std::string> texts;
  for (const auto& [row, column, value] : matrix) {
    texts.push_back(fmt::format("[\"{}\", \"{}\", {}]", fields[row], fields[column], value));
  }
  return fmt::format("[{}]", fmt::join(texts, ", "));
}

}  // namespace

std::size_t LatticeProblem::nodes() const {
  std::size_t count = 1;
  for (const Axis& axis : axes) {
    count *= axis.cells;
  }
  return count;
}

int LatticeProblem::order_of_scheme() const {
  return lagrangian == Lagrangian::splitting ? composition_order(composition) : 2 * stages;
}

bool LatticeProblem::has_step_potential() const {
  using Kind = PotentialRule::Kind;
  return !fixed && (step_potential.kind == Kind::unsaid ? on_singular.empty() : step_potential.kind != Kind::none);
}

LevelRules LatticeProblem::rules() const {
  const bool given = step_potential.kind == PotentialRule::Kind::given;
  return {.start = start_time,
          .until = until,
          .step = step,
          .tolerance = tolerance,
          .fixed = fixed,
          .every = static_cast<std::size_t>(every),
          .order = order_of_scheme(),
          .potential = has_step_potential(),
          .kappa = given ? step_potential.kappa : 0.0,
          .exponent = given ? step_potential.exponent : 0.0};
}

std::string LatticeProblem::toml() const {
  std::string text = fmt::format("title = \"{}\"\n[multisymplectic]\nfields = [\"{}\"]\nM = {}\n", family,
                                 fmt::join(fields, "\", \""), entries(M, fields));
  for (std::size_t a = 0; a < axes.size(); ++a) {
    text += fmt::format("K.{} = {}\n", axis_names[a], entries(K[a], fields));
  }
  text += fmt::format("S = \"{}\"\n[grid]\n", S.text(fields));
  for (std::size_t a = 0; a < axes.size(); ++a) {
    text += fmt::format("{} = {{ from = {}, to = {}, cells = {} }}\n", axis_names[a], axes[a].from, axes[a].to,
                        axes[a].cells);
  }
  text += "[initial]\n";
  if (start_time != 0.0) {
    text += fmt::format("t = {}\n", start_time);
  }
  for (const auto& [field, formula] : initial) {
    text += fmt::format("{} = \"{}\"\n", fields[field], formula.text(axis_names));
  }
  if (exact) {
    std::vector<std::string> names(axis_names.begin(), axis_names.begin() + static_cast<std::ptrdiff_t>(axes.size()));
    names.emplace_back("t");
    text += fmt::format("[exact]\n{} = \"{}\"\n", fields[initial[0].first], exact->text(names));
  }
  constexpr const char* words[] = {"box", "fourier", "euler-box", "splitting"};
  text += fmt::format("[scheme]\nlagrangian = \"{}\"\nstep = {}\nuntil = {}\nmax_steps = {}\n",
                      words[static_cast<int>(lagrangian)], step, until, max_steps);
  text += stages > 1 ? fmt::format("stages = {}\n", stages) : "";
  if (lagrangian == Lagrangian::splitting) {
    text += fmt::format("composition = \"{}\"\n{}", composition, differences ? "space = \"differences\"\n" : "");
  }
  text += fixed ? "levels = \"fixed\"\n" : "";
  text += step_potential.toml();
  text += tolerance_given ? fmt::format("tolerance = {}\n", tolerance) : "";
  text += !on_singular.empty() ? fmt::format("on_singular = \"{}\"\n", on_singular) : "";
  text += fmt::format("[output]\nevery = {}\n[levels]\nevery = 1\n[laws]\nfields = true\n", every);
  return text;
}

LatticeProblem random_lattice(std::uint64_t number) {
  return Generator(number).make();
}

}  // namespace audit
