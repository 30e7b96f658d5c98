#include "bus/socket.h"

#include <gtest/gtest.h>
#include <sys/socket.h>

#include <array>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

#include "base/file_descriptor.h"

namespace tachless::bus {
namespace {

const std::string nul(1, '\0');
const std::string short_header = std::string("LC02") + std::string("\0\0\0\7", 4);

std::string fragment_header(char number) {
  return std::string("LC03") + std::string("\0\0\0\7\0\1\0\0\0\0\0\0\0", 13) + number +
         std::string("\0\2", 2);
}

/// A pair of local sockets, one of them with the filter. Each message gets eight bytes in front
/// instead of the UDP header.
class Filtered {
 public:
  explicit Filtered(const std::vector<std::string>& channels) {
    std::array<int, 2> ends{};
    EXPECT_EQ(::socketpair(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0, ends.data()), 0);
    in_ = base::FileDescriptor(ends[0]);
    out_ = base::FileDescriptor(ends[1]);
    std::vector<sock_filter> program = channel_filter(channels);
    const sock_fprog handle{static_cast<unsigned short>(program.size()), program.data()};
    EXPECT_EQ(::setsockopt(out_.get(), SOL_SOCKET, SO_ATTACH_FILTER, &handle, sizeof handle), 0);
  }
  /// Returns whether a datagram passes completely.
  bool passes(const std::string& datagram) {
    const std::string packet = std::string(8, '\xff') + datagram;
    EXPECT_EQ(::send(in_.get(), packet.data(), packet.size(), 0),
              static_cast<ssize_t>(packet.size()));
    std::array<char, 4096> buffer{};
    const ssize_t size = ::recv(out_.get(), buffer.data(), buffer.size(), 0);
    if (size < 0) return false;
    EXPECT_EQ(std::string(buffer.data(), static_cast<std::size_t>(size)), packet);
    return true;
  }
  bool passes_channel(const std::string& name) {
    const bool with_payload = passes(short_header + name + nul + "payload");
    EXPECT_EQ(passes(short_header + name + nul), with_payload) << "empty payload on " << name;
    return with_payload;
  }

 private:
  base::FileDescriptor in_;
  base::FileDescriptor out_;
};

TEST(ChannelFilter, PassesNothingWithoutChannels) {
  Filtered filtered({});
  EXPECT_FALSE(filtered.passes_channel("ARM_TICK"));
  EXPECT_FALSE(filtered.passes(""));
}
TEST(ChannelFilter, PassesExactlyTheNameAtEveryLength) {
  for (std::size_t length = 1; length <= 63; ++length) {
    std::string name;
    for (std::size_t i = 0; i < length; ++i) name += static_cast<char>('A' + i % 26);
    Filtered filtered({name});
    EXPECT_TRUE(filtered.passes_channel(name)) << length;
    EXPECT_FALSE(filtered.passes_channel(name + "X")) << length;
    EXPECT_FALSE(filtered.passes_channel(name.substr(1))) << length;
    EXPECT_FALSE(filtered.passes_channel(name.substr(0, length - 1))) << length;
    for (std::size_t i = 0; i < length; ++i) {
      std::string other = name;
      other[i] = '#';
      EXPECT_FALSE(filtered.passes_channel(other)) << length << " at " << i;
    }
    for (std::size_t cut = 0; cut < 8 + length + 1; ++cut) {
      EXPECT_FALSE(filtered.passes((short_header + name + nul).substr(0, cut))) << cut;
    }
  }
}
TEST(ChannelFilter, FindsAShortNameAmongLongOnesThatBeginAlike) {
  const std::vector<std::string> names = {"ARM_TICKET_OFFICE_WITH_A_LONG_NAME", "ARM_TICKET",
                                          "ARM_T", "ARM_TICK", "A"};
  Filtered filtered(names);
  for (const std::string& name : names) EXPECT_TRUE(filtered.passes_channel(name)) << name;
  for (const char* name : {"ARM", "ARM_TI", "ARM_TICKE", "B", "ARM_TICKET_"}) {
    EXPECT_FALSE(filtered.passes_channel(name)) << name;
  }
}
TEST(ChannelFilter, HoldsAHundredChannels) {
  std::vector<std::string> names;
  for (int i = 0; i < 100; ++i) names.push_back("ROBOT_CHANNEL_" + std::to_string(i));
  Filtered filtered(names);
  for (const std::string& name : names) EXPECT_TRUE(filtered.passes_channel(name)) << name;
  EXPECT_FALSE(filtered.passes_channel("ROBOT_CHANNEL_100"));
}
TEST(ChannelFilter, SaysWhenTheChannelsAreTooMany) {
  std::vector<std::string> names;
  for (int i = 0; i < 1000; ++i) names.push_back("ROBOT_CHANNEL_" + std::to_string(i));
  EXPECT_THROW(channel_filter(names), std::invalid_argument);
}
TEST(ChannelFilter, PassesTheFirstFragmentOfAChannelAndNoOther) {
  Filtered filtered({"ARM_TICK"});
  EXPECT_TRUE(filtered.passes(fragment_header(0) + "ARM_TICK" + nul + "payload"));
  EXPECT_FALSE(filtered.passes(fragment_header(1) + "ARM_TICK" + nul + "payload"));
  EXPECT_FALSE(filtered.passes(fragment_header(0) + "ARM_TOCK" + nul + "payload"));
}
TEST(ChannelFilter, DropsWhatIsNotLcm) {
  Filtered filtered({"ARM_TICK"});
  EXPECT_FALSE(filtered.passes("LC01" + std::string(4, '\0') + "ARM_TICK" + nul));
  EXPECT_FALSE(filtered.passes("LC04" + std::string(4, '\0') + "ARM_TICK" + nul));
  EXPECT_FALSE(filtered.passes("hello"));
}

}  // namespace
}  // namespace tachless::bus
