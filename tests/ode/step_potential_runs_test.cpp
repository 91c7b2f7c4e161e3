// Ten thousand steps with a step potential (theory, section 9): the extended two-form along whole orbits, through the
// places where η = 0, and the way back.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <vector>

#include <Eigen/Dense>

#include <rubato/base/limits.hpp>
#include <rubato/ode/integrate.hpp>
#include <rubato/ode/tangent.hpp>
#include <rubato/variation/gauss_tableau.hpp>

#include "systems.hpp"

using namespace rubato;
using systems::System;

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Kind = StepPotentialChoice::Kind;

constexpr int many_steps = 10000;

System rotating_pendulum(double step) {
  System system = systems::pendulum();
  system.initial = {.q = {0.2}, .p = {2.2}};
  system.step = step;
  return system;
}

System eccentric_kepler(double step_ratio) {
  System system = systems::kepler(0.8);
  system.step *= step_ratio;
  return system;
}

/// A step of Gauss collocation and its tangent (z, t, E) ↦ (z_1, t + h, E), from its own stages:
///
///     δZ_i = δz + Σ_j a_ij (h JH_zz(Z_j) δZ_j + f_j δh),   Σ_i b_i ∇H(Z_i)·δZ_i + f''(h) δh = δE.
class GaussTangent {
public:
  GaussTangent(const Hamiltonian& hamiltonian, int stages)
      : evaluator_(hamiltonian), tableau_(stages), size_(static_cast<Index>(evaluator_.dimension())) {}

  struct Step {
    VectorXd end;
    double energy = 0.0;  ///< K = Σ b_i H(Z_i)
    double slope = 0.0;   ///< dK/dh, which has the sign of η
    MatrixXd tangent;
  };

  Step operator()(const VectorXd& z, double h, double potential_slope) {
    const int m = tableau_.stages;
    const Index rows = m * size_, n = size_ / 2;
    MatrixXd f(size_, m), Z = z.replicate(1, m);
    std::vector<VectorXd> g(static_cast<std::size_t>(m), VectorXd(size_));
    MatrixXd hessian(size_, size_);
    VectorXd energies(m), slope(size_);
    for (int iteration = 0; iteration < 60; ++iteration) {
      const MatrixXd last = Z;
      for (Index i = 0; i < m; ++i) {
        VectorXd& gradient = g[static_cast<std::size_t>(i)];
        const VectorXd point = Z.col(i);
        energies[i] = evaluator_.gradient(point.data(), gradient.data());
        f.col(i) << gradient.tail(n), -gradient.head(n);
      }
      Z = z.replicate(1, m) + h * f * tableau_.a.transpose();
      if ((Z - last).cwiseAbs().maxCoeff() <= 4.0 * epsilon * Z.cwiseAbs().maxCoeff()) {
        break;
      }
    }
    // Unknowns δZ and δh, by δz and δE.
    MatrixXd left = MatrixXd::Identity(rows + 1, rows + 1), right = MatrixXd::Zero(rows + 1, size_ + 1);
    left(rows, rows) = potential_slope;
    MatrixXd slopes(size_, rows + 1);  // of z_1 - z by δZ and δh
    for (Index j = 0; j < m; ++j) {
      const VectorXd point = Z.col(j);
      evaluator_.hessian(point.data(), slope.data(), hessian.data());
      MatrixXd jacobian(size_, size_);
      jacobian << hessian.bottomRows(n), -hessian.topRows(n);
      for (Index i = 0; i < m; ++i) {
        left.block(i * size_, j * size_, size_, size_) -= h * tableau_.a(i, j) * jacobian;
      }
      slopes.middleCols(j * size_, size_) = h * tableau_.b[j] * jacobian;
      left.block(rows, j * size_, 1, size_) = tableau_.b[j] * g[static_cast<std::size_t>(j)].transpose();
      left.col(rows).segment(j * size_, size_) = -f * tableau_.a.row(j).transpose();
      right.block(j * size_, 0, size_, size_).setIdentity();
    }
    slopes.col(rows) = f * tableau_.b;
    right(rows, size_) = 1.0;
    const MatrixXd solved = left.partialPivLu().solve(right);
    Step step;
    step.end = z + h * f * tableau_.b;
    step.energy = energies.dot(tableau_.b);
    const VectorXd by_step = left.topLeftCorner(rows, rows).partialPivLu().solve(left.col(rows).head(rows));
    step.slope = -left.row(rows).head(rows).dot(by_step);
    step.tangent = MatrixXd::Identity(size_ + 2, size_ + 2);
    const MatrixXd moved = slopes * solved;
    step.tangent.topLeftCorner(size_, size_) += moved.leftCols(size_);
    step.tangent.topRightCorner(size_, 1) = moved.rightCols(1);
    step.tangent.block(size_, 0, 1, size_) = solved.bottomLeftCorner(1, size_);
    step.tangent(size_, size_ + 1) = solved(rows, size_);
    return step;
  }

private:
  HamiltonianEvaluator evaluator_;
  GaussTableau tableau_;
  Index size_;
};

VectorXd joined(const OrbitIntegrator& run) {
  return Eigen::Map<const VectorXd>(run.scheme().state().data(), static_cast<Index>(run.scheme().state().size()));
}

}  // namespace

TEST_CASE("the extended two-form is preserved over ten thousand steps, through the places where η = 0") {
  struct Case {
    System system;
    int stages;
    bool by_differences;
  };
  const Case cases[] = {{rotating_pendulum(0.05), 1, true},
                        {eccentric_kepler(5.0), 1, true},
                        {rotating_pendulum(0.1), 2, false},
                        {eccentric_kepler(10.0), 2, false}};
  for (const auto& [system, stages, by_differences] : cases) {
    INFO(system.name << ", " << stages << " stages");
    const InitialState& start = system.initial;
    const auto size = static_cast<Index>(2 * start.q.size());
    const Index time = size, energy = size + 1;
    IntegrationOptions options{
        .lagrangian = Gauss{stages}, .step = system.step, .until = 1e9, .potential = {.kind = Kind::automatic}};
    if (stages == 1) {
      options.lagrangian = Midpoint{};
    }
    OrbitIntegrator run(system.hamiltonian, start, options);
    GaussTangent tangent(system.hamiltonian, stages);
    HamiltonianEvaluator evaluator(system.hamiltonian);
    const MatrixXd form = extended_two_form(start.q.size());

    MatrixXd P = MatrixXd::Identity(size + 2, size + 2), wrong = P;
    VectorXd direction = VectorXd::Unit(size + 2, 0);  // dq_1 at the same first step
    double bound = 0.0, largest = 0.0, excess = 0.0, excess_of_K = 0.0, last_slope = 0.0, E = 0.0;
    int changes = 0;
    StepPotential f;
    for (int k = 0; k < many_steps; ++k) {
      const VectorXd z = joined(run);
      const StepReport report = run.step();
      REQUIRE(report.status == Status::success);
      REQUIRE(!report.off_law);
      f = run.levels().potential();
      E = k == 0 ? report.energy : E;
      const GaussTangent::Step step = tangent(z, report.h, f.slope(report.h));
      changes += step.slope * last_slope < 0.0 ? 1 : 0;
      last_slope = step.slope;

      // The step is the one whose tangent that is: the stages are found to a few ε of z, which the angle of a rotating
      // pendulum has made some 2000, and H there to as much times its slope.
      const double rounding = 8.0 * epsilon * std::max(1.0, z.cwiseAbs().maxCoeff());
      VectorXd gradient(size);
      evaluator.gradient(z.data(), gradient.data());
      REQUIRE((step.end - joined(run)).cwiseAbs().maxCoeff() <= rounding);
      REQUIRE(std::abs(step.energy + f.energy(report.h) - E) <=
              1e-13 * std::max(1.0, std::abs(E)) + 4.0 * rounding * std::max(1.0, gradient.cwiseAbs().maxCoeff()));

      // Each product rounds at (2n + 2) ε |T| |P|, which the form multiplies by |TP|.
      const MatrixXd& T = step.tangent;
      const MatrixXd before = P;
      P = T * before;
      bound += static_cast<double>(size + 2) * epsilon * T.cwiseAbs().maxCoeff() * before.cwiseAbs().maxCoeff() *
               P.cwiseAbs().maxCoeff();
      largest = std::max(largest, P.cwiseAbs().maxCoeff());
      excess = std::max(excess, (P.transpose() * form * P - form).cwiseAbs().maxCoeff() / bound);

      // The twins: f'' off by a hundredth, and K in place of E.
      wrong = tangent(z, report.h, 0.99 * f.slope(report.h)).tangent * wrong;
      if (k == 0) {
        direction[energy] = -T(time, 0) / T(time, energy);
      }
      MatrixXd of_K = P;
      of_K.row(energy) -= f.slope(report.h) * (P.row(time) - before.row(time));
      excess_of_K = std::max(excess_of_K, (of_K.transpose() * form * of_K - form).cwiseAbs().maxCoeff() / bound);
    }
    CHECK(changes > 50);
    CHECK(excess <= 1.0);
    CHECK(bound <= 1e-7 * largest * largest);  // so that the bound says something
    CHECK(excess_of_K > 100.0);

    // Any f'' has a form that is preserved: that this is the run's own is given by runs from nearby, so near that their
    // ends are about 1e-4 off, and the fifth derivative does not show. h is known to some 1e-12, which over d is up to
    // 1e-4 of a rate and grows along the run; where order 4 leaves a slope of 1e-3, and tangents
    // that cancel to a few thousandths, that is too much after so many steps.
    if (by_differences) {
      const double d = 1e-4 / (P * direction).head(size + 1).cwiseAbs().maxCoeff();
      std::vector<VectorXd> ends;
      for (const double shift : {2.0 * d, d, -d, -2.0 * d}) {
        InitialState nearby = start;
        nearby.q[0] += shift;
        options.potential = {.kind = Kind::stated, .potential = f};
        OrbitIntegrator other(system.hamiltonian, nearby, options);
        for (int k = 0; k < many_steps; ++k) {
          REQUIRE(other.step().status == Status::success);
        }
        VectorXd end(size + 1);
        end << joined(other), other.t();
        ends.push_back(end);
      }
      const VectorXd rate = (8.0 * (ends[1] - ends[2]) - (ends[0] - ends[3])) / (12.0 * d);
      const auto missed = [&](const MatrixXd& tangents) {
        return (rate - (tangents * direction).head(size + 1)).cwiseAbs().maxCoeff() / rate.cwiseAbs().maxCoeff();
      };
      CHECK(missed(P) < 1e-2);
      CHECK(missed(wrong) > 0.3);
    }
  }
}

TEST_CASE("a run of ten thousand steps comes back as far as the conditions of its steps allow") {
  for (const System& system : {rotating_pendulum(0.05), eccentric_kepler(5.0)}) {
    INFO(system.name);
    const InitialState& start = system.initial;
    const std::size_t n = start.q.size();
    HamiltonianEvaluator evaluator(system.hamiltonian);
    struct Return {
      double z = 0.0, t = 0.0;
      double slack = 0.0;    ///< Σ h · condition: by how much levels may be off, there and back
      double fastest = 0.0;  ///< max |f|
    };
    /// There and back; `wrong` times f' on the way back.
    const auto return_of = [&](IntegrationOptions options, double wrong = 1.0) {
      options.step = system.step;
      options.until = 1e9;
      Return result;
      bool lost = false;
      OrbitIntegrator there(system.hamiltonian, start, options);
      const auto follow = [&](OrbitIntegrator& run) {
        for (int k = 0; k < many_steps; ++k) {
          const StepReport step = run.step();
          if (step.status != Status::success && options.potential.kind == Kind::none) {
            lost = true;  // off the law an orbit may be thrown out
            return;
          }
          REQUIRE(step.status == Status::success);
          const auto velocity =
              systems::velocity(evaluator, {run.scheme().state().begin(), run.scheme().state().end()});
          for (const double component : velocity) {
            result.fastest = std::max(result.fastest, std::abs(component));
          }
          result.slack += std::isnan(step.condition) ? 0.0 : std::abs(step.h) * step.condition;
        }
      };
      follow(there);
      if (lost) {
        return Return{.z = infinity};
      }
      if (options.potential.kind == Kind::automatic) {
        StepPotential f = there.levels().potential();
        f.strength *= wrong;
        options.potential = {.kind = Kind::stated, .potential = f};
      }
      options.step = -(options.levels == Levels::fixed ? system.step : there.levels().last_step());
      options.until = -1e9;
      const VectorXd z = joined(there);
      OrbitIntegrator back(system.hamiltonian,
                           {.q = {z.data(), z.data() + n}, .p = {z.data() + n, z.data() + 2 * n}, .t = there.t()},
                           options);
      follow(back);
      result.z =
          systems::distance(systems::joined(start), {back.scheme().state().begin(), back.scheme().state().end()});
      result.t = std::abs(back.t());
      result.z = lost ? infinity : result.z;
      return result;
    };
    const Return equal = return_of({.levels = Levels::fixed});
    const Return levels = return_of({.potential = {.kind = Kind::automatic}});
    const Return wrong = return_of({.potential = {.kind = Kind::automatic}}, 1.001);
    const Return plain = return_of({.on_singular = OnSingular::plain, .potential = {.kind = Kind::none}});

    // With equal steps each rounds z by an ε, at random, √N ε in all, and what that changes of the energy shifts the
    // phase by as much again in each of the N/2 steps that follow on average, at the speed of the motion.
    const double rounding = 0.5 * std::pow(many_steps, 1.5) * epsilon * levels.fastest;
    CHECK(equal.z <= rounding);
    CHECK(equal.t == 0.0);
    // A level that is off by h times its condition moves on along the orbit, and t with it: the orbit is the same one.
    // The conditions are bounds that add up; the levels after it differ by a few times as much, as h follows the place.
    CHECK(levels.t <= 4.0 * levels.slack);
    CHECK(levels.z <= 4.0 * levels.fastest * levels.slack + rounding);
    CHECK(levels.slack < 1e-7);
    // The twins: another f' on the way back, by a thousandth; steps off the law.
    CHECK(wrong.z > 1e4 * (4.0 * levels.fastest * levels.slack + rounding));
    CHECK(plain.z > 0.1);
  }
}
