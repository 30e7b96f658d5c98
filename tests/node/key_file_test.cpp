#include "node/key_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "diagnostics/failure.h"
#include "tests/support/temporary_directory.h"

using namespace tachless;

namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

class AKeyFile : public testing::Test {
 protected:
  void write(const std::string& content, mode_t mode = 0600) {
    std::ofstream(path, std::ios::binary) << content;
    ASSERT_EQ(chmod(path.c_str(), mode), 0);
  }
  std::string refusal() {
    try {
      node::read_key_file(path);
    } catch (const diagnostics::Failure& failure) {
      EXPECT_EQ(failure.code(), diagnostics::ExitCode::bad_usage);
      EXPECT_THAT(failure.what(), AllOf(HasSubstr("--key-file"), HasSubstr(path.string())));
      return failure.what();
    }
    return "accepted";
  }

  TemporaryDirectory directory;
  std::filesystem::path path = directory / "key";
  const std::string digits = "000102030405060708090a0b0c0d0e0f101112131415161718191A1B1C1D1E1F";
};

TEST_F(AKeyFile, Holds32BytesOr64HexadecimalDigits) {
  std::string bytes;
  for (int i = 0; i < 32; ++i) bytes.push_back(static_cast<char>(i));
  for (const std::string& content : {bytes, digits, digits + "\n", digits + "\r\n"}) {
    write(content);
    const bus::Key key = node::read_key_file(path);
    for (std::size_t i = 0; i < 32; ++i) EXPECT_EQ(key.bytes[i], i);
  }
}

TEST_F(AKeyFile, IsRefusedWhenMissingWithTheWayToMakeOne) {
  EXPECT_THAT(refusal(), AllOf(HasSubstr("No such file"), HasSubstr("/dev/urandom")));
}

TEST_F(AKeyFile, IsRefusedWhenOthersMayReadIt) {
  for (const mode_t mode : {0640, 0604, 0620, 0644}) {
    write(digits, mode);
    EXPECT_THAT(refusal(), HasSubstr("chmod 600"));
  }
}

TEST_F(AKeyFile, IsRefusedWithAnotherLengthOrDigitsThatAreNone) {
  for (const std::string& content : {std::string(), std::string(31, 'x'), std::string(33, 'x'),
                                     digits + "0", digits.substr(1), std::string(1000, '0')}) {
    write(content);
    EXPECT_THAT(refusal(), HasSubstr(std::to_string(content.size()) + " bytes"));
  }
  write("zz" + digits.substr(2));
  EXPECT_THAT(refusal(), HasSubstr("character 1"));
}

TEST_F(AKeyFile, IsNotAppearingInAnyMessage) {
  write("zz" + digits.substr(2));
  EXPECT_THAT(refusal(), Not(HasSubstr("0405")));
  write(digits + "0");
  EXPECT_THAT(refusal(), Not(HasSubstr("0405")));
}

TEST_F(AKeyFile, IsNoDirectoryAndNoPipe) {
  std::filesystem::create_directory(path);
  EXPECT_THAT(refusal(), HasSubstr("not a regular file"));
  std::filesystem::remove(path);
  ASSERT_EQ(mkfifo(path.c_str(), 0600), 0);
  EXPECT_THAT(refusal(), HasSubstr("not a regular file"));
}

}  // namespace
