#include <rubato/grids/fourier.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>

#include <rubato/grids/buffer.hpp>
#include <rubato/grids/fftw_plan.hpp>
#include <rubato/grids/parallel.hpp>

namespace rubato::grids {

double wave_angle(std::ptrdiff_t k, std::size_t n) {
  return 2.0 * std::numbers::pi * static_cast<double>(k) / static_cast<double>(n);
}

std::complex<double> average_symbol(double theta) {
  // e^{iθ/2} cos(θ/2): no cancellation near θ = π.
  return std::polar(1.0, 0.5 * theta) * std::cos(0.5 * theta);
}

std::complex<double> difference_symbol(double theta, double spacing) {
  // e^{iθ/2} 2i sin(θ/2)/Δx: no cancellation near θ = 0.
  return std::polar(1.0, 0.5 * theta) * std::complex<double>(0.0, 2.0 * std::sin(0.5 * theta) / spacing);
}

std::complex<double> derivative_symbol(std::ptrdiff_t k, const Axis& axis) {
  if (2 * static_cast<std::size_t>(std::abs(k)) == axis.cells) {
    return 0.0;
  }
  return {0.0, 2.0 * std::numbers::pi * static_cast<double>(k) / axis.length()};
}

/// Each row along x is padded to whole cache lines, so that every transform of an axis finds the alignment its plan was
/// made for. Along y and z, four neighbouring columns (a cache line of complex numbers) are transformed together.
struct Fourier::Storage {
  static constexpr std::size_t together = 4;

  Grid grid;
  int fields;
  std::size_t nx, ny, nz;
  std::size_t half;         ///< modes kept along x
  std::size_t real_row;     ///< doubles from row to row
  std::size_t complex_row;  ///< complex numbers from row to row
  Buffer real;
  Buffer complex;
  Plan rows_forward, rows_inverse, y_forward, y_inverse, z_forward, z_inverse;

  Storage(const Grid& g, int n)
      : grid(g),
        fields(n),
        nx(g.cells(0)),
        ny(g.cells(1)),
        nz(g.cells(2)),
        half(nx / 2 + 1),
        real_row((nx + 7) / 8 * 8),
        complex_row((half + together - 1) / together * together),
        real(static_cast<std::size_t>(n) * ny * nz * real_row),
        complex(2 * static_cast<std::size_t>(n) * ny * nz * complex_row) {
    parallel_fill(real.data(), real.size(), 0.0);
    parallel_fill(complex.data(), complex.size(), 0.0);
    const int length = static_cast<int>(nx);
    rows_forward = make_plan([&] { return fftw_plan_dft_r2c_1d(length, real.data(), spectrum(0), FFTW_ESTIMATE); });
    rows_inverse = make_plan([&] { return fftw_plan_dft_c2r_1d(length, spectrum(0), real.data(), FFTW_ESTIMATE); });
    const auto columns = [&](std::size_t size, std::size_t stride, int sign) {
      const int lengths[] = {static_cast<int>(size)};
      return make_plan([&] {
        return fftw_plan_many_dft(1, lengths, together, spectrum(0), nullptr, static_cast<int>(stride), 1, spectrum(0),
                                  nullptr, static_cast<int>(stride), 1, sign, FFTW_ESTIMATE);
      });
    };
    if (ny > 1) {
      y_forward = columns(ny, complex_row, FFTW_FORWARD);
      y_inverse = columns(ny, complex_row, FFTW_BACKWARD);
    }
    if (nz > 1) {
      z_forward = columns(nz, complex_row * ny, FFTW_FORWARD);
      z_inverse = columns(nz, complex_row * ny, FFTW_BACKWARD);
    }
  }

  fftw_complex* spectrum(std::size_t offset) { return reinterpret_cast<fftw_complex*>(complex.data()) + offset; }

  void transform_columns(fftw_plan plan, bool along_z, std::size_t count) {
    const std::size_t groups = complex_row / together;
    const std::size_t planes = along_z ? ny : nz;  // of the direction that is not transformed
    for_each_block(count * planes * groups, 4, [&](std::size_t begin, std::size_t end) {
      for (std::size_t unit = begin; unit < end; ++unit) {
        const std::size_t plane = unit / groups % planes;
        const std::size_t field = unit / groups / planes;
        const std::size_t row = field * ny * nz + (along_z ? plane : plane * ny);
        fftw_complex* start = spectrum(row * complex_row + unit % groups * together);
        fftw_execute_dft(plan, start, start);
      }
    });
  }
};

Fourier::Fourier(const Grid& grid, int fields) : storage_(std::make_unique<Storage>(grid, fields)) {}
Fourier::~Fourier() = default;
Fourier::Fourier(Fourier&&) noexcept = default;
Fourier& Fourier::operator=(Fourier&&) noexcept = default;

int Fourier::fields() const {
  return storage_->fields;
}
std::size_t Fourier::modes() const {
  return storage_->half * storage_->ny * storage_->nz;
}

std::size_t Fourier::row_length() const {
  return storage_->half;
}

std::array<std::ptrdiff_t, 3> Fourier::wave(std::size_t mode) const {
  const Storage& s = *storage_;
  const auto signed_index = [](std::size_t k, std::size_t n) {
    return static_cast<std::ptrdiff_t>(k) - (2 * k > n ? static_cast<std::ptrdiff_t>(n) : 0);
  };
  return {static_cast<std::ptrdiff_t>(mode % s.half), signed_index(mode / s.half % s.ny, s.ny),
          signed_index(mode / s.half / s.ny, s.nz)};
}

Fourier::Complex& Fourier::at(int field, std::size_t mode) {
  Storage& s = *storage_;
  const std::size_t row = static_cast<std::size_t>(field) * s.ny * s.nz + mode / s.half;
  return reinterpret_cast<Complex*>(s.complex.data())[row * s.complex_row + mode % s.half];
}

const Fourier::Complex& Fourier::at(int field, std::size_t mode) const {
  return const_cast<Fourier*>(this)->at(field, mode);
}

void Fourier::forward(std::span<const double* const> values) {
  Storage& s = *storage_;
  const std::size_t rows = s.ny * s.nz;
  for_each_block(values.size() * rows, std::max<std::size_t>(1, 1024 / s.nx), [&](std::size_t begin, std::size_t end) {
    for (std::size_t row = begin; row < end; ++row) {
      double* to = s.real.data() + row * s.real_row;
      std::copy_n(values[row / rows] + row % rows * s.nx, s.nx, to);
      fftw_execute_dft_r2c(s.rows_forward.get(), to, s.spectrum(row * s.complex_row));
    }
  });
  if (s.y_forward) {
    s.transform_columns(s.y_forward.get(), false, values.size());
  }
  if (s.z_forward) {
    s.transform_columns(s.z_forward.get(), true, values.size());
  }
}

void Fourier::inverse(std::span<double* const> values) {
  Storage& s = *storage_;
  if (s.z_inverse) {
    s.transform_columns(s.z_inverse.get(), true, values.size());
  }
  if (s.y_inverse) {
    s.transform_columns(s.y_inverse.get(), false, values.size());
  }
  const std::size_t rows = s.ny * s.nz;
  const double factor = 1.0 / static_cast<double>(s.grid.size());
  for_each_block(values.size() * rows, std::max<std::size_t>(1, 1024 / s.nx), [&](std::size_t begin, std::size_t end) {
    for (std::size_t row = begin; row < end; ++row) {
      double* from = s.real.data() + row * s.real_row;
      fftw_execute_dft_c2r(s.rows_inverse.get(), s.spectrum(row * s.complex_row), from);
      double* to = values[row / rows] + row % rows * s.nx;
      for (std::size_t i = 0; i < s.nx; ++i) {
        to[i] = factor * from[i];
      }
    }
  });
}

}  // namespace rubato::grids
