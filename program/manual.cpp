#include "manual.hpp"

#include <sstream>
#include <string_view>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/run/version.hpp>

namespace rubato::program {

namespace {

/// Plain text as troff prints it: hyphens that can be copied, and no line that is a request.
std::string troff(std::string_view text) {
  std::string safe;
  bool begins_line = true;
  for (const char c : text) {
    if (begins_line && (c == '.' || c == '\'')) {
      safe += "\\&";
    }
    safe += c == '\\' ? "\\e" : c == '-' ? "\\-" : std::string(1, c);
    begins_line = c == '\n';
  }
  return safe;
}

/// Lines as they are.
std::string as_is(const std::string& text) {
  if (text.empty()) {
    return "";
  }
  return fmt::format(".PP\n.nf\n{}{}.fi\n", troff(text), text.ends_with('\n') ? "" : "\n");
}

std::string option_entry(const CLI::Option& option) {
  std::vector<std::string> names;
  for (const std::string& name : option.get_snames()) {
    names.push_back("-" + name);
  }
  for (const std::string& name : option.get_lnames()) {
    names.push_back("--" + name);
  }
  const std::string value = option.get_option_text();
  if (option.get_positional()) {
    return fmt::format(".TP\n\\fI{}\\fR\n{}\n", troff(value), troff(option.get_description()));
  }
  return fmt::format(".TP\n\\fB{}\\fR{}\n{}\n", troff(fmt::format("{}", fmt::join(names, ", "))),
                     value.empty() ? "" : fmt::format(" \\fI{}\\fR", troff(value)), troff(option.get_description()));
}

std::string options_of(const CLI::App& app) {
  std::string entries;
  for (const CLI::Option* const option : app.get_options()) {
    entries += option_entry(*option);
  }
  return entries;
}

}  // namespace

std::string manual(const CLI::App& app) {
  std::istringstream description(app.get_description());
  std::string summary, rest, line;
  std::getline(description, summary);
  while (std::getline(description, line)) {
    rest += line + "\n";
  }
  std::string page = fmt::format(
      ".TH RUBATO 1 \"\" \"rubato {}\" \"User Commands\"\n.SH NAME\nrubato \\- {}\n.SH SYNOPSIS\n\\fBrubato\\fR "
      "\\fICOMMAND\\fR [\\fIOPTIONS\\fR]\n.SH DESCRIPTION\n{}",
      version(), troff(summary), troff(rest));
  page += ".SH OPTIONS\n" + options_of(app) + ".SH COMMANDS\n";
  for (const CLI::App* const command : app.get_subcommands({})) {
    page += fmt::format(".SS rubato {}\n{}.\n", command->get_name(), troff(command->get_description()));
    page += options_of(*command) + as_is(command->get_footer());
  }
  return page + ".SH EXAMPLES AND EXIT STATUS\n" + as_is(app.get_footer());
}

}  // namespace rubato::program
