#pragma once

#include <span>
#include <string>
#include <string_view>

#include <rubato/study/document.hpp>

namespace rubato::study {

/// A problem's tree after `--set` and the catalogue, and the text that stands for it in a record.
struct EffectiveDocument {
  Value root;
  std::string text;  ///< the user's own text where nothing was changed
};

/// Reads `text`, carries out `settings` ("table.key=value"), and puts the catalogue's entries in the place of
/// `system = "…"` and `equation = "…"`; the user's parameters go before the catalogue's.
/// \throws ProblemError
[[nodiscard]] EffectiveDocument effective_document(std::string_view text, const std::string& source,
                                                   std::span<const std::string> settings);

/// "; did you mean …?" for the nearest of the catalogue's names, or a list of them all.
[[nodiscard]] std::string catalogue_suggestion(std::string_view name);

}  // namespace rubato::study
