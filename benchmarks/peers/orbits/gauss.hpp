#pragma once

#include <string>
#include <vector>

#include "case.hpp"

namespace orbits {

/// Coefficients of Gauss collocation, row by row; `ahead` are those of the last step's slopes at the stages of the
/// next.
struct GaussCoefficients {
  std::vector<double> a, ahead, b, c;
};
[[nodiscard]] GaussCoefficients gauss_coefficients(int stages);

/// Gauss collocation by fixed point iteration, as one would write it for one system (Hairer, Lubich and Wanner,
/// Geometric Numerical Integration, section VIII.6): stages begin where the collocation polynomial of the last step
/// leads; of a sum only stages of q are iterated, Q_i = q + c_i h v + h² M⁻¹ Σ (A²)_ij f(Q_j), which contracts by h²;
/// iterations end where the change is no rounding any more or does not become smaller; sums keep what rounding takes.
template <typename System, int Stages>
class Gauss {
  static constexpr std::size_t n = System::n, m = Stages;
  static constexpr bool second_order = System::separable;
  static constexpr std::size_t width = second_order ? n : 2 * n;

public:
  Gauss() : slopes_(m * width), old_(slopes_), at_(2 * n), increment_(m * width), rest_(2 * n), v_(n), sums_(2 * n) {
    const GaussCoefficients all = gauss_coefficients(Stages);
    for (std::size_t i = 0; i < m; ++i) {
      for (std::size_t j = 0; j < m; ++j) {
        double square = 0.0;
        for (std::size_t l = 0; l < m; ++l) {
          square += all.a[i * m + l] * all.a[l * m + j];
        }
        a_[i][j] = second_order ? square : all.a[i * m + j];
        ahead_[i][j] = all.ahead[i * m + j];
      }
      c_[i] = all.c[i];
      b_[i] = all.b[i];
      bb_[i] = b_[i] * (1.0 - c_[i]);  // q gains h v + h² M⁻¹ Σ b_i (1 - c_i) f_i
    }
  }

  template <typename Watch>
  Taken operator()(int steps, double until, State<System>& state, Watch& watch) {
    const double h = until / steps;
    std::fill(rest_.begin(), rest_.end(), 0.0);
    double* const q = state.q.data();
    double* const p = state.p.data();
    const double start = peers::cpu_seconds();
    slope(q, p, slopes_.data());
    for (std::size_t i = 1; i < m; ++i) {
      std::copy_n(slopes_.begin(), width, slopes_.begin() + static_cast<std::ptrdiff_t>(i * width));
    }
    for (int step = 0; step < steps; ++step) {
      if (step > 0) {
        old_.swap(slopes_);
        multiply(ahead_, old_.data(), slopes_.data());
      }
      double previous = std::numeric_limits<double>::infinity();
      bool first = true;
      for (int iteration = 0;; ++iteration) {
        if (iteration == 100) {
          return {std::numeric_limits<double>::infinity(), step, until};
        }
        multiply(a_, slopes_.data(), old_.data());
        if constexpr (second_order) {
          velocities(p, v_.data());
        }
        double change = 0.0;
        const double factor = second_order ? h * h : h;
        for (std::size_t i = 0; i < m; ++i) {
          double* const at = at_.data();
          if constexpr (second_order) {
            velocities(&old_[i * width], &old_[i * width]);
          }
          for (std::size_t k = 0; k < width; ++k) {
            const double base = k < n ? q[k] : p[k - n];
            double move = factor * old_[i * width + k];
            if constexpr (second_order) {
              move += c_[i] * h * v_[k];
            }
            change = std::max(change, std::abs(move - increment_[i * width + k]) / (std::abs(base) + std::abs(move)));
            increment_[i * width + k] = move;
            at[k] = base + move;
          }
          slope(at, at + n, slopes_.data() + i * width);
        }
        if (first) {
          first = false;
          continue;
        }
        if (!std::isfinite(change)) {
          return {std::numeric_limits<double>::infinity(), step, until};
        }
        if (change <= 2e-16 || (change >= previous && change < 1e-12)) {
          break;
        }
        previous = change;
      }
      double* const dq = sums_.data();
      double* const dp = dq + n;
      for (std::size_t k = 0; k < n; ++k) {
        dq[k] = dp[k] = 0.0;
        for (std::size_t i = 0; i < m; ++i) {
          dq[k] += (second_order ? h * bb_[i] : b_[i]) * slopes_[i * width + k];
          dp[k] += b_[i] * slopes_[i * width + (second_order ? k : n + k)];
        }
        dq[k] += second_order ? rest_[n + k] : 0.0;
      }
      if constexpr (second_order) {
        velocities(dq, dq);
      }
      for (std::size_t k = 0; k < n; ++k) {
        add(q[k], rest_[k], h * (second_order ? v_[k] + dq[k] : dq[k]));
        add(p[k], rest_[n + k], h * dp[k]);
      }
      watch(q, p);
    }
    return {peers::cpu_seconds() - start, steps, until};
  }

private:
  static void velocities(const double* p, double* v) {
    if constexpr (!System::unit_masses) {
      System::velocity(p, v);
    } else if (p != v) {
      std::copy_n(p, n, v);
    }
  }
  static void slope(const double* q, const double* p, double* out) {
    if constexpr (second_order) {
      System::force(q, out);
    } else {
      field<System>(q, p, out, out + n);
    }
  }
  static void multiply(const double (&weights)[m][m], const double* from, double* to) {
    for (std::size_t i = 0; i < m; ++i) {
      double* const row = to + i * width;
      for (std::size_t k = 0; k < width; ++k) {
        double sum = 0.0;
        for (std::size_t j = 0; j < m; ++j) {
          sum += weights[i][j] * from[j * width + k];
        }
        row[k] = sum;
      }
    }
  }

  double a_[m][m], ahead_[m][m], b_[m], bb_[m], c_[m];
  std::vector<double> slopes_, old_, at_, increment_, rest_, v_, sums_;
};

template <typename System>
void add_gauss(const Case<System>& problem, int first, std::vector<Method>& methods) {
  const auto take = [&]<int... Stages>(std::integer_sequence<int, Stages...>) {
    (methods.push_back(problem.method("Gauss " + std::to_string(Stages), Class::peer, first, Gauss<System, Stages>())),
     ...);
  };
  take(std::integer_sequence<int, 2, 3, 4, 6, 8>());
}

}  // namespace orbits
