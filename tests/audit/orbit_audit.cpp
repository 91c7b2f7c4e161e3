#include "audit/orbit_audit.hpp"

#include <algorithm>
#include <functional>
#include <span>

#include <fmt/format.h>

#include "audit/case_audit.hpp"
#include "audit/orbit_judge.hpp"

namespace audit {

void audit_orbit(const std::string& program, std::uint64_t number, Disagreements& findings) {
  const OrbitProblem problem = random_orbit(number);
  const Case which = {
      .problem = problem.toml(),
      .rules = problem.rules(),
      .max_steps = problem.max_steps,
      .automatic = problem.energy_tolerance.has_value(),
      .shifted =
          [&](double constant) {
            OrbitProblem shifted = problem;
            shifted.H = shifted.H + constant;
            shifted.L = shifted.L - constant;  // the energy of an L(q, q̇), too, is then more
            return shifted.toml();
          },
      .judge = [&](const Stored& record, const Json& reported,
                   Disagreements& found) { return judge_orbit(problem, record, reported, found); },
  };
  audit_case(program, which, findings);
}

namespace {

struct Twin {
  const char* kind;
  std::function<void(Stored&, Json&)> damage;
};

double& value_of(Stored& record, const std::string& path, std::size_t i) {
  return record.datasets.at(path).at(i);
}

}  // namespace

namespace {

/// Runs a problem.
std::pair<Stored, Json> run_of(const std::string& program, const OrbitProblem& problem) {
  const Folder folder;
  write_text(folder.path() / "p.toml", problem.toml());
  const Call run = call(program, {"run", "p.toml", "--json", "-o", "p.h5"}, folder.path());
  return {read_record(folder.path() / "p.h5"), parse_json(run.output)};
}

/// How many of the twins are taken for good, and of the findings where there is nothing to find.
int missed_of(const OrbitProblem& problem, const Stored& record, const Json& reported, std::span<const Twin> twins) {
  Disagreements none;
  judge_orbit(problem, record, reported, none);
  int missed = 0;
  for (const auto& [kind, text] : none.list) {
    fmt::print("FAILED: the undamaged record: {}: {}\n", kind, text);
    ++missed;
  }
  for (const Twin& twin : twins) {
    Stored damaged = record;
    Json damaged_account = reported;
    twin.damage(damaged, damaged_account);
    Disagreements found;
    judge_orbit(problem, damaged, damaged_account, found);
    if (!found.has(twin.kind)) {
      fmt::print("FAILED: a record with a wrong \"{}\" was taken for good\n", twin.kind);
      ++missed;
    }
  }
  return missed;
}

}  // namespace

int orbit_twins(const std::string& program) {
  // A rotating pendulum: some of its steps are off the law.
  OrbitProblem problem = {};
  problem.family = "twins";
  problem.names = {"q", "p"};
  const Expression q = Expression::variable(0), p = Expression::variable(1);
  problem.H = p * p / 2.0 - cos(q);
  problem.start = {0.0, 2.2};
  problem.invariants.emplace_back("product", q * p);
  problem.step = 0.1;
  problem.until = 12;
  problem.max_steps = 1000;
  problem.potential = {.kind = PotentialRule::Kind::none};
  const auto [record, reported] = run_of(program, problem);
  const auto plain =
      static_cast<std::size_t>(std::ranges::find(record["/levels/off_law"], 1.0) - record["/levels/off_law"].begin());
  // Each by a few units of what rounding may be at that place.
  const Twin twins[] = {
      {"step equation", [](Stored& r, Json&) { value_of(r, "/states/q", 9) += 1e-14; }},
      {"step equation", [&](Stored& r, Json&) { value_of(r, "/states/p", plain + 1) += 1e-13; }},
      {"step equation", [](Stored& r, Json&) { value_of(r, "/levels/h", 9) *= 1 + 1e-13; }},
      {"energy law", [&](Stored& r, Json&) { value_of(r, "/levels/off_law", plain) = 0; }},
      {"energy law", [](Stored&, Json& j) { j.numbers["discrete_energy.value"] *= 1 + 1e-12; }},
      {"stored energy", [](Stored& r, Json&) { value_of(r, "/levels/energy", 5) += 4e-14; }},
      {"node energy", [](Stored& r, Json&) { value_of(r, "/levels/node_energy", 5) *= 1 + 2e-14; }},
      {"gamma", [](Stored& r, Json&) { value_of(r, "/levels/gamma", 5) *= 1 + 2e-13; }},
      {"invariant", [](Stored& r, Json&) { value_of(r, "/laws/product", 5) *= 1 + 2e-14; }},
      {"times", [](Stored& r, Json&) { value_of(r, "/levels/t", 20) += 1e-14; }},
      {"sign of h", [](Stored& r, Json&) { value_of(r, "/levels/h", 20) *= -1; }},
      {"stored levels", [](Stored& r, Json&) { value_of(r, "/states/level", 20) += 1; }},
      {"told steps", [](Stored&, Json& j) { j.numbers["steps"] += 1; }},
      {"told off_law.steps", [](Stored&, Json& j) { j.numbers["off_law.steps"] = 0; }},
      {"told off_law.max_deviation", [](Stored&, Json& j) { j.numbers["off_law.max_deviation"] = 0; }},
      {"told gamma.min", [](Stored&, Json& j) { j.numbers["gamma.min"] += 1e-12; }},
      {"told node_energy.max_deviation", [](Stored&, Json& j) { j.numbers["node_energy.max_deviation"] = 0; }},
  };
  const int missed = missed_of(problem, record, reported, twins);

  // Gauss collocation, where the stages have to be found again.
  problem.lagrangian = OrbitProblem::Lagrangian::gauss;
  problem.stages = 3;
  problem.on_singular = "plain";
  const Twin collocated[] = {
      {"step equation", [](Stored& r, Json&) { value_of(r, "/states/q", 9) += 1e-14; }},
      {"step equation", [](Stored& r, Json&) { value_of(r, "/levels/h", 9) *= 1 + 1e-13; }},
      {"stored energy", [](Stored& r, Json&) { value_of(r, "/levels/energy", 5) += 4e-14; }},
  };
  const auto [gauss, gauss_told] = run_of(program, problem);
  int missed_in_all = missed + missed_of(problem, gauss, gauss_told, collocated);

  // A splitting with a step potential of given numbers.
  problem.lagrangian = OrbitProblem::Lagrangian::splitting;
  problem.composition = "kahan-li-6";
  problem.on_singular.clear();
  problem.potential = {.kind = PotentialRule::Kind::given, .kappa = 1.5, .exponent = 8.5};
  const Twin composed[] = {
      {"step equation", [](Stored& r, Json&) { value_of(r, "/states/p", 9) += 1e-12; }},
      {"step equation", [](Stored& r, Json&) { value_of(r, "/levels/h", 9) *= 1 + 1e-11; }},
      {"stored energy", [](Stored& r, Json&) { value_of(r, "/levels/energy", 5) += 5e-13; }},
      {"energy law", [](Stored&, Json& j) { j.numbers["discrete_energy.value"] *= 1 + 1e-12; }},
      {"step potential", [](Stored& r, Json&) { value_of(r, "/levels/step_potential", 5) *= 1 + 2e-14; }},
      {"step potential", [](Stored& r, Json&) { r.datasets.erase("/levels/step_potential"); }},
      {"strength of the step potential",
       [](Stored& r, Json&) {
         for (double& value : r.datasets.at("/levels/step_potential")) {
           value *= 1.1;
         }
       }},
      {"told step_potential.max", [](Stored&, Json& j) { j.numbers["step_potential.max"] *= 1 + 1e-15; }},
  };
  // The strength has to stand out from 1e-6 of the terms of H.
  problem.step = 0.6;
  const auto [splitting, splitting_told] = run_of(program, problem);
  missed_in_all += missed_of(problem, splitting, splitting_told, composed);

  // The pendulum by its L, on a cart that moves it.
  problem = {};
  problem.family = "twins";
  problem.names = {"q", "x", "q_dot", "x_dot"};
  const Expression x = Expression::variable(1), q_dot = Expression::variable(2), x_dot = Expression::variable(3);
  problem.L = q_dot * q_dot / 2.0 + x_dot * x_dot + q_dot * x_dot * cos(q) + cos(q) - x * x / 2.0;
  problem.quadrature = OrbitProblem::Quadrature::lobatto;
  problem.stages = 4;
  problem.start = {0.3, 0.2, 1.1, -0.4};
  problem.invariants.emplace_back("product", q * Expression::variable(2) * Expression::variable(5));
  problem.step = 0.2;
  problem.until = 12;
  problem.max_steps = 1000;
  const Twin by_L[] = {
      {"step equation", [](Stored& r, Json&) { value_of(r, "/states/q", 9) += 1e-13; }},
      {"step equation", [](Stored& r, Json&) { value_of(r, "/states/p", 9) += 1e-13; }},
      {"step equation", [](Stored& r, Json&) { value_of(r, "/levels/h", 9) *= 1 + 1e-12; }},
      {"velocities", [](Stored& r, Json&) { value_of(r, "/states/q_dot", 9) += 1e-13; }},
      {"stored energy", [](Stored& r, Json&) { value_of(r, "/levels/energy", 5) += 1e-12; }},
      {"energy law", [](Stored&, Json& j) { j.numbers["discrete_energy.value"] *= 1 + 2e-12; }},
      {"node energy", [](Stored& r, Json&) { value_of(r, "/levels/node_energy", 5) *= 1 + 2e-13; }},
      {"invariant", [](Stored& r, Json&) { value_of(r, "/laws/product", 5) *= 1 + 2e-14; }},
      {"exponent of the step potential",
       [](Stored& r, Json&) {
         for (double& value : r.datasets.at("/levels/step_potential")) {
           value = 1e-3;
         }
       }},
  };
  const auto [quadrature, quadrature_told] = run_of(program, problem);
  missed_in_all += missed_of(problem, quadrature, quadrature_told, by_L);
  problem.quadrature = OrbitProblem::Quadrature::midpoint;
  problem.step = 0.1;
  const Twin midpoint[] = {{"gamma", [](Stored& r, Json&) { value_of(r, "/levels/gamma", 5) *= 1 + 2e-12; }}};
  const auto [rule, rule_told] = run_of(program, problem);
  return missed_in_all + missed_of(problem, rule, rule_told, midpoint);
}

}  // namespace audit
