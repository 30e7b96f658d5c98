// A log does not depend on the processor: with fused multiply-add hidden from the C library, which
// then takes other functions, each run gives the same bytes. In a network of their own.

#include <gtest/gtest.h>

#include <cstdlib>
#include <string>
#include <vector>

#include "tests/support/private_network.h"
#include "tests/support/program.h"

namespace tachless::same_bits_test {
namespace {

class SameBits : public testing::TestWithParam<const char*> {
 protected:
  /// Returns the bytes of the log of a run by `how`, with the processor's `masked` features hidden
  /// from glibc.
  std::string log(const std::string& how, const std::string& masked) {
    const std::string out = directory_ / (how + (masked.empty() ? "" : "_masked"));
    setenv("GLIBC_TUNABLES", ("glibc.cpu.hwcaps=" + masked).c_str(), 1);
    std::vector<std::string> words = {
        "run",      std::string(TACHLESS_SOURCE_DIR "/scenarios/") + GetParam() + ".yaml",
        "--run-id", "7",
        "--quiet",  "--out",
        out};
    if (how == "in_process") words.emplace_back("--in-process");
    words.insert(words.end(), {"--duration", "0.5"});
    output_of("tachless", words, directory_);
    unsetenv("GLIBC_TUNABLES");
    return contents(out + "/lcmlog");
  }

  TemporaryDirectory directory_;
};

TEST_P(SameBits, WithAndWithoutFusedMultiplyAdd) {
  const std::string masked = "-FMA,-FMA4,-AVX2";
  const std::string in_process = log("in_process", "");
  EXPECT_GT(in_process.size(), 100000U);
  EXPECT_TRUE(log("in_process", masked) == in_process);
  EXPECT_TRUE(log("bus", "") == in_process);
  EXPECT_TRUE(log("bus", masked) == in_process);
}

INSTANTIATE_TEST_SUITE_P(Scenarios, SameBits,
                         testing::Values("practical_flexible", "study_encoder", "xarm7"),
                         [](const auto& each) { return std::string(each.param); });

}  // namespace
}  // namespace tachless::same_bits_test
