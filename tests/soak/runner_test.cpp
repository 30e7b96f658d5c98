// What a soak finds, when what is promised does not hold: programs that break a promise stand in
// for `tachless`.

#include "tests/soak/runner.h"

#include <gmock/gmock.h>
#include <sys/stat.h>

#include <atomic>
#include <fstream>

#include "process/process_tree.h"
#include "tests/support/private_network.h"
#include "tests/support/program.h"

namespace tachless::soak {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

class ASoakRound : public ::testing::Test {
 protected:
  /// @param misdeed shell commands after each run but the clean one; `$out` is its directory,
  /// `$code` the exit code
  Verdict after(const std::string& misdeed) {
    const std::string program = directory_ / "tachless";
    std::ofstream(program) << "#!/bin/bash\n" TACHLESS_BINARY_DIR "/bin/tachless \"$@\"\n"
                           << "code=$?; out=${5:-}\n"
                           << "if [[ $1 == run && $out == */soak-round ]]; then\n"
                           << misdeed << "\nfi\nexit $code\n";
    chmod(program.c_str(), 0700);
    Runner runner({.program = program,
                   .directory = directory_ / "out",
                   .scenarios = TACHLESS_SOURCE_DIR "/scenarios",
                   .num_ticks = 4'000},
                  interrupted_);
    Round round = plan_round(0);
    round.scenario = "practical_rigid";
    return runner.run(round).verdict;
  }

 private:
  TemporaryDirectory directory_;
  std::atomic<bool> interrupted_ = false;
};

TEST_F(ASoakRound, HoldsWhenNothingIsWrong) {
  const Verdict verdict = after("true");
  EXPECT_THAT(verdict.problems, IsEmpty());
  EXPECT_EQ(verdict.summary["ticks"], 4'000);
}

TEST_F(ASoakRound, NoticesALogOfWhichOneByteIsAnother) {
  // In the last message, which is TRUTH: the controller's commands stay what they were.
  const Verdict verdict = after(
      "printf '\\x55' | dd of=$out/lcmlog bs=1 conv=notrunc status=none "
      "seek=$(($(stat -c %s $out/lcmlog) - 40))");
  EXPECT_THAT(verdict.problems,
              ElementsAre(HasSubstr("the log differs from the clean run's, first in byte")));
}

TEST_F(ASoakRound, NoticesALogThatIsTooShort) {
  const Verdict verdict = after("truncate -s -1000 $out/lcmlog");
  EXPECT_THAT(verdict.problems, testing::Contains(HasSubstr("not as long as the clean run's")));
  EXPECT_THAT(verdict.problems, testing::Contains(HasSubstr("of 4000 ticks")));
}

TEST_F(ASoakRound, NoticesAnExitCodeThatWasNotPromised) {
  const Verdict verdict = after("code=3");
  EXPECT_THAT(verdict.problems,
              ElementsAre(AllOf(HasSubstr("exit code 3"), HasSubstr("promised was exit code 0"))));
}

TEST_F(ASoakRound, NoticesAProcessThatIsLeftBehindAndEndsIt) {
  const Verdict verdict =
      after("sleep 1000 > /dev/null 2>&1 & until [[ $(< /proc/$!/comm) == sleep ]]; do :; done");
  EXPECT_THAT(verdict.problems,
              ElementsAre(AllOf(HasSubstr("left behind: process"), HasSubstr("sleep"))));
  EXPECT_THAT(process::children_of(getpid()), IsEmpty());
}

}  // namespace
}  // namespace tachless::soak
