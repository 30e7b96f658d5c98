#include "viewer/visuals.h"

#include <SimTKsimbody.h>
#include <fmt/format.h>
#include <tinyxml.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cstdlib>
#include <exception>
#include <locale>
#include <map>
#include <sstream>
#include <stdexcept>
#include <system_error>
#include <utility>

#include "diagnostics/text.h"

namespace tachless::viewer {
namespace {

namespace fs = std::filesystem;

constexpr double farthest = 1e4;  // of any number; a float's bounding box stays a number

std::vector<const TiXmlElement*> children(const TiXmlElement& element, const char* name) {
  std::vector<const TiXmlElement*> found;
  for (auto* child = element.FirstChildElement(name); child != nullptr;
       child = child->NextSiblingElement(name)) {
    found.push_back(child);
  }
  return found;
}

/// Empty when there is none.
std::string text_of(const TiXmlElement& element, const char* attribute) {
  const char* given = element.Attribute(attribute);
  return given == nullptr ? "" : given;
}

/// @throw std::runtime_error unless the attribute is `count` numbers
Eigen::VectorXd numbers(const TiXmlElement& element, const char* attribute, Eigen::Index count) {
  const std::string text = text_of(element, attribute);
  std::istringstream in(text);
  in.imbue(std::locale::classic());
  Eigen::VectorXd x(count);
  for (double& value : x) in >> value;
  std::string rest;
  if (!in || in >> rest || x.cwiseAbs().maxCoeff() > farthest) {
    throw std::runtime_error(fmt::format("<{} {}=\"{}\">: not {} number{} of at most {:g}",
                                         element.ValueStr(), attribute, text, count,
                                         count == 1 ? "" : "s", farthest));
  }
  return x;
}

Eigen::VectorXd lengths(const TiXmlElement& element, const char* attribute, Eigen::Index count) {
  Eigen::VectorXd x = numbers(element, attribute, count);
  if (x.minCoeff() > 0) return x;
  throw std::runtime_error(fmt::format("<{} {}=\"{}\">: not above 0", element.ValueStr(), attribute,
                                       text_of(element, attribute)));
}

Eigen::Vector3d numbers_or(const TiXmlElement* element, const char* attribute,
                           const Eigen::Vector3d& otherwise) {
  if (element == nullptr || element->Attribute(attribute) == nullptr) return otherwise;
  return numbers(*element, attribute, 3);
}

std::vector<fs::path> listed_in(const char* variable) {
  std::vector<fs::path> folders;
  const char* value = std::getenv(variable);
  std::istringstream in(value == nullptr ? "" : value);
  for (std::string folder; std::getline(in, folder, ':');) {
    if (!folder.empty()) folders.emplace_back(folder);
  }
  return folders;
}

/// Where the mesh called `name` is. @throw std::runtime_error when it is nowhere
fs::path find_mesh(const std::string& name, const fs::path& urdf) {
  const std::string package = "package://", file = "file://";
  const fs::path beside = fs::absolute(urdf).parent_path();
  std::vector<fs::path> candidates;
  const bool in_package = name.rfind(package, 0) == 0;
  if (in_package) {
    const fs::path path = name.substr(package.size());
    for (const fs::path& folder : listed_in("ROS_PACKAGE_PATH"))
      candidates.push_back(folder / path);
    for (const fs::path& prefix : listed_in("AMENT_PREFIX_PATH")) {
      candidates.push_back(prefix / "share" / path);
    }
    for (fs::path folder = beside;; folder = folder.parent_path()) {
      candidates.push_back(folder / path);
      if (folder == folder.parent_path()) break;
    }
  } else {
    candidates.push_back(beside / (name.rfind(file, 0) == 0 ? name.substr(file.size()) : name));
  }
  for (const fs::path& candidate : candidates) {
    std::error_code none;
    if (fs::is_regular_file(candidate, none)) return candidate;
  }
  throw std::runtime_error(
      in_package ? "is not found; put the folder that holds the package into ROS_PACKAGE_PATH"
                 : "is not found");
}

class Reader {
 public:
  Reader(fs::path urdf, const robot::Model& model) : urdf_(std::move(urdf)), model_(model) {}

  Visuals read() {
    TiXmlDocument document;
    const TiXmlElement* robot = nullptr;
    if (document.LoadFile(urdf_.string(), TIXML_ENCODING_UTF8)) {
      robot = document.FirstChildElement("robot");
    }
    if (robot == nullptr) {
      note(-1, "the file has changed and is no robot any more");
      return std::move(read_);
    }
    for (const auto* material : children(*robot, "material")) note_color(*material);
    for (const auto* link : children(*robot, "link")) {
      const auto frame = model_.frames.find(text_of(*link, "name"));
      if (frame == model_.frames.end()) continue;
      for (const auto* visual : children(*link, "visual")) {
        try {
          read_.drawn.push_back(visual_of(*visual, frame->second));
        } catch (const std::exception& error) {
          note(frame->second.body, fmt::format("link '{}': {}", frame->first, error.what()));
        }
      }
    }
    return std::move(read_);
  }

 private:
  void note(int body, const std::string& problem) {
    read_.problems.push_back(urdf_.string() + ": " + problem);
    read_.bodies_with_problems.push_back(body);
  }

  /// The colour of a material, of which others need but the name.
  const TiXmlElement* note_color(const TiXmlElement& material) {
    const TiXmlElement* color = material.FirstChildElement("color");
    const char* name = material.Attribute("name");
    if (name == nullptr) return color;
    const TiXmlElement*& known = colors_[name];
    if (color != nullptr) known = color;
    return known;
  }

  /// @throw std::runtime_error saying what is wrong with it
  Visual visual_of(const TiXmlElement& visual, const robot::Frame& link) {
    Visual read;
    const TiXmlElement* origin = visual.FirstChildElement("origin");
    const Eigen::Vector3d xyz = numbers_or(origin, "xyz", Eigen::Vector3d::Zero());
    const Eigen::Vector3d rpy = numbers_or(origin, "rpy", Eigen::Vector3d::Zero());
    const Eigen::Matrix3d R_LV = (Eigen::AngleAxisd(rpy.z(), Eigen::Vector3d::UnitZ()) *
                                  Eigen::AngleAxisd(rpy.y(), Eigen::Vector3d::UnitY()) *
                                  Eigen::AngleAxisd(rpy.x(), Eigen::Vector3d::UnitX()))
                                     .toRotationMatrix();
    read.place = {link.body, link.R_BF * R_LV, link.p_BF + link.R_BF * xyz};
    if (const TiXmlElement* material = visual.FirstChildElement("material")) {
      if (const TiXmlElement* color = note_color(*material)) {
        const Eigen::VectorXd rgba = numbers(*color, "rgba", 4);
        if (rgba.minCoeff() < 0 || rgba.maxCoeff() > 1) {
          throw std::runtime_error(
              fmt::format("<color rgba=\"{}\">: not from 0 to 1", text_of(*color, "rgba")));
        }
        read.rgba = {rgba[0], rgba[1], rgba[2], rgba[3]};
      }
    }
    const TiXmlElement* geometry = visual.FirstChildElement("geometry");
    const TiXmlElement* shape = geometry == nullptr ? nullptr : geometry->FirstChildElement();
    if (shape == nullptr) throw std::runtime_error("<visual>: no shape in <geometry>");
    const std::string& kind = shape->ValueStr();
    if (kind == "box") {
      read.geometry = Box{lengths(*shape, "size", 3)};
    } else if (kind == "cylinder") {
      read.geometry = Cylinder{lengths(*shape, "radius", 1)[0], lengths(*shape, "length", 1)[0]};
    } else if (kind == "sphere") {
      read.geometry = Sphere{lengths(*shape, "radius", 1)[0]};
    } else if (kind == "mesh") {
      read.geometry = mesh_of(*shape);
    } else {
      throw std::runtime_error("<" + kind + ">: none of box, cylinder, sphere and mesh");
    }
    return read;
  }

  Mesh mesh_of(const TiXmlElement& element) {
    const std::string name = text_of(element, "filename");
    const Eigen::Vector3d scale = numbers_or(&element, "scale", Eigen::Vector3d::Ones());
    if (scale.prod() == 0) throw std::runtime_error("<mesh scale>: 0 leaves nothing to see");
    Mesh mesh;
    try {
      mesh.corners = read_mesh(find_mesh(name, urdf_), max_triangles - num_triangles_);
    } catch (const std::exception& error) {
      throw std::runtime_error(fmt::format("mesh \"{}\" {}", name, error.what()));
    }
    for (Eigen::Vector3d& corner : mesh.corners) {
      corner = corner.cwiseProduct(scale);
      if (!(corner.cwiseAbs().maxCoeff() <= farthest)) {
        throw std::runtime_error(fmt::format(
            "mesh \"{}\" has a corner farther away than {:g} m (is it in another unit?)", name,
            farthest));
      }
    }
    // A mirror turns the triangles' outside in.
    for (std::size_t i = 0; scale.prod() < 0 && i < mesh.corners.size(); i += 3) {
      std::swap(mesh.corners[i + 1], mesh.corners[i + 2]);
    }
    num_triangles_ += mesh.corners.size() / 3;
    return mesh;
  }

  fs::path urdf_;
  const robot::Model& model_;
  std::map<std::string, const TiXmlElement*> colors_;  ///< by the material's name
  std::size_t num_triangles_ = 0;
  Visuals read_;
};

}  // namespace

std::vector<Eigen::Vector3d> read_mesh(const fs::path& file, std::size_t most) {
  const std::string ending = SimTK::String::toLower(file.extension().string());
  if (ending != ".stl" && ending != ".obj") {
    throw std::runtime_error("is neither STL nor OBJ; convert it");
  }
  if (fs::file_size(file) > max_mesh_file) {
    throw std::runtime_error("is larger than 32 MiB; give a coarser one");
  }
  SimTK::PolygonalMesh mesh;
  try {
    mesh.loadFile(file.string());
  } catch (const std::exception& error) {  // in several lines
    throw std::runtime_error("cannot be read: " + diagnostics::one_line(error.what()));
  }
  std::vector<Eigen::Vector3d> corners;
  for (int face = 0; face < mesh.getNumFaces(); ++face) {
    for (int third = 2; third < mesh.getNumVerticesForFace(face); ++third) {
      if (corners.size() == 3 * most) {
        throw std::runtime_error("has too many triangles; give a coarser one");
      }
      for (const int corner : {0, third - 1, third}) {
        const int vertex = mesh.getFaceVertex(face, corner);
        // Simbody does not look at an OBJ file's indices.
        if (vertex < 0 || vertex >= mesh.getNumVertices()) {
          throw std::runtime_error("has a face with a vertex that does not exist");
        }
        const SimTK::Vec3& p = mesh.getVertexPosition(vertex);
        corners.emplace_back(p[0], p[1], p[2]);
      }
    }
  }
  if (corners.empty()) throw std::runtime_error("has no triangle");
  return corners;
}

Visuals read_visuals(const fs::path& urdf, const robot::Model& model) {
  return Reader(urdf, model).read();
}

std::optional<std::string> Visuals::warning() const {
  if (problems.empty()) return std::nullopt;
  return fmt::format("{} of {} visuals cannot be drawn, cylinders are instead; the first: {}",
                     problems.size(), problems.size() + drawn.size(), problems.front());
}

}  // namespace tachless::viewer
