#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <list>
#include <map>
#include <memory>
#include <string>
#include <string_view>

#include "base/clock.h"
#include "base/file_descriptor.h"

namespace tachless::live {

/// Server of the pages of running robots, for browsers on this computer. It listens on the loopback
/// interface alone and answers GET alone. It refuses other host names, which stops DNS rebinding. A
/// stretch is one line of JSON with the newest values (live_run.h). A request cannot change
/// anything:
///   /?robot=ARM          the page; without `robot`: the page of the only robot, or a list
///   /events?robot=ARM    server-sent events of the robot, from the oldest kept stretch on
/// All work is done in `serve`, by one thread. Connections, headers, time and memory are bounded.
class LiveServer {
 public:
  static constexpr std::size_t most_robots = 16;
  static constexpr std::size_t most_streams = 16;
  static constexpr std::size_t most_connections = most_streams + 8;
  static constexpr std::size_t longest_request = 8192;  ///< bytes of the request line and headers
  static constexpr std::chrono::seconds longest_answering{10};  ///< longest time to send an answer
  static constexpr std::size_t kept_stretches = 2400;  ///< one minute with 40 stretches per second
  static constexpr std::size_t kept_bytes = 48'000'000;  ///< bytes of the stretches of all robots

  /// Listens on `port`; 0 takes any free port.
  /// @param longest_asking longest time in which a request has to arrive completely
  /// @throw base::Failure(bad_usage) if the port is not available
  explicit LiveServer(int port, std::chrono::milliseconds longest_asking = std::chrono::seconds(1));

  [[nodiscard]] std::string url() const;
  /// Returns the listening socket.
  [[nodiscard]] int descriptor() const { return listening_.get(); }

  /// Replaces a robot's page at the beginning of a run and deletes the robot's stretches. Robots
  /// beyond `most_robots` are left out.
  void begin(const std::string& robot, std::string page);
  /// Adds a stretch of that run, one line of JSON. The oldest stretches are deleted if necessary.
  void add(const std::string& robot, std::string stretch);

  /// Serves browsers until `until`.
  void serve(base::Clock::time_point until);

 private:
  using Text = std::shared_ptr<const std::string>;
  struct Robot {
    Text page;
    std::deque<Text> stretches;  ///< newest stretches
    std::int64_t first = 0;      ///< number of the oldest kept stretch
    std::size_t bytes = 0;       ///< of the stretches
  };
  struct Connection {
    base::FileDescriptor socket;
    base::Clock::time_point deadline;  ///< deadline for the next progress
    std::string request;               ///< received part
    Text answer;                       ///< text being sent
    std::size_t sent = 0;              ///< bytes of `answer`
    Text body;                         ///< follows `answer`
    bool answering = false;
    bool streams = false;
    std::string robot;      ///< robot of a stream
    std::int64_t next = 0;  ///< number of the next stretch to send
  };

  void accept_connections(base::Clock::time_point now);
  [[nodiscard]] bool advance(Connection& connection, base::Clock::time_point now);
  [[nodiscard]] bool read_request(Connection& connection);
  void answer(Connection& connection);
  [[nodiscard]] bool write_answer(Connection& connection, base::Clock::time_point now);
  bool load_stretch(Connection& connection);
  [[nodiscard]] Text page(const std::string& robot) const;

  std::chrono::milliseconds longest_asking_;
  std::map<std::string, Robot> robots_;
  std::size_t bytes_ = 0;  ///< bytes of all stretches
  base::FileDescriptor listening_;
  int port_ = 0;
  std::list<Connection> connections_;
};

}  // namespace tachless::live
