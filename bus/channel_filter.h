#pragma once

#include <linux/filter.h>

#include <string>
#include <vector>

namespace tachless::bus {

/// A classic BPF program for a UDP socket that passes exactly the LCM messages of the given
/// channels, so that the kernel drops everything else before it wakes the process. Of a message in
/// fragments it passes the first fragment. No channel: nothing passes.
/// @throw std::invalid_argument if the channels are too many for one program
std::vector<sock_filter> channel_filter(std::vector<std::string> channels);

}  // namespace tachless::bus
