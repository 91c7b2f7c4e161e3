#pragma once

#include <limits>
#include <vector>

#include <rubato/variation/step_potential.hpp>

namespace rubato {

/// What a potential makes of the levels along an orbit that was looked along, by the levels' own leading order (the
/// surrogate of theory, section 9): with D = E - H(z_k),
///
///     (s+1) h^s η + f'(h) = D,    D ← D + h^s Δη.
///
/// Where η hardly changes from one step to the next, many steps that are alike are taken at once.
struct LevelForecast {
  bool complete = false;  ///< every level exists and is well determined, and steps change slowly
  double steps = 0.0;     ///< needed for the stretch of the look-ahead
  double shortest = 0.0, longest = 0.0;
  double energy = 0.0;     ///< max |D - D_0|, how far the node energy strays
  double potential = 0.0;  ///< max |f'|
};
/// What a forecast makes of η instead of what was seen: factor · cos(2πt/turn) times that; turn = 0: no cosine.
struct EtaDoubt {
  double factor = 1.0;
  double turn = 0.0;
};

/// Forecasts of the levels along the orbit of one look-ahead, for one potential after the other.
class LevelForecaster {
public:
  explicit LevelForecaster(const LookAhead& look);

  /// \param limit the largest part of the energy that f' may be: a forecast in which it is larger is incomplete
  [[nodiscard]] LevelForecast operator()(const StepPotential& potential, const EtaDoubt& doubt = {},
                                         double limit = std::numeric_limits<double>::infinity()) const;

private:
  /// η between the middles of two of the look-ahead's steps: a cubic through both, with the slopes of parabolas through
  /// them and their neighbours. Before the first and after the last middle η is constant.
  struct Piece {
    double begin, end, length, eta, rise, bend, twist;

    [[nodiscard]] double operator()(double time) const {
      const double part = (time - begin) / length;
      return eta + part * (rise + (1.0 - part) * ((1.0 - part) * bend + part * twist));
    }
  };
  /// What the law of a forecast is at a level.
  struct Level {
    double time = 0.0;
    double eta = 0.0;
    double defect = 0.0;  ///< D = E - H
    double steps = 0.0;   ///< up to there
    std::size_t piece = 0;
  };

  [[nodiscard]] Level moved(const Level& from, double h, double stride, const EtaDoubt& doubt) const;
  [[nodiscard]] double length_at(const Level& level, double guess, const StepPotential& potential) const;
  [[nodiscard]] double eta_at(std::size_t piece, double time, const EtaDoubt& doubt) const;

  const LookAhead& look_;
  std::vector<Piece> pieces_;
};

}  // namespace rubato
