#include <rubato/grids/arrays.hpp>

#include <rubato/base/wide_vectors.hpp>
#include <rubato/grids/parallel.hpp>

namespace rubato::grids {

namespace {

RUBATO_WIDE_VECTORS void add_block(double factor, const double* x, std::size_t count, double* out) {
#pragma GCC ivdep
  for (std::size_t i = 0; i < count; ++i) {
    out[i] += factor * x[i];
  }
}

RUBATO_WIDE_VECTORS void combine_block(double factor, const double* x, double ratio, const double* y, std::size_t count,
                                       double* out) {
#pragma GCC ivdep
  for (std::size_t i = 0; i < count; ++i) {
    out[i] = factor * (x[i] + ratio * y[i]);
  }
}

RUBATO_WIDE_VECTORS void difference_quotient_block(const double* x, const double* y, double h, std::size_t count,
                                                   double* out) {
#pragma GCC ivdep
  for (std::size_t i = 0; i < count; ++i) {
    out[i] = (x[i] - y[i]) / h;
  }
}

}  // namespace

void add(double factor, std::span<const double> x, std::span<double> out) {
  for_each_block(out.size(), nodes_per_block, [&](std::size_t begin, std::size_t end) {
    add_block(factor, x.data() + begin, end - begin, out.data() + begin);
  });
}

void combine(double factor, std::span<const double> x, double ratio, std::span<const double> y, std::span<double> out) {
  for_each_block(out.size(), nodes_per_block, [&](std::size_t begin, std::size_t end) {
    combine_block(factor, x.data() + begin, ratio, y.data() + begin, end - begin, out.data() + begin);
  });
}

void difference_quotient(std::span<const double> x, std::span<const double> y, double h, std::span<double> out) {
  for_each_block(out.size(), nodes_per_block, [&](std::size_t begin, std::size_t end) {
    difference_quotient_block(x.data() + begin, y.data() + begin, h, end - begin, out.data() + begin);
  });
}

}  // namespace rubato::grids
