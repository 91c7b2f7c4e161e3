#include <rubato/run/ensemble_member.hpp>

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <iterator>
#include <limits>
#include <string_view>
#include <utility>

#include <fmt/format.h>

#include <rubato/base/interrupt.hpp>
#include <rubato/figures/text.hpp>
#include <rubato/record/error.hpp>
#include <rubato/run/ensemble_lanes.hpp>
#include <rubato/run/last_rows.hpp>
#include <rubato/run/observed_run.hpp>
#include <rubato/run/warnings.hpp>

namespace rubato {

namespace {

/// A run of one member to its end. \throws ProblemError
class Member {
public:
  Member(const Problem& problem, const std::vector<std::string>& figures, const MemberDesk& desk, std::size_t at_once)
      : problem_(problem),
        names_(figures),
        desk_(desk),
        at_once_(at_once),
        observed_(problem, false),
        rows_(observed_.layout()) {}

  [[nodiscard]] const record::Layout& layout() const { return observed_.layout(); }

  /// \return nothing where something is not a number among the steps taken at once: which shows one by one
  std::optional<MemberResult> run() {
    try {
      observed_.append_start(rows_);
      while (result_.status == ExitStatus::done && !simulation().finished() && !observed_.stopped()) {
        next_steps();
      }
    } catch (const record::NotFinite& undefined) {
      end_undefined(undefined.what_is());
    }
    if (is_undefined_ && simulation().taken().size() > 1) {
      return std::nullopt;
    }
    finish();
    return std::move(result_);
  }

private:
  [[nodiscard]] Simulation& simulation() { return observed_.simulation(); }

  void end_undefined(const std::string& what) {
    result_.status = ExitStatus::failed;
    result_.message = fmt::format("{} at t = {:.10g}", what, simulation().t());
    is_undefined_ = true;
  }

  void next_steps() {
    if (desk_.halted()) {
      result_.status = ExitStatus::interrupted;
      return;
    }
    const std::size_t steps = observed_.statistics().steps, most = static_cast<std::size_t>(problem_.scheme.max_steps);
    if (steps >= most) {
      result_.status = ExitStatus::failed;
      result_.message =
          fmt::format("max_steps = {} reached at t = {:.10g}", problem_.scheme.max_steps, simulation().t());
      return;
    }
    const Interruptible here(desk_.interrupt());
    observed_.take(std::min(most - steps, at_once_));
    if (simulation().interrupted()) {
      result_.status = ExitStatus::interrupted;
      return;
    }
    if (!simulation().taken().empty()) {
      observed_.append_steps(rows_);
      if (!simulation().is_defined()) {
        result_.status = ExitStatus::failed;
        result_.message = fmt::format("the node energy or Gamma is not finite at t = {:.10g}", simulation().t());
        return;
      }
    }
    const StepReport& report = simulation().report();
    if (report.status != Status::success) {
      const bool singular = report.status == Status::singular || report.status == Status::ill_conditioned;
      result_.status = singular ? ExitStatus::singular : ExitStatus::failed;
      result_.message = simulation().integrator().explain(report);
    }
  }

  void finish() {
    try {
      if (result_.status != ExitStatus::failed && observed_.last_stored() != observed_.statistics().steps) {
        observed_.append_state(rows_);
      }
    } catch (const record::NotFinite&) {
      result_.status = ExitStatus::failed;
    }
    if (has_failed(result_.status)) {
      observed_.meter().end_early(simulation().t(), problem_.scheme.until);
    }
    const figures::Statistics statistics = observed_.final_statistics();
    result_.warnings = simulation().cautions();
    for (std::string& sentence : warnings_of(problem_, observed_, statistics)) {
      result_.warnings.push_back(std::move(sentence));
    }
    result_.judgement = figures::judge(statistics);
    if (result_.status == ExitStatus::done && result_.judgement.verdict == figures::Verdict::lost) {
      result_.status = ExitStatus::lost;
    }
    figures::JsonObject figures;
    figures::add_figures(figures, statistics);
    for (const std::string& name : names_) {
      result_.figures.push_back(figures.find(name).value_or(std::numeric_limits<double>::quiet_NaN()));
    }
    for (std::size_t i = 0; i < layout().datasets.size(); ++i) {
      if (is_last_state(layout().datasets[i])) {
        result_.states.push_back(rows_.kept(i));
      }
      if (is_kept_whole(layout().datasets[i])) {
        result_.series.push_back(rows_.kept(i));
      }
    }
  }

  const Problem& problem_;
  const std::vector<std::string>& names_;
  const MemberDesk& desk_;
  std::size_t at_once_;
  bool is_undefined_ = false;
  ObservedRun observed_;
  LastRows rows_;
  MemberResult result_;
};

/// A member by itself. \return whether it came to an end of its own
bool take_alone(const Problem& ensemble, std::size_t number, const std::vector<std::string>& figures,
                MemberDesk& desk) {
  const Problem problem = member_problem(ensemble, number);
  std::optional<MemberResult> result = Member(problem, figures, desk, std::numeric_limits<std::size_t>::max()).run();
  if (!result) {
    result = Member(problem, figures, desk, 1).run();
  }
  if (result->status == ExitStatus::interrupted) {
    return false;
  }
  desk.hand_in(number, std::move(*result));
  return true;
}

/// One thread: members until there are no more, as many at once as go side by side.
void take_members(const Problem& ensemble, const std::vector<std::string>& figures, MemberDesk& desk) {
  try {
    const std::unique_ptr<MemberLanes> lanes = MemberLanes::make(ensemble, figures);
    std::vector<std::size_t> numbers;
    std::size_t at_once = 1;
    do {
      at_once = lanes == nullptr ? 1 : lanes->width();
      numbers.clear();
      while (numbers.size() < at_once) {
        const std::optional<std::size_t> number = desk.next();
        if (!number) {
          break;
        }
        numbers.push_back(*number);
      }
      std::vector<std::optional<MemberResult>> results(numbers.size());
      if (lanes != nullptr && !numbers.empty()) {
        results = lanes->run(numbers, desk);
      }
      // The first one last: members are published in their order, and these together.
      for (std::size_t i = numbers.size(); i-- > 0;) {
        if (results[i]) {
          desk.hand_in(numbers[i], std::move(*results[i]));
        }
      }
      for (std::size_t i = 0; i < numbers.size(); ++i) {
        if (!results[i] && !take_alone(ensemble, numbers[i], figures, desk)) {
          return;
        }
      }
    } while (numbers.size() == at_once);
  } catch (...) {
    desk.fail(std::current_exception());
  }
}

}  // namespace

bool is_kept_whole(const record::Dataset& dataset) {
  return dataset.axis.starts_with("/events/") || dataset.axis == "/output/t";
}

bool is_last_state(const record::Dataset& dataset) {
  return dataset.path.starts_with("/states/") && dataset.axis == "/states/t" && dataset.type == record::Type::f64 &&
         dataset.path != "/states/t" && !dataset.path.starts_with("/states/previous/");
}

std::vector<std::string> figure_names(const Problem& member) {
  std::vector<std::string> names = {"steps",
                                    "t",
                                    "h/min",
                                    "h/max",
                                    "discrete_energy/value",
                                    "discrete_energy/max_relative_deviation",
                                    "discrete_energy/max_deviation",
                                    "step_potential/max",
                                    "step_potential/kappa",
                                    "step_potential/p",
                                    "step_potential/from",
                                    "step_potential/to",
                                    "node_energy/initial",
                                    "node_energy/max_deviation",
                                    "off_law/steps",
                                    "off_law/max_deviation",
                                    "gamma/min",
                                    "gamma/max",
                                    "step_condition/max",
                                    "newton_iterations/mean",
                                    "newton_iterations/max"};
  const auto simulation = make_simulation(member);
  const auto add = [&names](std::string_view group, const std::vector<std::string>& of,
                            std::initializer_list<std::string_view> keys) {
    for (const std::string& name : of) {
      for (const std::string_view key : keys) {
        names.push_back(fmt::format("{}/{}/{}", group, name, key));
      }
    }
  };
  std::vector<std::string> residuals;
  for (const std::string& law : simulation->law_names()) {
    if (law.starts_with(figures::constraint_group)) {
      names.push_back(law + "/max");
      names.push_back(law + "/rms");
    } else {
      residuals.push_back(law);
    }
  }
  add("residuals", residuals, {"max", "rms"});
  for (std::size_t i = 0; i < member.scheme.tangents.vectors; ++i) {
    names.push_back(fmt::format("lyapunov/exponents/{}", i + 1));
  }
  if (member.scheme.tangents.vectors > 0) {
    names.emplace_back("lyapunov/megno");
  }
  if (member.scheme.tangents.vectors > 1) {
    names.emplace_back("symplecticity/max");
  }
  add("invariants", simulation->invariant_names(), {"initial", "max_deviation"});
  add("totals", simulation->total_names(), {"initial", "max_deviation"});
  std::vector<std::string> events;
  std::ranges::transform(member.events, std::back_inserter(events), &StatedEvent::name);
  add("events", events, {"count", "first", "last"});
  if (std::ranges::any_of(member.events, [](const StatedEvent& event) { return event.stop_after > 0; })) {
    names.emplace_back("stopped/t");
  }
  std::vector<std::string> exact;
  for (const Named<Spread>& error : simulation->errors()) {
    exact.push_back(error.name);
  }
  add("error", exact, {"max", "rms"});
  return names;
}

void run_members(const Problem& ensemble, const std::vector<std::string>& figures, MemberDesk& desk) {
#pragma omp parallel default(shared)
  take_members(ensemble, figures, desk);
}

}  // namespace rubato
