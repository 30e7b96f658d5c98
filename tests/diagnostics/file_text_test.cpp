#include "diagnostics/file_text.h"

#include <gtest/gtest.h>

#include <fstream>

#include "tests/support/temporary_directory.h"

namespace tachless::diagnostics {
namespace {

TEST(AFilesText, IsEveryByteOfIt) {
  const TemporaryDirectory directory;
  const std::string content("two\r\nlines\0and \xff", 16);
  std::ofstream(directory / "file", std::ios::binary) << content;
  std::ofstream(directory / "empty");
  EXPECT_EQ(file_text(directory / "file"), content);
  EXPECT_EQ(file_text(directory / "empty"), "");
}

TEST(AFilesText, IsNothingWhereThereIsNoneToRead) {
  const TemporaryDirectory directory;
  EXPECT_EQ(file_text(directory.path()), std::nullopt);
  errno = 0;
  EXPECT_EQ(file_text(directory / "missing"), std::nullopt);
  EXPECT_EQ(errno, ENOENT);
}

}  // namespace
}  // namespace tachless::diagnostics
