#include <rubato/grids/fourier.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <stdexcept>

#include <rubato/base/wide_vectors.hpp>
#include <rubato/grids/buffer.hpp>
#include <rubato/grids/fftw_plan.hpp>
#include <rubato/grids/parallel.hpp>
#include <rubato/grids/transposition.hpp>
#include <rubato/grids/whole.hpp>

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

bool has_small_factors(std::size_t n) {
  for (const std::size_t prime : {2U, 3U, 5U, 7U}) {
    while (n > 1 && n % prime == 0) {
      n /= prime;
    }
  }
  return n == 1;
}

std::size_t good_odd_count(std::size_t least) {
  std::size_t n = least | 1U;
  while (!has_small_factors(n)) {
    n += 2;
  }
  return n;
}

namespace {

RUBATO_WIDE_VECTORS void scale(double factor, const double* from, std::size_t count, double* __restrict to) {
  for (std::size_t i = 0; i < count; ++i) {
    to[i] = factor * from[i];
  }
}

}  // namespace

/// Each row along x is padded to whole cache lines, so that every transform of an axis finds the alignment its plan was
/// made for. Two neighbouring rows of a field are transformed as real and imaginary part of one: FFTW does large prime
/// factors of complex transforms much faster than those of real ones, and grids of boxes are odd. Along y and z, four
/// neighbouring columns (a cache line of complex numbers) are transformed together.
struct Fourier::Storage {
  static constexpr std::size_t together = 4;

  int fields;
  std::size_t nodes;  ///< of the whole lattice
  std::size_t nx, ny, nz;
  std::size_t half;           ///< modes kept along x
  std::size_t real_row;       ///< doubles from row to row
  std::size_t complex_row;    ///< complex numbers from row to row
  std::vector<Buffer> pairs;  ///< of each thread, room for two rows
  Buffer complex;
  /// Where the grid is a slab's part: ny or nz are the planes that this rank owns, transforms across planes are those
  /// of columns, and modes are there.
  std::optional<Transposition> transposed;
  std::size_t first_node = 0;
  Buffer across;
  Plan across_forward, across_inverse;
  Plan pair_forward, pair_inverse, row_forward, row_inverse, y_forward, y_inverse, z_forward, z_inverse;

  Storage(const Grid& g, int n)
      : fields(n),
        nodes(whole_of(g).size()),
        nx(g.cells(0)),
        ny(cells_here(g, 1)),
        nz(cells_here(g, 2)),
        half(nx / 2 + 1),
        real_row((nx + 7) / 8 * 8),
        complex_row((half + together - 1) / together * together),
        complex(2 * static_cast<std::size_t>(n) * ny * nz * complex_row) {
    const Slab* const slab = Slab::of(g);
    if (slab != nullptr) {
      share(*slab, g.dimensions());
    }
    make_room_for_threads();
    double* const real = pairs.front().data();
    const int length = static_cast<int>(nx);
    row_forward = make_plan([&] { return fftw_plan_dft_r2c_1d(length, real, spectrum(0), FFTW_ESTIMATE); });
    row_inverse = make_plan([&] { return fftw_plan_dft_c2r_1d(length, spectrum(0), real, FFTW_ESTIMATE); });
    if (ny * nz > 1) {
      const auto pair = [&](int sign) {
        auto* rows = reinterpret_cast<fftw_complex*>(real);
        return make_plan([&] { return fftw_plan_dft_1d(length, rows, rows, sign, FFTW_ESTIMATE); });
      };
      pair_forward = pair(FFTW_FORWARD);
      pair_inverse = pair(FFTW_BACKWARD);
    }
    const auto columns = [&](std::size_t size, std::size_t stride, int sign) {
      const int lengths[] = {static_cast<int>(size)};
      return make_plan([&] {
        return fftw_plan_many_dft(1, lengths, together, spectrum(0), nullptr, static_cast<int>(stride), 1, spectrum(0),
                                  nullptr, static_cast<int>(stride), 1, sign, FFTW_ESTIMATE);
      });
    };
    const int last = slab != nullptr ? g.dimensions() - 1 : 3;
    if (ny > 1 && last > 1) {
      y_forward = columns(ny, complex_row, FFTW_FORWARD);
      y_inverse = columns(ny, complex_row, FFTW_BACKWARD);
    }
    if (nz > 1 && last > 2) {
      z_forward = columns(nz, complex_row * ny, FFTW_FORWARD);
      z_inverse = columns(nz, complex_row * ny, FFTW_BACKWARD);
    }
  }

  static std::size_t cells_here(const Grid& g, int axis) {
    const Slab* const slab = Slab::of(g);
    return slab != nullptr && axis == g.dimensions() - 1 ? slab->planes(slab->rank()) : g.cells(axis);
  }
  /// \throws std::invalid_argument for a line, which has no transforms along planes
  void share(const Slab& slab, int dimensions) {
    if (dimensions == 1) {
      throw std::invalid_argument("transforms along a line are not shared by ranks");
    }
    first_node = slab.first_node();
    transposed.emplace(
        slab, fields,
        Transposition::Shape{
            .rows = dimensions == 2 ? 1 : ny, .width = complex_row, .modes = half, .together = together});
    const std::size_t size = transposed->mine().size();
    across =
        Buffer(std::max<std::size_t>(2 * together, 2 * static_cast<std::size_t>(fields) * transposed->planes() * size));
    if (size == 0) {
      return;
    }
    const int lengths[] = {static_cast<int>(transposed->planes())}, stride = static_cast<int>(size);
    auto* at = reinterpret_cast<fftw_complex*>(across.data());
    const auto plan = [&](int sign) {
      return make_plan([&] {
        return fftw_plan_many_dft(1, lengths, together, at, nullptr, stride, 1, at, nullptr, stride, 1, sign,
                                  FFTW_ESTIMATE);
      });
    };
    across_forward = plan(FFTW_FORWARD);
    across_inverse = plan(FFTW_BACKWARD);
  }

  void transform_across(fftw_plan plan, std::size_t count) {
    const std::size_t size = transposed->mine().size(), groups = size / together;
    for_each_block(count * groups, 4, [&](std::size_t begin, std::size_t end) {
      for (std::size_t unit = begin; unit < end; ++unit) {
        const std::size_t place = unit / groups * transposed->planes() * size + unit % groups * together;
        auto* start = reinterpret_cast<fftw_complex*>(across.data()) + place;
        fftw_execute_dft(plan, start, start);
      }
    });
  }

  fftw_complex* spectrum(std::size_t offset) { return reinterpret_cast<fftw_complex*>(complex.data()) + offset; }

  void make_room_for_threads() {
    while (pairs.size() < static_cast<std::size_t>(thread_count())) {
      pairs.emplace_back(2 * real_row);
    }
  }

  /// The rows of `count` fields, pair by pair: use(field, first row, whether there is a second one, room for both).
  template <class Use>
  void for_each_pair(std::size_t count, Use&& use) {
    make_room_for_threads();
    const std::size_t rows = ny * nz;
    const std::size_t of_field = (rows + 1) / 2;
    for_each_block(count * of_field, std::max<std::size_t>(1, nodes_per_block / nx),
                   [&](std::size_t begin, std::size_t end, std::size_t thread) {
                     double* const room = pairs[thread].data();
                     if (rows == 1) {  // divisions take as long as a short transform's sweep
                       for (std::size_t field = begin; field < end; ++field) {
                         use(field, 0, false, room);
                       }
                       return;
                     }
                     for (std::size_t unit = begin; unit < end; ++unit) {
                       const std::size_t row = 2 * (unit % of_field);
                       use(unit / of_field, row, row + 1 < rows, room);
                     }
                   });
  }

  double* spectrum_at(std::size_t row) { return complex.data() + 2 * row * complex_row; }

  void forward(const double* first, const double* second, std::size_t row, double* z) {
    for (std::size_t i = 0; i < nx; ++i) {
      z[2 * i] = first[i];
      z[2 * i + 1] = second[i];
    }
    auto* rows = reinterpret_cast<fftw_complex*>(z);
    fftw_execute_dft(pair_forward.get(), rows, rows);
    double* x = spectrum_at(row);
    double* y = spectrum_at(row + 1);
    for (std::size_t k = 0; k < half; ++k) {  // X_k = (Z_k + Z̄_{n-k})/2, Y_k = (Z_k - Z̄_{n-k})/2i
      const double* a = z + 2 * k;
      const double* b = z + 2 * (k == 0 ? 0 : nx - k);
      x[2 * k] = 0.5 * (a[0] + b[0]);
      x[2 * k + 1] = 0.5 * (a[1] - b[1]);
      y[2 * k] = 0.5 * (a[1] + b[1]);
      y[2 * k + 1] = 0.5 * (b[0] - a[0]);
    }
  }

  void inverse(std::size_t row, double factor, double* first, double* second, double* z) {
    const double* x = spectrum_at(row);
    const double* y = spectrum_at(row + 1);
    for (std::size_t k = 1; 2 * k < nx; ++k) {  // Z_k = X_k + iY_k, Z_{n-k} = X̄_k + iȲ_k
      z[2 * k] = x[2 * k] - y[2 * k + 1];
      z[2 * k + 1] = x[2 * k + 1] + y[2 * k];
      z[2 * (nx - k)] = x[2 * k] + y[2 * k + 1];
      z[2 * (nx - k) + 1] = y[2 * k] - x[2 * k + 1];
    }
    for (const std::size_t k : {std::size_t{0}, nx / 2}) {  // the modes that a real row has no imaginary part of
      if (2 * k % nx == 0) {
        z[2 * k] = x[2 * k];
        z[2 * k + 1] = y[2 * k];
      }
    }
    auto* rows = reinterpret_cast<fftw_complex*>(z);
    fftw_execute_dft(pair_inverse.get(), rows, rows);
    for (std::size_t i = 0; i < nx; ++i) {
      first[i] = factor * z[2 * i];
      second[i] = factor * z[2 * i + 1];
    }
  }

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
  if (storage_->transposed) {
    return storage_->transposed->modes();
  }
  return storage_->half * storage_->ny * storage_->nz;
}

std::size_t Fourier::row_length() const {
  return storage_->transposed ? storage_->transposed->mine().modes : storage_->half;
}

const Transposition* Fourier::transposition() const {
  return storage_->transposed ? &*storage_->transposed : nullptr;
}

std::array<std::ptrdiff_t, 3> Fourier::wave(std::size_t mode) const {
  const Storage& s = *storage_;
  const auto signed_index = [](std::size_t k, std::size_t n) {
    return static_cast<std::ptrdiff_t>(k) - (2 * k > n ? static_cast<std::ptrdiff_t>(n) : 0);
  };
  if (s.transposed) {
    const Transposition::Part& part = s.transposed->mine();
    const std::size_t x = part.first_place + mode % part.modes, row = part.first_row + mode / part.modes % part.rows;
    const std::ptrdiff_t across = signed_index(mode / part.modes / part.rows, s.transposed->planes());
    const auto along = static_cast<std::ptrdiff_t>(x);
    return s.transposed->slab().whole().dimensions() == 2
               ? std::array<std::ptrdiff_t, 3>{along, across, 0}
               : std::array<std::ptrdiff_t, 3>{along, signed_index(row, s.ny), across};
  }
  return {static_cast<std::ptrdiff_t>(mode % s.half), signed_index(mode / s.half % s.ny, s.ny),
          signed_index(mode / s.half / s.ny, s.nz)};
}

Fourier::Complex& Fourier::at(int field, std::size_t mode) {
  Storage& s = *storage_;
  if (s.transposed) {
    const Transposition::Part& part = s.transposed->mine();
    const std::size_t row = static_cast<std::size_t>(field) * s.transposed->planes() * part.rows + mode / part.modes;
    return reinterpret_cast<Complex*>(s.across.data())[row * part.width + mode % part.modes];
  }
  if (mode < s.half) {  // without a division
    return reinterpret_cast<Complex*>(
        s.complex.data())[static_cast<std::size_t>(field) * s.ny * s.nz * s.complex_row + mode];
  }
  const std::size_t row = static_cast<std::size_t>(field) * s.ny * s.nz + mode / s.half;
  return reinterpret_cast<Complex*>(s.complex.data())[row * s.complex_row + mode % s.half];
}

const Fourier::Complex& Fourier::at(int field, std::size_t mode) const {
  return const_cast<Fourier*>(this)->at(field, mode);
}

void Fourier::forward(std::span<const double* const> values) {
  Storage& s = *storage_;
  const std::size_t rows = s.ny * s.nz;
  s.for_each_pair(values.size(), [&](std::size_t field, std::size_t row, bool paired, double* room) {
    const double* from = values[field] + s.first_node + row * s.nx;
    const std::size_t place = field * rows + row;
    if (paired) {
      s.forward(from, from + s.nx, place, room);
    } else {
      std::copy_n(from, s.nx, room);
      fftw_execute_dft_r2c(s.row_forward.get(), room, s.spectrum(place * s.complex_row));
    }
  });
  if (s.y_forward) {
    s.transform_columns(s.y_forward.get(), false, values.size());
  }
  if (s.z_forward) {
    s.transform_columns(s.z_forward.get(), true, values.size());
  }
  if (s.transposed) {
    s.transposed->to_columns(values.size(), s.complex.data(), s.across.data());
    s.transform_across(s.across_forward.get(), values.size());
  }
}

void Fourier::inverse(std::span<double* const> values) {
  Storage& s = *storage_;
  if (s.transposed) {
    s.transform_across(s.across_inverse.get(), values.size());
    s.transposed->to_planes(values.size(), s.across.data(), s.complex.data());
  }
  if (s.z_inverse) {
    s.transform_columns(s.z_inverse.get(), true, values.size());
  }
  if (s.y_inverse) {
    s.transform_columns(s.y_inverse.get(), false, values.size());
  }
  const std::size_t rows = s.ny * s.nz;
  const double factor = 1.0 / static_cast<double>(s.nodes);
  s.for_each_pair(values.size(), [&](std::size_t field, std::size_t row, bool paired, double* room) {
    double* to = values[field] + s.first_node + row * s.nx;
    const std::size_t place = field * rows + row;
    if (paired) {
      s.inverse(place, factor, to, to + s.nx, room);
    } else {
      fftw_execute_dft_c2r(s.row_inverse.get(), s.spectrum(place * s.complex_row), room);
      scale(factor, room, s.nx, to);
    }
  });
}

}  // namespace rubato::grids
