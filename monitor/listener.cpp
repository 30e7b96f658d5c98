#include "monitor/listener.h"

#include <poll.h>

#include <algorithm>
#include <chrono>
#include <utility>

namespace tachless::monitor {

using loop::Clock;

namespace {

void sleep_until(Clock::time_point end) {
  const auto left =
      std::max(std::chrono::nanoseconds(end - Clock::now()), std::chrono::nanoseconds(0));
  const timespec time{left.count() / 1'000'000'000, left.count() % 1'000'000'000};
  ppoll(nullptr, 0, &time, nullptr);  // a signal ends it
}

}  // namespace

void Listener::listen(Clock::time_point begin, Clock::time_point end) {
  while (!interrupted_ && Clock::now() < end) {
    const Clock::time_point drain_begin = Clock::now();
    const std::uint64_t count = drain(end);
    adapt(count, drain_begin);
    if (!interrupted_) sleep_until(std::min(end, Clock::now() + nap_));
  }
  drain_what_came_before_now();
  monitor_.end_stretch(std::chrono::duration<double>(Clock::now() - begin).count());
  monitor_.set_statistics(transport_.statistics());
}

std::uint64_t Listener::drain(Clock::time_point end) {
  constexpr std::uint64_t between_looks = 256;
  std::uint64_t count = 0;
  while (const auto datagram = transport_.receive(Clock::time_point::min())) {
    monitor_.take(*datagram);
    bytes_ += datagram->payload.size();
    if (++count % between_looks == 0 && (interrupted_ || Clock::now() >= end)) break;
  }
  return count;
}

/// What had arrived by now counts, however late this process gets to read it.
void Listener::drain_what_came_before_now() {
  const auto now_ns = std::chrono::duration_cast<std::chrono::nanoseconds>(
                          std::chrono::system_clock::now().time_since_epoch())
                          .count();
  while (const auto datagram = transport_.receive(Clock::time_point::min())) {
    monitor_.take(*datagram);
    if (datagram->received_ns >= now_ns) break;
  }
}

/// A quarter of the buffer has to hold what comes in one nap.
void Listener::adapt(std::uint64_t count, Clock::time_point begin) {
  constexpr double kernel_bytes_per_datagram = 1024;  // bookkeeping, at least doubled
  const double since_s = std::chrono::duration<double>(begin - last_drain_).count();
  last_drain_ = begin;
  const double bytes = static_cast<double>(std::exchange(bytes_, 0)) +
                       kernel_bytes_per_datagram * static_cast<double>(count);
  const double held_s = 0.25 * transport_.receive_buffer_bytes() * since_s / std::max(bytes, 1.0);
  const Clock::duration held = std::chrono::duration_cast<Clock::duration>(
      std::chrono::duration<double>(std::min(held_s, 1.0)));
  nap_ = std::clamp<Clock::duration>(std::min(held, 2 * nap_), shortest_nap, longest_nap);
}

}  // namespace tachless::monitor
