// The built command from outside: options, messages, exit codes. Nothing here reaches a bus.

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "base/json_text.h"
#include "base/text.h"
#include "tests/support/shell.h"
#include "tests/support/temporary_directory.h"

namespace tachless::command_test {
namespace {

namespace fs = std::filesystem;
using tachless::support::Outcome;
using tachless::support::shell;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

const std::string binary = TACHLESS_BINARY_DIR "/bin/tachless";
const std::string scenario = TACHLESS_SOURCE_DIR "/scenarios/paper_rigid.yaml";

Outcome tachless(const std::string& arguments) { return shell(binary + " " + arguments); }

long lines(const std::string& text) { return std::count(text.begin(), text.end(), '\n'); }

class Command : public ::testing::Test {
 protected:
  TemporaryDirectory directory_;
};

TEST_F(Command, TellsItsVersion) {
  const Outcome outcome = tachless("--version");
  EXPECT_EQ(outcome.exit_code, 0);
  EXPECT_THAT(outcome.output, StartsWith("tachless 0."));
  for (const char* word : {"-V", "-v", "version"}) {
    EXPECT_EQ(tachless(word).output, outcome.output) << word;
  }
}

TEST_F(Command, NamesTheOptionForRealtime) {
  const Outcome outcome = tachless("run " + scenario + " --realtime");
  EXPECT_EQ(outcome.exit_code, 2);
  EXPECT_THAT(outcome.output, HasSubstr("type --mode realtime"));
}

TEST_F(Command, PrintsNoProgressIntoAPipeWithinHalfAMinute) {
  const Outcome outcome = tachless("design " + scenario + " 2>&1");
  EXPECT_THAT(outcome.output, Not(HasSubstr("design: "))) << outcome.output;
}

TEST_F(Command, PrintsNoMarkup) {
  for (const char* words :
       {"--help", "run --help", "doctor --help", "spy --help", "spy", "info /nowhere"}) {
    EXPECT_THAT(tachless(words).output, Not(HasSubstr("`"))) << words;
  }
}

TEST_F(Command, CompareRefusesAnotherSweepsFolderBeforeItDesigns) {
  const std::string out = (directory_.path() / "out").string();
  const std::string compare = "compare " + scenario + " --laws loria_ortega_rigid -q --out " + out;
  EXPECT_EQ(tachless(compare + " --set loop.duration_s=0.01").exit_code, 0);
  const Outcome refused = tachless(compare + " --set loop.duration_s=0.02 --margin 0.5 2>&1");
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_THAT(refused.output, HasSubstr("another sweep is in this directory"));
}

TEST_F(Command, HelpNamesEveryVerbAndTheirHelpHasExamples) {
  const Outcome help = tachless("--help");
  EXPECT_EQ(help.exit_code, 0);
  for (const std::string verb : {"init", "run", "certify", "design", "compare", "sweep", "laws",
                                 "robot", "info", "replay", "report", "export", "doctor"}) {
    EXPECT_THAT(help.output, HasSubstr("  " + verb + " "));
    const Outcome of_verb = tachless(verb + " --help");
    EXPECT_EQ(of_verb.exit_code, 0);
    EXPECT_THAT(of_verb.output, HasSubstr("Examples:\n  tachless " + verb));
    EXPECT_EQ(tachless("help " + verb).output, of_verb.output);
    EXPECT_THAT(of_verb.output, Not(HasSubstr("out/paper_rigid/lcmlog"))) << "out/NAME/DATE-TIME/";
  }
  EXPECT_THAT(help.output, Not(HasSubstr("out/paper_rigid/lcmlog")));
  EXPECT_EQ(tachless("help").output, help.output);
  EXPECT_EQ(tachless("help nothing").exit_code, 2);
}

TEST_F(Command, CompletionsOfferWhatTheHelpTextsDeclare) {
  const Outcome rows = shell(TACHLESS_SOURCE_DIR "/cmake/completion.sh " + binary);
  EXPECT_EQ(rows.exit_code, 0);
  EXPECT_THAT(rows.output, AllOf(HasSubstr("tachless,* | help,help) offer='help init run "),
                                 HasSubstr("    run,--mode) offer='lockstep realtime' ;;\n"),
                                 HasSubstr("    run,--out) offer='' ;;\n"),
                                 HasSubstr("    info,*) [[ $now != -* ]] || offer='")));
}

TEST_F(Command, LawsListsEveryLawWithWhatItDeclares) {
  const Outcome table = tachless("laws");
  EXPECT_EQ(table.exit_code, 0) << table.output;
  const Outcome listed = tachless("laws --json");
  EXPECT_EQ(listed.exit_code, 0);
  const nlohmann::json laws = base::parse_json(listed.output);
  std::vector<std::string> pages;  // of docs/laws, which a test holds against the registry
  for (const auto& file : fs::directory_iterator(TACHLESS_SOURCE_DIR "/docs/laws")) {
    pages.push_back(file.path().stem());
  }
  std::vector<std::string> names;
  for (const auto& law : laws) {
    names.push_back(law.at("name"));
    EXPECT_THAT(table.output, HasSubstr("\n" + names.back() + " "));
    const Outcome page = tachless("laws " + names.back());
    for (const char* fact : {"measures", "proved", "source"}) {
      EXPECT_THAT(page.output, HasSubstr(law.at(fact).get<std::string>())) << law.at("name");
    }
    const auto conditions = law.at("conditions").get<std::string>();
    for (const std::string_view each : tachless::base::split(conditions, ';')) {  // a line each
      EXPECT_THAT(page.output, HasSubstr(fmt::format(" {}", each))) << law.at("name");
      EXPECT_THAT(each, Not(HasSubstr("\n")));
    }
    for (const auto& parameter : law.at("parameters")) {
      EXPECT_THAT(page.output,
                  HasSubstr(fmt::format("{:<17} [{}]", parameter.at("name").get<std::string>(),
                                        parameter.at("unit").get<std::string>())));
    }
  }
  EXPECT_THAT(names, ::testing::UnorderedElementsAreArray(pages));
  EXPECT_EQ(lines(table.output), static_cast<int>(names.size()) + 1) << "a line each";
  EXPECT_EQ(tachless("laws pd").exit_code, 2);
}

TEST_F(Command, RunRefusesALoopThatIsUnstableAtItsRate) {
  // 20 kHz is too slow for the paper's gains with a tick of delay: the limit is 34 us.
  const Outcome outcome = tachless("run " + scenario + " --set loop.command_delay=1");
  EXPECT_EQ(outcome.exit_code, 2) << outcome.output;
  EXPECT_EQ(lines(outcome.output), 1) << outcome.output;
  EXPECT_THAT(outcome.output, AllOf(HasSubstr("unstable at 20 kHz"), HasSubstr("34.22 µs"),
                                    HasSubstr("loop.period_s=2e-05"), HasSubstr("--force")));
}

TEST_F(Command, CertifyHasAPageAndJson) {
  const Outcome page = tachless("certify " + scenario + " --quiet --full --paper");
  EXPECT_EQ(page.exit_code, 0) << page.output;
  EXPECT_THAT(page.output, AllOf(HasSubstr("largest stable period"), HasSubstr("(19) eps <")));
  const Outcome unstable =
      tachless("certify " + scenario + " --quiet --json --set loop.command_delay=1 2> /dev/null");
  EXPECT_EQ(unstable.exit_code, 1);
  EXPECT_THAT(unstable.output, HasSubstr("\"stable\": false"));
}

TEST_F(Command, DesignWritesAScenarioThatCertifies) {
  const std::string robot = TACHLESS_SOURCE_DIR "/scenarios/robots/two_link.urdf";
  const std::string file = directory_ / "designed.yaml";
  const Outcome design = tachless("design " + robot + " --quiet --write " + file);
  EXPECT_EQ(design.exit_code, 0) << design.output;
  EXPECT_THAT(design.output, HasSubstr("limited by"));
  const Outcome certify = tachless("certify " + file + " --quiet");
  EXPECT_EQ(certify.exit_code, 0) << certify.output;
  EXPECT_THAT(certify.output, HasSubstr("; from rest "));
}

TEST_F(Command, DesignReadsABareUrdfAsTheSettingsOfTheRobotSay) {
  const std::string robot = TACHLESS_SOURCE_DIR "/scenarios/robots/two_link.urdf";
  const std::string file = directory_ / "designed.yaml";
  const Outcome design =
      tachless("design " + robot + " --quiet --set 'robot.locked={elbow: 0.5}' --write " + file);
  EXPECT_EQ(design.exit_code, 0) << design.output;
  const Outcome run = tachless("run --in-process --quiet " + file);
  EXPECT_EQ(run.exit_code, 0) << run.output;
  EXPECT_EQ(tachless("design " + robot + " --set 'robot.locked={wrist: 0.5}'").exit_code, 2);
}

TEST_F(Command, DesignOfASceneWritesThatMuJoCoMovesItWhereTheModuleIs) {
  const std::string file = directory_ / "scene.yaml";
  const std::string design = binary +
                             " design " TACHLESS_SOURCE_DIR
                             "/examples/mujoco/push_box.xml --structure diagonal --force --write " +
                             file + " 2>&1";
  const auto written = [&] {
    std::ifstream in(file);
    return std::string(std::istreambuf_iterator<char>(in), {});
  };
  const Outcome without = shell("TACHLESS_MUJOCO=/none " + design);
  EXPECT_EQ(without.exit_code, 0) << without.output;
  EXPECT_THAT(without.output, HasSubstr("no module for MuJoCo (package tachless-mujoco)"));
  EXPECT_THAT(written(), Not(HasSubstr("mujoco:")));
  if (!fs::exists(TACHLESS_BINARY_DIR "/lib/tachless/mujoco.so")) {
    GTEST_SKIP() << "built without MuJoCo";
  }
  const Outcome with = shell(design);
  EXPECT_EQ(with.exit_code, 0) << with.output;
  EXPECT_THAT(written(), HasSubstr("mujoco:"));
  const Outcome run =
      tachless("run --in-process --out " + (directory_ / "out").string() + " " + file);
  EXPECT_EQ(run.exit_code, 0) << run.output;
  EXPECT_THAT(run.output, HasSubstr("in free motion"));
}

TEST_F(Command, RefusesWhatItDoesNotKnowInOneLine) {
  for (const std::string& arguments : std::vector<std::string>{
           "fly", "run", "run " + scenario + " --no-such-option", "run " + scenario + " --run-id 0",
           "run " + scenario + " --run-id x", "run " + scenario + " --mode fast", "info",
           "export " + scenario, "export log -o - --run-id 0", "report log --run-id 0",
           "replay log --run-id 0", "doctor --json=perhaps"}) {
    const Outcome outcome = tachless(arguments);
    EXPECT_EQ(outcome.exit_code, 2) << arguments << "\n" << outcome.output;
    EXPECT_EQ(lines(outcome.output), 1) << arguments << "\n" << outcome.output;
    EXPECT_THAT(outcome.output, StartsWith("tachless: ")) << arguments;
  }
}

TEST_F(Command, AnEmptyWordIsNotTakenForAnOptionThatIsNotGiven) {
  for (const std::string& words : std::vector<std::string>{
           "run " + scenario + " --plant ''", "run " + scenario + " --controller ''",
           "run " + scenario + " --out ''", "commission " + scenario + " --plant ''",
           "design " + scenario + " --write ''", "doctor --scenario ''", "report log -o ''",
           "replay log --law ''", "sweep " + scenario + " --vary ''"}) {
    const Outcome outcome = tachless(words);
    EXPECT_EQ(outcome.exit_code, 2) << words << "\n" << outcome.output;
    EXPECT_THAT(outcome.output, HasSubstr(": empty; give a value, or leave the option out; see "))
        << words;
  }
  EXPECT_THAT(tachless("certify ''").output, HasSubstr("SCENARIO: empty; give a value"));
}

TEST_F(Command, AnOptionTakesOneWordAndLeavesTheScenarioToItsArgument) {
  const std::string rest = " " + scenario + " -q";
  const auto said = [&](const std::string& words) { return tachless(words + rest).output; };
  EXPECT_THAT(said("compare --laws none"), HasSubstr("no law \"none\""));
  EXPECT_THAT(said("sweep --laws none"), HasSubstr("no law \"none\""));
  EXPECT_THAT(said("design --stiffness 1,2,3"), HasSubstr("--stiffness has 3 numbers"));
  EXPECT_THAT(said("design --stiffness 1,2,3 --rest-error 1,0.1"),
              HasSubstr("--stiffness has 3 numbers"));
  EXPECT_THAT(said("design --from 0,0"), HasSubstr("--from: only for a URDF; in a scenario set"));
  EXPECT_THAT(said("compare --margin 0.5 --laws none --noise 1"), HasSubstr("no law \"none\""));
  EXPECT_THAT(said("certify --witness " + (directory_ / "w").string() + " --witness-error 1,2,3"),
              HasSubstr("--witness-error has 3 numbers"));
  EXPECT_THAT(said("excite --write move --unknown rotor"), HasSubstr("--write makes a scenario"));
  EXPECT_THAT(tachless("identify --unknown rotor /nowhere -q").output, HasSubstr("/nowhere"));
  EXPECT_EQ(tachless("robot --position 0,0 " + scenario + " --json").exit_code, 0);
}

TEST_F(Command, AMistypedOptionIsNotReportedAsAMissingFile) {
  const Outcome outcome = tachless("run " + scenario + " --outt o");
  EXPECT_EQ(outcome.exit_code, 2);
  EXPECT_EQ(outcome.output,
            "tachless: run: The following argument was not expected: --outt; see tachless run "
            "--help\n");
  EXPECT_THAT(tachless("run /nowhere.yaml").output, HasSubstr("/nowhere.yaml: no such file"));
}

TEST_F(Command, ANumberThatIsNotAboveZeroIsRefusedInWordsAsShort) {
  for (const std::string number : {"-1", "0", "nan", "inf", "x"}) {
    EXPECT_EQ(tachless("design " + scenario + " --settling " + number).output,
              "tachless: design: --settling: " + number +
                  "; allowed: a number above 0; see tachless design --help\n");
  }
}

TEST_F(Command, OptionsThatWouldBeIgnoredAreRefused) {
  for (const std::string& words : std::vector<std::string>{
           "sweep " + scenario + " --status --json", "sweep " + scenario + " --shard 1/2 --json",
           "watch --web --once", "watch --web --json"}) {
    const Outcome outcome = tachless(words);
    EXPECT_EQ(outcome.exit_code, 2) << words;
    EXPECT_THAT(outcome.output, HasSubstr(" excludes --")) << words;
  }
  const Outcome untuned = tachless("sweep " + scenario +
                                   " --vary loop.period_s=1e-3,2e-3 "
                                   "--bandwidth 8");
  EXPECT_THAT(untuned.output, HasSubstr("--bandwidth requires --laws"));
}

TEST_F(Command, ResultsThatCannotBePrintedEndWithCode2UnlessNobodyReadsThem) {
  const auto laws = [](const std::string& to) { return shell("(" + binary + " laws " + to + ")"); };
  const Outcome full = laws("> /dev/full");
  EXPECT_EQ(full.exit_code, 2);
  EXPECT_THAT(full.output, StartsWith("tachless: standard output: cannot be written"));
  EXPECT_EQ(lines(full.output), 1) << full.output;
  EXPECT_EQ(laws(">&-").output, "");
  // SIGPIPE is ignored there, so that the write fails; the pipe's reader has ended before it.
  const Outcome unread =
      shell("(trap '' PIPE; (sleep 0.3; " + binary + " laws; echo $? >&2) | true)");
  EXPECT_EQ(unread.output, "0\n");
}

TEST_F(Command, InitLeavesNothingWhenACopyFailsAndQuotesWhatIsToBeTyped) {
  const std::string arm = (directory_ / "my arm").string();
  // Blocks of 512 bytes: one is less than every file of a project.
  const Outcome full = shell("(ulimit -f 1; " + binary + " init '" + arm + "')");
  EXPECT_EQ(full.exit_code, 2) << full.output;
  EXPECT_THAT(full.output, HasSubstr("File too large"));
  EXPECT_TRUE(fs::is_empty(arm));
  EXPECT_THAT(tachless("init '" + arm + "'").output,
              HasSubstr("cd '" + arm + "' && tachless run arm.yaml\n"));
}

TEST_F(Command, CertifyReplacesNoFileWithAWitnessUnlessForced) {
  const std::string file = (directory_ / "scenario.yaml").string();
  fs::copy_file(scenario, file);
  const auto size = fs::file_size(file);
  const std::string command = "certify " + scenario + " -q --witness " + file;
  const Outcome refused = tachless(command);
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_THAT(refused.output,
              HasSubstr(file + ": exists already; name another file, or replace it with --force"));
  EXPECT_EQ(fs::file_size(file), size);
  EXPECT_THAT(tachless(command + " --force --witness-error 1,2,3").output,
              HasSubstr("--witness-error has 3 numbers"))
      << "not refused for the file";
  EXPECT_THAT(tachless("certify " + scenario + " --force").output,
              HasSubstr("--force requires --witness"));
}

TEST_F(Command, WithoutAVerbShowsTheVerbs) {
  const Outcome outcome = tachless("");
  EXPECT_EQ(outcome.exit_code, 2);
  EXPECT_THAT(outcome.output, HasSubstr("doctor"));
}

TEST_F(Command, RunRefusesABadScenarioBeforeItStartsAnything) {
  const std::string out = (directory_ / "out").string();
  for (const std::string& arguments : std::vector<std::string>{
           "/nowhere.yaml", scenario + " --set loop.period_s=-1",
           scenario + " --set controller.law=pd", scenario + " --set controller.gains.kp=[1]",
           scenario + " --duration never",
           scenario + " --set reference='{hold: {position_rad: [1]}}'",
           scenario + " --lcm-url tcp://x"}) {
    const Outcome outcome = tachless("run --out " + out + " " + arguments);
    EXPECT_EQ(outcome.exit_code, 2) << arguments << "\n" << outcome.output;
    EXPECT_EQ(lines(outcome.output), 1) << arguments << "\n" << outcome.output;
    EXPECT_FALSE(fs::exists(out + "/lcmlog"));
  }
}

TEST_F(Command, CertifyAndDesignRefuseAnUnknownLawAsRunDoes) {
  for (const std::string verb : {"certify ", "certify --json ", "design "}) {
    const Outcome outcome = tachless(verb + scenario + " --set controller.law=pd");
    EXPECT_EQ(outcome.exit_code, 2) << verb;
    EXPECT_THAT(outcome.output, AllOf(HasSubstr("controller.law=pd: controller.law: no law \"pd\""),
                                      Not(HasSubstr("internal error"))));
  }
}

TEST_F(Command, RunRefusesADirectoryItCannotUse) {
  const fs::path file = directory_ / "file";
  std::ofstream(file) << "mine";
  const Outcome outcome = tachless("run --isolate " + scenario + " --out " + file.string());
  EXPECT_EQ(outcome.exit_code, 2);
  EXPECT_THAT(outcome.output, AllOf(HasSubstr("--out " + file.string()), HasSubstr("choose")));
  EXPECT_EQ(lines(outcome.output), 1);
}

TEST_F(Command, RunRefusesToIsolateADriver) {
  const Outcome outcome = tachless("run --isolate --plant true " + scenario);
  EXPECT_EQ(outcome.exit_code, 2);
  EXPECT_THAT(outcome.output,
              HasSubstr("--isolate: with --plant the driver would be in the private "
                        "network too"));
  EXPECT_EQ(lines(outcome.output), 1);
}

TEST_F(Command, RobotShowsWhatIsReadOfAUrdf) {
  const std::string urdf = TACHLESS_SOURCE_DIR "/scenarios/robots/two_link.urdf";
  const Outcome text = tachless("robot " + urdf);
  EXPECT_EQ(text.exit_code, 0) << text.output;
  EXPECT_THAT(text.output, AllOf(HasSubstr("2 joints, 4 bodies"), HasSubstr("shoulder"),
                                 HasSubstr("root link is fixed"), HasSubstr("condition number")));
  // g_1 = 9.81 (7.6 sin 0.5 + 0.63 sin(-0.5)), by scenarios/robots/two_link.urdf's comment.
  const Outcome json = tachless("robot " + urdf + " --position 0.5,-1 --json");
  EXPECT_EQ(json.exit_code, 0);
  EXPECT_THAT(json.output, AllOf(HasSubstr("32.78"), HasSubstr("\"warnings\": []")));
  EXPECT_THAT(tachless("robot practical_rigid --set robot.locked.elbow=0.5").output,
              HasSubstr("1 joints"));
  EXPECT_THAT(tachless("robot " + urdf + " --set robot.locked.elbow=0.5").output,
              HasSubstr("1 joints"));
  const Outcome unread = tachless("robot " + urdf + " --set loop.period_s=1");
  EXPECT_EQ(unread.exit_code, 2);
  EXPECT_THAT(unread.output, HasSubstr("does not change how a URDF is read"));
  const Outcome wrong = tachless("robot " + urdf + " --position 1");
  EXPECT_EQ(wrong.exit_code, 2);
  EXPECT_THAT(wrong.output, HasSubstr("1 numbers; the robot has 2 joints: shoulder, elbow"));
  const Outcome info = tachless("info " + urdf);
  EXPECT_EQ(info.exit_code, 2);
  EXPECT_THAT(info.output, HasSubstr("tachless robot " + urdf));
}

TEST_F(Command, RobotShowsAnImpossibleOneAndSaysWhichKeyItNeeds) {
  std::ifstream from(TACHLESS_SOURCE_DIR "/scenarios/robots/two_link.urdf");
  std::string text(std::istreambuf_iterator<char>(from), {});
  const std::string inertia = "iyy=\"3.08\"";
  text.replace(text.find(inertia), inertia.size(), "iyy=\"30.8\"");
  const fs::path urdf = directory_ / "impossible.urdf";
  std::ofstream(urdf) << text;
  const Outcome outcome = tachless("robot " + urdf.string());
  EXPECT_EQ(outcome.exit_code, 1) << outcome.output;
  EXPECT_THAT(outcome.output, AllOf(HasSubstr("2 joints"), HasSubstr("warning: "),
                                    HasSubstr("robot.check_inertia: warn")));
}

TEST_F(Command, ADirectoryStandsForTheLogInIt) {
  const std::string out = (directory_ / "out").string();
  ASSERT_EQ(tachless("run " TACHLESS_SOURCE_DIR
                     "/scenarios/practical_rigid.yaml --in-process --duration 0.05 --out " +
                     out)
                .exit_code,
            0);
  EXPECT_EQ(tachless("info " + out).output, tachless("info " + out + "/lcmlog").output);
  EXPECT_THAT(tachless("replay " + out).output, HasSubstr("50 commands, bit for bit"));
  const Outcome without_a_change = tachless("replay " + out + " --out " + out + "/what_if");
  EXPECT_EQ(without_a_change.exit_code, 2);
  EXPECT_THAT(without_a_change.output, HasSubstr("name what is to be changed with --law or --set"));
  EXPECT_THAT(tachless("report " + out).output, HasSubstr(out + "/report.html"));
  EXPECT_EQ(tachless("report " + out + " " + out + "/lcmlog").exit_code, 2) << "no name for it";
  EXPECT_EQ(tachless("report " + out + " -o " + out + "/lcmlog").exit_code, 2) << "exists";
  const fs::path csv = directory_ / "log.csv";  // the log under a name that export takes
  fs::create_hard_link(out + "/lcmlog", csv);
  for (const std::string& words :
       std::vector<std::string>{"report " + out + " -o " + out + "/lcmlog --force",
                                "report " + out + " -o " + csv.string() + " --force",
                                "export " + out + " -o " + csv.string() + " --force"}) {
    EXPECT_THAT(tachless(words).output, HasSubstr("is the log that is read; name another file"));
  }
  EXPECT_EQ(tachless("info " + out).exit_code, 0) << "the log is as it was";
  EXPECT_EQ(tachless("export " + out + " -o " + out + "/run.csv").exit_code, 0);
  const std::string to_stdout = "(" + binary + " export " + out + " -o - ";
  EXPECT_EQ(shell(to_stdout + "| cmp - " + out + "/run.csv)").exit_code, 0);
  EXPECT_EQ(shell("((echo first; " + binary + " export " + out + " -o -) > " + out + "/added.csv)")
                .exit_code,
            0);
  EXPECT_EQ(shell("tail -n +2 " + out + "/added.csv | cmp - " + out + "/run.csv").exit_code, 0);
  EXPECT_EQ(shell(to_stdout + "> /dev/full)").exit_code, 2);
  const std::string empty = (directory_ / "empty").string();
  std::filesystem::create_directory(empty);
  EXPECT_THAT(tachless("info " + empty).output, HasSubstr(empty + "/lcmlog: cannot read the log"));
}

TEST_F(Command, RunDrawsTheShapesOfTheUrdfThatXacroMakes) {
  fs::create_directory(directory_ / "bin");
  const fs::path xacro = directory_ / "bin/xacro", robot = directory_ / "arm.urdf.xacro";
  std::ofstream(xacro) << "#!/bin/sh\ncp " TACHLESS_SOURCE_DIR
                          "/scenarios/robots/two_link.urdf \"$3\"\n";
  fs::permissions(xacro, fs::perms::owner_all);
  std::ofstream(robot) << "<robot/>";
  const std::string out = (directory_ / "out").string();
  const Outcome outcome =
      shell("PATH=" + (directory_ / "bin").string() + ":$PATH " + binary +
            " run --in-process --quiet --duration 0.01 --set robot.urdf=" + robot.string() +
            " --out " + out + " " + scenario);
  ASSERT_EQ(outcome.exit_code, 0) << outcome.output;
  std::ifstream page(out + "/report.html");
  EXPECT_THAT(std::string(std::istreambuf_iterator<char>(page), {}), HasSubstr("\\u003cvisual"));
}

TEST_F(Command, InfoAndExportRefuseWhatIsNoLog) {
  const fs::path file = directory_ / "file";
  std::ofstream(file) << "not a log";
  EXPECT_EQ(tachless("info /nowhere/lcmlog").exit_code, 2);
  EXPECT_EQ(tachless("replay " + file.string()).exit_code, 2);
  EXPECT_EQ(tachless("report " + file.string()).exit_code, 2);
  EXPECT_EQ(tachless("export " + file.string() + " -o " + file.string() + ".csv").exit_code, 2);
  EXPECT_EQ(tachless("export " + file.string() + " -o " + file.string() + ".doc").exit_code, 2);
}

}  // namespace
}  // namespace tachless::command_test
