#include <algorithm>
#include <cassert>
#include <cmath>
#include <stdexcept>

#include <fmt/format.h>

#include <rubato/formula/taylor.hpp>

namespace rubato::formula {

namespace {

const Bytecode& checked_field(const Bytecode& field) {
  if (field.input_count() != field.output_count())
    throw std::invalid_argument(
        fmt::format("the field of a flow must have as many components as variables, not {} and {}",
                    field.output_count(), field.input_count()));
  return field;
}

}  // namespace

TaylorFlow::TaylorFlow(const Bytecode& field, int order, int lanes)
    : order_(order),
      lanes_(static_cast<std::size_t>(std::max(lanes, 1))),
      field_(checked_field(field), std::max(order - 1, std::min(order, 0)), lanes),
      coefficients_(field.input_count() * (static_cast<std::size_t>(order) + 1) * lanes_) {}

Status TaylorFlow::operator()(std::span<const double* const> initial) {
  assert(initial.size() == lanes_);
  const std::size_t dimension = field_.input_count();
  const auto stride = (static_cast<std::size_t>(order_) + 1) * lanes_;
  for (std::size_t m = 0; m < dimension; ++m) {
    for (std::size_t lane = 0; lane < lanes_; ++lane) {
      field_.input(m, 0)[lane] = coefficients_[m * stride + lane] = initial[lane][m];
    }
  }
  field_.restart();
  for (int j = 0; j < order_; ++j) {
    if (const Status status = field_.advance(); status != Status::success) {
      return status;
    }
    for (std::size_t m = 0; m < dimension; ++m) {
      const auto derivative = field_.output(m, j);
      double* const next = coefficients_.data() + m * stride + static_cast<std::size_t>(j + 1) * lanes_;
      for (std::size_t lane = 0; lane < lanes_; ++lane) {
        next[lane] = derivative[lane] / (j + 1);
      }
      if (j + 1 < order_) {
        std::copy_n(next, lanes_, field_.input(m, j + 1).begin());
      }
    }
  }
  return Status::success;
}

void TaylorFlow::evaluate(double t, std::span<double> z, std::size_t lane) const {
  assert(z.size() == dimension() && lane < lanes_);
  for (std::size_t m = 0; m < z.size(); ++m) {
    double value = 0.0;
    for (int j = order_; j >= 0; --j) {
      value = value * t + coefficient(m, j, lane);
    }
    z[m] = value;
  }
}

}  // namespace rubato::formula
