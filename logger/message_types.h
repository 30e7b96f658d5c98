#pragma once

#include <cstddef>
#include <span>
#include <string_view>

namespace tachless::logger {

/// The name of a message's type by its LCM fingerprint, "tachless.tick_t"; empty when the type is
/// not one of ours. Looks at nothing else: the message may be undecodable all the same.
std::string_view type_name(std::span<const std::byte> message);

}  // namespace tachless::logger
