#pragma once

#include <array>
#include <cstddef>

#include <Eigen/Core>

#include <rubato/base/state.hpp>

namespace rubato {

/// What the predictions of the last steps missed, extrapolated to the coming one: at steps of one size the error of a
/// good predictor is a smooth function of time, and so is worth predicting itself.
///
/// Of the extrapolations by constants to cubics, and none at all, the one is used that would have done best in the last
/// step. Steps of another size begin anew.
class PredictionError {
public:
  explicit PredictionError(Eigen::Index size);

  /// Adds the expected error of a prediction for a step of length h.
  void correct(double h, Eigen::VectorXd& prediction) const;
  /// \param error what the step came to, less what was predicted without correct()
  /// \param size  of a vector: a function that weighs its components alike
  template <typename Size>
  void record(double h, const Eigen::VectorXd& error, Size size) {
    if (h != h_) {
      restart();
      h_ = h;
    }
    double least = size(error);
    points_ = 0;
    for (std::size_t points = 1; points <= known_; ++points) {
      guess_ = -error;
      extrapolate(points, guess_);
      if (const double missed = size(guess_); missed < least) {
        least = missed;
        points_ = points;
      }
    }
    shift(error);
  }
  void restart() { known_ = points_ = 0; }

  void save(StateWriter& state) const;
  void restore(StateReader& state);

private:
  static constexpr std::size_t most = 4;
  void extrapolate(std::size_t points, Eigen::VectorXd& sum) const;  ///< added to `sum`
  void shift(const Eigen::VectorXd& error);

  double h_ = 0.0;
  std::size_t known_ = 0, points_ = 0;        ///< errors known; how many of them to extrapolate from
  std::array<Eigen::VectorXd, most> errors_;  ///< the last one first
  Eigen::VectorXd guess_;
};

}  // namespace rubato
