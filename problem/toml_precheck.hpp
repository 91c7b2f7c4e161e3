#pragma once

#include <string>
#include <string_view>

namespace rubato {

/// Refuses text that the TOML parser would choke on, or explain badly: bytes that are not UTF-8 text, characters beyond
/// ASCII outside strings and comments, lines longer than 10^6 bytes, unclosed strings, brackets or dotted keys nested
/// deeper than 100 levels.
/// \throws ProblemError
void precheck_toml(std::string_view text, const std::string& source);

}  // namespace rubato
