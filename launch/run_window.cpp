#include "launch/run_window.h"

#include <fmt/core.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "diagnostics/failure.h"
#include "diagnostics/logging.h"
#include "process/interruption.h"
#include "viewer/visualizer.h"

namespace tachless::launch {

RunWindow::RunWindow(const RunOptions& options, bool isolated, Screen& screen)
    : options_(options), screen_(screen) {
  std::vector<std::string> command = command_of("tachless-visualizer", options);
  command.insert(command.end(), {"--run-id", std::to_string(options.run_id)});
  constexpr std::string_view itself = "tachless-visualizer: ";
  try {
    program_.emplace(
        "tachless-visualizer", command, viewer::window_is_open, std::chrono::seconds(30),
        [&](std::string_view line) { screen_.pass_on(options_.named(""), "visualizer", line); });
  } catch (const diagnostics::Failure& failure) {
    std::string_view why = failure.what();
    if (why.starts_with(itself)) why.remove_prefix(itself.size());
    throw diagnostics::Failure(
        failure.code(), "--visualize: {}; or leave out --visualize{}", why,
        isolated ? " (this run is isolated: it reaches no display over the network)" : "");
  }
}

void RunWindow::attend() {
  if (!program_->running()) return;
  program_->attend();
  if (program_->running()) return;
  const std::string& trouble = program_->trouble();
  screen_.clear();
  diagnostics::log_warning(options_.named(
      fmt::format("the window {}; the run goes on",
                  trouble.empty() ? "was closed" : fmt::format("is gone: {}", trouble))));
}

void RunWindow::run_is_over(bool interrupted) {
  interrupted ? program_->stop() : program_->signal(SIGUSR1);
}

void RunWindow::finish() {
  const std::atomic<bool>& interrupted = process::catch_interruptions();
  program_->attend();
  if (program_->running() && !options_.quiet) {
    diagnostics::log_info(options_.named(
        "the window shows the run to its end, at the simulated pace; Ctrl-C closes it"));
  }
  while (program_->running() && !interrupted) {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    program_->attend();
  }
  program_->stop();
}

}  // namespace tachless::launch
