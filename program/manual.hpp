#pragma once

#include <string>

#include <CLI/CLI.hpp>

namespace rubato::program {

/// Returns the manual page of the program in troff's man macros, made from the help texts of the command line: its
/// description, every command with its options and examples, and the footer.
[[nodiscard]] std::string manual(const CLI::App& app);

}  // namespace rubato::program
