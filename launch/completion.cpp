#include "launch/completion.h"

#include <fmt/format.h>

#include <utility>
#include <vector>

namespace tachless::launch {
namespace {

/// An option as a shell completes it.
struct Completed {
  std::vector<std::string> names;  ///< with their dashes
  std::string does;
  std::string choices;  ///< its values, separated by spaces; empty: files
  bool takes_value = false;
};

/// CLI11 tells a set of allowed values as "TEXT:{one,other}".
std::string choices_of(const std::string& type) {
  const auto begin = type.find(":{");
  if (begin == std::string::npos) return "";
  std::string choices = type.substr(begin + 2, type.find('}', begin) - begin - 2);
  for (char& letter : choices) letter = letter == ',' ? ' ' : letter;
  return choices;
}

std::vector<Completed> options_of(const CLI::App& command) {
  std::vector<Completed> all;
  for (const CLI::Option* option : command.get_options()) {
    if (!option->nonpositional()) continue;
    Completed one{{},
                  option->get_description(),
                  choices_of(option->get_type_name()),
                  option->get_items_expected_max() > 0};
    for (const std::string& name : option->get_snames()) one.names.push_back("-" + name);
    for (const std::string& name : option->get_lnames()) one.names.push_back("--" + name);
    all.push_back(std::move(one));
  }
  return all;
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

std::vector<const CLI::App*> verbs_of(const CLI::App& tachless) {
  return tachless.get_subcommands([](const CLI::App*) { return true; });
}

}  // namespace

std::string bash_completion(const CLI::App& tachless) {
  std::string names = "help", cases;
  for (const CLI::App* verb : verbs_of(tachless)) {
    names += " " + verb->get_name();
    std::string words;
    for (const Completed& option : options_of(*verb)) {
      words += fmt::format(" {}", fmt::join(option.names, " "));
      if (!option.takes_value) continue;
      for (const std::string& name : option.names) {
        cases += fmt::format("    {},{}) words='{}' ;;\n", verb->get_name(), name, option.choices);
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

std::string zsh_completion(const CLI::App& tachless) {
  std::string names, cases;
  for (const CLI::App* verb : verbs_of(tachless)) {
    names += fmt::format("    '{}:{}'\n", verb->get_name(), zsh_text(verb->get_description()));
    cases += fmt::format("    {}) _arguments", verb->get_name());
    for (const Completed& option : options_of(*verb)) {
      const std::string value = option.choices.empty() ? "_files" : "(" + option.choices + ")";
      for (const std::string& name : option.names) {
        cases += fmt::format(" \\\n      '*{}[{}]{}'", name, zsh_text(option.does),
                             option.takes_value ? ":value:" + value : "");
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

}  // namespace tachless::launch
