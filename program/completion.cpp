#include "completion.hpp"

#include <algorithm>
#include <stdexcept>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/problem/browse.hpp>
#include <rubato/problem/help.hpp>
#include <rubato/problem/keys.hpp>

namespace rubato::program {

namespace {

struct Option {
  std::vector<std::string> names;  ///< with dashes
  std::string description;
  bool takes_value = false;
};

struct Command {
  std::string name, description;
  std::vector<Option> options;
  bool takes_catalogue_name = false, takes_file = false;
  std::string words = {};  ///< what it may be given, with spaces between them
};

/// The names of what has names, with spaces between them.
template <typename Range>
std::string names_of(const Range& range) {
  std::string names;
  for (const auto& named : range) {
    names += names.empty() ? "" : " ";
    names += named.name;
  }
  return names;
}

std::vector<Command> commands_of(const CLI::App& app) {
  std::vector<Command> commands;
  for (const CLI::App* const subcommand : app.get_subcommands({})) {
    Command command{.name = subcommand->get_name(), .description = subcommand->get_description(), .options = {}};
    for (const CLI::Option* const option : subcommand->get_options()) {
      if (option->get_positional()) {
        command.takes_file =
            command.takes_file || (command.name != "show" && command.name != "completion" && command.name != "help");
        continue;
      }
      Option described{
          .names = {}, .description = option->get_description(), .takes_value = option->get_items_expected_max() > 0};
      for (const std::string& name : option->get_snames()) {
        described.names.push_back("-" + name);
      }
      for (const std::string& name : option->get_lnames()) {
        described.names.push_back("--" + name);
      }
      command.options.push_back(described);
    }
    command.takes_catalogue_name = command.name == "run" || command.name == "show";
    command.words = command.name == "completion" ? "bash zsh fish" : "";
    commands.push_back(command);
  }
  for (Command& command : commands) {
    if (command.name == "help") {
      command.words = fmt::format("{} {}", fmt::join(rubato::help_topics(), " "), names_of(commands));
    }
  }
  return commands;
}

std::string catalogue_names() {
  return names_of(rubato::list_catalogue());
}

/// Every entry of a problem file that --set can change, with spaces between them: "scheme.step". Of tables with names
/// of the user's, the table and a dot.
std::string entries_of_problems(std::string_view ending) {
  std::string entries;
  const auto add = [&](const std::string& entry) { entries += (entries.empty() ? "" : " ") + entry; };
  for (const rubato::TableEntry& table : rubato::problem_tables()) {
    const bool of_any_name = table.name.ends_with(".NAME");
    if (!table.names_what.empty() && !of_any_name) {
      add(fmt::format("{}.", table.name));
    }
    for (const rubato::KeyEntry& key : rubato::problem_keys()) {
      if (key.table == table.name && !of_any_name && !table.name.empty()) {
        add(fmt::format("{}.{}{}", table.name, key.name, ending));
      }
    }
  }
  return entries;
}

std::string option_names(const Command& command) {
  std::vector<std::string> names;
  for (const Option& option : command.options) {
    names.insert(names.end(), option.names.begin(), option.names.end());
  }
  return fmt::format("{}", fmt::join(names, " "));
}

/// In single quotes, for a shell.
std::string quoted(const std::string& text) {
  std::string safe = "'";
  for (const char c : text) {
    safe += c == '\'' ? std::string("'\\''") : std::string(1, c);
  }
  return safe + "'";
}

std::string bash_script(const std::vector<Command>& commands) {
  std::string text =
      "# bash completion of rubato\n_rubato() {\n  local word=\"${COMP_WORDS[COMP_CWORD]}\" words=''\n"
      "  if [ \"${COMP_WORDS[COMP_CWORD - 1]}\" = --set ]; then\n";
  text += fmt::format(
      "    words='{}'; compopt -o nospace 2>/dev/null\n  elif [ \"${{COMP_WORDS[COMP_CWORD - 1]}}\" = --unset ]; "
      "then\n",
      entries_of_problems("="));
  text += fmt::format("    words='{}'\n  elif [ \"$COMP_CWORD\" -eq 1 ]; then\n", entries_of_problems(""));
  text +=
      fmt::format("    words='{} --help --version'\n  else\n    case \"${{COMP_WORDS[1]}}\" in\n", names_of(commands));
  for (const Command& command : commands) {
    text +=
        fmt::format("      {})\n        if [[ $word == -* ]]; then words='{}'", command.name, option_names(command));
    if (command.takes_catalogue_name) {
      text += fmt::format("\n        else words='{}'", catalogue_names());
    } else if (!command.words.empty()) {
      text += fmt::format("\n        else words='{}'", command.words);
    }
    text += "; fi ;;\n";
  }
  text +=
      "    esac\n  fi\n  mapfile -t COMPREPLY < <(compgen -W \"$words\" -- \"$word\")\n}\n"
      "complete -o bashdefault -o default -F _rubato rubato\n";
  return text;
}

std::string zsh_script(const std::vector<Command>& commands) {
  std::string text = "#compdef rubato\n_rubato() {\n  local -a commands\n  commands=(\n";
  for (const Command& command : commands) {
    text += "    " + quoted(command.name + ":" + command.description) + "\n";
  }
  text += "  )\n  if (( CURRENT == 2 )); then _describe command commands; return; fi\n";
  text += fmt::format(
      "  case $words[CURRENT-1] in\n    --set) compadd -S '' -- {}; return ;;\n    --unset) compadd -- {}; "
      "return ;;\n  esac\n  case $words[2] in\n",
      entries_of_problems("="), entries_of_problems(""));
  for (const Command& command : commands) {
    text += fmt::format("    {})\n", command.name);
    if (!command.options.empty()) {
      text += fmt::format("      [[ $PREFIX == -* ]] && {{ compadd -- {}; return }}\n", option_names(command));
    }
    if (command.takes_catalogue_name) {
      text += fmt::format("      compadd -- {}\n", catalogue_names());
    }
    if (!command.words.empty()) {
      text += fmt::format("      compadd -- {}\n", command.words);
    }
    text += command.takes_file ? "      _files ;;\n" : "      ;;\n";
  }
  text += "  esac\n}\nif [ \"$funcstack[1]\" = _rubato ]; then _rubato \"$@\"; else compdef _rubato rubato; fi\n";
  return text;
}

std::string fish_script(const std::vector<Command>& commands) {
  std::string text = "# fish completion of rubato\n";
  for (const Command& command : commands) {
    text += fmt::format("complete -c rubato -n __fish_use_subcommand -f -a {} -d {}\n", command.name,
                        quoted(command.description));
    const std::string here = fmt::format("complete -c rubato -n '__fish_seen_subcommand_from {}'", command.name);
    for (const Option& option : command.options) {
      text += here;
      for (const std::string& name : option.names) {
        text += name.starts_with("--") ? " -l " + name.substr(2) : " -s " + name.substr(1);
      }
      const bool sets = std::ranges::find(option.names, "--set") != option.names.end();
      const bool unsets = std::ranges::find(option.names, "--unset") != option.names.end();
      text += option.takes_value ? " -r" : "";
      text += sets || unsets ? fmt::format(" -f -a '{}'", entries_of_problems(sets ? "=" : "")) : "";
      text += fmt::format(" -d {}\n", quoted(option.description));
    }
    if (command.takes_catalogue_name) {
      text += fmt::format("{}{} -a '{}'\n", here, command.takes_file ? "" : " -f", catalogue_names());
    } else if (!command.words.empty()) {
      text += fmt::format("{} -f -a '{}'\n", here, command.words);
    }
  }
  return text;
}

}  // namespace

std::string completion(const CLI::App& app, std::string_view shell) {
  const std::vector<Command> commands = commands_of(app);
  if (shell == "bash") {
    return bash_script(commands);
  }
  if (shell == "zsh") {
    return zsh_script(commands);
  }
  if (shell == "fish") {
    return fish_script(commands);
  }
  throw std::invalid_argument(fmt::format("{} is no shell that completion is known for: bash, zsh or fish", shell));
}

}  // namespace rubato::program
