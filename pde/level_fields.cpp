#include <rubato/pde/level_fields.hpp>

#include <algorithm>

#include <rubato/base/wide_vectors.hpp>
#include <rubato/grids/parallel.hpp>
#include <rubato/pde/wave_loops.hpp>

namespace rubato {

namespace {

/// z += change, with what rounding has left out of z so far, which `rest_of` becomes.
RUBATO_WIDE_VECTORS void add_changes(const double* change, std::size_t begin, std::size_t end, double* z,
                                     double* rest_of) {
#pragma GCC ivdep
  for (std::size_t n = begin; n < end; ++n) {
    const double rest = rest_of[n] + change[n];
    const double sum = z[n] + rest;
    rest_of[n] = rest - (sum - z[n]);
    z[n] = sum;
  }
}

}  // namespace

void add_increment(const grids::FieldSet& delta, const std::vector<bool>& at_midpoints, grids::FieldSet& high,
                   grids::FieldSet& low) {
  for (int f = 0; f < delta.fields(); ++f) {
    double* z = high.field(f).data();
    double* rest_of = low.field(f).data();
    const double* change = delta.field(f).data();
    const bool midpoint = at_midpoints[static_cast<std::size_t>(f)];
    grids::for_each_block(delta.size(), grids::nodes_per_block, [=](std::size_t begin, std::size_t end) {
      if (midpoint) {
        multiply(0.5, change + begin, end - begin, z + begin);
      } else {
        add_changes(change, begin, end, z, rest_of);
      }
    });
  }
}

void copy_level(const grids::FieldSet& fields, const std::vector<bool>& at_midpoints, grids::FieldSet& level) {
  if (&fields != &level) {
    level.copy_from(fields);
  }
  for (int f = 0; f < level.fields(); ++f) {
    if (at_midpoints[static_cast<std::size_t>(f)]) {
      std::ranges::fill(level.field(f), 0.0);
    }
  }
}

}  // namespace rubato
