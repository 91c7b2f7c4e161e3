#pragma once

#include <string>
#include <vector>

#include "../dormand_prince.hpp"
#include "case.hpp"

namespace orbits {

/// DOP853 (Hairer, Nørsett and Wanner, Solving Ordinary Differential Equations I, section II.10, "The code DOP853"):
/// the method of order 8 with its two estimates of the error, of orders 5 and 3, and the book's choice of steps.
template <typename System>
class Dop853 {
  static constexpr std::size_t n = System::n, size = 2 * n, stages = peers::dop853_stages;

public:
  Dop853() : k_((stages + 1) * size), at_(size), z_(size) {}

  template <typename Watch>
  Taken operator()(int effort, double until, State<System>& state, Watch& watch) {
    const double tolerance = tolerance_of(effort);
    std::copy_n(state.q.begin(), n, z_.begin());
    std::copy_n(state.p.begin(), n, z_.begin() + static_cast<std::ptrdiff_t>(n));
    const double start = peers::cpu_seconds();
    double t = 0.0;
    slope(z_.data(), k(0));
    double h = first_step(tolerance);
    long steps = 0;
    bool rejected = false;
    while (t < until) {
      const bool last = t + 1.01 * h >= until;
      if (last) {
        h = until - t;
      }
      if (++steps > 20'000'000 || !(h > 1e-13 * until)) {
        return {std::numeric_limits<double>::infinity(), steps, t};
      }
      for (std::size_t i = 1; i <= stages; ++i) {
        stage(i, h);
        if (i < stages) {
          slope(at_.data(), k(i));
        }
      }
      const double error = estimate(h, tolerance);
      const double factor = std::clamp(std::pow(error, 1.0 / 8.0) / 0.9, 1.0 / 6.0, 3.0);
      if (error <= 1.0) {
        z_.swap(at_);
        slope(z_.data(), k(0));
        t = last ? until : t + h;
        if constexpr (Watch::active) {
          watch(z_.data(), z_.data() + n);
        }
        h /= rejected ? std::max(factor, 1.0) : factor;
        rejected = false;
      } else {
        h /= std::isfinite(error) ? std::min(3.0, factor) : 3.0;
        rejected = true;
      }
    }
    const double seconds = peers::cpu_seconds() - start;
    std::copy_n(z_.begin(), n, state.q.begin());
    std::copy_n(z_.begin() + static_cast<std::ptrdiff_t>(n), n, state.p.begin());
    return {seconds, steps, until};
  }

private:
  double* k(std::size_t i) { return k_.data() + i * size; }
  static void slope(const double* z, double* f) { field<System>(z, z + n, f, f + n); }

  /// What is added to z for stage i, and after the last for the end.
  void stage(std::size_t i, double h) {
    const double* const row = peers::dop853_rows[i];
    for (std::size_t c = 0; c < size; ++c) {
      double sum = 0.0;
      for (std::size_t j = 0; j < i; ++j) {
        sum += row[j] * k_[j * size + c];
      }
      at_[c] = z_[c] + h * sum;
    }
  }

  double estimate(double h, double tolerance) const {
    constexpr double five[stages] = {0.1312004499419488073250102996e-01,
                                     0,
                                     0,
                                     0,
                                     0,
                                     -0.1225156446376204440720569753e+01,
                                     -0.4957589496572501915214079952,
                                     0.1664377182454986536961530415e+01,
                                     -0.3503288487499736816886487290,
                                     0.3341791187130174790297318841,
                                     0.8192320648511571246570742613e-01,
                                     -0.2235530786388629525884427845e-01};
    constexpr double first = 0.244094488188976377952755905512, ninth = 0.733846688281611857341361741547,
                     twelfth = 0.220588235294117647058823529412e-01;
    double sum_5 = 0.0, sum_3 = 0.0;
    for (std::size_t c = 0; c < size; ++c) {
      const double scale = 1.0 / (tolerance * (1.0 + std::max(std::abs(z_[c]), std::abs(at_[c]))));
      double of_5 = 0.0, of_8 = 0.0;
      for (std::size_t j = 0; j < stages; ++j) {
        of_5 += five[j] * k_[j * size + c];
        of_8 += peers::dop853_rows[stages][j] * k_[j * size + c];
      }
      const double of_3 = of_8 - first * k_[c] - ninth * k_[8 * size + c] - twelfth * k_[11 * size + c];
      sum_5 += of_5 * scale * of_5 * scale;
      sum_3 += of_3 * scale * of_3 * scale;
    }
    const double both = sum_5 + 0.01 * sum_3;
    return std::abs(h) * sum_5 / std::sqrt((both > 0.0 ? both : 1.0) * static_cast<double>(size));
  }

  double first_step(double tolerance) {
    double slopes = 0.0, states = 0.0;
    for (std::size_t c = 0; c < size; ++c) {
      const double scale = 1.0 + std::abs(z_[c]);
      slopes += k_[c] * k_[c] / (scale * scale);
      states += z_[c] * z_[c] / (scale * scale);
    }
    return 0.1 * std::sqrt(std::max(states, 1e-6) / slopes) * std::min(1.0, 3.0 * std::pow(tolerance, 1.0 / 8.0));
  }

  std::vector<double> k_, at_, z_;
};

}  // namespace orbits
