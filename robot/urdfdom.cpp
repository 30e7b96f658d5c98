#include "robot/urdfdom.h"

#include <console_bridge/console.h>
#include <fmt/format.h>
#include <urdf_parser/urdf_parser.h>

#include <exception>
#include <mutex>

#include "robot/urdf_tree.h"

namespace tachless::robot {
namespace {

/// While it lives, what urdfdom would print is kept instead. One at a time: urdfdom's channel is
/// global.
class UrdfdomMessages : public console_bridge::OutputHandler {
 public:
  UrdfdomMessages() : lock_(mutex()), level_(console_bridge::getLogLevel()) {
    console_bridge::setLogLevel(console_bridge::CONSOLE_BRIDGE_LOG_ERROR);
    console_bridge::useOutputHandler(this);
  }
  ~UrdfdomMessages() override {
    console_bridge::restorePreviousOutputHandler();
    console_bridge::setLogLevel(level_);
  }
  void log(const std::string& message, console_bridge::LogLevel, const char*, int) override {
    text += (text.empty() ? "" : "; ") + message;
  }

  std::string text;

 private:
  static std::mutex& mutex() {
    static std::mutex m;
    return m;
  }
  std::lock_guard<std::mutex> lock_;
  console_bridge::LogLevel level_;
};

}  // namespace

urdf::ModelInterfaceSharedPtr parse_with_urdfdom(const std::string& text,
                                                 const std::string& source) {
  urdf::ModelInterfaceSharedPtr urdf;
  UrdfdomMessages messages;
  try {
    urdf = urdf::parseURDF(text);
  } catch (const std::exception& e) {
    messages.text += (messages.text.empty() ? "" : "; ") + std::string(e.what());
  }
  // A link whose <inertial> does not parse is kept without it; urdfdom only prints the error.
  if (!urdf || !messages.text.empty()) {
    refuse_urdf(source,
                fmt::format("not a robot description: {}; correct the URDF",
                            messages.text.empty() ? "urdfdom gives no reason" : messages.text));
  }
  return urdf;
}

}  // namespace tachless::robot
