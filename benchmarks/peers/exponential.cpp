#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "dormand_prince.hpp"
#include "gauss_coefficients.hpp"
#include "peer.hpp"

namespace peers {

namespace {

/// û_t = L û + N(u). The right side as a whole is N where `whole` was asked for, and L is 0.
class Semilinear : public Peer {
public:
  Semilinear(const Line& line, Kind kind, std::string method)
      : Peer(line, kind),
        linear_(kind == Kind::complex ? line.nodes : line.nodes / 2 + 1),
        method_(std::move(method)),
        work_(14, linear_) {}

  double go(double time, int steps) override {
    const double h = time / steps;
    if (method_ == "IFRK4") {
      return classical<true>(h, steps);
    }
    if (method_ == "RK4") {
      return classical<false>(h, steps);
    }
    if (method_ == "ETDRK4") {
      return exponential(h, steps);
    }
    if (method_ == "IFDOP853" || method_ == "DOP853") {
      return dormand_prince(h, steps);
    }
    if (method_.starts_with("Gauss")) {
      return gauss(h, steps, method_[5] - '0');
    }
    if (method_.starts_with("AB")) {
      return adams_bashforth(h, steps, method_[2] - '0');
    }
    throw std::invalid_argument("no method " + method_);
  }

protected:
  [[nodiscard]] bool whole() const { return method_ == "RK4" || method_ == "DOP853" || method_.starts_with("AB"); }
  virtual void rest(const Modes& at, Modes& out) = 0;

  Modes linear_;

private:
  [[nodiscard]] Modes factor(double tau) const {
    Modes result(linear_.size());
    for (std::size_t k = 0; k < result.size(); ++k) {
      result[k] = std::exp(tau * linear_[k]);
    }
    return result;
  }

  template <bool with_factor>
  double classical(double h, int steps) {
    const std::size_t m = linear_.size();
    const Modes half_step = factor(0.5 * h);
    Modes &k1 = work_[0], &k2 = work_[1], &k3 = work_[2], &k4 = work_[3], &at = work_[4], &base = work_[5];
    Complex* const u = state_.u.data();
    const Complex* const e = half_step.data();
    const double start = cpu_seconds();
    for (int step = 0; step < steps; ++step) {
      rest(state_.u, k1);
      for (std::size_t k = 0; k < m; ++k) {
        base[k] = with_factor ? e[k] * u[k] : u[k];
        k1[k] = with_factor ? e[k] * k1[k] : k1[k];
        at[k] = base[k] + 0.5 * h * k1[k];
      }
      rest(at, k2);
      for (std::size_t k = 0; k < m; ++k) {
        at[k] = base[k] + 0.5 * h * k2[k];
      }
      rest(at, k3);
      for (std::size_t k = 0; k < m; ++k) {
        const Complex there = base[k] + h * k3[k];
        at[k] = with_factor ? e[k] * there : there;
      }
      rest(at, k4);
      for (std::size_t k = 0; k < m; ++k) {
        const Complex there = base[k] + h / 6.0 * (k1[k] + 2.0 * (k2[k] + k3[k]));
        u[k] = (with_factor ? e[k] * there : there) + h / 6.0 * k4[k];
      }
    }
    return cpu_seconds() - start;
  }

  double exponential(double h, int steps) {
    const std::size_t m = linear_.size();
    const Modes full = factor(h), half = factor(0.5 * h);
    Modes Q(m), f1(m), f2(m), f3(m);
    constexpr int points = 64;  // of the circle about hL over which the coefficients are means
    for (std::size_t k = 0; k < m; ++k) {
      for (int p = 0; p < points; ++p) {
        const Complex z = h * linear_[k] + std::polar(1.0, 2.0 * std::numbers::pi * (p + 0.5) / points);
        const Complex e = std::exp(z), weight = h / points;
        Q[k] += weight * (std::exp(0.5 * z) - 1.0) / z;
        f1[k] += weight * (-4.0 - z + e * (4.0 - 3.0 * z + z * z)) / (z * z * z);
        f2[k] += weight * (2.0 + z + e * (z - 2.0)) / (z * z * z);
        f3[k] += weight * (-4.0 - 3.0 * z - z * z + e * (4.0 - z)) / (z * z * z);
      }
    }
    Modes &Nu = work_[0], &Na = work_[1], &Nb = work_[2], &Nc = work_[3], &a = work_[4], &at = work_[5];
    Modes& u = state_.u;
    const double start = cpu_seconds();
    for (int step = 0; step < steps; ++step) {
      rest(u, Nu);
      for (std::size_t k = 0; k < m; ++k) {
        a[k] = half[k] * u[k] + Q[k] * Nu[k];
      }
      rest(a, Na);
      for (std::size_t k = 0; k < m; ++k) {
        at[k] = half[k] * u[k] + Q[k] * Na[k];
      }
      rest(at, Nb);
      for (std::size_t k = 0; k < m; ++k) {
        at[k] = half[k] * a[k] + Q[k] * (2.0 * Nb[k] - Nu[k]);
      }
      rest(at, Nc);
      for (std::size_t k = 0; k < m; ++k) {
        u[k] = full[k] * u[k] + f1[k] * Nu[k] + 2.0 * f2[k] * (Na[k] + Nb[k]) + f3[k] * Nc[k];
      }
    }
    return cpu_seconds() - start;
  }

  /// out = u + Σ weights·slopes, in pieces that stay in registers.
  template <std::size_t terms>
  static void combine(std::size_t m, const double* weights, const Modes* const* slopes, const Complex* u,
                      Complex* out) {
    const double* from[terms];
    for (std::size_t j = 0; j < terms; ++j) {
      from[j] = reinterpret_cast<const double*>(slopes[j]->data());
    }
    const auto* base = reinterpret_cast<const double*>(u);
    auto* to = reinterpret_cast<double*>(out);
    for (std::size_t k = 0; k < 2 * m; ++k) {
      double sum = base[k];
      for (std::size_t j = 0; j < terms; ++j) {
        sum += weights[j] * from[j][k];
      }
      to[k] = sum;
    }
  }
  static void combine(std::size_t terms, std::size_t m, const double* weights, const Modes* const* slopes,
                      const Complex* u, Complex* out) {
    switch (terms) {
      case 0: return combine<0>(m, weights, slopes, u, out);
      case 1: return combine<1>(m, weights, slopes, u, out);
      case 2: return combine<2>(m, weights, slopes, u, out);
      case 3: return combine<3>(m, weights, slopes, u, out);
      case 4: return combine<4>(m, weights, slopes, u, out);
      case 5: return combine<5>(m, weights, slopes, u, out);
      case 6: return combine<6>(m, weights, slopes, u, out);
      case 7: return combine<7>(m, weights, slopes, u, out);
      case 8: return combine<8>(m, weights, slopes, u, out);
      default: return combine<9>(m, weights, slopes, u, out);
    }
  }

  double dormand_prince(double h, int steps) {
    const std::size_t m = linear_.size();
    const bool with_factor = method_ == "IFDOP853";
    std::array<Modes, dop853_stages> there, back;
    if (with_factor) {
      for (std::size_t i = 0; i < dop853_stages; ++i) {
        there[i] = factor(dop853_times[i] * h);
        back[i] = factor(-dop853_times[i] * h);
      }
    }
    struct Row {
      std::array<double, dop853_stages> weights{};
      std::array<const Modes*, dop853_stages> slopes{};
      std::size_t terms = 0;
    };
    std::array<Row, dop853_stages + 1> rows;
    for (std::size_t i = 0; i <= dop853_stages; ++i) {
      for (std::size_t j = 0; j < dop853_stages; ++j) {
        if (dop853_rows[i][j] != 0.0) {
          rows[i].weights[rows[i].terms] = h * dop853_rows[i][j];
          rows[i].slopes[rows[i].terms++] = &work_[j];
        }
      }
    }
    Complex* const u = state_.u.data();
    Modes& at = work_[12];
    const double start = cpu_seconds();
    for (int step = 0; step < steps; ++step) {
      for (std::size_t i = 0; i < dop853_stages; ++i) {
        Complex* const slope = work_[i].data();
        if (i == 0) {
          rest(state_.u, work_[0]);
          continue;
        }
        combine(rows[i].terms, m, rows[i].weights.data(), rows[i].slopes.data(), u, at.data());
        if (with_factor) {
          for (std::size_t k = 0; k < m; ++k) {
            at[k] *= there[i][k];
          }
        }
        rest(at, work_[i]);
        for (std::size_t k = 0; with_factor && k < m; ++k) {
          slope[k] *= back[i][k];
        }
      }
      const Row& last = rows[dop853_stages];
      combine(last.terms, m, last.weights.data(), last.slopes.data(), u, u);
      for (std::size_t k = 0; with_factor && k < m; ++k) {
        u[k] *= there[dop853_stages - 1][k];
      }
    }
    return cpu_seconds() - start;
  }

  /// (1 - zA)⁻¹ [1, hA], row by row, by elimination: the matrix is well conditioned for z on the imaginary axis.
  static std::vector<Complex> resolvent(const std::vector<double>& a, std::size_t s, double h, Complex z) {
    std::vector<Complex> matrix(s * s), right(s * (s + 1));
    for (std::size_t i = 0; i < s; ++i) {
      right[i * (s + 1)] = 1.0;
      for (std::size_t j = 0; j < s; ++j) {
        matrix[i * s + j] = (i == j ? 1.0 : 0.0) - z * a[i * s + j];
        right[i * (s + 1) + 1 + j] = h * a[i * s + j];
      }
    }
    for (std::size_t p = 0; p < s; ++p) {
      for (std::size_t i = 0; i < s; ++i) {
        const Complex factor = matrix[i * s + p] / matrix[p * s + p];
        for (std::size_t j = p; i != p && j < s; ++j) {
          matrix[i * s + j] -= factor * matrix[p * s + j];
        }
        for (std::size_t j = 0; i != p && j <= s; ++j) {
          right[i * (s + 1) + j] -= factor * right[p * (s + 1) + j];
        }
      }
    }
    for (std::size_t i = 0; i < s; ++i) {
      for (std::size_t j = 0; j <= s; ++j) {
        right[i * (s + 1) + j] /= matrix[i * s + i];
      }
    }
    return right;
  }

  /// û_i = û + h Σ_j a_ij (L û_j + N_j), iterated on N until rounding. N begins with that of the last step, continued.
  double gauss(double h, int steps, int stages) {
    const std::size_t m = linear_.size(), s = static_cast<std::size_t>(stages);
    const GaussCoefficients coefficients(stages);
    // û_i = R (û + h A N), R = (1 - h L A)⁻¹ for each mode.
    std::vector<Modes> of_u(s, Modes(m)), of_N(s * s, Modes(m)), at(s, Modes(m)), N(s, Modes(m)), old;
    for (std::size_t k = 0; k < m; ++k) {
      const std::vector<Complex> solved = resolvent(coefficients.a, s, h, h * linear_[k]);
      for (std::size_t i = 0; i < s; ++i) {
        of_u[i][k] = solved[i * (s + 1)];
        for (std::size_t j = 0; j < s; ++j) {
          of_N[i * s + j][k] = solved[i * (s + 1) + 1 + j];
        }
      }
    }
    Modes& u = state_.u;
    const double start = cpu_seconds();
    for (int step = 0; step < steps; ++step) {
      if (step == 0) {
        for (Modes& slope : N) {
          rest(u, slope);
        }
      } else {
        old = N;
        for (std::size_t i = 0; i < s; ++i) {
          std::fill(N[i].begin(), N[i].end(), Complex());
          for (std::size_t j = 0; j < s; ++j) {
            for (std::size_t k = 0; k < m; ++k) {
              N[i][k] += coefficients.ahead[i * s + j] * old[j][k];
            }
          }
        }
      }
      double before = 0.0;
      for (int iteration = 0;; ++iteration) {
        double change = 0.0, size = 0.0;
        for (std::size_t i = 0; i < s; ++i) {
          for (std::size_t k = 0; k < m; ++k) {
            Complex sum = of_u[i][k] * u[k];
            for (std::size_t j = 0; j < s; ++j) {
              sum += of_N[i * s + j][k] * N[j][k];
            }
            change += std::norm(sum - at[i][k]);
            size += std::norm(sum);
            at[i][k] = sum;
          }
        }
        const bool falls = change < 0.25 * before;
        if (iteration > 0 && (change < 1e-30 * size || (change < 1e-24 * size && !falls))) {
          break;
        }
        if (iteration > 100 || !(size < 1e100)) {  // it does not converge
          std::fill(u.begin(), u.end(), Complex(std::nan("")));
          return cpu_seconds() - start;
        }
        before = change;
        for (std::size_t i = 0; i < s; ++i) {
          rest(at[i], N[i]);
        }
      }
      for (std::size_t k = 0; k < m; ++k) {
        const Complex base = u[k];
        for (std::size_t i = 0; i < s; ++i) {
          u[k] += coefficients.end[i] * (at[i][k] - base);
        }
      }
    }
    return cpu_seconds() - start;
  }

  double adams_bashforth(double h, int steps, int order) {
    // ∫_0^1 of the Lagrange polynomials of the nodes 0, -1, …, 1 - order.
    std::array<double, 9> weights{};
    for (int j = 0; j < order; ++j) {
      std::vector<long double> p = {1.0L};
      for (int i = 0; i < order; ++i) {
        if (i != j) {  // (t + i)/(i - j)
          p.insert(p.begin(), 0.0L);
          for (std::size_t c = 0; c + 1 < p.size(); ++c) {
            p[c] = (p[c] + static_cast<long double>(i) * p[c + 1]) / static_cast<long double>(i - j);
          }
          p.back() /= static_cast<long double>(i - j);
        }
      }
      long double integral = 0.0L;
      for (std::size_t c = 0; c < p.size(); ++c) {
        integral += p[c] / static_cast<long double>(c + 1);
      }
      weights[static_cast<std::size_t>(j)] = h * static_cast<double>(integral);
    }
    const std::size_t terms = static_cast<std::size_t>(order);
    std::vector<Modes> slopes(terms, linear_);
    std::vector<const Modes*> order_of(terms);
    double seconds = 0.0;
    for (int step = 0; step < steps; ++step) {
      const std::size_t newest = static_cast<std::size_t>(step) % terms;
      if (step + 1 < order) {
        rest(state_.u, slopes[newest]);
        seconds += dormand_prince(h, 1);
        continue;
      }
      const double start = cpu_seconds();
      for (; step < steps; ++step) {
        const std::size_t place = static_cast<std::size_t>(step) % terms;
        rest(state_.u, slopes[place]);
        for (std::size_t j = 0; j < terms; ++j) {
          order_of[j] = &slopes[(place + terms - j) % terms];
        }
        combine(terms, linear_.size(), weights.data(), order_of.data(), state_.u.data(), state_.u.data());
      }
      seconds += cpu_seconds() - start;
    }
    return seconds;
  }

  std::string method_;
  std::vector<Modes> work_;
};

/// û_t = L û + M FFT(u²).
class Quadratic final : public Semilinear {
public:
  /// \param symbol linear part, and what u² is multiplied with
  template <class Symbol>
  Quadratic(const Line& line, const std::string& method, Symbol&& symbol)
      : Semilinear(line, Kind::real, method),
        transform_(line.nodes),
        of_square_(linear_.size()),
        of_u_(linear_.size()) {
    const double scale = 1.0 / static_cast<double>(line.nodes);
    for (std::size_t k = 0; k < linear_.size(); ++k) {
      const auto [linear, square] = symbol(line.wave(k));
      (whole() ? of_u_ : linear_)[k] = linear;
      of_square_[k] = scale * scale * square;
    }
  }

protected:
  void rest(const Modes& at, Modes& out) override {
    transform_.inverse(at);
    double* const x = transform_.x.data();
    for (std::size_t i = 0; i < line_.nodes; ++i) {
      x[i] *= x[i];
    }
    transform_.forward(out);
    if (whole()) {
      for (std::size_t k = 0; k < out.size(); ++k) {
        out[k] = of_u_[k] * at[k] + of_square_[k] * out[k];
      }
    } else {
      for (std::size_t k = 0; k < out.size(); ++k) {
        out[k] *= of_square_[k];
      }
    }
  }

private:
  RealTransform transform_;
  Modes of_square_, of_u_;
};

class Schroedinger final : public Semilinear {
public:
  Schroedinger(const Line& line, double a, const std::string& method, const Frame& frame)
      : Semilinear(line, Kind::complex, method), a_(a), transform_(line.nodes) {
    for (std::size_t k = 0; k < line.nodes; ++k) {
      linear_[k] = {0.0, (frame.velocity - line.wave(k)) * line.wave(k) - frame.rate};
    }
  }

protected:
  void rest(const Modes& at, Modes& out) override {
    transform_.inverse(at);
    Complex* const x = transform_.x.data();
    const double scale = 1.0 / static_cast<double>(line_.nodes), factor = a_ * scale * scale * scale;
    for (std::size_t i = 0; i < line_.nodes; ++i) {
      const double re = x[i].real(), im = x[i].imag(), size = factor * (re * re + im * im);
      x[i] = {-size * im, size * re};
    }
    transform_.forward(out);
  }

private:
  double a_;
  ComplexTransform transform_;
};

using Symbols = std::array<Complex, 2>;

}  // namespace

std::unique_ptr<Peer> korteweg_de_vries(const Line& line, double eta, double gamma, const std::string& method,
                                        const Frame& frame) {
  return std::make_unique<Quadratic>(line, method, [=](double k) {
    return Symbols{Complex(0.0, gamma * gamma * k * k * k + frame.velocity * k - frame.rate),
                   Complex(0.0, -0.5 * eta * k)};
  });
}

std::unique_ptr<Peer> benjamin_bona_mahony(const Line& line, const std::string& method) {
  return std::make_unique<Quadratic>(line, method, [](double k) {
    return Symbols{Complex(0.0, -k / (1.0 + k * k)), Complex(0.0, -0.5 * k / (1.0 + k * k))};
  });
}

std::unique_ptr<Peer> schroedinger(const Line& line, double a, const std::string& method, const Frame& frame) {
  return std::make_unique<Schroedinger>(line, a, method, frame);
}

}  // namespace peers
