#include "terminal.hpp"

#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>

#include <fmt/format.h>

#include <rubato/base/utf8.hpp>

namespace rubato::program {
namespace {

bool is_set(const char* variable) {
  const char* const value = std::getenv(variable);
  return value != nullptr && *value != '\0';
}

bool has_colour() {
  const char* const terminal = std::getenv("TERM");
  const bool is_dumb = terminal == nullptr || std::strcmp(terminal, "dumb") == 0;
  return isatty(STDERR_FILENO) != 0 && !is_set("NO_COLOR") && !is_dumb;
}

void print_message(std::string_view kind, std::string_view colour, std::string_view message) {
  // Not fmt::print, which throws where standard error cannot be written: then there is nobody to show.
  const std::string shown = printable(message);
  const std::string text = has_colour() ? fmt::format("rubato: \x1b[1;{}m{}:\x1b[0m {}\n", colour, kind, shown)
                                        : fmt::format("rubato: {}: {}\n", kind, shown);
  std::fputs(text.c_str(), stderr);
}

std::string duration(double seconds) {
  const auto whole = static_cast<long long>(std::ceil(seconds));
  if (whole < 60) {
    return fmt::format("{} s", whole);
  }
  if (whole < 3600) {
    return fmt::format("{} min {:02} s", whole / 60, whole % 60);
  }
  return fmt::format("{} h {:02} min", whole / 3600, whole / 60 % 60);
}

}  // namespace

void print_error(std::string_view message) {
  print_message("error", "31", message);
}
void print_warning(std::string_view message) {
  print_message("warning", "33", message);
}

void print(std::string_view unchecked) {
  const std::string text = printable(unchecked);
  if (std::fwrite(text.data(), 1, text.size(), stdout) != text.size() || std::fflush(stdout) != 0) {
    throw rubato::FileError("standard output cannot be written");
  }
}

ProgressLine::ProgressLine() : begin_(std::chrono::steady_clock::now()), is_terminal_(isatty(STDERR_FILENO) != 0) {}

ProgressLine::~ProgressLine() {
  if (is_dirty_) {
    std::fputs("\r\x1b[K", stderr);
  }
}

void ProgressLine::begin() {
  std::fputs("\r\x1b[Kpreparing the first step", stderr);
  std::fflush(stderr);
  is_dirty_ = true;
}

void ProgressLine::update(const rubato::Progress& progress) {
  if (!is_terminal_) {
    return;
  }
  if (!is_updated_) {
    first_t_ = progress.t;
  }
  is_updated_ = true;
  const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - begin_;
  const double done = (progress.t - first_t_) / (progress.until - first_t_);
  const std::string left = done > 0.001 ? duration(elapsed.count() * (1 - done) / done) + " left" : "";
  const std::string off_law = progress.off_law > 0 ? fmt::format("  {} off the law", progress.off_law) : "";
  const std::string line =
      progress.members > 0
          ? fmt::format("\r\x1b[K{} of {} members  {}", progress.steps, progress.members, left)
          : fmt::format("\r\x1b[Kt = {:.6g} of {:.6g}  {} steps  h = {:.3g}  energy {:.1e}{}  {}", progress.t,
                        progress.until, progress.steps, progress.h, progress.energy_deviation, off_law, left);
  std::fputs(line.c_str(), stderr);
  std::fflush(stderr);
  is_dirty_ = true;
}

}  // namespace rubato::program
