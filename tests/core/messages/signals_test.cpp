#include "messages/signals.h"

#include <gmock/gmock.h>

namespace tachless::messages {
namespace {

TEST(Signals, TravelAsTextAndBack) {
  const std::array declared = {Signal{"error", "rad"}, Signal{"nu", "rad/s"},
                               Signal{"power", "N m"}, Signal{"count", ""}};
  const std::string text = text_of(declared);
  EXPECT_EQ(text, "error:rad,nu:rad/s,power:N m,count:");
  const auto parsed = parse_signals(text);
  ASSERT_TRUE(parsed);
  ASSERT_EQ(parsed->size(), declared.size());
  for (std::size_t i = 0; i < declared.size(); ++i) {
    EXPECT_EQ((*parsed)[i].name, declared[i].name);
    EXPECT_EQ((*parsed)[i].unit, declared[i].unit);
  }
}

TEST(Signals, NoneAreAnEmptyText) {
  EXPECT_EQ(text_of({}), "");
  ASSERT_TRUE(parse_signals(""));
  EXPECT_TRUE(parse_signals("")->empty());
}

TEST(Signals, WhatIsNoListOfNamesAndUnitsIsRefused) {
  for (const char* text :
       {",", "error", ":rad", "error:rad,", ",error:rad", "error:rad,,nu:rad", "a:b:c",
        "error:rad,nu", "error:rad,nu:rad/s\n!touch PWNED\n#", "e\nx:rad", "e x:rad", "1e:rad",
        "_e:rad", "e\"x:rad", "=e:rad", "e:\x7f", "é:rad"}) {
    EXPECT_FALSE(parse_signals(text)) << text;
  }
  std::string many = "s:rad";
  for (int i = 1; i < max_signals; ++i) many += ",s:rad";
  EXPECT_TRUE(parse_signals(many));
  EXPECT_FALSE(parse_signals(many + ",s:rad"));
}

}  // namespace
}  // namespace tachless::messages
