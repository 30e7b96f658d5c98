#include "launch/completion.h"

#include <iostream>
#include <memory>
#include <string>

#include "launch/verb.h"

namespace tachless::launch::verb {
namespace {

Verb::Action declare(CLI::App& command) {
  auto shell = std::make_shared<std::string>();
  command.add_option("SHELL", *shell, "bash or zsh")
      ->required()
      ->check(CLI::IsMember({"bash", "zsh"}));
  return [shell, tachless = command.get_parent()] {
    std::cout << (*shell == "bash" ? bash_completion(*tachless) : zsh_completion(*tachless));
    return diagnostics::ExitCode::done;
  };
}

}  // namespace

extern const Verb completion;
const Verb completion = {
    "completion", "The options of all verbs, as bash or zsh completes them",
    "  tachless completion bash > ~/.local/share/bash-completion/completions/tachless\n"
    "  tachless completion zsh > ~/.zfunc/_tachless",
    declare};

}  // namespace tachless::launch::verb
