#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

namespace httplib {
class Server;
}

namespace tachless::live {

/// Serves the pages of runs that go on to browsers on this computer: listens on the loopback
/// interface alone, answers GET alone, and only under the names of this computer (no page of
/// another origin reads it, by DNS rebinding neither). What it serves cannot change anything.
///   /?robot=ARM          the page; without a robot that of the only one, or a list
///   /events?robot=ARM    its stretches as server-sent events, from those of the newest minute on
class LiveServer {
 public:
  /// @param port 0: one that is free
  /// @throw base::Failure(bad_usage) when the port cannot be listened on
  explicit LiveServer(int port);
  LiveServer(const LiveServer&) = delete;
  LiveServer& operator=(const LiveServer&) = delete;
  ~LiveServer();

  [[nodiscard]] std::string url() const;

  /// A robot's run begins: its page, and no stretch yet.
  void begin(const std::string& robot, std::string page);
  /// A stretch of that run, one line of JSON.
  void add(const std::string& robot, std::string stretch);

 private:
  struct Robot {
    std::string page;
    std::deque<std::string> stretches;  ///< of the newest minute
    std::int64_t first = 0;             ///< number of the first of them
  };

  [[nodiscard]] std::string page(const std::string& robot);
  /// The events from number `next` on, after waiting for one; "" when it is over.
  std::string events(const std::string& robot, std::int64_t& next);

  std::mutex mutex_;
  std::condition_variable changed_;
  std::map<std::string, Robot> robots_;
  std::atomic<bool> over_ = false;
  std::unique_ptr<httplib::Server> server_;
  int port_ = 0;
  std::thread thread_;
};

}  // namespace tachless::live
