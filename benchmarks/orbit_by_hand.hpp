#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>

/// \file
/// The variable-level midpoint step written by hand for one system: fixed-size arrays, no virtual calls, everything
/// visible to the compiler at once. It is the yardstick of the library's step, so it is the same algorithm: the
/// predictors, corrections, trials and stopping rules of TimeLevels and of the midpoint scheme, for order 2.
///
/// A System gives `size` = 2n and, written by hand,
///
///     static double gradient(const Vector<size>& z, Vector<size>& g);                     // H, and ∇H into g
///     static double hessian(const Vector<size>& z, Vector<size>& g, Matrix<size>& H_zz);  // the same, and H_zz

namespace by_hand {

template <std::size_t Size>
using Vector = std::array<double, Size>;
template <std::size_t Size>
using Matrix = std::array<Vector<Size>, Size>;

constexpr double epsilon = std::numeric_limits<double>::epsilon();
constexpr double infinity = std::numeric_limits<double>::infinity();

/// LU factors with partial pivoting.
template <std::size_t Size>
class Factors {
public:
  void compute(const Matrix<Size>& matrix) {
    lu_ = matrix;
    for (std::size_t k = 0; k < Size; ++k) {
      std::size_t pivot = k;
      for (std::size_t i = k + 1; i < Size; ++i) {
        if (std::abs(lu_[i][k]) > std::abs(lu_[pivot][k])) {
          pivot = i;
        }
      }
      pivots_[k] = pivot;
      std::swap(lu_[k], lu_[pivot]);
      for (std::size_t i = k + 1; i < Size; ++i) {
        lu_[i][k] /= lu_[k][k];
        for (std::size_t j = k + 1; j < Size; ++j) {
          lu_[i][j] -= lu_[i][k] * lu_[k][j];
        }
      }
    }
  }

  void solve(Vector<Size>& x) const {
    for (std::size_t k = 0; k < Size; ++k) {
      std::swap(x[k], x[pivots_[k]]);
    }
    for (std::size_t i = 1; i < Size; ++i) {
      for (std::size_t j = 0; j < i; ++j) {
        x[i] -= lu_[i][j] * x[j];
      }
    }
    for (std::size_t i = Size; i-- > 0;) {
      for (std::size_t j = i + 1; j < Size; ++j) {
        x[i] -= lu_[i][j] * x[j];
      }
      x[i] /= lu_[i][i];
    }
  }

private:
  Matrix<Size> lu_;
  std::array<std::size_t, Size> pivots_;
};

/// An orbit of a System with variable levels, forward in time.
template <typename System>
class Orbit {
  static constexpr std::size_t size = System::size;
  static constexpr std::size_t n = size / 2;
  using State = Vector<size>;

public:
  explicit Orbit(const State& z) : high_(z) {}

  /// The step of length h that fixes E. \return whether it could be made
  bool first_step(double h) {
    State g;
    energy_scale_ = std::abs(System::gradient(high_, g));
    if (!advance(h, 0.0)) {
      return false;
    }
    State z;
    displaced(1.0, z);
    energy_scale_ = std::max({energy_scale_, std::abs(energy_), std::abs(System::gradient(z, g))});
    target_ = energy_;
    direction_ = slope_ < 0.0 ? -1.0 : 1.0;
    return take(h);
  }

  /// A step on which E(h) = E. \return whether it could be made
  bool step() {
    double h = 0.0;
    return solve_level(predicted_step(), h) && take(h);
  }

  [[nodiscard]] const State& state() const { return high_; }
  [[nodiscard]] double time() const { return time_ + time_rest_; }
  [[nodiscard]] int iterations() const { return iterations_; }  ///< evaluations of ∇H, and of H_zz, in the last step

private:
  struct Sample {
    double time;
    double density;  ///< of the step law: ±h^-3
  };
  struct Velocity {
    double time;
    State velocity;
  };

  // ---- the step of a given length ---------------------------------------------------------------------------------

  void displaced(double scale, State& z) const {
    for (std::size_t i = 0; i < size; ++i) {
      z[i] = high_[i] + (low_[i] + scale * delta_[i]);
    }
  }

  static void apply_j(const State& g, State& f) {
    for (std::size_t i = 0; i < n; ++i) {
      f[i] = g[n + i];
      f[n + i] = -g[i];
    }
  }

  void predict(double h) {
    if (velocities_known_ == 0) {
      State g, f;
      System::gradient(high_, g);
      apply_j(g, f);
      for (std::size_t i = 0; i < size; ++i) {
        delta_[i] = h * f[i];
      }
      return;
    }
    const double at = elapsed_ + 0.5 * h;
    delta_.fill(0.0);
    for (std::size_t i = 0; i < velocities_known_; ++i) {
      double weight = h;
      for (std::size_t j = 0; j < velocities_known_; ++j) {
        if (j != i) {
          weight *= (at - velocities_[j].time) / (velocities_[i].time - velocities_[j].time);
        }
      }
      for (std::size_t k = 0; k < size; ++k) {
        delta_[k] += weight * velocities_[i].velocity[k];
      }
    }
  }

  bool factor(double h) {
    State z, g;
    displaced(0.5, z);
    Matrix<size> hessian, matrix;
    System::hessian(z, g, hessian);
    ++new_iterations_;
    bool finite = true;
    for (std::size_t i = 0; i < n; ++i) {
      for (std::size_t j = 0; j < size; ++j) {
        matrix[i][j] = -0.5 * h * hessian[n + i][j];
        matrix[n + i][j] = 0.5 * h * hessian[i][j];
        finite = finite && std::isfinite(matrix[i][j]) && std::isfinite(matrix[n + i][j]);
      }
    }
    for (std::size_t i = 0; i < size; ++i) {
      matrix[i][i] += 1.0;
    }
    factored_ = finite;
    if (finite) {
      factors_.compute(matrix);
      factored_h_ = h;
    }
    return finite;
  }

  /// max |v_i| / max(|δ_i|, largest |δ_i| so far, ε|z_i|).
  double relative_size(const State& v) const {
    double result = 0.0;
    for (std::size_t i = 0; i < size; ++i) {
      const double scale = std::max({std::abs(delta_[i]), largest_[i], epsilon * std::abs(high_[i])});
      const double ratio = v[i] == 0.0 ? 0.0 : std::abs(v[i]) / scale;
      result = ratio > result || std::isnan(ratio) ? ratio : result;
    }
    return result;
  }

  bool advance(double h, double accuracy) {
    if (!factored_) {
      predict(h);
      if (!factor(h)) {
        return false;
      }
    } else {
      for (std::size_t i = 0; i < size; ++i) {
        delta_[i] += (h - trial_h_) * rate_[i];
      }
      if (std::abs(h - factored_h_) > 1e-4 * std::abs(h) && !factor(h)) {
        return false;
      }
    }
    trial_h_ = h;
    accuracy = std::max(accuracy, 0.5 * epsilon);
    double previous = infinity;
    for (int iteration = 0; iteration < 50; ++iteration) {
      State z, g, f, correction;
      displaced(0.5, z);
      energy_ = System::gradient(z, g);
      ++new_iterations_;
      apply_j(g, f);
      for (std::size_t i = 0; i < size; ++i) {
        correction[i] = h * f[i] - delta_[i];
      }
      factors_.solve(correction);
      for (std::size_t i = 0; i < size; ++i) {
        delta_[i] += correction[i];
      }
      const double change = relative_size(correction);
      if (!std::isfinite(change) || !std::isfinite(energy_)) {
        factored_ = false;
        return false;
      }
      const bool stagnated = change >= 0.5 * previous && change < 1e-10;
      const bool slow = change > 0.1 * previous && change >= 1e-10;
      previous = change;
      if (change <= accuracy || stagnated) {
        double shift = 0.0;
        rate_ = f;
        factors_.solve(rate_);
        slope_ = 0.0;
        for (std::size_t i = 0; i < size; ++i) {
          shift += g[i] * correction[i];
          slope_ += g[i] * rate_[i];
        }
        energy_ += 0.5 * shift;
        slope_ *= 0.5;
        return true;
      }
      if (slow && !factor(h)) {
        return false;
      }
    }
    factored_ = false;
    return false;
  }

  // ---- the choice of its length -----------------------------------------------------------------------------------

  double predicted_step() const {
    if (samples_known_ < 2) {
      return last_step_;
    }
    const double limit = 2.0 * last_step_;
    double length = last_step_;
    for (int iteration = 0; iteration < 3; ++iteration) {
      const double at = time() + 0.5 * length;
      double density = 0.0;
      for (std::size_t i = 0; i < samples_known_; ++i) {
        double weight = 1.0;
        for (std::size_t j = 0; j < samples_known_; ++j) {
          if (j != i) {
            weight *= (at - samples_[j].time) / (samples_[i].time - samples_[j].time);
          }
        }
        density += weight * samples_[i].density;
      }
      const bool same_sign = density * samples_[0].density > 0.0;
      length = same_sign ? std::min(1.0 / std::cbrt(std::abs(density)), limit) : limit;
    }
    return std::max(length, 0.5 * last_step_);
  }

  /// The trials of TimeLevels on a stretch where the step equation has its root: a step that cannot be solved, or that
  /// lies past the fold of E(h), ends the run here.
  bool solve_level(double guess, double& h) {
    const double tolerance = 0.1 * 1e-13 * energy_scale_;
    double below = 0.0;
    double above = infinity;
    double length = guess;
    double best = infinity;
    double last_length = 0.0;
    double last_miss = 0.0;
    int stalls = 0;
    bool full = false;
    for (int trial = 0; trial < 60; ++trial) {
      if (!advance(length, full ? 0.0 : 1e-6)) {
        return false;
      }
      const double miss = direction_ * (energy_ - target_);
      const double slope = direction_ * slope_;
      if (!std::isfinite(miss) || !(slope > 0.0)) {
        return false;
      }
      stalls = full && std::abs(miss) >= 0.5 * best ? stalls + 1 : 0;
      const bool stagnated = stalls >= 2 && std::abs(miss) <= 1e-9 * energy_scale_;
      if (full && (std::abs(miss) <= tolerance || stagnated)) {
        h = length;
        return true;
      }
      if (!full && std::abs(miss) <= tolerance) {
        full = true;
        continue;
      }
      const bool reliable = full || std::abs(miss) > 1e-6 * slope * length;
      if (reliable && miss < 0.0) {
        below = std::max(below, length);
      } else if (reliable) {
        above = std::min(above, length);
      }
      if (full) {
        best = std::min(best, std::abs(miss));
      }
      const double secant = (miss - last_miss) / (length - last_length);
      const bool agrees = stalls == 0 && last_length > 0.0 && secant > 0.8 * slope && secant < 1.25 * slope;
      last_length = length;
      last_miss = miss;
      double next = length - miss / (agrees ? secant : slope);
      next = std::clamp(next, 0.5 * length, 2.0 * length);
      if ((next <= below || next >= above) && std::isfinite(above)) {
        next = 0.5 * (below + above);
      }
      if (next > 4.0 * guess || next < 0.25 * guess) {
        return false;
      }
      full = full || std::abs(next - length) < 1e-4 * length;
      length = next;
    }
    return false;
  }

  // ---- the new level ----------------------------------------------------------------------------------------------

  /// \return whether the energy law carries information at this step: its condition is within the limit
  bool take(double h) {
    if (!(epsilon * energy_scale_ / std::abs(h * slope_) <= 1e-2)) {
      return false;
    }
    std::move_backward(samples_.begin(), samples_.end() - 1, samples_.end());
    samples_[0] = {time() + 0.5 * h, (slope_ < 0.0 ? 1.0 : -1.0) / (h * h * h)};
    samples_known_ = std::min(samples_known_ + 1, samples_.size());

    std::move_backward(velocities_.begin(), velocities_.end() - 1, velocities_.end());
    velocities_[0].time = elapsed_ + 0.5 * h;
    for (std::size_t i = 0; i < size; ++i) {
      velocities_[0].velocity[i] = delta_[i] / h;
      largest_[i] = std::max(largest_[i], std::abs(delta_[i]));
    }
    velocities_known_ = std::min(velocities_known_ + 1, velocities_.size());
    elapsed_ += h;

    for (std::size_t i = 0; i < size; ++i) {
      low_[i] += delta_[i];
      const double sum = high_[i] + low_[i];
      low_[i] -= sum - high_[i];
      high_[i] = sum;
    }
    const double sum = time_ + h;
    time_rest_ += time_ >= h ? (time_ - sum) + h : (h - sum) + time_;
    time_ = sum + time_rest_;
    time_rest_ -= time_ - sum;

    energy_scale_ = std::max(energy_scale_, std::abs(energy_));
    last_step_ = h;
    factored_ = false;
    iterations_ = std::exchange(new_iterations_, 0);
    return true;
  }

  State high_;
  State low_{};
  State delta_{}, rate_{}, largest_{};
  Factors<size> factors_;
  bool factored_ = false;
  double factored_h_ = 0.0;
  double trial_h_ = 0.0;
  double energy_ = 0.0;
  double slope_ = 0.0;
  std::array<Velocity, 4> velocities_{};
  std::size_t velocities_known_ = 0;
  double elapsed_ = 0.0;

  std::array<Sample, 4> samples_{};
  std::size_t samples_known_ = 0;
  double time_ = 0.0;
  double time_rest_ = 0.0;
  double target_ = 0.0;
  double energy_scale_ = 0.0;
  double direction_ = 1.0;
  double last_step_ = 0.0;
  int iterations_ = 0;
  int new_iterations_ = 0;
};

}  // namespace by_hand
