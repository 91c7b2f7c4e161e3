#include "commands.hpp"

#include <algorithm>

#include <fmt/format.h>

#include <rubato/base/quoted.hpp>
#include <rubato/problem/browse.hpp>
#include <rubato/problem/effective.hpp>
#include <rubato/problem/form.hpp>
#include <rubato/record/error.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/report/xdmf.hpp>
#include <rubato/run/advise.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/converge.hpp>
#include <rubato/run/ensemble.hpp>
#include <rubato/run/run_estimate.hpp>
#include <rubato/run/solve.hpp>

#include "beside.hpp"
#include "probe.hpp"
#include "signals.hpp"
#include "terminal.hpp"

namespace rubato::program {
namespace {

ranks::Communicator* other_ranks = nullptr;

/// Prints an outcome, and answers with its status. `said`: warnings that were printed already.
rubato::ExitStatus report(const rubato::Outcome& outcome, bool json, bool quiet,
                          const std::vector<std::string>& said = {}) {
  if (json) {
    print(rubato::to_json(outcome) + "\n");
  } else if (!quiet) {
    print(rubato::to_table(outcome));
  }
  if (!quiet) {
    for (const std::string& warning : outcome.warnings) {
      if (std::ranges::find(said, warning) == said.end()) {
        print_warning(warning);
      }
    }
  }
  if (!outcome.message.empty()) {
    print_error(outcome.message);
  }
  return outcome.status;
}

/// Beside the record of a plane or a volume, the small file that lets ParaView open it.
void write_xdmf(rubato::Outcome& outcome) {
  if (outcome.axes < 2) {
    return;
  }
  const std::string file = beside(outcome.file, ".xdmf");
  try {
    report::export_xdmf(record::Reader(outcome.file), file);
  } catch (const record::AlreadyExists&) {
    outcome.warnings.push_back(fmt::format(
        "{} is left as it is, since it was not written for this record; `rubato export --xdmf --force` replaces it",
        file));
  } catch (const record::Error& error) {
    outcome.warnings.push_back(fmt::format("{} was not written ({})", file, error.what()));
  }
}

/// Carries out `work` with a progress line. `said`: the warnings it printed.
template <typename Work>
auto with_progress(const Reporting& reporting, rubato::RunOptions options, std::vector<std::string>& said,
                   const Work& work) {
  Interruption& interruption = catch_interrupts();
  options.threads = reporting.threads;
  options.lock = !reporting.no_lock;
  options.interrupt = &interruption.asked;
  options.storing = &interruption.storing;
  options.ranks = other_ranks;
  ProgressLine line;
  if (!reporting.quiet) {
    options.caution = [&said](const std::string& sentence) {
      print_warning(sentence);
      said.push_back(sentence);
    };
  }
  if (line.is_shown() && !reporting.quiet) {
    line.begin();
    options.progress = [&line](const rubato::Progress& progress) { line.update(progress); };
  }
  return work(options);
}

/// Carries out `work` on an ensemble, and reports its outcome; with `rows`, of every member.
template <typename Work>
rubato::ExitStatus report_members(const Reporting& reporting, const rubato::RunOptions& options, bool rows,
                                  const Work& work) {
  std::vector<std::string> said;
  const rubato::EnsembleOutcome outcome = with_progress(reporting, options, said, work);
  if (reporting.json) {
    print(rubato::to_json(outcome) + "\n");
  } else if (!reporting.quiet) {
    print(rubato::to_table(outcome, rows));
  }
  if (!reporting.quiet) {
    for (const std::string& warning : outcome.findings.warnings("members")) {
      print_warning(warning);
    }
  }
  if (!outcome.message.empty()) {
    print_error(outcome.message);
  }
  return outcome.status;
}

/// "path=from:to:count" or "path=a,b,c" as an entry of [ensemble] grid.
std::string grid_setting(const std::string& entry) {
  const std::size_t equals = entry.find('=');
  if (equals == std::string::npos || equals == 0 || entry.find('.') > equals) {
    throw rubato::ProblemError({entry.substr(0, 200), 0, 0},
                               "expected table.key=from:to:count, or table.key=a,b,c: what to change, and its values");
  }
  const std::string path = entry.substr(0, equals), values = entry.substr(equals + 1);
  std::string list;
  if (values.find(':') == std::string::npos) {
    for (std::size_t begin = 0; begin <= values.size();) {
      const std::size_t end = std::min(values.find(',', begin), values.size());
      list += fmt::format("{}{}", list.empty() ? "" : ", ", rubato::setting_value(values.substr(begin, end - begin)));
      begin = end + 1;
    }
    return fmt::format("ensemble.grid.{}=[{}]", path, list);
  }
  return fmt::format("ensemble.grid.{}={}", path, rubato::quoted(values));
}

/// Carries out `work` with a progress line, and reports its outcome.
template <typename Work>
rubato::ExitStatus report_on(const Reporting& reporting, const rubato::RunOptions& options, const Work& work) {
  std::vector<std::string> said;
  rubato::Outcome outcome = with_progress(reporting, options, said, work);
  if (!outcome.file.empty()) {
    write_xdmf(outcome);
  }
  return report(outcome, reporting.json, reporting.quiet, said);
}

}  // namespace

void share_with(ranks::Communicator* ranks) {
  other_ranks = ranks;
}

rubato::ExitStatus run(const RunCommand& command) {
  rubato::Problem problem = rubato::read_problem(command.problem, command.settings);
  rubato::RunOptions options;
  options.output = command.output;
  options.overwrite = command.force;
  if (!command.tangents.empty()) {
    if (problem.hamiltonian() != nullptr) {  // an entry of the problem, which its record has
      const std::string name = problem.name;
      problem = rubato::parse_problem(problem.text, problem.source, std::vector{"scheme.tangents=" + command.tangents});
      problem.name = name;
    } else {
      options.tangents = true;
    }
  }
  if (command.dry_run) {
    options.threads = command.reporting.threads;
    options.ranks = other_ranks;
    const rubato::RunEstimate estimate = rubato::dry_run(problem, options);
    if (command.reporting.json || !command.reporting.quiet) {
      print(command.reporting.json ? rubato::to_json(estimate) + "\n" : rubato::to_table(estimate));
    }
    return rubato::ExitStatus::done;
  }
  refuse_replacing(command.problem, command.output.value_or(problem.output.file));
  if (problem.ensemble) {
    return report_members(command.reporting, options, false,
                          [&](const rubato::RunOptions& complete) { return rubato::run_ensemble(problem, complete); });
  }
  return report_on(command.reporting, options,
                   [&](const rubato::RunOptions& complete) { return rubato::run(problem, complete); });
}

rubato::ExitStatus scan(const ScanCommand& command) {
  RunCommand run = command.run;
  for (const std::string& entry : command.entries) {
    run.settings.push_back(grid_setting(entry));
  }
  const rubato::Problem problem = rubato::read_problem(run.problem, run.settings);
  rubato::RunOptions options;
  options.output = run.output.value_or(problem.name + "-scan.h5");
  options.overwrite = run.force;
  refuse_replacing(run.problem, *options.output);
  return report_members(run.reporting, options, true,
                        [&](const rubato::RunOptions& complete) { return rubato::run_ensemble(problem, complete); });
}

rubato::ExitStatus converge(const ConvergeCommand& command) {
  const rubato::Problem problem = rubato::read_problem(command.problem, command.settings);
  std::vector<std::string> said;
  const Reporting quiet{.json = command.reporting.json, .quiet = true, .threads = command.reporting.threads};
  const rubato::ConvergenceOutcome outcome = with_progress(quiet, {}, said, [&](const rubato::RunOptions& options) {
    const rubato::Storing storing(options.storing);  // its folder of records is removed by it, whatever ends it
    return rubato::converge(problem, command.tolerance, options);
  });
  if (command.reporting.json) {
    print(rubato::to_json(outcome) + "\n");
  } else if (outcome.ended) {
    print(rubato::to_table(outcome));
  }
  for (const std::string& warning : outcome.findings.warnings("runs")) {
    print_warning(warning);
  }
  if (!outcome.message.empty()) {
    print_error(outcome.message);
  }
  return outcome.status;
}

rubato::ExitStatus advise(const ConvergeCommand& command) {
  const rubato::Problem problem = rubato::read_problem(command.problem, command.settings);
  std::vector<std::string> said;
  const Reporting quiet{.json = command.reporting.json, .quiet = true, .threads = command.reporting.threads};
  const rubato::Advice advice = with_progress(quiet, {}, said, [&](const rubato::RunOptions& options) {
    const rubato::Storing storing(options.storing);  // as of converge()
    return rubato::advise(problem, command.tolerance, options);
  });
  if (advice.status != rubato::ExitStatus::interrupted) {
    print(command.reporting.json ? rubato::to_json(advice) + "\n" : rubato::to_table(advice));
  }
  if (!advice.message.empty()) {
    print_error(advice.message);
  }
  return advice.status;
}

rubato::ExitStatus solve(const SolveCommand& command) {
  const rubato::Problem problem = rubato::read_problem(command.problem, command.settings);
  const std::string file = command.output.value_or(problem.output.file);
  refuse_replacing(command.problem, file);
  const rubato::SolveOutcome outcome = rubato::solve_problem(problem, {.output = file,
                                                                       .overwrite = command.force,
                                                                       .lock = !command.reporting.no_lock,
                                                                       .threads = command.reporting.threads});
  if (command.reporting.json) {
    print(rubato::to_json(outcome) + "\n");
  } else if (!command.reporting.quiet) {
    print(rubato::to_table(outcome));
  }
  for (const std::string& warning : outcome.warnings) {
    print_warning(warning);
  }
  if (!outcome.message.empty()) {
    print_error(outcome.message);
  }
  return outcome.status;
}

rubato::ExitStatus resume(const ResumeCommand& command) {
  probe_record(command.file);
  if (rubato::is_ensemble(record::Reader(command.file))) {
    if (command.until) {
      throw rubato::ProblemError({"--until", 0, 0},
                                 "the members of an ensemble end where its problem says; leave it out");
    }
    return report_members(command.reporting, {}, false, [&](const rubato::RunOptions& complete) {
      return rubato::resume_ensemble(command.file, complete);
    });
  }
  return report_on(command.reporting, {}, [&](const rubato::RunOptions& complete) {
    return rubato::resume(command.file, command.until, complete);
  });
}

rubato::ExitStatus check(const CheckCommand& command) {
  probe_record(command.file);
  if (rubato::is_ensemble(record::Reader(command.file, record::Altered::reported))) {
    return report_members({.json = command.json}, {}, false, [&](const rubato::RunOptions& complete) {
      return rubato::check_ensemble(command.file, complete);
    });
  }
  return report(rubato::check(command.file, {.replay = command.replay, .ranks = other_ranks}), command.json, false);
}

rubato::ExitStatus list() {
  const auto items = rubato::list_catalogue();
  std::size_t width = 0;
  for (const auto& item : items) {
    width = std::max(width, item.name.size());
  }
  std::string text;
  std::optional<bool> group;
  for (const auto& item : items) {
    if (group != item.is_lattice) {
      text += fmt::format("{}{}\n", group ? "\n" : "",
                          item.is_lattice ? "Partial differential equations" : "Ordinary differential equations");
      group = item.is_lattice;
    }
    text += fmt::format("  {:<{}}  {}\n", item.name, width, item.title);
  }
  print(text);
  return rubato::ExitStatus::done;
}

rubato::ExitStatus show(const std::string& name, std::span<const std::string> settings) {
  const std::string text(rubato::show_catalogue(name));
  print(rubato::effective_document(text, name + ".toml (built-in)", settings).text);
  return rubato::ExitStatus::done;
}

rubato::ExitStatus show_form(const std::string& problem, const std::string& style,
                             std::span<const std::string> settings) {
  const auto place = std::ranges::find(rubato::form_styles, style) - rubato::form_styles.begin();
  print(rubato::form_of(rubato::read_problem(problem, settings), static_cast<rubato::FormStyle>(place)));
  return rubato::ExitStatus::done;
}

}  // namespace rubato::program
