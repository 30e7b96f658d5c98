#include "loop/messages.h"

#include <array>

namespace tachless::loop {

std::string_view name(Role role) {
  static constexpr std::array<std::string_view, num_roles> names = {"plant", "reference",
                                                                    "controller", "logger"};
  return names.at(static_cast<std::size_t>(role));
}

}  // namespace tachless::loop
