// Tests of the table of states and events: docs/protocol.md must show the code's table, and a
// member must react as each cell says.

#include "session/membership_table.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "session/membership.h"

namespace tachless::session {
namespace {

using namespace std::chrono_literals;
using base::ExitCode;
using base::Failure;
using messages::ParticipantState;
using messages::Role;
using Event = MembershipEvent;
using Reaction = MembershipReaction;
using testing::AllOf;
using testing::HasSubstr;

/// Names of the reactions in docs/protocol.md, in the order of MembershipReaction.
constexpr std::array<std::string_view, 16> reaction_names = {
    "ignore", "observe",       "join",   "agree",  "dissolve", "yield",  "contest", "answer",
    "refuse", "note finished", "follow", "forget", "start",    "finish", "fail",    "reject"};

std::string name(Reaction reaction) {
  return std::string(reaction_names.at(static_cast<std::size_t>(reaction)));
}

/// Returns the cells of each row of the document's section "States and events", by the row's event.
std::map<std::string, std::vector<std::string>> documented_rows() {
  std::ifstream file(std::string(TACHLESS_SOURCE_DIR) + "/docs/protocol.md");
  std::map<std::string, std::vector<std::string>> rows;
  std::string line;
  while (std::getline(file, line) && line != "### States and events") {
  }
  while (std::getline(file, line) && !line.starts_with("#")) {
    if (!line.starts_with("| ")) continue;
    std::vector<std::string> cells;
    for (std::size_t at = 2; at < line.size();) {
      const std::size_t end = line.find(" |", at);
      cells.push_back(line.substr(at, end - at));
      at = end + 3;
    }
    const std::string event = cells.front();
    rows[event] = {cells.begin() + 1, cells.end()};
  }
  rows.erase("event");
  return rows;
}

TEST(MembershipTable, IsTheOneInTheDocument) {
  auto documented = documented_rows();
  for (const auto& row : membership_table::rows) {
    std::vector<std::string> cells;
    for (const Reaction each : row.reaction) cells.push_back(name(each));
    auto& words = documented[std::string(row.event)];
    ASSERT_GE(words.size(), cells.size()) << row.event;
    words.resize(cells.size());  // the remaining cells describe the event
    EXPECT_EQ(words, cells) << row.event;
    documented.erase(std::string(row.event));
  }
  EXPECT_TRUE(documented.empty()) << "no such event: " << documented.begin()->first;
}

constexpr std::int64_t run = 77;
constexpr std::int64_t digest = 5;
constexpr std::int64_t other_digest = 6;
constexpr std::int64_t visitor = 95;  ///< instance of a known controller that is no member
constexpr auto visitors_address = "visitor's address";

/// A member that is brought into a state and receives an event there. Each holder's instance is its
/// role's number + 1.
class Cell {
 public:
  Cell(Role role, ParticipantState state, Event event) : role_(role) {
    Membership::Self self;
    self.who.role = role;
    self.who.instance = instance_of(role);
    self.who.scenario_digest = digest;
    self.run = role == Role::plant ? run : 0;
    if (event == Event::wait_over) self.wait_limit = 2s;
    member_.emplace(self, now_);
    announce();
    const bool undecided = event == Event::rival || event == Event::roster ||
                           event == Event::other_roster || event == Event::holder_gone;
    // A member that has failed acknowledges the members of its run only, so it has no run here.
    const bool alone = event == Event::unproven && state == ParticipantState::fault;
    if (state != ParticipantState::waiting && !alone) {
      join(state != ParticipantState::ready || !undecided);
    }
    if (event == Event::departure) visit();
    if (state == ParticipantState::running || state == ParticipantState::finished) {
      member_->on_started(now_);
    }
    finished_ = state == ParticipantState::finished;
    if (finished_) member_->on_finished(now_);
    if (state == ParticipantState::fault) {
      member_->on_failed(Failure(ExitCode::interrupted, "interrupted"), now_);
    }
    EXPECT_EQ(announce().participant.state, state);
    announced_ = now_;
    now_ += 20ms;
  }

  void tell(Event event) {
    const Role peer = role_ == Role::plant ? Role::reference : Role::plant;
    switch (event) {
      case Event::unproven:
        proves_ = false;
        // A member that has finished acknowledges only the members of its run.
        if (finished_)
          return hear(peer, instance_of(peer), ParticipantState::running, {.run = run});
        return hear(Role::reference, 96, ParticipantState::ready, {.run = run});
      case Event::roster:
        return name_roster(roster());
      case Event::other_roster: {
        messages::PerRole other = roster();
        ++other[static_cast<std::size_t>(role_)];
        return name_roster(other);
      }
      case Event::rival:
        return hear(role_, 90, ParticipantState::running, {.utime = older, .run = member_->run()});
      case Event::foreign_scenario:
        digest_ = other_digest;
        return hear(Role::reference, 96, ParticipantState::ready, {});
      case Event::peer:
        return join(true);
      case Event::member_finished:
        member_->on_all_ticks_done();
        for (const Role each : others()) {
          hear(each, instance_of(each), ParticipantState::finished, {.run = run});
        }
        return;
      case Event::member_failed:
        fault_code_ = ExitCode::protective_stop;
        return hear(peer, instance_of(peer), ParticipantState::fault, {.run = run});
      case Event::departure:
        return hear(Role::controller, visitor, ParticipantState::finished, {});
      case Event::holder_gone:
        fault_code_ = ExitCode::protocol_violated;
        return hear(Role::reference, instance_of(Role::reference), ParticipantState::fault, {});
      case Event::holder_silent:
        return pass(5200ms);
      case Event::wait_over:
        return pass(2100ms);
      case Event::run_started:
        return member_->on_started(now_);
      case Event::part_finished:
        return member_->on_finished(now_);
      case Event::failure:
        return member_->on_failed(Failure(ExitCode::bad_usage, "the disk is full"), now_);
    }
  }

  /// Returns the visible state of the member.
  std::string seen() {
    const bool early = member_->next_announcement() < announced_ + Membership::period;
    announced_ = now_;
    // Every second announcement names a process without proof of being alive.
    const Membership::Announcement said = announce();
    const Membership::Announcement next = announce();
    std::string text = "state " + std::to_string(static_cast<int>(said.participant.state)) +
                       ", run " + std::to_string(said.stamp.run);
    if (early) text += ", announces";
    if (member_->failure()) {
      text += ", exit code " + std::to_string(static_cast<int>(member_->failure()->code()));
    }
    acknowledges_ = false;
    for (const auto* each : {&said, &next}) {
      const auto& counters = each->participant.heard_counter;
      if (std::ranges::find(counters, heard_counter_) != counters.end()) acknowledges_ = true;
    }
    if (member_->knows(visitors_address)) text += ", knows the visitor";
    if (member_->knows("96's address")) text += ", knows the newcomer";
    if (member_->have_all_finished()) text += ", all finished";
    return text;
  }

  void check(Reaction reaction, Event event) {
    const std::string before = seen();
    if (reaction == Reaction::reject) {
      EXPECT_THROW(tell(event), std::logic_error);
      return;
    }
    now_ += 20ms;
    tell(event);
    const std::string after = seen();
    const auto& failure = member_->failure();
    switch (reaction) {
      case Reaction::ignore:
        EXPECT_EQ(after, before);
        return;
      case Reaction::observe:
        EXPECT_TRUE(acknowledges_);
        EXPECT_THAT(after, testing::Not(HasSubstr("knows the newcomer")));
        return;
      case Reaction::join:
        EXPECT_TRUE(member_->has_joined());
        EXPECT_EQ(member_->run(), run);
        return;
      case Reaction::agree:
        EXPECT_TRUE(member_->has_joined());
        EXPECT_EQ(announce().participant.roster, roster());
        return;
      case Reaction::dissolve:
        EXPECT_THAT(after, HasSubstr("state 0, run 77, announces"));
        EXPECT_EQ(announce().participant.roster, messages::PerRole{});
        return;
      case Reaction::yield:
      case Reaction::contest:
        EXPECT_THAT(after, HasSubstr("run 0, announces, exit code 4"));
        return;
      case Reaction::answer:
        EXPECT_THAT(after, HasSubstr("announces"));
        EXPECT_FALSE(failure);
        return;
      case Reaction::refuse:
        EXPECT_THAT(after, HasSubstr("run 0, announces, exit code 2"));
        return;
      case Reaction::note_finished:
        EXPECT_TRUE(member_->have_all_finished());
        EXPECT_FALSE(failure);
        return;
      case Reaction::follow:
        EXPECT_THAT(after, HasSubstr("exit code 5"));
        return;
      case Reaction::forget:
        EXPECT_THAT(before, HasSubstr("knows the visitor"));
        EXPECT_THAT(after, testing::Not(HasSubstr("knows the visitor")));
        EXPECT_FALSE(failure);
        return;
      case Reaction::start:
        EXPECT_TRUE(member_->is_running());
        return;
      case Reaction::finish:
        EXPECT_EQ(member_->announce(now_).participant.state, ParticipantState::finished);
        return;
      case Reaction::fail:
        ASSERT_TRUE(failure);
        EXPECT_EQ(member_->announce(now_).participant.state, ParticipantState::fault);
        return;
      case Reaction::reject:
        return;
    }
  }

 private:
  static constexpr std::int64_t older = 1'000'000'000;  // age of an older rival [us]

  static std::int64_t instance_of(Role role) { return static_cast<std::int64_t>(role) + 1; }

  std::vector<Role> others() const {
    std::vector<Role> roles = {Role::plant, Role::reference, Role::controller, Role::logger};
    std::erase(roles, role_);
    return roles;
  }

  static messages::PerRole roster() {
    messages::PerRole instances{};
    for (const Role role : {Role::plant, Role::reference, Role::controller, Role::logger}) {
      instances[static_cast<std::size_t>(role)] = instance_of(role);
    }
    return instances;
  }

  const Membership::Announcement& announce() {
    const auto& said = member_->announce(now_);
    counter_ = said.participant.counter;
    return said;
  }

  void hear(Role role, std::int64_t instance, ParticipantState state, messages::Stamp stamp) {
    messages::Participant who;
    who.counter = ++heard_counter_;
    if (proves_) {
      who.heard_instance[static_cast<std::size_t>(role_)] = instance_of(role_);
      who.heard_counter[static_cast<std::size_t>(role_)] = counter_;
    }
    who.roster = roster_;
    who.role = role;
    who.instance = instance;
    who.scenario_digest = digest_;
    who.state = state;
    who.fault_code = state == ParticipantState::fault ? static_cast<int>(fault_code_) : 0;
    member_->handle(
        stamp, who,
        instance == visitor ? visitors_address : std::to_string(instance) + "'s address", now_);
  }

  /// Lets the plant, or (to the plant) all others, announce a roster.
  void name_roster(const messages::PerRole& roster) {
    roster_ = roster;
    for (const Role each : role_ == Role::plant ? others() : std::vector{Role::plant}) {
      hear(each, instance_of(each), ParticipantState::ready, {.run = run});
    }
  }

  /// Lets the others announce so that the member becomes ready and, if `whole`, joins.
  void join(bool whole) {
    const bool plant = role_ == Role::plant;
    roster_ = {};
    for (const Role each : others()) {
      const bool waits = each == Role::plant;
      hear(each, instance_of(each),
           waits   ? ParticipantState::waiting
           : plant ? ParticipantState::ready
                   : ParticipantState::running,
           {.run = run});
    }
    if (whole) name_roster(roster());
  }

  void visit() { hear(Role::controller, visitor, ParticipantState::waiting, {}); }

  void pass(std::chrono::nanoseconds duration) {
    for (const auto end = now_ + duration; now_ < end; now_ += 100ms) member_->poll(now_);
    member_->poll(now_);
  }

  Role role_;
  Membership::Time now_{};
  Membership::Time announced_{};
  std::int64_t digest_ = digest;
  std::int64_t counter_ = 0;        ///< counter of the member's last announcement
  std::int64_t heard_counter_ = 0;  ///< counter of the others' last announcement
  bool acknowledges_ = false;       ///< the member acknowledges that announcement
  messages::PerRole roster_{};      ///< roster that the others announce
  bool finished_ = false;
  bool proves_ = true;  ///< the others' announcements answer the member
  ExitCode fault_code_ = ExitCode::done;
  std::optional<Membership> member_;
};

/// Without a run no process is a member.
bool can_occur(Role role, ParticipantState state, Event event) {
  static const std::set<Event> of_a_run = {Event::roster, Event::other_roster,
                                           Event::member_finished, Event::member_failed,
                                           Event::holder_silent};
  if (state == ParticipantState::waiting && of_a_run.contains(event)) return false;
  if (role == Role::plant && event == Event::other_roster) return false;
  if (event == Event::holder_gone) {
    return role == Role::plant && state == ParticipantState::ready;
  }
  return true;
}

TEST(MembershipTable, IsWhatAMemberDoes) {
  int cells = 0;
  for (const Role role : {Role::plant, Role::logger}) {
    for (std::size_t row = 0; row < num_membership_events; ++row) {
      for (int column = 0; column < 5; ++column) {
        const auto event = static_cast<Event>(row);
        const auto state = static_cast<ParticipantState>(column);
        if (!can_occur(role, state, event)) continue;
        SCOPED_TRACE(std::string(messages::name(role)) + ", state " + std::to_string(column) +
                     ", " + std::string(membership_table::rows[row].event) + ": " +
                     name(reaction(event, state)));
        Cell(role, state, event).check(reaction(event, state), event);
        ++cells;
      }
    }
  }
  EXPECT_EQ(cells, 2 * 5 * 15 - 2 * 5 - 4 - 9);
}

}  // namespace
}  // namespace tachless::session
