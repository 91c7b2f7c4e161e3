#pragma once

#include <cstddef>
#include <span>

namespace rubato::grids {

// Sums of whole arrays of one length, in vectors, by all threads where they are long. Each number is made as it is
// written here: the same bits on every machine and for any number of threads. Arrays are the same one or do not
// overlap.

/// out += factor x.
void add(double factor, std::span<const double> x, std::span<double> out);
/// out = factor (x + ratio y).
void combine(double factor, std::span<const double> x, double ratio, std::span<const double> y, std::span<double> out);
/// out = (x - y)/h.
void difference_quotient(std::span<const double> x, std::span<const double> y, double h, std::span<double> out);

}  // namespace rubato::grids
