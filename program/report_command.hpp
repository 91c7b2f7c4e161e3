#pragma once

#include <optional>
#include <string>

#include <CLI/CLI.hpp>

#include <rubato/run/run.hpp>

namespace rubato::program {

/// The commands that look at records: report, compare, export. They describe themselves to the command line, and the
/// one that was chosen is carried out by act().
class ReportCommands {
public:
  void add_to(CLI::App& app);

  /// Nothing if none of them was chosen. Errors are thrown as by the other commands.
  [[nodiscard]] std::optional<rubato::ExitStatus> act() const;

private:
  void add_report(CLI::App& app);
  void add_compare(CLI::App& app);
  void add_size(CLI::App& command);
  void add_export(CLI::App& app);
  void report() const;
  void compare() const;
  void export_record() const;

  CLI::App* report_ = nullptr;
  CLI::App* compare_ = nullptr;
  CLI::App* export_ = nullptr;
  std::string file_, other_file_;
  std::optional<std::string> output_;
  std::string field_;
  double max_size_ = 5.0;
  bool full_ = false, force_ = false, json_ = false, xdmf_ = false;
};

}  // namespace rubato::program
