#include "diagnostics/file_text.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "diagnostics/failure.h"
#include "tests/support/temporary_directory.h"

namespace tachless::diagnostics {
namespace {

using ::testing::HasSubstr;

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

TEST(AnUnfinishedFile, LeavesWhatWasThereUntilItIsWhole) {
  const TemporaryDirectory directory;
  const auto path = directory / "table.csv";
  std::ofstream(path) << "earlier";
  {
    const UnfinishedFile abandoned(path, "name another");
    std::ofstream(abandoned.name()) << "half";
    EXPECT_EQ(file_text(path), "earlier");
  }
  EXPECT_EQ(file_text(path), "earlier");
  UnfinishedFile(path, "name another").write("whole");
  EXPECT_EQ(file_text(path), "whole");
  EXPECT_FALSE(std::filesystem::exists(path.string() + ".partial"));
}

TEST(AnUnfinishedFile, IsNotWrittenThroughALinkThatHasItsName) {
  const TemporaryDirectory directory;
  const auto path = directory / "table.csv";
  const auto other = directory / "other";
  std::ofstream(other) << "untouched";
  std::filesystem::create_symlink(other, path.string() + ".partial");
  UnfinishedFile(path, "name another").write("whole");
  EXPECT_EQ(file_text(path), "whole");
  EXPECT_FALSE(std::filesystem::is_symlink(path));
  EXPECT_EQ(file_text(other), "untouched");
}

TEST(AnUnfinishedFile, SaysWhyItCannotBeWrittenAndWhatToDo) {
  const TemporaryDirectory directory;
  try {
    const UnfinishedFile refused(directory / "missing/table.csv", "name another with -o");
    ADD_FAILURE() << "before anything is written";
  } catch (const Failure& failure) {
    EXPECT_THAT(failure.what(),
                HasSubstr("table.csv: cannot be written: No such file or directory; "
                          "name another with -o"));
  }
  EXPECT_THROW(UnfinishedFile(directory / ".", "name a file"), Failure);
}

}  // namespace
}  // namespace tachless::diagnostics
