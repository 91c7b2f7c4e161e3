#pragma once

#include <cstddef>

/// \file
/// What a step does to a state of two parts, high + low, number by number, beside evaluating H. In vectors, and the
/// same bit by bit for every width of them; none of the arrays of n numbers overlaps another unless it is the same.

namespace rubato {

/// δ += factor gradient, and the point (high + (low + δ)).
void move_state(std::size_t n, double factor, const double* gradient, const double* high, const double* low,
                double* delta, double* point);
/// high + low + δ as high + low: high + δ = sum + error exactly (Knuth), the error added to the low part, and what the
/// low part can give moved up.
void add_to_state(std::size_t n, const double* delta, double* high, double* low);
/// The same of factor gradient in place of δ, from one state to another, or to itself.
void displace_state(std::size_t n, double factor, const double* gradient, const double* high, const double* low,
                    double* to_high, double* to_low);
/// Whether all numbers are finite.
[[nodiscard]] bool all_finite(std::size_t n, const double* numbers);

}  // namespace rubato
