#include "report/gnuplot.h"

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cstdio>
#include <cstring>
#include <fstream>

#include "diagnostics/failure.h"

extern char** environ;

namespace tachless::report {

std::string gnuplot_string(const std::string& text) {
  std::string quoted = "'";
  for (const char c : text) {
    if (c == '\'') quoted += '\'';
    quoted += c;
  }
  return quoted + "'";
}

std::string gnuplot_text(const std::string& text) {
  std::string escaped;
  for (const char c : text) {
    if (std::strchr("_^{}@&~\\", c) != nullptr && c != '\0') escaped += '\\';
    escaped += static_cast<unsigned char>(c) < ' ' ? ' ' : c;
  }
  return gnuplot_string(escaped);
}

std::string gnuplot_number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.9g", value);
  return text;
}

void draw(const std::string& gnuplot_commands, const std::filesystem::path& svg) {
  const std::filesystem::path script = svg.string() + ".gnuplot";
  const std::filesystem::path output = svg.string() + ".gnuplot-says";
  std::ofstream(script) << gnuplot_commands;

  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, output.c_str(),
                                   O_WRONLY | O_CREAT | O_TRUNC, 0644);
  posix_spawn_file_actions_adddup2(&actions, STDERR_FILENO, STDOUT_FILENO);
  std::string program = "gnuplot";
  std::string argument = script.string();
  std::array<char*, 3> argv = {program.data(), argument.data(), nullptr};
  pid_t pid = -1;
  const int error = posix_spawnp(&pid, "gnuplot", &actions, nullptr, argv.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  int status = 0;
  if (error == 0) waitpid(pid, &status, 0);

  std::string says;
  std::ifstream(output) >> std::ws&& std::getline(std::ifstream(output) >> std::ws, says);
  std::error_code ignored;
  std::filesystem::remove(script, ignored);
  std::filesystem::remove(output, ignored);
  if (error != 0) {
    throw diagnostics::Failure(diagnostics::ExitCode::bad_usage,
                               std::string("cannot start gnuplot: ") + std::strerror(error) +
                                   "; type: apt-get install gnuplot-nox");
  }
  if (status != 0) {
    throw diagnostics::Failure(diagnostics::ExitCode::bad_usage,
                               "gnuplot did not draw " + svg.string() + ": " + says);
  }
}

}  // namespace tachless::report
