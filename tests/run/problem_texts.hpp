#pragma once

#include <algorithm>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/figures/statistics.hpp>
#include <rubato/problem/lattice_problem.hpp>
#include <rubato/problem/problem.hpp>

/// What tests of problems that are stated as one text share.
namespace rubato::run_tests {

using Settings = std::vector<std::string>;

inline Settings joined(Settings one, const Settings& other) {
  one.insert(one.end(), other.begin(), other.end());
  return one;
}

/// The text with the one place of `from` replaced.
inline std::string with(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  REQUIRE(at != std::string::npos);
  return text.replace(at, from.size(), to);
}

/// The message with which the problem is refused; empty if it is read.
inline std::string refusal(const std::string& text, const std::string& file, const Settings& settings) {
  try {
    static_cast<void>(parse_problem(text, file, settings));
  } catch (const ProblemError& error) {
    return error.what();
  }
  return "";
}

/// The same, or that with which its first level is.
inline std::string refusal_at_start(const std::string& text, const std::string& file, const Settings& settings = {}) {
  try {
    static_cast<void>(make_lattice(parse_problem(text, file, settings)));
  } catch (const ProblemError& error) {
    return error.what();
  }
  return "";
}

/// The figure of that name.
template <typename Value>
const Value& named(const std::vector<figures::Named<Value>>& all, const std::string& name) {
  const auto found = std::ranges::find(all, name, &figures::Named<Value>::name);
  REQUIRE(found != all.end());
  return found->value;
}

}  // namespace rubato::run_tests
