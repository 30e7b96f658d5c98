#include "scenario/yaml_tree.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include "base/failure.h"
#include "tests/support/sanitizer.h"

namespace tachless::scenario {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

std::string refusal_of_yaml(const std::string& text) {
  try {
    parse_yaml(text, "f.yaml");
  } catch (const base::Failure& failure) {
    EXPECT_EQ(failure.code(), base::ExitCode::bad_usage);
    EXPECT_THAT(failure.what(), Not(HasSubstr("\n")));
    return failure.what();
  }
  return "accepted";
}

std::string after(const std::string& text, const std::string& assignment) {
  YamlNode root = parse_yaml(text, "f.yaml");
  apply_override(root, assignment);
  return emit_yaml(root);
}

std::string override_refusal(const std::string& assignment) {
  try {
    return after("a: {b: 1}\n", assignment);
  } catch (const base::Failure& failure) {
    return failure.what();
  }
}

TEST(YamlTree, RemembersTheLineOfEveryKey) {
  const YamlNode root = parse_yaml("a: 1\nb:\n  c: [1,\n    2]\n  d: {e: x}\n", "f.yaml");
  EXPECT_EQ(root.find("a")->where, "f.yaml:1");
  EXPECT_EQ(root.find("b")->where, "f.yaml:2");
  EXPECT_EQ(root.find("b")->find("c")->where, "f.yaml:3");
  EXPECT_EQ(root.find("b")->find("c")->children[1].where, "f.yaml:4");
  EXPECT_EQ(root.find("b")->find("d")->find("e")->where, "f.yaml:5");
  EXPECT_EQ(root.find("z"), nullptr);
  EXPECT_EQ(root.find("a")->find("z"), nullptr);
}

TEST(YamlTree, TellsNumbersFromTextInQuotes) {
  const YamlNode root = parse_yaml("a: 5\nb: \"5\"\nc: '5'\nd: null\ne:\n", "f.yaml");
  EXPECT_FALSE(root.find("a")->quoted);
  EXPECT_TRUE(root.find("b")->quoted);
  EXPECT_TRUE(root.find("c")->quoted);
  EXPECT_EQ(root.find("d")->kind, YamlNode::Kind::null);
  EXPECT_EQ(root.find("e")->kind, YamlNode::Kind::null);
}

TEST(YamlTree, RefusesAKeyGivenTwice) {
  EXPECT_THAT(refusal_of_yaml("a: 1\nb:\n  c: 1\n  d: 2\n  c: 3\n"),
              AllOf(StartsWith("f.yaml:5: b.c: given twice"), HasSubstr("line 3")));
}

TEST(YamlTree, RefusesWhatIsNotYaml) {
  EXPECT_THAT(refusal_of_yaml("a: 1\nb: [1, 2\nc: 3\n"), StartsWith("f.yaml:"));
  EXPECT_THAT(refusal_of_yaml("a: 1\n  b: 2\n"),
              AllOf(StartsWith("f.yaml:2: "), HasSubstr("not YAML")));
  EXPECT_THAT(refusal_of_yaml("a: {b: 1\n"), HasSubstr("not YAML"));
  EXPECT_THAT(refusal_of_yaml("a:\n\tb: 1\n"),
              AllOf(StartsWith("f.yaml:2: "), HasSubstr("; indent by blanks, not tabs")));
  EXPECT_THAT(refusal_of_yaml("a: 1\n  b: \t2\n"), Not(HasSubstr("tabs")));
  EXPECT_THAT(refusal_of_yaml("a: *nowhere\n"), HasSubstr("not YAML"));
}

TEST(YamlTree, RefusesWhatItDoesNotMean) {
  EXPECT_THAT(refusal_of_yaml("a: !!float 1\n"),
              AllOf(StartsWith("f.yaml:1: a: "), HasSubstr("tag")));
  EXPECT_THAT(refusal_of_yaml("a: 1\n---\nb: 2\n"), HasSubstr("second document"));
  EXPECT_THAT(refusal_of_yaml("? [1, 2]\n: 3\n"), HasSubstr("key"));
  EXPECT_THAT(refusal_of_yaml("a: 1\nb: \x04\nc: 2\n"),
              AllOf(StartsWith("f.yaml:2: "), HasSubstr("control character 4")));
  EXPECT_THAT(refusal_of_yaml(std::string("a: 1\n\0", 6)), HasSubstr("control character 0"));
}

TEST(YamlTree, ExpandsAliasesButNotWithoutEnd) {
  EXPECT_EQ(parse_yaml("a: &x [1, 2]\nb: *x\n", "f.yaml").find("b")->children[1].scalar, "2");
  EXPECT_THAT(refusal_of_yaml("a: &x [*x]\n"), HasSubstr("a"));
  std::string bomb = "a: &a [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n";
  for (char name = 'b'; name < 'j'; ++name) {
    bomb += name;
    bomb += ": &";
    bomb += name;
    for (int i = 0; i < 10; ++i) {
      bomb += i == 0 ? " [*" : ", *";
      bomb += static_cast<char>(name - 1);
    }
    bomb += "]\n";
  }
  EXPECT_THAT(refusal_of_yaml(bomb), HasSubstr("too large"));
  EXPECT_THAT(refusal_of_yaml("a: " + std::string(400, '[') + std::string(400, ']')),
              HasSubstr("too deeply"));
  EXPECT_THAT(refusal_of_yaml("a: " + std::string(100'000, '[')), StartsWith("f.yaml:"));
}

TEST(YamlTree, BoundsAKey) {
  EXPECT_THAT(refusal_of_yaml("a: {" + std::string(101, 'k') + ": 1}\n"),
              AllOf(StartsWith("f.yaml:1: a: "), HasSubstr("101 bytes; allowed: at most 100")));
}

TEST(YamlTree, AnOverrideOfAnyTextIsThatText) {
  for (const std::string text : {"../arm #2/a.urdf", "a: b", "plain/path.urdf", "'q'", "[x"}) {
    YamlNode root = parse_yaml("a: 1\n", "f.yaml");
    apply_override(root, text_override("a", text));
    EXPECT_EQ(root.find("a")->scalar, text);
  }
  EXPECT_EQ(text_override("a", "plain/path.urdf"), "a=plain/path.urdf");
}

// yaml-cpp's loader takes all memory for these two, and 10 GB for the third.
TEST(YamlTree, TakesNoMoreMemoryThanTheBoundsAllow) {
#ifndef __SANITIZE_ADDRESS__  // its own maps are larger than any limit
  rlimit before{};
  getrlimit(RLIMIT_AS, &before);
  const rlimit limited{4'000'000'000, before.rlim_max};
  setrlimit(RLIMIT_AS, &limited);
#endif
  EXPECT_THAT(refusal_of_yaml("{: {{},\n{}},},"), StartsWith("f.yaml:"));
  EXPECT_THAT(refusal_of_yaml("{name: a, b: {c: 1}},\n  d: {e: 1}}\n"),
              HasSubstr("second document"));
  std::string copies = "a: &x " + std::string(500'000, 'y') + "\nb: [*x";
  for (int i = 0; i < 19'000; ++i) copies += ", *x";
  EXPECT_THAT(refusal_of_yaml(copies + "]\n"), HasSubstr("b[1]: too large"));
  EXPECT_THAT(refusal_of_yaml("a: " + std::string(1'000'000, 'y')),
              HasSubstr("allowed: at most 1000000"));
#ifndef __SANITIZE_ADDRESS__
  setrlimit(RLIMIT_AS, &before);
#endif
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  EXPECT_LT(usage.ru_maxrss, 2'000'000) << "KiB; the least of the three took 10 GB";
}

TEST(YamlTree, AnOverrideReplacesCreatesAndTurnsAScalarIntoAMap) {
  EXPECT_EQ(after("a: {b: 1, c: 2}\n", "a.b=5"), "a:\n  b: 5\n  c: 2\n");
  EXPECT_EQ(after("a: {b: 1, c: 2}\n", "a={d: [1, 2]}"), "a:\n  d: [1, 2]\n");
  EXPECT_EQ(after("a: 1\n", "b.c.d=x=y"), "a: 1\nb:\n  c:\n    d: x=y\n");
  EXPECT_EQ(after("a: rigid\n", "a.b=null"), "a:\n  b: null\n");
}

TEST(YamlTree, AnOverrideIsNamedAsTheSource) {
  YamlNode root = parse_yaml("a: {b: 1}\n", "f.yaml");
  apply_override(root, "a.c={d: 2}");
  EXPECT_EQ(root.find("a")->find("b")->where, "f.yaml:1");
  EXPECT_EQ(root.find("a")->find("c")->where, "--set a.c={d: 2}");
  EXPECT_EQ(root.find("a")->find("c")->find("d")->where, "--set a.c={d: 2}");
}

TEST(YamlTree, ALongOverrideIsNamedByItsBegin) {
  std::string list = "a=[0";
  for (int i = 0; i < 1000; ++i) list += ",1";
  YamlNode root = parse_yaml("a: 1\n", "f.yaml");
  apply_override(root, list + "]");
  const std::string& where = root.find("a")->children.back().where;
  EXPECT_THAT(where, StartsWith("--set a=[0,1,1,"));
  EXPECT_LT(where.size(), 600U);
}

TEST(YamlTree, RefusesAMalformedOverride) {
  EXPECT_THAT(override_refusal("a.b"), AllOf(StartsWith("--set a.b: "), HasSubstr("key.path=")));
  EXPECT_THAT(override_refusal("a.b="), HasSubstr("no value"));
  EXPECT_THAT(override_refusal("=5"), HasSubstr("empty name"));
  EXPECT_THAT(override_refusal("a..b=5"), HasSubstr("empty name"));
  EXPECT_THAT(override_refusal("a.=5"), HasSubstr("empty name"));
  EXPECT_THAT(override_refusal("a.b=[1"),
              AllOf(StartsWith("--set a.b=[1: "), HasSubstr("not YAML")));
  EXPECT_THAT(override_refusal("a={b: 1, b: 2}"), HasSubstr("a.b: given twice"));
}

TEST(YamlTree, IsEmittedSoThatItReadsBackTheSame) {
  const std::string text =
      "name: x y\nn: [1.0e-9, 0x1F, 0.1000000000000000055511151231257827]\n"
      "q: \"a: b, \\\"c\\\" # d\"\ne: {}\nl: []\nm:\n  - {a: 1, b: [2, 3]}\n  - {a: null}\n"
      "s: \"null\"\nt: a, b] c\nu: \"µ\"\n";
  const YamlNode root = parse_yaml(text, "f.yaml");
  const std::string emitted = emit_yaml(root);
  EXPECT_THAT(emitted, HasSubstr("[1.0e-9, 0x1F, 0.1000000000000000055511151231257827]"));
  const YamlNode again = parse_yaml(emitted, "g.yaml");
  EXPECT_EQ(emit_yaml(again), emitted);
  EXPECT_EQ(again.keys, root.keys);
  EXPECT_EQ(again.find("q")->scalar, "a: b, \"c\" # d");
  EXPECT_EQ(again.find("s")->kind, YamlNode::Kind::scalar);
  EXPECT_EQ(again.find("t")->scalar, "a, b] c");
  EXPECT_EQ(again.find("m")->children[1].find("a")->kind, YamlNode::Kind::null);
}

TEST(YamlTree, IsShownOnOneShortLine) {
  EXPECT_EQ(emit_line(parse_yaml("a:\n  - 1\n  - {b: c}\n", "f.yaml")), "{a: [1, {b: c}]}");
  EXPECT_LT(emit_line(parse_yaml("a: " + std::string(1000, 'x'), "f.yaml")).size(), 90U);
}

}  // namespace
}  // namespace tachless::scenario
