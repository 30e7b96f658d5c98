#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "bus/key.h"
#include "messages/wire.h"
#include "scenario/scenario.h"
#include "session/session.h"
#include "tests/support/in_memory.h"
#include "tests/support/node_outcome.h"
#include "tests/support/temporary_directory.h"

/// The four real nodes in four threads on an in-memory bus.
namespace tachless::system_test {

using Outcome = support::NodeOutcome;

struct RunResult {
  std::map<messages::Role, Outcome> of;
  std::string log;  ///< the log file's bytes

  /// Returns "" if all four ended well, else the nodes that did not, and why.
  [[nodiscard]] std::string complaints() const;
};

/// A function that wraps a node's transport. The result replaces the network for that node.
using Wrapper =
    std::function<std::unique_ptr<bus::Transport>(messages::Role, std::unique_ptr<bus::Transport>)>;

class FourThreads {
 public:
  explicit FourThreads(const scenario::Scenario& scenario, const bus::NetworkFaults& faults = {});
  ~FourThreads();

  bus::InMemoryNetwork& network() { return network_; }
  void wrap(Wrapper wrapper) { wrapper_ = std::move(wrapper); }
  /// Gives the key to all four nodes.
  void give_key(const bus::Key& key) { key_ = key; }
  /// Sets the longest wait at the start; default: a minute.
  void wait_for_others(double wait_s) { wait_s_ = wait_s; }
  /// Gives one role alone this scenario.
  void give(messages::Role role, const scenario::Scenario& scenario);
  /// Interrupts the node of `role`, as a user's Ctrl-C interrupts its process.
  void interrupt(messages::Role role) { interrupted_.at(static_cast<std::size_t>(role)) = true; }

  void start(messages::Role role);
  /// Waits for the nodes that were started.
  void wait();
  /// Starts the nodes that do not run yet, waits for all and reads the log.
  RunResult finish();

  [[nodiscard]] std::filesystem::path log_path() const;

 private:
  scenario::Scenario scenario_;
  std::map<messages::Role, scenario::Scenario> own_;
  bus::InMemoryNetwork network_;
  TemporaryDirectory directory_;
  Wrapper wrapper_;
  std::optional<bus::Key> key_;
  double wait_s_ = 60;
  std::array<std::atomic<bool>, messages::num_roles> interrupted_{};
  std::array<Outcome, messages::num_roles> outcomes_;
  std::array<std::thread, messages::num_roles> threads_;
};

inline constexpr std::array all_roles = {messages::Role::plant, messages::Role::reference,
                                         messages::Role::controller, messages::Role::logger};

/// Returns scenarios/NAME.yaml with these overrides.
scenario::Scenario scenario(const std::string& name, const std::vector<std::string>& overrides);

/// Carries out one run from start to end.
RunResult run(const scenario::Scenario& scenario, const bus::NetworkFaults& faults = {});

}  // namespace tachless::system_test
