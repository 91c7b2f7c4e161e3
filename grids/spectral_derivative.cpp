#include <algorithm>
#include <optional>
#include <stdexcept>
#include <vector>

#include <fmt/core.h>
#include <rubato/grids/buffer.hpp>
#include <rubato/grids/columns.hpp>
#include <rubato/grids/fftw_plan.hpp>
#include <rubato/grids/fourier.hpp>
#include <rubato/grids/parallel.hpp>

namespace rubato::grids {
namespace {

/// Neighbouring lines are fetched together: along y and z a cache line holds one value of each of eight, and four of
/// them lie in one page.
constexpr std::size_t together = 32;

}  // namespace

struct SpectralDerivative::Storage {
  struct Direction {
    std::size_t lines = 1;                     ///< so many are taken together
    std::size_t padded = 0;                    ///< doubles from one line to the next in a workspace
    std::vector<std::complex<double>> symbol;  ///< with the factor 1/n
    Plan forward;
    Plan inverse;

    /// The derivative of a line of values, in place; `modes` has room for two more.
    void along(double* line, double* modes) const {
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
  std::optional<Columns> columns;  ///< where the grid is a slab's part
  std::vector<Direction> directions;
  std::size_t workspace = 0;
  std::vector<Buffer> workspaces;  ///< one for each thread: `together` lines, and one line of modes

  explicit Storage(const Grid& g) : grid(g) {
    const Slab* const slab = Slab::of(g);
    if (slab != nullptr) {
      columns.emplace(*slab);
    }
    const std::vector<Axis>& axes = slab == nullptr ? grid.axes() : slab->whole().axes();
    for (std::size_t a = 0; a < axes.size(); ++a) {
      Direction& direction = directions.emplace_back();
      const std::size_t lines = slab != nullptr && a + 1 == axes.size() ? columns->count() : g.size() / axes[a].cells;
      direction.lines = std::clamp<std::size_t>(lines, 1, together);
      direction.padded = (axes[a].cells + 7) / 8 * 8;
      workspace = std::max(workspace, (direction.lines + 1) * direction.padded + 2);
    }
    prepare_workspaces();
    double* lines = workspaces.front().data();
    for (std::size_t a = 0; a < axes.size(); ++a) {
      const Axis& axis = axes[a];
      Direction& direction = directions[a];
      auto* modes = reinterpret_cast<fftw_complex*>(lines + direction.lines * direction.padded);
      const int n = static_cast<int>(axis.cells);
      direction.forward = make_plan([&] { return fftw_plan_dft_r2c_1d(n, lines, modes, FFTW_ESTIMATE); });
      direction.inverse = make_plan([&] { return fftw_plan_dft_c2r_1d(n, modes, lines, FFTW_ESTIMATE); });
      for (std::size_t k = 0; k < axis.cells / 2 + 1; ++k) {
        direction.symbol.push_back(derivative_symbol(static_cast<std::ptrdiff_t>(k), axis) /
                                   static_cast<double>(axis.cells));
      }
    }
  }

  void prepare_workspaces() {
    while (workspaces.size() < static_cast<std::size_t>(thread_count())) {
      workspaces.emplace_back(workspace);
    }
  }

  /// The derivatives of `lines` lines of each of `fields` fields, some together: read(field, first line, count, lines
  /// of the workspace) and write(the same) copy them there and back.
  template <class Read, class Write>
  void each_line(const Direction& direction, std::size_t n, std::size_t fields, std::size_t lines, const Read& read,
                 const Write& write) {
    const std::size_t groups = (lines + together - 1) / together;
    for_each_block(fields * groups, std::max<std::size_t>(1, nodes_per_block / (n * direction.lines)),
                   [&](std::size_t begin, std::size_t end, std::size_t thread) {
                     double* space = workspaces[thread].data();
                     for (std::size_t unit = begin; unit < end; ++unit) {
                       const std::size_t field = unit / groups, first = unit % groups * together;
                       const std::size_t count = std::min(together, lines - first);
                       read(field, first, count, space);
                       for (std::size_t l = 0; l < count; ++l) {
                         direction.along(space + l * direction.padded, space + direction.lines * direction.padded);
                       }
                       write(field, first, count, space);
                     }
                   });
  }

  /// Across the planes of a slab.
  void across(const Direction& direction, std::span<const double* const> in, std::span<double* const> out) {
    const std::size_t n = columns->planes(), padded = direction.padded;
    columns->take(in);
    each_line(
        direction, n, in.size(), columns->count(),
        [&](std::size_t field, std::size_t first, std::size_t count, double* lines) {
          for (std::size_t i = 0; i < n; ++i) {
            const double* row = columns->row(field, i) + first;
            for (std::size_t l = 0; l < count; ++l) {
              lines[l * padded + i] = row[l];
            }
          }
        },
        [&](std::size_t field, std::size_t first, std::size_t count, const double* lines) {
          for (std::size_t i = 0; i < n; ++i) {
            double* row = columns->row(field, i) + first;
            for (std::size_t l = 0; l < count; ++l) {
              row[l] = lines[l * padded + i];
            }
          }
        });
    columns->put(out);
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
  const Storage::Direction& direction = s.directions[static_cast<std::size_t>(axis)];
  if (s.columns && axis == s.grid.dimensions() - 1) {
    s.across(direction, in, out);
    return;
  }
  const std::size_t n = s.grid.cells(axis), padded = direction.padded;
  const std::size_t stride = s.grid.stride(axis);
  const auto start = [n, stride](std::size_t line) { return line / stride * stride * n + line % stride; };
  s.each_line(
      direction, n, in.size(), s.grid.size() / n,
      [&](std::size_t field, std::size_t first, std::size_t count, double* lines) {
        std::size_t starts[together];
        for (std::size_t l = 0; l < count; ++l) {
          starts[l] = start(first + l);
        }
        const double* from = in[field];
        if (stride == 1) {
          for (std::size_t l = 0; l < count; ++l) {
            std::copy_n(from + starts[l], n, lines + l * padded);
          }
          return;
        }
        for (std::size_t i = 0; i < n; ++i) {
          for (std::size_t l = 0; l < count; ++l) {
            lines[l * padded + i] = from[starts[l] + i * stride];
          }
        }
      },
      [&](std::size_t field, std::size_t first, std::size_t count, const double* lines) {
        std::size_t starts[together];
        for (std::size_t l = 0; l < count; ++l) {
          starts[l] = start(first + l);
        }
        double* to = out[field];
        if (stride == 1) {
          for (std::size_t l = 0; l < count; ++l) {
            std::copy_n(lines + l * padded, n, to + starts[l]);
          }
          return;
        }
        for (std::size_t i = 0; i < n; ++i) {
          for (std::size_t l = 0; l < count; ++l) {
            to[starts[l] + i * stride] = lines[l * padded + i];
          }
        }
      });
}

void SpectralDerivative::operator()(int axis, const double* in, double* out) const {
  (*this)(axis, std::span(&in, 1), std::span(&out, 1));
}

}  // namespace rubato::grids
