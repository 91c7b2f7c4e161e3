#pragma once

#include <string_view>

namespace rubato {

[[nodiscard]] std::string_view version();   ///< of this library, "major.minor.patch"
[[nodiscard]] std::string_view compiler();  ///< that built it, and the build type

}  // namespace rubato
