#include "bus/key.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/prctl.h>
#include <sys/stat.h>

#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <span>
#include <sstream>
#include <string>
#include <string_view>

#include "base/failure.h"
#include "tests/support/sanitizer.h"
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
      bus::read_key_file(path);
    } catch (const base::Failure& failure) {
      EXPECT_EQ(failure.code(), base::ExitCode::bad_usage);
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
    const bus::Key key = bus::read_key_file(path).value();
    for (std::size_t i = 0; i < 32; ++i) EXPECT_EQ(key.bytes()[i], i);
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
  for (const std::string& content :
       {std::string(), std::string(31, 'x'), std::string(33, 'x'), digits + "0", digits.substr(1),
        std::string(1000, '0'), digits + "\n\n\n", digits + "\n\n\n" + digits}) {
    write(content);
    EXPECT_THAT(refusal(), HasSubstr(std::to_string(content.size()) + " bytes"));
  }
  write("zz" + digits.substr(2));
  EXPECT_THAT(refusal(), HasSubstr("character 1"));
}

TEST_F(AKeyFile, IsRefusedWhenAllZeros) {
  for (const std::string& content : {std::string(32, '\0'), std::string(64, '0')}) {
    write(content);
    EXPECT_THAT(refusal(), AllOf(HasSubstr("all zeros"), HasSubstr("/dev/urandom")));
  }
}

TEST_F(AKeyFile, MakesTheMemoryOfWhoReadsItPrivate) {
  write(digits);
  ASSERT_EQ(prctl(PR_SET_DUMPABLE, 1UL), 0);
  (void)bus::read_key_file(path);
  EXPECT_EQ(prctl(PR_GET_DUMPABLE), 0);
  ASSERT_EQ(prctl(PR_SET_DUMPABLE, 1UL), 0);
}

/// Returns the flags of the mapping that holds the byte, as in /proc/self/smaps.
std::string flags_of(const unsigned char* byte) {
  const auto address = reinterpret_cast<std::uintptr_t>(byte);
  std::ifstream maps("/proc/self/smaps");
  std::string line;
  bool inside = false;
  while (std::getline(maps, line)) {
    std::uintptr_t begin = 0, end = 0;
    char dash = 0;
    std::istringstream words(line);
    if (words >> std::hex >> begin >> dash >> end && dash == '-') {
      inside = begin <= address && address < end;
    } else if (inside && line.starts_with("VmFlags:")) {
      return line + " ";
    }
  }
  return "";
}

TEST_F(AKeyFile, IsKeptInMemoryThatIsLockedAndInNoDump) {
  write(digits);
  const bus::Key key = bus::read_key_file(path).value();
  const bus::Key copy = key;
  ASSERT_EQ(prctl(PR_SET_DUMPABLE, 1UL), 0);  // without it this test may not read them
  for (const bus::Key* each : {&key, &copy}) {
    const std::string flags = flags_of(each->bytes().data());
    EXPECT_THAT(flags, HasSubstr(" dd "));
#ifndef __SANITIZE_ADDRESS__  // which does without mlock
    EXPECT_THAT(flags, HasSubstr(" lo "));
#endif
  }
}

TEST_F(AKeyFile, IsNotAppearingInAnyMessage) {
  write("zz" + digits.substr(2));
  EXPECT_THAT(refusal(), Not(HasSubstr("0405")));
  write(digits + "0");
  EXPECT_THAT(refusal(), Not(HasSubstr("0405")));
}

TEST(NoKeyFile, IsRefusedWhileTheVariableIsSetButEmpty) {
  EXPECT_FALSE(bus::read_key_file(""));
  ASSERT_EQ(setenv("TACHLESS_KEY_FILE", "", 1), 0);
  try {
    bus::read_key_file("");
    ADD_FAILURE() << "runs without a key";
  } catch (const base::Failure& failure) {
    EXPECT_EQ(failure.code(), base::ExitCode::bad_usage);
    EXPECT_THAT(failure.what(), HasSubstr("TACHLESS_KEY_FILE is set but empty"));
  }
  unsetenv("TACHLESS_KEY_FILE");
}

TEST(ADigest, HasItsValueInNetworkOrder) {
  const auto digest_of = [](std::string_view text) {
    bus::Digest digest;
    digest.add(std::as_bytes(std::span(text)));
    return digest;
  };
  // BLAKE2b with 16 bytes of "abc", by Python: hashlib.blake2b(b"abc", digest_size=16)
  EXPECT_EQ(digest_of("abc").value(), static_cast<std::int64_t>(0xcf4ab791c62b8d2bULL));
  EXPECT_NE(digest_of("abc").value(), static_cast<std::int64_t>(0x2b8d2bc691b74acfULL))
      << "a host's own order";
}

TEST_F(AKeyFile, IsNoDirectoryAndNoPipe) {
  std::filesystem::create_directory(path);
  EXPECT_THAT(refusal(), HasSubstr("not a regular file"));
  std::filesystem::remove(path);
  ASSERT_EQ(mkfifo(path.c_str(), 0600), 0);
  EXPECT_THAT(refusal(), HasSubstr("not a regular file"));
}

}  // namespace
