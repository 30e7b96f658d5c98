#include "robot/link_shapes.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "robot/urdf_xml.h"
#include "robot/xml.h"

namespace tachless::robot {
namespace {

using Eigen::Vector3d;

/// Returns `size` numbers of an attribute, or zeros if the attribute is optional and missing.
Eigen::VectorXd numbers_of(const XmlElement& element, const char* attribute, Eigen::Index size,
                           bool optional) {
  const char* text = element.Attribute(attribute);
  if (text == nullptr && optional) return Eigen::VectorXd::Zero(size);
  const auto numbers = finite_numbers(text == nullptr ? "" : text);
  if (numbers && std::ssize(*numbers) == size) {
    return Eigen::Map<const Eigen::VectorXd>(numbers->data(), size);
  }
  throw std::invalid_argument(fmt::format("line {}: {} of <{}> is \"{}\"; needed: {} number{}",
                                          element.GetLineNum(), attribute, name_of(element),
                                          text == nullptr ? "" : text, size, size > 1 ? "s" : ""));
}

/// Sets segment and radius of a capsule about a shape, in the shape's frame.
/// @return false if the shape is no primitive
bool set_about(const XmlElement& shape, Capsule& capsule) {
  const std::string kind = name_of(shape);
  Vector3d half = Vector3d::Zero();  // of the segment
  if (kind == "box") {
    const Vector3d size = numbers_of(shape, "size", 3, false) / 2;
    Eigen::Index longest = 0;
    size.maxCoeff(&longest);
    half[longest] = size[longest];
    capsule.radius = (size - half).norm();
  } else if (kind == "sphere" || kind == "cylinder" || kind == "capsule") {
    capsule.radius = numbers_of(shape, "radius", 1, false)[0];
    if (kind != "sphere") half.z() = numbers_of(shape, "length", 1, false)[0] / 2;
  } else {
    return false;
  }
  capsule.from = -half;
  capsule.to = half;
  return true;
}

/// Returns capsules about the primitives among a link's <collision> or <visual> elements.
std::vector<Capsule> capsules_of(const XmlElement& link, const char* elements) {
  std::vector<Capsule> result;
  const char* name = link.Attribute("name");
  for (const auto* e = link.FirstChildElement(elements); e; e = e->NextSiblingElement(elements)) {
    const auto* geometry = e->FirstChildElement("geometry");
    const auto* shape = geometry == nullptr ? nullptr : geometry->FirstChildElement();
    Capsule capsule{name == nullptr ? "" : name, {}, {}, 0};
    if (shape == nullptr || !set_about(*shape, capsule)) continue;
    if (const auto* origin = e->FirstChildElement("origin")) {
      const Eigen::Matrix3d R = rotation_of(numbers_of(*origin, "rpy", 3, true));
      const Vector3d p = numbers_of(*origin, "xyz", 3, true);
      capsule.from = R * capsule.from + p;
      capsule.to = R * capsule.to + p;
    }
    result.push_back(std::move(capsule));
  }
  return result;
}

}  // namespace

std::vector<Capsule> link_capsules(const std::string& urdf) {
  XmlDocument document;
  if (const std::string problem = parse_xml(urdf, document); !problem.empty()) {
    throw std::invalid_argument(problem);
  }
  std::vector<Capsule> result;
  const auto* link = document.RootElement()->FirstChildElement("link");
  for (; link != nullptr; link = link->NextSiblingElement("link")) {
    std::vector<Capsule> own = capsules_of(*link, "collision");
    if (own.empty()) own = capsules_of(*link, "visual");
    result.insert(result.end(), own.begin(), own.end());
  }
  return result;
}

double distance(const Capsule& a, const Capsule& b) {
  // The least distance of two segments is a convex problem. Either both nearest points are inside,
  // or one of them is an end.
  const auto to_segment = [](const Vector3d& p, const Capsule& capsule) {
    const Vector3d along = capsule.to - capsule.from;
    const double length = along.squaredNorm();
    const double at = length > 0 ? std::clamp((p - capsule.from).dot(along) / length, 0.0, 1.0) : 0;
    return (p - capsule.from - at * along).norm();
  };
  double least = std::min(
      {to_segment(a.from, b), to_segment(a.to, b), to_segment(b.from, a), to_segment(b.to, a)});
  const Vector3d u = a.to - a.from, v = b.to - b.from, w = b.from - a.from, n = u.cross(v);
  const double square = n.squaredNorm();
  if (square > 1e-12 * u.squaredNorm() * v.squaredNorm()) {
    const double s = w.cross(v).dot(n) / square, t = w.cross(u).dot(n) / square;
    if (s >= 0 && s <= 1 && t >= 0 && t <= 1) {
      least = std::min(least, std::abs(w.dot(n)) / std::sqrt(square));
    }
  }
  return least - a.radius - b.radius;
}

}  // namespace tachless::robot
