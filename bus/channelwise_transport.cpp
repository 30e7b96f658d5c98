#include "bus/channelwise_transport.h"

#include <algorithm>
#include <cerrno>
#include <system_error>

#include "bus/poll_until.h"

namespace tachless::bus {

void ChannelwiseTransport::subscribe(const std::string& channel) {
  if (std::ranges::find(boxes_, channel, &Box::channel) != boxes_.end()) return;
  auto transport = std::make_unique<UdpTransport>(sender_.url());
  transport->regard_as_own(sender_);
  transport->stamp_arrivals();
  transport->subscribe(channel);
  const std::ptrdiff_t yielded = yielded_ == nullptr ? -1 : yielded_ - boxes_.data();
  boxes_.push_back({channel, std::move(transport), std::nullopt});
  if (yielded >= 0) yielded_ = &boxes_[static_cast<std::size_t>(yielded)];
  descriptors_.resize(boxes_.size());
}

std::optional<Datagram> ChannelwiseTransport::receive(loop::Clock::time_point deadline) {
  if (yielded_ != nullptr) yielded_->first.reset();
  yielded_ = nullptr;
  for (;;) {
    const bool none = oldest() == nullptr;
    const Wake wake = look_into_empty_boxes(none ? deadline : loop::Clock::time_point::min());
    if (oldest() != nullptr) break;
    if (wake != Wake::looked) return std::nullopt;
  }
  // While the last box was looked into, older messages may have come into the first.
  look_into_empty_boxes(loop::Clock::time_point::min());
  yielded_ = oldest();
  return yielded_->first->datagram;
}

ChannelwiseTransport::Wake ChannelwiseTransport::look_into_empty_boxes(
    loop::Clock::time_point deadline) {
  nfds_t empty = 0;
  for (Box& box : boxes_) {
    if (!box.first && box.transport->holds_datagrams()) {
      box.first = box.transport->receive_raw(loop::Clock::time_point::min());
      if (box.first) deadline = loop::Clock::time_point::min();  // there is something: no wait
    }
    if (!box.first) descriptors_[empty++] = {box.transport->descriptor(), POLLIN, 0};
  }
  const int ready = poll_until({descriptors_.data(), empty}, deadline);
  if (ready < 0 && errno == EINTR) return Wake::signal;
  if (ready < 0) throw std::system_error(errno, std::generic_category(), "ppoll");
  if (ready == 0) return Wake::deadline;
  for (nfds_t i = 0; i < empty; ++i) {
    if (descriptors_[i].revents == 0) continue;
    const auto box = std::ranges::find_if(boxes_, [&](const Box& each) {
      return each.transport->descriptor() == descriptors_[i].fd;
    });
    box->first = box->transport->receive_raw(loop::Clock::time_point::min());
  }
  return Wake::looked;
}

ChannelwiseTransport::Box* ChannelwiseTransport::oldest() {
  Box* oldest = nullptr;
  for (Box& box : boxes_) {
    if (!box.first) continue;
    if (oldest == nullptr || box.first->received_ns < oldest->first->received_ns) oldest = &box;
  }
  return oldest;
}

}  // namespace tachless::bus
