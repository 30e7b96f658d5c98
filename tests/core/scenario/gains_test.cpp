#include "scenario/gains.h"

#include <gtest/gtest.h>

#include <limits>
#include <string>

namespace tachless::scenario {
namespace {

Vector vector(std::initializer_list<double> values) {
  return Eigen::Map<const Eigen::VectorXd>(values.begin(),
                                           static_cast<Eigen::Index>(values.size()));
}

TEST(GainsText, HoldsEveryNumberToTheLastBit) {
  const Gains gains = {{"a", vector({200, 200})},
                       {"kd", vector({0.1, 1.0 / 3})},
                       {"kp", vector({1e-300, std::numeric_limits<double>::max()})},
                       {"matrix", vector({2, -1, -1, 3})}};
  const std::string text = gains_text(gains);
  EXPECT_EQ(text.substr(0, 6), "a=200;");
  const auto again = read_gains(text, 2);
  ASSERT_TRUE(again);
  ASSERT_EQ(again->size(), gains.size());
  for (const auto& [name, value] : gains) EXPECT_EQ(again->at(name), value) << name;
}

TEST(GainsText, IsRefusedWhereItIsNone) {
  EXPECT_TRUE(read_gains("a=1", 7));
  for (const char* text :
       {"", "a", "a=", "=1", "a=1;", ";a=1", "a=1,", "a=,1", "a=1,2,3", "a=nan", "a=inf", "a=1e999",
        "a=0x1", "a= 1", "A=1", "a=1;a=2", "a b=1", "a=1\nb=2", "a=1=2"}) {
    EXPECT_FALSE(read_gains(text, 2)) << text;
  }
  // A matrix of nine joints has more entries than a vector can hold.
  std::string matrix = "a=0";
  for (int i = 1; i < 81; ++i) matrix += ",0";
  EXPECT_FALSE(read_gains(matrix, 9));
}

}  // namespace
}  // namespace tachless::scenario
