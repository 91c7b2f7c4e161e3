#include <rubato/grids/stencil.hpp>

#include <algorithm>
#include <cstddef>

namespace rubato::grids {

namespace {

void change_sign(double* values, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) {
    values[i] = -values[i];
  }
}

}  // namespace

SpaceOperator SpaceOperator::average(int dimensions) {
  SpaceOperator op;
  std::fill_n(op.box.begin(), dimensions, Along::average);
  return op;
}

SpaceOperator SpaceOperator::box_difference(int axis, int dimensions) {
  SpaceOperator op = average(dimensions);
  op.box.at(static_cast<std::size_t>(axis)) = Along::difference;
  return op;
}

SpaceOperator SpaceOperator::forward_difference(int axis) {
  SpaceOperator op;
  op.box.at(static_cast<std::size_t>(axis)) = Along::difference;
  return op;
}

SpaceOperator SpaceOperator::backward_difference(int axis) {
  SpaceOperator op = forward_difference(axis);
  op.mirrored = true;
  return op;
}

SpaceOperator SpaceOperator::next(int axis) {
  SpaceOperator op;
  op.box.at(static_cast<std::size_t>(axis)) = Along::next;
  return op;
}

SpaceOperator SpaceOperator::spectral_derivative(int axis) {
  SpaceOperator op;
  op.spectral_axis = axis;
  return op;
}

SpectralDerivative& Stencil::spectral() {
  if (spectral_ == nullptr) {
    spectral_ = std::make_unique<SpectralDerivative>(grid_);
  }
  return *spectral_;
}

void Stencil::apply(const SpaceOperator& op, const double* in, double* out) {
  if (op.spectral_axis >= 0) {
    spectral()(op.spectral_axis, in, out);
  } else if (op.mirrored) {
    grids::apply_adjoint(grid_, op.box, in, out);
    change_sign(out, grid_.size());
  } else {
    grids::apply(grid_, op.box, in, out);
  }
}

void Stencil::apply_adjoint(const SpaceOperator& op, const double* in, double* out) {
  if (op.spectral_axis >= 0) {
    spectral()(op.spectral_axis, in, out);
  } else if (op.mirrored) {
    grids::apply(grid_, op.box, in, out);
  } else {
    grids::apply_adjoint(grid_, op.box, in, out);
    return;
  }
  change_sign(out, grid_.size());
}

}  // namespace rubato::grids
