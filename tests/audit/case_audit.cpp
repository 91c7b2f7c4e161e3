#include "audit/case_audit.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <fmt/format.h>

#include "audit/random.hpp"

namespace audit {

namespace {

/// The statuses of a run that reached its end; 7: with a result that is lost.
bool is_complete(int status) {
  return status == 0 || status == 7;
}
/// Those of a run that leaves a record.
bool leaves_record(int status) {
  return is_complete(status) || status == 3 || status == 4;
}

class CaseAudit {
public:
  CaseAudit(std::string program, const Case& which, Disagreements& findings)
      : program_(std::move(program)), case_(which), rules_(which.rules), findings_(findings) {}

  void audit() {
    const Call run = call_run(case_.problem, "run");
    if (run.status == 2 && case_.automatic) {
      return;  // no first step is small enough
    }
    if (!leaves_record(run.status)) {
      findings_.add("status", fmt::format("{}: {}", run.status, run.errors));
      return;
    }
    reported_ = parse_json(run.output);
    record_ = read_record(folder_.path() / "run.h5");
    if (reported_["status"] != run.status) {
      findings_.add("status", fmt::format("{} in the object, {} from the program", reported_["status"], run.status));
    }
    judge_status(run);
    if (record_["/levels/h"].empty()) {
      return;
    }
    roundings_ = case_.judge(record_, reported_, findings_);
    check();
    resume(run.status);
    shift();
  }

private:
  Call call_run(const std::string& problem, const std::string& name, const std::string& until = "") {
    write_text(folder_.path() / (name + ".toml"), problem);
    std::vector<std::string> words = {"run", name + ".toml", "--json", "-o", name + ".h5"};
    if (!until.empty()) {
      words.insert(words.end(), {"--set", "scheme.until=" + until});
    }
    return call(program_, words, folder_.path());
  }

  /// Whether the run ended where it says.
  void judge_status(const Call& run) {
    const std::vector<double>&t = record_["/levels/t"], &h = record_["/levels/h"];
    const double direction = rules_.until < rules_.start ? -1.0 : 1.0;
    const double left = direction * (rules_.until - t.back());
    const double slack = h.empty() ? 0.0 : 2e-9 * std::abs(h.back());
    const bool reached = left <= slack;
    if (is_complete(run.status) != reached) {
      findings_.add("status", fmt::format("{} with {} left of the time", run.status, left));
    }
    if (h.size() > 1 && direction * (rules_.until - t[t.size() - 2]) < -slack) {
      findings_.add("status", "the run went on past its end");
    }
    const bool limited = run.errors.find("max_steps") != std::string::npos;
    if (limited != (run.status == 4 && h.size() == static_cast<std::size_t>(case_.max_steps))) {
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
    const Json reported = parse_json(object.output);
    compare_accounts(reported_, reported, roundings_, rules_.every > 1, findings_);
    compare_table(call(program_, {"check", "run.h5"}, folder_.path()).output, reported, 0, findings_);
    compare_table(call(program_, {"compare", "run.h5", "run.h5"}, folder_.path()).output, reported_, 1, findings_);
  }

  /// A run to the middle and on from there is the run to the end, bit by bit.
  void resume(int status) {
    if (case_.automatic) {
      return;
    }
    const std::vector<double>& t = record_["/levels/t"];
    const double middle = t[t.size() / 2];
    if (t.size() < 4) {
      return;
    }
    const Call first = call_run(case_.problem, "resumed", fmt::format("{:.17g}", middle));
    if (!is_complete(first.status)) {
      findings_.add("resume", fmt::format("the run to t = {} ends with {}: {}", middle, first.status, first.errors));
      return;
    }
    const Call second = call(
        program_, {"resume", "resumed.h5", "--json", "--until", fmt::format("{:.17g}", rules_.until)}, folder_.path());
    if (second.status != status) {
      findings_.add("resume", fmt::format("status {} in place of {}: {}", second.status, status, second.errors));
      return;
    }
    same_account("resume", reported_, parse_json(second.output), findings_);
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
    const double constant =
        random.sign() * Random::short_number(static_cast<double>(roundings_.scale)) * random.decades(0, 2.9);
    if (case_.automatic || !std::isfinite(constant)) {
      return;
    }
    const Call run = call_run(case_.shifted(constant), "shifted");
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
    const std::vector<double>&flags = record_["/levels/off_law"], &flags_shifted = shifted["/levels/off_law"];
    const std::vector<double>&condition = record_["/levels/step_condition"],
          &condition_shifted = shifted["/levels/step_condition"];
    // The condition is ε·scale/|h dE/dh| with a scale of at least |H|, and so bounds what the tolerance does.
    long double uncertain = 0.0L;
    for (std::size_t k = 0; k < std::min<std::size_t>(h.size(), 40); ++k) {
      if (k >= h_shifted.size()) {
        // A step of condition 1e-2 is refused, and the constant's rounding is part of it.
        const long double refused = condition[k] * (1 + std::abs(constant) / roundings_.scale);
        if (uncertain < 1e-6L && refused < 2e-3L) {
          findings_.add("constant in H",
                        fmt::format("+ {}: {} steps in place of {}", constant, h_shifted.size(), h.size()));
        }
        return;
      }
      const long double worst = std::max(condition[k], condition_shifted[k]);
      uncertain += worst * (rules_.tolerance / (2 * unit_roundoff) + 8);
      if (flags[k] != 0.0 || flags_shifted[k] != 0.0) {
        uncertain = std::max(uncertain, 1e-12L) * 10;  // when the law is met again depends on last digits
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
  const Case& case_;
  const LevelRules& rules_;
  Disagreements& findings_;
  Folder folder_;
  Json reported_;
  Stored record_;
  Roundings roundings_;
};

}  // namespace

void audit_case(const std::string& program, const Case& which, Disagreements& findings) {
  try {
    CaseAudit(program, which, findings).audit();
  } catch (const std::exception& error) {
    findings.add("exception", error.what());
  }
}

}  // namespace audit
