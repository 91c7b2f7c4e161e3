#include "signals.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <csignal>
#include <string>
#include <string_view>

#include <fmt/format.h>

#include <rubato/base/utf8.hpp>
#include <rubato/run/run.hpp>

namespace rubato::program {
namespace {

Interruption interruption;
static_assert(std::atomic<bool>::is_always_lock_free, "a signal handler may only touch lock-free atomics");

/// Only what is allowed in a signal handler.
extern "C" void on_signal(int /*number*/) {
  if (interruption.storing) {
    interruption.asked = true;
    return;
  }
  constexpr std::string_view message = "\nrubato: error: interrupted\n";
  static_cast<void>(!write(STDERR_FILENO, message.data(), message.size()));
  _exit(static_cast<int>(rubato::ExitStatus::interrupted));
}

/// Made beforehand: a signal handler may not.
std::string crash_message;

/// Only what is allowed in a signal handler.
extern "C" void on_crash(int /*number*/) {
  static_cast<void>(!write(STDERR_FILENO, crash_message.data(), crash_message.size()));
  _exit(static_cast<int>(rubato::ExitStatus::file_error));
}

}  // namespace

Interruption& catch_interrupts() {
  struct sigaction action = {};
  action.sa_handler = &on_signal;
  action.sa_flags = static_cast<int>(SA_RESETHAND);
  sigemptyset(&action.sa_mask);
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  struct sigaction hangup = {};
  if (sigaction(SIGHUP, nullptr, &hangup) == 0 && hangup.sa_handler != SIG_IGN) {
    sigaction(SIGHUP, &action, nullptr);
  }
  return interruption;
}

void explain_crashes(std::string_view files) {
  crash_message = fmt::format(
      "rubato: error: {}: crashed while reading the record, which is probably damaged; take it from a copy\n",
      printable(files));
  struct sigaction action = {};
  action.sa_handler = &on_crash;
  sigemptyset(&action.sa_mask);
  for (const int signal : {SIGSEGV, SIGBUS, SIGFPE, SIGABRT}) {
    struct sigaction before = {};
    if (sigaction(signal, nullptr, &before) == 0 && before.sa_handler == SIG_DFL) {  // not that of a sanitizer
      sigaction(signal, &action, nullptr);
    }
  }
}

void survive_file_limits() {
  struct sigaction action = {};
  action.sa_handler = SIG_IGN;
  sigaction(SIGXFSZ, &action, nullptr);
}

void keep_standard_streams() {
  for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) {
    if (fcntl(stream, F_GETFD) < 0) {
      static_cast<void>(open("/dev/null", O_RDONLY));  // takes the lowest free number, which is this one
    }
  }
}

}  // namespace rubato::program
