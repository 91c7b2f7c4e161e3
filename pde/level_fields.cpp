#include <rubato/pde/level_fields.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <rubato/base/larger.hpp>
#include <rubato/base/wide_vectors.hpp>
#include <rubato/grids/parallel.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/grids/slab.hpp>
#include <rubato/pde/multisymplectic_system.hpp>
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

RUBATO_WIDE_VECTORS IncrementSizes add_twice_in_block(const double* c, double* delta, std::size_t count) {
  constexpr std::size_t lanes = 8;
  double added[lanes] = {};
  double sums[lanes] = {};
  double poison[lanes] = {};  // becomes NaN with the first value that is not finite
  const auto take = [&](std::size_t lane, std::size_t i) {
    const double change = 2.0 * c[i];
    const double sum = delta[i] + change;
    delta[i] = sum;
    added[lane] = std::abs(change) > added[lane] ? std::abs(change) : added[lane];
    sums[lane] = std::abs(sum) > sums[lane] ? std::abs(sum) : sums[lane];
    poison[lane] += 0.0 * sum;
  };
  std::size_t i = 0;
  for (; i + lanes <= count; i += lanes) {
    for (std::size_t l = 0; l < lanes; ++l) {
      take(l, i + l);
    }
  }
  for (std::size_t l = 0; i + l < count; ++l) {
    take(l, i + l);
  }
  IncrementSizes result;
  for (std::size_t l = 0; l < lanes; ++l) {
    result.added = std::max(result.added, added[l]);
    result.sum = std::max(result.sum, sums[l]);
  }
  if (std::ranges::any_of(poison, [](double value) { return value != 0.0; })) {
    result.added = result.sum = std::numeric_limits<double>::quiet_NaN();
  }
  return result;
}

/// δ += 2 c.
IncrementSizes add_twice_here(std::span<const double> c, std::span<double> delta) {
  const grids::ReductionBlocks pieces(c.size());
  std::array<IncrementSizes, grids::ReductionBlocks::most> partial;
  grids::for_each_block(c.size(), pieces.block, [&](std::size_t begin, std::size_t end) {
    partial[begin / pieces.block] = add_twice_in_block(c.data() + begin, delta.data() + begin, end - begin);
  });
  IncrementSizes result;
  for (std::size_t b = 0; b < pieces.blocks; ++b) {
    result.added = larger(result.added, partial[b].added);
    result.sum = larger(result.sum, partial[b].sum);
  }
  return result;
}

}  // namespace

void add_increment(std::span<const double> delta, bool at_midpoints, std::span<double> high, std::span<double> low) {
  grids::for_each_block(delta.size(), grids::nodes_per_block, [=](std::size_t begin, std::size_t end) {
    if (at_midpoints) {
      multiply(0.5, delta.data() + begin, end - begin, high.data() + begin);
    } else {
      add_changes(delta.data(), begin, end, high.data(), low.data());
    }
  });
}

void add_twice(const grids::FieldSet& c, grids::FieldSet& delta, std::span<IncrementSizes> sizes) {
  const grids::Slab* const slab = grids::Slab::of(delta.size());
  std::array<double, 2 * MultisymplecticSystem::most_fields> largest;
  for (std::size_t f = 0; f < sizes.size(); ++f) {
    const auto from = c.field(static_cast<int>(f));
    const auto to = delta.field(static_cast<int>(f));
    if (slab == nullptr) {
      sizes[f] = add_twice_here(from, to);
      continue;
    }
    const std::size_t first = slab->first_node(), owned = slab->owned(), end = first + owned;
    add_twice_here(from.first(first), to.first(first));
    add_twice_here(from.subspan(end), to.subspan(end));
    const IncrementSizes here = add_twice_here(from.subspan(first, owned), to.subspan(first, owned));
    largest[2 * f] = here.added;
    largest[2 * f + 1] = here.sum;
  }
  if (slab != nullptr) {
    slab->reduce({}, {}, std::span(largest).first(2 * sizes.size()));
    for (std::size_t f = 0; f < sizes.size(); ++f) {
      sizes[f] = {largest[2 * f], largest[2 * f + 1]};
    }
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
