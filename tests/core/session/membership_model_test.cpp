// All attacks on the handshake to a stated depth. They start at each point of an undisturbed
// rendezvous and consist of every sequence of `depth` steps. A step may be an announcement of one
// of the four, received by any of the other three. It may also be a recorded announcement that is
// delivered to any process. The recording is of an earlier session with the same run id, or of this
// session. The four processes are session::Membership itself.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <functional>
#include <map>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "session/membership.h"

namespace tachless::session {
namespace {

using namespace std::chrono_literals;
using messages::ParticipantState;
using messages::Role;

constexpr std::int64_t the_run = 77;
constexpr std::array all_roles = {Role::plant, Role::reference, Role::controller, Role::logger};
constexpr int num_roles = messages::num_roles;

Membership member(Role role, std::int64_t first_instance) {
  Membership::Self self;
  self.who.role = role;
  self.who.instance = first_instance + static_cast<std::int64_t>(role);
  self.who.scenario_digest = 5;
  self.run = role == Role::plant ? the_run : 0;
  self.give_up = 1h;
  return {self, Membership::Time{}};
}

/// Four processes and all their announcements.
struct World {
  explicit World(std::int64_t first) : first_instance(first) {
    for (const Role role : all_roles) members.push_back(member(role, first));
  }

  Membership& of(Role role) { return members[static_cast<std::size_t>(role)]; }
  const Membership& of(Role role) const { return members[static_cast<std::size_t>(role)]; }
  messages::PerRole roster() const {
    messages::PerRole result{};
    for (std::int64_t i = 0; i < num_roles; ++i) {
      result[static_cast<std::size_t>(i)] = first_instance + i;
    }
    return result;
  }

  /// Lets `role` announce; the roles whose bit is set receive it at once.
  void announce(Role role, unsigned heard_by) {
    now += 20ms;
    if (role == Role::plant && of(role).has_joined()) of(role).on_started(now);
    announced.push_back(of(role).announce(now));
    const Membership::Announcement said = announced.back();
    for (const Role to : all_roles) {
      if (to != role && (heard_by >> static_cast<unsigned>(to) & 1U) != 0) deliver(said, to);
    }
  }

  void deliver(const Membership::Announcement& said, Role to) {
    std::int64_t& newest = heard[{said.participant.instance, to}];
    newest = std::max(newest, said.participant.counter);
    of(to).handle(said.stamp, said.participant, "address", now);
    // The first message of the run has this effect.
    if (to != Role::plant && of(to).has_joined() && !of(to).failure() &&
        of(Role::plant).is_running()) {
      of(to).on_started(now);
    }
  }

  /// Returns whether `to` has heard nothing newer of that process; older announcements are ignored
  /// as copies.
  bool is_news(const Membership::Announcement& said, Role to) const {
    const auto found = heard.find({said.participant.instance, to});
    return said.participant.role != to &&
           (found == heard.end() || found->second < said.participant.counter);
  }

  /// Lets every process hear every other.
  void round() {
    for (const Role role : all_roles) announce(role, 0b1111);
  }

  std::int64_t first_instance;
  Membership::Time now{};
  std::vector<Membership> members;
  std::vector<Membership::Announcement> announced;
  std::map<std::pair<std::int64_t, Role>, std::int64_t> heard;  ///< newest counter, by hearer
};

/// Returns the attacker's recording of an earlier session with the same run id: an announcement of
/// each process in each state. The last two states have the highest counters.
std::vector<Membership::Announcement> recorded() {
  World earlier(11);
  for (int i = 0; i < 5; ++i) earlier.round();
  EXPECT_TRUE(earlier.of(Role::plant).is_running());
  std::vector<Membership::Announcement> result;
  for (const ParticipantState state :
       {ParticipantState::waiting, ParticipantState::ready, ParticipantState::running}) {
    for (const Role role : all_roles) {
      const auto found = std::ranges::find_if(earlier.announced, [&](const auto& each) {
        return each.participant.role == role && each.participant.state == state;
      });
      if (found != earlier.announced.end()) result.push_back(*found);
    }
  }
  World failing = earlier;
  for (const Role role : all_roles) {
    earlier.of(role).on_finished(earlier.now);
    result.push_back(earlier.of(role).announce(earlier.now));
    failing.of(role).on_failed({base::ExitCode::interrupted, "interrupted"}, failing.now);
    result.push_back(failing.of(role).announce(failing.now));
  }
  return result;
}

/// Checker of the properties that must hold under every attack.
class Properties {
 public:
  /// @param dead role that announces nothing from `since` on
  Properties(std::optional<Role> dead, Membership::Time since) : dead_(dead), since_(since) {}

  void check(const World& world) {
    ++states_;
    const bool plant_joined = world.of(Role::plant).has_joined();
    for (const Role role : all_roles) {
      const Membership& each = world.of(role);
      if (each.failure()) return complain(role, each.failure()->what());
      if (each.has_plant_finished() || each.have_all_finished())
        return complain(role, "believes the end");
      if (each.has_joined() && each.roster() != world.roster())
        return complain(role, "other roster");
      if (each.has_joined() && world.of(Role::plant).roster() != world.roster()) {
        return complain(role, "joined without the plant's roster");
      }
      if (plant_joined && !each.has_joined())
        return complain(role, "has not agreed, the plant starts");
      if (!dead_ || role == *dead_) continue;
      const auto silence = each.silence(*dead_, world.now);
      if (silence && *silence < world.now - since_) return complain(role, "believes in the dead");
    }
  }

  [[nodiscard]] std::int64_t states() const { return states_; }
  [[nodiscard]] const std::string& complaint() const { return complaint_; }

 private:
  void complain(Role role, const std::string& what) {
    if (complaint_.empty()) complaint_ = std::string(messages::name(role)) + ": " + what;
  }

  std::optional<Role> dead_;
  Membership::Time since_;
  std::int64_t states_ = 0;
  std::string complaint_;
};

/// Calls `f(step)` for each possible step of the attacker and the four in `world`.
template <class F>
void for_each_step(const World& world, const std::vector<Membership::Announcement>& recordings,
                   std::optional<Role> dead, F&& f) {
  for (const Role role : all_roles) {
    if (role == dead) continue;
    for (unsigned heard_by = 0; heard_by < 1U << num_roles; ++heard_by) {
      if ((heard_by >> static_cast<unsigned>(role) & 1U) != 0) continue;  // no process hears itself
      f([role, heard_by](World& next) { next.announce(role, heard_by); });
    }
  }
  for (const auto* source : {&recordings, &world.announced}) {
    for (const Membership::Announcement& said : *source) {
      for (const Role to : all_roles) {
        if (!world.is_news(said, to)) continue;
        f([said, to](World& next) { next.deliver(said, to); });
      }
    }
  }
}

void explore(const World& world, const std::vector<Membership::Announcement>& recordings,
             std::optional<Role> dead, int depth, Properties& properties) {
  properties.check(world);
  if (depth == 0 || !properties.complaint().empty()) return;
  for_each_step(world, recordings, dead, [&](const auto& step) {
    if (!properties.complaint().empty()) return;
    World next = world;
    step(next);
    explore(next, recordings, dead, depth - 1, properties);
  });
}

/// Returns the points of an undisturbed rendezvous: before it, and after each announcement.
std::vector<World> course() {
  std::vector<World> points = {World(1)};
  for (int i = 0; i < 4 * num_roles; ++i) {
    World next = points.back();
    next.announce(all_roles[static_cast<std::size_t>(i % num_roles)], 0b1111);
    points.push_back(next);
  }
  return points;
}

TEST(TheHandshake, IsDoneInFourRoundsWhenNobodyDisturbsIt) {
  const World end = course().back();
  for (const Role role : all_roles) {
    EXPECT_TRUE(end.of(role).has_joined()) << messages::name(role);
    EXPECT_TRUE(end.of(role).is_running()) << messages::name(role);
  }
}

TEST(TheHandshake, HoldsAgainstEveryTwoStepsFromEveryPoint) {
  const auto recordings = recorded();
  ASSERT_GE(recordings.size(), 18U);
  std::int64_t states = 0;
  for (const World& point : course()) {
    Properties properties({}, {});
    explore(point, recordings, {}, 2, properties);
    ASSERT_EQ(properties.complaint(), "");
    states += properties.states();
  }
  RecordProperty("states", std::to_string(states));
  EXPECT_GT(states, 50'000);
}

TEST(TheHandshake, BelievesInNobodyWhoIsDead) {
  const auto recordings = recorded();
  for (const World& point : course()) {
    for (const Role dead : {Role::plant, Role::logger}) {
      Properties properties(dead, point.now);
      explore(point, recordings, dead, 2, properties);
      ASSERT_EQ(properties.complaint(), "") << messages::name(dead);
    }
  }
}

TEST(TheHandshake, SucceedsAsSoonAsTheAttackerRests) {
  const auto recordings = recorded();
  for (std::uint64_t seed = 0; seed < 300; ++seed) {
    std::mt19937_64 random(seed);
    World world(1);
    Properties properties({}, {});
    for (int i = 0; i < 60 && properties.complaint().empty(); ++i) {
      std::vector<std::function<void(World&)>> steps;
      for_each_step(world, recordings, {}, [&](const auto& step) { steps.emplace_back(step); });
      steps[random() % steps.size()](world);
      properties.check(world);
    }
    ASSERT_EQ(properties.complaint(), "") << seed;
    // Announcements name missing candidates in turn with existing ones.
    for (int i = 0; i < 40; ++i) world.round();
    for (const Role role : all_roles) {
      EXPECT_TRUE(world.of(role).is_running()) << seed << " " << messages::name(role);
    }
  }
}

}  // namespace
}  // namespace tachless::session
