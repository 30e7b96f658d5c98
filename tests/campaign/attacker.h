#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <span>
#include <string_view>
#include <thread>
#include <vector>

#include "bus/transport.h"
#include "messages/wire.h"
#include "tests/campaign/forger.h"
#include "tests/campaign/plan.h"
#include "tests/system/wrapped.h"

namespace tachless::campaign {

/// Ticks (-1: RUN_INFO) for which something false was sent: from there on the log of a run without
/// a key may differ. May be used from several threads.
class Lies {
 public:
  void note(std::span<const std::byte> payload);
  [[nodiscard]] std::set<std::int64_t> ticks() const;

 private:
  mutable std::mutex mutex_;
  std::set<std::int64_t> ticks_;
};

/// The attacker: receives everything on the network and, at random moments, does the deeds that are
/// planned, in a thread of its own. Without hostility it only records. Has no key.
class Attacker {
 public:
  /// `recording` and `lies` outlive it.
  /// @param endpoint does not hear what it sends itself
  /// @param on_received called in its thread after each datagram, with how many it has received
  Attacker(std::unique_ptr<bus::Transport> endpoint, const std::optional<Hostility>& plan,
           std::uint64_t seed, const std::vector<Sent>& recording, Lies& lies,
           std::function<void(std::size_t)> on_received = {});
  ~Attacker() { stop(); }
  Attacker(const Attacker&) = delete;
  Attacker& operator=(const Attacker&) = delete;

  void stop();
  /// Everything it has received; after `stop`.
  [[nodiscard]] const std::vector<Sent>& received() const { return received_; }
  [[nodiscard]] std::int64_t num_sent() const { return num_sent_; }

 private:
  void listen();
  void acknowledge();
  void act();
  void announce();
  void flood();
  void send(std::string_view channel, std::span<const std::byte> payload);
  void lie(const Sent& honest, const std::vector<std::byte>& payload);
  const Sent& pick();
  std::uint64_t below(std::uint64_t bound) { return random_() % bound; }
  bool chance(double probability) {
    return static_cast<double>(random_() >> 11) * 0x1p-53 < probability;
  }

  std::unique_ptr<bus::Transport> endpoint_;
  std::optional<Hostility> plan_;
  std::mt19937_64 random_;
  Forger forger_;
  const std::vector<Sent>& recording_;
  Lies& lies_;
  std::function<void(std::size_t)> on_received_;
  messages::Codec<messages::LogAck> acks_{messages::Layout{}};
  std::vector<Sent> received_;
  std::size_t replayed_ = 0;  ///< of the recording, in order
  std::size_t flooded_ = 0;   ///< bytes
  std::int64_t num_sent_ = 0;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

/// In front of an honest sender: whatever it answers, a false answer may come first, and the
/// honest one may be lost then.
class Raced : public system_test::Wrapped {
 public:
  Raced(std::unique_ptr<bus::Transport> inner, std::unique_ptr<bus::Transport> rival,
        const Hostility& plan, std::uint64_t seed, Lies& lies)
      : Wrapped(std::move(inner)),
        rival_(std::move(rival)),
        plan_(plan),
        random_(seed),
        forger_(seed),
        lies_(lies) {}
  void publish(std::string_view channel, std::span<const std::byte> payload) override;

 private:
  std::unique_ptr<bus::Transport> rival_;
  Hostility plan_;
  std::mt19937_64 random_;
  Forger forger_;
  Lies& lies_;
};

/// A member to which something happens at a certain datagram: its transport falls silent or throws
/// from then on, or it stands still for a while, or its user interrupts it.
class Afflicted : public system_test::Wrapped {
 public:
  /// @param happened set when it has  @param interrupt what a user's Ctrl-C does
  Afflicted(std::unique_ptr<bus::Transport> inner, const Mishap& mishap,
            std::atomic<bool>& happened, std::function<void()> interrupt)
      : Wrapped(std::move(inner)),
        mishap_(mishap),
        happened_(happened),
        interrupt_(std::move(interrupt)) {}
  void publish(std::string_view channel, std::span<const std::byte> payload) override;
  std::optional<bus::Datagram> receive(base::Clock::time_point deadline) override;

 private:
  [[nodiscard]] bool dead() const { return happened_ && mishap_.kind == Mishap::Kind::kill; }
  void count();
  void throw_if_failing() const;

  Mishap mishap_;
  int count_ = 0;
  std::atomic<bool>& happened_;
  std::function<void()> interrupt_;
};

}  // namespace tachless::campaign
