#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <functional>
#include <list>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include "bus/subscriptions.h"
#include "messages/truth/truth_wire.h"
#include "messages/wire.h"
#include "plant/node.h"
#include "session/session.h"
#include "tests/support/members.h"
#include "tests/support/node_outcome.h"

namespace tachless::plant {

inline constexpr auto controllers_address = "controller's address";

inline scenario::Scenario scenario(std::vector<std::string> overrides) {
  overrides.insert(overrides.begin(),
                   {"loop.mode=realtime", "loop.duration_s=0.03", "robot.gravity_m_per_s2=0",
                    "plant.encoder.resolution_bits=null"});
  return scenario::load_scenario(
      std::string(TACHLESS_SOURCE_DIR) + "/scenarios/practical_rigid.yaml", overrides);
}

/// Returns a torque that tells its tick.
inline Vector torque_of(std::int64_t tick) {
  Vector tau(2);
  tau << 1 + 0.5 * static_cast<double>(tick), -0.25 * static_cast<double>(tick);
  return tau;
}

/// Reference, controller and logger as the plant sees them, on a bus of their own.
class Peers : public bus::Transport {
 public:
  explicit Peers(const scenario::Scenario& scenario) : digest_(scenario.digest) {
    // The controller answers at once, until a test says otherwise.
    on_measurement = [this](std::int64_t tick) { command(tick, torque_of(tick)); };
  }

  std::function<void(std::int64_t tick)> on_measurement;
  std::function<void(std::int64_t tick)> on_truth = [](std::int64_t) {};
  std::function<void()> on_run_info = [] {};
  std::function<void()> on_first_announcement = [] {};

  std::string law = "loria_ortega_rigid";  ///< law that the controller announces
  std::string measurement = "POSITION";    ///< measurement that it asks for

  std::vector<messages::truth::PlantTruth> truths;
  std::vector<messages::truth::ArmTorque> arm_torques;
  std::vector<std::int64_t> truth_ticks, ticks, tick_utimes;
  std::vector<messages::Participant> heard_plant;

  void command(std::int64_t tick, const Vector& tau, std::string sender = controllers_address,
               std::int64_t run = 0) {
    messages::Codec<messages::TorqueCommand> codec(layout_);
    queue("ARM_COMMAND", codec.encode({0, run != 0 ? run : run_, tick}, {tau}), std::move(sender));
  }
  /// Sends a command with NaN for the last torque.
  void non_finite_command(std::int64_t tick, std::string sender) {
    messages::Codec<messages::TorqueCommand> codec(layout_);
    const auto sound = codec.encode({0, run_, tick}, {torque_of(tick)});
    std::vector<std::byte> bytes(sound.begin(), sound.end());
    std::fill(bytes.end() - 8, bytes.end(), std::byte{0xff});
    queue("ARM_COMMAND", bytes, std::move(sender));
  }
  /// Acknowledges as the logger that all ticks up to this one are recorded.
  /// @param missing bit i: tick + 1 + i is incomplete
  void acknowledge(std::int64_t tick, std::uint64_t missing = 0) {
    messages::Codec<messages::LogAck> codec(layout_);
    queue("ARM_LOG_ACK", codec.encode({0, run_, tick}, {missing}), "logger's address");
  }
  /// Time from a measurement to its torque, even while the plant sleeps.
  std::chrono::microseconds answering_time{0};

  void queue(std::string channel, std::span<const std::byte> bytes, std::string sender) {
    const auto at = base::Clock::now() +
                    (channel == "ARM_COMMAND" ? answering_time : std::chrono::microseconds(0));
    messages_.push_back({std::move(channel), {bytes.begin(), bytes.end()}, std::move(sender), at});
  }

  int subscribe(const std::string& channel) override { return channels_.add(channel); }

  /// Action of the bus at the plant's announcement of a fault.
  std::function<void()> on_fault = [] {};

  void publish(std::string_view channel, std::span<const std::byte> payload) override {
    messages::Stamp stamp;
    if (channel == "ARM_PARTICIPANT") {
      messages::Participant plant;
      ASSERT_EQ(participants_.decode(payload, stamp, plant), messages::Rejection::none);
      if (!plant.fault.empty()) on_fault();
      run_ = stamp.run;
      if (heard_plant.empty()) {
        on_first_announcement();
        members_.emplace(digest_, messages::Role::plant, messages::LawInfo{law, measurement, ""});
        members_->for_each([](session::Membership& each) { each.on_all_ticks_done(); });
      }
      heard_plant.push_back(plant);
      const auto now = base::Clock::now();
      members_->handle(stamp, plant, now);
      members_->for_each([&](session::Membership& each) {
        if (each.has_plant_finished()) each.on_finished(now);
      });
      members_->announce(now, [&](std::span<const std::byte> bytes, const std::string& address) {
        queue("ARM_PARTICIPANT", bytes, address);
      });
    } else if (channel == "ARM_RUN_INFO") {
      on_run_info();
    } else if (channel == "ARM_POSITION") {
      messages::PositionMeasurement position;
      ASSERT_EQ(positions_.decode(payload, stamp, position), messages::Rejection::none);
      on_measurement(stamp.tick);
    } else if (channel == "ARM_TICK") {
      messages::Tick tick;
      ASSERT_EQ(ticks_.decode(payload, stamp, tick), messages::Rejection::none);
      ticks.push_back(stamp.tick);
      tick_utimes.push_back(stamp.utime);
    } else if (channel == "ARM_TRUTH") {
      truths.emplace_back();
      ASSERT_EQ(truths_.decode(payload, stamp, truths.back()), messages::Rejection::none);
      truth_ticks.push_back(stamp.tick);
      on_truth(stamp.tick);
    } else if (channel == "ARM_ARM_TORQUE") {
      arm_torques.emplace_back();
      ASSERT_EQ(arm_torques_.decode(payload, stamp, arm_torques.back()), messages::Rejection::none);
    }
  }

  std::optional<bus::Datagram> receive(base::Clock::time_point deadline) override {
    const bool any = !messages_.empty();
    std::this_thread::sleep_until(any ? std::min(deadline, messages_.front().at) : deadline);
    if (!any || messages_.front().at > base::Clock::now()) return std::nullopt;
    current_ = std::move(messages_.front());
    messages_.pop_front();
    return bus::Datagram{.channel = current_.channel,
                         .payload = current_.payload,
                         .sender = current_.sender,
                         .channel_number = channels_.find(current_.channel)};
  }

 private:
  struct Message {
    std::string channel;
    std::vector<std::byte> payload;
    std::string sender;
    base::Clock::time_point at;  ///< time of its arrival
  };

  std::int64_t digest_;
  std::int64_t run_ = 0;
  messages::Layout layout_{.num_joints = 2, .num_motors = 0, .num_signals = 0};
  messages::Codec<messages::Participant> participants_{layout_};
  messages::Codec<messages::PositionMeasurement> positions_{layout_};
  messages::Codec<messages::Tick> ticks_{layout_};
  messages::Codec<messages::truth::PlantTruth> truths_{layout_};
  messages::Codec<messages::truth::ArmTorque> arm_torques_{layout_};
  std::optional<support::Members> members_;
  std::list<Message> messages_;
  bus::Subscriptions channels_;
  Message current_;
};

using Outcome = support::NodeOutcome;

/// Runs the plant. A `driver` replaces the emulator, a `simulator` its mechanics.
inline Outcome run(const scenario::Scenario& scenario, Peers& peers,
                   const std::atomic<bool>* interrupted = nullptr, RobotDriver* driver = nullptr,
                   Simulator* simulator = nullptr) {
  session::Session session(scenario, peers,
                           {.role = messages::Role::plant,
                            .run_id = 7,
                            .wait_s = 10,
                            .interrupted = interrupted,
                            .instance = 1});
  return support::outcome_of(session, [&] {
    if (driver != nullptr) {
      run_driver(scenario, session, *driver);
    } else if (simulator != nullptr) {
      run_simulator(scenario, session, *simulator);
    } else {
      run_node(scenario, session);
    }
  });
}

}  // namespace tachless::plant
