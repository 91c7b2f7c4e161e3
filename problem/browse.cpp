#include <rubato/problem/browse.hpp>

#include <algorithm>

#include <fmt/format.h>

#include <rubato/catalogue/catalogue.hpp>
#include <rubato/formula/parse.hpp>
#include <rubato/problem/document.hpp>
#include <rubato/problem/effective.hpp>

namespace rubato {

std::vector<CatalogueItem> list_catalogue() {
  std::vector<CatalogueItem> items;
  for (const auto& entry : catalogue::entries()) {
    const std::string name(entry.name);
    const Value root = read_document(entry.text, name);
    const Entry* title = find(*root.table(), "title");
    items.push_back(
        {name, title == nullptr ? name : *title->value.string(), find(*root.table(), "multisymplectic") != nullptr});
  }
  std::stable_partition(items.begin(), items.end(), [](const CatalogueItem& item) { return !item.is_lattice; });
  return items;
}

std::string_view show_catalogue(const std::string& name) {
  const auto entry = catalogue::find(name);
  if (!entry) {
    throw ProblemError({name, 0, 0}, "the catalogue has no such problem" + catalogue_suggestion(name));
  }
  return entry->text;
}

std::string did_you_mean(std::string_view word, std::span<const std::string> known) {
  const auto nearest = formula::nearest_name(word, known);
  return nearest ? fmt::format("did you mean {}?", *nearest) : "";
}

}  // namespace rubato
