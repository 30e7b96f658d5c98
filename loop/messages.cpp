#include "loop/messages.h"

#include <array>

namespace tachless::loop {

std::string_view name(Role role) {
  static constexpr std::array<std::string_view, num_roles> names = {"plant", "reference",
                                                                    "controller", "logger"};
  return names.at(static_cast<std::size_t>(role));
}

std::string_view name(ParticipantState state) {
  static constexpr std::array<std::string_view, 5> names = {"waiting", "ready", "running",
                                                            "finished", "fault"};
  return names.at(static_cast<std::size_t>(state));
}

}  // namespace tachless::loop
