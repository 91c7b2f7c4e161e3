#include "children.hpp"

#include <csignal>
#include <fstream>
#include <iterator>
#include <thread>

#include <fcntl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

namespace children {

namespace {

Ended ended(int status, const rusage& usage) {
  return {WIFSIGNALED(status) ? -WTERMSIG(status) : WEXITSTATUS(status), static_cast<double>(usage.ru_maxrss) / 1024.0};
}

void redirect(int stream, const std::string& file) {
  const int target = ::open(file.empty() ? "/dev/null" : file.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
  ::dup2(target, stream);
}

}  // namespace

pid_t start(const std::string& program, std::vector<std::string> arguments, const Streams& streams) {
  arguments.insert(arguments.begin(), program);
  std::vector<char*> argv;
  for (std::string& argument : arguments) {
    argv.push_back(argument.data());
  }
  argv.push_back(nullptr);
  const pid_t child = ::fork();
  if (child == 0) {
    redirect(STDOUT_FILENO, streams.output);
    redirect(STDERR_FILENO, streams.errors);
    ::execv(program.c_str(), argv.data());
    ::_exit(127);
  }
  return child;
}

Ended wait_for(pid_t child) {
  int status = 0;
  rusage usage{};
  ::wait4(child, &status, 0, &usage);
  return ended(status, usage);
}

Ended wait_for(pid_t child, std::chrono::milliseconds longest) {
  constexpr std::chrono::milliseconds pause(5);
  for (auto waited = pause; waited < longest; waited += pause) {
    int status = 0;
    rusage usage{};
    if (::wait4(child, &status, WNOHANG, &usage) == child) {
      return ended(status, usage);
    }
    std::this_thread::sleep_for(pause);
  }
  ::kill(child, SIGKILL);
  return wait_for(child);
}

std::string contents(const std::string& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

}  // namespace children
