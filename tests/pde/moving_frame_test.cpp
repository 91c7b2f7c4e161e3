// A lattice in a moving frame keeps the extended form of section 8, with the energy of the frame as the generator.

#include <cmath>
#include <memory>
#include <numbers>
#include <vector>

#include <Eigen/Core>
#include <catch2/catch.hpp>

#include <rubato/pde/lattice_method.hpp>
#include <rubato/pde/moving_frame.hpp>

#include "equations.hpp"

using namespace rubato;
using namespace rubato::tests;

namespace {

const grids::Grid ring({{"x", 0, 2 * std::numbers::pi, 7}});

/// One step of `fourier` for iψ_t + ψ_xx + 2|ψ|²ψ = 0 in a frame from the state (p, q, t, E).
class Step {
public:
  /// \param wrong multiplies p at the first node, which the law then has as an addend
  Step(const MovingFrame& frame, const Eigen::VectorXd& from, double wrong)
      : system_(frame.seen(schroedinger(2.0))), from_(from), addend_(wrong * from[0]) {
    InitialFields fields(4);
    for (std::size_t f = 0; f < 2; ++f) {
      const double* first = from.data() + f * ring.size();
      fields[f] = std::vector<double>(first, first + ring.size());
    }
    const auto method = make_lattice_method({.name = "fourier"});
    scheme_ = method->scheme(system_, ring, method->first_level(system_, ring, fields).level, guess);
  }
  static constexpr double guess = 0.1;

  /// E_k of the step of length h, and the addend.
  [[nodiscard]] double law(double h) {
    REQUIRE(scheme_->advance(h, 0.0) == Status::success);
    return scheme_->discrete_energy() + addend_;
  }
  /// (p, q, t, E) after the step whose law has the E of the state.
  [[nodiscard]] Eigen::VectorXd next() {
    const Eigen::Index n = (from_.size() - 2) / 2;
    const double energy = from_[2 * n + 1];
    double before = guess, miss_before = law(before) - energy, h = 1.01 * guess;
    // To what rounding leaves of h, some 1e-15 over dE/dh, 0.1 and more.
    for (double miss = law(h) - energy; std::abs(h - before) > 1e-13; miss = law(h) - energy) {
      const double secant = (h - before) / (miss - miss_before);
      before = h;
      miss_before = miss;
      h -= miss * secant;
    }
    scheme_->accept();
    Eigen::VectorXd to = from_;
    to[2 * n] += h;
    for (int f = 0; f < 2; ++f) {
      to.segment(f * n, n) = Eigen::VectorXd::Map(scheme_->level().fields.field(f).data(), n);
    }
    return to;
  }

private:
  MultisymplecticSystem system_;
  Eigen::VectorXd from_;
  double addend_;
  std::unique_ptr<LatticeScheme> scheme_;
};

/// Σ Δx dp∧dq - dE∧dt.
Eigen::MatrixXd extended_form() {
  const auto n = static_cast<Eigen::Index>(ring.size());
  Eigen::MatrixXd form = Eigen::MatrixXd::Zero(2 * n + 2, 2 * n + 2);
  form.block(0, n, n, n).diagonal().setConstant(ring.axis(0).spacing());
  form(2 * n + 1, 2 * n) = -1.0;
  return form - form.transpose();
}

/// The largest entry of Ψ*ω - ω, derivatives by differences of this width.
double defect(const MovingFrame& frame, double wrong, double width) {
  const auto n = static_cast<Eigen::Index>(ring.size());
  Eigen::VectorXd z = Eigen::VectorXd::Zero(2 * n + 2);
  for (Eigen::Index i = 0; i < n; ++i) {
    const double x = ring.axis(0).spacing() * static_cast<double>(i);
    z[i] = 0.8 + 0.4 * std::cos(x) + 0.2 * std::sin(2 * x);
    z[n + i] = 0.3 * std::sin(x + 0.5) - 0.2 * std::cos(3 * x);
  }
  z[2 * n + 1] = Step(frame, z, wrong).law(Step::guess);
  Eigen::MatrixXd slope(2 * n + 2, 2 * n + 2);
  for (Eigen::Index c = 0; c < slope.cols(); ++c) {
    Eigen::VectorXd up = z, down = z;
    up[c] += width;
    down[c] -= width;
    slope.col(c) = (Step(frame, up, wrong).next() - Step(frame, down, wrong).next()) / (2 * width);
  }
  const Eigen::MatrixXd form = extended_form();
  return (slope.transpose() * form * slope - form).cwiseAbs().maxCoeff();
}

}  // namespace

TEST_CASE("a step in a frame keeps the extended form") {
  Eigen::MatrixXd B = Eigen::MatrixXd::Zero(4, 4);
  B(0, 1) = B(2, 3) = -1.0;
  B(1, 0) = B(3, 2) = 1.0;
  const MovingFrame rest{.velocity = {0.0}}, moving{.velocity = {0.7}, .rate = 0.4, .B = B};
  for (const MovingFrame& frame : {rest, moving}) {
    // Differences of second order: a tenth of the width takes a hundredth of the defect, until rounding over the width.
    const double wide = defect(frame, 0.0, 1e-4), narrow = defect(frame, 0.0, 1e-5);
    CHECK(wide < 1.0);
    CHECK(narrow == Approx(wide / 100.0).epsilon(0.1));

    // The twin: a law of another generator.
    CHECK(defect(frame, 0.3, 1e-5) > 100.0 * narrow);
  }
}
