#pragma once

#include <stdexcept>
#include <string>

namespace rubato::run_tests {

/// A complete ODE problem; the tests of bad input change one thing in it.
inline const std::string pendulum = R"toml(title = "T"
[hamiltonian]
q = ["q"]
p = ["p"]
H = "p^2/2 - cos(q)"
[parameters]
k = 1.0
[initial]
q = 0
p = 1.9
[scheme]
step = 0.1
until = 10
)toml";

/// The lattice problem of the interface.
inline const std::string breather = R"toml(title = "sine-Gordon breather"
[multisymplectic]
fields = ["u", "v", "w"]
M = [["u", "v", -1]]
K.x = [["u", "w", 1]]
S = "(v^2 - w^2)/2 + 1 - cos(u)"
[grid]
x = { from = -20, to = 20, cells = 401 }
[parameters]
omega = 0.5
gamma = "sqrt(1 - omega^2)"
[initial]
u = "0"
v = "4*gamma*sech(gamma*x)"
[exact]
u = "4*atan(gamma/omega*sin(omega*t)*sech(gamma*x))"
[invariants]
topological_charge = "w/(2*pi)"
[symmetries]
turn = [["u", "v", 1], ["v", "u", -1]]
[scheme]
lagrangian = "box"
levels = "variable"
step = 0.05
until = 20
)toml";

/// `text` with the first `from` replaced by `to`; `from` must be there, or a test would test nothing.
inline std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const std::size_t place = text.find(from);
  if (place == std::string::npos) {
    throw std::logic_error("nothing to replace: " + from);
  }
  return text.replace(place, from.size(), to);
}

}  // namespace rubato::run_tests
