#pragma once

#include <span>
#include <vector>

#include <rubato/grids/field_set.hpp>

namespace rubato {

/// z = high + low → z + δ of a field, rounded at ε²|z|. Of one at midpoints `high` becomes δ/2, the value that it had
/// there.
void add_increment(std::span<const double> delta, bool at_midpoints, std::span<double> high, std::span<double> low);

/// Largest absolute values, NaN if one is not finite.
struct IncrementSizes {
  double added = 0.0;
  double sum = 0.0;
};
/// δ += 2 c, of all ranks that share the fields, all of which have come to the same numbers in ghosts. \param sizes
/// receives those of 2 c and of δ then, of each field
void add_twice(const grids::FieldSet& c, grids::FieldSet& delta, std::span<IncrementSizes> sizes);

/// The fields of a level: 0 for those that exist at midpoints only, whose value there is no part of it. Both may be the
/// same.
void copy_level(const grids::FieldSet& fields, const std::vector<bool>& at_midpoints, grids::FieldSet& level);

}  // namespace rubato
