#include "audit/orbit_audit.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <stdexcept>

#include <fmt/format.h>

#include "audit/orbit_judge.hpp"
#include "audit/random.hpp"

namespace audit {

namespace {

/// The statuses of a run that leave a record.
bool leaves_record(int status) {
  return status == 0 || status == 3 || status == 4;
}

class OrbitAudit {
public:
  OrbitAudit(std::string program, const OrbitProblem& problem, Findings& findings)
      : program_(std::move(program)), problem_(problem), findings_(findings) {}

  void audit() {
    const Call run = call_run(problem_, "run");
    if (run.status == 2 && problem_.energy_tolerance) {
      return;  // no first step is small enough
    }
    if (!leaves_record(run.status)) {
      findings_.add("status", fmt::format("{}: {}", run.status, run.errors));
      return;
    }
    told_ = parse_json(run.output);
    record_ = read_record(folder_.path() / "run.h5");
    if (told_["status"] != run.status) {
      findings_.add("status", fmt::format("{} in the object, {} from the program", told_["status"], run.status));
    }
    judge_status(run);
    if (record_["/levels/h"].empty()) {
      return;
    }
    roundings_ = judge_orbit(problem_, record_, told_, findings_);
    check();
    resume(run.status);
    shift();
  }

private:
  Call call_run(const OrbitProblem& problem, const std::string& name, const std::string& until = "") {
    write_text(folder_.path() / (name + ".toml"), problem.toml());
    std::vector<std::string> words = {"run", name + ".toml", "--json", "-o", name + ".h5"};
    if (!until.empty()) {
      words.insert(words.end(), {"--set", "scheme.until=" + until});
    }
    return call(program_, words, folder_.path());
  }

  /// Whether the run ended where it says.
  void judge_status(const Call& run) {
    const std::vector<double>&t = record_["/levels/t"], &h = record_["/levels/h"];
    const double direction = problem_.until < problem_.start_time ? -1.0 : 1.0;
    const double left = direction * (problem_.until - t.back());
    const double slack = h.empty() ? 0.0 : 2e-9 * std::abs(h.back());
    const bool reached = left <= slack;
    if ((run.status == 0) != reached) {
      findings_.add("status", fmt::format("{} with {} left of the time", run.status, left));
    }
    if (h.size() > 1 && direction * (problem_.until - t[t.size() - 2]) < -slack) {
      findings_.add("status", "the run went on past its end");
    }
    const bool limited = run.errors.find("max_steps") != std::string::npos;
    if (limited != (run.status == 4 && h.size() == static_cast<std::size_t>(problem_.max_steps))) {
      findings_.add("status", fmt::format("{} after {} steps: {}", run.status, h.size(), run.errors));
    }
    if ((run.status == 0) != (run.errors.find("error: ") == std::string::npos)) {
      findings_.add("status", fmt::format("{} with the message {}", run.status, run.errors));
    }
    const auto finished = record_.attributes.find("finished");
    if (finished == record_.attributes.end() || (finished->second != 0.0) != reached) {
      findings_.add("status", "the record's attribute `finished` is not true");
    }
  }

  void check() {
    const Call object = call(program_, {"check", "run.h5", "--json"}, folder_.path());
    if (object.status != 0) {
      findings_.add("check", fmt::format("status {}: {}", object.status, object.errors));
      if (object.output.empty()) {
        return;
      }
    }
    const Json told = parse_json(object.output);
    compare_accounts(told_, told, roundings_, problem_.every > 1, findings_);
    compare_table(call(program_, {"check", "run.h5"}, folder_.path()).output, told, 0, findings_);
    compare_table(call(program_, {"compare", "run.h5", "run.h5"}, folder_.path()).output, told_, 1, findings_);
  }

  /// A run to the middle and on from there is the run to the end, bit by bit.
  void resume(int status) {
    if (problem_.energy_tolerance) {
      return;  // the first step is chosen by trial runs, which know the end
    }
    const std::vector<double>& t = record_["/levels/t"];
    const double middle = t[t.size() / 2];
    if (t.size() < 4) {
      return;
    }
    const Call first = call_run(problem_, "resumed", fmt::format("{:.17g}", middle));
    if (first.status != 0) {
      findings_.add("resume", fmt::format("the run to t = {} ends with {}: {}", middle, first.status, first.errors));
      return;
    }
    const Call second =
        call(program_, {"resume", "resumed.h5", "--json", "--until", fmt::format("{:.17g}", problem_.until)},
             folder_.path());
    if (second.status != status) {
      findings_.add("resume", fmt::format("status {} in place of {}: {}", second.status, status, second.errors));
      return;
    }
    same_account("resume", told_, parse_json(second.output), findings_);
    const Stored resumed = read_record(folder_.path() / "resumed.h5");
    for (const auto& [path, values] : record_.datasets) {
      const auto found = resumed.datasets.find(path);
      const bool same = found != resumed.datasets.end() && found->second.size() == values.size() &&
                        std::equal(values.begin(), values.end(), found->second.begin(),
                                   [](double a, double b) { return a == b || (std::isnan(a) && std::isnan(b)); });
      if (!same) {
        findings_.add("resume", path + " is not the same");
      }
    }
  }

  /// A constant added to H changes no step by more than rounding explains.
  void shift() {
    Random random(static_cast<std::uint64_t>(record_["/levels/h"].size()) + 77);
    OrbitProblem shifted = problem_;
    const double constant =
        random.sign() * Random::short_number(static_cast<double>(roundings_.scale)) * random.decades(0, 2.9);
    if (problem_.energy_tolerance || !std::isfinite(constant)) {
      return;
    }
    shifted.H = shifted.H + constant;
    shifted.L = shifted.L - constant;
    const Call run = call_run(shifted, "shifted");
    if (!leaves_record(run.status)) {
      findings_.add("constant in H", fmt::format("+ {}: status {}: {}", constant, run.status, run.errors));
      return;
    }
    compare_steps(constant, read_record(folder_.path() / "shifted.h5"));
  }

  /// Each step is determined by the energy law up to (tolerance + rounding) / |h dE/dh|, which the step condition gives
  /// in units of its own; later steps inherit what earlier ones were off, with a factor for the motion in between.
  void compare_steps(double constant, const Stored& shifted) {
    constexpr long double inherited = 100.0L;
    const std::vector<double>&h = record_["/levels/h"], &h_shifted = shifted["/levels/h"];
    const std::vector<double>&flags = record_["/levels/bridged"], &flags_shifted = shifted["/levels/bridged"];
    const std::vector<double>&condition = record_["/levels/step_condition"],
          &condition_shifted = shifted["/levels/step_condition"];
    // The condition is ε·scale/|h dE/dh| with a scale of at least |H|, and so bounds what the tolerance does.
    long double uncertain = 0.0L;
    for (std::size_t k = 0; k < std::min<std::size_t>(h.size(), 40); ++k) {
      if (k >= h_shifted.size()) {
        if (uncertain < 1e-6L) {
          findings_.add("constant in H",
                        fmt::format("+ {}: {} steps in place of {}", constant, h_shifted.size(), h.size()));
        }
        return;
      }
      const long double worst = std::max(condition[k], condition_shifted[k]);
      uncertain += worst * (problem_.tolerance / (2 * unit_roundoff) + 8);
      if (flags[k] != 0.0 || flags_shifted[k] != 0.0) {
        uncertain = std::max(uncertain, 1e-12L) * 10;  // a bridge is found to some accuracy only
      }
      const long double limit = inherited * (uncertain + 8 * unit_roundoff);
      if (!(limit < 1e-3L)) {
        return;
      }
      if (flags[k] != flags_shifted[k]) {
        findings_.add("constant in H", fmt::format("+ {}: step {} is flagged in one run only", constant, k));
        return;
      }
      const long double off = std::abs(static_cast<long double>(h_shifted[k]) / h[k] - 1);
      findings_.within("constant in H", off, limit, [&] {
        return fmt::format("+ {}: step {} is {} in place of {}, off by {:.2g} in place of {:.2g}", constant, k,
                           h_shifted[k], h[k], static_cast<double>(off), static_cast<double>(limit));
      });
    }
  }

  std::string program_;
  const OrbitProblem& problem_;
  Findings& findings_;
  Folder folder_;
  Json told_;
  Stored record_;
  Roundings roundings_;
};

}  // namespace

void audit_orbit(const std::string& program, std::uint64_t number, Findings& findings) {
  const OrbitProblem problem = random_orbit(number);
  try {
    OrbitAudit(program, problem, findings).audit();
  } catch (const std::exception& error) {
    findings.add("exception", error.what());
  }
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

int orbit_twins(const std::string& program) {
  // A rotating pendulum: some of its steps are bridges.
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
  const Folder folder;
  write_text(folder.path() / "p.toml", problem.toml());
  const Call run = call(program, {"run", "p.toml", "--json", "-o", "p.h5"}, folder.path());
  const Json told = parse_json(run.output);
  const Stored record = read_record(folder.path() / "p.h5");
  const auto bridge =
      static_cast<std::size_t>(std::ranges::find(record["/levels/bridged"], 1.0) - record["/levels/bridged"].begin());
  // Each by a few units of what rounding may be at that place.
  const Twin twins[] = {
      {"step equation", [](Stored& r, Json&) { value_of(r, "/states/q", 9) += 1e-14; }},
      {"step equation", [&](Stored& r, Json&) { value_of(r, "/states/p", bridge + 1) += 1e-13; }},
      {"step equation", [](Stored& r, Json&) { value_of(r, "/levels/h", 9) *= 1 + 1e-13; }},
      {"energy law", [&](Stored& r, Json&) { value_of(r, "/levels/bridged", bridge) = 0; }},
      {"energy law", [](Stored&, Json& j) { j.numbers["discrete_energy.value"] *= 1 + 1e-12; }},
      {"stored energy", [](Stored& r, Json&) { value_of(r, "/levels/energy", 5) += 4e-14; }},
      {"node energy", [](Stored& r, Json&) { value_of(r, "/levels/node_energy", 5) *= 1 + 2e-14; }},
      {"gamma", [](Stored& r, Json&) { value_of(r, "/levels/gamma", 5) *= 1 + 2e-13; }},
      {"invariant", [](Stored& r, Json&) { value_of(r, "/laws/product", 5) *= 1 + 2e-14; }},
      {"times", [](Stored& r, Json&) { value_of(r, "/levels/t", 20) += 1e-14; }},
      {"sign of h", [](Stored& r, Json&) { value_of(r, "/levels/h", 20) *= -1; }},
      {"stored levels", [](Stored& r, Json&) { value_of(r, "/states/level", 20) += 1; }},
      {"told steps", [](Stored&, Json& j) { j.numbers["steps"] += 1; }},
      {"told bridges.steps", [](Stored&, Json& j) { j.numbers["bridges.steps"] = 0; }},
      {"told bridges.max_deviation", [](Stored&, Json& j) { j.numbers["bridges.max_deviation"] = 0; }},
      {"told gamma.min", [](Stored&, Json& j) { j.numbers["gamma.min"] += 1e-12; }},
      {"told node_energy.max_deviation", [](Stored&, Json& j) { j.numbers["node_energy.max_deviation"] = 0; }},
  };
  Findings none;
  judge_orbit(problem, record, told, none);
  int missed = 0;
  for (const auto& [kind, text] : none.list) {
    fmt::print("FAILED: the undamaged record: {}: {}\n", kind, text);
    ++missed;
  }
  for (const Twin& twin : twins) {
    Stored damaged = record;
    Json damaged_account = told;
    twin.damage(damaged, damaged_account);
    Findings found;
    judge_orbit(problem, damaged, damaged_account, found);
    if (!found.has(twin.kind)) {
      fmt::print("FAILED: a record with a wrong \"{}\" was taken for good\n", twin.kind);
      ++missed;
    }
  }
  return missed;
}

}  // namespace audit
