#include "report/contacts.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace tachless::report {
namespace {

messages::TickRecord tick(const std::string& geoms, double force,
                          const std::vector<std::size_t>& saturated = {}) {
  messages::TickRecord record;
  record.contact = messages::truth::Contact{"MuJoCo 2.2.2", geoms, force};
  record.truth.emplace();
  for (const std::size_t joint : saturated) record.truth->saturated[joint] = true;
  return record;
}

TEST(Contacts, AreToldFromTheFirstTouchOn) {
  Contacts contacts;
  contacts.add(messages::TickRecord(), 0);
  EXPECT_EQ(to_json(contacts), nullptr);
  contacts.add(tick("", 0, {0}), 1);  // a limit without a contact does not count
  EXPECT_EQ(contacts.text(), "");
  EXPECT_EQ(to_json(contacts)["first"], nullptr);
  contacts.add(tick("tip, wall", 370, {1}), 1.22);
  EXPECT_EQ(contacts.text(), "contact from 1.22 s (tip, wall), up to 370 N: joint 2 at its limit");
  contacts.add(tick("tip, wall", 520, {3, 5}), 1.5);
  contacts.add(tick("tip, wall", 426, {1}), 1.6);
  EXPECT_EQ(contacts.text(),
            "contact from 1.22 s (tip, wall), up to 520 N: joints 2, 4, 6 at their limits");
  const auto json = to_json(contacts);
  EXPECT_EQ(json["simulator"], "MuJoCo 2.2.2");
  EXPECT_EQ(json["ticks"], 3);
  EXPECT_EQ(json["first"]["time_s"], 1.22);
  EXPECT_EQ(json["largest"]["force_N"], 520);
  EXPECT_EQ(json["saturated_joints"], (std::vector<int>{2, 4, 6}));
}

TEST(Contacts, NameAnotherPairThatPressesMore) {
  Contacts contacts;
  contacts.add(tick("tip, wall", 5), 1);
  contacts.add(tick("elbow, ta\x1b[2Jble", 7), 2);
  EXPECT_EQ(contacts.text(), "contact from 1 s (tip, wall), up to 7 N (elbow, ta?[2Jble)");
}

}  // namespace
}  // namespace tachless::report
