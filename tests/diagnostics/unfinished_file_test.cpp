#include "diagnostics/unfinished_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <iterator>

#include "diagnostics/failure.h"
#include "tests/support/temporary_directory.h"

namespace tachless::diagnostics {
namespace {

using ::testing::HasSubstr;

std::string text_of(const std::filesystem::path& path) {
  std::ifstream file(path);
  return {std::istreambuf_iterator<char>(file), {}};
}

TEST(AnUnfinishedFile, LeavesWhatWasThereUntilItIsWhole) {
  const TemporaryDirectory directory;
  const auto path = directory / "table.csv";
  std::ofstream(path) << "earlier";
  {
    const UnfinishedFile abandoned(path, "name another");
    std::ofstream(abandoned.name()) << "half";
    EXPECT_EQ(text_of(path), "earlier");
  }
  EXPECT_EQ(text_of(path), "earlier");
  UnfinishedFile(path, "name another").write("whole");
  EXPECT_EQ(text_of(path), "whole");
  EXPECT_FALSE(std::filesystem::exists(path.string() + ".partial"));
}

TEST(AnUnfinishedFile, SaysWhyItCannotBeWrittenAndWhatToDo) {
  const TemporaryDirectory directory;
  try {
    UnfinishedFile(directory / "missing/table.csv", "name another with -o").write("whole");
    ADD_FAILURE() << "written";
  } catch (const Failure& failure) {
    EXPECT_THAT(failure.what(),
                HasSubstr("table.csv: cannot be written: No such file or directory; "
                          "name another with -o"));
  }
  EXPECT_THROW(UnfinishedFile(directory / ".", "name a file"), Failure);
}

}  // namespace
}  // namespace tachless::diagnostics
