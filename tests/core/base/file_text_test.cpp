#include "base/file_text.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <optional>
#include <utility>

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
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(directory.path()), {}), 1);
}

/// A process that a signal ends cannot remove it.
TEST(AnUnfinishedFile, IsNotInItsFolder) {
  const TemporaryDirectory directory;
  const std::filesystem::path path = directory.path() / "file";
  UnfinishedFile file(path, "name another");
  std::ofstream(file.name()) << "half of it";
  EXPECT_TRUE(std::filesystem::is_empty(directory.path()));
  file.finish();
  EXPECT_EQ(file_text(path), "half of it");
  std::filesystem::remove(path);
  EXPECT_TRUE(std::filesystem::is_empty(directory.path()));
}

TEST(AnUnfinishedFile, OfTwoWritersIsWholeAndTheLastOneFinishedStays) {
  const TemporaryDirectory directory;
  const auto path = directory.path() / "table.csv";
  UnfinishedFile first(path, "name another");
  UnfinishedFile second(path, "name another");
  std::ofstream(second.name()) << "half";
  first.write("the first");
  EXPECT_EQ(file_text(path), "the first");  // not the other one's half
  second.write("the second, whole");
  EXPECT_EQ(file_text(path), "the second, whole");
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(directory.path()), {}), 1);
}

TEST(AnUnfinishedFile, ThatIsFinishedRemovesNoLaterWritersFile) {
  const TemporaryDirectory directory;
  const auto path = directory.path() / "table.csv";
  std::optional<UnfinishedFile> first(std::in_place, path, "name another");
  first->write("the first");
  UnfinishedFile second(path, "name another");
  first.reset();
  second.write("the second");
  EXPECT_EQ(file_text(path), "the second");
}

TEST(AnUnfinishedFile, ThatHasToBeNewLeavesAnEarlierOne) {
  const TemporaryDirectory directory;
  const auto path = directory.path() / "plan.json";
  UnfinishedFile first(path, "name another");
  UnfinishedFile second(path, "name another");
  EXPECT_TRUE(second.write_new("the second"));
  EXPECT_FALSE(first.write_new("the first"));
  EXPECT_EQ(file_text(path), "the second");
}

TEST(AnUnfinishedFile, IsWrittenToADeviceDirectly) {
  UnfinishedFile("/dev/null", "name another").write("text");
  EXPECT_THROW(UnfinishedFile("/dev/full", "name another").write("text"), Failure);
}

TEST(AnUnfinishedFile, SaysWhyItCannotBeWrittenAndWhatToDo) {
  const TemporaryDirectory directory;
  try {
    const UnfinishedFile refused(directory.path() / "missing/table.csv", "name another with -o");
    ADD_FAILURE() << "before anything is written";
  } catch (const Failure& failure) {
    EXPECT_THAT(
        failure.what(),
        HasSubstr("table.csv: cannot be written: No such file or directory; type: mkdir -p " +
                  (directory.path() / "missing").string()));
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
