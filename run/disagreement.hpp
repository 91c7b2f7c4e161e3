#pragma once

#include <cstddef>
#include <limits>
#include <optional>
#include <string>

namespace rubato {

/// A number of a record that is not what the rest of the record makes of it.
struct Disagreement {
  std::string dataset;
  std::optional<std::size_t> row = std::nullopt;    ///< absent where only the whole dataset is known to differ
  std::optional<std::size_t> index = std::nullopt;  ///< within a row of several numbers
  double stored = std::numeric_limits<double>::quiet_NaN();
  double recomputed = std::numeric_limits<double>::quiet_NaN();
  double tolerance = 0.0;  ///< what rounding explains of the difference
  std::string reason;      ///< what it was compared with
};

/// "/levels/h, row 7: 0.1 is stored, 0.2 recomputed (…)"
[[nodiscard]] std::string to_string(const Disagreement& disagreement);

}  // namespace rubato
