#include "probe.hpp"

#include <cerrno>
#include <csignal>
#include <cstdint>
#include <exception>

#include <fcntl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fmt/format.h>

#include <rubato/record/arrays.hpp>
#include <rubato/record/reader.hpp>

namespace rubato::program {

namespace {

/// Processor time that the structure of a record may take. Its checksums are read at hundreds of megabytes a second.
constexpr rlim_t seconds_of_work = 5, bytes_a_second = 100'000'000;

[[noreturn]] void read_and_leave(const std::filesystem::path& file) {
  std::error_code none;
  const std::uintmax_t size = std::filesystem::file_size(file, none);
  const rlim_t seconds = seconds_of_work + (none ? 0 : static_cast<rlim_t>(size) / bytes_a_second);
  const rlimit work{seconds, seconds}, no_core{0, 0};
  setrlimit(RLIMIT_CPU, &work);
  setrlimit(RLIMIT_CORE, &no_core);
  for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGXCPU}) {
    std::signal(signal, SIG_DFL);
  }
  // What a library says of its own crash is not for the user.
  if (const int nowhere = open("/dev/null", O_WRONLY); nowhere >= 0) {
    dup2(nowhere, STDERR_FILENO);
  }
  try {
    if (record::is_record(file)) {
      const record::Reader reader(file, record::Altered::reported);  // which leaves what datasets hold to the command
    } else {
      const record::ArrayFile arrays(file);
    }
  } catch (const std::exception&) {
    // The command will find the same, and say it.
  }
  _exit(0);
}

}  // namespace

void probe_record(const std::filesystem::path& file) {
  const pid_t child = fork();
  if (child < 0) {
    return;  // then without
  }
  if (child == 0) {
    read_and_leave(file);
  }
  int status = 0;
  while (waitpid(child, &status, 0) < 0) {
    if (errno != EINTR) {
      return;
    }
  }
  if (WIFSIGNALED(status) && (WTERMSIG(status) == SIGXCPU || WTERMSIG(status) == SIGKILL)) {
    throw record::Error(file, "is damaged: the HDF5 library does not come to an end with its structure");
  }
  if (WIFSIGNALED(status) || WEXITSTATUS(status) != 0) {
    throw record::Error(file, fmt::format("is damaged: its structure crashes the HDF5 library{}",
                                          WIFSIGNALED(status) ? fmt::format(" (signal {})", WTERMSIG(status)) : ""));
  }
}

}  // namespace rubato::program
