#include "tests/system/four_threads.h"

#include <unistd.h>

#include <fstream>
#include <iterator>

#include "base/logging.h"
#include "controller/node.h"
#include "logger/node.h"
#include "plant/node.h"
#include "reference/node.h"

namespace tachless::system_test {
namespace {

using messages::Role;

void run_role(Role role, const scenario::Scenario& scenario, session::Session& session,
              const std::filesystem::path& log_path) {
  switch (role) {
    case Role::plant:
      return plant::run_node(scenario, session);
    case Role::reference:
      return reference::run_node(scenario, session);
    case Role::controller:
      return controller::run_node(scenario, controller::scenario_law(scenario), session);
    case Role::logger:
      return logger::run_node(scenario, session, log_path);
  }
}

}  // namespace

std::string RunResult::complaints() const {
  std::string result;
  for (const auto& [role, outcome] : of) {
    if (outcome.code == base::ExitCode::done) continue;
    result += std::string(messages::name(role)) + ": exit " +
              std::to_string(static_cast<int>(outcome.code)) + ", " + outcome.fault + "\n";
  }
  return result;
}

FourThreads::FourThreads(const scenario::Scenario& scenario, const bus::NetworkFaults& faults)
    : scenario_(scenario), network_(faults) {}

FourThreads::~FourThreads() {
  for (auto& flag : interrupted_) flag = true;
  wait();
}

std::filesystem::path FourThreads::log_path() const { return directory_ / "lcmlog"; }

void FourThreads::give(Role role, const scenario::Scenario& scenario) {
  own_.insert_or_assign(role, scenario);
}

void FourThreads::start(Role role) {
  // Before there is a second thread, as the programs do, and once.
  [[maybe_unused]] static const bool logging =
      (base::start_logging("four_threads", base::Verbosity::normal), true);
  const auto index = static_cast<std::size_t>(role);
  const auto mine = own_.find(role);
  const scenario::Scenario& scenario = mine != own_.end() ? mine->second : scenario_;
  auto transport = network_.connect(std::string(messages::name(role)) + "'s endpoint");
  if (wrapper_) transport = wrapper_(role, std::move(transport));
  threads_.at(index) = std::thread([this, role, index, &scenario, endpoint = std::move(transport)] {
    session::Session session(
        scenario, *endpoint,
        {.role = role,
         .run_id = role == Role::plant ? std::optional<std::int64_t>(7) : std::nullopt,
         .wait_s = wait_s_,
         .interrupted = &interrupted_.at(index),
         .key = key_});
    outcomes_.at(index) =
        support::outcome_of(session, [&] { run_role(role, scenario, session, log_path()); });
  });
}

void FourThreads::wait() {
  for (std::thread& thread : threads_) {
    if (thread.joinable()) thread.join();
  }
}

RunResult FourThreads::finish() {
  RunResult result;
  for (const Role role : all_roles) {
    if (!threads_.at(static_cast<std::size_t>(role)).joinable()) start(role);
  }
  wait();
  for (const Role role : all_roles) {
    result.of[role] = outcomes_.at(static_cast<std::size_t>(role));
  }
  std::ifstream log(log_path(), std::ios::binary);
  result.log = {std::istreambuf_iterator<char>(log), {}};
  return result;
}

scenario::Scenario scenario(const std::string& name, const std::vector<std::string>& overrides) {
  return scenario::load_scenario(
      std::filesystem::path(TACHLESS_SOURCE_DIR) / "scenarios" / (name + ".yaml"), overrides);
}

RunResult run(const scenario::Scenario& scenario, const bus::NetworkFaults& faults) {
  return FourThreads(scenario, faults).finish();
}

}  // namespace tachless::system_test
