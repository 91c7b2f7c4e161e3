#include <rubato/grids/resample.hpp>

#include <complex>
#include <cstddef>
#include <numeric>
#include <optional>
#include <stdexcept>

#include <fmt/format.h>

#include <rubato/grids/fourier.hpp>
#include <rubato/grids/local_polynomial.hpp>

namespace rubato::grids {

namespace {

/// Interpolates lines along one axis.
class ResamplingLine {
public:
  ResamplingLine(const Axis& from, const Axis& to)
      : n_(from.cells), m_(to.cells), forward_(Grid({from}), 1), inverse_(Grid({to}), 1), in_(n_), out_(m_) {}

  std::vector<double>& in() { return in_; }
  const std::vector<double>& run() {
    const double* in = in_.data();
    forward_.forward({&in, 1});
    for (std::size_t k = 0; k < inverse_.modes(); ++k) {
      inverse_.at(0, k) = 0.0;
    }
    const double scale = static_cast<double>(m_) / static_cast<double>(n_);
    for (std::size_t k = 0; k < forward_.modes(); ++k) {
      const std::complex<double> c = scale * forward_.at(0, k);
      // Waves k and -k; 0 is one, and the highest of an even number is half of each.
      const bool highest = 2 * k == n_;
      const auto wave = static_cast<std::ptrdiff_t>(k);
      add(wave, highest ? 0.5 * c : c);
      if (k > 0) {
        add(-wave, std::conj(highest ? 0.5 * c : c));
      }
    }
    double* out = out_.data();
    inverse_.inverse({&out, 1});
    return out_;
  }

private:
  /// At the nodes of the new grid waves that differ by its number of cells are the same.
  void add(std::ptrdiff_t wave, std::complex<double> c) {
    const auto m = static_cast<std::ptrdiff_t>(m_);
    const std::ptrdiff_t k = ((wave % m) + m) % m;
    if (2 * k <= m) {
      inverse_.at(0, static_cast<std::size_t>(k)) += c;
    }
  }

  std::size_t n_, m_;
  Fourier forward_, inverse_;
  std::vector<double> in_, out_;
};

/// The same between walls.
class PolynomialLine {
public:
  PolynomialLine(const Axis& from, const Axis& to) : in_(from.cells), out_(to.cells) {
    for (std::size_t i = 0; i < to.cells; ++i) {
      weights_.push_back(local_weights(from, to.node(i)));
    }
  }

  std::vector<double>& in() { return in_; }
  const std::vector<double>& run() {
    for (std::size_t i = 0; i < out_.size(); ++i) {
      out_[i] = std::inner_product(weights_[i].of.begin(), weights_[i].of.end(),
                                   in_.begin() + static_cast<std::ptrdiff_t>(weights_[i].first), 0.0);
    }
    return out_;
  }

private:
  std::vector<LocalWeights> weights_;
  std::vector<double> in_, out_;
};

}  // namespace

std::vector<double> resampled(std::span<const double> values, const Grid& from, const Grid& to) {
  bool fits = from.dimensions() == to.dimensions() && values.size() == from.size();
  for (int a = 0; fits && a < from.dimensions(); ++a) {
    fits = from.axis(a).from == to.axis(a).from && from.axis(a).to == to.axis(a).to;
  }
  if (!fits) {
    throw std::invalid_argument("values cannot be interpolated between grids that cover different boxes");
  }
  std::vector<double> present(values.begin(), values.end());
  std::vector<Axis> axes = from.axes();
  for (int a = 0; a < from.dimensions(); ++a) {
    if (axes[static_cast<std::size_t>(a)].cells == to.axis(a).cells) {
      continue;
    }
    const Grid before(axes);
    axes[static_cast<std::size_t>(a)] = to.axis(a);
    const Grid after(axes);
    if (from.axis(a).has_walls() != to.axis(a).has_walls()) {
      throw std::invalid_argument("values cannot be interpolated between a period and the space between walls");
    }
    std::optional<ResamplingLine> waves;
    std::optional<PolynomialLine> local;
    if (from.axis(a).has_walls()) {
      local.emplace(before.axis(a), after.axis(a));
    } else {
      waves.emplace(before.axis(a), after.axis(a));
    }
    std::vector<double>& in = waves ? waves->in() : local->in();
    std::vector<double> next(after.size());
    const std::size_t stride = before.stride(a), n = before.cells(a), m = after.cells(a);
    for (std::size_t first = 0; first < before.size() / n; ++first) {
      // The line's place among those of lower and of higher axes.
      const std::size_t low = first % stride, high = first / stride;
      for (std::size_t i = 0; i < n; ++i) {
        in[i] = present[low + stride * (i + n * high)];
      }
      const std::vector<double>& out = waves ? waves->run() : local->run();
      for (std::size_t i = 0; i < m; ++i) {
        next[low + stride * (i + m * high)] = out[i];
      }
    }
    present = std::move(next);
  }
  return present;
}

}  // namespace rubato::grids
