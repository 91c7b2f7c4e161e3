#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

namespace audit {

/// What an audit of one run found wrong, each under a word for its kind; and how near to its limit each check came.
struct Disagreements {
  std::vector<std::pair<std::string, std::string>> list;
  std::map<std::string, long double> closest;  ///< largest ratio of a value to its limit, for each kind
  std::map<std::string, std::size_t> judged;   ///< how many values each kind of check has seen

  void add(const std::string& kind, const std::string& text) { list.emplace_back(kind, text); }
  /// Finds fault if the value is not within the limit; a value that is not a number never is.
  template <typename Text>
  void within(const std::string& kind, long double value, long double limit, const Text& text) {
    ++judged[kind];
    long double& ratio = closest[kind];
    if (!(value <= limit)) {
      add(kind, text());
    } else if (limit > 0 && value / limit > ratio) {
      ratio = value / limit;
    }
  }
  [[nodiscard]] bool has(const std::string& kind) const {
    for (const auto& [word, text] : list) {
      if (word == kind) {
        return true;
      }
    }
    return false;
  }
};

}  // namespace audit
