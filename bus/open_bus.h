#pragma once

#include <memory>

#include "bus/lcm_url.h"
#include "bus/transport.h"

namespace tachless::bus {

/// A transport on the bus that the URL names.
/// @throw std::system_error if the host or the server refuses, with what was refused and what to do
std::unique_ptr<Transport> open_bus(const LcmUrl& url);
/// For who listens to all of it.
std::unique_ptr<MonitoredBus> open_monitored_bus(const LcmUrl& url);

}  // namespace tachless::bus
