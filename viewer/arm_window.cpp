#include "viewer/arm_window.h"

#include <SimTKsimbody.h>
#include <unistd.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <memory>
#include <set>
#include <string_view>
#include <variant>
#include <vector>

#include "diagnostics/failure.h"
#include "robot/kinematics.h"

namespace tachless::viewer {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

SimTK::Vec3 vec3(const Vector3d& x) { return {x.x(), x.y(), x.z()}; }

SimTK::Transform transform(const Matrix3d& R, const Vector3d& p) {
  return {SimTK::Rotation(SimTK::Mat33(R(0, 0), R(0, 1), R(0, 2), R(1, 0), R(1, 1), R(1, 2),
                                       R(2, 0), R(2, 1), R(2, 2)),
                          true),
          vec3(p)};
}

robot::Frame at(int body, const Vector3d& p, const Matrix3d& R = Matrix3d::Identity()) {
  return {body, R, p};
}
constexpr int ground = -1;

/// Turns y, which Simbody's cylinders are along, into `axis`.
Matrix3d along(const Vector3d& axis) {
  return Eigen::Quaterniond::FromTwoVectors(Vector3d::UnitY(), axis).toRotationMatrix();
}

bool nowhere(const Vector3d& p) { return p.norm() < 1e-9; }

/// Whether another body has the same coordinate already: a rotor, a belt, the other finger.
bool follows_another(const robot::Model& model, int body) {
  const int coordinate = model.bodies[static_cast<std::size_t>(body)].coordinate;
  return std::any_of(model.bodies.begin(), model.bodies.begin() + body,
                     [&](const robot::Body& other) { return other.coordinate == coordinate; });
}

/// Points of a body to which a link is drawn from its origin: its children's joints, the ends of
/// the tree; without either, twice as far as its centre of mass.
std::vector<Vector3d> ends_of(const robot::Model& model, int body) {
  std::vector<Vector3d> ends;
  for (const robot::Body& other : model.bodies) {
    if (other.parent == body) ends.push_back(other.p_PB);
  }
  for (const auto& [name, frame] : model.frames) {
    if (frame.body == body && frame.leaf) ends.push_back(frame.p_BF);
  }
  ends.erase(std::remove_if(ends.begin(), ends.end(), nowhere), ends.end());
  if (ends.empty() && body >= 0 && !follows_another(model, body)) {
    const Vector3d opposite = 2 * model.bodies[static_cast<std::size_t>(body)].p_Bcm;
    if (!nowhere(opposite)) ends.push_back(opposite);
  }
  return ends;
}

/// Whether there is nothing to see of it: all of it is in another joint's housing.
bool hidden(const robot::Model& model, int body) {
  return follows_another(model, body) && ends_of(model, body).empty() &&
         nowhere(model.bodies[static_cast<std::size_t>(body)].p_PB);
}

/// Length of the longest chain of links [m].
double reach_of(const robot::Model& model) {
  std::vector<double> to_origin;
  double reach = 0;
  for (std::size_t i = 0; i < model.bodies.size(); ++i) {
    const robot::Body& body = model.bodies[i];
    const double before = body.parent < 0 ? 0 : to_origin[static_cast<std::size_t>(body.parent)];
    to_origin.push_back(before + body.p_PB.norm());
    reach = std::max(reach, to_origin.back());
    for (const Vector3d& end : ends_of(model, static_cast<int>(i))) {
      reach = std::max(reach, to_origin.back() + end.norm());
    }
  }
  return reach > 0 ? reach : 1;
}

/// Bodies that have visuals, all of which are drawn.
std::set<int> bodies_shown_by(const Visuals& visuals) {
  std::set<int> bodies;
  for (const Visual& visual : visuals.drawn) bodies.insert(visual.place.body);
  for (const int body : visuals.bodies_with_problems) bodies.erase(body);
  return bodies;
}

constexpr double smoothness = 3;  // triangles, relative to Simbody's default

/// What Simbody draws at the frame of a geometry; more than one for a mesh that is large.
struct Drawn {
  std::vector<SimTK::DecorativeGeometry> operator()(const Box& box) const {
    return {SimTK::DecorativeBrick(vec3(box.size / 2))};
  }
  std::vector<SimTK::DecorativeGeometry> operator()(const Cylinder& cylinder) const {
    return {SimTK::DecorativeCylinder(cylinder.radius, cylinder.length / 2)
                .setTransform(transform(along(Vector3d::UnitZ()), Vector3d::Zero()))};
  }
  std::vector<SimTK::DecorativeGeometry> operator()(const Sphere& sphere) const {
    return {SimTK::DecorativeSphere(sphere.radius)};
  }
  /// Each triangle has corners of its own: with common ones, Simbody rounds the edges off.
  std::vector<SimTK::DecorativeGeometry> operator()(const Mesh& mesh) const {
    constexpr std::size_t most = 65535;  // corners that Simbody's window takes at once
    std::vector<SimTK::DecorativeGeometry> parts;
    for (std::size_t begin = 0; begin < mesh.corners.size(); begin += most) {
      SimTK::PolygonalMesh part;
      for (std::size_t i = begin; i < std::min(begin + most, mesh.corners.size()); i += 3) {
        SimTK::Array_<int> triangle;
        for (std::size_t corner = i; corner < i + 3; ++corner) {
          triangle.push_back(part.addVertex(vec3(mesh.corners[corner])));
        }
        part.addFace(triangle);
      }
      parts.push_back(SimTK::DecorativeMesh(part));
    }
    return parts;
  }
};

const SimTK::Vec3 link_color(1.0, 0.55, 0.10);
const SimTK::Vec3 joint_color(0.36, 0.42, 0.50);
const SimTK::Vec3 stand_color(0.88, 0.90, 0.93);
const SimTK::Vec3 floor_color(0.78, 0.81, 0.85);
const SimTK::Vec3 background_color(0.95, 0.96, 0.98);

/// The robot and what stands around it, as Simbody's window asks for it before each picture.
class Scene : public SimTK::DecorationGenerator {
 public:
  Scene(const robot::Model& model, const Visuals& visuals, const std::vector<std::string>& tools,
        const robot::Vector& initial)
      : q(initial), model_(model), reach_(reach_of(model)), radius_(0.04 * reach_) {
    const std::set<int> shown = bodies_shown_by(visuals);
    const bool stands = shown.count(ground) == 0;
    if (stands) draw_links(ground, stand_color);
    for (int i = 0; i < static_cast<int>(model.bodies.size()); ++i) {
      if (shown.count(i) != 0 || hidden(model, i)) continue;
      draw_joint(i);
      draw_links(i, link_color);
    }
    for (const Visual& visual : visuals.drawn) draw_visual(visual);
    for (const std::string& tool : tools) draw_axes(model.frames.at(tool));
    measure();
    draw_floor();
    if (stands) draw_stand();
  }

  void generateDecorations(const SimTK::State& /*state*/,
                           SimTK::Array_<SimTK::DecorativeGeometry>& drawn) override {
    for (const Part& part : parts_) {
      const robot::Pose<double> X = robot::frame_pose<double>(model_, part.frame, q);
      drawn.push_back(part.geometry);
      drawn.back().setTransform(transform(X.R, X.p) * part.geometry.getTransform());
    }
  }

  /// Everything in view, from the side and a little above.
  [[nodiscard]] SimTK::Transform camera() const {
    const SimTK::UnitVec3 towards_viewer(0.45, -1, 0.3);
    const SimTK::Rotation R_GC(towards_viewer, SimTK::ZAxis, SimTK::Vec3(0, 0, 1), SimTK::YAxis);
    const double distance = 0.9 * reach_ + 1.1 * box_.diagonal().norm();
    return {R_GC, vec3(box_.center()) + distance * towards_viewer};
  }

  robot::Vector q;  ///< that is drawn

 private:
  struct Part {
    robot::Frame frame;
    SimTK::DecorativeGeometry geometry;
  };

  void draw(const robot::Frame& frame, SimTK::DecorativeGeometry geometry,
            const SimTK::Vec3& color) {
    geometry.setColor(color);
    parts_.push_back({frame, geometry});
  }

  void draw_visual(const Visual& visual) {
    for (SimTK::DecorativeGeometry& geometry : std::visit(Drawn{}, visual.geometry)) {
      SimTK::Vec3 color = link_color;
      if (const auto& rgba = visual.rgba) {
        color = {(*rgba)[0], (*rgba)[1], (*rgba)[2]};
        geometry.setOpacity((*rgba)[3]);
      }
      draw(visual.place, geometry.setResolution(smoothness), color);
    }
  }

  /// Bars from the frame's origin along its axes.
  void draw_axes(const robot::Frame& frame) {
    const double half_length = 1.5 * radius_;
    for (int i = 0; i < 3; ++i) {
      const Vector3d axis_B = frame.R_BF.col(i);
      SimTK::Vec3 color(0.15);
      color[i] = 1;
      draw(at(frame.body, frame.p_BF + half_length * axis_B, along(axis_B)),
           SimTK::DecorativeCylinder(0.15 * radius_, half_length), color);
    }
  }

  void draw_joint(int number) {
    const robot::Body& body = model_.bodies[static_cast<std::size_t>(number)];
    const robot::Frame axle = at(number, Vector3d::Zero(), along(body.axis_B));
    if (body.type == robot::JointType::revolute) {
      draw(axle, SimTK::DecorativeCylinder(1.35 * radius_, 1.5 * radius_).setResolution(smoothness),
           joint_color);
    } else {
      draw(axle, SimTK::DecorativeBrick(SimTK::Vec3(1.3, 2, 1.3) * radius_), joint_color);
    }
  }

  void draw_links(int number, const SimTK::Vec3& color) {
    for (const Vector3d& end : ends_of(model_, number)) {
      draw(at(number, end / 2, along(end)),
           SimTK::DecorativeCylinder(radius_, end.norm() / 2).setResolution(smoothness), color);
      draw(at(number, end), SimTK::DecorativeSphere(radius_).setResolution(smoothness), color);
    }
  }

  /// The box that holds the robot as it is, and the height of the floor below it.
  void measure() {
    const auto include = [&](int body, const Vector3d& p_B) {
      box_.extend(robot::frame_pose<double>(model_, at(body, p_B), q).p);
    };
    for (int i = ground; i < static_cast<int>(model_.bodies.size()); ++i) {
      include(i, Vector3d::Zero());
      for (const Vector3d& end : ends_of(model_, i)) include(i, end);
    }
    const double lowest = box_.min().z();
    floor_ = lowest > -0.01 * reach_ ? 0 : lowest - 0.15 * reach_;
  }

  void draw_floor() {
    constexpr int half = 8;  // tiles on either side
    const double tile = 0.25 * reach_;
    const double edge = half * tile;
    const auto line = [&](const Vector3d& from, const Vector3d& to) {
      draw(at(ground, Vector3d::Zero()), SimTK::DecorativeLine(vec3(from), vec3(to)), floor_color);
    };
    for (int i = -half; i <= half; ++i) {
      line({-edge, i * tile, floor_}, {edge, i * tile, floor_});
      line({i * tile, -edge, floor_}, {i * tile, edge, floor_});
    }
  }

  /// From the floor to the root, or what hangs from above.
  void draw_stand() {
    const robot::Body& first = model_.bodies.front();
    const Vector3d axis = first.R_PB * first.axis_B;
    if (floor_ == 0) {
      stand({0, 0, 0.01 * reach_}, Vector3d(0.12, 0.12, 0.01) * reach_);
    } else if (std::abs(axis.z()) < 0.5) {  // beside the arm's plane, away from the viewer
      const Vector3d away = axis.y() < 0 ? Vector3d(-axis) : axis;
      const Vector3d root = first.p_PB + 5 * radius_ * away;
      const double top = root.z() + 2 * radius_;
      stand({root.x(), root.y(), (top + floor_) / 2}, {radius_, radius_, (top - floor_) / 2});
      stand({root.x(), root.y(), floor_ + 0.01 * reach_}, Vector3d(0.15, 0.15, 0.01) * reach_);
      draw(at(ground, first.p_PB + 3 * radius_ * away, along(away)),
           SimTK::DecorativeCylinder(0.7 * radius_, 2 * radius_), stand_color);
    } else {  // from above
      stand(first.p_PB + Vector3d(0, 0, 2 * radius_),
            {0.15 * reach_, 0.15 * reach_, 0.5 * radius_});
    }
  }

  void stand(const Vector3d& middle, const Vector3d& half_lengths) {
    draw(at(ground, middle), SimTK::DecorativeBrick(vec3(half_lengths)), stand_color);
  }

  const robot::Model& model_;
  double reach_;   ///< of the robot [m]
  double radius_;  ///< of the links [m]
  std::vector<Part> parts_;
  Eigen::AlignedBox3d box_{Vector3d(0, 0, 0)};  ///< around the robot [m]
  double floor_ = 0;                            ///< height [m]
};

}  // namespace

/// Simbody knows no joint of the robot: all it has is pictures.
struct ArmWindow::Window {
  Window(std::unique_ptr<Scene> drawn, const std::string& title,
         const std::filesystem::path& viewers)
      : state([this] {
          matter.setShowDefaultGeometry(false);
          return system.realizeTopology();
        }()),
        visualizer(system, SimTK::Array_<SimTK::String>(1, viewers.string() + "/")),
        scene(*drawn) {
    system.realizeModel(state);
    visualizer.addDecorationGenerator(drawn.release());
    visualizer.setShutdownWhenDestructed(true);
    visualizer.setMode(SimTK::Visualizer::PassThrough);
    visualizer.setWindowTitle(title);
    visualizer.setShowSimTime(true);
    visualizer.setBackgroundType(SimTK::Visualizer::SolidColor);
    visualizer.setBackgroundColor(background_color);
    visualizer.setSystemUpDirection(SimTK::ZAxis);
    visualizer.setShowShadows(false);
    visualizer.setCameraTransform(scene.camera());
  }

  void show(double t_s) {
    state.setTime(t_s);
    system.realize(state, SimTK::Stage::Position);
    visualizer.drawFrameNow(state);
  }

  SimTK::MultibodySystem system;
  SimTK::SimbodyMatterSubsystem matter{system};
  SimTK::State state;
  SimTK::Visualizer visualizer;
  Scene& scene;  ///< the visualizer's
};

ArmWindow::ArmWindow(const robot::Model& model, const Visuals& visuals,
                     const std::vector<std::string>& tools, const robot::Vector& initial,
                     const std::string& title, const std::filesystem::path& viewers) {
  // Where Simbody finds none, it goes on in two processes.
  if (access(SIMBODY_VIEWER, X_OK) != 0) {
    throw diagnostics::bad_usage("there is no " SIMBODY_VIEWER
                                 "; as root, type: apt-get install --reinstall libsimbody3.7");
  }
  try {
    window_ = std::make_unique<Window>(std::make_unique<Scene>(model, visuals, tools, initial),
                                       title, viewers);
    window_->show(0);
  } catch (const std::exception& error) {
    // Simbody's own words, or none at all.
    const std::string_view why = error.what();
    throw why == "std::exception"
        ? diagnostics::bad_usage(viewer_ended)
        : diagnostics::bad_usage("Simbody's window cannot be opened: {}", why);
  }
}

ArmWindow::~ArmWindow() = default;

void ArmWindow::show(double t_s, const robot::Vector& q) {
  try {
    window_->scene.q = q;
    window_->show(t_s);
  } catch (const std::exception& error) {
    throw diagnostics::bad_usage("Simbody's window does not draw: {}", error.what());
  }
}

}  // namespace tachless::viewer
