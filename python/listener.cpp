#include <pybind11/stl.h>

#include <algorithm>
#include <chrono>
#include <exception>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "base/clock.h"
#include "base/failure.h"
#include "base/json_text.h"
#include "bus/udp_transport.h"
#include "live/bus_monitor.h"
#include "python/python_law.h"
#include "session/options.h"

namespace tachless::python {
namespace {

using base::Clock;
using bus::UdpTransport;

/// Returns a transport that receives the channels.
/// @param channels exact names; empty: all
/// @param url empty: $LCM_DEFAULT_URL, otherwise the programs' default
std::unique_ptr<UdpTransport> joined(const std::vector<std::string>& channels,
                                     const std::string& url) try {
  auto transport = std::make_unique<UdpTransport>(session::parse_lcm_url(url));
  for (const std::string& channel : channels) transport->subscribe(channel);
  if (channels.empty()) transport->subscribe_all();
  transport->read_in_batches(std::chrono::milliseconds(1));  // so no sender waits for this reader
  return transport;
} catch (const std::exception& problem) {
  throw base::bad_usage(problem.what());
}

/// Returns the next message that can be decoded, as JSON. Returns "" after `seconds` without one.
std::string take(UdpTransport& transport, double seconds) {
  const Clock::time_point end = Clock::now() + base::nanoseconds_of(seconds);
  do {
    std::vector<live::MessageField> fields;
    live::Glance seen;
    nlohmann::ordered_json json;
    {
      const py::gil_scoped_release unlocked;
      // Waits briefly, because Ctrl-C may have arrived meanwhile.
      const auto short_end = Clock::now() + std::chrono::milliseconds(50);
      if (const auto message = transport.receive(std::min(end, short_end))) {
        seen = live::glance(message->payload, &fields);
        json["channel"] = message->channel;
      }
    }
    if (PyErr_CheckSignals() != 0) throw py::error_already_set();
    if (seen.type.empty() || seen.rejection != messages::Rejection::none) continue;
    const auto& [utime, run, tick] = seen.stamp;
    json.update({{"type", seen.type}, {"utime", utime}, {"run", run}, {"tick", tick}});
    for (const auto& [name, unit, value] : fields) {
      nlohmann::ordered_json& field = json[name.substr(0, name.find('['))];
      if (!name.ends_with(']')) field = value;
      if (name.ends_with(']')) field.push_back(value);  // "value[0]", ...: entries of one list
    }
    return base::json_text(json);
  } while (Clock::now() < end);
  return "";
}

}  // namespace

void declare_listener(py::module_& module) {
  declare_class<UdpTransport>(module, "Listener").def(py::init(&joined)).def("take", &take);
}

}  // namespace tachless::python
