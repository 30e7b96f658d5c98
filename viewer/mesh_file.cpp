#include "viewer/mesh_file.h"

#include <SimTKsimbody.h>

#include <algorithm>
#include <cctype>
#include <exception>
#include <stdexcept>
#include <string>

#include "diagnostics/text.h"

namespace tachless::viewer {
namespace {

SimTK::PolygonalMesh loaded(const std::filesystem::path& file) {
  std::string ending = file.extension().string();
  std::transform(ending.begin(), ending.end(), ending.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  if (ending != ".stl" && ending != ".obj") {
    throw std::runtime_error("is neither STL nor OBJ; convert it");
  }
  if (std::filesystem::file_size(file) > max_mesh_file) {
    throw std::runtime_error("is larger than 32 MiB; give a coarser one");
  }
  SimTK::PolygonalMesh mesh;
  try {
    mesh.loadFile(file.string());
  } catch (const std::exception& error) {  // in several lines
    throw std::runtime_error("cannot be read: " + diagnostics::one_line(error.what()));
  }
  return mesh;
}

}  // namespace

std::vector<Eigen::Vector3d> read_mesh(const std::filesystem::path& file,
                                       std::size_t max_triangles) {
  const SimTK::PolygonalMesh mesh = loaded(file);
  std::vector<Eigen::Vector3d> corners;
  // Simbody does not look at an OBJ file's indices.
  const auto add = [&](int face, int corner) {
    const int vertex = mesh.getFaceVertex(face, corner);
    if (vertex < 0 || vertex >= mesh.getNumVertices()) {
      throw std::runtime_error("has a face with a vertex that does not exist");
    }
    const SimTK::Vec3& p = mesh.getVertexPosition(vertex);
    corners.emplace_back(p[0], p[1], p[2]);
  };
  for (int face = 0; face < mesh.getNumFaces(); ++face) {
    for (int corner = 2; corner < mesh.getNumVerticesForFace(face); ++corner) {
      if (corners.size() == 3 * max_triangles) {
        throw std::runtime_error("has too many triangles; give a coarser one");
      }
      add(face, 0);
      add(face, corner - 1);
      add(face, corner);
    }
  }
  if (corners.empty()) throw std::runtime_error("has no triangle");
  return corners;
}

}  // namespace tachless::viewer
