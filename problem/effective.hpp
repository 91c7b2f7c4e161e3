#pragma once

#include <span>
#include <string>
#include <string_view>

#include <rubato/problem/document.hpp>

namespace rubato {

/// A problem's tree after `--set` and the catalogue, and the text that stands for it in a record.
struct EffectiveDocument {
  Value root;
  std::string text;  ///< the user's own text where nothing was changed
};

/// Reads `text`, carries out `settings` ("table.key=value" changes an entry, "-table.key" removes one, before the
/// others change any), and puts the catalogue's entries in the place of `system = "…"` and `equation = "…"`, and
/// numbers in that of `cells = "about …"`; the user's parameters go before the catalogue's. \throws ProblemError
[[nodiscard]] EffectiveDocument effective_document(std::string_view text, const std::string& source,
                                                   std::span<const std::string> settings);

/// A value of the command line as TOML: what is not TOML is a string.
[[nodiscard]] std::string setting_value(const std::string& text);

/// The text of a problem without one of its entries, a table or "table.key", if there is one.
[[nodiscard]] std::string without(std::string_view text, const std::string& source, std::string_view path);

/// "; did you mean …?" for the nearest of the catalogue's names, or a list of them all.
[[nodiscard]] std::string catalogue_suggestion(std::string_view name);

}  // namespace rubato
