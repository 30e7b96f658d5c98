#include "bus/lcm_url.h"

#include <gmock/gmock.h>

#include <cstdlib>
#include <stdexcept>

namespace tachless::bus {
namespace {

using testing::HasSubstr;

std::string refusal(const std::string& url) {
  try {
    parse_lcm_url(url);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "accepted";
}

class LcmUrlTest : public testing::Test {
 protected:
  void SetUp() override { ::unsetenv("LCM_DEFAULT_URL"); }
  void TearDown() override { ::unsetenv("LCM_DEFAULT_URL"); }
};

TEST_F(LcmUrlTest, HasTheDefaultsOfLcm) {
  const LcmUrl url = parse_lcm_url("");
  EXPECT_EQ(url.text(), "udpm://239.255.76.67:7667?ttl=0");
}
TEST_F(LcmUrlTest, ReadsEveryPart) {
  const LcmUrl url = parse_lcm_url("udpm://239.1.2.3:1234?ttl=1&recv_buf_size=65536");
  EXPECT_EQ(url.group, "239.1.2.3");
  EXPECT_EQ(url.port, 1234);
  EXPECT_EQ(url.ttl, 1);
  EXPECT_EQ(url.receive_buffer_bytes, 65536);
}
TEST_F(LcmUrlTest, FillsInWhatIsLeftOut) {
  EXPECT_EQ(parse_lcm_url("udpm://").text(), "udpm://239.255.76.67:7667?ttl=0");
  EXPECT_EQ(parse_lcm_url("udpm://:8000").text(), "udpm://239.255.76.67:8000?ttl=0");
  EXPECT_EQ(parse_lcm_url("udpm://?ttl=2").text(), "udpm://239.255.76.67:7667?ttl=2");
  EXPECT_EQ(parse_lcm_url("udpm://239.1.2.3").text(), "udpm://239.1.2.3:7667?ttl=0");
}
TEST_F(LcmUrlTest, IsReadBackFromItsOwnText) {
  const std::string text = "udpm://239.1.2.3:1234?ttl=1&recv_buf_size=65536";
  EXPECT_EQ(parse_lcm_url(text).text(), text);
}
TEST_F(LcmUrlTest, ComesFromTheEnvironmentWhenEmpty) {
  ::setenv("LCM_DEFAULT_URL", "udpm://239.9.9.9:9999?ttl=1", 1);
  EXPECT_EQ(parse_lcm_url("").text(), "udpm://239.9.9.9:9999?ttl=1");
  EXPECT_EQ(parse_lcm_url("udpm://:8000").group, "239.255.76.67");
  ::setenv("LCM_DEFAULT_URL", "", 1);
  EXPECT_EQ(parse_lcm_url("").port, 7667);
  ::setenv("LCM_DEFAULT_URL", "memq://localhost", 1);
  EXPECT_THAT(refusal(""), HasSubstr("memq://localhost"));
}
TEST_F(LcmUrlTest, RefusesOtherProvidersAndSaysWhichIsNeeded) {
  for (const char* url : {"tcpq://localhost:7700", "file:///tmp/log", "memq://", "udpm", "udpm:/",
                          "239.255.76.67:7667", "UDPM://239.255.76.67:7667"}) {
    EXPECT_THAT(refusal(url), AllOf(HasSubstr(url), HasSubstr("udpm://239.255.76.67"))) << url;
  }
}
TEST_F(LcmUrlTest, RefusesWhatIsMalformedAndNamesValueAndRange) {
  EXPECT_THAT(refusal("udpm://10.0.0.1:7667"), HasSubstr("'10.0.0.1'"));
  EXPECT_THAT(refusal("udpm://localhost:7667"), HasSubstr("'localhost'"));
  EXPECT_THAT(refusal("udpm://239.255.76:7667"), HasSubstr("224.0.0.0 to 239.255.255.255"));
  EXPECT_THAT(refusal("udpm://239.255.76.67:0"), HasSubstr("1 to 65535"));
  EXPECT_THAT(refusal("udpm://239.255.76.67:65536"), HasSubstr("'65536'"));
  EXPECT_THAT(refusal("udpm://239.255.76.67:"), HasSubstr("port is ''"));
  EXPECT_THAT(refusal("udpm://239.255.76.67:76x7"), HasSubstr("'76x7'"));
  EXPECT_THAT(refusal("udpm://?ttl=256"), HasSubstr("0 to 255"));
  EXPECT_THAT(refusal("udpm://?ttl=-1"), HasSubstr("'-1'"));
  EXPECT_THAT(refusal("udpm://?ttl"), HasSubstr("ttl is ''"));
  EXPECT_THAT(refusal("udpm://?recv_buf_size=0"), HasSubstr("1 to 1000000000"));
  EXPECT_THAT(refusal("udpm://?tll=1"), HasSubstr("allowed are ttl and recv_buf_size"));
}

}  // namespace
}  // namespace tachless::bus
