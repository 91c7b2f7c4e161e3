#pragma once

#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <rubato/formula/batch.hpp>
#include <rubato/formula/bytecode.hpp>

namespace rubato::formula::testing {

/// Bit for bit, except that one NaN is as good as another.
inline bool same_double(double a, double b) {
  return std::bit_cast<std::uint64_t>(a) == std::bit_cast<std::uint64_t>(b) || (std::isnan(a) && std::isnan(b));
}

/// How many outputs machine code of `compiled` and the interpreter of `interpreted` do not agree on, over all points:
/// by copies and in place.
inline std::size_t disagreements(const Bytecode& compiled, const Bytecode& interpreted,
                                 std::span<const std::vector<double>> points) {
  ScalarEvaluator machine(compiled), reference(interpreted, Engine::interpreter);
  std::vector<double> got(compiled.output_count()), expected(interpreted.output_count());
  std::size_t count = 0;
  for (const std::vector<double>& point : points) {
    got.assign(got.size(), 0.123);
    machine(point, got);
    reference(point, expected);
    const double* const in_place = machine.at(point.data());
    for (std::size_t j = 0; j < expected.size(); ++j) {
      count += same_double(got[j], expected[j]) && same_double(in_place[j], expected[j]) ? 0 : 1;
    }
  }
  return count;
}

/// The same for batches of all points and of some.
inline std::size_t batch_disagreements(const Bytecode& compiled, const Bytecode& interpreted,
                                       std::span<const std::vector<double>> points) {
  BatchEvaluator machine(compiled), reference(interpreted, Engine::interpreter);
  std::size_t count = 0;
  for (const std::size_t size : {std::size_t{1}, std::size_t{5}, std::size_t{7}, std::size_t{16}, points.size()}) {
    const auto columns = [&](std::size_t number) { return std::vector(number, std::vector<double>(size)); };
    const auto pointers = [](auto& of) {
      std::vector<double*> result;
      for (std::vector<double>& column : of) {
        result.push_back(column.data());
      }
      return result;
    };
    std::vector<std::vector<double>> in = columns(compiled.input_count());
    for (std::size_t m = 0; m < in.size(); ++m) {
      for (std::size_t i = 0; i < size; ++i) {
        in[m][i] = points[i % points.size()][m];
      }
    }
    std::vector<const double*> inputs;
    for (const auto& column : in) {
      inputs.push_back(column.data());
    }
    std::vector<std::vector<double>> got = columns(compiled.output_count()), expected = got;
    machine(size, inputs, pointers(got));
    reference(size, inputs, pointers(expected));
    for (std::size_t j = 0; j < got.size(); ++j) {
      for (std::size_t i = 0; i < size; ++i) {
        count += same_double(got[j][i], expected[j][i]) ? 0 : 1;
      }
    }
  }
  return count;
}

}  // namespace rubato::formula::testing
