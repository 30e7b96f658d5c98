#include "base/text.h"

#include <gtest/gtest.h>

namespace tachless::base {
namespace {

TEST(Table, AlignsColumnsByLettersAndEndsLinesWithoutSpaces) {
  EXPECT_EQ(table({{"joint", "peak", "rms", ""}, {"1 θ", "5", "-12.5", "rad"}}, "lrrl"),
            "  joint  peak    rms\n"
            "  1 θ       5  -12.5  rad\n");
}

TEST(Table, TakesTheLastLetterForFurtherColumnsAndRowsOfAnyLength) {
  EXPECT_EQ(table({{"a"}, {"b", "1", "22"}, {"c", "333", "4"}}, "lr"),
            "  a\n"
            "  b    1  22\n"
            "  c  333   4\n");
}

}  // namespace
}  // namespace tachless::base
