#include <rubato/grids/box_operators.hpp>

#include <algorithm>
#include <stdexcept>

#include <fmt/core.h>
#include <rubato/base/compensated_sum.hpp>
#include <rubato/base/wide_vectors.hpp>
#include <rubato/grids/parallel.hpp>

namespace rubato::grids {
namespace {

constexpr std::size_t piece = 4096;  ///< of a row, handed to one thread

/// The rows (y, z corners) that enter a row of the result, with their signs.
struct Rows {
  int count = 0;
  std::array<const double*, 4> start{};
  std::array<double, 4> sign{};
};

/// out[i] = scale Σ_r sign_r (first · row_r[i] + second · row_r[i + 1]), i in [begin, end), where no i + 1 is cyclic.
/// `single` leaves out the second term.
template <int Count>
[[gnu::always_inline]] inline void combine(const Rows& rows, bool single, double first, double second, double scale,
                                           std::size_t begin, std::size_t end, double* out) {
  std::array<const double*, Count> p;
  std::array<double, Count> a;
  std::array<double, Count> b;
  for (int r = 0; r < Count; ++r) {
    p[r] = rows.start[r];
    a[r] = rows.sign[r] * first;
    b[r] = rows.sign[r] * second;
  }
  if (single) {
#pragma GCC ivdep
    for (std::size_t i = begin; i < end; ++i) {
      double sum = a[0] * p[0][i];
      for (int r = 1; r < Count; ++r) {
        sum += a[r] * p[r][i];
      }
      out[i] = scale * sum;
    }
  } else {
#pragma GCC ivdep
    for (std::size_t i = begin; i < end; ++i) {
      double sum = a[0] * p[0][i] + b[0] * p[0][i + 1];
      for (int r = 1; r < Count; ++r) {
        sum += a[r] * p[r][i] + b[r] * p[r][i + 1];
      }
      out[i] = scale * sum;
    }
  }
}

RUBATO_WIDE_VECTORS void combine(const Rows& rows, bool single, double first, double second, double scale,
                                 std::size_t begin, std::size_t end, double* out) {
  switch (rows.count) {
    case 1: return combine<1>(rows, single, first, second, scale, begin, end, out);
    case 2: return combine<2>(rows, single, first, second, scale, begin, end, out);
    default: return combine<4>(rows, single, first, second, scale, begin, end, out);
  }
}

void run(const Grid& grid, const BoxOperator& op, bool adjoint, const double* in, double* out) {
  const std::size_t nx = grid.cells(0);
  const std::size_t ny = grid.cells(1);
  const std::size_t rows_total = grid.size() / nx;
  double scale = 1.0;
  for (int a = 0; a < 3; ++a) {
    if (op[a] != Along::identity && a >= grid.dimensions()) {
      throw std::invalid_argument(
          fmt::format("a box operator acts along axis {} of a grid with {} axes", a + 1, grid.dimensions()));
    }
    scale *= op[a] == Along::average ? 0.5 : op[a] == Along::difference ? 1.0 / grid.spacing(a) : 1.0;
  }
  // The adjoint has the same two points mirrored: the neighbour is the one before, and takes the sign +.
  const auto sign_of_neighbour = [](Along) { return 1.0; };
  const auto sign_of_own = [](Along kind) {
    return kind == Along::difference ? -1.0 : kind == Along::next ? 0.0 : 1.0;
  };
  const auto neighbour = [&](std::size_t i, std::size_t n) {
    return adjoint ? (i == 0 ? n - 1 : i - 1) : (i + 1 == n ? 0 : i + 1);
  };
  const bool single = op[0] == Along::identity;
  const double own = sign_of_own(op[0]);
  const double other = sign_of_neighbour(op[0]);
  const std::size_t pieces = (nx + piece - 1) / piece;
  // Enough work for a thread: about a piece's worth of points.
  const std::size_t together = std::max<std::size_t>(1, piece / nx);

  for_each_block(rows_total * pieces, together, [&](std::size_t unit_begin, std::size_t unit_end) {
    for (std::size_t unit = unit_begin; unit < unit_end; ++unit) {
      const std::size_t row = unit / pieces;
      const std::size_t begin = unit % pieces * piece;
      const std::size_t end = std::min(nx, begin + piece);
      const std::size_t j = row % ny;
      const std::size_t k = row / ny;
      Rows rows;
      for (int ck = 0; ck < (op[2] == Along::identity ? 1 : 2); ++ck) {
        for (int cj = 0; cj < (op[1] == Along::identity ? 1 : 2); ++cj) {
          const std::size_t jj = cj == 0 ? j : neighbour(j, ny);
          const std::size_t kk = ck == 0 ? k : neighbour(k, grid.cells(2));
          rows.start[rows.count] = in + (kk * ny + jj) * nx;
          rows.sign[rows.count] = (cj == 0 ? sign_of_own(op[1]) : sign_of_neighbour(op[1])) *
                                  (ck == 0 ? sign_of_own(op[2]) : sign_of_neighbour(op[2]));
          ++rows.count;
        }
      }
      double* to = out + row * nx;
      const auto seam = [&](std::size_t i) {  // the one point whose neighbour lies across the seam
        double sum = 0.0;
        for (int r = 0; r < rows.count; ++r) {
          const double* p = rows.start[r];
          sum += rows.sign[r] * own * p[i] + rows.sign[r] * other * p[neighbour(i, nx)];
        }
        to[i] = scale * sum;
      };
      if (single) {
        combine(rows, true, 1.0, 0.0, scale, begin, end, to);
      } else if (adjoint) {
        if (begin == 0) {
          seam(0);
        }
        const std::size_t from = std::max<std::size_t>(begin, 1);
        Rows before = rows;
        for (int r = 0; r < rows.count; ++r) {
          before.start[r] = rows.start[r] - 1 + from;
        }
        combine(before, false, other, own, scale, 0, end - from, to + from);
      } else {
        const std::size_t inner = end == nx ? nx - 1 : end;
        combine(rows, false, own, other, scale, begin, inner, to);
        if (end == nx) {
          seam(nx - 1);
        }
      }
    }
  });
}

}  // namespace

double coordinate(const Axis& axis, std::size_t cell, Along along) {
  return along == Along::next ? axis.upper(cell) : along == Along::average ? axis.centre(cell) : axis.node(cell);
}

void apply(const Grid& grid, const BoxOperator& op, const double* in, double* out) {
  run(grid, op, false, in, out);
}

void apply_adjoint(const Grid& grid, const BoxOperator& op, const double* in, double* out) {
  run(grid, op, true, in, out);
}

void invert_average(const Grid& grid, int axis, const double* in, double* out) {
  const std::size_t n = grid.cells(axis);
  if (axis < 0 || axis >= grid.dimensions()) {
    throw std::invalid_argument(
        fmt::format("the inverse average acts along axis {} of a grid with {} axes", axis + 1, grid.dimensions()));
  }
  if (n % 2 == 0) {
    throw std::invalid_argument(fmt::format(
        "axis {}: the average over neighbours has no inverse for {} cells, an even number, because it maps (-1)^i to "
        "zero; take {}",
        grid.axis(axis).name, n, n + 1));
  }
  const std::size_t stride = grid.stride(axis);
  for_each_block(grid.size() / n, 8, [&](std::size_t begin, std::size_t end) {
    for (std::size_t line = begin; line < end; ++line) {
      const std::size_t start = line / stride * stride * n + line % stride;
      CompensatedSum sum;  // (-1)^i w_i
      double sign = 1.0;
      for (std::size_t i = 0; i < n; ++i, sign = -sign) {
        sum.add(sign * in[start + i * stride]);
      }
      sign = 1.0;
      for (std::size_t i = 0; i < n; ++i, sign = -sign) {
        const double b = in[start + i * stride];
        out[start + i * stride] = sign * sum.value();
        sum.add(-2.0 * sign * b);
      }
    }
  });
}

}  // namespace rubato::grids
