#pragma once

#include <sys/types.h>

#include <map>
#include <string>

#include "bus/lcm_url.h"
#include "report/visuals.h"

namespace tachless::live {

using RobotVisuals = std::map<std::string, report::Visuals>;

/// The live pages of all robots on a bus, served by a child process of the least priority. The
/// child has limits on memory and files, so a browser or a flood cannot harm this process. The
/// child ends with this process.
class PageProcess {
 public:
  /// Starts the child. Call this before the process starts threads and before it reads a key: the
  /// child copies the memory of this process.
  /// @param visuals visuals of robots by name
  /// @param port 0: any free port
  /// @throw base::Failure(bad_usage) if the port or the bus is not available
  PageProcess(const bus::LcmUrl& url, const RobotVisuals& visuals, int port = 0);
  PageProcess(const PageProcess&) = delete;
  PageProcess& operator=(const PageProcess&) = delete;
  /// Kills the child and does not wait for browsers.
  ~PageProcess();

  [[nodiscard]] const std::string& url() const { return url_; }
  /// Prints the address, and opens it in the desktop's browser if there is a desktop.
  void show() const;
  /// Returns true if the child still serves the pages.
  [[nodiscard]] bool running();

 private:
  std::string url_;
  pid_t child_ = -1;  ///< -1: it has ended
};

}  // namespace tachless::live
