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

/// Ticks (-1: RUN_INFO) for which a false message was sent. From such a tick on, the log of a run
/// without a key may differ. Several threads may use it.
class Lies {
 public:
  void note(std::span<const std::byte> payload);
  [[nodiscard]] std::set<std::int64_t> ticks() const;

 private:
  mutable std::mutex mutex_;
  std::set<std::int64_t> ticks_;
};

/// The attacker, in a thread of its own. It receives everything on the network and carries out the
/// planned attacks at random moments. Without hostility it only records. It has no key.
class Attacker {
 public:
  /// `recording` and `lies` must outlive the attacker.
  /// @param endpoint does not receive its own messages
  /// @param on_received is called in the attacker's thread after each datagram, with the number of
  /// received ones
  Attacker(std::unique_ptr<bus::Transport> endpoint, const std::optional<Hostility>& plan,
           std::uint64_t seed, const std::vector<Sent>& recording, Lies& lies,
           std::function<void(std::size_t)> on_received = {});
  ~Attacker() { stop(); }
  Attacker(const Attacker&) = delete;
  Attacker& operator=(const Attacker&) = delete;

  void stop();
  /// Returns all received messages; call it after `stop`.
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
  std::size_t replayed_ = 0;  ///< number of replayed messages of the recording, in order
  std::size_t flooded_ = 0;   ///< bytes
  std::int64_t num_sent_ = 0;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

/// Transport of an honest sender with a rival. A false message may come before the sender's
/// message, which may then be lost.
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

/// Transport of a member with a mishap at a certain datagram. From then on it falls silent or
/// throws, or the member pauses for a while, or the member's user interrupts it.
class Afflicted : public system_test::Wrapped {
 public:
  /// @param happened is set when the mishap has happened  @param interrupt does the same as a
  /// user's Ctrl-C
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
