#include "commands.hpp"

#include <algorithm>

#include <fmt/format.h>

#include <rubato/record/error.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/report/xdmf.hpp>
#include <rubato/study/browse.hpp>
#include <rubato/study/check.hpp>

#include "beside.hpp"
#include "probe.hpp"
#include "signals.hpp"
#include "terminal.hpp"

namespace rubato::program {
namespace {

/// Prints an outcome, and answers with its status. `said`: warnings that were printed already.
study::ExitStatus report(const study::Outcome& outcome, bool json, bool quiet,
                         const std::vector<std::string>& said = {}) {
  if (json) {
    print(study::to_json(outcome) + "\n");
  } else if (!quiet) {
    print(study::to_table(outcome));
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
void write_xdmf(study::Outcome& outcome) {
  const std::string file = beside(outcome.file, ".xdmf");
  try {
    const record::Reader reader(outcome.file);
    if (reader.has("/grid/y")) {
      report::export_xdmf(reader, file);
    }
  } catch (const record::AlreadyExists&) {
    outcome.warnings.push_back(fmt::format(
        "{} is left as it is, since it was not written for this record; `rubato export --xdmf --force` replaces it",
        file));
  } catch (const record::Error& error) {
    outcome.warnings.push_back(fmt::format("{} was not written ({})", file, error.what()));
  }
}

/// Carries out `work` with a progress line, and reports its outcome.
template <typename Work>
study::ExitStatus report_on(const Reporting& reporting, study::RunOptions options, const Work& work) {
  options.threads = reporting.threads;
  options.interrupt = &catch_interrupts();
  std::vector<std::string> said;
  study::Outcome outcome = [&] {
    ProgressLine line;
    if (!reporting.quiet) {
      options.caution = [&said](const std::string& sentence) {
        print_warning(sentence);
        said.push_back(sentence);
      };
    }
    if (line.is_shown() && !reporting.quiet) {
      options.progress = [&line](const study::Progress& progress) { line.update(progress); };
    }
    return work(options);
  }();
  if (!outcome.file.empty()) {
    write_xdmf(outcome);
  }
  return report(outcome, reporting.json, reporting.quiet, said);
}

}  // namespace

study::ExitStatus run(const RunCommand& command) {
  const study::Problem problem = study::read_problem(command.problem, command.settings);
  study::RunOptions options;
  options.output = command.output;
  options.overwrite = command.force;
  options.tangents = command.tangents;
  refuse_replacing(command.problem, command.output.value_or(problem.output.file));
  return report_on(command.reporting, options,
                   [&](const study::RunOptions& complete) { return study::run(problem, complete); });
}

study::ExitStatus resume(const ResumeCommand& command) {
  probe_record(command.file);
  return report_on(command.reporting, {}, [&](const study::RunOptions& complete) {
    return study::resume(command.file, command.until, complete);
  });
}

study::ExitStatus check(const CheckCommand& command) {
  probe_record(command.file);
  return report(study::check(command.file, {.replay = command.replay}), command.json, false);
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
