#include "audit/orbit_problem.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "audit/bounded.hpp"
#include "audit/quadrature.hpp"
#include "audit/random.hpp"
#include "audit/series.hpp"

namespace audit {

namespace {

std::string quoted_list(std::span<const std::string> names) {
  return fmt::format("[\"{}\"]", fmt::join(names, "\", \""));
}

std::vector<std::string> corner_names(std::span<const std::string> names) {
  std::vector<std::string> corners;
  for (const char* suffix : {"_0", "_1"}) {
    corners.push_back(std::string("t") + suffix);
    for (const std::string& name : names) {
      corners.push_back(name + suffix);
    }
  }
  return corners;
}

/// Velocity and its rate of change, to find out how fast things happen.
struct Motion {
  std::vector<long double> velocity, acceleration;
  long double gamma = 0.0L;

  Motion(const Expression& H, std::span<const double> z) {
    const std::size_t size = z.size(), n = size / 2;
    const Shape& shape = Shape::of(size, 2);
    std::vector<Series> variables;
    for (std::size_t i = 0; i < size; ++i) {
      variables.emplace_back(shape, Bounded(static_cast<long double>(z[i])), i);
    }
    const Series energy = H(std::span<const Series>(variables));
    const auto flip = [n](std::span<const long double> g) {
      std::vector<long double> f(g.size());
      for (std::size_t i = 0; i < n; ++i) {
        f[i] = g[n + i];
        f[n + i] = -g[i];
      }
      return f;
    };
    std::vector<long double> gradient(size);
    for (std::size_t i = 0; i < size; ++i) {
      gradient[i] = energy.derivative(i).value;
    }
    velocity = flip(gradient);
    std::vector<long double> image(size);
    for (std::size_t i = 0; i < size; ++i) {
      const Series row = energy.differentiated(i);
      for (std::size_t j = 0; j < size; ++j) {
        image[i] += row.derivative(j).value * velocity[j];
      }
      gamma += velocity[i] * image[i];
    }
    acceleration = flip(image);
  }

  static long double norm(std::span<const long double> values) {
    long double sum = 0.0L;
    for (const long double value : values) {
      sum += value * value;
    }
    return std::sqrt(sum);
  }
  [[nodiscard]] double time_scale() const { return static_cast<double>(norm(velocity) / norm(acceleration)); }
};

class Generator {
public:
  explicit Generator(std::uint64_t number) : random_(number) {}

  OrbitProblem make() {
    const bool by_L = random_.chance(0.22);
    do {
      problem_ = {};
      if (by_L) {
        choose_L();
      } else {
        choose_motion();
        move_start();
      }
    } while (!choose_scheme());
    return problem_;
  }

private:
  using Variables = std::vector<Expression>;

  Expression q(std::size_t i) const { return Expression::variable(i); }
  Expression p(std::size_t i) const { return Expression::variable(problem_.start.size() / 2 + i); }
  static Expression square(const Expression& a) { return Expression::raised(a, 2); }
  double coefficient() { return random_.between(0.05, 2.0); }

  void declare(std::size_t n) {
    constexpr std::array<const char*, 3> coordinates = {"x", "y", "z"}, momenta = {"u", "v", "w"};
    for (std::size_t i = 0; i < n; ++i) {
      problem_.names.emplace_back(coordinates.at(i));
    }
    for (std::size_t i = 0; i < n; ++i) {
      problem_.names.emplace_back(momenta.at(i));
    }
    for (std::size_t i = 0; i < 2 * n; ++i) {
      problem_.start.push_back(random_.between(-1.3, 1.3));
    }
  }

  Expression kinetic() {
    Expression sum = coefficient() * square(p(0));
    for (std::size_t i = 1; i < problem_.start.size() / 2; ++i) {
      sum = sum + coefficient() * square(p(i));
    }
    return sum;
  }

  /// Any of the state's variables.
  Expression any() { return Expression::variable(random_.below(problem_.start.size())); }

  void polynomial() {
    problem_.family = "polynomial";
    const std::size_t n = 1 + random_.below(3);
    declare(n);
    problem_.H = kinetic();
    for (std::size_t i = 0; i < n; ++i) {
      problem_.H = problem_.H + random_.between(-0.6, 1.5) * square(q(i)) + coefficient() * Expression::raised(q(i), 4);
    }
    for (std::size_t terms = random_.below(4); terms-- > 0;) {
      problem_.H = problem_.H + random_.between(-0.4, 0.4) * any() * any() * any();
    }
  }

  void trigonometric() {
    problem_.family = "trigonometric";
    const std::size_t n = 1 + random_.below(3);
    declare(n);
    problem_.H = kinetic();
    for (std::size_t i = 0; i < n; ++i) {
      problem_.H = problem_.H - coefficient() * cos(q(i));
      if (i > 0) {
        problem_.H = problem_.H - random_.between(-1, 1) * cos(q(i) - q(i - 1));
      }
    }
    for (std::size_t terms = random_.below(3); terms-- > 0;) {
      const Expression argument = any() + random_.between(-1, 1) * any();
      problem_.H = problem_.H + random_.between(-0.7, 0.7) * (random_.chance(0.5) ? sin(argument) : cos(argument));
    }
    if (random_.chance(0.3)) {
      problem_.H = problem_.H + random_.between(-0.3, 0.3) * any() * any();
    }
  }

  void pendulum() {
    declare(1);
    problem_.H = square(p(0)) / 2.0 - cos(q(0));
    switch (random_.below(4)) {
      case 0:
        problem_.family = "pendulum of energy 0";
        problem_.start = {0.0, std::sqrt(2.0)};
        break;
      case 1:
        problem_.family = "pendulum near its separatrix";
        problem_.start = {0.0, 2.0 * (1.0 + random_.sign() * random_.decades(-9, -2))};
        break;
      case 2:
        problem_.family = "pendulum that turns over";
        problem_.start = {random_.between(-3, 3), random_.sign() * random_.between(2.05, 3)};
        break;
      default:
        problem_.family = "pendulum";
        problem_.start = {random_.between(-2, 2), random_.between(-1, 1)};
        break;
    }
  }

  void double_well() {
    problem_.family = "double well";
    declare(1);
    problem_.H = square(p(0)) / 2.0 + (Expression::raised(q(0), 4) - square(q(0))) / 2.0;
    if (random_.chance(0.5)) {
      problem_.family = "double well near its separatrix";
      problem_.start = {1.0, random_.sign() * random_.decades(-8, -2)};
    }
  }

  void blow_up() {
    problem_.family = "motion without bound";
    declare(1);
    const int degree = random_.one_of({3, 4, 6, 8});
    if (random_.chance(0.4)) {
      problem_.H = square(p(0)) / 2.0 - 1.0 / square(q(0));
      problem_.start = {random_.between(0.5, 1.5), random_.between(-2, 2)};
    } else {
      problem_.H = square(p(0)) / 2.0 - coefficient() * Expression::raised(q(0), degree);
    }
  }

  void kepler() {
    problem_.family = "Kepler";
    declare(2);
    const double e = random_.between(0.0, 0.97);
    problem_.H = (square(p(0)) + square(p(1))) / 2.0 - 1.0 / Expression::raised(square(q(0)) + square(q(1)), 0.5);
    problem_.start = {1 - e, 0.0, 0.0, std::sqrt((1 + e) / (1 - e))};
    problem_.invariants.emplace_back("angular_momentum", q(0) * p(1) - q(1) * p(0));
  }

  void double_pendulum() {
    problem_.family = "double pendulum";
    declare(2);
    const Expression difference = q(0) - q(1);
    problem_.H = (square(p(0)) + 2.0 * square(p(1)) - 2.0 * p(0) * p(1) * cos(difference)) /
                     (2.0 * (1.0 + square(sin(difference)))) -
                 2.0 * cos(q(0)) - cos(q(1));
    if (random_.chance(0.5)) {
      problem_.start = {std::acos(0.0), std::acos(0.0), 0.0, 0.0};
    }
  }

  void not_separable() {
    problem_.family = "not separable";
    declare(1);
    problem_.H = (square(q(0)) + 1.0) * (square(p(0)) + 1.0) / 2.0;
    if (random_.chance(0.4)) {
      problem_.H = problem_.H + random_.between(-0.5, 0.5) * exp(random_.between(-0.5, 0.5) * any());
    }
  }

  /// Energies and steps that show nothing: oscillators, free particles.
  void degenerate() {
    declare(1 + random_.below(2));
    problem_.H = kinetic();
    if (random_.chance(0.7)) {
      problem_.family = "oscillator";
      problem_.H = problem_.H + coefficient() * square(q(0));
    } else {
      problem_.family = "free particle";
    }
    if (random_.chance(0.4)) {
      problem_.family += ", disturbed";
      problem_.H = problem_.H + random_.decades(-9, -2) * Expression::raised(q(0), 4);
    }
  }

  void choose_motion() {
    const std::size_t which = random_.below(20);
    if (which < 6) {
      polynomial();
    } else if (which < 11) {
      trigonometric();
    } else if (which < 13) {
      pendulum();
    } else if (which < 14) {
      double_well();
    } else if (which < 15) {
      blow_up();
    } else if (which < 17) {
      kepler();
    } else if (which < 18) {
      double_pendulum();
    } else if (which < 19) {
      not_separable();
    } else {
      degenerate();
    }
    if (problem_.invariants.empty()) {
      problem_.invariants.emplace_back("something", any() * any() + random_.between(-1, 1) * any());
    }
  }

  /// Motions stated by L, of q and then q̇.
  void choose_L() {
    const std::size_t which = random_.below(8);
    const std::size_t n = which == 0 || which == 4 || which == 5 ? 2 : 1 + random_.below(which == 1 ? 3 : 2);
    declare(n);
    for (std::size_t i = 0; i < n; ++i) {
      problem_.names[n + i] = problem_.names[i] + "_dot";
    }
    problem_.quadrature = random_.one_of({OrbitProblem::Quadrature::midpoint, OrbitProblem::Quadrature::trapezoid,
                                          OrbitProblem::Quadrature::lobatto, OrbitProblem::Quadrature::lobatto,
                                          OrbitProblem::Quadrature::gauss, OrbitProblem::Quadrature::gauss});
    Expression& L = problem_.L;
    const Expression v = p(0);
    switch (which) {
      case 0: {
        problem_.family = "L: double pendulum";
        const double mass = random_.between(0.5, 2);
        L = mass * square(p(0)) + square(p(1)) / 2.0 + p(0) * p(1) * cos(q(0) - q(1)) + 2.0 * cos(q(0)) + cos(q(1));
        if (mass < 0.6) {
          L = L + square(p(0));
        }
        break;
      }
      case 1:
        problem_.family = "L: natural";
        L = kinetic();
        for (std::size_t i = 0; i < n; ++i) {
          L = L - random_.between(-0.6, 1.5) * square(q(i)) - coefficient() * Expression::raised(q(i), 4);
        }
        L = L + random_.between(-0.4, 0.4) * q(0) * q(n - 1) * q(random_.below(n));
        break;
      case 2:
        problem_.family = "L: curved";
        L = (1.0 + coefficient() * square(q(0))) * square(v) - coefficient() * Expression::raised(q(0), 4);
        for (std::size_t i = 1; i < n; ++i) {
          L = L + (0.5 + square(sin(q(i)))) * square(p(i)) + coefficient() * cos(q(i) - q(i - 1));
        }
        break;
      case 3:
        problem_.family = "L: relativistic";
        for (double& value : problem_.start) {
          value *= 0.4;
        }
        L = 0.0 - Expression::raised(1.0 - square(v), 0.5) - coefficient() * square(q(0));
        if (n == 2) {
          L = 0.0 - Expression::raised(1.0 - square(v) - square(p(1)), 0.5) - coefficient() * square(q(0)) +
              coefficient() * cos(q(1));
        }
        break;
      case 4:
        problem_.family = "L: in a magnetic field";
        L = kinetic() + random_.between(-2, 2) * (q(0) * p(1) - q(1) * p(0)) - coefficient() * square(q(0)) -
            random_.between(0, 1) * Expression::raised(q(1), 4);
        break;
      case 5:
        problem_.family = "L: on a sphere";
        problem_.start[0] = random_.between(0.8, 2.2);
        L = (square(v) + square(sin(q(0))) * square(p(1))) / 2.0 + random_.between(-1, 1) * cos(q(0));
        break;
      case 6:
        problem_.family = "L: pendulum";
        declare_again(1);
        L = square(p(0)) / 2.0 + cos(q(0));
        problem_.start = {random_.between(-1, 1), random_.one_of({0.5, 1.5, 1.99, 2.3})};
        break;
      default:
        problem_.family = "L: oscillator";
        L = kinetic();
        for (std::size_t i = 0; i < n; ++i) {
          L = L - coefficient() * square(q(i));
        }
    }
    if (random_.chance(0.2)) {
      problem_.family += ", a large constant in L";
      L = L + random_.sign() * random_.decades(1, 3);
    }
    const std::size_t size = problem_.start.size() / 2;
    const auto something = [&] { return Expression::variable(random_.below(3 * size)); };
    problem_.invariants.emplace_back("something", something() * something() + random_.between(-1, 1) * something());
    if (random_.chance(0.2)) {
      problem_.start_time = random_.between(-20, 20);
    }
  }

  void declare_again(std::size_t n) {
    problem_.names.clear();
    problem_.start.clear();
    declare(n);
    for (std::size_t i = 0; i < n; ++i) {
      problem_.names[n + i] = problem_.names[i] + "_dot";
    }
  }

  /// To where Γ, or H, or the motion vanishes.
  void move_start() {
    const double which = random_.unit();
    if (which < 0.08) {
      start_at_zero_of_gamma();
    } else if (which < 0.12 && problem_.family != "Kepler" &&
               problem_.family.find("without bound") == std::string::npos) {
      problem_.family += ", near an equilibrium";
      const double scale = random_.decades(-7, -2);
      for (double& value : problem_.start) {
        value *= scale;
      }
    } else if (which < 0.27) {
      problem_.family += ", H = 0 at the start";
      const double energy = energy_of(problem_.start);
      problem_.H = problem_.H - (random_.chance(0.5) ? energy : Random::short_number(energy));
    } else if (which < 0.31) {
      problem_.family += ", a large constant in H";
      problem_.H = problem_.H + random_.sign() * random_.decades(1, 3);
    }
    if (random_.chance(0.2)) {
      problem_.start_time = random_.between(-20, 20);
    }
  }

  [[nodiscard]] double energy_of(std::span<const double> z) const {
    std::vector<Bounded> variables(z.begin(), z.end());
    return static_cast<double>(problem_.H(std::span<const Bounded>(variables)).value);
  }

  void start_at_zero_of_gamma() {
    const std::vector<double> start = problem_.start;
    const std::size_t n = start.size() / 2;
    const auto scaled = [&](double factor) {
      std::vector<double> z = start;
      for (std::size_t i = n; i < 2 * n; ++i) {
        z[i] *= factor;
      }
      return z;
    };
    const auto gamma = [&](double factor) { return Motion(problem_.H, scaled(factor)).gamma; };
    double low = 0.0;
    for (double high = 0.25; high < 5.0; low = high, high += 0.25) {
      if (gamma(low) * gamma(high) < 0) {
        for (int i = 0; i < 60; ++i) {
          const double middle = (low + high) / 2;
          (gamma(low) * gamma(middle) <= 0 ? high : low) = middle;
        }
        problem_.family += random_.chance(0.5) ? ", at a zero of Gamma" : ", beside a zero of Gamma";
        const bool beside = problem_.family.ends_with("beside a zero of Gamma");
        problem_.start = scaled(beside ? high * (1 + random_.sign() * random_.decades(-6, -1)) : high);
        return;
      }
    }
  }

  void choose_lagrangian() {
    const std::size_t n = problem_.degrees_of_freedom();
    if (problem_.is_stated_by_L()) {
      const bool lobatto = problem_.quadrature == OrbitProblem::Quadrature::lobatto;
      problem_.stages = static_cast<int>(lobatto ? 2 + random_.below(8) : 1 + random_.below(8));
      return;
    }
    const std::size_t which = random_.below(28);
    if (which >= 20) {
      if (separate()) {
        problem_.lagrangian = OrbitProblem::Lagrangian::splitting;
        problem_.composition =
            random_.one_of({"golden", "golden", "verlet", "suzuki-4", "blanes-moan-4", "kahan-li-6", "kahan-li-8"});
        if (kinetic_energy_is_quadratic() && random_.chance(0.2)) {
          problem_.composition = "blanes-moan-rkn-6";
        }
        problem_.by_order = random_.chance(0.3) && problem_.composition != "verlet" &&
                            problem_.composition != "suzuki-4" && problem_.composition != "blanes-moan-rkn-6";
      } else {
        problem_.lagrangian = OrbitProblem::Lagrangian::gauss;
        problem_.stages = 1 + static_cast<int>(random_.below(8));
      }
      return;
    }
    if (which < 11) {
      if (random_.chance(0.35)) {
        problem_.lagrangian = OrbitProblem::Lagrangian::gauss;
        problem_.stages = 1 + static_cast<int>(random_.below(8));
      }
      return;
    }
    if (which < 17) {
      problem_.lagrangian = OrbitProblem::Lagrangian::generating;
      problem_.order = random_.one_of({2, 4, 4, 6, 6, 8});
      if (n == 3) {
        problem_.order = std::min(problem_.order, 6);
      }
      if (random_.chance(0.25)) {
        problem_.order = random_.one_of({1, 2, 3, 4});
        choose_darboux(n);
      }
    } else if (which < 19) {
      problem_.lagrangian = OrbitProblem::Lagrangian::custom;
      mix_lagrangian(random_.one_of({0.0, 0.5, 1.0 / 3, 0.7}), 0.5);
    } else {
      problem_.lagrangian = OrbitProblem::Lagrangian::forward;
      mix_lagrangian(1.0, 1.0);
    }
  }

  /// Leaves the terms of H out that depend on both coordinates and momenta; false if T or V would be nothing.
  /// By third differences of T along lines, not about 0, where T may be even: 0 but for rounding, or of the size of T.
  bool kinetic_energy_is_quadratic() {
    const std::size_t n = problem_.degrees_of_freedom();
    const Expression T = problem_.H.terms_where([n](const Expression& term) { return term.depends_on(n, 2 * n); });
    for (int line = 0; line < 8; ++line) {
      std::vector<double> direction(2 * n);
      for (double& component : direction) {
        component = random_.between(-1.0, 1.0);
      }
      const auto at = [&](long double s) {
        std::vector<Bounded> z;
        for (const double component : direction) {
          z.emplace_back(s * component);
        }
        return T(std::span<const Bounded>(z)).value;
      };
      const long double values[] = {at(-1.2L), at(-0.2L), at(0.8L), at(1.8L)};
      const long double size = std::abs(values[0]) + std::abs(values[1]) + std::abs(values[2]) + std::abs(values[3]);
      if (!(std::abs(values[3] - values[0] - 3 * (values[2] - values[1])) <= 1e-12L * size)) {
        return false;
      }
    }
    return true;
  }

  bool separate() {
    const std::size_t n = problem_.degrees_of_freedom();
    const auto is_mixed = [n](const Expression& term) { return term.depends_on(0, n) && term.depends_on(n, 2 * n); };
    const Expression H = problem_.H.terms_where([&](const Expression& term) { return !is_mixed(term); });
    if (!H.depends_on(0, n) || !H.depends_on(n, 2 * n)) {
      return false;
    }
    problem_.H = H;
    return true;
  }

  void choose_potential() {
    using Kind = PotentialRule::Kind;
    PotentialRule& rule = problem_.potential;
    const double which = random_.unit();
    const bool family = problem_.is_family();
    if (which < (family ? 0.2 : 0.12)) {
      rule.kind = Kind::automatic;
    } else if (which < (family ? 0.35 : 0.22)) {
      rule.kind = Kind::given;
      rule.kappa = random_.between(1.1, 5);
      rule.exponent = random_.chance(0.5) ? problem_.order_of_scheme() + random_.one_of({1, 2, 4})
                                          : problem_.order_of_scheme() * random_.between(1.2, 3);
    } else if (which < 0.6) {
      rule.kind = Kind::none;
    }
    if (rule.kind == Kind::automatic && random_.chance(0.2)) {
      rule.largest_step = Random::short_number(std::abs(problem_.step) * random_.between(1, 4));
    }
  }

  void choose_darboux(std::size_t n) {
    const std::size_t kind = random_.below(3);
    problem_.F.assign(4 * n * n, 0.0);
    if (kind < 2) {
      problem_.darboux = kind == 0 ? "euler-a" : "euler-b";
      for (std::size_t i = 0; i < n; ++i) {
        problem_.F[i * 2 * n + n + i] = problem_.F[(n + i) * 2 * n + i] = kind == 0 ? 1.0 : -1.0;
      }
      return;
    }
    problem_.darboux = "matrix";
    for (std::size_t i = 0; i < 2 * n; ++i) {
      for (std::size_t j = 0; j <= i; ++j) {
        problem_.F[i * 2 * n + j] = problem_.F[j * 2 * n + i] = random_.between(-0.6, 0.6);
      }
    }
  }

  /// 𝕃 = (weighted p)·Δq/Δt - (part of H in the middle) - (the rest, a mean of H at the ends)
  void mix_lagrangian(double middle, double weight_of_first) {
    const std::size_t size = problem_.start.size(), n = size / 2;
    const auto corner = [size](std::size_t end, std::size_t i) {
      return Expression::variable(end * (size + 1) + 1 + i);
    };
    const Expression duration = Expression::variable(size + 1) - Expression::variable(0);
    Variables means, firsts, lasts;
    for (std::size_t i = 0; i < size; ++i) {
      firsts.push_back(corner(0, i));
      lasts.push_back(corner(1, i));
      means.push_back((corner(0, i) + corner(1, i)) / 2.0);
    }
    Expression L = 0.0;
    for (std::size_t i = 0; i < n; ++i) {
      const Expression momentum = weight_of_first == 1.0 ? firsts[n + i] : means[n + i];
      const Expression term = momentum * (lasts[i] - firsts[i]) / duration;
      L = i == 0 ? term : L + term;
    }
    if (middle > 0.0) {
      L = L - (middle == 1.0 ? problem_.H.with(means) : middle * problem_.H.with(means));
    }
    if (middle < 1.0) {
      L = L - (1.0 - middle) / 2.0 * (problem_.H.with(firsts) + problem_.H.with(lasts));
    }
    problem_.L = L;
  }

  bool choose_scheme() {
    choose_lagrangian();
    const double time_scale = problem_.is_stated_by_L() ? time_scale_of_L() : time_scale_of_H();
    if (!std::isfinite(time_scale) && problem_.family.find("free") == std::string::npos) {
      return false;
    }
    const bool forward = problem_.lagrangian == OrbitProblem::Lagrangian::forward;
    const bool custom = problem_.lagrangian == OrbitProblem::Lagrangian::custom;
    const double length = random_.chance(0.12) ? random_.decades(-0.3, 0.6) : random_.decades(-2.2, -0.3);
    const int direction = random_.chance(0.7) ? 1 : -1;
    problem_.step = direction * Random::short_number(length * (std::isfinite(time_scale) ? time_scale : 1.0));
    const double steps = forward ? 4.5 : random_.between(20, 250);
    problem_.until = problem_.start_time + Random::short_number(steps * problem_.step);
    problem_.fixed = random_.chance(0.15);
    problem_.max_steps = forward ? 5 : 600;
    problem_.every = random_.one_of({1, 1, 3, 16});
    if (random_.chance(0.25)) {
      problem_.tolerance = random_.decades(-14, -6);
      problem_.tolerance_given = true;
    }
    if (!problem_.fixed && !custom && !forward) {
      choose_potential();
    }
    if (random_.chance(0.25)) {
      problem_.on_singular = random_.chance(0.5) ? "plain" : "stop";
    }
    const bool two_steps = !problem_.is_stated_by_L() && !forward && !custom && !problem_.is_family();
    if (random_.chance(0.15) && problem_.F.empty() && (two_steps || custom)) {
      give_next();
    } else if (random_.chance(0.1) && !forward) {
      problem_.energy_tolerance = random_.decades(-6, -2);
    }
    if (random_.chance(0.4)) {
      const Expression t = Expression::variable(0);
      problem_.exact = random_.between(-1, 1) * cos(random_.between(0.2, 2) * t) + random_.between(-0.1, 0.1) * t;
    }
    return true;
  }

  [[nodiscard]] double time_scale_of_H() const { return Motion(problem_.H, problem_.start).time_scale(); }

  /// (q̇, q̈) beside its rate of change, by a difference along it.
  [[nodiscard]] double time_scale_of_L() const {
    const std::size_t n = problem_.degrees_of_freedom();
    const auto rate = [&](const std::vector<long double>& z) {
      const Shape& shape = Shape::of(2 * n, 2);
      std::vector<Series> variables;
      for (std::size_t i = 0; i < 2 * n; ++i) {
        variables.emplace_back(shape, Bounded(z[i]), i);
      }
      const Series L = problem_.L(std::span<const Series>(variables));
      std::vector<std::vector<long double>> rows(n, std::vector<long double>(n + 1));
      for (std::size_t r = 0; r < n; ++r) {
        const Series slope = L.differentiated(n + r);
        rows[r][n] = L.derivative(r).value;
        for (std::size_t c = 0; c < n; ++c) {
          rows[r][c] = slope.derivative(n + c).value;
          rows[r][n] -= slope.derivative(c).value * z[n + c];
        }
      }
      std::vector<long double> f(z.begin() + static_cast<std::ptrdiff_t>(n), z.end());
      const std::vector<long double> acceleration = solved(rows);
      f.insert(f.end(), acceleration.begin(), acceleration.end());
      return f;
    };
    const std::vector<long double> z(problem_.start.begin(), problem_.start.end());
    const std::vector<long double> f = rate(z);
    std::vector<long double> moved = z;
    constexpr long double little = 1e-6L;
    for (std::size_t i = 0; i < 2 * n; ++i) {
      moved[i] += little * f[i];
    }
    std::vector<long double> change = rate(moved);
    for (std::size_t i = 0; i < 2 * n; ++i) {
      change[i] = (change[i] - f[i]) / little;
    }
    return static_cast<double>(Motion::norm(f) / Motion::norm(change));
  }

  /// A second level that no step leads to, so that the form with two steps is solved.
  void give_next() {
    const Motion motion(problem_.H, problem_.start);
    for (std::size_t i = 0; i < problem_.start.size(); ++i) {
      const double moved = problem_.start[i] + problem_.step * static_cast<double>(motion.velocity[i]);
      problem_.next.push_back(Random::short_number(moved + 1e-3 * problem_.step * random_.between(-1, 1)));
    }
  }

  Random random_;
  OrbitProblem problem_;
};

}  // namespace

bool OrbitProblem::is_family() const {
  return lagrangian == Lagrangian::gauss || lagrangian == Lagrangian::splitting ||
         (is_stated_by_L() && quadrature != Quadrature::midpoint);
}

bool OrbitProblem::has_potential() const {
  using Kind = PotentialRule::Kind;
  const bool usual = on_singular.empty() && lagrangian != Lagrangian::custom && lagrangian != Lagrangian::forward;
  return !fixed && (potential.kind == Kind::unsaid ? usual : potential.kind != Kind::none);
}

int OrbitProblem::order_of_scheme() const {
  if (is_stated_by_L()) {
    return quadrature == Quadrature::lobatto ? 2 * stages - 2 : quadrature == Quadrature::gauss ? 2 * stages : 2;
  }
  switch (lagrangian) {
    case Lagrangian::gauss: return 2 * stages;
    case Lagrangian::splitting: return composition_order(composition);
    case Lagrangian::generating: return F.empty() ? (order + 1) / 2 * 2 : order;
    default: return 2;
  }
}

LevelRules OrbitProblem::rules() const {
  const bool given = potential.kind == PotentialRule::Kind::given;
  return {.start = start_time,
          .until = until,
          .step = energy_tolerance || !next.empty() ? 0.0 : step,
          .tolerance = tolerance,
          .fixed = fixed,
          .every = static_cast<std::size_t>(every),
          .order = order_of_scheme(),
          .potential = has_potential(),
          .kappa = given ? potential.kappa : 0.0,
          .exponent = given ? potential.exponent : 0.0};
}

std::vector<std::string> OrbitProblem::names_in_invariants() const {
  if (!is_stated_by_L()) {
    return names;
  }
  const auto n = static_cast<std::ptrdiff_t>(degrees_of_freedom());
  std::vector<std::string> all(names.begin(), names.begin() + n);
  for (std::ptrdiff_t i = 0; i < n; ++i) {
    all.push_back("p_" + names[static_cast<std::size_t>(i)]);
  }
  all.insert(all.end(), names.begin() + n, names.end());
  return all;
}

std::string OrbitProblem::toml() const {
  const std::size_t n = degrees_of_freedom();
  const std::string coordinates = quoted_list(std::span(names).first(n));
  std::string text =
      is_stated_by_L()
          ? fmt::format("title = \"{}\"\n[lagrangian]\nq = {}\nL = \"{}\"\n", family, coordinates, L.text(names))
          : fmt::format("title = \"{}\"\n[hamiltonian]\nq = {}\np = {}\nH = \"{}\"\n", family, coordinates,
                        quoted_list(std::span(names).last(n)), H.text(names));
  text += "[initial]\n";
  if (start_time != 0.0) {
    text += fmt::format("t = {}\n", start_time);
  }
  for (std::size_t i = 0; i < start.size(); ++i) {
    text += fmt::format("{} = {}\n", names[i], start[i]);
  }
  if (!next.empty()) {
    text += fmt::format("[initial.next]\nt = {:.17g}\n", start_time + step);
    for (std::size_t i = 0; i < next.size(); ++i) {
      text += fmt::format("{} = {}\n", names[i], next[i]);
    }
  }
  text += "[invariants]\n";
  for (const auto& [name, formula] : invariants) {
    text += fmt::format("{} = \"{}\"\n", name, formula.text(names_in_invariants()));
  }
  if (exact) {
    const std::vector<std::string> time = {"t"};
    text += fmt::format("[exact]\n{} = \"{}\"\n", names[0], exact->text(time));
  }
  constexpr std::array<const char*, 6> words = {"midpoint", "generating", "custom", "forward", "gauss", "splitting"};
  constexpr std::array<const char*, 5> quadratures = {"", "midpoint", "trapezoid", "lobatto", "gauss"};
  text += fmt::format("[scheme]\nlagrangian = \"{}\"\n", is_stated_by_L()
                                                             ? quadratures.at(static_cast<std::size_t>(quadrature))
                                                             : words.at(static_cast<std::size_t>(lagrangian)));
  if (is_stated_by_L()) {
    const bool has_stages = quadrature == Quadrature::lobatto || quadrature == Quadrature::gauss;
    text += has_stages ? fmt::format("stages = {}\n", stages) : "";
  } else if (lagrangian == Lagrangian::splitting) {
    text += by_order ? fmt::format("order = {}\n", composition_order(composition))
                     : fmt::format("composition = \"{}\"\n", composition);
  } else if (lagrangian == Lagrangian::generating) {
    text += fmt::format("order = {}\n", order);
    if (darboux == "matrix") {
      text += "darboux = [";
      for (std::size_t i = 0; i < 2 * n; ++i) {
        text += fmt::format("{}[{}]", i == 0 ? "" : ", ", fmt::join(std::span(F).subspan(i * 2 * n, 2 * n), ", "));
      }
      text += "]\n";
    } else if (darboux != "midpoint") {
      text += fmt::format("darboux = \"{}\"\n", darboux);
    }
  } else if (lagrangian == Lagrangian::gauss) {
    text += fmt::format("stages = {}\n", stages);
  } else if (lagrangian == Lagrangian::custom) {
    text += fmt::format("L = \"{}\"\n", L.text(corner_names(names)));
  }
  text += fixed ? "levels = \"fixed\"\n" : "";
  text += potential.toml();
  if (energy_tolerance) {
    text += fmt::format("step = \"auto\"\nenergy_tolerance = {}\n", *energy_tolerance);
  } else if (next.empty()) {
    text += fmt::format("step = {}\n", step);
  }
  text += fmt::format("until = {}\n", until);
  text += tolerance_given ? fmt::format("tolerance = {}\n", tolerance) : "";
  text += !on_singular.empty() ? fmt::format("on_singular = \"{}\"\n", on_singular) : "";
  text += fmt::format("max_steps = {}\n[output]\nevery = {}\n[levels]\nevery = 1\n", max_steps, every);
  return text;
}

OrbitProblem random_orbit(std::uint64_t number) {
  return Generator(number).make();
}

}  // namespace audit
