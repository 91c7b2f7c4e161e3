#pragma once

#include <vector>

#include <rubato/grids/field_set.hpp>

namespace rubato {

/// z = high + low → z + δ, rounded at ε²|z|. Of fields at midpoints `high` becomes δ/2, the value that they had there.
void add_increment(const grids::FieldSet& delta, const std::vector<bool>& at_midpoints, grids::FieldSet& high,
                   grids::FieldSet& low);

}  // namespace rubato
