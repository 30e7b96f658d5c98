#include "base/json_text.h"

#include <gtest/gtest.h>

namespace tachless::base {
namespace {

TEST(JsonText, ReplacesWhatIsNotUtf8) {
  const nlohmann::ordered_json json = {{"path", "j\xf6rg/lcmlog"}, {"ticks", 3}};
  EXPECT_EQ(json_text(json), "{\"path\":\"j\xef\xbf\xbdrg/lcmlog\",\"ticks\":3}");
  EXPECT_EQ(json_text(nlohmann::json{{"a", 1}}, 2), "{\n  \"a\": 1\n}");
}

}  // namespace
}  // namespace tachless::base
