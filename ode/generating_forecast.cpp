#include <rubato/ode/generating_forecast.hpp>

#include <algorithm>
#include <stdexcept>

#include <rubato/ode/increment.hpp>

namespace rubato {

namespace {

/// Weights of the polynomial through the last values, at the next place.
constexpr double weights[4][4] = {{1, 0, 0, 0}, {2, -1, 0, 0}, {3, -3, 1, 0}, {4, -6, 4, -1}};

}  // namespace

PredictionError::PredictionError(Eigen::Index size) : guess_(Eigen::VectorXd::Zero(size)) {
  errors_.fill(guess_);
}

void PredictionError::extrapolate(std::size_t points, Eigen::VectorXd& sum) const {
  for (std::size_t i = 0; i < points; ++i) {
    sum += weights[points - 1][i] * errors_[i];
  }
}

void PredictionError::correct(double h, Eigen::VectorXd& prediction) const {
  if (h == h_) {
    extrapolate(points_, prediction);
  }
}

void PredictionError::shift(const Eigen::VectorXd& error) {
  std::ranges::rotate(errors_, errors_.end() - 1);
  errors_.front() = error;
  known_ = std::min(known_ + 1, most);
}

void PredictionError::save(StateWriter& state) const {
  state.write(h_);
  state.write(static_cast<double>(known_));
  state.write(static_cast<double>(points_));
  for (const Eigen::VectorXd& error : errors_) {
    state.write(as_span(error));
  }
}

void PredictionError::restore(StateReader& state) {
  state.read(h_);
  state.read(known_);
  state.read(points_);
  if (known_ > errors_.size() || points_ > errors_.size()) {
    throw std::invalid_argument("a saved state has more errors than there are");
  }
  for (Eigen::VectorXd& error : errors_) {
    state.read(as_span(error));
  }
}

}  // namespace rubato
