#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <new>
#include <string>
#include <vector>

#include <malloc.h>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <CLI/CLI.hpp>

#include <rubato/base/memory.hpp>
#include <rubato/problem/browse.hpp>
#include <rubato/problem/form.hpp>
#include <rubato/problem/help.hpp>
#include <rubato/problem/initial_record.hpp>
#include <rubato/ranks/communicator.hpp>
#include <rubato/record/error.hpp>
#include <rubato/run/ensemble_ranks.hpp>
#include <rubato/run/threads.hpp>
#include <rubato/run/version.hpp>

#include "commands.hpp"
#include "completion.hpp"
#include "manual.hpp"
#include "probe.hpp"
#include "report_command.hpp"
#include "signals.hpp"
#include "terminal.hpp"

namespace {

/// Lets waiting threads sleep: threads that spin take the processor from those they wait for. OpenMP reads its
/// environment before main(), but after this if the program links OpenMP's static library.
[[gnu::constructor(101)]] void wait_passively() {
  setenv("OMP_WAIT_POLICY", "passive", 0);
}

/// Large blocks are mappings of their own, which go back to the system when they are freed. By default the heap takes
/// blocks of up to 32 MiB once one as large was freed, and keeps the room between them.
[[gnu::constructor]] void give_large_blocks_back() {
#ifdef M_MMAP_THRESHOLD
  constexpr int large = 1 << 22;  // as grids::Buffer has it
  mallopt(M_MMAP_THRESHOLD, large);
#endif
}

using rubato::ExitStatus;
using rubato::program::print_error;

constexpr const char* description =
    "Variational integration with variable time levels.\n"
    "A problem is a small TOML file; `rubato show pendulum` prints one to start from.";

constexpr const char* examples =
    "Examples:\n"
    "  rubato list                          the built-in problems\n"
    "  rubato show pendulum > mine.toml     a problem file to start from\n"
    "  rubato run mine.toml                 run it: writes mine.h5 or the file it names\n"
    "  rubato run kepler --set parameters.e=0.3 -o kepler.h5\n"
    "  rubato scan pendulum initial.p=0.1:3:30   a run for each value, and one table\n"
    "  rubato converge mine.toml            errors and orders, by runs with smaller steps\n"
    "  rubato advise mine.toml              the cheapest schemes and steps, by trials\n"
    "  rubato solve mine.toml               an orbit between two ends, or a periodic one\n"
    "  rubato resume mine.h5 --until 200    continue from the last level\n"
    "  rubato check mine.h5                 recompute every law from the stored states\n"
    "  rubato report mine.h5                writes mine.html: a page of plots, for a browser\n"
    "  rubato compare mine.h5 fixed.h5      two records side by side\n"
    "  rubato export mine.h5                CSV files, for spreadsheets and other programs\n"
    "  rubato help formulas                 functions of formulas; help problem: every key of a file;\n"
    "                                       help table: every line of the table that a run prints\n"
    "\n"
    "Exit status: 0 done; 2 input or usage wrong; 3 stopped at a singular point of the step\n"
    "equation; 4 the solver failed; 5 a file could not be read or written; 6 (check) the record\n"
    "contradicts itself; 7 the run reached its end, but its result is lost (see the verdict);\n"
    "130 interrupted.\n";

constexpr const char* run_examples =
    "Examples:\n"
    "  rubato run mine.toml\n"
    "  rubato run pendulum --set scheme.step=0.05 --set scheme.until=20*pi\n"
    "  rubato run pendulum --set scheme.levels=fixed -o fixed.h5 --force\n"
    "  rubato run mine.toml --set scheme.lagrangian=midpoint --unset scheme.stages -o midpoint.h5\n"
    "  generate | rubato run - -o mine.h5\n"
    "  rubato run pendulum --json | python3 -m json.tool\n"
    "  rubato run mine.toml --dry-run       estimate memory and time\n";

/// A whole number of threads, or the reason why not.
std::string check_threads(const std::string& text) {
  constexpr int most = rubato::most_threads;
  int threads = 0;
  const bool is_number = CLI::detail::lexical_cast(text, threads);
  return is_number && threads >= 1 && threads <= most
             ? ""
             : fmt::format("{} is not a number of threads from 1 to {}", text, most);
}

std::string check_finite(const std::string& text) {
  double number = 0;
  return CLI::detail::lexical_cast(text, number) && std::isfinite(number) ? "" : text + " is not a finite number";
}

std::string check_positive(const std::string& text) {
  double number = 0;
  return CLI::detail::lexical_cast(text, number) && std::isfinite(number) && number > 0.0
             ? ""
             : text + " is not a number above 0";
}

std::string check_removal(const std::string& text) {
  return text.find('=') == std::string::npos
             ? ""
             : fmt::format("{}: expected table.key, without a value; --set changes one", text.substr(0, 200));
}

std::string check_not_empty(const std::string& text) {
  return text.empty() ? "the name is empty" : "";
}

void add_reporting(CLI::App& command, rubato::program::Reporting& reporting) {
  command.add_flag("--json", reporting.json, "Print one JSON object, and nothing else, on standard output");
  command.add_flag("-q,--quiet", reporting.quiet, "Print no progress line, table or warnings");
  command
      .add_option("--threads", reporting.threads,
                  "Number of threads (default: OMP_NUM_THREADS; else one, or all processors for large problems)")
      ->option_text("N")
      ->check(check_threads);
  command.add_flag("--no-lock", reporting.no_lock,
                   "Write without a lock, on a file system that has none; no other run may write the record then");
}

/// The command line: its options are stored where the commands find them, and the command chosen is carried out by
/// act().
class CommandLine {
public:
  CommandLine() : app_(description, "rubato") {
    app_.set_version_flag("--version", fmt::format("rubato {}", rubato::version()));
    app_.require_subcommand(1);
    add_run();
    add_scan();
    add_converge();
    add_advise();
    add_solve();
    add_resume();
    add_check();
    reports_.add_to(app_);
    app_.add_subcommand("list", "List the catalogue")
        ->footer("Every name is a problem that `rubato run NAME` runs and `rubato show NAME` prints.\n");
    CLI::App& show = *app_.add_subcommand("show", "Print a complete problem file of the catalogue");
    show.add_option("name", name_, "A catalogue name; with --form, a problem file as well")
        ->option_text("NAME")
        ->required();
    CLI::Option* form =
        show.add_flag("--form", form_,
                      "Print what is derived from a field equation: densities, M, K and S, constraints, "
                      "symmetries, dispersion, schemes");
    show.add_option("--as", form_style_, "How --form is printed: text, toml (to put in place of [field]) or latex")
        ->option_text("STYLE")
        ->needs(form)
        ->check(CLI::IsMember(std::vector<std::string>(rubato::form_styles.begin(), rubato::form_styles.end())));
    add_changes(show, show_settings_);
    show.footer(
        "Examples:\n  rubato show pendulum > mine.toml\n"
        "  rubato show kepler --set parameters.e=0.3 --unset exact > mine.toml\n"
        "  rubato show --form mine.toml\n  rubato show --form --as latex mine.toml\n");
    CLI::App& help = *app_.add_subcommand("help", "Explain formulas, problem files, a table of one or a command");
    help.add_option("topic", name_, "formulas, problem, table, a table of a problem file such as scheme, or a command")
        ->option_text("TOPIC");
    help.add_flag("--man", man_, "Print the manual page, for man -l");
    help.footer(
        "Examples:\n  rubato help formulas   functions, operators, names\n  rubato help problem    every key of a "
        "problem file\n  rubato help scheme     every key of one of its tables\n  rubato help table      every line "
        "of the table that a run prints\n");
    CLI::App& completion = *app_.add_subcommand("completion", "Print a script that makes a shell complete commands");
    completion.add_option("shell", name_, "bash, zsh or fish")->option_text("SHELL")->required();
    completion.footer("Example:\n  source <(rubato completion bash)\n");
    app_.footer(examples);  // last: a command would inherit it
  }

  [[nodiscard]] ExitStatus act(int argc, char** argv) {
    try {
      app_.parse(argc, argv);
    } catch (const CLI::ParseError& error) {
      return explain(error, argc, argv);
    }
    if (app_.got_subcommand("run")) {
      return rubato::program::run(run_);
    }
    if (app_.got_subcommand("scan")) {
      return rubato::program::scan(scan_);
    }
    if (app_.got_subcommand("converge")) {
      return rubato::program::converge(converge_);
    }
    if (app_.got_subcommand("advise")) {
      return rubato::program::advise(advise_);
    }
    if (app_.got_subcommand("solve")) {
      return rubato::program::solve(solve_);
    }
    records_ = files_read(*app_.get_subcommands().front());
    rubato::program::explain_crashes(records_);  // all others read records
    if (app_.got_subcommand("resume")) {
      return rubato::program::resume(resume_);
    }
    if (app_.got_subcommand("check")) {
      return rubato::program::check(check_);
    }
    if (const auto status = reports_.act()) {
      return *status;
    }
    if (app_.got_subcommand("help")) {
      if (man_) {
        rubato::program::print(rubato::program::manual(app_));
        return ExitStatus::done;
      }
      return help();
    }
    if (app_.got_subcommand("completion")) {
      rubato::program::print(rubato::program::completion(app_, name_));
      return ExitStatus::done;
    }
    return app_.got_subcommand("list") ? rubato::program::list()
           : form_                     ? rubato::program::show_form(name_, form_style_, show_settings_)
                                       : rubato::program::show(name_, show_settings_);
  }

  /// The records that the command chosen reads, "a.h5, b.h5"; empty if none.
  [[nodiscard]] const std::string& records() const { return records_; }

private:
  [[nodiscard]] std::vector<std::string> command_names() {
    std::vector<std::string> names;
    for (const CLI::App* command : app_.get_subcommands({})) {
      names.push_back(command->get_name());
    }
    return names;
  }

  /// A topic, a command, or everything.
  ExitStatus help() {
    std::vector<std::string> known = command_names();
    const auto& topics = rubato::help_topics();
    if (name_.empty()) {
      // App::help() would be that of the command chosen, which is this one.
      rubato::program::print(app_.get_formatter()->make_help(&app_, app_.get_name(), CLI::AppFormatMode::Normal));
    } else if (std::ranges::find(topics, name_) != topics.end()) {
      rubato::program::print(rubato::help_text(name_));
    } else if (std::ranges::find(known, name_) != known.end()) {
      rubato::program::print(app_.get_subcommand(name_)->help("rubato"));
    } else {
      known.insert(known.end(), topics.begin(), topics.end());
      const std::string guess = rubato::did_you_mean(name_, known);
      print_error(
          fmt::format("there is no help on {}; {}\nTopics: {}. Commands: see rubato --help", name_.substr(0, 100),
                      guess.empty() ? "it is neither a topic, nor a table of problem files, nor a command" : guess,
                      fmt::join(topics, ", ")));
      return ExitStatus::wrong_input;
    }
    return ExitStatus::done;
  }

  [[nodiscard]] static std::string files_read(const CLI::App& command) {
    std::string files;
    for (const CLI::Option* const option : command.get_options()) {
      for (const std::string& file : option->get_positional() ? option->results() : std::vector<std::string>()) {
        files += (files.empty() ? "" : ", ") + file;
      }
    }
    return files;
  }

  static void add_source(CLI::App& command, std::string& problem, std::vector<std::string>& settings) {
    command.add_option("problem", problem, "A problem file, a catalogue name, or - for standard input")
        ->option_text("PROBLEM")
        ->check(check_not_empty)
        ->required();
    add_changes(command, settings);
  }

  /// --set and --unset, both of which are settings of a problem.
  static void add_changes(CLI::App& command, std::vector<std::string>& settings) {
    command
        .add_option_function<std::vector<std::string>>(
            "--set",
            [&settings](const std::vector<std::string>& changes) {
              settings.insert(settings.end(), changes.begin(), changes.end());
            },
            "Change one entry of the problem; repeatable")
        ->option_text("table.key=value")
        ->allow_extra_args(false);
    command
        .add_option_function<std::vector<std::string>>(
            "--unset",
            [&settings](const std::vector<std::string>& removed) {
              for (const std::string& entry : removed) {
                settings.push_back("-" + entry);
              }
            },
            "Remove one entry of the problem, or a table; repeatable; before any --set")
        ->option_text("table.key")
        ->check(check_removal)
        ->allow_extra_args(false);
  }

  /// What commands that write the record of a problem have in common.
  static void add_problem(CLI::App& command, rubato::program::RunCommand& run, const std::string& default_file) {
    add_source(command, run.problem, run.settings);
    command.add_option("-o,--output", run.output, fmt::format("The record to write (default: {})", default_file))
        ->option_text("OUT.h5")
        ->check(check_not_empty);
    command.add_flag("-f,--force", run.force, "Overwrite an existing record");
  }

  void add_scan() {
    CLI::App& command = *app_.add_subcommand("scan", "Run a problem for many values of its entries");
    add_problem(command, scan_.run, "the problem's name with -scan.h5");
    command.add_option("entries", scan_.entries, "What to change: from:to:count, or values with commas between them")
        ->option_text("table.key=from:to:count ...")
        ->required();
    add_reporting(command, scan_.run.reporting);
    command.footer(
        "Every combination is a member: a run of its own. The table has a line for each.\n"
        "Examples:\n"
        "  rubato scan pendulum initial.p=0.1:3:30\n"
        "  rubato scan kepler scheme.step=0.1,0.05,0.025 parameters.e=0:0.8:5 --json\n");
  }

  /// Common options of the commands that run a problem several times and write nothing.
  static void add_trials(CLI::App& command, rubato::program::ConvergeCommand& trials, const std::string& meaning) {
    add_source(command, trials.problem, trials.settings);
    command.add_option("--tolerance", trials.tolerance, meaning)->option_text("T")->check(check_positive);
    command.add_flag("--json", trials.reporting.json, "Print one JSON object, and nothing else, on standard output");
    command.add_option("--threads", trials.reporting.threads, "Number of threads (default: OpenMP's)")
        ->option_text("N")
        ->check(check_threads);
  }

  void add_advise() {
    CLI::App& command = *app_.add_subcommand("advise", "Try schemes and steps on a problem, and rank them by cost");
    add_trials(command, advise_,
               "The error at which schemes are compared, relative to the largest coordinate, momentum or field "
               "(default: that of the problem as it stands, at most 1e-3)");
    command.footer(
        "Every scheme that takes the problem gets the step (and cells) at which halves and quarters of the\n"
        "step estimate that error, at the end of trials of about a second. The time is that of the whole run.\n"
        "Examples:\n"
        "  rubato advise kepler --tolerance 1e-6\n"
        "  rubato advise sine-gordon --json\n");
  }

  void add_converge() {
    CLI::App& command =
        *app_.add_subcommand("converge", "Estimate errors by runs with halves and quarters of the step");
    add_trials(command, converge_, "Print the step that would reach this error, relative to each quantity");
    command.footer(
        "Conservation laws can hold on a wrong orbit, so they do not estimate the error. This command does.\n"
        "Example:\n"
        "  rubato converge kepler --tolerance 1e-3\n");
  }

  void add_run() {
    CLI::App& command = *app_.add_subcommand("run", "Run a problem and write its record");
    add_problem(command, run_, "as the problem says");
    command
        .add_flag("--tangents{2}", run_.tangents,
                  "Integrate tangent solutions as well: of a lattice two random ones, for the multisymplectic "
                  "residual; of an "
                  "orbit K tangent vectors (--tangents=4, --tangents=all), as [scheme] tangents")
        ->option_text("[=K]");
    command.add_flag("--dry-run", run_.dry_run,
                     "Run nothing: estimate memory, time and the size of the record from a few steps");
    add_reporting(command, run_.reporting);
    command.footer(run_examples);
  }

  void add_solve() {
    CLI::App& command =
        *app_.add_subcommand("solve", "Solve a boundary-value problem of an orbit and write its record");
    add_source(command, solve_.problem, solve_.settings);
    command.add_option("-o,--output", solve_.output, "Write the record here (default: as the problem says)")
        ->option_text("OUT.h5")
        ->check(check_not_empty);
    command.add_flag("-f,--force", solve_.force, "Replace an existing record");
    add_reporting(command, solve_.reporting);
    command.footer(
        "[solve] of the problem says what holds at the ends: rubato help solve. The guess is [initial],\n"
        "integrated until the end of [scheme]. Exit status 4: no solution was found, and nothing written.\n"
        "Examples:\n"
        "  rubato solve examples/pendulum-to-a-place.toml\n"
        "  rubato solve examples/henon-heiles-orbit.toml --set solve.energy=0.1 --json\n");
  }

  void add_resume() {
    CLI::App& command = *app_.add_subcommand("resume", "Continue a record from its last complete level");
    command.add_option("file", resume_.file, "A record")->option_text("OUT.h5")->check(check_not_empty)->required();
    command.add_option("--until", resume_.until, "Run to this time instead of the problem's")
        ->option_text("T")
        ->check(check_finite);
    add_reporting(command, resume_.reporting);
    command.footer(
        "The result has the same bits as one uninterrupted run of the problem in the record.\n"
        "Examples:\n"
        "  rubato resume mine.h5                 to the problem's until\n"
        "  rubato resume mine.h5 --until 200     further\n");
  }

  void add_check() {
    CLI::App& command =
        *app_.add_subcommand("check", "Recompute every derived quantity from the stored states and compare");
    command.add_option("file", check_.file, "A record")->option_text("OUT.h5")->check(check_not_empty)->required();
    command.add_flag("--json", check_.json, "Print one JSON object, and nothing else, on standard output");
    command.add_flag("--replay", check_.replay,
                     "Repeat every step as well and compare bit by bit; takes as long as the run");
    command.footer(
        "Every stored quantity that follows from the stored states is recomputed and compared.\n"
        "Exit status 0: it agrees; 6: the record contradicts itself, and the table and\n"
        "\"disagreements\" in JSON name what disagrees; 5: it cannot be read.\n");
  }

  /// Help and version are asked for; everything else is a usage error.
  ExitStatus explain(const CLI::ParseError& error, int argc, char** argv) {
    if (error.get_exit_code() == 0) {
      return app_.exit(error) == 0 ? ExitStatus::done : ExitStatus::wrong_input;
    }
    std::string message = error.what();
    if (argc > 1 && app_.get_subcommands().empty()) {
      const std::vector<std::string> names = command_names();
      const std::string word = argv[1];
      message =
          word.starts_with('-') ? fmt::format("unknown option {}", word) : fmt::format("unknown command {}", word);
      if (const std::string guess = rubato::did_you_mean(word, names); !guess.empty()) {
        message += "; " + guess;
      }
    }
    const auto is_setting = [](const std::string& word) {
      return !word.starts_with('-') && word.find('=') != std::string::npos;
    };
    if (const std::vector<std::string> left = app_.remaining(true);
        !left.empty() && std::ranges::all_of(left, is_setting)) {
      message = fmt::format("{} stands alone: write --set before each setting, --set {}", left.front(),
                            fmt::join(left, " --set "));
    }
    const auto chosen = app_.get_subcommands();
    print_error(fmt::format("{}\nSee rubato {}--help", message, chosen.empty() ? "" : chosen[0]->get_name() + " "));
    return ExitStatus::wrong_input;
  }

  CLI::App app_;
  rubato::program::RunCommand run_;
  rubato::program::ScanCommand scan_;
  rubato::program::ConvergeCommand converge_, advise_;
  rubato::program::ResumeCommand resume_;
  rubato::program::SolveCommand solve_;
  rubato::program::CheckCommand check_;
  rubato::program::ReportCommands reports_;
  std::string name_, records_;
  std::vector<std::string> show_settings_;
  bool form_ = false, man_ = false;
  std::string form_style_ = "text";
};

/// What is wrong although nothing checked for it: with a record, or else with the problem that is run.
ExitStatus unforeseen(const std::string& records, std::string_view reason) {
  print_error(records.empty() || reason.find(records) != std::string_view::npos
                  ? std::string(reason)
                  : fmt::format("{}: {}", records, reason));
  return records.empty() ? ExitStatus::failed : ExitStatus::file_error;
}

std::string no_memory() {
  const rubato::AvailableMemory available = rubato::available_memory();
  return fmt::format("not enough memory: the process held {:.3g} GB, and {:.3g} GB is available ({})",
                     rubato::peak_memory() * 1e-9, available.bytes * 1e-9, available.limit);
}

ExitStatus guarded(int argc, char** argv) {
  CommandLine line;
  try {
    return line.act(argc, argv);
  } catch (const rubato::record::AlreadyExists& error) {
    print_error(fmt::format("{}; --force overwrites it, -o names another file", error.what()));
    return ExitStatus::wrong_input;
  } catch (const rubato::record::Error& error) {
    print_error(error.what());
    return ExitStatus::file_error;
  } catch (const rubato::FileError& error) {
    print_error(error.what());
    return ExitStatus::file_error;
  } catch (const std::invalid_argument& error) {
    print_error(error.what());
    return ExitStatus::wrong_input;
  } catch (const std::bad_alloc&) {
    return unforeseen(line.records(), no_memory());
  } catch (const std::length_error&) {
    return unforeseen(line.records(), no_memory());
  } catch (const std::exception& error) {
    return unforeseen(line.records(), error.what());
  }
}

/// The command is carried out by rank 0 alone, which shares out what it can; all others help it. Their own status does
/// not count.
ExitStatus by_ranks(int argc, char** argv) {
  // Longer than ranks take to see that they are done; one that does not is ended by the launcher.
  constexpr std::chrono::seconds patience{5};
  ExitStatus status = ExitStatus::done;
  try {
    const auto ranks = rubato::ranks::join();
    if (ranks->rank() == 0) {
      rubato::program::share_with(ranks.get());
      status = guarded(argc, argv);
      rubato::dismiss(*ranks);
    } else {
      rubato::program::Interruption& interruption = rubato::program::catch_interrupts();
      interruption.storing = true;  // what rank 0 stores may be at stake
      rubato::help_rank_0(*ranks, &interruption.asked);
    }
    std::fflush(nullptr);  // some launchers end all where one ends with another status than 0
    // With HDF5 for MPI the end of the job is that of HDF5: see main(). The launcher then ends the others.
    if (status != ExitStatus::file_error) {
      ranks->leave(patience);
    }
  } catch (const std::exception& error) {
    print_error(error.what());
    status = ExitStatus::failed;
  }
  return status;
}

}  // namespace

int main(int argc, char** argv) {
  rubato::program::keep_standard_streams();
  rubato::program::survive_file_limits();
  rubato::fail_beyond_available_memory();
  rubato::probe_sources_with(&rubato::program::probe_record);
  const ExitStatus status = by_ranks(argc, argv);
  if (status == ExitStatus::file_error) {
    // HDF5, at the end of the process, takes up again what it could not write or read, and may crash there.
    std::fflush(nullptr);
    std::_Exit(static_cast<int>(status));
  }
  return static_cast<int>(status);
}
