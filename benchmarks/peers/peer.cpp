#include "peer.hpp"

#include <cmath>
#include <numbers>

namespace peers {

double Line::wave(std::size_t mode) const {
  if (2 * mode == nodes) {
    return 0.0;
  }
  const double k = static_cast<double>(mode) - (2 * mode > nodes ? static_cast<double>(nodes) : 0.0);
  return 2.0 * std::numbers::pi * k / length;
}

Complex Series::operator()(double x) const {
  const double theta = 2.0 * std::numbers::pi * (x - from) / length;
  const Complex z = std::polar(1.0, theta);
  Complex sum = 0.0;
  for (std::size_t k = coefficients.size(); k-- > 0;) {
    sum = sum * z + coefficients[k];
  }
  return sum * std::polar(1.0, -theta * static_cast<double>(coefficients.size() / 2));
}

void Peer::stand(const Function& first, const Function& second) {
  const std::size_t n = line_.nodes;
  if (kind_ == Kind::complex) {
    ComplexTransform transform(n);
    for (std::size_t i = 0; i < n; ++i) {
      transform.x[i] = {first(line_.node(i)), second ? second(line_.node(i)) : 0.0};
    }
    state_.u.resize(n);
    transform.forward(state_.u);
    return;
  }
  RealTransform transform(n);
  const auto modes_of = [&](const Function& f, Modes& modes) {
    for (std::size_t i = 0; i < n; ++i) {
      transform.x[i] = f ? f(line_.node(i)) : 0.0;
    }
    modes.resize(n / 2 + 1);
    transform.forward(modes);
  };
  modes_of(first, state_.u);
  if (kind_ == Kind::wave) {
    modes_of(second, state_.v);
  }
}

Series Peer::series_of(const Modes& modes) const {
  // The mode without a partner, if there is one, is half e^{iπi} and half e^{-iπi}: at the nodes they are the same.
  const std::size_t n = line_.nodes, most = n / 2;
  Series series{line_.from, line_.length, std::vector<Complex>(2 * most + 1)};
  const double factor = 1.0 / static_cast<double>(n);
  for (std::size_t k = 0; k <= most; ++k) {
    const double weight = 2 * k == n ? 0.5 * factor : factor;
    series.coefficients[most + k] = weight * modes[k];
    series.coefficients[most - k] = weight * (kind_ == Kind::complex ? modes[k == 0 ? 0 : n - k] : std::conj(modes[k]));
  }
  return series;
}

}  // namespace peers
