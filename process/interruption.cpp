#include "process/interruption.h"

#include <csignal>
#include <stdexcept>

namespace tachless::process {
namespace {

std::atomic<bool> interrupted{false};
static_assert(std::atomic<bool>::is_always_lock_free, "set by a signal handler");

void note_signal(int /*signal*/) { interrupted = true; }

}  // namespace

const std::atomic<bool>& catch_interruptions(int flags) {
  struct sigaction action {};
  action.sa_handler = note_signal;
  sigemptyset(&action.sa_mask);
  action.sa_flags = flags;
  for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGPIPE}) {
    if (sigaction(signal, &action, nullptr) != 0) throw std::logic_error("sigaction failed");
  }
  return interrupted;
}

void survive_file_size_limit() { std::signal(SIGXFSZ, SIG_IGN); }

void survive_broken_pipes() { std::signal(SIGPIPE, SIG_IGN); }

}  // namespace tachless::process
