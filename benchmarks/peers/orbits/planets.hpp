#pragma once

#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "../passes.hpp"
#include "case.hpp"

namespace orbits {

/// Wisdom and Holman's splitting (Astron. J. 102, 1991): Kepler orbits of Jacobi's coordinates, and kicks by what is
/// left. x'_i is the place of body i from the centre of mass of those before it, and x'_0 the centre of all; the Kepler
/// orbit of body i is about G·(m_0 + … + m_i).
class KeplerSplitting {
  using System = OuterSolarSystem;
  static constexpr std::size_t bodies = System::bodies, n = System::n;
  using Places = std::array<double, n>;

public:
  explicit KeplerSplitting(const rubato::Composition& composition) : passes_(composition) {
    for (std::size_t b = 0; b < bodies; ++b) {
      inner_[b] = System::mass[b] + (b > 0 ? inner_[b - 1] : 0.0);
    }
  }

  template <typename Watch>
  Taken operator()(int steps, double until, State<System>& state, Watch& watch) {
    const double h = until / steps;
    Places v;
    System::velocity(state.p.data(), v.data());
    to_jacobi(state.q.data(), x_.data());
    to_jacobi(v.data(), v_.data());
    const double start = peers::cpu_seconds();
    const auto pass = [&](const peers::Passes::Pass& one) {
      if (one.kick != 0.0) {
        kick(one.kick * h);
      }
      if (one.drift != 0) {
        drift(passes_.drifts[one.drift] * h);
      }
    };
    if constexpr (Watch::active) {
      for (int i = 0; i < steps; ++i) {
        passes_.run(1, pass);
        write(state);
        watch(state.q.data(), state.p.data());
      }
    } else {
      passes_.run(steps, pass);
    }
    const double seconds = peers::cpu_seconds() - start;
    write(state);
    return {seconds, steps, until};
  }

private:
  void to_jacobi(const double* from, double* to) const {
    for (std::size_t k = 0; k < 3; ++k) {
      double centre = from[k];
      for (std::size_t b = 1; b < bodies; ++b) {
        const double difference = from[3 * b + k] - centre;
        to[3 * b + k] = difference;
        centre += System::mass[b] / inner_[b] * difference;
      }
      to[k] = centre;
    }
  }
  void from_jacobi(const double* from, double* to) const {
    for (std::size_t k = 0; k < 3; ++k) {
      double centre = from[k];
      for (std::size_t b = bodies; b-- > 1;) {
        centre -= System::mass[b] / inner_[b] * from[3 * b + k];
        to[3 * b + k] = centre + from[3 * b + k];
      }
      to[k] = centre;
    }
  }
  void write(State<System>& state) const {
    from_jacobi(x_.data(), state.q.data());
    from_jacobi(v_.data(), state.p.data());
    for (std::size_t i = 0; i < n; ++i) {
      state.p[i] *= System::mass[i / 3];
    }
  }

  void kick(double length) {
    Places q, a, jacobi;
    from_jacobi(x_.data(), q.data());
    System::force(q.data(), a.data());
    System::velocity(a.data(), a.data());
    to_jacobi(a.data(), jacobi.data());
    for (std::size_t b = 1; b < bodies; ++b) {
      const double* const x = &x_[3 * b];
      const double square = x[0] * x[0] + x[1] * x[1] + x[2] * x[2];
      const double factor = System::G * inner_[b] / (square * std::sqrt(square));
      for (std::size_t k = 0; k < 3; ++k) {
        v_[3 * b + k] += length * (jacobi[3 * b + k] + factor * x[k]);
      }
    }
  }

  void drift(double length) {
    for (std::size_t k = 0; k < 3; ++k) {
      x_[k] += length * v_[k];
    }
    for (std::size_t b = 1; b < bodies; ++b) {
      follow(&x_[3 * b], &v_[3 * b], System::G * inner_[b], length);
    }
  }

  /// Along an ellipse about the centre, by the difference of eccentric anomalies.
  static void follow(double* x, double* v, double mu, double time) {
    const double r_0 = std::sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]);
    const double square = v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
    const double a = 1.0 / (2.0 / r_0 - square / mu), rate = std::sqrt(mu / a) / a;
    const double along = (x[0] * v[0] + x[1] * v[1] + x[2] * v[2]) / (rate * a * a), e_cos = 1.0 - r_0 / a;
    const double angle = rate * time;
    double d = angle, sine = 0.0, cosine = 0.0;
    for (int iteration = 0; iteration < 20; ++iteration) {
      sine = std::sin(d);
      const double half = std::sin(0.5 * d);
      cosine = 2.0 * half * half;  // 1 - cos
      const double miss = d - e_cos * sine + along * cosine - angle;
      const double slope = 1.0 - e_cos * (1.0 - cosine) + along * sine;
      const double bend = e_cos * sine + along * (1.0 - cosine);
      const double newton = -miss / slope;
      const double step = -miss / (slope + 0.5 * newton * bend);
      d += step;
      if (std::abs(step) < 1e-9 * std::abs(angle)) {  // cubic, so that what is left is rounding
        sine += step * (1.0 - cosine);
        cosine += step * (sine - 0.5 * step * (1.0 - cosine));
        break;
      }
    }
    const double r = a * (1.0 - e_cos * (1.0 - cosine) + along * sine);
    const double f = -a / r_0 * cosine, g = time + (sine - d) / rate;  // f - 1
    const double f_dot = -rate * a * a / (r * r_0) * sine, g_dot = -a / r * cosine;
    for (std::size_t k = 0; k < 3; ++k) {
      const double old = x[k];
      x[k] += f * old + g * v[k];
      v[k] += f_dot * old + g_dot * v[k];
    }
  }

  peers::Passes passes_;
  std::array<double, bodies> inner_ = {};
  Places x_ = {}, v_ = {};
};

}  // namespace orbits
