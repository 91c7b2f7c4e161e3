#include <rubato/run/level_check.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

#include <rubato/base/limits.hpp>
#include <rubato/record/run_shape.hpp>

namespace rubato {

namespace {

constexpr double none = std::numeric_limits<double>::quiet_NaN();

class LevelCheck {
public:
  LevelCheck(const record::Reader& reader, const StoredLevels& levels, const Problem& problem,
             const CheckpointDisagreements& checkpoint, Disagreements& findings)
      : reader_(reader),
        levels_(levels),
        problem_(problem),
        fixed_(problem.scheme.levels == Levels::fixed),
        checkpoint_(checkpoint),
        findings_(findings) {}

  void run() {
    check_times();
    check_stored_levels();
    check_levels_of_laws();
    check_flags();
    check_law();
    check_potential();
    check_columns();
  }

private:
  [[nodiscard]] std::size_t step_rows() const { return levels_.h.size(); }

  void refuse(const std::string& dataset, std::size_t row, double stored, const std::string& reason) {
    findings_.add({.dataset = dataset, .row = row, .stored = stored, .reason = reason});
  }

  void check_times() {
    const std::vector<double>& t = levels_.t;
    const std::vector<double>& h = levels_.h;
    const std::optional<double> step = problem_.scheme.step;
    findings_.same("/levels/t", 0, {}, t.front(), problem_.start(), "the start of the problem");
    // Times are summed with compensation, each then rounded once; h as it is.
    double largest = 0.0;
    for (const double time : t) {
      largest = std::isfinite(time) ? std::max(largest, std::abs(time)) : largest;
    }
    const auto rounding = [largest] { return 2.0 * epsilon * largest; };
    const double direction = problem_.scheme.until < problem_.start() ? -1.0 : 1.0;
    for (std::size_t k = 0; k < h.size(); ++k) {
      if (fixed_ && step) {
        findings_.same("/levels/h", k, {}, h[k], *step, "the step of the problem");
        findings_.same("/levels/t", k + 1, {}, t[k + 1],
                       problem_.start() + static_cast<double>(levels_.level[k + 1]) * *step, "start + k step");
        continue;
      }
      if (levels_.level[k] + 1 == levels_.level[k + 1]) {
        findings_.compare("/levels/t", k + 1, {}, t[k + 1], t[k] + h[k], rounding, "t_k + h_k, from /levels/h");
        if (!(std::abs(t[k + 1] - (t[k] + h[k])) <= rounding())) {
          findings_.compare("/levels/h", k, {}, h[k], t[k + 1] - t[k], rounding, "t_{k+1} - t_k, from /levels/t");
        }
      } else {
        findings_.count(1);
        if (!(std::abs(h[k]) <= std::abs(t[k + 1] - t[k]) + rounding())) {
          refuse("/levels/h", k, h[k], "a step is no longer than all those since the level of the row before");
        }
      }
      if (!(h[k] * direction > 0.0 && (t[k + 1] - t[k]) * direction > 0.0)) {
        refuse("/levels/h", k, h[k], "levels go one way");
      }
    }
    if (!h.empty() && step && !fixed_ && levels_.level[1] == 1) {
      // The first step is taken as it is; the rounding of start + step is not in it.
      findings_.same("/levels/h", 0, {}, h.front(), *step, "the step of the problem");
    }
  }

  void check_stored_levels() {
    for (std::size_t row = 0; row < levels_.state_level.size(); ++row) {
      const std::size_t level = levels_.state_level[row];
      findings_.same("/states/level", row, {}, levels_.reported_level[row], static_cast<double>(level),
                     "every n-th level is stored, and the last");
      if (const auto at = levels_.row_of(level)) {
        findings_.same("/states/t", row, {}, levels_.state_t[row], levels_.t[*at], "/levels/t of that level");
      }
      if (levels_.sparse && !levels_.evolving_alone) {
        check_previous_time(row);
      }
    }
  }

  void check_previous_time(std::size_t row) {
    constexpr const char* path = "/states/previous/t";
    const std::size_t level = levels_.state_level[row];
    const double stored = levels_.previous_t[row];
    if (const auto at = levels_.row_of(level == 0 ? 0 : level - 1)) {
      findings_.same(path, row, {}, stored, levels_.t[*at], "/levels/t of the level before");
    } else if (const auto step = levels_.step_to(row)) {
      const double expected = levels_.state_t[row] - levels_.h[*step];
      // Levels are t_0 + k h: k h is rounded, then the sum, at both levels, and then their difference.
      findings_.compare(
          path, row, {}, stored, expected,
          [&] {
            return epsilon *
                   (std::abs(levels_.t.front()) + 2.5 * std::max(std::abs(levels_.state_t[row]), std::abs(expected)));
          },
          "the stored level less its step, /levels/h");
    }
  }

  void check_levels_of_laws() {
    if (problem_.laws.every <= 1) {
      return;
    }
    StoredRows taken(reader_, std::string(figures::laws_taken));
    require_rows(taken, levels_.t.size());
    for (std::size_t k = 0; k < taken.rows(); ++k) {
      findings_.same(taken.path(), k, {}, taken.at(k), problem_.laws.taken_at(levels_.level[k]) ? 1.0 : 0.0,
                     "[laws] every of the problem");
    }
  }

  void check_flags() {
    StoredRows iterations(reader_, "/levels/iterations");
    require_rows(iterations, step_rows());
    const std::string flags = record::off_law_path(reader_);
    for (std::size_t k = 0; k < step_rows(); ++k) {
      findings_.same("/levels/step", k, {}, levels_.reported_step[k], static_cast<double>(levels_.level[k + 1] - 1),
                     levels_.rows_every == 1 ? "steps are numbered from 0"
                                             : "that of the step to every n-th level, and to the last");
      const double off_law = levels_.off_law[k];
      findings_.count(2);
      if ((off_law != 0.0 && off_law != 1.0) || (fixed_ && off_law != 0.0)) {
        refuse(flags, k, off_law, fixed_ ? "fixed levels have no law to be off" : "it is 0 or 1");
      }
      if (!(iterations.at(k) >= 0.0)) {
        refuse("/levels/iterations", k, iterations.at(k), "it counts");
      }
    }
  }

  /// What a step on the law may be off E by, as TimeLevels has it: the tolerance, or where that is less what
  /// rounding in E_k and in h leaves; |h dE/dh| follows from the step condition. The law is judged before a constant is
  /// added to the energies.
  [[nodiscard]] double allowed(double energy, double target, double rounding, double condition) const {
    const double miss = std::abs(energy - target);
    const double slope = condition > 0.0 ? (miss + rounding) / condition : 0.0;
    // Without a checkpoint the size of the terms is at least as large as their rounding says.
    const double of_terms = checkpoint_.is_checked ? checkpoint_.energy_terms : rounding / epsilon;
    const double terms = std::max(of_terms, std::abs(target));
    return 1.01 * std::max(problem_.scheme.tolerance * terms, 2.0 * (rounding + epsilon * slope)) +
           4.0 * epsilon * std::abs(target);
  }

  void check_law() {
    if (!reader_.has("/levels/target")) {
      return;  // a record of an earlier version
    }
    StoredRows energy(reader_, "/levels/energy"), target(reader_, "/levels/target"),
        rounding(reader_, "/levels/rounding"), condition(reader_, "/levels/step_condition");
    for (StoredRows* rows : {&energy, &target, &rounding, &condition}) {
      require_rows(*rows, step_rows());
    }
    double law = none;
    bool one_law = true;
    for (std::size_t k = 0; k < step_rows(); ++k) {
      const double E = target.at(k);
      one_law = one_law && (std::isnan(law) || std::isnan(E) || E == law);
      law = std::isnan(law) ? E : law;
    }
    const bool autonomous = is_autonomous();
    bool met = false;
    for (std::size_t k = 0; k < step_rows(); ++k) {
      const bool off_law = levels_.off_law[k] != 0.0;
      const double E = target.at(k);
      if (autonomous && !one_law) {
        findings_.same("/levels/target", k, {}, E, std::isnan(E) && !met ? E : law, "there is one E for the run");
      }
      if (std::isnan(E) && (met || !off_law)) {
        refuse("/levels/target", k, E, "a step on the law has set E");
      }
      met = met || !std::isnan(E);
      if (!(rounding.at(k) >= 0.0) || !std::isfinite(rounding.at(k))) {
        refuse("/levels/rounding", k, rounding.at(k), "it is a bound");
      }
      const double c = condition.at(k);
      if (fixed_ ? !std::isnan(c) : !off_law && !(c >= 0.0 && std::isfinite(c))) {
        refuse("/levels/step_condition", k, c, fixed_ ? "fixed levels have none" : "it is finite on steps of the law");
      }
      if (!fixed_ && !off_law) {
        findings_.compare(
            "/levels/energy", k, {}, energy.at(k), E, [&] { return allowed(energy.at(k), E, rounding.at(k), c); },
            "E of the law in /levels/target, which a step that is not in " + record::off_law_path(reader_) + " meets");
      }
    }
  }

  /// f'(h) of every step. Elementary functions may round differently on another machine.
  void check_potential() {
    if (levels_.potential.empty() || !checkpoint_.is_checked) {
      return;
    }
    for (std::size_t k = 0; k < step_rows(); ++k) {
      const double expected = checkpoint_.potential.energy(levels_.h[k]);
      findings_.compare(
          "/levels/step_potential", k, {}, levels_.potential[k], expected,
          [&] { return Rounding::unit * std::abs(expected); }, "f'(h) of the step potential in the checkpoint");
    }
  }

  /// 𝕃 may depend on t only where the user wrote it, or H does.
  [[nodiscard]] bool is_autonomous() const { return problem_.scheme.lagrangian != LagrangianName::custom; }

  /// What has to be a number everywhere.
  void check_columns() {
    for (const char* path : {"/levels/t", "/levels/h", "/levels/energy"}) {
      StoredRows rows(reader_, path);
      for (std::size_t k = 0; k < rows.rows(); ++k) {
        findings_.count(1);
        if (!std::isfinite(rows.at(k))) {
          refuse(path, k, rows.at(k), "there has to be a number");
        }
      }
    }
  }

  void require_rows(const StoredRows& rows, std::size_t wanted) const {
    if (rows.rows() != wanted) {
      throw record::Error(reader_.file(),
                          fmt::format("{} has {} rows, and {} are needed", rows.path(), rows.rows(), wanted));
    }
  }

  const record::Reader& reader_;
  const StoredLevels& levels_;
  const Problem& problem_;
  bool fixed_;
  const CheckpointDisagreements& checkpoint_;
  Disagreements& findings_;
};

}  // namespace

void check_levels(const record::Reader& reader, const StoredLevels& levels, const Problem& problem,
                  const CheckpointDisagreements& checkpoint, Disagreements& findings) {
  LevelCheck(reader, levels, problem, checkpoint, findings).run();
}

}  // namespace rubato
