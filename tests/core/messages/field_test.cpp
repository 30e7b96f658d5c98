#include "messages/field.h"

#include <gmock/gmock.h>

#include <fstream>
#include <limits>
#include <regex>
#include <sstream>

#include "messages/messages.h"
#include "messages/truth/contact.h"
#include "messages/truth/plant_truth.h"

namespace tachless::messages {
namespace {

/// One line of an .lcm file.
struct Declared {
  std::string type, name, size;
  bool operator==(const Declared&) const = default;
};
void PrintTo(const Declared& field, std::ostream* to) {
  *to << field.type << " " << field.name << field.size;
}

/// Returns the fields of a message's .lcm file, without the stamp.
std::vector<Declared> declared_in_file(std::string type) {
  std::replace(type.begin(), type.end(), '.', '_');
  std::ifstream file(std::string(TACHLESS_SOURCE_DIR "/lcmtypes/") + type + ".lcm");
  EXPECT_TRUE(file) << type;
  std::vector<Declared> fields;
  const std::regex line_of_field(R"(^ +(\w+) (\w+)([\[\]\w]*);.*$)");
  std::string line;
  while (std::getline(file, line)) {
    std::smatch match;
    if (std::regex_match(line, match, line_of_field))
      fields.push_back({match[1], match[2], match[3]});
  }
  EXPECT_GE(fields.size(), 4u) << type;
  fields.erase(fields.begin(), fields.begin() + 3);
  return fields;
}

std::string lcm_type(Kind kind) {
  switch (kind) {
    case Kind::real:
      return "double";
    case Kind::flag:
      return "boolean";
    case Kind::int64:
      return "int64_t";
    case Kind::int32:
      return "int32_t";
    case Kind::int8:
    case Kind::uint8:
      return "int8_t";
    case Kind::text:
      return "string";
  }
  return {};
}

std::string lcm_size(Count count) {
  switch (count) {
    case Count::one:
      return "";
    case Count::joints:
      return "[num_joints]";
    case Count::motors:
      return "[num_motors]";
    case Count::roles:
      return "[4]";
    case Count::signals:
      return "[num_signals][num_joints]";
  }
  return {};
}

template <class Value>
std::vector<Declared> declared_in_table() {
  std::vector<Declared> fields;
  if (has_count<Value>(Count::signals)) fields.push_back({"int32_t", "num_signals", ""});
  if (has_joint_count<Value>()) fields.push_back({"int32_t", "num_joints", ""});
  if (has_count<Value>(Count::motors)) fields.push_back({"int32_t", "num_motors", ""});
  for_each_field<Value>([&](const auto& field) {
    fields.push_back({lcm_type(field.kind), std::string(field.name), lcm_size(field.count)});
  });
  return fields;
}

TEST(Fields, AreThoseOfTheLcmFilesInTheirOrder) {
  const auto compare = []<class Value>(std::type_identity<Value>) {
    EXPECT_EQ(declared_in_table<Value>(), declared_in_file(std::string(Value::type)));
  };
  for_each_type(Messages(), compare);
  compare(std::type_identity<truth::PlantTruth>());
  compare(std::type_identity<truth::Contact>());
}

TEST(AllFinite, LooksAtNumbersAndNotAtTexts) {
  Participant who;
  who.host = "nan";
  EXPECT_TRUE(all_finite(who));
  who.error_norm = std::numeric_limits<double>::infinity();
  EXPECT_FALSE(all_finite(who));
}

TEST(Channels, AreUpperSnakeWithTheRobotsName) {
  EXPECT_EQ(channel<PositionMeasurement>("ARM"), "ARM_POSITION");
  EXPECT_EQ(channel<truth::PlantTruth>("ARM"), "ARM_TRUTH");
}

}  // namespace
}  // namespace tachless::messages
