#pragma once

#include <chrono>
#include <string_view>

#include <rubato/run/run.hpp>

namespace rubato::program {

/// "rubato: error: …" and "rubato: warning: …" on standard error; in colour on a terminal, unless NO_COLOR is set.
void print_error(std::string_view message);
void print_warning(std::string_view message);

/// Writes to standard output. Here, and in messages, what a file or an argument contains cannot command the terminal
/// (rubato::printable).
/// \throws rubato::FileError if that fails, as on a full disk
void print(std::string_view text);

/// One line on standard error, rewritten as the run goes on; nothing if that is not a terminal.
class ProgressLine {
public:
  ProgressLine();
  ProgressLine(const ProgressLine&) = delete;
  ProgressLine& operator=(const ProgressLine&) = delete;
  ~ProgressLine();  ///< wipes the line

  [[nodiscard]] bool is_shown() const { return is_terminal_; }
  /// Says that the run has been taken up, before it has a level to report.
  void begin();
  void update(const rubato::Progress& progress);

private:
  std::chrono::steady_clock::time_point begin_;
  double first_t_ = 0.0;  ///< where this process began, which after `resume` is not the start of the run
  bool is_terminal_;
  bool is_dirty_ = false, is_updated_ = false;
};

}  // namespace rubato::program
