#pragma once

#include <cstddef>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include <rubato/variation/step_potential.hpp>

namespace rubato {

/// η between the middles of a scout's steps: cubics through both, with the slopes that their neighbours tell. Before
/// the first and after the last it is what it is there.
class EtaPieces {
public:
  explicit EtaPieces(const Scouting& scouting);

  struct Piece {
    double begin, end, length, eta, rise, bend, twist;

    [[nodiscard]] double operator()(double time) const {
      const double part = (time - begin) / length;
      return eta + part * (rise + (1.0 - part) * ((1.0 - part) * bend + part * twist));
    }
  };
  /// In the order of their times, next to each other; one at least.
  [[nodiscard]] std::span<const Piece> pieces() const { return pieces_; }

private:
  std::vector<Piece> pieces_;
};

/// What is to be forecast.
struct ForecastJob {
  StepPotential potential;
  EtaDoubt doubt = {};
  double limit = std::numeric_limits<double>::infinity();  ///< a potential of more than this is too much
};

/// Where forecasts come from and go to, while others go on. What is forecast of a job does not depend on the others.
class ForecastQueue {
public:
  virtual ~ForecastQueue() = default;
  struct Next {
    std::size_t number;
    ForecastJob job;
  };
  [[nodiscard]] virtual std::optional<Next> next() = 0;  ///< none: none until another one has finished
  virtual void finished(std::size_t number, const LevelForecast& forecast) = 0;
  /// Whether to give this one up, as incomplete, for what it is so far; asked every period() steps, 0 for never.
  [[nodiscard]] virtual bool too_much(std::size_t /*number*/, const LevelForecast& /*so_far*/) { return false; }
  [[nodiscard]] virtual std::size_t period() const { return 0; }
};

/// forecast_levels() of many potentials of one scouted stretch, side by side in vectors, bit by bit the same: one after
/// the other each waits for its own divisions.
///@{
void forecast_side_by_side(const Scouting& scouting, const EtaPieces& pieces, ForecastQueue& queue);
[[nodiscard]] std::vector<LevelForecast> forecast_side_by_side(const Scouting& scouting, const EtaPieces& pieces,
                                                               std::span<const ForecastJob> jobs);
///@}

}  // namespace rubato
