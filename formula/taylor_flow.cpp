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

TaylorFlow::TaylorFlow(const Bytecode& field, int order)
    : order_(order),
      dimension_(field.input_count()),
      field_(checked_field(field), std::max(order - 1, std::min(order, 0))),
      coefficients_(dimension_ * (static_cast<std::size_t>(order) + 1)) {}

Status TaylorFlow::operator()(std::span<const double> initial) {
  assert(initial.size() == dimension_);
  const auto stride = static_cast<std::size_t>(order_) + 1;
  const auto set = [&](std::size_t m, int j, double value) {
    coefficients_[m * stride + static_cast<std::size_t>(j)] = value;
    if (j <= field_.order())
      field_.input(m, j)[0] = value;
  };
  for (std::size_t m = 0; m < dimension_; ++m)
    set(m, 0, initial[m]);
  field_.restart();
  for (int j = 0; j < order_; ++j) {
    if (const Status status = field_.advance(); status != Status::success)
      return status;
    for (std::size_t m = 0; m < dimension_; ++m)
      set(m, j + 1, field_.output(m, j)[0] / (j + 1));
  }
  return Status::success;
}

void TaylorFlow::evaluate(double s, std::span<double> z) const {
  assert(z.size() == dimension_);
  for (std::size_t m = 0; m < dimension_; ++m) {
    const auto c = coefficients(m);
    double value = 0.0;
    for (std::size_t j = c.size(); j-- > 0;)
      value = value * s + c[j];
    z[m] = value;
  }
}

template <typename Grading>
BasicTaylorFlowFamily<Grading>::BasicTaylorFlowFamily(const Bytecode& field, int order)
    : order_(order),
      dimension_(field.input_count()),
      stride_(Grading::offset(order + 1)),
      field_(checked_field(field), std::max(order - 1, std::min(order, 0))),
      parts_(dimension_ * stride_) {}

template <typename Grading>
void BasicTaylorFlowFamily<Grading>::restart() {
  next_ = 0;
  field_.restart();
}

template <typename Grading>
Status BasicTaylorFlowFamily<Grading>::extend(std::span<const double> coefficient) {
  assert(coefficient.size() == dimension_ && next_ <= order_);
  const int d = next_;
  const bool has_own = d % Grading::stride == 0;  // whether parts of degree d hold a coefficient of t^d
  assert(has_own || std::ranges::all_of(coefficient, [](double x) { return x == 0.0; }));
  for (std::size_t m = 0; m < dimension_; ++m) {
    double* own = parts_.data() + m * stride_ + Grading::offset(d);
    if (has_own)
      own[Grading::size(d) - 1] = coefficient[m];
    if (d < order_)
      std::copy_n(own, Grading::size(d), field_.input(m, d).begin());
  }
  if (d < order_) {
    if (const Status status = field_.advance(); status != Status::success)
      return status;
    for (std::size_t m = 0; m < dimension_; ++m) {
      const auto derivative = field_.output(m, d);
      double* next = parts_.data() + m * stride_ + Grading::offset(d + 1);
      next[Grading::size(d + 1) - 1] = 0.0;
      for (std::size_t i = 0; i < derivative.size(); ++i)
        next[i] = derivative[i] / (d + 1 - Grading::stride * static_cast<int>(i));
    }
  }
  ++next_;
  return Status::success;
}

template class BasicTaylorFlowFamily<Bivariate>;
template class BasicTaylorFlowFamily<EvenBivariate>;

}  // namespace rubato::formula
