#include <rubato/pde/face_gather.hpp>

#include <array>

namespace rubato {

namespace {

/// The weights of the lower and the upper node.
std::array<double, 2> weights(FaceOperation operation, double inverse_spacing) {
  switch (operation) {
    case FaceOperation::average: return {0.5, 0.5};
    case FaceOperation::difference: return {-inverse_spacing, inverse_spacing};
    case FaceOperation::first: return {1.0, 0.0};
    case FaceOperation::second: return {0.0, 1.0};
  }
  return {};
}

}  // namespace

FaceGather::FaceGather(const grids::Grid& grid) : dimensions_(grid.dimensions()) {
  for (int a = 0; a < 3; ++a) {
    n_[a] = grid.cells(a);
    stride_[a] = a < dimensions_ ? grid.stride(a) : 0;
    inverse_spacing_[a] = a < dimensions_ ? 1.0 / grid.spacing(a) : 0.0;
  }
}

void FaceGather::operator()(const double* field, std::size_t line, std::size_t begin, std::size_t count,
                            const FaceOperation (&operations)[3], double* out) const {
  std::array<double, CellBlocks::most + 1> nodes{};
  const std::size_t lower[2] = {line % n_[1], line / n_[1]};
  const auto y = dimensions_ > 1 ? weights(operations[1], inverse_spacing_[1]) : std::array{1.0, 0.0};
  const auto z = dimensions_ > 2 ? weights(operations[2], inverse_spacing_[2]) : std::array{1.0, 0.0};
  const std::size_t last = begin + count == n_[0] ? count : count + 1;
  for (std::size_t dz = 0; dz < 2; ++dz) {
    for (std::size_t dy = 0; dy < 2; ++dy) {
      const double weight = y[dy] * z[dz];
      if (weight == 0.0) {
        continue;
      }
      const double* row = field + (lower[0] + dy) % n_[1] * stride_[1] + (lower[1] + dz) % n_[2] * stride_[2];
      for (std::size_t i = 0; i < last; ++i) {
        nodes[i] += weight * row[begin + i];
      }
      if (last == count) {
        nodes[count] += weight * row[0];
      }
    }
  }
  switch (operations[0]) {
    case FaceOperation::average:
      for (std::size_t i = 0; i < count; ++i) {
        out[i] = 0.5 * (nodes[i] + nodes[i + 1]);
      }
      return;
    case FaceOperation::difference:
      for (std::size_t i = 0; i < count; ++i) {
        out[i] = (nodes[i + 1] - nodes[i]) * inverse_spacing_[0];
      }
      return;
    case FaceOperation::first:
    case FaceOperation::second:
      for (std::size_t i = 0; i < count; ++i) {
        out[i] = nodes[i + (operations[0] == FaceOperation::second ? 1 : 0)];
      }
      return;
  }
}

}  // namespace rubato
