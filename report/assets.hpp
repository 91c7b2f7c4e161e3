#pragma once

#include <span>
#include <string_view>

namespace rubato::report {

/// A file of report/page or report/vendor, embedded at build time.
struct Asset {
  std::string_view name;  ///< without folders
  std::string_view text;
};

[[nodiscard]] std::span<const Asset> assets();

/// The text of the asset called `name`, which must exist.
[[nodiscard]] std::string_view asset(std::string_view name);

}  // namespace rubato::report
