#include <rubato/pde/node_derivative.hpp>

#include <algorithm>
#include <stdexcept>

#include <rubato/grids/box_operators.hpp>

namespace rubato {

namespace {

grids::BoxOperator along_axis(int axis, grids::Along along) {
  grids::BoxOperator op{grids::Along::identity, grids::Along::identity, grids::Along::identity};
  op.at(static_cast<std::size_t>(axis)) = along;
  return op;
}

}  // namespace

NodeDerivative::NodeDerivative(const grids::Grid& grid, Collocation collocation) : grid_(grid) {
  if (collocation == Collocation::cells) {
    throw std::invalid_argument("derivatives at nodes are not those of the box");
  }
  if (collocation == Collocation::nodes) {
    spectral_ = std::make_unique<grids::SpectralDerivative>(grid);
  } else {
    scratch_ = grids::FieldSet(1, grid.size());
  }
}

void NodeDerivative::operator()(int axis, const double* in, double* out) {
  if (spectral_ != nullptr) {
    (*spectral_)(axis, in, out);
    return;
  }
  double* const to = in == out ? scratch_.field(0).data() : out;  // an array that nothing is written to takes no memory
  grids::apply_adjoint(grid_, along_axis(axis, grids::Along::difference), in, to);
  std::transform(to, to + grid_.size(), out, [](double value) { return -value; });  // (δ⁺)ᵀ = -δ⁻
}

void NodeDerivative::operator()(int axis, std::span<const double* const> in, std::span<double* const> out) {
  if (spectral_ != nullptr) {
    (*spectral_)(axis, in, out);
    return;
  }
  for (std::size_t f = 0; f < in.size(); ++f) {
    (*this)(axis, in[f], out[f]);
  }
}

void NodeDerivative::next(int axis, const double* in, double* out) const {
  grids::apply(grid_, along_axis(axis, grids::Along::next), in, out);
}

}  // namespace rubato
