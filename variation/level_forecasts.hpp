#pragma once

#include <cstddef>
#include <functional>
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
};

/// Whether to give a forecast up, as incomplete, for what it is so far; asked of each every so many steps.
struct GiveUp {
  double potential = 0.0;  ///< more than this part of the potential is too much
  std::size_t period = 1;
  std::function<bool(const LevelForecast&)> too_much = {};  ///< none: never
};

/// forecast_levels() of many potentials of one scouted stretch, side by side in vectors, bit by bit the same: one after
/// the other each waits for its own divisions.
[[nodiscard]] std::vector<LevelForecast> forecast_side_by_side(const Scouting& scouting, const EtaPieces& pieces,
                                                               std::span<const ForecastJob> jobs,
                                                               const GiveUp* give_up = nullptr);

}  // namespace rubato
