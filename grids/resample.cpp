#include <rubato/grids/resample.hpp>

#include <complex>
#include <cstddef>
#include <stdexcept>

#include <fmt/format.h>

#include <rubato/grids/fourier.hpp>

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
    ResamplingLine line(before.axis(a), after.axis(a));
    std::vector<double> next(after.size());
    const std::size_t stride = before.stride(a), n = before.cells(a), m = after.cells(a);
    for (std::size_t first = 0; first < before.size() / n; ++first) {
      // The line's place among those of lower and of higher axes.
      const std::size_t low = first % stride, high = first / stride;
      for (std::size_t i = 0; i < n; ++i) {
        line.in()[i] = present[low + stride * (i + n * high)];
      }
      const std::vector<double>& out = line.run();
      for (std::size_t i = 0; i < m; ++i) {
        next[low + stride * (i + m * high)] = out[i];
      }
    }
    present = std::move(next);
  }
  return present;
}

}  // namespace rubato::grids
