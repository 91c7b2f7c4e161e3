// The program against equations written a second time: random problems are run, checked, resumed and compared as a user
// would, and everything that the records and the tables say is judged by an oracle that shares no code with the
// library.
//
//   audit problem orbit|lattice N           prints the problem file of a case
//   audit RUBATO orbit|lattice N [M]        judges cases N … M-1, and shows what is wrong with each
//   audit RUBATO twins                      judges records in which something was made wrong
//
// Exits 0 if nothing is wrong.

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <map>
#include <string>
#include <thread>
#include <vector>

#include <sys/wait.h>
#include <unistd.h>

#include <fmt/format.h>

#include "audit/lattice_audit.hpp"
#include "audit/orbit_audit.hpp"
#include "audit/orbit_problem.hpp"

namespace {

using namespace audit;

constexpr std::size_t most_told = 3;  ///< findings of a kind in one case

bool judge(const std::string& program, const std::string& kind, std::uint64_t number) {
  Disagreements findings;
  (kind == "orbit" ? audit_orbit : audit_lattice)(program, number, findings);
  if (!findings.list.empty()) {
    fmt::print("{} {} ({})\n", kind, number,
               kind == "orbit" ? random_orbit(number).family : random_lattice(number).family);
  }
  std::map<std::string, std::size_t> reported;
  for (const auto& [word, text] : findings.list) {
    if (reported[word]++ < most_told) {
      fmt::print("    {}: {}\n", word, text);
    }
  }
  for (const auto& [word, count] : reported) {
    fmt::print("    [{} × {}]\n", word, count);
  }
  std::fflush(stdout);
  return findings.list.empty();
}

/// Every other case in a process of its own: HDF5 and the program are each happy with one core.
int judge_all(const std::string& program, const std::string& kind, std::uint64_t first, std::uint64_t end) {
  const auto workers = static_cast<std::uint64_t>(std::clamp(std::thread::hardware_concurrency(), 1U, 8U));
  std::vector<pid_t> children;
  for (std::uint64_t worker = 0; worker < workers; ++worker) {
    const pid_t child = ::fork();
    if (child == 0) {
      int wrong = 0;
      for (std::uint64_t number = first + worker; number < end; number += workers) {
        wrong += judge(program, kind, number) ? 0 : 1;
      }
      fmt::print("{} exceptions\n", wrong);
      std::fflush(stdout);
      ::_exit(wrong == 0 ? 0 : 1);
    }
    children.push_back(child);
  }
  int result = 0;
  for (const pid_t child : children) {
    int status = 0;
    ::waitpid(child, &status, 0);
    result = WIFEXITED(status) && WEXITSTATUS(status) == 0 ? result : 1;
  }
  return result;
}

int usage() {
  fmt::print(stderr, "audit problem orbit|lattice N; audit RUBATO orbit|lattice N [M]; audit RUBATO twins\n");
  return 2;
}

}  // namespace

int main(int argc, char** argv) {
  const std::vector<std::string> words(argv + 1, argv + argc);
  if (words.size() < 2) {
    return usage();
  }
  if (words[1] == "twins") {
    const std::string program = std::filesystem::absolute(words[0]).string();
    return orbit_twins(program) + lattice_twins(program) == 0 ? 0 : 1;
  }
  if (words.size() < 3 || (words[1] != "orbit" && words[1] != "lattice")) {
    return usage();
  }
  const std::uint64_t first = std::stoull(words[2]);
  if (words[0] == "problem") {
    fmt::print("{}", words[1] == "orbit" ? random_orbit(first).toml() : random_lattice(first).toml());
    return 0;
  }
  const std::uint64_t end = words.size() > 3 ? std::stoull(words[3]) : first + 1;
  return judge_all(std::filesystem::absolute(words[0]).string(), words[1], first, end);
}
