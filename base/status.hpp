#pragma once

#include <string_view>

namespace rubato {

/// How an attempted step, or a solve inside it, ended. Numerics never throw: they return one of these.
enum class [[nodiscard]] Status{
    success,
    singular,         ///< the step equation has no solution with the required energy (theory.md section 3)
    ill_conditioned,  ///< it has, but the step condition exceeds the limit: the energy law carries no information
    not_converged,    ///< the iteration did not reach stagnation within its limit
    undefined,        ///< a formula gave a value that is not finite (outside its domain)
};

[[nodiscard]] constexpr std::string_view to_string(Status status) {
  switch (status) {
    case Status::success: return "success";
    case Status::singular: return "singular";
    case Status::ill_conditioned: return "ill-conditioned";
    case Status::not_converged: return "not converged";
    case Status::undefined: return "undefined";
  }
  return "unknown";
}

}  // namespace rubato
