#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "cpu_clock.hpp"
#include "transform.hpp"

/// \file
/// Pseudospectral codes written by hand, one for one kind of equation: what Rubato is measured beside.

namespace peers {

/// A periodic line.
struct Line {
  double from = 0.0, length = 1.0;
  std::size_t nodes = 0;
  [[nodiscard]] double node(std::size_t i) const {
    return from + length * static_cast<double>(i) / static_cast<double>(nodes);
  }
  /// 2πk/length of mode number `mode`: those of a complex transform beyond half stand for negative ones. The mode
  /// without a derivative on the grid, if there is one, has 0.
  [[nodiscard]] double wave(std::size_t mode) const;
};

/// Σ c_k e^{2πik(x - from)/length}, k = -K … K.
struct Series {
  double from = 0.0, length = 1.0;
  std::vector<Complex> coefficients;
  [[nodiscard]] Complex operator()(double x) const;
};

using Function = std::function<double(double)>;

/// A code for one equation on one grid. The state is u, and u_t where the equation is of second order in time; or
/// ψ = p + iq.
class Peer {
public:
  enum class Kind { real, wave, complex };
  Peer(const Line& line, Kind kind) : line_(line), kind_(kind) {}
  Peer(const Peer&) = delete;
  Peer& operator=(const Peer&) = delete;
  virtual ~Peer() = default;

  /// u and u_t, or p and q, at the nodes. The second one may be left out.
  void stand(const Function& first, const Function& second);
  struct State {
    Modes u, v;
  };
  void stand(const State& state) { state_ = state; }
  [[nodiscard]] const State& state() const { return state_; }
  [[nodiscard]] Series solution() const { return series_of(state_.u); }
  [[nodiscard]] Series rate() const { return series_of(state_.v); }  ///< u_t, of a wave equation
  /// Goes so many steps through a time. \return CPU seconds, without what is prepared for this length of step
  virtual double go(double time, int steps) = 0;

protected:
  [[nodiscard]] Series series_of(const Modes& modes) const;

  Line line_;
  Kind kind_;
  State state_;
};

/// A frame that moves at a velocity and turns at a rate, u(t, x) = e^{iωt} u~(t, x - ct): û~_t = (L + ikc - iω) û~ + N.
/// The state of a peer is u~, and so is its solution.
struct Frame {
  double velocity = 0.0, rate = 0.0;
};

/// u_tt = u_xx - m u + R(u), R(u) = m u - V'(u), by compositions of exact waves and kicks.
enum class Rest { sine, cubic };  ///< V' = sin u, m = 1; V' = u + u³, m = 1
[[nodiscard]] std::unique_ptr<Peer> waves_and_kicks(const Line& line, Rest rest, const std::string& composition);

/// i ψ_t + ψ_xx + a|ψ|²ψ = 0 by compositions of the free flow and turns at the nodes.
[[nodiscard]] std::unique_ptr<Peer> split_step(const Line& line, double a, const std::string& composition,
                                               const Frame& frame = {});

/// û_t = L û + N(u) by "RK4" and "DOP853" for the whole of the right side, by "IFRK4" and "IFDOP853" with an
/// integrating factor (Lawson), by "ETDRK4" (Cox and Matthews 2002, coefficients as Kassam and Trefethen 2005), by
/// "AB4" … "AB8", Adams and Bashforth's of the whole, and by "Gauss1" … "Gauss8", collocation whose stages are iterated
/// on N, with L solved for mode by mode.
///@{
/// u_t + η u u_x + γ² u_xxx = 0
[[nodiscard]] std::unique_ptr<Peer> korteweg_de_vries(const Line& line, double eta, double gamma,
                                                      const std::string& method, const Frame& frame = {});
/// u_t + u_x + u u_x - u_xxt = 0
[[nodiscard]] std::unique_ptr<Peer> benjamin_bona_mahony(const Line& line, const std::string& method);
/// i ψ_t + ψ_xx + a|ψ|²ψ = 0
[[nodiscard]] std::unique_ptr<Peer> schroedinger(const Line& line, double a, const std::string& method,
                                                 const Frame& frame = {});
///@}

/// u_tt = u_xx - sin u by the leapfrog of second order in both: `steps` steps from u and u_t, into `out`.
/// \return CPU seconds
double leapfrog(const Line& line, const Function& u, const Function& u_t, double h, int steps, Nodes& out);

}  // namespace peers
