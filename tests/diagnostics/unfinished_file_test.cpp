#include "diagnostics/unfinished_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "diagnostics/failure.h"
#include "diagnostics/file_text.h"
#include "tests/support/temporary_directory.h"

namespace tachless::diagnostics {
namespace {

using ::testing::HasSubstr;

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
