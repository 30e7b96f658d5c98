#pragma once

#include <optional>

#include "experiment/scenario.h"
#include "node/session.h"

namespace tachless::node {

/// A controller's part in a recorded run that lcm-logplayer plays back: it answers the questions of
/// that run at once. Nobody is met and nothing is announced; the run is over with its last tick.
class Playback final : public Session {
 public:
  struct Config {
    std::int64_t run = 0;
    double wait_s = 0;  ///< for the first message; 0 = unlimited
    const std::atomic<bool>* interrupted = nullptr;
  };

  Playback(const experiment::Scenario& scenario, const Config& config);

  void join(const loop::LawInfo& law, const Handler& other) override;
  [[nodiscard]] std::int64_t run() const override { return run_; }
  void started(loop::Clock::time_point now) override;
  void poll(loop::Clock::time_point now) override;
  [[nodiscard]] loop::Clock::time_point next_poll() const override { return next_poll_; }
  bool handle(const bus::Datagram& /*datagram*/) override { return false; }
  void handle_pending() override { poll(loop::Clock::now()); }
  void progressed(std::int64_t tick, double error_norm) override;
  void complete() override {}  // the last tick is the end
  [[nodiscard]] bool finished() const override { return tick_ >= last_tick_; }
  void leave() override { note_end(loop::Clock::now()); }
  [[nodiscard]] std::int64_t tick_of(loop::Role /*role*/) const override { return -1; }
  [[nodiscard]] std::string describe(loop::Role role) const override;
  [[nodiscard]] bool knows(std::string_view /*sender*/) const override { return false; }

 private:
  void announce_fault(const diagnostics::Failure& /*failure*/) override {}

  std::int64_t run_;
  std::int64_t last_tick_;
  std::optional<std::chrono::nanoseconds> wait_;
  std::chrono::nanoseconds give_up_;
  std::int64_t tick_ = -1;  ///< newest one answered
  loop::Clock::time_point progress_at_;
  loop::Clock::time_point next_poll_;
};

}  // namespace tachless::node
