// Results that mean nothing, or not what they seem to: each is found, and its twin, which is sound, is not.

#include <catch2/catch.hpp>

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include <rubato/problem/problem.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/converge.hpp>
#include <rubato/run/ensemble.hpp>
#include <rubato/run/run.hpp>

#include "defects.hpp"

using namespace rubato;
using figures::ReasonKind;
using figures::Verdict;
using rubato::defect_tests::defect_file;
using rubato::tests::Folder;

namespace {
using Settings = std::vector<std::string>;

Outcome run_file(const Folder& folder, const std::string& name, const Settings& settings = {}) {
  return run(read_problem(defect_file(name + ".toml"), settings),
             {.output = (folder / "record.h5"), .overwrite = true, .threads = 1});
}

bool has(const figures::Judgement& judgement, ReasonKind kind) {
  return std::ranges::any_of(judgement.reasons, [kind](const figures::Reason& reason) { return reason.kind == kind; });
}

std::string line_of(const std::string& table, const std::string& label) {
  const std::size_t at = table.find("  " + label + " ");
  return at == std::string::npos ? "" : table.substr(at, table.find('\n', at) - at);
}

/// The problems of a file, each below its name: "## NAME".
std::vector<std::pair<std::string, std::string>> problems_in(const std::string& name) {
  std::ifstream file(defect_file(name));
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  constexpr std::string_view heading = "## ";
  std::vector<std::pair<std::string, std::string>> problems;
  for (std::size_t at = text.find(heading); at != std::string::npos;) {
    const std::size_t line = text.find('\n', at), next = text.find("\n## ", at);
    problems.emplace_back(text.substr(at + heading.size(), line - at - heading.size()), text.substr(line, next - line));
    at = next == std::string::npos ? next : next + 1;
  }
  return problems;
}

struct Found {
  std::string file;
  Settings settings;
  Verdict verdict;
  ReasonKind kind;
  Settings twin;  ///< which makes it sound
};

}  // namespace

TEST_CASE("a lost result is found, its status is 7, and its sound twin is good") {
  const auto found = GENERATE(values<Found>({
      {"p18-ejected-untold", {}, Verdict::lost, ReasonKind::energy, {"initial.x=1", "initial.v=1"}},
      {"p23-long-steps-untold", {}, Verdict::lost, ReasonKind::energy, {"scheme.step=0.001", "scheme.until=2"}},
      {"p29-over-the-pole", {}, Verdict::lost, ReasonKind::energy, {"scheme.until=1.5"}},
      {"user-pythagorean-lost-energy", {"scheme.until=5"}, Verdict::lost, ReasonKind::energy, {"scheme.until=1"}},
      {"p39-full-spectrum-untold",
       {"grid.x.cells=64", "grid.y.cells=64"},
       Verdict::lost,
       ReasonKind::spectrum,
       {"grid.x.cells=64", "grid.y.cells=64", "scheme.until=0.1"}},
      {"p38-sawtooth", {}, Verdict::lost, ReasonKind::spectrum, {"grid.x.cells=33"}},
  }));
  INFO(found.file);
  const Folder folder;
  const Outcome bad = run_file(folder, found.file, found.settings);
  INFO(figures::text_of(bad.judgement));
  CHECK(bad.judgement.verdict == found.verdict);
  CHECK(has(bad.judgement, found.kind));
  CHECK(bad.status == ExitStatus::lost);
  CHECK(bad.complete);
  CHECK(to_json(bad).find("\"verdict\": \"lost\"") != std::string::npos);
  for (const figures::Reason& reason : bad.judgement.reasons) {
    CHECK_FALSE(reason.remedy.empty());
  }
  // The record alone has the same verdict.
  const Outcome checked = check((folder / "record.h5"));
  CHECK(checked.status == ExitStatus::done);
  CHECK(line_of(to_table(checked), "verdict") == line_of(to_table(bad), "verdict"));

  const Outcome good = run_file(folder, found.file, found.twin);
  INFO(figures::text_of(good.judgement));
  CHECK(good.judgement.verdict == Verdict::good);
  CHECK(good.status == ExitStatus::done);
}

TEST_CASE("fields and an energy of the size of rounding errors are not judged, and levels vary with none") {
  // A plane wave along x, of one polarisation. The density E·curl E + H·curl H vanishes, and so do four of six fields,
  // but for rounding errors, whose spectrum is full and whose energy strays by itself.
  const auto scheme = GENERATE(as<std::string>{}, "box", "fourier", "splitting");
  const auto levels = GENERATE(as<std::string>{}, "fixed", "variable");
  INFO(scheme << ", " << levels);
  const Folder folder;
  const Settings settings = {"scheme.lagrangian=" + scheme, "scheme.levels=" + levels};
  const Outcome good = run_file(folder, "plane-wave-of-energy-0", settings);
  INFO(figures::text_of(good.judgement));
  CHECK(good.status == ExitStatus::done);
  CHECK(good.judgement.verdict == Verdict::good);
  CHECK(good.statistics.steps == 40);
  CHECK(good.statistics.off_law_steps == 0);
  CHECK_FALSE(good.statistics.has_energy_scale());
  CHECK(check(folder / "record.h5").status == ExitStatus::done);

  // The twin: the other polarisation is as small as 1e-6 of the first, no rounding error, and in the shortest waves.
  Settings twin = settings;
  twin.emplace_back("initial.H2=\"1e-6*sin(7*x)\"");
  twin.emplace_back("scheme.until=1");
  const Outcome bad = run_file(folder, "plane-wave-of-energy-0", twin);
  INFO(figures::text_of(bad.judgement));
  CHECK(has(bad.judgement, ReasonKind::spectrum));
}

TEST_CASE("a stated action of an orbit that names t is judged by its balance, not by an H that does not") {
  const auto levels = GENERATE(as<std::string>{}, "fixed", "variable");
  const Folder folder;
  const auto judgement_of = [&](const std::string& drive) {
    const Outcome outcome = run(
        parse_problem("[hamiltonian]\nq = [\"x\"]\np = [\"v\"]\nH = \"v^2/2 + x^2/2\"\n[initial]\nx = 0.2\nv = 0.1\n"
                      "[scheme]\nlagrangian = \"custom\"\nstep = 0.02\nuntil = 5\nlevels = \"" +
                          levels +
                          "\"\nL = \"(v_0+v_1)/2*(x_1-x_0)/(t_1-t_0) - ((v_0+v_1)^2/8 + ((x_0+x_1)/2)^2/2 - "
                          "(x_0+x_1)/2*" +
                          drive + ")\"\n",
                      "driven.toml"),
        {.output = folder / "record.h5", .overwrite = true});
    CHECK(check(folder / "record.h5").judgement.verdict == outcome.judgement.verdict);
    return outcome.judgement;
  };
  const figures::Judgement good = judgement_of("0.3*cos(1.7*(t_0+t_1)/2)");
  INFO(figures::text_of(good));
  CHECK(good.verdict == Verdict::good);
  // The twin: a force that is always there, of which H knows nothing.
  CHECK(has(judgement_of("0.3"), ReasonKind::energy));
}

TEST_CASE("how far steps are off the law is the same number in the finding and in JSON") {
  const Folder folder;
  const Outcome outcome =
      run(parse_problem(
              "[hamiltonian]\nq = [\"q\"]\np = [\"p\"]\nH = \"3*(p^2*(1+q^2/3)/2 + q^4/4)\"\n[initial]\nq = 0.7\np = "
              "1.2\n[scheme]\nstep = 0.3\nstep_potential = \"none\"\nuntil = 30\n",
              "off.toml"),
          {.output = folder / "record.h5", .overwrite = true});
  const auto reason = std::ranges::find(outcome.judgement.reasons, ReasonKind::law, &figures::Reason::kind);
  REQUIRE(reason != outcome.judgement.reasons.end());
  INFO(reason->finding);
  const double relative = outcome.statistics.relative_off_law_deviation().value();
  CHECK(reason->finding.ends_with(fmt::format("{:.2g} (relative)", relative)));
  // The twin: the absolute one is another.
  CHECK(fmt::format("{:.2g}", outcome.statistics.off_law_deviation()) != fmt::format("{:.2g}", relative));
}

TEST_CASE("the rounding errors of constants and ramps are no waves") {
  struct Still {
    std::string equation, axis, u, lagrangian;
  };
  const auto [equation, axis, u, lagrangian] = GENERATE(values<Still>({
      {"u_t + 6*u*u_x + u_xxx = 0", "", "0.7", "box"},
      {"u_t + u_x + u*u_x - u_xxt = 0", "", "0.5", "box"},
      {"i*psi_t + psi_xx - abs2(psi)*psi = 0", "", "0.7", "box"},
      {"u_tt = u_xx", ", left = \"fixed\", right = \"fixed\"", "2*x/7", "leapfrog"},
      {"u_tt = u_xx - sin(u)", ", jump = { u = \"2*pi\" }", "2*pi*x/7", "fourier"},
  }));
  INFO(equation);
  const Folder folder;
  const auto judgement_of = [&, &equation = equation, &axis = axis, &u = u,
                             &lagrangian = lagrangian](const std::string& added) {
    const std::string text = "[field]\nequation = \"" + equation + "\"\n[grid]\nx = { from = 0, to = 7, cells = 33" +
                             axis + " }\n[initial]\n" + (equation.starts_with("i") ? "psi" : "u") + " = \"" + u +
                             added + "\"\n" + (equation.starts_with("u_tt") ? "u_t = 0\n" : "") +
                             "[scheme]\nlagrangian = \"" + lagrangian +
                             "\"\nlevels = \"fixed\"\nstep = 0.02\nuntil = 2\n";
    return run(parse_problem(text, "still.toml"), {.output = folder / "record.h5", .overwrite = true}).judgement;
  };
  const figures::Judgement good = judgement_of("");
  INFO(figures::text_of(good));
  CHECK(good.verdict == Verdict::good);
  // The twin: the shortest waves are as small as 1e-6 of that, no rounding.
  CHECK(has(judgement_of(" + 1e-6*sin(2*pi*15*x/7)"), ReasonKind::spectrum));
}

TEST_CASE("[exact] of another frequency is found by its first increment, and the right one is not") {
  const auto scheme = GENERATE(as<std::string>{}, "euler-box", "box", "leapfrog", "fourier", "splitting");
  // At rest; and a travelling wave, whose first increment is of the order of the step.
  const auto [u_t, u] = GENERATE(
      values<std::pair<std::string, std::string>>({{"0", "cos(k*x)*cos(f*w*t)"}, {"w*sin(k*x)", "cos(k*x - f*w*t)"}}));
  const auto step = GENERATE(as<std::string>{}, "0.02", "0.5");
  INFO(scheme << ", " << u << ", " << step);
  const Folder folder;
  const auto doubts = [&, &u_t = u_t, &u = u](const std::string& f) {
    const std::string text =
        "[field]\nequation = \"u_tt = u_xx - u\"\n[parameters]\nk = \"2*pi/6\"\nw = \"sqrt(1 + k^2)\"\nf = " + f +
        "\n[grid]\nx = { from = 0, to = 6, cells = 25 }\n[initial]\nu = \"cos(k*x)\"\nu_t = \"" + u_t +
        "\"\n[exact]\nu = \"" + u + "\"\n[scheme]\nlagrangian = \"" + scheme +
        "\"\nlevels = \"fixed\"\nuntil = 2\nstep = ";
    return has(run(parse_problem(text + (scheme == "leapfrog" || scheme == "euler-box" ? "0.02" : step), "exact.toml"),
                   {.output = folder / "record.h5", .overwrite = true})
                   .judgement,
               ReasonKind::exact);
  };
  CHECK_FALSE(doubts("1"));
  // The error of a step of order 1 from rest is that of a larger frequency, too.
  CHECK(doubts(scheme == "euler-box" && u_t == "0" ? "0.5" : step == "0.5" ? "1.5" : "1.1"));
}

TEST_CASE("thirty good runs are good, and thirty bad ones are not or end early", "[long]") {
  const bool are_good = GENERATE(true, false);
  const auto problems = problems_in(are_good ? "verdict-good.txt" : "verdict-bad.txt");
  REQUIRE(problems.size() == 30);
  const Folder folder;
  for (const auto& [name, text] : problems) {
    INFO(name);
    const Outcome outcome =
        run(parse_problem(text, name + ".toml"), {.output = (folder / "record.h5"), .overwrite = true, .threads = 1});
    INFO(figures::text_of(outcome.judgement));
    const bool found = outcome.judgement.verdict != Verdict::good;
    CHECK((found || !outcome.complete) == !are_good);
  }
}

TEST_CASE("a collapse in the plane is lost", "[long]") {
  const Folder folder;
  const Outcome outcome = run_file(folder, "user-nls-collapse-silent");
  CHECK(outcome.status == ExitStatus::lost);
}

TEST_CASE("[verdict] accept turns a reason off, and the run names it") {
  const Folder folder;
  const Outcome outcome = run_file(folder, "p29-over-the-pole", {"verdict.accept=[\"energy\",\"resolution\"]"});
  CHECK(outcome.status == ExitStatus::done);
  CHECK(outcome.judgement.verdict == Verdict::good);
  CHECK(line_of(to_table(outcome), "verdict").find("accepted") != std::string::npos);
  CHECK(to_json(outcome).find("\"accepted\"") != std::string::npos);
  CHECK(line_of(to_table(check((folder / "record.h5"))), "verdict") == line_of(to_table(outcome), "verdict"));
  CHECK_THROWS_AS(run_file(folder, "p29-over-the-pole", {"verdict.accept=[\"enregy\"]"}), ProblemError);
}

TEST_CASE("steps off the law by little of the energy exchanged are no finding where H is 0") {
  const Folder folder;
  const auto verdict = [&](const std::string& step, const std::string& until) {
    const Problem problem = parse_problem(
        "[hamiltonian]\nq = [\"x\"]\np = [\"u\"]\nH = \"u^2/2 - cos(x)\"\n[initial]\nx = 0\nu = \"sqrt(2)\"\n"
        "[scheme]\nlagrangian = \"splitting\"\ncomposition = \"kahan-li-6\"\nstep_potential = \"none\"\n",
        "t.toml", Settings{"scheme.step=" + step, "scheme.until=" + until});
    const Outcome outcome = run(problem, {.output = folder / "record.h5", .overwrite = true});
    CHECK(outcome.status == ExitStatus::done);
    CHECK(outcome.statistics.off_law_steps > 0);
    return outcome.judgement.verdict;
  };
  CHECK(verdict("0.005", "2") == Verdict::good);
  CHECK(verdict("0.3", "20") == Verdict::good);      // steps over zeros of Gamma, off by 3e-6, where terms exchange 1
  CHECK(verdict("1.2", "20") == Verdict::doubtful);  // the twin: off by 0.02
}

TEST_CASE("a run that fails before its end is not good, until it is continued to its end") {
  const Folder folder;
  const std::string file = folder / "record.h5";
  const auto fails = [&](const Settings& settings) {
    return run(read_problem("pendulum", settings), {.output = file, .overwrite = true, .threads = 1});
  };
  const Outcome failed = fails({"scheme.until=5", "scheme.max_steps=10"});
  CHECK(failed.status == ExitStatus::failed);
  CHECK(failed.judgement.verdict == Verdict::doubtful);
  REQUIRE(failed.judgement.reasons.size() == 1);
  CHECK(failed.judgement.reasons.front().kind == ReasonKind::end);
  CHECK(failed.judgement.reasons.front().value == failed.statistics.t);
  CHECK_FALSE(failed.judgement.reasons.front().remedy.empty());
  CHECK(to_json(failed).find("\"verdict\": \"doubtful\", \"reasons\": [{\"what\": \"end\"") != std::string::npos);
  const Outcome checked = check(file);
  CHECK(checked.status == ExitStatus::done);
  CHECK(line_of(to_table(checked), "verdict") == line_of(to_table(failed), "verdict"));
  // To an end that is reached: what was not good is past.
  const Outcome continued = resume(file, failed.statistics.t - 0.01, {.threads = 1});
  CHECK(continued.status == ExitStatus::done);
  CHECK(continued.judgement.verdict == Verdict::good);
  CHECK(check(file).judgement.verdict == Verdict::good);
  CHECK(fails({"scheme.until=5", "scheme.max_steps=10", "verdict.accept=[\"end\"]"}).judgement.verdict ==
        Verdict::good);
  // The twins: a run that reaches its end, and one that is interrupted, which is no failure.
  CHECK(fails({"scheme.until=1"}).judgement.verdict == Verdict::good);
  std::atomic<bool> asked = false;
  const Outcome interrupted = run(read_problem("pendulum", Settings{"scheme.until=1e4"}),
                                  {.output = file,
                                   .overwrite = true,
                                   .threads = 1,
                                   .interrupt = &asked,
                                   .progress = [&asked](const Progress&) { asked = true; },
                                   .progress_interval = {}});
  CHECK(interrupted.status == ExitStatus::interrupted);
  CHECK(interrupted.judgement.verdict == Verdict::good);
}

TEST_CASE("a run continued has the verdict of a run never stopped") {
  const Folder folder;
  const Outcome whole = run_file(folder, "p18-ejected-untold");
  Outcome part = run_file(folder, "p18-ejected-untold", {"scheme.until=77"});
  part = resume((folder / "record.h5"), 200.0, {.threads = 1});
  CHECK(part.status == whole.status);
  CHECK(figures::text_of(part.judgement) == figures::text_of(whole.judgement));
}

TEST_CASE("a wave that comes to the seam is a remark, and none where it does not") {
  const Folder folder;
  const Outcome small = run_file(folder, "p40-window-too-small", {"scheme.until=2"});
  CHECK(small.judgement.verdict == Verdict::good);
  CHECK(line_of(to_table(small), "at the seam").find("reached") != std::string::npos);
  const Outcome large =
      run_file(folder, "p40-window-too-small",
               {"scheme.until=1", "grid.x.from=-40", "grid.x.to=40", "grid.x.cells=512", "scheme.step=0.01"});
  CHECK(line_of(to_table(large), "at the seam").empty());
}

TEST_CASE("an ensemble carries the warnings and verdicts of its members") {
  const Folder folder;
  const auto ensemble = [&](const std::string& name, const Settings& settings = {}) {
    return run_ensemble(read_problem(defect_file(name + ".toml"), settings),
                        {.output = (folder / "record.h5"), .overwrite = true, .threads = 1});
  };
  const auto has_warning = [](const EnsembleOutcome& outcome, const std::string& part) {
    return to_json(outcome).find(part) != std::string::npos;
  };
  const EnsembleOutcome hidden = ensemble("p22-ensemble-hides-warnings");
  CHECK(hidden.status == ExitStatus::done);
  CHECK(has_warning(hidden, "in 2 of 2 members, the first: 0: the formula of event e is not defined"));
  CHECK(has_warning(hidden, "output times something is not defined"));
  CHECK(has_warning(hidden, "\"verdicts\": {\"good\": 2, \"doubtful\": 0, \"lost\": 0}"));

  const EnsembleOutcome ill_posed = ensemble("p22-ill-posed-in-ensemble");
  CHECK(ill_posed.findings.warnings("members").size() >= 2);

  const Settings grid = {"ensemble.grid.scheme.until=[1.5, 2]"};
  const EnsembleOutcome one_lost = ensemble("p29-over-the-pole", grid);
  CHECK(one_lost.status == ExitStatus::done);
  CHECK(one_lost.findings.verdict() == Verdict::lost);
  CHECK(has_warning(one_lost, "\"verdicts\": {\"good\": 1, \"doubtful\": 0, \"lost\": 1}"));
  CHECK(one_lost.statuses == std::vector{ExitStatus::done, ExitStatus::lost});
  // The record has the verdicts, and a check agrees with them.
  const EnsembleOutcome checked = check_ensemble((folder / "record.h5"), {.threads = 1});
  CHECK(checked.status == ExitStatus::done);
  CHECK(checked.findings.verdict() == Verdict::lost);

  const EnsembleOutcome all_lost = ensemble("p29-over-the-pole", {"ensemble.grid.scheme.until=[2, 2.5]"});
  CHECK(all_lost.status == ExitStatus::lost);
}

TEST_CASE("converge carries the warnings and verdicts of its runs") {
  const ConvergenceOutcome lost = converge(read_problem(defect_file("p18-ejected-untold.toml")), {}, {.threads = 1});
  CHECK(lost.findings.verdict() == Verdict::lost);
  CHECK(to_json(lost).find("\"verdicts\"") != std::string::npos);
}
