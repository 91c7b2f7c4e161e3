#pragma once

#include <optional>
#include <span>
#include <string_view>

/// Named systems and problems, as data: every problem file of catalogue/, embedded at build time.
namespace rubato::catalogue {

struct Entry {
  std::string_view name;  ///< the file's name without its extension
  std::string_view text;  ///< the complete problem file
};

/// All entries, in alphabetical order.
[[nodiscard]] std::span<const Entry> entries();

/// The entry called `name`.
[[nodiscard]] std::optional<Entry> find(std::string_view name);

}  // namespace rubato::catalogue
