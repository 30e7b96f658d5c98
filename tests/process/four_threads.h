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

#include "app/scenario.h"
#include "app/session.h"
#include "bus/in_memory.h"
#include "bus/key.h"
#include "bus/wire.h"
#include "tests/temporary_directory.h"

/// The four real nodes in four threads on an in-memory bus.
namespace process_test {

struct Outcome {
  app::ExitCode code = app::ExitCode::done;
  std::string fault;
  app::Statistics statistics;
};

struct RunResult {
  std::map<bus::Role, Outcome> of;
  std::string log;  ///< the log file's bytes

  /// "" when all four ended well, else who did not and why.
  [[nodiscard]] std::string complaints() const;
};

/// Wraps a node's transport; takes the place of the network for that node.
using Wrapper =
    std::function<std::unique_ptr<bus::Transport>(bus::Role, std::unique_ptr<bus::Transport>)>;

class FourThreads {
 public:
  explicit FourThreads(const app::Scenario& scenario, const bus::NetworkFaults& faults = {});
  ~FourThreads();

  bus::InMemoryNetwork& network() { return network_; }
  void wrap(Wrapper wrapper) { wrapper_ = std::move(wrapper); }
  /// All four have it.
  void give_key(const bus::Key& key) { key_ = key; }
  /// The scenario of one role alone.
  void give(bus::Role role, const app::Scenario& scenario);
  /// What a user's Ctrl-C in that process does.
  void interrupt(bus::Role role) { interrupted_.at(static_cast<std::size_t>(role)) = true; }

  void start(bus::Role role);
  /// Waits for those that were started.
  void wait();
  /// Starts whoever is not running yet, waits for all and reads the log.
  RunResult finish();

  [[nodiscard]] std::filesystem::path log_path() const;

 private:
  app::Scenario scenario_;
  std::map<bus::Role, app::Scenario> own_;
  bus::InMemoryNetwork network_;
  TemporaryDirectory directory_;
  Wrapper wrapper_;
  std::optional<bus::Key> key_;
  std::array<std::atomic<bool>, bus::num_roles> interrupted_{};
  std::array<Outcome, bus::num_roles> outcomes_;
  std::array<std::thread, bus::num_roles> threads_;
};

inline constexpr std::array all_roles = {bus::Role::plant, bus::Role::reference,
                                         bus::Role::controller, bus::Role::logger};

/// scenarios/NAME.yaml with these overrides.
app::Scenario scenario(const std::string& name, const std::vector<std::string>& overrides);

/// One run from start to end.
RunResult run(const app::Scenario& scenario, const bus::NetworkFaults& faults = {});

}  // namespace process_test
