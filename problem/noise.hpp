#pragma once

#include <cstdint>
#include <span>

#include <rubato/formula/expression.hpp>
#include <rubato/problem/problem.hpp>

namespace rubato {

/// A random function of the coordinates of a periodic grid, noise(seed, waves): the sum of all waves with up to `waves`
/// periods along each axis, but for the constant, with normal random amplitudes of equal deviation, so that its values
/// have mean 0 and deviation 1. Every wave has its own random numbers: the function is the same however many cells the
/// grid has.
/// \throws std::invalid_argument unless waves >= 1 and there are at most 5000 of them
[[nodiscard]] formula::Expression random_waves(formula::Graph& graph, std::span<const GridAxis> axes, std::int64_t seed,
                                               std::int64_t waves);

}  // namespace rubato
