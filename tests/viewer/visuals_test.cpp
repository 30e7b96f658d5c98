#include "viewer/visuals.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

#include "robot/kinematics.h"
#include "robot/model.h"
#include "tests/support/temporary_directory.h"

namespace tachless::viewer {
namespace {

namespace fs = std::filesystem;
using Eigen::Vector3d;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::SizeIs;
using ::testing::StartsWith;

void write(const fs::path& file, const std::string& bytes) {
  fs::create_directories(file.parent_path());
  std::ofstream(file, std::ios::binary) << bytes;
}

template <class T>
std::string bytes_of(T value) {
  return {reinterpret_cast<const char*>(&value), sizeof value};
}

/// A binary STL whose header counts `counted` triangles.
std::string binary_stl(const std::vector<Vector3d>& corners, std::uint32_t counted) {
  std::string bytes = std::string(80, '-') + bytes_of(counted);
  for (std::size_t i = 0; i < corners.size(); i += 3) {
    bytes += std::string(12, '\0');  // the normal, which nobody reads
    for (std::size_t k = i; k < i + 3; ++k) {
      for (int axis = 0; axis < 3; ++axis) bytes += bytes_of(static_cast<float>(corners[k][axis]));
    }
    bytes += std::string(2, '\0');
  }
  return bytes;
}

const std::vector<Vector3d> triangle = {{1, 0, 0}, {0, 2, 0}, {0, 0, 4}};

const std::string text_stl =
    "solid plate\n facet normal 0 0 1\n  outer loop\n   vertex 1 0 0\n   vertex 0 2e0 0\n"
    "   vertex 0 0 4\n  endloop\n endfacet\nendsolid plate\n";

class VisualsOf : public ::testing::Test {
 protected:
  void SetUp() override {
    for (const char* variable : {"ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"}) unsetenv(variable);
  }

  /// What is read of a robot whose one moving link, `arm`, has `visuals`.
  Visuals of_arm(const std::string& visuals, const std::string& before = "") {
    return read("<robot name='r'>" + before +
                "<link name='base'/><link name='arm'><inertial><mass value='1'/><inertia ixx='1' "
                "iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial>" +
                visuals +
                "</link><joint name='hinge' type='continuous'><parent link='base'/><child "
                "link='arm'/><axis xyz='0 0 1'/></joint></robot>");
  }

  Visuals read(const std::string& urdf, const robot::UrdfOptions& options = {}) {
    write(urdf_, urdf);
    model_ = robot::model_from_urdf(urdf, "robot.urdf", options);
    return read_visuals(urdf_, model_);
  }

  static std::string visual(const std::string& geometry, const std::string& more = "") {
    return "<visual>" + more + "<geometry>" + geometry + "</geometry></visual>";
  }

  /// The corners of the one mesh of that name.
  std::vector<Vector3d> mesh(const std::string& attributes) {
    const Visuals visuals = of_arm(visual("<mesh " + attributes + "/>"));
    if (visuals.drawn.size() != 1) throw std::runtime_error(visuals.problems.at(0));
    return std::get<Mesh>(visuals.drawn[0].geometry).corners;
  }

  TemporaryDirectory directory_;
  fs::path urdf_ = directory_ / "ws/robots/arm/urdf/arm.urdf";
  robot::Model model_;
};

TEST_F(VisualsOf, ShapesHaveTheirSizeAndColour) {
  const Visuals visuals =
      of_arm(visual("<box size=' 1 2.5  3e-1 '/>", "<material name='red'/>") +
                 visual("<cylinder length='4' radius='0.5'/>",
                        "<material name='sea'><color rgba='0 0.25 1 0.5'/></material>") +
                 visual("<sphere radius='7'/>", "<material name='sea'/>") +
                 visual("<sphere radius='8'/>", "<material name='nobody knows'/>"),
             "<material name='red'><color rgba='1 0 0 1'/></material>");
  ASSERT_THAT(visuals.drawn, SizeIs(4));
  EXPECT_FALSE(visuals.warning());
  EXPECT_EQ(std::get<Box>(visuals.drawn[0].geometry).size, Vector3d(1, 2.5, 0.3));
  EXPECT_EQ(std::get<Cylinder>(visuals.drawn[1].geometry).length, 4);
  EXPECT_EQ(std::get<Cylinder>(visuals.drawn[1].geometry).radius, 0.5);
  EXPECT_EQ(std::get<Sphere>(visuals.drawn[2].geometry).radius, 7);
  EXPECT_THAT(*visuals.drawn[0].rgba, ElementsAre(1, 0, 0, 1));
  EXPECT_THAT(*visuals.drawn[1].rgba, ElementsAre(0, 0.25, 1, 0.5));
  EXPECT_THAT(*visuals.drawn[2].rgba, ElementsAre(0, 0.25, 1, 0.5));
  EXPECT_FALSE(visuals.drawn[3].rgba.has_value());
}

/// A URDF's <origin>, from its definition: turned about the fixed x, then y, then z.
Eigen::Isometry3d origin(double x, double y, double z, double roll, double pitch, double yaw) {
  const double cr = std::cos(roll), sr = std::sin(roll), cp = std::cos(pitch), sp = std::sin(pitch),
               cy = std::cos(yaw), sy = std::sin(yaw);
  Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
  X.linear() << cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr, sy * cp,
      sy * sp * sr + cy * cr, sy * sp * cr - cy * sr, -sp, cp * sr, cp * cr;
  X.translation() << x, y, z;
  return X;
}

Eigen::Isometry3d turned(double angle, const Vector3d& axis) {
  return Eigen::Isometry3d(Eigen::AngleAxisd(angle, axis));
}

TEST_F(VisualsOf, LinksThatAreMergedStandWhereTheirJointsPutThem) {
  const std::string mass =
      "<inertial><mass value='1'/><inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/>"
      "</inertial>";
  const auto link = [&](const std::string& name, const std::string& place) {
    return "<link name='" + name + "'>" + mass +
           visual("<sphere radius='1'/>", "<origin " + place + "/>") + "</link>";
  };
  const auto joint = [](const std::string& name, const std::string& type, const std::string& parent,
                        const std::string& child, const std::string& more) {
    return "<joint name='" + name + "' type='" + type + "'><parent link='" + parent +
           "'/><child link='" + child + "'/>" + more + "</joint>";
  };
  robot::UrdfOptions options;
  options.locked["wrist"] = 0.7;
  options.base_rpy = {0.3, -0.2, 1.1};
  options.base_xyz = {1, 2, 3};
  const Visuals visuals = read(
      "<robot name='r'>" + link("base", "xyz='0.1 0.2 0.3' rpy='1 2 3'") + link("arm", "") +
          link("bracket", "xyz='0.5 0 0.1' rpy='0.4 -0.5 0.6'") + link("hand", "rpy='0 0 1'") +
          link("rotor", "xyz='0 0 1'") + link("fan", "xyz='1 0 0'") +
          joint("shoulder", "continuous", "base", "arm",
                "<origin xyz='0 0 1' rpy='0.1 0.2 0.3'/><axis xyz='0 1 0'/>") +
          joint("screws", "fixed", "arm", "bracket", "<origin xyz='1 0 0' rpy='-1 0.5 2'/>") +
          joint("wrist", "revolute", "bracket", "hand",
                "<origin xyz='0 1 0' rpy='0 1 0'/><axis xyz='1 0 0'/><limit lower='-1' upper='1' "
                "effort='1' velocity='1'/>") +
          joint("gear", "continuous", "hand", "rotor",
                "<axis xyz='0 0 1'/><mimic joint='shoulder' multiplier='-2' offset='0.3'/>") +
          joint("hub", "fixed", "rotor", "fan", "<origin xyz='0 0 2' rpy='0 0.5 0'/>") + "</robot>",
      options);
  ASSERT_THAT(visuals.drawn, SizeIs(6));
  const robot::Vector q = robot::Vector::Constant(1, 0.9);
  const auto Y = Vector3d::UnitY(), X = Vector3d::UnitX(), Z = Vector3d::UnitZ();
  const Eigen::Isometry3d base = origin(1, 2, 3, 0.3, -0.2, 1.1);
  const Eigen::Isometry3d arm = base * origin(0, 0, 1, 0.1, 0.2, 0.3) * turned(0.9, Y);
  const Eigen::Isometry3d bracket = arm * origin(1, 0, 0, -1, 0.5, 2);
  const Eigen::Isometry3d hand = bracket * origin(0, 1, 0, 0, 1, 0) * turned(0.7, X);
  const Eigen::Isometry3d rotor = hand * turned(-2 * 0.9 + 0.3, Z);
  const Eigen::Isometry3d expected[] = {
      base * origin(0.1, 0.2, 0.3, 1, 2, 3),
      arm,
      bracket * origin(0.5, 0, 0.1, 0.4, -0.5, 0.6),
      hand * origin(0, 0, 0, 0, 0, 1),
      rotor * origin(0, 0, 1, 0, 0, 0),
      rotor * origin(0, 0, 2, 0, 0.5, 0) * origin(1, 0, 0, 0, 0, 0)};
  for (std::size_t i = 0; i < 6; ++i) {
    const auto pose = robot::frame_pose<double>(model_, visuals.drawn[i].place, q);
    // Rounding of some ten products of numbers of order 1.
    EXPECT_LT((pose.R - expected[i].linear()).norm(), 1e-12) << i;
    EXPECT_LT((pose.p - expected[i].translation()).norm(), 1e-12) << i;
  }
}

TEST_F(VisualsOf, MeshesAreReadFromBinaryAndTextStlAndFromObj) {
  write(urdf_.parent_path() / "a.stl", binary_stl(triangle, 1));
  write(urdf_.parent_path() / "b.STL", text_stl);
  // A square of four corners, by indices from the end and with textures, is a fan of two triangles.
  write(urdf_.parent_path() / "c.obj",
        "# square\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvn 0 0 1\nf -4//1 -3//1 -2//1 -1//1\n");
  EXPECT_EQ(mesh("filename='a.stl'"), triangle);
  EXPECT_EQ(mesh("filename='b.STL'"), triangle);
  const std::vector<Vector3d> square = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0},
                                        {0, 0, 0}, {1, 1, 0}, {0, 1, 0}};
  EXPECT_EQ(mesh("filename='c.obj'"), square);
}

TEST_F(VisualsOf, MeshesAreScaledAndMirrorsKeepTheirOutsideOut) {
  write(urdf_.parent_path() / "a.stl", binary_stl(triangle, 1));
  EXPECT_EQ(mesh("filename='a.stl' scale='0.5 2 0.25'"),
            (std::vector<Vector3d>{{0.5, 0, 0}, {0, 4, 0}, {0, 0, 1}}));
  EXPECT_EQ(mesh("filename='a.stl' scale='1 -1 1'"),
            (std::vector<Vector3d>{{1, 0, 0}, {0, 0, 4}, {0, -2, 0}}));
}

TEST_F(VisualsOf, MeshesAreFoundByPackageFileAndPath) {
  const auto put = [&](const std::string& where, double x) {
    write(directory_ / where, binary_stl({{x, 0, 0}, {0, 1, 0}, {0, 0, 1}}, 1));
  };
  const auto found = [&](const std::string& name) {
    return mesh("filename='" + name + "'").at(0).x();
  };
  put("ws/robots/arm/meshes/a.stl", 1);  // the package is a folder above the URDF,
  put("ws/tools/a.stl", 2);              // or beside one above
  EXPECT_EQ(found("package://arm/meshes/a.stl"), 1);
  EXPECT_EQ(found("package://tools/a.stl"), 2);
  EXPECT_EQ(found("../meshes/a.stl"), 1);
  EXPECT_EQ(found("file://" + (directory_ / "ws/tools/a.stl").string()), 2);
  put("prefix/share/tools/a.stl", 3);
  setenv("AMENT_PREFIX_PATH", (directory_ / "none").c_str(), 1);
  EXPECT_EQ(found("package://tools/a.stl"), 2);
  const std::string folder = directory_.path().string();
  setenv("AMENT_PREFIX_PATH", (folder + "/none:" + folder + "/prefix").c_str(), 1);
  EXPECT_EQ(found("package://tools/a.stl"), 3);
  put("src/tools/a.stl", 4);
  setenv("ROS_PACKAGE_PATH", (":" + folder + "/src").c_str(), 1);
  EXPECT_EQ(found("package://tools/a.stl"), 4);
  EXPECT_EQ(found("package://arm/meshes/a.stl"), 1);  // not there
}

TEST_F(VisualsOf, NothingWrongWithOneRefusesTheRobotOrHidesTheOthers) {
  const fs::path folder = urdf_.parent_path();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const std::string whole = binary_stl(triangle, 1);
  write(folder / "cut.stl", whole.substr(0, whole.size() - 1));
  write(folder / "bold.stl", binary_stl(triangle, 4'000'000'000U));
  write(folder / "header.stl", whole.substr(0, 50));
  write(folder / "none.stl", binary_stl({}, 0));
  write(folder / "nan.stl", binary_stl({{nan, 0, 0}, {0, 1, 0}, {0, 0, 1}}, 1));
  write(folder / "text.stl", text_stl.substr(0, text_stl.find("endloop")));
  write(folder / "beyond.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n");
  write(folder / "before.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 -4\n");
  write(folder / "zero.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n");
  write(folder / "words.obj", "v here there 0\n");
  write(folder / "empty.obj", "");
  write(folder / "a.dae", "<COLLADA/>");
  write(folder / "large.stl", "");
  fs::resize_file(folder / "large.stl", max_mesh_file + 1);
  fs::create_directory(folder / "folder.stl");
  ASSERT_EQ(mkfifo((folder / "pipe.stl").c_str(), 0600), 0);
  const auto of_file = [](const std::string& name) {
    return visual("<mesh filename='" + name + "'/>");
  };
  const std::map<std::string, std::string> wrong = {
      {of_file("cut.stl"), "mesh \"cut.stl\" cannot be read"},
      {of_file("bold.stl"), "mesh \"bold.stl\" cannot be read"},
      {of_file("header.stl"), "mesh \"header.stl\" cannot be read"},
      {of_file("none.stl"), "mesh \"none.stl\" has no triangle"},
      {of_file("nan.stl"), "farther away than 10000 m"},
      {of_file("text.stl"), "mesh \"text.stl\" cannot be read"},
      {of_file("beyond.obj"), "a vertex that does not exist"},
      {of_file("before.obj"), "a vertex that does not exist"},
      {of_file("zero.obj"), "a vertex that does not exist"},
      {of_file("words.obj"), "mesh \"words.obj\" cannot be read"},
      {of_file("empty.obj"), "mesh \"empty.obj\" has no triangle"},
      {of_file("a.dae"), "mesh \"a.dae\" is neither STL nor OBJ; convert it"},
      {of_file("large.stl"), "mesh \"large.stl\" is larger than 32 MiB"},
      {of_file("folder.stl"), "mesh \"folder.stl\" is not found"},
      {of_file("pipe.stl"), "mesh \"pipe.stl\" is not found"},
      {of_file("absent.stl"), "mesh \"absent.stl\" is not found"},
      {of_file("package://p/a.stl"), "into ROS_PACKAGE_PATH"},
      {visual("<mesh/>"), "mesh \"\" is not found"},
      {visual("<mesh filename='a.stl' scale='1 0 1'/>"), "scale"},
      {visual("<mesh filename='a.stl' scale='2'/>"), "scale=\"2\">: not 3 numbers"},
      {visual("<box size='1 2'/>"), "<box size=\"1 2\">: not 3 numbers"},
      {visual("<box size='1 2 3 4'/>"), "<box size=\"1 2 3 4\">: not 3 numbers"},
      {visual("<box size='1 2 0'/>"), "<box size=\"1 2 0\">: not above 0"},
      {visual("<sphere radius='nan'/>"), "<sphere radius=\"nan\">: not 1 number"},
      {visual("<sphere radius='1e999'/>"), "<sphere radius=\"1e999\">: not 1 number"},
      {visual("<cylinder radius='1'/>"), "<cylinder length=\"\">: not 1 number"},
      {visual("<capsule radius='1'/>"), "<capsule>: none of box, cylinder, sphere and mesh"},
      {visual(""), "no shape in <geometry>"},
      {"<visual/>", "no shape in <geometry>"},
      {visual("<sphere radius='1'/>", "<origin xyz='0 0'/>"), "<origin xyz=\"0 0\">"},
      {visual("<sphere radius='1'/>", "<material><color rgba='2 0 0 1'/></material>"),
       "<color rgba=\"2 0 0 1\">: not from 0 to 1"}};
  const std::string good = visual("<sphere radius='1'/>");
  for (const auto& [one, why] : wrong) {
    const Visuals visuals = of_arm(good + one + good);
    EXPECT_THAT(visuals.drawn, SizeIs(2)) << one;
    ASSERT_THAT(visuals.problems, SizeIs(1)) << one;
    EXPECT_THAT(visuals.problems[0],
                AllOf(StartsWith(urdf_.string() + ": link 'arm': "), HasSubstr(why)));
    EXPECT_THAT(visuals.bodies_with_problems, ElementsAre(0));
  }
}

TEST_F(VisualsOf, OneLineSaysHowManyCannotBeDrawnAndWhichIsFirst) {
  const Visuals visuals =
      of_arm(visual("<mesh filename='a.dae'/>") + visual("<sphere radius='1'/>") +
             visual("<mesh filename='b.dae'/>"));
  ASSERT_TRUE(visuals.warning());
  EXPECT_THAT(*visuals.warning(), AllOf(StartsWith("2 of 3 visuals cannot be drawn"),
                                        HasSubstr("link 'arm': mesh "
                                                  "\"a.dae\""),
                                        Not(HasSubstr("b.dae")), Not(HasSubstr("\n"))));
}

TEST(MeshFile, IsReadUpToANumberOfTriangles) {
  const TemporaryDirectory directory;
  std::vector<Vector3d> two = triangle;
  two.insert(two.end(), triangle.rbegin(), triangle.rend());
  write(directory / "two.stl", binary_stl(two, 2));
  EXPECT_THAT(read_mesh(directory / "two.stl", 2), SizeIs(6));
  EXPECT_THROW(read_mesh(directory / "two.stl", 1), std::runtime_error);
}

}  // namespace
}  // namespace tachless::viewer
