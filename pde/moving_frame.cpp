#include <rubato/pde/moving_frame.hpp>

#include <algorithm>
#include <complex>
#include <utility>

#include <Eigen/Core>

#include <rubato/grids/fourier.hpp>
#include <rubato/grids/slab.hpp>
#include <rubato/solve/small_matrices.hpp>

namespace rubato {

MultisymplecticSystem MovingFrame::seen(const MultisymplecticSystem& laboratory) const {
  std::vector<Eigen::MatrixXd> K;
  for (int a = 0; a < laboratory.directions(); ++a) {
    K.emplace_back(laboratory.K(a) - velocity[static_cast<std::size_t>(a)] * laboratory.M());
  }
  formula::Expression S = laboratory.expression();
  if (rate != 0.0) {
    const Eigen::MatrixXd MB = solve::product(laboratory.M(), B);
    for (Eigen::Index i = 0; i < MB.rows(); ++i) {
      for (Eigen::Index j = 0; j < MB.cols(); ++j) {
        if (MB(i, j) != 0.0) {
          S = S - 0.5 * rate * MB(i, j) * laboratory.variables()[static_cast<std::size_t>(i)] *
                      laboratory.variables()[static_cast<std::size_t>(j)];
        }
      }
    }
  }
  return {laboratory.graph(), laboratory.fields(), laboratory.M(), std::move(K), S};
}

std::array<double, 3> MovingFrame::shift(double t) const {
  std::array<double, 3> result{};
  std::ranges::transform(velocity, result.begin(), [&](double c) { return c * (t - start); });
  return result;
}

Eigen::MatrixXd MovingFrame::turn(double t) const {
  return solve::exponential_of((phase(t) * B).cast<std::complex<double>>()).real();
}

void MovingFrame::turn(double t, grids::FieldSet& fields) const {
  if (phase(t) == 0.0) {
    return;
  }
  const Eigen::MatrixXd turn = this->turn(t);
  Eigen::VectorXd z(turn.rows());
  for (std::size_t node = 0; node < fields.size(); ++node) {
    for (int f = 0; f < fields.fields(); ++f) {
      z(f) = std::as_const(fields).field(f)[node];
    }
    const Eigen::VectorXd turned = turn * z;
    for (int f = 0; f < fields.fields(); ++f) {
      fields.field(f)[node] = turned(f);
    }
  }
}

const LatticeLevel& LaboratoryView::operator()(const LatticeLevel& level, double t) {
  const std::array<double, 3> by = frame_.shift(t);
  const bool moves = std::ranges::any_of(by, [](double s) { return s != 0.0; });
  if (!moves && frame_.phase(t) == 0.0) {
    return level;
  }
  if (moved_) {
    moved_->fields.copy_from(level.fields);
    moved_->slopes = level.slopes;
  } else {
    moved_ = level;
  }
  frame_.turn(t, moved_->fields);
  if (moves) {
    if (!shift_) {
      shift_.emplace(grid_, level.fields.fields());
    }
    (*shift_)(std::as_const(moved_->fields).pointers(), moved_->fields.pointers(), by);
    move_ramps(by);
    grids::refresh_ghosts(moved_->fields);
  }
  return *moved_;
}

/// The frame's ramp, Σ_a (x_a - by_a - from_a) J_a/L_a, is that of the laboratory less a constant.
void LaboratoryView::move_ramps(const std::array<double, 3>& by) {
  for (int f = 0; f < moved_->fields.fields(); ++f) {
    double less = 0.0;
    for (std::size_t a = 0; a < frame_.jumps.size(); ++a) {
      less += frame_.jumps[a](f) * by[a] / grid_.axis(static_cast<int>(a)).length();
    }
    if (less != 0.0) {
      for (double& value : moved_->fields.field(f)) {
        value -= less;
      }
    }
  }
}

void fit_frame(const MultisymplecticSystem& system, const grids::Grid& grid, const LatticeLevel& before,
               const LatticeLevel& after, double h, bool fits_velocity, bool fits_rate, MovingFrame& frame) {
  const auto n = static_cast<Eigen::Index>(grid.size());
  const int d = system.field_count(), directions = grid.dimensions();
  Eigen::MatrixXd mean(n, d);
  for (int f = 0; f < d; ++f) {
    mean.col(f) = 0.5 * (Eigen::Map<const Eigen::VectorXd>(before.fields.field(f).data(), n) +
                         Eigen::Map<const Eigen::VectorXd>(after.fields.field(f).data(), n));
  }
  // The columns are -z_x, …, and Bz; those that are not fitted go to the right-hand side.
  const Eigen::Index columns = directions + (frame.B.size() > 0 ? 1 : 0);
  Eigen::MatrixXd A(n, columns), normal = Eigen::MatrixXd::Zero(columns, columns);
  Eigen::VectorXd right = Eigen::VectorXd::Zero(columns), known = Eigen::VectorXd::Zero(columns);
  std::vector<Eigen::Index> fitted;
  for (Eigen::Index a = 0; a < columns; ++a) {
    const bool is_rate = a == directions;
    if (is_rate ? fits_rate : fits_velocity) {
      fitted.push_back(a);
    } else {
      known(a) = is_rate ? frame.rate : frame.velocity[static_cast<std::size_t>(a)];
    }
  }
  const grids::SpectralDerivative derivative(grid);
  for (int f = 0; f < d; ++f) {
    if (system.M().col(f).isZero(0.0) || system.structure().potential[static_cast<std::size_t>(f)] ||
        system.structure().at_midpoints(f)) {
      continue;
    }
    for (int a = 0; a < directions; ++a) {
      derivative(a, mean.col(f).data(), A.col(a).data());
      A.col(a) *= -1.0;
      if (!frame.jumps.empty()) {
        A.col(a).array() -= frame.jumps[static_cast<std::size_t>(a)](f) / grid.axis(a).length();
      }
    }
    if (columns > directions) {
      A.col(directions) = mean * frame.B.row(f).transpose();
    }
    const Eigen::VectorXd rate = (Eigen::Map<const Eigen::VectorXd>(after.fields.field(f).data(), n) -
                                  Eigen::Map<const Eigen::VectorXd>(before.fields.field(f).data(), n)) /
                                 h;
    normal += solve::product(A.transpose(), A);
    right += A.transpose() * (rate - A * known);
  }
  const Eigen::VectorXd solution = solve::least_squares(normal(fitted, fitted), right(fitted));
  for (std::size_t i = 0; i < fitted.size(); ++i) {
    const double value = solution(static_cast<Eigen::Index>(i));
    (fitted[i] == directions ? frame.rate : frame.velocity[static_cast<std::size_t>(fitted[i])]) = value;
  }
}

}  // namespace rubato
