#include "node/loop.h"

#include <fmt/core.h>

#include <algorithm>

#include "diagnostics/logging.h"

namespace tachless::node {

using protocol::lockstep::Verdict;

void Loop::on(const std::string& channel, Handler handler) {
  transport_.subscribe(channel);
  diagnostics::log_detail("receives {}", channel);
  handlers_.emplace_back(channel, std::move(handler));
}

void Loop::run_until(const std::function<bool()>& done, const Turn& turn) {
  while (!done()) {
    const Time now = loop::Clock::now();
    session_.poll(now);
    const Time due = turn ? turn(now) : Time::max();
    receive(std::min(due, session_.next_poll()));
  }
}

void Loop::run_until_finished(const std::function<bool(Time)>& complete, const Turn& turn) {
  run_until([this] { return session_.finished(); },
            [&](Time now) {
              if (complete(now)) session_.complete();
              return turn ? turn(now) : Time::max();
            });
}

bool Loop::receive(Time deadline) {
  const auto datagram = transport_.receive(deadline);
  if (datagram) handle(*datagram);
  return datagram.has_value();
}

void Loop::handle(const bus::Datagram& datagram) {
  if (session_.handle(datagram)) {
    if (session_handler_) session_handler_(datagram);
    return;
  }
  for (const auto& [channel, handler] : handlers_) {
    if (channel == datagram.channel) return handler(datagram);
  }
}

void Loop::count(Verdict verdict) {
  Statistics& statistics = session_.statistics();
  if (verdict == Verdict::repeated) ++statistics.duplicates;
  if (verdict == Verdict::not_asked) statistics.rejected.add(Discard::not_asked);
  if (verdict == Verdict::too_old) statistics.rejected.add(Discard::too_old);
}

diagnostics::Failure Loop::two_of(loop::Role role, const bus::Datagram& second, std::int64_t tick,
                                  std::string_view first) const {
  return {diagnostics::ExitCode::protocol_violated,
          fmt::format("two processes are the {} of run {}: {} and {} sent different {} messages "
                      "for tick {}; the run's own is {}, end the other",
                      loop::name(role), session_.run(), first, second.sender, second.channel, tick,
                      session_.describe(role))};
}

}  // namespace tachless::node
