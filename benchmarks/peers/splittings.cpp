#include <cmath>

#include "passes.hpp"
#include "peer.hpp"

namespace peers {

namespace {

struct SineRest {
  double operator()(double u) const { return u - std::sin(u); }
};
struct CubicRest {
  double operator()(double u) const { return -u * u * u; }
};

template <class R>
class WavesAndKicks final : public Peer {
public:
  WavesAndKicks(const Line& line, const std::string& name)
      : Peer(line, Kind::wave), passes_(rubato::composition(name)), transform_(line.nodes), g_(line.nodes / 2 + 1) {}

  double go(double time, int steps) override {
    const std::size_t modes = g_.size(), n = line_.nodes;
    const double h = time / steps, scale = 1.0 / static_cast<double>(n);
    std::vector<Nodes> cosine, sine, omega_sine;
    for (const double drift : passes_.drifts) {
      Nodes c(modes), s(modes), o(modes);
      for (std::size_t k = 0; k < modes; ++k) {
        const double kappa = line_.wave(k), omega = std::sqrt(1.0 + kappa * kappa);
        c[k] = std::cos(omega * drift * h);
        s[k] = std::sin(omega * drift * h) / omega;
        o[k] = -std::sin(omega * drift * h) * omega;
      }
      cosine.push_back(c);
      sine.push_back(s);
      omega_sine.push_back(o);
    }
    Complex* const u = state_.u.data();
    Complex* const v = state_.v.data();
    double* const x = transform_.x.data();
    const Complex* const g = g_.data();
    const double start = cpu_seconds();
    passes_.run(steps, [&](const Passes::Pass& pass) {
      const double b = pass.kick * h;
      if (b != 0.0) {
        transform_.inverse(state_.u);
        for (std::size_t i = 0; i < n; ++i) {
          x[i] = R()(scale * x[i]);
        }
        transform_.forward(g_);
      }
      const double* const c = cosine[pass.drift].data();
      const double* const s = sine[pass.drift].data();
      const double* const o = omega_sine[pass.drift].data();
      for (std::size_t k = 0; k < modes; ++k) {
        const Complex old = u[k], kicked = v[k] + b * g[k];
        u[k] = c[k] * old + s[k] * kicked;
        v[k] = o[k] * old + c[k] * kicked;
      }
    });
    return cpu_seconds() - start;
  }

private:
  Passes passes_;
  RealTransform transform_;
  Modes g_;
};

class SplitStep final : public Peer {
public:
  SplitStep(const Line& line, double a, const std::string& name, const Frame& frame)
      : Peer(line, Kind::complex),
        a_(a),
        frame_(frame),
        passes_(rubato::composition(name)),
        transform_(line.nodes),
        angle_(line.nodes),
        c_(angle_),
        s_(c_) {}

  double go(double time, int steps) override {
    const std::size_t n = line_.nodes;
    const double h = time / steps, scale = 1.0 / static_cast<double>(n);
    std::vector<Modes> free;
    for (const double drift : passes_.drifts) {
      Modes& factor = free.emplace_back(n);
      for (std::size_t k = 0; k < n; ++k) {
        factor[k] = std::polar(1.0, ((frame_.velocity - line_.wave(k)) * line_.wave(k) - frame_.rate) * drift * h);
      }
    }
    Complex* const u = state_.u.data();
    Complex* const x = transform_.x.data();
    const double start = cpu_seconds();
    passes_.run(steps, [&](const Passes::Pass& pass) {
      if (pass.kick != 0.0) {
        transform_.inverse(state_.u);
        turn(x, pass.kick * h, scale);
        transform_.forward(state_.u);
      }
      const Complex* const factor = free[pass.drift].data();
      for (std::size_t k = 0; k < n; ++k) {
        u[k] *= factor[k];
      }
    });
    return cpu_seconds() - start;
  }

private:
  /// x ← scale·x·exp(i a|scale·x|²τ), in loops that go by vectors each.
  void turn(Complex* x, double tau, double scale) {
    const std::size_t n = line_.nodes;
    double* const angle = angle_.data();
    double* const c = c_.data();
    double* const s = s_.data();
    const double factor = a_ * tau * scale * scale;
    for (std::size_t i = 0; i < n; ++i) {
      angle[i] = factor * (x[i].real() * x[i].real() + x[i].imag() * x[i].imag());
    }
    for (std::size_t i = 0; i < n; ++i) {
      c[i] = scale * std::cos(angle[i]);
    }
    for (std::size_t i = 0; i < n; ++i) {
      s[i] = scale * std::sin(angle[i]);
    }
    for (std::size_t i = 0; i < n; ++i) {
      x[i] = {c[i] * x[i].real() - s[i] * x[i].imag(), c[i] * x[i].imag() + s[i] * x[i].real()};
    }
  }

  double a_;
  Frame frame_;
  Passes passes_;
  ComplexTransform transform_;
  Nodes angle_, c_, s_;
};

}  // namespace

std::unique_ptr<Peer> waves_and_kicks(const Line& line, Rest rest, const std::string& composition) {
  if (rest == Rest::sine) {
    return std::make_unique<WavesAndKicks<SineRest>>(line, composition);
  }
  return std::make_unique<WavesAndKicks<CubicRest>>(line, composition);
}

std::unique_ptr<Peer> split_step(const Line& line, double a, const std::string& composition, const Frame& frame) {
  return std::make_unique<SplitStep>(line, a, composition, frame);
}

}  // namespace peers
