#include "bus/open_bus.h"

#include "bus/tcpq_transport.h"
#include "bus/udp_transport.h"

namespace tachless::bus {

std::unique_ptr<Transport> open_bus(const LcmUrl& url) {
  if (url.is_tcp()) return std::make_unique<TcpqTransport>(url);
  return std::make_unique<UdpTransport>(url);
}

std::unique_ptr<MonitoredBus> open_monitored_bus(const LcmUrl& url) {
  if (url.is_tcp()) return std::make_unique<TcpqTransport>(url);
  return std::make_unique<UdpTransport>(url);
}

}  // namespace tachless::bus
