#include <rubato/ode/splitting_tangent.hpp>

#include <rubato/base/all_finite.hpp>

namespace rubato {

SplittingTangent::Half::Half(const SplittingHalf& half) {
  std::vector<formula::Expression> formulas(half.outputs.begin() + 1, half.outputs.end());
  for (const formula::HessianEntry& entry : formula::hessian_entries(half.outputs.front(), half.variables)) {
    formulas.push_back(entry.value);
    places.emplace_back(entry.row, entry.column);
  }
  evaluate = formula::ScalarEvaluator(formula::Bytecode(formulas, half.variables));
  outputs.resize(formulas.size());
}

SplittingTangent::SplittingTangent(const SplittingHalf& T, const SplittingHalf& V, const Composition& composition)
    : composition_(composition), n_(T.variables.size()), halves_{Half(V), Half(T)} {}

Status SplittingTangent::operator()(std::span<const double> z, double h, std::span<double> columns) {
  z_.assign(z.begin(), z.end());
  for (const Composition::Part& part : composition_.parts) {
    Half& half = halves_[part.drift ? 1 : 0];
    const std::size_t by = part.drift ? n_ : 0, moved = n_ - by;
    const double length = (part.drift ? part.length : -part.length) * h;
    half.evaluate(std::span<const double>(z_).subspan(by, n_), half.outputs);
    for (std::size_t k = 0; k < half.places.size(); ++k) {
      const auto [row, column] = half.places[k];
      const double rate = length * half.outputs[n_ + k];
      for (std::size_t first = 0; first < columns.size(); first += 2 * n_) {
        columns[first + moved + row] += rate * columns[first + by + column];
        if (row != column) {
          columns[first + moved + column] += rate * columns[first + by + row];
        }
      }
    }
    for (std::size_t i = 0; i < n_; ++i) {
      z_[moved + i] += length * half.outputs[i];
    }
  }
  return all_finite(columns) ? Status::success : Status::undefined;
}

}  // namespace rubato
