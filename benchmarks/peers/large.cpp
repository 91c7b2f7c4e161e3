#include "large.hpp"

#include <fftw3.h>
#include <omp.h>

#include <chrono>
#include <cmath>
#include <complex>
#include <memory>
#include <numbers>
#include <vector>

#include "cpu_clock.hpp"
#include "passes.hpp"
#include "transform.hpp"

namespace peers {

namespace {

/// Arrays whose pages each thread touches first where it works, as the loops below divide rows.
using Array = std::unique_ptr<double[], decltype(&fftw_free)>;

Array array(std::size_t size) {
  return {static_cast<double*>(fftw_malloc(size * sizeof(double))), &fftw_free};
}

class Clock {
public:
  [[nodiscard]] Pace pace(int steps) const {
    return {(cpu_seconds() - cpu_) / steps,
            std::chrono::duration<double>(std::chrono::steady_clock::now() - wall_).count() / steps, 0.0};
  }

private:
  double cpu_ = cpu_seconds();
  std::chrono::steady_clock::time_point wall_ = std::chrono::steady_clock::now();
};

/// Rows of the torus along its last direction.
class Rows {
public:
  explicit Rows(const Torus& torus)
      : n_(torus.nodes), count_(torus.size() / torus.nodes), volume_(torus.dimensions == 3) {}
  [[nodiscard]] std::size_t count() const { return count_; }
  struct Neighbours {
    const double *here, *before[2], *after[2];
  };
  [[nodiscard]] Neighbours of(const double* u, std::size_t row) const {
    const auto at = [&](std::size_t i, std::size_t j) { return u + (i * n_ + j) * n_; };
    const auto left = [&](std::size_t i) { return i == 0 ? n_ - 1 : i - 1; };
    const auto right = [&](std::size_t i) { return i + 1 == n_ ? 0 : i + 1; };
    const std::size_t i = volume_ ? row / n_ : 0, j = volume_ ? row % n_ : row;
    return {at(i, j), {at(i, left(j)), at(volume_ ? left(i) : 0, j)}, {at(i, right(j)), at(volume_ ? right(i) : 0, j)}};
  }

private:
  std::size_t n_, count_;
  bool volume_;
};

/// f(x, left, right, neighbours before, after along the other directions) at each node of a row.
template <int dimensions, class F>
double along_row(const Rows::Neighbours& row, std::size_t n, F&& f) {
  const double* const u = row.here;
  const auto at = [&](std::size_t k, std::size_t left, std::size_t right) {
    double around = u[left] + u[right] + row.before[0][k] + row.after[0][k];
    const double x = u[right] - u[k], y = row.after[0][k] - u[k];
    double slopes = x * x + y * y;
    if constexpr (dimensions == 3) {
      around += row.before[1][k] + row.after[1][k];
      const double z = row.after[1][k] - u[k];
      slopes += z * z;
    }
    return f(k, u[k], around - 2.0 * dimensions * u[k], slopes);
  };
  double sum = at(0, n - 1, 1) + at(n - 1, n - 2, 0);
#pragma omp simd reduction(+ : sum)
  for (std::size_t k = 1; k < n - 1; ++k) {
    sum += at(k, k - 1, k + 1);
  }
  return sum;
}

double first_value(const Torus& torus, std::size_t node) {
  double value = 0.5;
  for (int a = 0; a < torus.dimensions; ++a, node /= torus.nodes) {
    value *=
        std::cos(2.0 * std::numbers::pi * static_cast<double>(node % torus.nodes) / static_cast<double>(torus.nodes));
  }
  return value;
}

template <int dimensions>
Pace leapfrog_of(const Torus& torus, double h, int steps, int threads) {
  const Rows rows(torus);
  const std::size_t n = torus.nodes;
  const double dx = torus.length / static_cast<double>(n), ratio = h * h / (dx * dx), square = h * h;
  Array now = array(torus.size()), old = array(torus.size());
#pragma omp parallel for num_threads(threads) schedule(static)
  for (std::size_t row = 0; row < rows.count(); ++row) {
    for (std::size_t i = row * n; i < (row + 1) * n; ++i) {
      now[i] = old[i] = first_value(torus, i);
    }
  }
  std::vector<double> energies;
  const Clock clock;
  for (int step = 0; step < steps; ++step) {
    double energy = 0.0;
#pragma omp parallel for num_threads(threads) schedule(static) reduction(+ : energy)
    for (std::size_t row = 0; row < rows.count(); ++row) {
      double* const x = old.get() + row * n;
      energy += along_row<dimensions>(
          rows.of(now.get(), row), n, [&](std::size_t k, double u, double laplace, double slopes) {
            const double next = 2.0 * u - x[k] + ratio * laplace - square * u * (1.0 + u * u);
            const double rate = next - x[k];
            x[k] = next;
            return 0.25 * rate * rate + ratio * slopes + square * u * u * (1.0 + 0.5 * u * u);
          });
    }
    energies.push_back(energy);
    std::swap(now, old);
  }
  Pace pace = clock.pace(steps);
  pace.energy_change = energies.back() / energies[1] - 1.0;
  return pace;
}

template <int dimensions>
Pace drifts_and_kicks_of(const Torus& torus, const std::string& name, double h, int steps) {
  const Rows rows(torus);
  const std::size_t n = torus.nodes;
  const double dx = torus.length / static_cast<double>(n), inverse = 1.0 / (dx * dx);
  const Passes passes(rubato::composition(name));
  Array u = array(torus.size()), next = array(torus.size()), v = array(torus.size());
  for (std::size_t i = 0; i < torus.size(); ++i) {
    u[i] = first_value(torus, i);
    v[i] = 0.0;
  }
  std::vector<double> energies;
  const Clock clock;
  passes.run(steps, [&](const Passes::Pass& pass) {
    const double kick = pass.kick * h, drift = passes.drifts[pass.drift] * h;
    double energy = 0.0;
    for (std::size_t row = 0; row < rows.count(); ++row) {
      double* const rate = v.get() + row * n;
      double* const to = next.get() + row * n;
      energy +=
          along_row<dimensions>(rows.of(u.get(), row), n, [&](std::size_t k, double x, double laplace, double slopes) {
            const double kicked = rate[k] + kick * (inverse * laplace - x * (1.0 + x * x));
            rate[k] = kicked;
            to[k] = x + drift * kicked;
            return kicked * kicked + inverse * slopes + x * x * (1.0 + 0.5 * x * x);
          });
    }
    energies.push_back(energy);
    std::swap(u, next);
  });
  Pace pace = clock.pace(steps);
  pace.energy_change = energies.back() / energies[1] - 1.0;
  return pace;
}

/// Of all directions at once, in place, as FFTW's plans for several directions are.
class Modes3 {
public:
  Modes3(const Torus& torus, bool real)
      : last_(real ? torus.nodes / 2 + 1 : torus.nodes),
        rows_(torus.size() / torus.nodes),
        memory_(array(2 * last_ * rows_)) {
    const std::vector<int> lengths(static_cast<std::size_t>(torus.dimensions), static_cast<int>(torus.nodes));
    if (real) {
      forward_ = fftw_plan_dft_r2c(torus.dimensions, lengths.data(), memory_.get(), raw(modes()), FFTW_MEASURE);
      inverse_ = fftw_plan_dft_c2r(torus.dimensions, lengths.data(), raw(modes()), memory_.get(), FFTW_MEASURE);
    } else {
      forward_ =
          fftw_plan_dft(torus.dimensions, lengths.data(), raw(modes()), raw(modes()), FFTW_FORWARD, FFTW_MEASURE);
      inverse_ =
          fftw_plan_dft(torus.dimensions, lengths.data(), raw(modes()), raw(modes()), FFTW_BACKWARD, FFTW_MEASURE);
    }
  }
  Modes3(const Modes3&) = delete;
  Modes3& operator=(const Modes3&) = delete;
  ~Modes3() {
    fftw_destroy_plan(forward_);
    fftw_destroy_plan(inverse_);
  }
  [[nodiscard]] std::size_t rows() const { return rows_; }
  [[nodiscard]] std::size_t last() const { return last_; }
  [[nodiscard]] std::size_t count() const { return rows_ * last_; }
  [[nodiscard]] Complex* modes() { return reinterpret_cast<Complex*>(memory_.get()); }
  /// A row of real nodes.
  [[nodiscard]] double* nodes(std::size_t row) { return memory_.get() + 2 * row * last_; }
  void forward() { fftw_execute(forward_); }
  void inverse() { fftw_execute(inverse_); }

private:
  std::size_t last_, rows_;
  Array memory_;
  fftw_plan forward_, inverse_;
};

/// -Δ of each mode, of differences or exactly.
double minus_laplace(const Torus& torus, std::size_t row, std::size_t k, bool differences) {
  const double dx = torus.length / static_cast<double>(torus.nodes);
  double sum = 0.0;
  const auto add = [&](std::size_t mode) {
    const double m = static_cast<double>(mode <= torus.nodes / 2 ? mode : torus.nodes - mode);
    const double wave = 2.0 * std::numbers::pi * m / torus.length,
                 root = differences ? 2.0 / dx * std::sin(0.5 * wave * dx) : wave;
    sum += root * root;
  };
  add(k);
  for (int a = 1; a < torus.dimensions; ++a, row /= torus.nodes) {
    add(row % torus.nodes);
  }
  return sum;
}

}  // namespace

Pace leapfrog(const Torus& torus, double h, int steps, int threads) {
  return torus.dimensions == 3 ? leapfrog_of<3>(torus, h, steps, threads) : leapfrog_of<2>(torus, h, steps, threads);
}

Pace drifts_and_kicks(const Torus& torus, const std::string& composition, double h, int steps) {
  return torus.dimensions == 3 ? drifts_and_kicks_of<3>(torus, composition, h, steps)
                               : drifts_and_kicks_of<2>(torus, composition, h, steps);
}

Pace waves_and_kicks(const Torus& torus, const std::string& composition, bool differences, double h, int steps) {
  const Passes passes(rubato::composition(composition));
  Modes3 g(torus, true);
  const std::size_t n = torus.nodes, count = g.count();
  const double scale = 1.0 / static_cast<double>(torus.size());
  struct Rotation {
    Nodes c, s, o;
  };
  std::vector<Rotation> rotations;
  for (const double drift : passes.drifts) {
    Rotation& r = rotations.emplace_back(Rotation{Nodes(count), Nodes(count), Nodes(count)});
    for (std::size_t i = 0; i < count; ++i) {
      const double omega = std::sqrt(1.0 + minus_laplace(torus, i / g.last(), i % g.last(), differences));
      r.c[i] = std::cos(omega * drift * h);
      r.s[i] = std::sin(omega * drift * h) / omega;
      r.o[i] = -std::sin(omega * drift * h) * omega;
    }
  }
  for (std::size_t i = 0; i < torus.size(); ++i) {
    g.nodes(i / n)[i % n] = first_value(torus, i);
  }
  g.forward();
  Modes u(g.modes(), g.modes() + count), v(count);
  const Clock clock;
  passes.run(steps, [&](const Passes::Pass& pass) {
    const double b = pass.kick * h;
    Complex* const kick = g.modes();
    if (b != 0.0) {
      std::copy(u.begin(), u.end(), kick);
      g.inverse();
      for (std::size_t row = 0; row < g.rows(); ++row) {
        double* const x = g.nodes(row);
        for (std::size_t k = 0; k < n; ++k) {
          const double value = scale * x[k];
          x[k] = -b * value * value * value;
        }
      }
      g.forward();
    }
    const Rotation& r = rotations[pass.drift];
    for (std::size_t i = 0; i < count; ++i) {
      const Complex old = u[i], kicked = b != 0.0 ? v[i] + kick[i] : v[i];
      u[i] = r.c[i] * old + r.s[i] * kicked;
      v[i] = r.o[i] * old + r.c[i] * kicked;
    }
  });
  return clock.pace(steps);
}

Pace split_step(const Torus& torus, const std::string& composition, double h, int steps) {
  const Passes passes(rubato::composition(composition));
  Modes3 psi(torus, false);
  const std::size_t n = torus.nodes, count = psi.count();
  const double scale = 1.0 / static_cast<double>(torus.size());
  std::vector<Modes> free;
  for (const double drift : passes.drifts) {
    Modes& factor = free.emplace_back(count);
    for (std::size_t i = 0; i < count; ++i) {
      factor[i] = std::polar(1.0, -minus_laplace(torus, i / n, i % n, false) * drift * h);
    }
  }
  for (std::size_t i = 0; i < count; ++i) {
    psi.modes()[i] = first_value(torus, i);
  }
  psi.forward();
  Complex* const x = psi.modes();
  std::vector<double> angle(n), c(n), s(n);
  const Clock clock;
  passes.run(steps, [&](const Passes::Pass& pass) {
    if (pass.kick != 0.0) {
      psi.inverse();
      const double factor = -pass.kick * h * scale * scale;
      for (std::size_t row = 0; row < psi.rows(); ++row) {  // loops that go by vectors each
        Complex* const at = x + row * n;
        for (std::size_t k = 0; k < n; ++k) {
          angle[k] = factor * (at[k].real() * at[k].real() + at[k].imag() * at[k].imag());
        }
        for (std::size_t k = 0; k < n; ++k) {
          c[k] = scale * std::cos(angle[k]);
        }
        for (std::size_t k = 0; k < n; ++k) {
          s[k] = scale * std::sin(angle[k]);
        }
        for (std::size_t k = 0; k < n; ++k) {
          at[k] = {c[k] * at[k].real() - s[k] * at[k].imag(), c[k] * at[k].imag() + s[k] * at[k].real()};
        }
      }
      psi.forward();
    }
    const Complex* const factor = free[pass.drift].data();
    for (std::size_t i = 0; i < count; ++i) {
      x[i] *= factor[i];
    }
  });
  return clock.pace(steps);
}

double triad_bandwidth(int threads) {
  constexpr std::size_t size = 40'000'000;
  const Array a = array(size), b = array(size), c = array(size);
#pragma omp parallel for num_threads(threads) schedule(static)
  for (std::size_t i = 0; i < size; ++i) {
    a[i] = 0.0;
    b[i] = 1.0;
    c[i] = 2.0;
  }
  double best = 0.0;
  for (int turn = 0; turn < 8; ++turn) {
    const Clock clock;
#pragma omp parallel for num_threads(threads) schedule(static)
    for (std::size_t i = 0; i < size; ++i) {
      a[i] = b[i] + 0.5 * c[i];
    }
    best = std::max(best, 24.0 * static_cast<double>(size) / clock.pace(1).wall);
  }
  return best;
}

}  // namespace peers
