#include "base/file_text.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "base/failure.h"

namespace tachless::base {
namespace {

using ::testing::HasSubstr;

TEST(AFilesText, IsEveryByteOfIt) {
  const TemporaryDirectory directory;
  const std::string content("two\r\nlines\0and \xff", 16);
  std::ofstream(directory.path() / "file", std::ios::binary) << content;
  std::ofstream(directory.path() / "empty");
  EXPECT_EQ(file_text(directory.path() / "file"), content);
  EXPECT_EQ(file_text(directory.path() / "empty"), "");
}

TEST(AFilesText, IsNothingWhereThereIsNoneToRead) {
  const TemporaryDirectory directory;
  EXPECT_EQ(file_text(directory.path()), std::nullopt);
  errno = 0;
  EXPECT_EQ(file_text(directory.path() / "missing"), std::nullopt);
  EXPECT_EQ(errno, ENOENT);
}

TEST(AnUnfinishedFile, LeavesWhatWasThereUntilItIsWhole) {
  const TemporaryDirectory directory;
  const auto path = directory.path() / "table.csv";
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
  const auto path = directory.path() / "table.csv";
  const auto other = directory.path() / "other";
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
    const UnfinishedFile refused(directory.path() / "missing/table.csv", "name another with -o");
    ADD_FAILURE() << "before anything is written";
  } catch (const Failure& failure) {
    EXPECT_THAT(failure.what(),
                HasSubstr("table.csv: cannot be written: No such file or directory; "
                          "name another with -o"));
  }
  EXPECT_THROW(UnfinishedFile(directory.path() / ".", "name a file"), Failure);
}

TEST(TemporaryDirectory, GoesWithAllThatIsInIt) {
  std::filesystem::path path;
  {
    const TemporaryDirectory directory;
    path = directory.path();
    std::filesystem::create_directory(path / "inner");
    std::ofstream(path / "inner/file") << "text";
    EXPECT_TRUE(std::filesystem::exists(path / "inner/file"));
  }
  EXPECT_FALSE(std::filesystem::exists(path));
}

}  // namespace
}  // namespace tachless::base
