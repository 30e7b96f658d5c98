#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "robot/model.h"

/// What the <visual> elements of a URDF show. Opens no window; collisions, textures and a mesh's
/// own materials are not read.
namespace tachless::viewer {

/// Lengths in m. About the origin; a cylinder is along z.
struct Box {
  Eigen::Vector3d size;
};
struct Cylinder {
  double radius, length;
};
struct Sphere {
  double radius;
};
struct Mesh {
  std::vector<Eigen::Vector3d> corners;  ///< three a triangle, counterclockwise from outside
};

struct Visual {
  robot::Frame place;  ///< the frame of its geometry in the body that its link is merged into
  std::variant<Box, Cylinder, Sphere, Mesh> geometry;
  std::optional<std::array<double, 4>> rgba;  ///< 0 to 1; the last is the opacity
};

struct Visuals {
  std::vector<Visual> drawn;
  std::vector<std::string> problems;      ///< one for each that cannot be drawn
  std::vector<int> bodies_with_problems;  ///< their bodies; -1 is the ground

  /// What to say of `problems`, on one line; nothing without any.
  [[nodiscard]] std::optional<std::string> warning() const;
};

/// A mesh file larger than this [bytes] is not read.
inline constexpr std::size_t max_mesh_file = std::size_t{32} << 20;

/// The triangles of an STL (text or binary) or Wavefront OBJ file, three corners each, in the
/// file's unit; polygons as fans. Materials, normals and, in a text STL, all solids but the first
/// are not read.
/// @throw std::runtime_error when that is not what the file is, or it holds more than
/// `most` triangles
std::vector<Eigen::Vector3d> read_mesh(const std::filesystem::path& file, std::size_t most);

/// Most triangles of all meshes of a robot.
inline constexpr std::size_t max_triangles = 500'000;

/// Reads the visuals of the file that `model` has been read from. A mesh is looked for where its
/// name says: `package://NAME/…` in a folder NAME of ROS_PACKAGE_PATH, of `share` in
/// AMENT_PREFIX_PATH, or of any folder above the URDF; `file://` and other paths relative to the
/// URDF. Nothing that is wrong with a visual throws: it is among the problems.
Visuals read_visuals(const std::filesystem::path& urdf, const robot::Model& model);

}  // namespace tachless::viewer
