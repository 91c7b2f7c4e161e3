#include <algorithm>
#include <optional>
#include <stdexcept>
#include <vector>

#include <fmt/core.h>
#include <rubato/grids/buffer.hpp>
#include <rubato/grids/fftw_plan.hpp>
#include <rubato/grids/fourier.hpp>
#include <rubato/grids/parallel.hpp>

namespace rubato::grids {
namespace {

/// Neighbouring lines are fetched together: along y and z a cache line holds one value of each of eight.
constexpr std::size_t together = 8;

}  // namespace

struct SpectralDerivative::Storage {
  struct Direction {
    std::size_t padded = 0;                    ///< doubles from one line to the next in a workspace
    std::vector<std::complex<double>> symbol;  ///< with the factor 1/n
    std::optional<ShortTransform> own;         ///< in place of the plans, where there is one
    Plan forward;
    Plan inverse;

    /// The derivative of a line of n values, in place; `modes` has room for n + 2.
    void along(double* line, std::size_t n, double* modes) const {
      if (own) {
        double *re = modes, *im = modes + symbol.size();
        own->forward(line, re, im);
        for (std::size_t k = 0; k < symbol.size(); ++k) {
          const double factor = symbol[k].imag() * static_cast<double>(n);  // i times it; back there is a factor 1/n
          const double real = re[k];
          re[k] = -factor * im[k];
          im[k] = factor * real;
        }
        own->inverse(re, im, line);
        return;
      }
      fftw_execute_dft_r2c(forward.get(), line, reinterpret_cast<fftw_complex*>(modes));
      for (std::size_t k = 0; k < symbol.size(); ++k) {
        const double factor = symbol[k].imag();  // i times it
        const double real = modes[2 * k];
        modes[2 * k] = -factor * modes[2 * k + 1];
        modes[2 * k + 1] = factor * real;
      }
      fftw_execute_dft_c2r(inverse.get(), reinterpret_cast<fftw_complex*>(modes), line);
    }
  };

  Grid grid;
  std::vector<Direction> directions;
  std::size_t workspace = 0;
  std::vector<Buffer> workspaces;  ///< one for each thread: `together` lines, and one line of modes

  explicit Storage(const Grid& g) : grid(g) {
    for (const Axis& axis : grid.axes()) {
      const std::size_t padded = (axis.cells + 7) / 8 * 8;
      workspace = std::max(workspace, (lines_together(axis) + 1) * padded + 2);
    }
    prepare_workspaces();
    double* lines = workspaces.front().data();
    for (const Axis& axis : grid.axes()) {
      Direction direction;
      direction.padded = (axis.cells + 7) / 8 * 8;
      auto* modes = reinterpret_cast<fftw_complex*>(lines + lines_together(axis) * direction.padded);
      const int n = static_cast<int>(axis.cells);
      direction.forward = make_plan([&] { return fftw_plan_dft_r2c_1d(n, lines, modes, FFTW_ESTIMATE); });
      direction.inverse = make_plan([&] { return fftw_plan_dft_c2r_1d(n, modes, lines, FFTW_ESTIMATE); });
      if (ShortTransform::serves(axis.cells)) {
        direction.own.emplace(axis.cells);
      }
      for (std::size_t k = 0; k < axis.cells / 2 + 1; ++k) {
        direction.symbol.push_back(derivative_symbol(static_cast<std::ptrdiff_t>(k), axis) /
                                   static_cast<double>(axis.cells));
      }
      directions.push_back(std::move(direction));
    }
  }

  [[nodiscard]] std::size_t lines_together(const Axis& axis) const {
    return std::min(together, grid.size() / axis.cells);
  }

  void prepare_workspaces() {
    while (workspaces.size() < static_cast<std::size_t>(thread_count())) {
      workspaces.emplace_back(workspace);
    }
  }
};

SpectralDerivative::SpectralDerivative(const Grid& grid) : storage_(std::make_unique<Storage>(grid)) {}
SpectralDerivative::~SpectralDerivative() = default;
SpectralDerivative::SpectralDerivative(SpectralDerivative&&) noexcept = default;
SpectralDerivative& SpectralDerivative::operator=(SpectralDerivative&&) noexcept = default;

void SpectralDerivative::operator()(int axis, std::span<const double* const> in, std::span<double* const> out) const {
  Storage& s = *storage_;
  if (axis < 0 || axis >= s.grid.dimensions() || in.size() != out.size()) {
    throw std::invalid_argument(fmt::format("a derivative along axis {} of {}, from {} fields to {}", axis + 1,
                                            s.grid.dimensions(), in.size(), out.size()));
  }
  s.prepare_workspaces();
  const Storage::Direction& direction = s.directions[axis];
  const std::size_t n = s.grid.cells(axis);
  const std::size_t stride = s.grid.stride(axis);
  const std::size_t lines = s.grid.size() / n;
  const std::size_t groups = (lines + together - 1) / together;
  const auto one = [&](std::size_t unit) {
    double* space = s.workspaces[thread_number()].data();
    double* modes = space + std::min(together, lines) * direction.padded;
    const double* from = in[unit / groups];
    double* to = out[unit / groups];
    const std::size_t first = unit % groups * together;
    const std::size_t count = std::min(together, lines - first);
    std::size_t starts[together];
    for (std::size_t l = 0; l < count; ++l) {
      starts[l] = (first + l) / stride * stride * n + (first + l) % stride;
    }
    for (std::size_t i = 0; i < n; ++i) {
      for (std::size_t l = 0; l < count; ++l) {
        space[l * direction.padded + i] = from[starts[l] + i * stride];
      }
    }
    for (std::size_t l = 0; l < count; ++l) {
      direction.along(space + l * direction.padded, n, modes);
    }
    for (std::size_t i = 0; i < n; ++i) {
      for (std::size_t l = 0; l < count; ++l) {
        to[starts[l] + i * stride] = space[l * direction.padded + i];
      }
    }
  };
  for_each_block(in.size() * groups, std::max<std::size_t>(1, nodes_per_block / (n * std::min(together, lines))),
                 [&](std::size_t begin, std::size_t end) {
                   for (std::size_t unit = begin; unit < end; ++unit) {
                     one(unit);
                   }
                 });
}

void SpectralDerivative::operator()(int axis, const double* in, double* out) const {
  (*this)(axis, std::span(&in, 1), std::span(&out, 1));
}

}  // namespace rubato::grids
