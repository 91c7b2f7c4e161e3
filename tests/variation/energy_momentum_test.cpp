// Energy and momentum, what can be had (docs/energy-and-momentum.md): the theorem for several parameters, and the
// smallest examples of the ways that do not work.

#include <catch2/catch.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <numbers>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Dense>

#include <rubato/formula/bytecode.hpp>

using namespace rubato;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::Vector4d;
using Eigen::VectorXd;

namespace {

/// Newton's method with differences for derivatives, until nothing improves. \return whether it came to rounding
bool solve(const std::function<VectorXd(const VectorXd&)>& residual, VectorXd& x, double enough) {
  double best = std::numeric_limits<double>::infinity();
  VectorXd kept = x;
  for (int iteration = 0; iteration < 40; ++iteration) {
    const VectorXd r = residual(x);
    if (!(r.norm() < best)) {
      break;
    }
    best = r.norm();
    kept = x;
    MatrixXd J(r.size(), x.size());
    for (Index i = 0; i < x.size(); ++i) {
      constexpr double width = 1e-6;
      VectorXd more = x, less = x;
      more(i) += width;
      less(i) -= width;
      J.col(i) = (residual(more) - residual(less)) / (2.0 * width);
    }
    x -= J.fullPivLu().solve(r);
  }
  x = kept;
  return best < enough;
}

// ---- Orbits: H = |p|²/2 + r²/2 + r⁴/4 and B = L²/2, which commute; z = (x, y, u, v) ---------------------------------

double H(const Vector4d& z) {
  const double r2 = z.head(2).squaredNorm();
  return 0.5 * z.tail(2).squaredNorm() + 0.5 * r2 + 0.25 * r2 * r2;
}
Vector4d slope_of_H(const Vector4d& z) {
  const double r2 = z.head(2).squaredNorm();
  return {z(0) * (1.0 + r2), z(1) * (1.0 + r2), z(2), z(3)};
}
double L(const Vector4d& z) {
  return z(0) * z(3) - z(1) * z(2);
}
double B(const Vector4d& z) {
  return 0.5 * L(z) * L(z);
}
Vector4d slope_of_B(const Vector4d& z) {
  return L(z) * Vector4d(z(3), -z(2), -z(1), z(0));
}
Vector4d J_times(const Vector4d& g) {
  return {g(2), g(3), -g(0), -g(1)};
}

/// The midpoint step of g¹H + g²B, and K = (H, B) at its middle.
struct Step {
  Vector4d z;
  Vector2d K;
};
Step step_of(const Vector4d& z, const Vector2d& g) {
  Vector4d next = z;
  for (int iteration = 0; iteration < 100; ++iteration) {
    const Vector4d middle = 0.5 * (z + next);
    next = z + J_times(g(0) * slope_of_H(middle) + g(1) * slope_of_B(middle));
  }
  const Vector4d middle = 0.5 * (z + next);
  return {next, {H(middle), B(middle)}};
}

/// (z, s, E) ↦ (ψ_g(z), s + g, E) with K_a(g; ψ_g(z)) + κ_a(g) = E_a, and what it leaves of Σ dp∧dq - Σ dE_a∧ds^a.
double defect_of_form(const std::function<Vector2d(const Vector4d& z, const Vector2d& g)>& law) {
  const Vector4d z(0.9, 0.2, 0.3, 0.8);
  const Vector2d g(0.6, 0.4), E = law(z, g);
  const auto map = [&](const VectorXd& x) {
    const Vector4d from = x.head(4);
    const Vector2d wanted = x.tail(2);
    VectorXd length = g;
    CHECK(solve([&](const VectorXd& h) -> VectorXd { return law(from, h) - wanted; }, length, 1e-11));
    VectorXd to(8);
    to << step_of(from, length).z, x.segment(4, 2) + length, wanted;
    return to;
  };
  VectorXd x(8);
  x << z, 0.0, 0.0, E;
  MatrixXd D(8, 8);
  for (Index i = 0; i < 8; ++i) {
    constexpr double width = 1e-3;  // of differences of fourth order
    const auto at = [&](double by) {
      VectorXd moved = x;
      moved(i) += by * width;
      return map(moved);
    };
    D.col(i) = (8.0 * (at(1.0) - at(-1.0)) - (at(2.0) - at(-2.0))) / (12.0 * width);
  }
  MatrixXd W = MatrixXd::Zero(8, 8);
  W.block<2, 2>(0, 2) = -MatrixXd::Identity(2, 2);  // dp∧dq on (q, p)
  W.block<2, 2>(2, 0) = MatrixXd::Identity(2, 2);
  W.block<2, 2>(4, 6) = MatrixXd::Identity(2, 2);  // -dE∧ds on (s, E)
  W.block<2, 2>(6, 4) = -MatrixXd::Identity(2, 2);
  return (D.transpose() * W * D - W).cwiseAbs().maxCoeff();
}

}  // namespace

TEST_CASE("a family of maps with r parameters solved from its generators keeps the extended form") {
  // With the gradient of a function of g added, as a step potential is: without it g changes by 1/(g Γ) with z, too
  // much for differences of doubles.
  constexpr double differences = 1e-8;
  const auto K = [](const Vector4d& z, const Vector2d& g) { return step_of(z, g).K; };
  const auto gradient = [](const Vector2d& g) { return Vector2d(2.0 * g(0) * g(1), g(0) * g(0)); };
  CHECK(defect_of_form([&](const Vector4d& z, const Vector2d& g) -> Vector2d { return K(z, g) + gradient(g); }) <
        differences);
  // Twins: what is no gradient may not be added, and other energies than K do not do.
  CHECK(defect_of_form([&](const Vector4d& z, const Vector2d& g) -> Vector2d {
          return K(z, g) + gradient(g) + Vector2d(0.1 * g(1), 0.0);
        }) > 1e-3);
  CHECK(defect_of_form([&](const Vector4d& z, const Vector2d& g) -> Vector2d {
          return Vector2d(H(step_of(z, g).z), K(z, g)(1)) + gradient(g);
        }) > 1e-3);
}

TEST_CASE("two laws by two parameters hold exactly, and the second parameter does not vanish with the step") {
  // g² for each step of a length that is halved twice: s² at t = 6 tends to a function of time, not to 0, and the orbit
  // is turned by it.
  const Vector4d start(1.0, 0.0, 0.3, 0.7);
  std::vector<double> shift;
  for (const double h : {0.1, 0.05, 0.025}) {
    Vector4d z = start;
    const Vector2d E = step_of(z, {h, 0.0}).K;
    VectorXd g = Vector2d(h, 0.0), before = g;
    Vector2d s = Vector2d::Zero();
    double worst = 0.0;
    while (s(0) < 6.0) {
      VectorXd next = s(0) > 0.0 ? VectorXd(2.0 * g - before) : g;
      REQUIRE(solve([&](const VectorXd& length) -> VectorXd { return step_of(z, length).K - E; }, next, 1e-12));
      before = g;
      g = next;
      const Step step = step_of(z, g);
      worst = std::max(worst, (step.K - E).cwiseAbs().maxCoeff());
      z = step.z;
      s += g;
    }
    CHECK(worst < 1e-12);
    shift.push_back(s(1));
  }
  for (const double s : shift) {
    CHECK(s > 0.2);
    CHECK(s < 0.4);
  }
  CHECK(std::abs(shift[2] - shift[1]) < std::abs(shift[1] - shift[0]));
}

namespace {

// ---- A line of nodes that are free in x: u_tt - u_xx = -V'(u), with u(x + length) = u + jump ------------------------

/// The action of a cell between the levels 0 and 1 and the nodes a and b, with u_t and u_x of the cell and V at its
/// centre, and its slopes and second derivatives by all eight corners.
class Cell {
public:
  explicit Cell(const std::function<formula::Expression(formula::Expression)>& V) {
    const auto graph = std::make_shared<formula::Graph>();
    std::vector<formula::Expression> c;
    for (const char* const name : {"u0a", "x0a", "u0b", "x0b", "u1a", "x1a", "u1b", "x1b"}) {
      c.push_back(graph->variable(name));
    }
    const formula::Expression h = graph->variable("h"), rho = graph->variable("rho"), w = graph->variable("w"),
                              natural = graph->variable("natural");
    const auto by_t = [&](int i) {
      const auto at = static_cast<std::size_t>(i);
      return 0.5 * (c[4 + at] + c[6 + at] - c[at] - c[2 + at]);
    };
    const auto by_x = [&](int i) {
      const auto at = static_cast<std::size_t>(i);
      return 0.5 * (c[2 + at] + c[6 + at] - c[at] - c[4 + at]);
    };
    const formula::Expression spacing = by_x(1), u_x = by_x(0) / spacing, u_t = (by_t(0) - u_x * by_t(1)) / h;
    const formula::Expression mean = 0.25 * (c[0] + c[2] + c[4] + c[6]);
    formula::Expression A = h * spacing * (0.5 * u_t * u_t - 0.5 * u_x * u_x - V(mean));
    // The mesh's own inertia and springs; of node a.
    A = A + 0.5 * rho * pow(c[5] - c[1], 2.0) / h - h * w * (natural * natural / spacing + spacing - 2.0 * natural);
    std::vector<formula::Expression> outputs = formula::gradient(A, c);
    for (const formula::Expression slope : std::vector(outputs)) {
      const auto row = formula::gradient(slope, c);
      outputs.insert(outputs.end(), row.begin(), row.end());
    }
    c.insert(c.end(), {h, rho, w, natural});
    evaluate_.emplace(formula::Bytecode(outputs, c));
  }
  /// 8 slopes, then 8 × 8 second derivatives.
  std::span<const double> at(const std::array<double, 12>& corners) { return {evaluate_->at(corners.data()), 72}; }

private:
  std::optional<formula::ScalarEvaluator> evaluate_;
};

class Line {
public:
  Line(Cell cell, int nodes, double length, double jump, double h, double rho, double w)
      : cell_(std::move(cell)), n_(nodes), length_(length), jump_(jump), h_(h), rho_(rho), w_(w) {}

  /// ∂A/∂(level 0), ∂A/∂(level 1), and ∂²A/∂(level 0)∂(level 1), of (u_0, x_0, u_1, x_1, …).
  void action(const VectorXd& from, const VectorXd& to, VectorXd& slope_0, VectorXd& slope_1, MatrixXd* mixed) {
    slope_0 = slope_1 = VectorXd::Zero(2 * n_);
    if (mixed != nullptr) {
      *mixed = MatrixXd::Zero(2 * n_, 2 * n_);
    }
    for (Index i = 0; i < n_; ++i) {
      const Index j = (i + 1) % n_;
      const double over = j == 0 ? 1.0 : 0.0;
      const auto s = cell_.at({from(2 * i), from(2 * i + 1), from(2 * j) + over * jump_,
                               from(2 * j + 1) + over * length_, to(2 * i), to(2 * i + 1), to(2 * j) + over * jump_,
                               to(2 * j + 1) + over * length_, h_, rho_, w_, length_ / static_cast<double>(n_)});
      const std::array<Index, 4> place = {2 * i, 2 * i + 1, 2 * j, 2 * j + 1};
      for (std::size_t a = 0; a < 4; ++a) {
        slope_0(place.at(a)) += s[a];
        slope_1(place.at(a)) += s[4 + a];
        for (std::size_t b = 0; b < 4 && mixed != nullptr; ++b) {
          (*mixed)(place.at(a), place.at(b)) += s[8 + 8 * a + 4 + b];
        }
      }
    }
  }

  /// The level after two; false if Newton's method finds none near by, or the mesh folds.
  bool advance(const VectorXd& last, const VectorXd& now, VectorXd& next, bool free) {
    VectorXd slope, before, unused;
    MatrixXd mixed;
    action(last, now, unused, before, nullptr);
    next = 2.0 * now - last;
    if (!free) {
      for (Index i = 0; i < n_; ++i) {
        next(2 * i + 1) = now(2 * i + 1);
      }
    }
    double best = std::numeric_limits<double>::infinity();
    VectorXd kept = next;
    for (int iteration = 0; iteration < 40; ++iteration) {
      action(now, next, slope, unused, &mixed);
      VectorXd residual = slope + before;
      for (Index i = 0; i < n_ && !free; ++i) {
        residual(2 * i + 1) = 0.0;
        mixed.row(2 * i + 1).setZero();
        mixed(2 * i + 1, 2 * i + 1) = 1.0;
      }
      const double size = residual.cwiseAbs().maxCoeff() / before.cwiseAbs().maxCoeff();
      if (size < best) {
        best = size;
        kept = next;
      } else if (best < 1e-11) {
        break;
      }
      next -= mixed.fullPivLu().solve(residual);
      if (!next.allFinite()) {
        break;
      }
    }
    next = kept;
    bool folded = false;
    for (Index i = 0; i < n_; ++i) {
      const Index j = (i + 1) % n_;
      folded = folded || next(2 * j + 1) + (j == 0 ? length_ : 0.0) <= next(2 * i + 1);
    }
    return best < 1e-9 && !folded;
  }
  /// The momentum of field and mesh that leaves a step: what its action gives for a translation of its end.
  double momentum(const VectorXd& from, const VectorXd& to) {
    VectorXd slope_0, slope_1;
    action(from, to, slope_0, slope_1, nullptr);
    double sum = 0.0;
    for (Index i = 0; i < n_; ++i) {
      sum += slope_1(2 * i + 1);
    }
    return sum;
  }

  struct Run {
    int levels = 1;
    double momentum_range = 0.0;
  };
  /// Of a solution u(x, t), with the mesh at rest at the start.
  Run run(const std::function<double(double x, double t)>& u, int levels, bool free) {
    VectorXd last(2 * n_), now(2 * n_), next;
    for (Index i = 0; i < n_; ++i) {
      const double x = length_ * static_cast<double>(i) / static_cast<double>(n_);
      last(2 * i) = u(x, 0.0);
      now(2 * i) = u(x, h_);
      last(2 * i + 1) = now(2 * i + 1) = x;
    }
    Run result;
    double least = momentum(last, now), most = least;
    while (result.levels < levels && advance(last, now, next, free)) {
      const double p = momentum(now, next);
      least = std::min(least, p);
      most = std::max(most, p);
      last = now;
      now = next;
      ++result.levels;
    }
    result.momentum_range = most - least;
    return result;
  }

private:
  Cell cell_;
  Index n_;
  double length_, jump_, h_, rho_, w_;
};

formula::Expression klein_gordon(formula::Expression u) {
  return 0.5 * u * u;
}
formula::Expression sine_gordon(formula::Expression u) {
  return 1.0 - cos(u);
}

constexpr double turn = 2.0 * std::numbers::pi;
double two_waves(double x, double t) {
  return std::cos(x - std::numbers::sqrt2 * t) + 0.5 * std::cos(2.0 * x + std::sqrt(5.0) * t + 0.3);
}

}  // namespace

namespace {

/// What the mesh makes of the discretisation error of the action, of Klein and Gordon's equation. On a smooth mesh
/// x = X(τ, s), s = εi, τ = t = εk, it is S_0 + ε⁴ Σ L_2 + O(ε⁶), and S_0 does not depend on the mesh.
/// For cells with u_t, u_x and V at the centre, p = X_τ, q = X_s, V'' = 1,
///
///     12 L_2 = q (u_tt² + 3p u_tt u_tx + (3/2) p² (u_tt u_xx + u_tx²) + p³ u_tx u_xx)
///              + q³ (½(u_x² - u_xx² - u_tx²) - p u_tx u_xx)
class MeshError {
public:
  /// \param factor of the term with p², 3/2
  explicit MeshError(double factor) {
    using formula::Expression;
    const auto graph = std::make_shared<formula::Graph>();
    const auto by = [](Expression f, Expression v) { return formula::gradient(f, std::vector{v}).front(); };
    const Expression tau = graph->variable("tau"), s = graph->variable("s"), x = graph->variable("x"),
                     p = graph->variable("p"), q = graph->variable("q");
    const Expression u = cos(x - std::numbers::sqrt2 * tau) + 0.5 * cos(2.0 * x + std::sqrt(5.0) * tau + 0.3);
    const Expression X = 1.3 * s + 0.2 * sin(s + 0.7 * tau) + 0.15 * tau * tau;
    const Expression u_x = by(u, x), u_t = by(u, tau), u_xx = by(u_x, x), u_tx = by(u_t, x), u_tt = by(u_t, tau);
    const Expression L = (q * (u_tt * u_tt + 3.0 * p * u_tt * u_tx + factor * p * p * (u_tt * u_xx + u_tx * u_tx) +
                               p * p * p * u_tx * u_xx) +
                          q * q * q * (0.5 * (u_x * u_x - u_xx * u_xx - u_tx * u_tx) - p * u_tx * u_xx)) /
                         12.0;
    const Expression X_tau = by(X, tau), X_s = by(X, s);
    const auto along_tau = [&](Expression f) {
      return by(f, tau) + by(f, x) * X_tau + by(f, p) * by(X_tau, tau) + by(f, q) * by(X_s, tau);
    };
    const auto along_s = [&](Expression f) { return by(f, x) * X_s + by(f, p) * by(X_tau, s) + by(f, q) * by(X_s, s); };
    euler_.emplace(formula::Bytecode(std::vector{by(L, x) - along_tau(by(L, p)) - along_s(by(L, q))},
                                     std::vector{tau, s, x, p, q}));
    mesh_.emplace(formula::Bytecode(std::vector{X, X_tau, X_s}, std::vector{tau, s}));
    wave_.emplace(formula::Bytecode(std::vector{u, u_x}, std::vector{x, tau}));
  }
  double place(double tau, double s) { return mesh_->at(std::array{tau, s}.data())[0]; }
  double u(double x, double t) { return wave_->at(std::array{x, t}.data())[0]; }
  double u_x(double x, double t) { return wave_->at(std::array{x, t}.data())[1]; }
  double euler_lagrange(double tau, double s) {
    const double* const mesh = mesh_->at(std::array{tau, s}.data());
    return euler_->at(std::array{tau, s, mesh[0], mesh[1], mesh[2]}.data())[0];
  }

private:
  std::optional<formula::ScalarEvaluator> euler_, mesh_, wave_;
};

/// d𝕊/dX of one node, u moved along, by the action's own slopes in the four cells around it, over ε⁴.
double residual_of_node(Cell& cell, MeshError& error, double tau, double s, double epsilon) {
  double sum = 0.0;
  for (const std::size_t k : {0, 1}) {
    for (const std::size_t i : {0, 1}) {  // the node is corner (k, i) of this cell
      std::array<double, 12> corners{};
      for (std::size_t c = 0; c < 4; ++c) {
        const double t = tau + epsilon * (static_cast<double>(c / 2) - static_cast<double>(k));
        corners.at(2 * c + 1) = error.place(t, s + epsilon * (static_cast<double>(c % 2) - static_cast<double>(i)));
        corners.at(2 * c) = error.u(corners.at(2 * c + 1), t);
      }
      corners[8] = epsilon;  // h; no inertia, no springs
      const std::span<const double> slopes = cell.at(corners);
      const std::size_t place = 4 * k + 2 * i;
      sum += slopes[place + 1] + error.u_x(error.place(tau, s), tau) * slopes[place];
    }
  }
  return sum / std::pow(epsilon, 4);
}

}  // namespace

TEST_CASE("nodes that are free in x make the error of the action stationary, in closed form") {
  Cell cell(klein_gordon);
  MeshError closed(1.5), wrong(1.0);
  double largest = 0.0, coarse = 0.0, fine = 0.0, twin = 0.0;
  for (const double s : {0.2, 1.1, 2.3, 3.4, 4.8}) {
    const double tau = 0.4 + 0.1 * s, expected = closed.euler_lagrange(tau, s);
    largest = std::max(largest, std::abs(expected));
    coarse = std::max(coarse, std::abs(residual_of_node(cell, closed, tau, s, 0.02) - expected));
    const double measured = residual_of_node(cell, closed, tau, s, 0.01);
    fine = std::max(fine, std::abs(measured - expected));
    twin = std::max(twin, std::abs(measured - wrong.euler_lagrange(tau, s)));
  }
  INFO("largest " << largest << ", distances " << coarse << ", " << fine << ", of the wrong term " << twin);
  // The next term of 𝕊 is smaller by ε². Rounding of the slopes, 1e-16, is 1e-8 beside ε⁴.
  CHECK(fine < 0.01 * largest);
  CHECK(fine < coarse / 3.5);
  CHECK(fine > coarse / 4.5);
  CHECK(twin > 0.1 * largest);
}

TEST_CASE("one node a level that is free in x: its momentum law and its equation contradict each other") {
  // Momentum: J (u_t,k - u_t,k-1) = 0. Value: u_t,k - u_t,k-1 = -h/2 (V'(ū_k) + V'(ū_k-1)). With sin ū = 0.5 in the
  // last cell no step near it meets both: what is left is h/2 (sin ū_k + 0.5) times the length.
  const double h = 0.1, length = 3.0;
  Line line(Cell(sine_gordon), 1, length, turn, h, 0.0, 0.0);
  VectorXd last(2), now(2), before, slope, unused;
  const double middle = std::asin(0.5) - 0.5 * turn;  // ū is that of the nodes, and half of the jump
  last << middle - 0.005, 0.0;
  now << middle + 0.005, 0.0;
  line.action(last, now, unused, before, nullptr);
  double least = std::numeric_limits<double>::infinity();
  for (int i = -20; i <= 20; ++i) {
    for (int j = -20; j <= 20; ++j) {
      VectorXd next = now;
      next(0) += 0.01 + 0.005 * i;
      next(1) += 0.005 * j;
      line.action(now, next, slope, unused, nullptr);
      // The combination of both equations that is free of the step's own u_t.
      const VectorXd rest = slope + before;
      least = std::min(least, std::abs(rest(0) + rest(1) * length / turn));
    }
  }
  CHECK(least > 0.5 * length * h * (0.5 + std::sin(std::asin(0.5) - 0.15)) * 0.9);
  VectorXd next;
  // Newton's method goes to a mirror image a third of the period away, or nowhere; the step itself is a hundredth long.
  CHECK_FALSE((line.advance(last, now, next, true) && (next - now).norm() < 0.5));
  CHECK((line.advance(last, now, next, false) && (next - now).norm() < 0.5));  // the twin: with the node held
}

TEST_CASE("nodes that are free in x have no next level where the mesh equation has no type of its own") {
  const int nodes = 33;
  const double h = 0.5 * turn / nodes;
  const auto travelling = [](double x, double t) { return std::cos(x - std::numbers::sqrt2 * t); };
  CHECK(Line(Cell(klein_gordon), nodes, turn, 0.0, h, 0.0, 0.0).run(travelling, 40, true).levels <= 5);
  CHECK(Line(Cell(klein_gordon), nodes, turn, 0.0, h, 0.0, 0.0).run(travelling, 40, false).levels == 40);
}

TEST_CASE("with inertia and springs the mesh goes on, and field and mesh keep their momentum to rounding") {
  const int nodes = 33, levels = 100;
  const double spacing = turn / nodes, h = 0.5 * spacing, size = 3.0;  // of max(|u_tt u_xx|, u_tx²)
  const double rho = 10.0 * 0.25 * spacing * h * h * size, w = 10.0 * 0.25 * spacing * spacing * size;
  const Line::Run with = Line(Cell(sine_gordon), nodes, turn, 0.0, h, rho, w).run(two_waves, levels, true);
  CHECK(with.levels == levels);
  CHECK(with.momentum_range < 1e-11);  // a hundred steps of equations solved to 1e-11 of terms of size 0.1
  // The twin: on a fixed mesh momentum is kept to truncation error.
  const Line::Run fixed = Line(Cell(sine_gordon), nodes, turn, 0.0, h, 0.0, 0.0).run(two_waves, levels, false);
  CHECK(fixed.levels == levels);
  CHECK(fixed.momentum_range > 1e-4);
}
