#include "tests/support/program.h"

#include <fcntl.h>
#include <poll.h>
#include <spawn.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <system_error>
#include <thread>

using std::chrono::steady_clock;

Program::Program(const std::string& name, const std::vector<std::string>& arguments,
                 const std::filesystem::path& directory)
    : name_(name) {
  static int count = 0;
  const std::string stem =
      std::filesystem::path(name).filename().string() + "." + std::to_string(count++);
  stderr_path_ = directory / (stem + ".err");
  stdout_path_ = directory / (stem + ".out");
  const bool ours = name.rfind("tachless", 0) == 0;
  std::vector<std::string> words{ours ? TACHLESS_BINARY_DIR "/bin/" + name : name};
  words.insert(words.end(), arguments.begin(), arguments.end());
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, stderr_path_.c_str(),
                                   O_WRONLY | O_CREAT | O_TRUNC, 0600);
  posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, stdout_path_.c_str(),
                                   O_WRONLY | O_CREAT | O_TRUNC, 0600);
  posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  const int error = posix_spawnp(&pid_, argv[0], &actions, nullptr, argv.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  if (error != 0) throw std::system_error(error, std::generic_category(), words[0]);
  pidfd_ = static_cast<int>(syscall(SYS_pidfd_open, pid_, 0));
  if (pidfd_ < 0) throw std::system_error(errno, std::generic_category(), "pidfd_open");
}

Program::~Program() {
  if (running_ && !ended()) {
    kill(pid_, SIGKILL);
    waitpid(pid_, nullptr, 0);
  }
  close(pidfd_);
}

bool Program::ended() {
  int status = 0;
  if (!running_) return true;
  if (waitpid(pid_, &status, WNOHANG) != pid_) return false;
  running_ = false;
  exit_code_ = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  return true;
}

int Program::wait(std::chrono::seconds limit) {
  pollfd end{.fd = pidfd_, .events = POLLIN, .revents = 0};
  const auto milliseconds = std::chrono::milliseconds(limit).count();
  while (!ended()) {
    if (poll(&end, 1, static_cast<int>(milliseconds)) == 0) {
      throw std::runtime_error(name_ + " still runs after " + std::to_string(limit.count()) +
                               " s; it said: " + errors());
    }
  }
  return exit_code_;
}

void Program::signal(int number) const {
  syscall(SYS_pidfd_send_signal, pidfd_, number, nullptr, 0);
}

std::string Program::errors() const { return contents(stderr_path_); }

std::string Program::output() const { return contents(stdout_path_); }

void Program::wait_for(const std::string& text, std::chrono::seconds limit) {
  const auto deadline = steady_clock::now() + limit;
  pollfd end{.fd = pidfd_, .events = POLLIN, .revents = 0};
  while (errors().find(text) == std::string::npos) {
    if (ended() || steady_clock::now() > deadline) {
      throw std::runtime_error(name_ + " never said '" + text + "' but: " + errors());
    }
    poll(&end, 1, 10);
  }
}

std::string contents(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

void wait_until(const std::string& what, const std::function<bool()>& is_so,
                std::chrono::seconds limit) {
  const auto deadline = steady_clock::now() + limit;
  while (!is_so()) {
    if (steady_clock::now() > deadline) throw std::runtime_error("timed out waiting for " + what);
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
}

std::string output_of(const std::string& program, const std::vector<std::string>& arguments,
                      const TemporaryDirectory& directory) {
  Program tool(program, arguments, directory.path());
  if (tool.wait() != 0) throw std::runtime_error(program + ": " + tool.errors());
  return tool.output();
}
