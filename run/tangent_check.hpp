#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include <rubato/problem/stored.hpp>
#include <rubato/run/disagreements.hpp>
#include <rubato/run/tangent_writer.hpp>

namespace rubato {

/// What a record shows under /tangents, made anew from its levels, where all of them have a state and a row: each
/// step's tangent acts on what those before it have left.
class TangentCheck {
public:
  /// \throws figures::Mismatch for a dataset that is not there, or of another size
  TangentCheck(const record::Reader& reader, const StoredLevels& levels, const Problem& problem,
               Disagreements& findings);

  /// In the order of the levels.
  ///@{
  void begin();
  void check_step(std::size_t state_row, std::span<const double> before, std::span<const double> z);
  ///@}

private:
  void compare(std::size_t dataset, std::size_t row, std::span<const double> found, const char* reason);

  const StoredLevels& levels_;
  Disagreements& findings_;
  std::optional<std::size_t> clock_;  ///< Problem::clock()
  std::unique_ptr<TangentWriter> writer_;
  record::Layout layout_;
  std::vector<figures::StoredRows> columns_;
  double stretch_ = 1.0;  ///< the largest growth of a vector in a step so far
};

}  // namespace rubato
