#pragma once

#include <string>
#include <string_view>

#include <CLI/CLI.hpp>

namespace rubato::program {

/// A script that makes a shell complete the commands, their options, catalogue names and files: made from the command
/// line's own description, so that it knows all of it. `shell` is bash, zsh or fish. \throws std::invalid_argument
[[nodiscard]] std::string completion(const CLI::App& app, std::string_view shell);

}  // namespace rubato::program
