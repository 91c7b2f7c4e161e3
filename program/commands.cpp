#include "commands.hpp"

#include <algorithm>

#include <fmt/format.h>

#include <rubato/study/browse.hpp>
#include <rubato/study/check.hpp>

#include "signals.hpp"
#include "terminal.hpp"

namespace rubato::program {
namespace {

/// Prints an outcome, and answers with its status.
study::ExitStatus report(const study::Outcome& outcome, bool json, bool quiet) {
  if (json) {
    print(study::to_json(outcome) + "\n");
  } else if (!quiet) {
    print(study::to_table(outcome));
  }
  if (!quiet) {
    for (const std::string& warning : outcome.warnings) {
      print_warning(warning);
    }
  }
  if (!outcome.message.empty()) {
    print_error(outcome.message);
  }
  return outcome.status;
}

/// Carries out `work` with a progress line, and reports its outcome.
template <typename Work>
study::ExitStatus report_on(const Reporting& reporting, study::RunOptions options, const Work& work) {
  options.threads = reporting.threads;
  options.interrupt = &catch_interrupts();
  const auto outcome = [&] {
    ProgressLine line;
    if (line.is_shown() && !reporting.quiet) {
      options.progress = [&line](const study::Progress& progress) { line.update(progress); };
    }
    return work(options);
  }();
  return report(outcome, reporting.json, reporting.quiet);
}

}  // namespace

study::ExitStatus run(const RunCommand& command) {
  const study::Problem problem = study::read_problem(command.problem, command.settings);
  study::RunOptions options;
  options.output = command.output;
  options.overwrite = command.force;
  options.tangents = command.tangents;
  return report_on(command.reporting, options,
                   [&](const study::RunOptions& complete) { return study::run(problem, complete); });
}

study::ExitStatus resume(const ResumeCommand& command) {
  return report_on(command.reporting, {}, [&](const study::RunOptions& complete) {
    return study::resume(command.file, command.until, complete);
  });
}

study::ExitStatus check(const CheckCommand& command) {
  return report(study::check(command.file), command.json, false);
}

study::ExitStatus list() {
  const auto items = study::list_catalogue();
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
  return study::ExitStatus::done;
}

study::ExitStatus show(const std::string& name) {
  print(study::show_catalogue(name));
  return study::ExitStatus::done;
}

}  // namespace rubato::program
