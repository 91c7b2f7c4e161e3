#pragma once

#include <sched.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <iterator>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>

/// \file
/// Whole processes, measured in turns.

namespace processes {

struct Cost {
  double cpu = 0.0, wall = 0.0;  ///< seconds
  double megabytes = 0.0;        ///< of the record
  double memory = 0.0;           ///< MB at the peak
};

inline double median(std::vector<double> values) {
  std::ranges::sort(values);
  return values[values.size() / 2];
}

/// On the first processor alone, or wherever the system likes.
inline void stay(bool on_first) {
  if (on_first) {
    cpu_set_t set;
    CPU_ZERO(&set);
    CPU_SET(0, &set);
    sched_setaffinity(0, sizeof set, &set);
  }
}

/// A child that does `work`, with its CPU time.
inline Cost measured(bool on_first, const std::function<int()>& work) {
  const auto begin = std::chrono::steady_clock::now();
  const pid_t child = fork();
  if (child == 0) {
    stay(on_first);
    _exit(work());
  }
  int status = 0;
  rusage used{};
  wait4(child, &status, 0, &used);
  if (child < 0 || !WIFEXITED(status) || WEXITSTATUS(status) != 0) {
    fmt::print(stderr, "a run failed\n");
    std::exit(1);
  }
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return {seconds(used.ru_utime) + seconds(used.ru_stime),
          std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count(), 0.0,
          1e-3 * static_cast<double>(used.ru_maxrss)};
}

class Program {
public:
  Program(std::string path, std::string directory)
      : path_(std::move(path)), record_(std::move(directory) + "/cost.h5") {}

  [[nodiscard]] Cost run(const std::vector<std::string>& settings, int threads = 1) const {
    std::vector<std::string> words = {path_, "run"};
    words.insert(words.end(), settings.begin(), settings.end());
    for (const std::string& word : {std::string("--quiet"), std::string("--force"), std::string("--output"), record_,
                                    std::string("--threads"), std::to_string(threads)}) {
      words.push_back(word);
    }
    std::vector<char*> arguments;
    for (std::string& word : words) {
      arguments.push_back(word.data());
    }
    arguments.push_back(nullptr);
    Cost cost = measured(threads == 1, [&] {
      execv(arguments[0], arguments.data());
      return 127;
    });
    cost.megabytes = 1e-6 * static_cast<double>(std::filesystem::file_size(record_));
    std::filesystem::remove(record_);
    return cost;
  }
  [[nodiscard]] const std::string& record() const { return record_; }

private:
  std::string path_, record_;
};

/// `problem key=value …` and more of the latter, as the program has them.
inline std::vector<std::string> with(const std::string& problem, const std::vector<std::string>& settings,
                                     const std::vector<std::string>& more) {
  std::vector<std::string> words = {problem};
  for (const auto& list : {settings, more}) {
    for (const std::string& setting : list) {
      words.insert(words.end(), {"--set", setting});
    }
  }
  return words;
}

/// Medians of what each makes, all in turns.
inline std::vector<Cost> in_turns(int repeats, const std::vector<std::function<Cost()>>& all) {
  std::vector<std::vector<Cost>> taken(all.size());
  for (int turn = 0; turn < repeats; ++turn) {
    for (std::size_t i = 0; i < all.size(); ++i) {
      taken[i].push_back(all[i]());
    }
  }
  std::vector<Cost> medians;
  for (const auto& costs : taken) {
    const auto of = [&](double Cost::*part) {
      std::vector<double> values;
      std::ranges::transform(costs, std::back_inserter(values), [&](const Cost& cost) { return cost.*part; });
      return median(values);
    };
    medians.push_back({of(&Cost::cpu), of(&Cost::wall), of(&Cost::megabytes), of(&Cost::memory)});
  }
  return medians;
}

}  // namespace processes
