#include <rubato/pde/space_collocation.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <cstdlib>
#include <numbers>
#include <stdexcept>
#include <string>

#include <fmt/format.h>
#include <Eigen/Core>

#include <rubato/grids/whole.hpp>
#include <rubato/pde/wave_loops.hpp>
#include <rubato/solve/small_matrices.hpp>
#include <rubato/variation/gauss_tableau.hpp>

namespace rubato {

namespace {

/// sin and cos of kΔx/2 = πw/n; near π/2 by the complement, so that neither loses digits.
struct HalfAngle {
  double sin, cos;
  HalfAngle(std::ptrdiff_t w, std::size_t n) {
    const double size = static_cast<double>(std::abs(w)), cells = static_cast<double>(n);
    const bool steep = 4.0 * size > cells;
    const double angle = std::numbers::pi / (2.0 * cells) * (steep ? cells - 2.0 * size : 2.0 * size);
    sin = steep ? std::cos(angle) : std::sin(angle);
    cos = steep ? std::sin(angle) : std::cos(angle);
    sin = w < 0 ? -sin : sin;
  }
};

/// y with arg R(iy) = 2πr w/n: for eigenvalues λ of A⁻¹ arg R(iy) = 2 Σ arg(λ/(λ - iy)), and what it lacks of rπ is
/// 2 Σ arg(y + iλ), which keeps its digits where the other loses them. Newton's method within bounds.
double phase_inverse(const std::vector<std::complex<double>>& lambda, std::size_t w, std::size_t n) {
  if (w == 0) {
    return 0.0;
  }
  const double part = std::numbers::pi * static_cast<double>(lambda.size()) / static_cast<double>(n);
  const bool steep = 4 * w > n;
  const double wanted = part * static_cast<double>(steep ? n - 2 * w : 2 * w);
  double low = 0.0, high = std::numeric_limits<double>::infinity();
  double y = std::numbers::pi * 2.0 * static_cast<double>(w * lambda.size()) / static_cast<double>(n);
  for (int iteration = 0; iteration < 200; ++iteration) {
    double value = 0.0, slope = 0.0;
    for (const std::complex<double>& l : lambda) {
      const double a = l.real(), b = l.imag();
      value += 2.0 * (steep ? std::atan2(a, y - b) : std::atan2(y * a, a * a + b * b - y * b));
      slope += 2.0 * a / ((y - b) * (y - b) + a * a);
    }
    const double excess = steep ? wanted - value : value - wanted;  // rises with y
    (excess > 0.0 ? high : low) = y;
    double next = y - excess / slope;
    if (!(next > low && next < high)) {
      next = std::isfinite(high) ? 0.5 * (low + high) : 2.0 * y;
    }
    const bool done = std::abs(next - y) <= 1e-16 * y || (iteration > 3 && std::abs(next - y) <= 4e-16 * y);
    y = next;
    if (done) {
      break;
    }
  }
  return y;
}

void multiply_rows(const WaveRows& factor, WaveRows& rows) {
  for_each_wave_block(rows.waves(), [&](std::size_t begin, std::size_t end) {
    for (int f = 0; f < rows.rows(); ++f) {
      multiply(factor.re.field(0).data() + begin, factor.im.field(0).data() + begin, end - begin,
               rows.re.pointers()[static_cast<std::size_t>(f)] + begin,
               rows.im.pointers()[static_cast<std::size_t>(f)] + begin);
    }
  });
}

/// The elements of a line as a grid of its own; of a grid that has none the grid itself.
grids::Grid element_grid(const grids::Grid& grid, int stages) {
  if (stages <= 1) {
    return grid;
  }
  grids::Axis axis = grid.axis(0);
  axis.cells /= static_cast<std::size_t>(stages);
  return grids::Grid({axis});
}

}  // namespace

std::string_view space_rule_objection(SpaceRule rule, std::size_t cells) {
  const auto stages = static_cast<std::size_t>(rule.stages);
  return rule.spectral()   ? ""
         : stages % 2 == 0 ? "with an even number of stages the points of all elements together see a wave that "
                             "alternates from one to the next, whose value at the faces nothing determines"
         : cells % 2 == 0  ? "averaging annihilates the sawtooth of an even one, which then is undetermined or frozen"
         : cells % stages != 0 ? "so many cells make an element"
                               : "";
}

SpaceCollocation::SpaceCollocation(const grids::Grid& grid, SpaceRule rule) : rule_(rule) {
  const grids::Grid& whole = grids::whole_of(grid);
  for (int a = 0; a < grid.dimensions(); ++a) {
    if (const std::string_view objection = space_rule_objection(rule, whole.cells(a)); !objection.empty()) {
      throw std::invalid_argument(
          fmt::format("{} = {} cells, and collocation with {} stage(s) in space cannot take them: {}",
                      whole.axis(a).name, whole.cells(a), rule.stages, objection));
    }
  }
  if (rule.stages > 1 && grid.dimensions() > 1) {
    throw std::invalid_argument("collocation with several stages in space is made for one dimension");
  }
  const grids::Fourier fourier(grid, 1);
  const std::size_t waves = fourier.modes();
  derivatives_.assign(static_cast<std::size_t>(grid.dimensions()), std::vector<double>(waves));
  if (!spectral()) {
    factor_ = WaveRows(1, waves);
    inverse_ = WaveRows(1, waves);
  }
  if (rule.stages > 1) {
    add_elements(grid);
    return;
  }
  for (std::size_t w = 0; w < waves; ++w) {
    const auto wave = fourier.wave(w);
    std::complex<double> factor = 1.0, inverse = 1.0;
    for (int a = 0; a < grid.dimensions(); ++a) {
      const auto axis = static_cast<std::size_t>(a);
      if (spectral()) {
        derivatives_[axis][w] = grids::derivative_symbol(wave[axis], whole.axis(a)).imag();
        continue;
      }
      const HalfAngle half(wave[axis], whole.cells(a));
      derivatives_[axis][w] = 2.0 / whole.spacing(a) * (half.sin / half.cos);
      const std::complex<double> phase(half.cos, half.sin);
      factor *= half.cos * phase;
      inverse *= std::conj(phase) / half.cos;
    }
    if (!spectral()) {
      factor_.re.field(0)[w] = factor.real();
      factor_.im.field(0)[w] = factor.imag();
      inverse_.re.field(0)[w] = inverse.real();
      inverse_.im.field(0)[w] = inverse.imag();
    }
  }
}

void SpaceCollocation::add_elements(const grids::Grid& grid) {
  const GaussTableau tableau(rule_.stages);
  const auto r = static_cast<std::size_t>(rule_.stages);
  const auto lambda = tableau.inverse_eigenvalues();
  const double length = static_cast<double>(r) * grid.spacing(0);
  const Eigen::MatrixXcd A = tableau.a.cast<std::complex<double>>();
  const Eigen::MatrixXcd one = Eigen::MatrixXcd::Identity(tableau.stages, tableau.stages);
  modes_ = WaveRows(rule_.stages, factor_.waves());
  for (std::size_t w = 0; w < factor_.waves(); ++w) {
    const double y = phase_inverse(lambda, w, grid.cells(0));
    derivatives_[0][w] = y / length;
    const Eigen::VectorXcd phi = solve::inverse_of(one - std::complex<double>(0.0, y) * A).matrix.rowwise().sum();
    double square = 0.0;
    for (int i = 0; i < rule_.stages; ++i) {
      square += tableau.b[i] * std::norm(phi[i]);
    }
    const double size = std::sqrt(square);
    for (int i = 0; i < rule_.stages; ++i) {
      modes_.re.field(i)[w] = phi[i].real() / size;
      modes_.im.field(i)[w] = phi[i].imag() / size;
    }
    factor_.re.field(0)[w] = size;
    inverse_.re.field(0)[w] = 1.0 / size;
    factor_.im.field(0)[w] = inverse_.im.field(0)[w] = 0.0;
  }
  for (std::size_t p = 0; p < grid.size(); ++p) {
    weights_.push_back(static_cast<double>(r) * tableau.b[static_cast<Eigen::Index>(p % r)]);
  }
  fractions_.assign(tableau.c.begin(), tableau.c.end());
}

void SpaceCollocation::from_nodes(WaveRows& rows) const {
  if (!spectral()) {
    multiply_rows(factor_, rows);
  }
}

void SpaceCollocation::to_nodes(WaveRows& rows) const {
  if (!spectral()) {
    multiply_rows(inverse_, rows);
  }
}

PlacedCoordinates SpaceCollocation::places(const MultisymplecticSystem& system, const grids::Grid& grid) const {
  if (rule_.stages <= 1) {
    return PlacedCoordinates(system, grid, spectral() ? Within::node : Within::centre);
  }
  std::vector<double> places;
  const std::size_t r = fractions_.size();
  for (std::size_t p = 0; p < grid.size(); ++p) {
    places.push_back(grid.axis(0).node(p - p % r) + fractions_[p % r] * static_cast<double>(r) * grid.spacing(0));
  }
  return PlacedCoordinates(system, places);
}

PointTransform::PointTransform(const SpaceCollocation& space, const grids::Grid& grid, int fields)
    : stages_(std::max(1, space.rule().stages)),
      fourier_(element_grid(grid, space.rule().stages), stages_ > 1 ? stages_ * fields : fields) {
  if (stages_ == 1) {
    return;
  }
  const std::size_t elements = grid.cells(0) / static_cast<std::size_t>(stages_);
  const GaussTableau tableau(stages_);
  b_.assign(tableau.b.begin(), tableau.b.end());
  modes_ = space.modes();
  values_ = grids::FieldSet(stages_ * fields, elements);
  // The waves that are one at the faces: k = m + N s, |2k| < n.
  for (std::size_t m = 0; m < fourier_.modes(); ++m) {
    for (int s = -(stages_ / 2); s <= stages_ / 2; ++s) {
      const auto k = static_cast<std::ptrdiff_t>(m) + s * static_cast<std::ptrdiff_t>(elements);
      branches_.push_back({static_cast<std::size_t>(std::abs(k)), k < 0 ? -1.0 : 1.0});
    }
  }
}

void PointTransform::from_points(std::span<const double* const> fields, WaveRows& rows) {
  if (stages_ == 1) {
    from_grid(fields, fourier_, rows);
    return;
  }
  const auto r = static_cast<std::size_t>(stages_);
  for (std::size_t f = 0; f < fields.size(); ++f) {
    for (std::size_t i = 0; i < r; ++i) {
      const auto to = values_.field(static_cast<int>(f * r + i));
      for (std::size_t e = 0; e < to.size(); ++e) {
        to[e] = fields[f][e * r + i];
      }
    }
  }
  fourier_.forward(std::as_const(values_).pointers().first(fields.size() * r));
  grids::for_each_block(fields.size(), 1, [&](std::size_t first, std::size_t last) {
    for (std::size_t f = first; f < last; ++f) {
      double* re = rows.re.pointers()[f];
      double* im = rows.im.pointers()[f];
      for (std::size_t place = 0; place < branches_.size(); ++place) {
        const auto [wave, sign] = branches_[place];
        double sum_re = 0.0, sum_im = 0.0;
        for (std::size_t i = 0; i < r; ++i) {
          const std::complex<double> value = fourier_.at(static_cast<int>(f * r + i), place / r);
          const double a = value.real(), b = sign * value.imag();
          const double c = modes_.re.field(static_cast<int>(i))[wave], d = modes_.im.field(static_cast<int>(i))[wave];
          const double weight = static_cast<double>(r) * b_[i];
          sum_re += weight * (a * c + b * d);
          sum_im += weight * (b * c - a * d);
        }
        re[wave] = sum_re;
        im[wave] = sum_im;
      }
    }
  });
}

void PointTransform::to_points(const WaveRows& rows, std::span<const int> which, std::span<double* const> fields) {
  if (stages_ == 1) {
    to_grid(rows, which, fourier_, fields);
    return;
  }
  const auto r = static_cast<std::size_t>(stages_);
  grids::for_each_block(which.size(), 1, [&](std::size_t first, std::size_t last) {
    for (std::size_t f = first; f < last; ++f) {
      const auto re = rows.re.field(which[f]), im = rows.im.field(which[f]);
      for (std::size_t i = 0; i < r; ++i) {
        const auto mode_re = std::as_const(modes_).re.field(static_cast<int>(i));
        const auto mode_im = std::as_const(modes_).im.field(static_cast<int>(i));
        for (std::size_t m = 0; m < fourier_.modes(); ++m) {
          double sum_re = 0.0, sum_im = 0.0;
          for (std::size_t s = 0; s < r; ++s) {
            const auto [wave, sign] = branches_[m * r + s];
            sum_re += re[wave] * mode_re[wave] - im[wave] * mode_im[wave];
            sum_im += sign * (re[wave] * mode_im[wave] + im[wave] * mode_re[wave]);
          }
          fourier_.at(static_cast<int>(f * r + i), m) = std::complex<double>(sum_re, sum_im) / static_cast<double>(r);
        }
      }
    }
  });
  fourier_.inverse(values_.pointers().first(which.size() * r));
  for (std::size_t f = 0; f < which.size(); ++f) {
    for (std::size_t i = 0; i < r; ++i) {
      const auto from = std::as_const(values_).field(static_cast<int>(f * r + i));
      for (std::size_t e = 0; e < from.size(); ++e) {
        fields[f][e * r + i] = from[e];
      }
    }
  }
}

ElementOperators::ElementOperators(const grids::Grid& grid, int stages)
    : space_(grid, {.stages = stages}),
      fourier_(grid, 1),
      points_(space_, grid, 1),
      row_(1, fourier_.modes()),
      derived_(row_) {}

void ElementOperators::operator()(const double* nodes, double* mean, double* derivative) {
  constexpr std::array first{0};
  from_grid(std::array{nodes}, fourier_, row_);
  space_.from_nodes(row_);
  if (derivative != nullptr) {
    for (std::size_t w = 0; w < row_.waves(); ++w) {
      const double k = space_.derivatives()[0][w];
      derived_.re.field(0)[w] = -k * row_.im.field(0)[w];
      derived_.im.field(0)[w] = k * row_.re.field(0)[w];
    }
    points_.to_points(derived_, first, std::array{derivative});
  }
  if (mean != nullptr) {
    points_.to_points(row_, first, std::array{mean});
  }
}

void ElementOperators::to_row(const double* points, double* out) {
  constexpr std::array first{0};
  points_.from_points(std::array{points}, row_);
  to_grid(row_, first, fourier_, std::array{out});
}

}  // namespace rubato
