#include <rubato/ode/splitting_tangent.hpp>

#include <rubato/base/all_finite.hpp>

namespace rubato {

SplittingHalfTangent::SplittingHalfTangent(const SplittingHalf& half) {
  std::vector<formula::Expression> formulas(half.outputs.begin() + 1, half.outputs.end());
  for (const formula::HessianEntry& entry : formula::hessian_entries(half.outputs.front(), half.variables)) {
    formulas.push_back(entry.value);
    places_.emplace_back(entry.row, entry.column);
  }
  evaluate_ = formula::ScalarEvaluator(formula::Bytecode(formulas, half.variables));
  outputs_.resize(formulas.size());
}

void SplittingHalfTangent::shear(double length, const double* by, double* moved) const {
  const double* entry = outputs_.data() + gradient().size();
  for (const auto& [row, column] : places_) {
    const double rate = length * *entry++;
    moved[row] += rate * by[column];
    if (row != column) {
      moved[column] += rate * by[row];
    }
  }
}

SplittingTangent::SplittingTangent(const SplittingHalf& T, const SplittingHalf& V, const Composition& composition)
    : composition_(composition), n_(T.variables.size()), halves_{SplittingHalfTangent(V), SplittingHalfTangent(T)} {}

Status SplittingTangent::operator()(std::span<const double> z, double h, std::span<double> columns) {
  z_.assign(z.begin(), z.end());
  for (const Composition::Part& part : composition_.parts) {
    SplittingHalfTangent& half = halves_[part.drift ? 1 : 0];
    const std::size_t by = part.drift ? n_ : 0, moved = n_ - by;
    const double length = (part.drift ? part.length : -part.length) * h;
    half.evaluate(std::span<const double>(z_).subspan(by, n_));
    for (std::size_t first = 0; first < columns.size(); first += 2 * n_) {
      half.shear(length, &columns[first + by], &columns[first + moved]);
    }
    for (std::size_t i = 0; i < n_; ++i) {
      z_[moved + i] += length * half.gradient()[i];
    }
  }
  return all_finite(columns) ? Status::success : Status::undefined;
}

}  // namespace rubato
