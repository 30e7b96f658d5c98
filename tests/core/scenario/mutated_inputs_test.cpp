// Files with one mistake: a mistake is refused, or warned of, or changes nothing. The number of
// files of each kind is 10,000, or TACHLESS_MUTATIONS.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <iostream>
#include <map>
#include <set>
#include <stdexcept>

#include "robot/dynamics.h"
#include "robot/kinematics.h"
#include "robot/mjcf_joints.h"
#include "robot/urdf_xml.h"
#include "scenario/motion_file.h"
#include "scenario/table.h"
#include "tests/core/scenario/xml_mutations.h"

namespace tachless::scenario {
namespace {

using Numbers = std::vector<double>;

int count_of_files() {
  const char* const given = std::getenv("TACHLESS_MUTATIONS");
  return given == nullptr ? 10'000 : std::atoi(given);
}

bool equal(const Numbers& a, const Numbers& b) {
  return std::ranges::equal(a, b, [](double x, double y) {
    return x == y || std::abs(x - y) <= 1e-12 * std::max(1.0, std::abs(x));
  });
}

/// Tallies of what became of the files.
class Tally {
 public:
  explicit Tally(std::string title) : title_(std::move(title)) {}
  ~Tally() {
    std::cout << title_ << ": " << equal << " equal, " << warned << " warned, " << refused
              << " refused, " << silent << " silently changed\n";
  }
  Tally(const Tally&) = delete;
  Tally& operator=(const Tally&) = delete;

  void fail(const Mutation& mutation) {
    ++silent;
    if (kinds_.insert(mutation.kind).second) {
      ADD_FAILURE() << title_ << ", " << mutation.kind << ": changed silently:\n" << mutation.text;
    }
  }

  int equal = 0, warned = 0, refused = 0, silent = 0;

 private:
  std::string title_;
  std::set<std::string> kinds_;
};

constexpr const char* arm_urdf = R"(<?xml version="1.0"?>
<robot name="arm">
  <link name="base"/>
  <link name="mount">
    <inertial>
      <origin xyz="0.01 0 0.02" rpy="0.1 0.2 0.3"/>
      <mass value="0.4"/>
      <inertia ixx="0.002" ixy="0.0001" ixz="0" iyy="0.003" iyz="0" izz="0.004"/>
    </inertial>
    <visual>
      <origin xyz="0 0 0.1" rpy="0 0 0"/>
      <geometry/>
    </visual>
  </link>
  <link name="upper">
    <inertial>
      <origin xyz="0 0.02 -0.2" rpy="0 0 0.5"/>
      <mass value="2.5"/>
      <inertia ixx="0.03" ixy="0.001" ixz="0.002" iyy="0.03" iyz="0.001" izz="0.014"/>
    </inertial>
  </link>
  <link name="lower">
    <inertial>
      <origin xyz="0 0.01 -0.15" rpy="0.2 0 0"/>
      <mass value="1.5"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.002"/>
    </inertial>
  </link>
  <link name="finger">
    <inertial>
      <origin xyz="0 0.01 -0.05" rpy="0 0 0"/>
      <mass value="0.2"/>
      <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.0005"/>
    </inertial>
  </link>
  <joint name="grip" type="prismatic">
    <parent link="lower"/>
    <child link="finger"/>
    <origin xyz="0 0 -0.3" rpy="0 0 0.3"/>
    <axis xyz="1 0 0"/>
    <limit lower="-0.5" upper="0.75" effort="20" velocity="1"/>
    <mimic joint="shoulder" multiplier="0.1" offset="0.05"/>
  </joint>
  <joint name="weld" type="fixed">
    <parent link="base"/>
    <child link="mount"/>
    <origin xyz="0 0 0.3" rpy="0 0.1 0"/>
  </joint>
  <joint name="shoulder" type="revolute">
    <parent link="mount"/>
    <child link="upper"/>
    <origin xyz="0 0 0.1" rpy="0.1 0 0"/>
    <axis xyz="0 1 0"/>
    <limit lower="-2" upper="2.5" effort="60" velocity="3"/>
    <dynamics damping="0.5" friction="0.25"/>
  </joint>
  <joint name="elbow" type="continuous">
    <parent link="upper"/>
    <child link="lower"/>
    <origin xyz="0 0.05 -0.4" rpy="0 0 0.2"/>
    <axis xyz="0 0.6 0.8"/>
    <limit effort="30" velocity="4"/>
    <dynamics damping="0.125" friction="0.5"/>
  </joint>
</robot>
)";

struct Mechanics {
  Numbers numbers;
  std::set<std::string> warnings;
};

/// Everything that the loop has from a URDF.
Mechanics mechanics_of(const std::string& text) {
  const robot::Model model = robot::model_from_urdf(text, "arm.urdf");
  Mechanics result;
  result.warnings.insert(model.warnings.begin(), model.warnings.end());
  for (std::string& line : robot::improbable_numbers(text, "arm.urdf", {})) {
    result.warnings.insert(std::move(line));
  }
  const auto add = [&](const auto& values) {
    result.numbers.insert(result.numbers.end(), values.begin(), values.end());
  };
  for (const Vector* each :
       {&model.lower, &model.upper, &model.effort_limit, &model.velocity_limit,
        &model.deceleration_limit, &model.velocity_offset, &model.damping, &model.friction}) {
    add(*each);
  }
  for (const double q : {0.0, 0.3, -0.7}) {
    const Vector position = Vector::Constant(model.num_joints, q);
    add(robot::mass_matrix<double>(model, position).reshaped());
    add(robot::gravity_torque(model, position));
    for (const auto& [name, frame] : model.frames) {
      add(robot::frame_pose(model, frame, position).p);
    }
  }
  return result;
}

TEST(MutatedInputs, NoMistakeInAUrdfChangesTheRobotSilently) {
  const XmlMutator mutator(
      arm_urdf, {"robot/link", "robot/joint", "link/inertial", "link/visual", "visual/origin",
                 "visual/geometry", "inertial/origin", "inertial/mass", "inertial/inertia",
                 "joint/parent", "joint/child", "joint/origin", "joint/axis", "joint/limit",
                 "joint/dynamics", "joint/mimic", "origin@xyz", "origin@rpy"});
  const Mechanics right = mechanics_of(arm_urdf);
  Draw draw(1);
  Tally tally("URDFs");
  for (int k = 0; k < count_of_files(); ++k) {
    const Mutation mutation = mutator.mutation(draw);
    try {
      const Mechanics mutated = mechanics_of(mutation.text);
      if (equal(mutated.numbers, right.numbers)) {
        ++tally.equal;
      } else if (!std::ranges::includes(right.warnings, mutated.warnings)) {
        ++tally.warned;
      } else {
        tally.fail(mutation);
      }
    } catch (const std::invalid_argument&) {
      ++tally.refused;
    }
  }
}

constexpr const char* arm_mjcf = R"(<mujoco model="arm">
  <default>
    <joint armature="0.1" damping="0.5" frictionloss="0.25"/>
    <default class="small">
      <joint armature="0.02" damping="0.125"/>
    </default>
  </default>
  <worldbody>
    <body name="a" childclass="small">
      <joint name="j1" axis="0 1 0" range="-1 1"/>
      <body name="b">
        <joint name="j2" class="small" frictionloss="0.5"/>
        <body name="c">
          <joint name="j3" armature="0.3"/>
        </body>
      </body>
    </body>
    <body name="d">
      <joint name="j4" damping="2"/>
    </body>
  </worldbody>
</mujoco>
)";

TEST(MutatedInputs, NoMistakeInAnMjcfChangesTheJointsSilently) {
  const auto numbers_of = [](const std::string& text) {
    Numbers numbers;
    const auto joints = robot::read_mjcf_joints(
        text, "arm.xml",
        [](const std::string&) -> std::string { throw std::invalid_argument(""); });
    // A scenario refuses a file that lacks one of the robot's joints.
    for (const char* name : {"j1", "j2", "j3", "j4"}) {
      const auto found = joints.find(name);
      if (found == joints.end()) throw std::invalid_argument("a joint is missing");
      const robot::JointNumbers& j = found->second;
      for (const double x : {j.rotor_inertia, j.viscous_friction, j.coulomb_friction}) {
        numbers.push_back(x);
      }
    }
    return numbers;
  };
  const XmlMutator mutator(
      arm_mjcf, {"mujoco/default", "mujoco/worldbody", "default/default", "default/joint",
                 "body/joint", "body/body", "worldbody/body", "joint@armature", "joint@damping",
                 "joint@frictionloss", "joint@class", "body@childclass"});
  const Numbers right = numbers_of(arm_mjcf);
  Draw draw(2);
  Tally tally("MJCFs");
  for (int k = 0; k < count_of_files(); ++k) {
    const Mutation mutation = mutator.mutation(draw);
    try {
      if (equal(numbers_of(mutation.text), right)) {
        ++tally.equal;
      } else {
        tally.fail(mutation);
      }
    } catch (const std::invalid_argument&) {
      ++tally.refused;
    }
  }
}

/// Tables of one motion.
constexpr const char* tables[] = {
    "time,gap,shoulder,note,elbow\n0,,0.25,idle,0.5\n1,,0.125,moving fast,-0.25\n2,,0.5,,0.375\n",
    "elbow;time;shoulder\n0.5;0;0.25\n-0.25;1;0.125\n0.375;2;0.5\n",
    "\"time\"\t\"shoulder\"\t\"elbow\"\r\n0\t0.25\t0.5\r\n1\t0.125\t-0.25\r\n2\t0.5\t0.375\r\n",
    "0 0.25 0.5\n1 0.125 -0.25\n2 0.5 0.375\n",
    "0, 0.25, 0.5\n1, 0.125, -0.25\n2, 0.5, 0.375\n",
};

bool in_number(char c) { return std::string_view("0123456789.-+eE").find(c) != std::string::npos; }

/// Makes a mistake that leaves no table of another motion.
Mutation mutated_table(const std::string& text, Draw& draw) {
  static constexpr std::string_view others = ",;\t \"'xOd_:/()[]{}<>|=\r\n!?$~*@^&";
  static constexpr std::array<std::string_view, 7> words{"nan",
                                                         "inf",
                                                         "1e999",
                                                         "0x1p-1",
                                                         "\xe2\x88\x92"
                                                         "1",
                                                         "1,000",
                                                         std::string_view("\0", 1)};
  while (true) {
    const std::size_t at = draw.below(text.size());
    const char c = text[at];
    const std::string other(1, draw.one_of(others));
    switch (draw.below(6)) {
      case 0:
        if (!in_number(c)) return {"character lost", std::string(text).erase(at, 1)};
        break;
      case 1:
        return {"character added", std::string(text).insert(at, other)};
      case 2:
        if (!in_number(c) || c == '.') {
          return {"character exchanged", std::string(text).replace(at, 1, other)};
        }
        return {"digit misread", std::string(text).replace(at, 1, "O")};
      case 3:
        return {"word added", std::string(text).insert(at, draw.one_of(words))};
      case 4:
        if (std::isalpha(static_cast<unsigned char>(c)) != 0 && at < text.find('\n')) {
          return {"header", std::string(text).replace(at, 1, "q")};
        }
        break;
      default: {  // a field is emptied
        const std::string_view separators =
            text.find_first_of(",;\t") == std::string::npos ? " \r\n" : ",;\t\r\n";
        const std::size_t end = text.find_first_of(separators, at);
        const std::size_t begin = text.find_last_of(separators, at);
        if (begin == std::string::npos || end == std::string::npos || begin + 1 >= end) break;
        return {"field emptied", std::string(text).erase(begin + 1, end - begin - 1)};
      }
    }
  }
}

const robot::Model& two_joints() {
  static const robot::Model model = robot::model_from_urdf(
      R"(<robot name="two"><link name="ground"/>
<link name="a"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="b"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="ground"/><child link="a"/><limit lower="-2" upper="2" effort="10" velocity="10"/></joint>
<joint name="elbow" type="revolute"><parent link="a"/><child link="b"/><limit lower="-2" upper="2" effort="10" velocity="10"/></joint></robot>)",
      "two.urdf");
  return model;
}

/// The motion of a table, from before its first to behind its last row.
Numbers motion_of(const std::string& text) {
  const auto spline = parse_motion(text, "m.csv", two_joints());
  Numbers numbers = {spline.time_s().front(), spline.time_s().back()};
  for (double t = -0.5; t < 3; t += 0.25) {
    const auto at = spline.at(t);
    numbers.insert(numbers.end(), at.q_ref.begin(), at.q_ref.end());
  }
  return numbers;
}

/// The columns of a recording by their numbers, as `identify` reads them.
Numbers recorded(const std::string& text) {
  Table table(text, "r.csv");
  const std::size_t time = table.time_column("", false);
  const std::size_t first = table.column_by_name_or_number("3"), last = table.width() - 1;
  Numbers numbers;
  while (table.next()) {
    for (const std::size_t column : {time, first, last}) numbers.push_back(table.number(column));
  }
  return numbers;
}

template <class Read>
void try_tables(const std::string& title, std::uint64_t seed, const Read& read) {
  Draw draw(seed);
  Tally tally(title);
  for (int k = 0; k < count_of_files(); ++k) {
    const std::string right = draw.one_of(tables);
    const Mutation mutation = mutated_table(right, draw);
    try {
      if (equal(read(mutation.text), read(right))) {
        ++tally.equal;
      } else {
        tally.fail(mutation);
      }
    } catch (const std::invalid_argument&) {
      ++tally.refused;
    }
  }
}

TEST(MutatedInputs, NoMistakeInAMotionMovesTheRobotElsewhereSilently) {
  try_tables("motions", 3, motion_of);
}

TEST(MutatedInputs, NoMistakeInARecordingChangesItSilently) {
  try_tables("recordings", 4, recorded);
}

}  // namespace
}  // namespace tachless::scenario
