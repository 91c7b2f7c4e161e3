#pragma once

#include <array>
#include <string>
#include <vector>

#include "case.hpp"

namespace orbits {

/// IAS15 (Rein and Spiegel, "IAS15: a fast, adaptive, high-order integrator for gravitational dynamics, accurate to
/// machine precision over a billion orbits", Mon. Not. R. Astron. Soc. 446 (2015) 1424), written from the paper: Gauss
/// and Radau's collocation of q'' = a(q) with seven points after the first, solved by predictions and corrections to
/// rounding, Everhart's prediction of the next step's coefficients, steps from the last coefficient, sums that keep
/// what rounding takes. The largest acceleration is that of the whole step: at its beginning alone, as in the paper, a
/// single coordinate's would vanish.
template <typename System>
class Ias15 {
  static constexpr std::size_t n = System::n, points = 7;
  using Coefficients = std::array<std::vector<double>, points>;

public:
  Ias15() : q_(n), v_(n), a_(n), q_rest_(n), v_rest_(n), at_(n), there_(n) {
    for (std::size_t k = 0; k < points; ++k) {
      b_[k].resize(n);
      g_[k].resize(n);
      predicted_[k].resize(n);
    }
    // c_[k]: coefficients of h Π_{j<k} (h - h_j) in powers of h from the first.
    c_[0][0] = 1.0;
    for (std::size_t k = 1; k < points; ++k) {
      for (std::size_t j = 0; j <= k; ++j) {
        c_[k][j] = (j > 0 ? c_[k - 1][j - 1] : 0.0) - node(k) * (j < k ? c_[k - 1][j] : 0.0);
      }
    }
  }

  template <typename Watch>
  Taken operator()(int effort, double until, State<System>& state, Watch& watch) {
    const double precision = tolerance_of(effort);
    q_ = state.q;
    System::velocity(state.p.data(), v_.data());
    std::vector<double> mass(n, 1.0);  // of each coordinate
    System::velocity(std::vector<double>(n, 1.0).data(), mass.data());
    for (double& one : mass) {
      one = 1.0 / one;
    }
    for (std::size_t i = 0; i < n; ++i) {
      q_rest_[i] = v_rest_[i] = 0.0;
      for (std::size_t k = 0; k < points; ++k) {
        b_[k][i] = predicted_[k][i] = 0.0;
      }
    }
    const double start = peers::cpu_seconds();
    double t = 0.0, h = 1e-3 * until;
    long steps = 0;
    bool fresh = true;
    while (t < until) {
      const bool last = t + h >= until * (1.0 - 1e-14);
      const double own = last ? until - t : h;
      if (++steps > 5'000'000 || !(own > 1e-13 * until)) {
        return {std::numeric_limits<double>::infinity(), steps, t};
      }
      if (last && own != h && !fresh) {
        rescale(own / h);
      }
      acceleration(q_.data(), a_.data());
      const double ratio = solve(own);  // of the last coefficient
      const double factor = std::pow(precision / ratio, 1.0 / 7.0);
      if (!std::isfinite(ratio)) {
        return {std::numeric_limits<double>::infinity(), steps, t};
      }
      if (factor < 0.25) {
        if (fresh) {
          for (std::size_t k = 0; k < points; ++k) {
            std::fill(b_[k].begin(), b_[k].end(), 0.0);
          }
        } else {
          rescale(factor);
        }
        h = own * factor;
        continue;
      }
      advance(own);
      t = last ? until : t + own;
      if constexpr (Watch::active) {
        for (std::size_t i = 0; i < n; ++i) {
          at_[i] = v_[i] * mass[i];
        }
        watch(q_.data(), at_.data());
      }
      const double growth = std::min(factor, 4.0);
      predict(growth, fresh);
      fresh = false;
      h = own * growth;
    }
    const double seconds = peers::cpu_seconds() - start;
    for (std::size_t i = 0; i < n; ++i) {
      state.q[i] = q_[i];
      state.p[i] = v_[i] * mass[i];
    }
    return {seconds, steps, until};
  }

private:
  /// Radau's points, 0 the first.
  static constexpr double node(std::size_t i) {
    constexpr double all[points + 1] = {0.0,
                                        0.0562625605369221464656521910318,
                                        0.180240691736892364987579942780,
                                        0.352624717113169637373907769648,
                                        0.547153626330555383001448554766,
                                        0.734210177215410531523210605558,
                                        0.885320946839095768090359771030,
                                        0.977520613561287501891174488626};
    return all[i];
  }
  static void acceleration(const double* q, double* a) {
    System::force(q, a);
    if constexpr (!System::unit_masses) {
      System::velocity(a, a);
    }
  }

  /// \return max |b_7| / max |a|
  double solve(double h) {
    // g from b: b_j = Σ_{k≥j} c_kj g_k.
    for (std::size_t i = 0; i < n; ++i) {
      for (std::size_t k = points; k-- > 0;) {
        double sum = b_[k][i];
        for (std::size_t l = k + 1; l < points; ++l) {
          sum -= c_[l][k] * g_[l][i];
        }
        g_[k][i] = sum;
      }
    }
    double largest = 0.0, previous = std::numeric_limits<double>::infinity();
    for (int iteration = 0; iteration < 12; ++iteration) {
      double change = 0.0;
      largest = 0.0;
      for (std::size_t point = 1; point <= points; ++point) {
        place(h, node(point));
        acceleration(at_.data(), there_.data());
        for (std::size_t i = 0; i < n; ++i) {
          largest = std::max(largest, std::abs(there_[i]));
          // The divided difference that ends with this point.
          double difference = (there_[i] - a_[i]) * inverse_[point][0];
          for (std::size_t k = 1; k < point; ++k) {
            difference = (difference - g_[k - 1][i]) * inverse_[point][k];
          }
          const double more = difference - g_[point - 1][i];
          g_[point - 1][i] = difference;
          for (std::size_t j = 0; j < point; ++j) {
            b_[j][i] += c_[point - 1][j] * more;
          }
          change = point == points ? std::max(change, std::abs(more)) : change;
        }
      }
      change /= largest;
      if (change < 1e-16 || (iteration > 1 && change >= previous)) {
        break;
      }
      previous = change;
    }
    double last = 0.0;
    for (std::size_t i = 0; i < n; ++i) {
      last = std::max(last, std::abs(b_[points - 1][i]));
    }
    return std::max(last / largest, 1e-300);
  }

  /// q at a part s of the step.
  void place(double h, double s) {
    std::array<double, points> weight;
    double power = s * s * s;
    for (std::size_t k = 0; k < points; ++k, power *= s) {
      weight[k] = power / static_cast<double>((k + 2) * (k + 3));
    }
    for (std::size_t i = 0; i < n; ++i) {
      double sum = 0.0;
      for (std::size_t k = points; k-- > 0;) {
        sum += weight[k] * b_[k][i];
      }
      at_[i] = q_[i] + (q_rest_[i] + h * (s * v_[i] + h * (0.5 * s * s * a_[i] + sum)));
    }
  }

  void advance(double h) {
    for (std::size_t i = 0; i < n; ++i) {
      double twice = 0.0, once = 0.0;
      for (std::size_t k = points; k-- > 0;) {
        twice += b_[k][i] / static_cast<double>((k + 2) * (k + 3));
        once += b_[k][i] / static_cast<double>(k + 2);
      }
      add(q_[i], q_rest_[i], h * (v_[i] + (v_rest_[i] + h * (0.5 * a_[i] + twice))));
      add(v_[i], v_rest_[i], h * (a_[i] + once));
    }
  }

  /// Coefficients for a step from the end of this one, r times as long, with what the last prediction missed.
  void predict(double r, bool fresh) {
    constexpr double binomial[points][points] = {
        {1, 2, 3, 4, 5, 6, 7},  {0, 1, 3, 6, 10, 15, 21}, {0, 0, 1, 4, 10, 20, 35}, {0, 0, 0, 1, 5, 15, 35},
        {0, 0, 0, 0, 1, 6, 21}, {0, 0, 0, 0, 0, 1, 7},    {0, 0, 0, 0, 0, 0, 1}};
    for (std::size_t i = 0; i < n; ++i) {
      double power = r;
      for (std::size_t j = 0; j < points; ++j, power *= r) {
        const double missed = fresh ? 0.0 : b_[j][i] - predicted_[j][i];
        double sum = 0.0;
        for (std::size_t k = j; k < points; ++k) {
          sum += binomial[j][k] * b_[k][i];
        }
        predicted_[j][i] = power * sum;
        b_[j][i] = predicted_[j][i] + missed;
      }
    }
  }
  /// The same for another length of this step.
  void rescale(double r) {
    for (std::size_t i = 0; i < n; ++i) {
      double power = r;
      for (std::size_t j = 0; j < points; ++j, power *= r) {
        b_[j][i] *= power;
        predicted_[j][i] *= power;
      }
    }
  }

  static constexpr std::array<std::array<double, points>, points + 1> inverse_ = [] {
    std::array<std::array<double, points>, points + 1> result{};
    for (std::size_t i = 1; i <= points; ++i) {
      for (std::size_t j = 0; j < i; ++j) {
        result[i][j] = 1.0 / (node(i) - node(j));
      }
    }
    return result;
  }();
  double c_[points][points] = {};
  std::vector<double> q_, v_, a_, q_rest_, v_rest_, at_, there_;
  Coefficients b_, g_, predicted_;
};

}  // namespace orbits
