#include "audit/level_rules.hpp"

#include <fmt/format.h>

namespace audit {

std::string PotentialRule::toml() const {
  switch (kind) {
    case Kind::unsaid: return {};
    case Kind::none: return "step_potential = \"none\"\n";
    case Kind::given: return fmt::format("step_potential = {{ kappa = {}, p = {} }}\n", kappa, exponent);
    case Kind::automatic: break;
  }
  return largest_step == 0.0 ? "step_potential = \"auto\"\n"
                             : fmt::format("step_potential = \"auto\"\nlargest_step = {}\n", largest_step);
}

}  // namespace audit
