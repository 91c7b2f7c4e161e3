#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include <rubato/run/run.hpp>

/// The commands of the program, each a thin call into problem/ and run/. Errors are thrown; main() turns them into exit
/// statuses.
namespace rubato::program {

/// What `run` and `resume` have in common.
struct Reporting {
  bool json = false;
  bool quiet = false;
  bool no_lock = false;
  int threads = 0;
};

struct RunCommand {
  std::string problem;
  std::vector<std::string> settings;
  std::optional<std::string> output;
  bool force = false;
  std::string tangents;  ///< how many, or "all"; empty for none
  bool dry_run = false;
  Reporting reporting;
};

struct ScanCommand {
  RunCommand run;
  std::vector<std::string> entries;  ///< "path=from:to:count", or "path=a,b,c"
};

/// `converge` and `advise`.
struct ConvergeCommand {
  std::string problem;
  std::vector<std::string> settings;
  std::optional<double> tolerance;
  Reporting reporting;
};

struct SolveCommand {
  std::string problem;
  std::vector<std::string> settings;
  std::optional<std::string> output;
  bool force = false;
  Reporting reporting;
};

struct ResumeCommand {
  std::string file;
  std::optional<double> until;
  Reporting reporting;
};

struct CheckCommand {
  std::string file;
  bool json = false;
  bool replay = false;
};

/// The ranks that share the command, of which this process is number 0; null for none.
void share_with(ranks::Communicator* ranks);

[[nodiscard]] rubato::ExitStatus run(const RunCommand& command);
[[nodiscard]] rubato::ExitStatus converge(const ConvergeCommand& command);
[[nodiscard]] rubato::ExitStatus advise(const ConvergeCommand& command);
[[nodiscard]] rubato::ExitStatus scan(const ScanCommand& command);
[[nodiscard]] rubato::ExitStatus solve(const SolveCommand& command);
[[nodiscard]] rubato::ExitStatus resume(const ResumeCommand& command);
[[nodiscard]] rubato::ExitStatus check(const CheckCommand& command);
[[nodiscard]] rubato::ExitStatus list();
[[nodiscard]] rubato::ExitStatus show(const std::string& name, std::span<const std::string> settings);
/// The [multisymplectic] of a problem, as it was derived from [field].
[[nodiscard]] rubato::ExitStatus show_form(const std::string& problem, const std::string& style,
                                           std::span<const std::string> settings);

}  // namespace rubato::program
