#include <rubato/record/error.hpp>

#include <algorithm>
#include <cmath>

#include <rubato/base/all_finite.hpp>

namespace rubato::record {

void require_finite(const Dataset& dataset, std::span<const double> values, std::size_t row_size, std::size_t before) {
  if (dataset.may_be_undefined || all_finite(values))
    return;
  const auto wrong = std::ranges::find_if_not(values, [](double value) { return std::isfinite(value); });
  const std::size_t place = before + static_cast<std::size_t>(wrong - values.begin());
  throw NotFinite(dataset, place / row_size, place % row_size, *wrong);
}

}  // namespace rubato::record
