#pragma once

#include <cstddef>

/// \file
/// What a step does to a state of two parts, high + low, number by number, beside evaluating H. In vectors, and the
/// same bit by bit for every width of them; none of the arrays of n numbers overlaps another unless it is the same.

namespace rubato {

/// high + low + δ as high + low: high + δ = sum + error exactly (Knuth), the error added to the low part, and what the
/// low part can give moved up.
void add_to_state(std::size_t n, const double* delta, double* high, double* low);
/// The middle of two states, and the bound of its error that a mean of rounded sums has, in units of u: 2(|middle| +
/// |there - here|).
void middle_of_states(std::size_t n, const double* here, const double* there, double* middle, double* errors);

}  // namespace rubato
