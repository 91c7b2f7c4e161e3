#include <rubato/ode/tangent_vectors.hpp>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <random>
#include <stdexcept>

#include <fmt/format.h>

#include <rubato/base/larger.hpp>
#include <rubato/ode/component_units.hpp>
#include <rubato/solve/orthonormal.hpp>

namespace rubato {

namespace {

constexpr double undefined = std::numeric_limits<double>::quiet_NaN();
/// Radians in a step, of the slowest motion that units are found by. Smaller: a first step that a force hardly reaches
/// gets units of a motion that is slower than the rest of the orbit's. Larger: slow motions have exponents that depend
/// on units by its square root over the time.
constexpr double least_turn = 0x1p-10;

double dot(std::span<const double> u, std::span<const double> v) {
  double sum = 0.0;
  for (std::size_t i = 0; i < u.size(); ++i) {
    sum += u[i] * v[i];
  }
  return sum;
}

/// (dp∧dq)(u, v)
double form(std::span<const double> u, std::span<const double> v) {
  const std::size_t half = u.size() / 2;
  return dot(u.subspan(half), v.first(half)) - dot(u.first(half), v.subspan(half));
}

void add(double factor, std::span<const double> v, std::span<double> to) {
  for (std::size_t i = 0; i < to.size(); ++i) {
    to[i] += factor * v[i];
  }
}

}  // namespace

std::vector<double> symplectic_start(std::size_t degrees_of_freedom, std::size_t count) {
  const std::size_t n = degrees_of_freedom, size = 2 * n;
  std::mt19937_64 generator(1);
  const auto draw = [&generator] {  // between -1 and 1, the same with every library
    return static_cast<double>(generator() >> 11) * 0x1p-52 - 1.0;
  };
  // A vector (a, b) stands for a + ib, and J for the product with -i: unitary columns are orthonormal with their Jv.
  std::vector<double> basis(n * size);
  std::vector<double> turned(size);
  const auto column = [&](std::size_t i) { return std::span(basis).subspan(i * size, size); };
  const auto turn = [&](std::span<const double> v) {
    std::copy(v.begin() + static_cast<std::ptrdiff_t>(n), v.end(), turned.begin());
    std::transform(v.begin(), v.begin() + static_cast<std::ptrdiff_t>(n),
                   turned.begin() + static_cast<std::ptrdiff_t>(n), std::negate());
  };
  const std::size_t needed = std::min(n, count);
  for (std::size_t j = 0; j < needed; ++j) {
    const auto v = column(j);
    std::ranges::generate(v, draw);
    for (int pass = 0; pass < 2; ++pass) {
      for (std::size_t i = 0; i < j; ++i) {
        const auto u = column(i);
        turn(u);
        const double along = dot(u, v), across = dot(turned, v);
        add(-along, u, v);
        add(-across, turned, v);
      }
      const double length = std::sqrt(dot(v, v));
      std::ranges::transform(v, v.begin(), [length](double x) { return x / length; });
    }
  }
  std::vector<double> vectors(basis.begin(), basis.begin() + static_cast<std::ptrdiff_t>(needed * size));
  for (std::size_t j = needed; j < count; ++j) {
    turn(column(size - 1 - j));
    vectors.insert(vectors.end(), turned.begin(), turned.end());
  }
  return vectors;
}

double two_form_defect(std::span<const double> before, std::span<const double> after, std::size_t count) {
  if (count < 2) {
    return undefined;
  }
  const std::size_t size = before.size() / count;
  double largest = 0.0;
  for (std::size_t i = 0; i < count; ++i) {
    const auto u = before.subspan(i * size, size), u_after = after.subspan(i * size, size);
    for (std::size_t j = i + 1; j < count; ++j) {
      const auto v = before.subspan(j * size, size), v_after = after.subspan(j * size, size);
      const double unit = std::sqrt(std::max(dot(u, u) * dot(v, v), dot(u_after, u_after) * dot(v_after, v_after)));
      largest = larger(largest, std::abs(form(u_after, v_after) - form(u, v)) / unit);
    }
  }
  return largest;
}

TangentVectors::TangentVectors(std::unique_ptr<OrbitTangent> tangent, std::size_t dimension, std::size_t count,
                               bool with_matrix)
    : tangent_(std::move(tangent)),
      dimension_(dimension),
      count_(count),
      units_(dimension / 2, 1.0),
      logarithms_(count, 0.0) {
  if (count > dimension) {
    throw std::invalid_argument(fmt::format(
        "{} tangent vectors in a phase space of dimension {}: there are no more than that", count, dimension));
  }
  columns_ = symplectic_start(dimension / 2, count);
  if (with_matrix) {
    matrix_.resize(dimension * dimension);
    columns_.resize((count + dimension) * dimension, 0.0);
    for (std::size_t i = 0; i < dimension; ++i) {
      columns_[(count + i) * dimension + i] = 1.0;
    }
    read_matrix();
  }
}

Status TangentVectors::step(std::span<const double> z_0, std::span<const double> z_1, double t_0, double h) {
  const std::size_t size = tangent_->size();
  if (!begun_) {
    if (const Status status = find_units(z_0, z_1, t_0, h); status != Status::success) {
      return fail(status);
    }
    before_ = columns_;
    columns_.assign(columns_.size() / dimension_ * size, 0.0);
    begun_ = true;
    if (const Status status = tangent_->lift(z_0, z_1, t_0, h, before_, columns_); status != Status::success) {
      return fail(status);
    }
    if (columns_ != before_) {
      to_units(columns_, size);
      const bool independent = solve::orthonormalise(std::span(columns_).first(count_ * size), count_, logarithms_);
      to_units(columns_, size, true);
      if (!independent) {
        return fail(Status::singular);
      }
    }
  }
  before_ = columns_;
  if (const Status status = tangent_->step(z_0, z_1, t_0, h, columns_); status != Status::success) {
    return fail(status);
  }
  if (!matrix_.empty()) {
    read_matrix();
  }
  to_units(before_, size);
  to_units(columns_, size);
  const auto vectors = std::span(columns_).first(count_ * size);
  defect_ = two_form_defect(std::span(before_).first(count_ * size), vectors, count_);
  const bool independent = solve::orthonormalise(vectors, count_, logarithms_);
  to_units(columns_, size, true);
  return independent ? Status::success : fail(Status::undefined);
}

Status TangentVectors::find_units(std::span<const double> z_0, std::span<const double> z_1, double t_0, double h) {
  const std::size_t n = dimension_ / 2, size = tangent_->size();
  std::vector<double> identity(dimension_ * dimension_, 0.0), columns(dimension_ * size, 0.0);
  for (std::size_t i = 0; i < dimension_; ++i) {
    identity[i * dimension_ + i] = 1.0;
  }
  Status status = tangent_->lift(z_0, z_1, t_0, h, identity, columns);
  status = status == Status::success ? tangent_->step(z_0, z_1, t_0, h, columns) : status;
  if (status != Status::success) {
    return status;
  }
  // Of a two-step map, too, what comes first in a column is the variation of z.
  const auto entry = [&](std::size_t row, std::size_t column) { return columns[column * size + row]; };
  ComponentUnits units(dimension_);
  units.find(
      [&](const auto& use) {
        for (std::size_t column = 0; column < dimension_; ++column) {
          for (std::size_t row = 0; row < dimension_; ++row) {
            double value = std::abs(entry(row, column));
            if (row == column + n) {
              const double weakest = least_turn * least_turn / std::abs(entry(column, row));
              value = std::isfinite(weakest) ? std::max(value, weakest) : value;
            }
            use(row, column, value);
          }
        }
      },
      1);
  std::copy_n(units.data(), n, units_.begin());
  to_units(columns_, dimension_, true);
  return Status::success;
}

void TangentVectors::to_units(std::span<double> columns, std::size_t size, bool back) const {
  const std::size_t n = units_.size();
  for (std::size_t i = 0; i < size; ++i) {
    // (q, p), and after it of a two-step map the momenta of both.
    const bool inverse = (i / n == 1 || i / n == 2) != back;
    const double factor = inverse ? units_[i % n] : 1.0 / units_[i % n];
    for (std::size_t column = 0; column < count_; ++column) {
      columns[column * size + i] *= factor;
    }
  }
}

Status TangentVectors::fail(Status status) {
  std::ranges::fill(columns_, undefined);
  std::ranges::fill(logarithms_, undefined);
  std::ranges::fill(matrix_, undefined);
  defect_ = undefined;
  return status;
}

void TangentVectors::read_matrix() {
  const std::size_t size = begun_ ? tangent_->size() : dimension_;
  for (std::size_t column = 0; column < dimension_; ++column) {
    for (std::size_t row = 0; row < dimension_; ++row) {
      matrix_[row * dimension_ + column] = columns_[(count_ + column) * size + row];
    }
  }
}

void TangentVectors::save(StateWriter& state) const {
  state.write(begun_ ? 1.0 : 0.0);
  state.write(units_);
  state.write(columns_);
  tangent_->save(state);
}

void TangentVectors::restore(StateReader& state) {
  const bool begun = state.read() != 0.0;
  if (begun != begun_) {
    columns_.resize(columns_.size() / (begun_ ? tangent_->size() : dimension_) *
                    (begun ? tangent_->size() : dimension_));
    begun_ = begun;
  }
  state.read(std::span<double>(units_));
  state.read(std::span<double>(columns_));
  tangent_->restore(state);
  if (!matrix_.empty()) {
    read_matrix();
  }
}

}  // namespace rubato
