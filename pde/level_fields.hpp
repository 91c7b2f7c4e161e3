#pragma once

#include <vector>

#include <rubato/grids/field_set.hpp>

namespace rubato {

/// z = high + low → z + δ, rounded at ε²|z|. Of fields at midpoints `high` becomes δ/2, the value that they had there.
void add_increment(const grids::FieldSet& delta, const std::vector<bool>& at_midpoints, grids::FieldSet& high,
                   grids::FieldSet& low);

/// The fields of a level: 0 for those that exist at midpoints only, whose value there is no part of it. Both may be the
/// same.
void copy_level(const grids::FieldSet& fields, const std::vector<bool>& at_midpoints, grids::FieldSet& level);

}  // namespace rubato
