#include <rubato/catalogue/catalogue.hpp>

#include <algorithm>

namespace rubato::catalogue {

std::optional<Entry> find(std::string_view name) {
  const auto all = entries();
  const auto found = std::find_if(all.begin(), all.end(), [name](const Entry& entry) { return entry.name == name; });
  if (found == all.end()) {
    return std::nullopt;
  }
  return *found;
}

}  // namespace rubato::catalogue
