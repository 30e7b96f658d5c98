#include <fmt/format.h>

#include <iostream>
#include <string>
#include <vector>

#include "launch/verb.h"

namespace tachless::launch {
namespace {

/// With their dashes.
std::vector<std::string> names_of(const CLI::Option& option) {
  std::vector<std::string> names;
  for (const std::string& name : option.get_snames()) names.push_back("-" + name);
  for (const std::string& name : option.get_lnames()) names.push_back("--" + name);
  return names;
}

bool takes_value(const CLI::Option& option) { return option.get_items_expected_max() > 0; }

/// The option's values, separated by spaces; empty: files. CLI11 tells a set of allowed values as
/// "TEXT:{one,other}".
std::string choices_of(const CLI::Option& option) {
  const std::string type = option.get_type_name();
  const auto begin = type.find(":{");
  if (begin == std::string::npos) return "";
  std::string choices = type.substr(begin + 2, type.find('}', begin) - begin - 2);
  for (char& letter : choices) letter = letter == ',' ? ' ' : letter;
  return choices;
}

std::vector<const CLI::Option*> options_of(const CLI::App& verb) {
  return verb.get_options([](const CLI::Option* option) { return option->nonpositional(); });
}

/// `text` between apostrophes and brackets of an _arguments specification.
std::string zsh_text(const std::string& text) {
  std::string escaped;
  for (const char letter : text) {
    if (letter == '\'') escaped += "'\\'";
    if (letter == '[' || letter == ']' || letter == ':' || letter == '\\') escaped += '\\';
    escaped += letter;
  }
  return escaped;
}

std::string bash_completion(const std::vector<const CLI::App*>& verbs) {
  std::string names = "help", cases;
  for (const CLI::App* verb : verbs) {
    names += " " + verb->get_name();
    std::string words;
    for (const CLI::Option* option : options_of(*verb)) {
      words += fmt::format(" {}", fmt::join(names_of(*option), " "));
      if (!takes_value(*option)) continue;
      for (const std::string& name : names_of(*option)) {
        cases +=
            fmt::format("    {},{}) words='{}' ;;\n", verb->get_name(), name, choices_of(*option));
      }
    }
    cases += fmt::format("    {},*) [[ $now == -* ]] && words='{}' ;;\n", verb->get_name(), words);
  }
  return fmt::format(
      "# bash completion of tachless; written by: tachless completion bash\n"
      "_tachless() {{\n"
      "  local now=${{COMP_WORDS[COMP_CWORD]}} before=${{COMP_WORDS[COMP_CWORD-1]}} words=\n"
      "  local verb=${{COMP_WORDS[1]}}\n"
      "  ((COMP_CWORD > 1)) || verb=tachless\n"
      "  [[ $verb,$before != help,help ]] || verb=tachless\n"
      "  case $verb,$before in\n"
      "    tachless,*) words='{}' ;;\n{}"
      "  esac\n"
      "  mapfile -t COMPREPLY < <(compgen -W \"$words\" -- \"$now\")\n"
      "}}\n"
      "complete -o default -F _tachless tachless\n",
      names, cases);
}

std::string zsh_completion(const std::vector<const CLI::App*>& verbs) {
  std::string names, cases;
  for (const CLI::App* verb : verbs) {
    names += fmt::format("    '{}:{}'\n", verb->get_name(), zsh_text(verb->get_description()));
    cases += fmt::format("    {}) _arguments", verb->get_name());
    for (const CLI::Option* option : options_of(*verb)) {
      const std::string choices = choices_of(*option);
      const std::string value = ":value:" + (choices.empty() ? "_files" : "(" + choices + ")");
      for (const std::string& name : names_of(*option)) {
        cases += fmt::format(" \\\n      '*{}[{}]{}'", name, zsh_text(option->get_description()),
                             takes_value(*option) ? value : "");
      }
    }
    cases += " \\\n      '*:file:_files' ;;\n";
  }
  return fmt::format(
      "#compdef tachless\n# written by: tachless completion zsh\n"
      "local -a verbs=(\n{}  )\n"
      "if ((CURRENT == 2)); then\n  _describe verb verbs\nelse\n  shift words; ((CURRENT--))\n"
      "  case ${{words[1]}} in\n{}    help) _describe verb verbs ;;\n  esac\nfi\n",
      names, cases);
}

/// The verbs of the command and their options with the values that they allow, as a script by which
/// the shell completes them. Where a value is not one of a set, it completes files.
struct Completion {
  const CLI::App* tachless = nullptr;
  std::string shell;

  void declare(CLI::App& command) {
    tachless = command.get_parent();
    command.add_option("SHELL", shell, "bash or zsh")
        ->required()
        ->check(CLI::IsMember({"bash", "zsh"}));
  }

  [[nodiscard]] diagnostics::ExitCode run() const {
    const auto verbs = tachless->get_subcommands([](const CLI::App*) { return true; });
    std::cout << (shell == "bash" ? bash_completion(verbs) : zsh_completion(verbs));
    return diagnostics::ExitCode::done;
  }
};

}  // namespace

const Verb completion_verb = verb_of<Completion>(
    "completion", "The options of all verbs, as bash or zsh completes them",
    "  tachless completion bash > ~/.local/share/bash-completion/completions/tachless\n"
    "  tachless completion zsh > ~/.zfunc/_tachless");

}  // namespace tachless::launch
