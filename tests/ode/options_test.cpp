// Options left out or without sense are refused with their name, value and remedy.

#include <functional>
#include <limits>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/ode/integrate.hpp>

using namespace rubato;
using Catch::Contains;

namespace {

const Hamiltonian pendulum({"q"}, {"p"}, "p^2/2 - cos(q)");
constexpr double undefined = std::numeric_limits<double>::quiet_NaN();
constexpr double infinity = std::numeric_limits<double>::infinity();

struct Case {
  std::function<void(InitialState&, IntegrationOptions&)> spoil;
  std::vector<std::string> said;
};

}  // namespace

TEST_CASE("integrate refuses options that are left out or make no sense, by name") {
  const std::vector<Case> cases = {
      {[](auto&, auto& o) { o = {.step = 0.1}; }, {"until = 0", "give the time at which the run ends"}},
      {[](auto& s, auto& o) { s.t = 2.0, o.until = 2.0; }, {"until = 2 is the start time"}},
      {[](auto&, auto& o) { o = {.until = 1}; }, {"step = 0 leads nowhere", "give the first step"}},
      {[](auto&, auto& o) { o = {}; }, {"until = 0"}},
      {[](auto&, auto& o) { o.until = undefined; }, {"until = nan is not finite"}},
      {[](auto&, auto& o) { o.until = infinity; }, {"until = inf is not finite"}},
      {[](auto&, auto& o) { o.step = undefined; }, {"step = nan"}},
      {[](auto&, auto& o) { o.step = infinity; }, {"step = inf"}},
      {[](auto&, auto& o) { o.step = -0.1; }, {"a step of -0.1 does not lead", "sign of the step"}},
      {[](auto&, auto& o) { o.step = 1e12; }, {"so long that until = 1 counts as the start"}},
      {[](auto& s, auto& o) { s.t = 1e9, o.until = 2e9, o.step = 1e-9; }, {"lost in rounding"}},
      {[](auto& s, auto&) { s.t = undefined; }, {"start time has to be finite"}},
      {[](auto& s, auto&) { s.q = {undefined}; }, {"the initial state is not finite: q = (nan)"}},
      {[](auto& s, auto&) { s.p = {infinity}; }, {"p = (inf)"}},
      {[](auto& s, auto&) { s = {}; }, {"0 coordinates and 0 momenta", "1 of each"}},
      {[](auto& s, auto&) {
         s.p = {1.0, 2.0};
       },
       {"1 coordinates and 2 momenta"}},
      {[](auto&, auto& o) { o.tolerance = 0.0; }, {"tolerance = 0", "between 0 and 1"}},
      {[](auto&, auto& o) { o.tolerance = -1e-13; }, {"tolerance = -1e-13"}},
      {[](auto&, auto& o) { o.tolerance = undefined; }, {"tolerance = nan"}},
      {[](auto&, auto& o) { o.tolerance = 1.0; }, {"tolerance = 1"}},
      {[](auto&, auto& o) { o.max_steps = 0; }, {"max_steps = 0 allows no step"}},
      {[](auto&, auto& o) {
         o.next = InitialState{{undefined}, {1.0}, 0.1};
       },
       {"the initial state is not finite"}},
      {[](auto&, auto& o) {
         o.next = InitialState{{0.1}, {1.0}, 0.3};
       },
       {"contradicts the starting pair"}},
  };
  for (const Case& example : cases) {
    InitialState state{.q = {0.0}, .p = {1.9}};
    IntegrationOptions options{.step = 0.1, .until = 1.0};
    example.spoil(state, options);
    std::string message;
    try {
      static_cast<void>(integrate(pendulum, state, options));
    } catch (const std::invalid_argument& error) {
      message = error.what();
    }
    for (const std::string& part : example.said) {
      CHECK_THAT(message, Contains(part));
    }
  }
  // The twin: what was spoilt runs.
  CHECK(integrate(pendulum, {.q = {0.0}, .p = {1.9}}, {.step = 0.1, .until = 1.0}).steps() > 5);
  CHECK(integrate(pendulum, {.q = {0.0}, .p = {1.9}}, {.step = -0.1, .until = -1.0}).steps() > 5);
}
