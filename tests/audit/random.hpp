#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <initializer_list>
#include <random>

#include <fmt/format.h>

namespace audit {

/// Random choices that are the same on every machine (the distributions of the standard library are not).
class Random {
public:
  explicit Random(std::uint64_t seed) : engine_(seed * 0x9e3779b97f4a7c15U + 1) {}

  double unit() { return static_cast<double>(engine_() >> 11) * 0x1p-53; }
  bool chance(double probability) { return unit() < probability; }
  std::size_t below(std::size_t count) { return static_cast<std::size_t>(engine_() % count); }
  int sign() { return chance(0.5) ? 1 : -1; }
  /// A number of four digits, as people write them.
  double between(double low, double high) { return short_number(low + (high - low) * unit()); }
  /// 10^between(low, high), the same
  double decades(double low, double high) { return short_number(std::pow(10.0, low + (high - low) * unit())); }
  template <typename T>
  T one_of(std::initializer_list<T> values) {
    return values.begin()[below(values.size())];
  }

  static double short_number(double value) { return std::strtod(fmt::format("{:.4g}", value).c_str(), nullptr); }

private:
  std::mt19937_64 engine_;
};

}  // namespace audit
