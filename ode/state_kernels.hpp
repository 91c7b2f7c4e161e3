#pragma once

#include <cstddef>

namespace rubato {

/// What a step does to a state of two parts, high + low, number by number, beside evaluating H. Every instruction set
/// does the same roundings; none of the arrays of n numbers overlaps another unless it is the same.
struct StateKernels {
  /// δ += factor gradient, and the point (high + (low + δ)).
  void (*move)(std::size_t n, double factor, const double* gradient, const double* high, const double* low,
               double* delta, double* point);
  /// high + low + δ as high + low: high + δ = sum + error exactly (Knuth), the error added to the low part, and what
  /// the low part can give moved up.
  void (*add)(std::size_t n, const double* delta, double* high, double* low);
  /// The same of factor gradient in place of δ, from one state to another, or to itself.
  void (*displace)(std::size_t n, double factor, const double* gradient, const double* high, const double* low,
                   double* to_high, double* to_low);
  /// Whether all numbers are finite.
  bool (*finite)(std::size_t n, const double* numbers);
};

/// By the widest instruction set that this machine has (base/lanes.hpp).
[[nodiscard]] const StateKernels& state_kernels();

}  // namespace rubato
