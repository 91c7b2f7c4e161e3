#pragma once

#include <array>
#include <cmath>
#include <cstddef>

/// \file
/// Problems of the catalogue, written by hand. All with scalars of any kind: double, and what a reference has.
///
/// A system has n coordinates and
///
///     static void start(double* q, double* p);
///     T energy(const T* q, const T* p);
///
/// and, if it is a sum ½Σp_i²/m_i + V(q), `separable`, and `unit_masses` if m_i = 1, with
///
///     void velocity(const T* p, T* v);   // p/m
///     void force(const T* q, T* f);      // -∇V
///
/// if not,
///
///     void field(const T* q, const T* p, T* v, T* f);   // H_p and -H_q.

namespace orbits {

/// H = p²/2 - cos q.
struct Pendulum {
  static constexpr std::size_t n = 1;
  static constexpr bool separable = true, unit_masses = true;
  static void start(double* q, double* p) {
    q[0] = 0.0;
    p[0] = 1.9;
  }
  template <typename T>
  static void velocity(const T* p, T* v) {
    v[0] = p[0];
  }
  template <typename T>
  static void force(const T* q, T* f) {
    using std::sin;
    f[0] = -sin(q[0]);
  }
  template <typename T>
  static T energy(const T* q, const T* p) {
    using std::cos;
    return p[0] * p[0] / 2 - cos(q[0]);
  }
};

/// H = |p|²/2 - 1/|q| in the plane, from the pericentre of an orbit of semi-major axis 1 and an eccentricity of so many
/// thousandths.
template <int Thousandths>
struct Kepler {
  static constexpr std::size_t n = 2;
  static constexpr bool separable = true, unit_masses = true;
  static void start(double* q, double* p) {
    const double e = Thousandths / 1000.0;
    q[0] = 1 - e;
    q[1] = 0.0;
    p[0] = 0.0;
    p[1] = std::sqrt((1 + e) / (1 - e));
  }
  template <typename T>
  static void velocity(const T* p, T* v) {
    v[0] = p[0];
    v[1] = p[1];
  }
  template <typename T>
  static void force(const T* q, T* f) {
    using std::sqrt;
    const T square = q[0] * q[0] + q[1] * q[1];
    const T factor = T(-1) / (square * sqrt(square));
    f[0] = factor * q[0];
    f[1] = factor * q[1];
  }
  template <typename T>
  static T energy(const T* q, const T* p) {
    using std::sqrt;
    return (p[0] * p[0] + p[1] * p[1]) / 2 - 1 / sqrt(q[0] * q[0] + q[1] * q[1]);
  }
};

/// H = (|p|² + |q|²)/2 + x²y - y³/3, of energy 1/12.
struct HenonHeiles {
  static constexpr std::size_t n = 2;
  static constexpr bool separable = true, unit_masses = true;
  static void start(double* q, double* p) {
    const double y = 0.1;
    q[0] = 0.0;
    q[1] = y;
    p[0] = std::sqrt(2 * (1.0 / 12) - y * y + 2 * y * y * y / 3);
    p[1] = 0.0;
  }
  template <typename T>
  static void velocity(const T* p, T* v) {
    v[0] = p[0];
    v[1] = p[1];
  }
  template <typename T>
  static void force(const T* q, T* f) {
    f[0] = -q[0] * (1 + 2 * q[1]);
    f[1] = -q[1] - q[0] * q[0] + q[1] * q[1];
  }
  template <typename T>
  static T energy(const T* q, const T* p) {
    return (p[0] * p[0] + p[1] * p[1] + q[0] * q[0] + q[1] * q[1]) / 2 + q[0] * q[0] * q[1] - q[1] * q[1] * q[1] / 3;
  }
};

/// H = (q² + 1)(p² + 1)/2.
struct NonSeparable {
  static constexpr std::size_t n = 1;
  static constexpr bool separable = false, unit_masses = false;
  static void start(double* q, double* p) {
    q[0] = 1.0;
    p[0] = 0.0;
  }
  template <typename T>
  static void field(const T* q, const T* p, T* v, T* f) {
    v[0] = p[0] * (q[0] * q[0] + 1);
    f[0] = -q[0] * (p[0] * p[0] + 1);
  }
  template <typename T>
  static T energy(const T* q, const T* p) {
    return (q[0] * q[0] + 1) * (p[0] * p[0] + 1) / 2;
  }
};

/// The Sun and its five outer planets. Data as the catalogue has them.
struct OuterSolarSystem {
  static constexpr std::size_t bodies = 6, n = 3 * bodies;
  static constexpr bool separable = true, unit_masses = false;
  static constexpr double G = 2.95912208286e-4;
  static constexpr std::array<double, bodies> mass = {1.00000597682,    9.54786104043e-4, 2.85583733151e-4,
                                                      4.37273164546e-5, 5.17759138449e-5, 1 / 1.3e8};
  static void start(double* q, double* p) {
    constexpr double places[bodies][3] = {{0, 0, 0},
                                          {-3.5023653, -3.8169847, -1.5507963},
                                          {9.0755314, -3.0458353, -1.6483708},
                                          {8.3101420, -16.2901086, -7.2521278},
                                          {11.4707666, -25.7294829, -10.8169456},
                                          {-15.5387357, -25.2225594, -3.1902382}};
    constexpr double velocities[bodies][3] = {{0, 0, 0},
                                              {0.00565429, -0.00412490, -0.00190589},
                                              {0.00168318, 0.00483525, 0.00192462},
                                              {0.00354178, 0.00137102, 0.00055029},
                                              {0.00288930, 0.00114527, 0.00039677},
                                              {0.00276725, -0.00170702, -0.00136504}};
    for (std::size_t b = 0; b < bodies; ++b) {
      for (std::size_t k = 0; k < 3; ++k) {
        q[3 * b + k] = places[b][k];
        p[3 * b + k] = mass[b] * velocities[b][k];
      }
    }
  }
  template <typename T>
  static void velocity(const T* p, T* v) {
    for (std::size_t b = 0; b < bodies; ++b) {
      const T inverse = T(1) / T(mass[b]);
      for (std::size_t k = 0; k < 3; ++k) {
        v[3 * b + k] = p[3 * b + k] * inverse;
      }
    }
  }
  template <typename T>
  static void force(const T* q, T* f) {
    using std::sqrt;
    for (std::size_t i = 0; i < n; ++i) {
      f[i] = 0;
    }
    for (std::size_t b = 1; b < bodies; ++b) {
      for (std::size_t c = 0; c < b; ++c) {
        const T x = q[3 * b] - q[3 * c], y = q[3 * b + 1] - q[3 * c + 1], z = q[3 * b + 2] - q[3 * c + 2];
        const T square = x * x + y * y + z * z;
        const T factor = T(G) * T(mass[b]) * T(mass[c]) / (square * sqrt(square));
        f[3 * b] -= factor * x;
        f[3 * b + 1] -= factor * y;
        f[3 * b + 2] -= factor * z;
        f[3 * c] += factor * x;
        f[3 * c + 1] += factor * y;
        f[3 * c + 2] += factor * z;
      }
    }
  }
  template <typename T>
  static T energy(const T* q, const T* p) {
    using std::sqrt;
    T sum = 0;
    for (std::size_t b = 0; b < bodies; ++b) {
      sum += (p[3 * b] * p[3 * b] + p[3 * b + 1] * p[3 * b + 1] + p[3 * b + 2] * p[3 * b + 2]) / (2 * T(mass[b]));
      for (std::size_t c = 0; c < b; ++c) {
        const T x = q[3 * b] - q[3 * c], y = q[3 * b + 1] - q[3 * c + 1], z = q[3 * b + 2] - q[3 * c + 2];
        sum -= T(G) * T(mass[b]) * T(mass[c]) / sqrt(x * x + y * y + z * z);
      }
    }
    return sum;
  }
};

/// Fermi, Pasta, Ulam and Tsingou's chain of N masses between walls, alpha = 1/4, from its lowest mode with an
/// amplitude that leaves the stretch of a spring the same for every N + 1: (N + 1)/32.
template <std::size_t N>
struct Chain {
  static constexpr std::size_t n = N;
  static constexpr bool separable = true, unit_masses = true;
  static constexpr double alpha = 0.25, amplitude = static_cast<double>(N + 1) / 32.0;
  static void start(double* q, double* p) {
    for (std::size_t i = 0; i < N; ++i) {
      q[i] = amplitude * std::sin(static_cast<double>(i + 1) * 3.14159265358979323846 / static_cast<double>(N + 1));
      p[i] = 0.0;
    }
  }
  template <typename T>
  static void velocity(const T* p, T* v) {
    for (std::size_t i = 0; i < N; ++i) {
      v[i] = p[i];
    }
  }
  /// q_{i+1} - 2q_i + q_{i-1} + α(d_{i+1}² - d_i²) = (d_{i+1} - d_i)(1 + α(d_{i+1} + d_i)), which a compiler takes to
  /// vectors.
  template <typename T>
  static void force(const T* q, T* f) {
    const auto one = [](T left, T middle, T right) {
      return (right - middle - (middle - left)) * (1 + T(alpha) * (right - left));
    };
    f[0] = one(T(0), q[0], q[1]);
    for (std::size_t i = 1; i + 1 < N; ++i) {
      f[i] = one(q[i - 1], q[i], q[i + 1]);
    }
    f[N - 1] = one(q[N - 2], q[N - 1], T(0));
  }
  template <typename T>
  static T energy(const T* q, const T* p) {
    T sum = 0, last = 0;
    for (std::size_t i = 0; i <= N; ++i) {
      const T next = i < N ? q[i] : T(0), stretch = next - last;
      sum += stretch * stretch * (T(1) / 2 + T(alpha) / 3 * stretch);
      if (i < N) {
        sum += p[i] * p[i] / 2;
      }
      last = next;
    }
    return sum;
  }
};

/// H_p and -H_q of any system.
template <typename System, typename T>
void field(const T* q, const T* p, T* v, T* f) {
  if constexpr (System::separable) {
    System::velocity(p, v);
    System::force(q, f);
  } else {
    System::field(q, p, v, f);
  }
}

}  // namespace orbits
