#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <filesystem>
#include <vector>

namespace tachless::viewer {

/// A mesh file larger than this [bytes] is not read.
inline constexpr std::size_t max_mesh_file = std::size_t{32} << 20;

/// The triangles of an STL (text or binary) or Wavefront OBJ file, three corners each, in the
/// file's unit; polygons as fans. Materials, normals and, in a text STL, all solids but the first
/// are not read.
/// @throw std::runtime_error when that is not what the file is, or it holds more than
/// `max_triangles`
std::vector<Eigen::Vector3d> read_mesh(const std::filesystem::path& file,
                                       std::size_t max_triangles);

}  // namespace tachless::viewer
