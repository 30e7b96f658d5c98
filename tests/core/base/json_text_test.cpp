#include "base/json_text.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace tachless::base {
namespace {

TEST(JsonText, ReplacesWhatIsNotUtf8) {
  const nlohmann::ordered_json json = {{"path", "j\xf6rg/lcmlog"}, {"ticks", 3}};
  EXPECT_EQ(json_text(json), "{\"path\":\"j\xef\xbf\xbdrg/lcmlog\",\"ticks\":3}");
  EXPECT_EQ(json_text(nlohmann::json{{"a", 1}}, 2), "{\n  \"a\": 1\n}");
}

TEST(JsonText, ListsNumbersAndWritesNullForOthers) {
  const std::vector<double> numbers = {1, 0.1, HUGE_VAL, std::nan("")};
  EXPECT_EQ(json_text(json_list(numbers)), "[1.0,0.1,null,null]");
  EXPECT_EQ(json_text(json_list(std::vector<double>())), "[]");
}

}  // namespace
}  // namespace tachless::base
