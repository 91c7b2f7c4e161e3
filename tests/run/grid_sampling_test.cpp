// Formulas of place that the grid does not hold: what it takes for another wave, or what falls between the nodes.

#include <catch2/catch.hpp>

#include <algorithm>
#include <string>

#include <rubato/problem/problem.hpp>
#include <rubato/run/run.hpp>

#include "folder.hpp"

using namespace rubato;
using rubato::tests::Folder;

namespace {

/// True if formulas between the nodes are a reason; the run is then lost.
bool is_lost_between_nodes(const std::string& text) {
  const Folder folder;
  const Outcome outcome = run(parse_problem(text, "t.toml"), {.output = folder / "t.h5", .threads = 1});
  const bool found = std::ranges::any_of(outcome.judgement.reasons, [](const figures::Reason& reason) {
    return reason.kind == figures::ReasonKind::spectrum &&
           reason.finding.find("between the nodes") != std::string::npos;
  });
  CHECK((!found || outcome.judgement.verdict == figures::Verdict::lost));
  return found;
}

std::string wave(const std::string& initial, const std::string& mass = "1", const std::string& cells = "200") {
  return "[field]\nequation = \"u_tt = u_xx - (" + mass + ")*u\"\n[grid]\nx = { from = 0, to = 40, cells = " + cells +
         " }\n[initial]\nu = \"" + initial +
         "\"\nu_t = 0\n[scheme]\nlagrangian = \"splitting\"\nlevels = \"fixed\"\nstep = 0.05\nuntil = 0.2\n";
}

}  // namespace

TEST_CASE("a wave that the grid takes for another is a reason, and one that it holds is none") {
  for (const std::string more : {"201", "199", "399", "401", "1001"}) {
    INFO(more << " waves on 200 cells");
    CHECK(is_lost_between_nodes(wave("cos(2*pi*" + more + "*x/40 + 0.3)")));
    CHECK_FALSE(is_lost_between_nodes(wave("cos(2*pi*" + more + "*x/40 + 0.3)", "1", "4000")));
  }
  // Three nodes for each wave are enough, and jumps and kinks are few among the nodes.
  for (const std::string held : {"cos(2*pi*66*x/40)", "1", "0", "max(0, 1 - abs(x - 20)/5)", "exp(-(x - 20)^2)"}) {
    INFO(held);
    CHECK_FALSE(is_lost_between_nodes(wave(held)));
  }
  CHECK_FALSE(is_lost_between_nodes(wave("noise(1, 10)")));
}

TEST_CASE("a medium that the grid takes for another is a reason") {
  const std::string pulse = "exp(-(x - 20)^2)";
  for (const std::string medium : {"1 + 50*exp(-((x - 5.1)/0.02)^2)", "1 + cos(2*pi*200*x/40)"}) {
    INFO(medium);
    CHECK(is_lost_between_nodes(wave(pulse, medium)));
    CHECK_FALSE(is_lost_between_nodes(wave(pulse, medium, "8000")));
  }
  CHECK_FALSE(is_lost_between_nodes(wave(pulse, "1 + 0.5*cos(2*pi*x/40)")));
}

TEST_CASE("along each axis of a plane between walls, too") {
  const auto plane = [](const std::string& initial) {
    return "[field]\nequation = \"u_tt = u_xx + u_yy - u\"\n[grid]\nx = { from = 0, to = 1, cells = 24, left = "
           "\"free\", "
           "right = \"free\" }\ny = { from = 0, to = 1, cells = 20 }\n[initial]\nu = \"" +
           initial + "\"\nu_t = 0\n[scheme]\nlagrangian = \"leapfrog\"\nlevels = \"fixed\"\nstep = 0.02\nuntil = 0.1\n";
  };
  CHECK(is_lost_between_nodes(plane("cos(2*pi*x)*cos(2*pi*21*y)")));
  CHECK(is_lost_between_nodes(plane("cos(47*pi*x)*cos(2*pi*y)")));
  CHECK_FALSE(is_lost_between_nodes(plane("cos(2*pi*x)*cos(4*pi*y)")));
}
