#include <rubato/solve/orthonormal.hpp>

#include <cmath>
#include <numeric>

namespace rubato::solve {

namespace {

double dot(std::span<const double> u, std::span<const double> v) {
  return std::inner_product(u.begin(), u.end(), v.begin(), 0.0);
}

}  // namespace

bool orthonormalise(std::span<double> columns, std::size_t count, std::span<double> logarithms) {
  const std::size_t size = count == 0 ? 0 : columns.size() / count;
  bool all = true;
  for (std::size_t j = 0; j < count; ++j) {
    const auto v = columns.subspan(j * size, size);
    double length = std::sqrt(dot(v, v)), logarithm = std::log(length);
    for (double& x : v) {
      x /= length;
    }
    for (int pass = 0; pass < 2 && j > 0; ++pass) {
      for (std::size_t i = 0; i < j; ++i) {
        const auto u = columns.subspan(i * size, size);
        const double along = -dot(u, v);
        for (std::size_t k = 0; k < size; ++k) {
          v[k] += along * u[k];
        }
      }
      length = std::sqrt(dot(v, v));
      logarithm += std::log(length);
      for (double& x : v) {
        x /= length;
      }
    }
    logarithms[j] = logarithm;
    all = all && std::isfinite(logarithm);
  }
  return all;
}

}  // namespace rubato::solve
