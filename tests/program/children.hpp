#pragma once

#include <chrono>
#include <string>
#include <vector>

#include <sys/types.h>

/// Programs run as children of a test.
namespace children {

/// Standard output goes to `output` (nowhere if empty), standard error to `errors` likewise.
struct Streams {
  std::string output, errors;
};
[[nodiscard]] pid_t start(const std::string& program, std::vector<std::string> arguments, const Streams& streams = {});

struct Ended {
  int status = 0;          ///< exit status, or minus the signal that ended it
  double megabytes = 0.0;  ///< the most memory it had
};
[[nodiscard]] Ended wait_for(pid_t child);
/// Kills it after `longest`; the status then is -SIGKILL.
[[nodiscard]] Ended wait_for(pid_t child, std::chrono::milliseconds longest);

/// All of a file; empty if there is none.
[[nodiscard]] std::string contents(const std::string& file);

}  // namespace children
