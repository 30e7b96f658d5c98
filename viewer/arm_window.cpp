#include "viewer/arm_window.h"

#include <SimTKsimbody.h>
#include <unistd.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>
#include <string_view>
#include <variant>
#include <vector>

#include "diagnostics/text.h"

namespace tachless::viewer {
namespace {

SimTK::Vec3 vec3(const Eigen::Vector3d& x) { return {x.x(), x.y(), x.z()}; }

SimTK::Rotation rotation(const Eigen::Matrix3d& R) {
  return SimTK::Rotation(
      SimTK::Mat33(R(0, 0), R(0, 1), R(0, 2), R(1, 0), R(1, 1), R(1, 2), R(2, 0), R(2, 1), R(2, 2)),
      true);
}

/// Turns the axis `from` into `to`.
SimTK::Rotation turning(const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
  return rotation(Eigen::Quaterniond::FromTwoVectors(from, to).toRotationMatrix());
}

bool nowhere(const Eigen::Vector3d& p) { return p.norm() < 1e-9; }

/// Whether another body has the same coordinate already: a rotor, a belt, the other finger.
bool follows_another(const robot::Model& model, int body) {
  const int coordinate = model.bodies[static_cast<std::size_t>(body)].coordinate;
  return std::any_of(model.bodies.begin(), model.bodies.begin() + body,
                     [&](const robot::Body& other) { return other.coordinate == coordinate; });
}

/// Points of a body to which a link is drawn from its origin: its children's joints, the ends of
/// the tree; without either, twice as far as its centre of mass.
std::vector<Eigen::Vector3d> ends_of(const robot::Model& model, int body) {
  std::vector<Eigen::Vector3d> ends;
  for (const robot::Body& other : model.bodies) {
    if (other.parent == body) ends.push_back(other.p_PB);
  }
  for (const auto& [name, frame] : model.frames) {
    if (frame.body == body && frame.leaf) ends.push_back(frame.p_BF);
  }
  ends.erase(std::remove_if(ends.begin(), ends.end(), nowhere), ends.end());
  if (ends.empty() && body >= 0 && !follows_another(model, body)) {
    const Eigen::Vector3d opposite = 2 * model.bodies[static_cast<std::size_t>(body)].p_Bcm;
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
    for (const Eigen::Vector3d& end : ends_of(model, static_cast<int>(i))) {
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
    // Simbody's are along y.
    return {SimTK::DecorativeCylinder(cylinder.radius, cylinder.length / 2)
                .setTransform(turning(Eigen::Vector3d::UnitY(), Eigen::Vector3d::UnitZ()))};
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

}  // namespace

class ArmWindow::Scene {
 public:
  Scene(const robot::Model& model, const Visuals& visuals, const std::vector<std::string>& tools,
        const robot::Vector& initial, const std::string& title,
        const std::filesystem::path& viewers)
      : matter_(system_), reach_(reach_of(model)), radius_(0.04 * reach_) {
    matter_.setShowDefaultGeometry(false);
    const std::set<int> shown = bodies_shown_by(visuals);
    if (shown.count(-1) == 0) draw_links(matter_.updGround(), model, -1, stand_color);
    for (int i = 0; i < static_cast<int>(model.bodies.size()); ++i) {
      SimTK::MobilizedBody mobilized = add(model.bodies[static_cast<std::size_t>(i)]);
      if (shown.count(i) != 0 || hidden(model, i)) continue;
      draw_joint(mobilized, model.bodies[static_cast<std::size_t>(i)]);
      draw_links(mobilized, model, i, link_color);
    }
    for (const Visual& visual : visuals.drawn) draw(visual);
    for (const std::string& tool : tools) draw_axes(model.frames.at(tool));
    state_ = system_.realizeTopology();
    system_.realizeModel(state_);
    for (std::size_t i = 0; i < model.bodies.size(); ++i) {
      const robot::Body& body = model.bodies[i];
      const SimTK::MobilizedBodyIndex index(static_cast<int>(i) + 1);
      const SimTK::MobilizedBody& mobilized = matter_.getMobilizedBody(index);
      joints_.push_back(
          {mobilized.getFirstQIndex(state_), body.coordinate, body.multiplier, body.offset});
    }
    pose(0, initial);
    measure(model);
    const SimTK::Array_<SimTK::String> folders(1, viewers.string() + "/");
    visualizer_ = std::make_unique<SimTK::Visualizer>(system_, folders);
    visualizer_->setShutdownWhenDestructed(true);
    visualizer_->setMode(SimTK::Visualizer::PassThrough);
    visualizer_->setWindowTitle(title);
    visualizer_->setShowSimTime(true);
    draw_floor();
    if (shown.count(-1) == 0) draw_stand(model);
    set_view();
  }

  void show(double t_s, const robot::Vector& q) {
    pose(t_s, q);
    visualizer_->drawFrameNow(state_);
  }

 private:
  struct Joint {
    int q;  ///< Simbody's index
    int coordinate;
    double multiplier, offset;
  };

  void pose(double t_s, const robot::Vector& q) {
    state_.setTime(t_s);
    for (const Joint& joint : joints_) {
      state_.updQ()[joint.q] = joint.multiplier * q[joint.coordinate] + joint.offset;
    }
    system_.realize(state_, SimTK::Stage::Position);
  }

  SimTK::MobilizedBody add(const robot::Body& body) {
    // Simbody pins turn about z and sliders move along x of the mobilizer's frames.
    const bool revolute = body.type == robot::JointType::revolute;
    const SimTK::Rotation R_BM =
        turning(revolute ? Eigen::Vector3d::UnitZ() : Eigen::Vector3d::UnitX(), body.axis_B);
    const SimTK::Transform X_PF(rotation(body.R_PB) * R_BM, vec3(body.p_PB));
    const SimTK::Transform X_BM(R_BM, SimTK::Vec3(0));
    SimTK::MobilizedBody& parent =
        matter_.updMobilizedBody(SimTK::MobilizedBodyIndex(body.parent + 1));
    const SimTK::Body::Rigid rigid(SimTK::MassProperties(1, SimTK::Vec3(0), SimTK::Inertia(1)));
    if (revolute) return SimTK::MobilizedBody::Pin(parent, X_PF, rigid, X_BM);
    return SimTK::MobilizedBody::Slider(parent, X_PF, rigid, X_BM);
  }

  void decorate(int body, const SimTK::Transform& X_BD, const SimTK::DecorativeGeometry& geometry) {
    matter_.updMobilizedBody(SimTK::MobilizedBodyIndex(body + 1)).addBodyDecoration(X_BD, geometry);
  }

  void draw(const Visual& visual) {
    const SimTK::Transform X_BV(rotation(visual.place.R_BF), vec3(visual.place.p_BF));
    for (SimTK::DecorativeGeometry& geometry : std::visit(Drawn{}, visual.geometry)) {
      geometry.setResolution(smoothness).setColor(link_color);
      if (const auto& rgba = visual.rgba) {
        geometry.setColor({(*rgba)[0], (*rgba)[1], (*rgba)[2]}).setOpacity((*rgba)[3]);
      }
      decorate(visual.place.body, X_BV, geometry);
    }
  }

  /// Bars from the frame's origin along its axes.
  void draw_axes(const robot::Frame& frame) {
    const double half_length = 1.5 * radius_;
    for (int i = 0; i < 3; ++i) {
      const Eigen::Vector3d axis_B = frame.R_BF.col(i);
      SimTK::Vec3 color(0.15);
      color[i] = 1;
      decorate(frame.body,
               SimTK::Transform(turning(Eigen::Vector3d::UnitY(), axis_B),
                                vec3(frame.p_BF + half_length * axis_B)),
               SimTK::DecorativeCylinder(0.15 * radius_, half_length).setColor(color));
    }
  }

  void draw_joint(SimTK::MobilizedBody& mobilized, const robot::Body& body) const {
    const SimTK::Rotation along_axis = turning(Eigen::Vector3d::UnitY(), body.axis_B);
    if (body.type == robot::JointType::revolute) {
      mobilized.addBodyDecoration(SimTK::Transform(along_axis),
                                  SimTK::DecorativeCylinder(1.35 * radius_, 1.5 * radius_)
                                      .setColor(joint_color)
                                      .setResolution(smoothness));
    } else {
      mobilized.addBodyDecoration(
          SimTK::Transform(along_axis),
          SimTK::DecorativeBrick(SimTK::Vec3(1.3 * radius_, 2 * radius_, 1.3 * radius_))
              .setColor(joint_color));
    }
  }

  void draw_links(SimTK::MobilizedBody& mobilized, const robot::Model& model, int number,
                  const SimTK::Vec3& color) const {
    for (const Eigen::Vector3d& end : ends_of(model, number)) {
      const SimTK::Transform middle(turning(Eigen::Vector3d::UnitY(), end), vec3(end / 2));
      mobilized.addBodyDecoration(middle, SimTK::DecorativeCylinder(radius_, end.norm() / 2)
                                              .setColor(color)
                                              .setResolution(smoothness));
      mobilized.addBodyDecoration(
          SimTK::Transform(vec3(end)),
          SimTK::DecorativeSphere(radius_).setColor(color).setResolution(smoothness));
    }
  }

  /// The box that holds the robot as it is, and the height of the floor below it.
  void measure(const robot::Model& model) {
    const auto include = [&](const SimTK::Vec3& p) {
      for (int i = 0; i < 3; ++i) {
        lowest_[i] = std::min(lowest_[i], p[i]);
        highest_[i] = std::max(highest_[i], p[i]);
      }
    };
    for (int i = -1; i < static_cast<int>(model.bodies.size()); ++i) {
      const SimTK::MobilizedBody& body = matter_.getMobilizedBody(SimTK::MobilizedBodyIndex(i + 1));
      include(body.getBodyOriginLocation(state_));
      for (const Eigen::Vector3d& end : ends_of(model, i)) {
        include(body.findStationLocationInGround(state_, vec3(end)));
      }
    }
    floor_ = lowest_[2] > -0.01 * reach_ ? 0 : lowest_[2] - 0.15 * reach_;
  }

  void draw_floor() {
    const auto tiles = [&](double from, double to, double at, bool along_x) {
      const SimTK::Vec3 a = along_x ? SimTK::Vec3(from, at, floor_) : SimTK::Vec3(at, from, floor_);
      const SimTK::Vec3 b = along_x ? SimTK::Vec3(to, at, floor_) : SimTK::Vec3(at, to, floor_);
      visualizer_->addDecoration(SimTK::MobilizedBodyIndex(0), SimTK::Transform(),
                                 SimTK::DecorativeLine(a, b).setColor(floor_color));
    };
    constexpr int half = 8;  // tiles on either side
    const double tile = 0.25 * reach_;
    for (int i = -half; i <= half; ++i) {
      tiles(-half * tile, half * tile, i * tile, true);
      tiles(-half * tile, half * tile, i * tile, false);
    }
  }

  /// From the floor to the root, or what hangs from above.
  void draw_stand(const robot::Model& model) {
    const robot::Body& first = model.bodies.front();
    const Eigen::Vector3d axis = first.R_PB * first.axis_B;
    if (floor_ == 0) {
      stand(SimTK::Vec3(0, 0, 0.01 * reach_), SimTK::Vec3(0.12, 0.12, 0.01) * reach_);
    } else if (std::abs(axis.z()) < 0.5) {  // beside the arm's plane, away from the viewer
      const Eigen::Vector3d away = axis.y() < 0 ? Eigen::Vector3d(-axis) : axis;
      const SimTK::Vec3 root = vec3(first.p_PB + 5 * radius_ * away);
      const double top = root[2] + 2 * radius_;
      stand(SimTK::Vec3(root[0], root[1], (top + floor_) / 2),
            SimTK::Vec3(radius_, radius_, (top - floor_) / 2));
      stand(SimTK::Vec3(root[0], root[1], floor_ + 0.01 * reach_),
            SimTK::Vec3(0.15, 0.15, 0.01) * reach_);
      visualizer_->addDecoration(
          SimTK::MobilizedBodyIndex(0),
          SimTK::Transform(turning(Eigen::Vector3d::UnitY(), away),
                           vec3(first.p_PB + 3 * radius_ * away)),
          SimTK::DecorativeCylinder(0.7 * radius_, 2 * radius_).setColor(stand_color));
    } else {  // from above
      stand(vec3(first.p_PB) + SimTK::Vec3(0, 0, 2 * radius_),
            SimTK::Vec3(0.15 * reach_, 0.15 * reach_, 0.5 * radius_));
    }
  }

  void stand(const SimTK::Vec3& middle, const SimTK::Vec3& half_lengths) {
    visualizer_->addDecoration(SimTK::MobilizedBodyIndex(0), SimTK::Transform(middle),
                               SimTK::DecorativeBrick(half_lengths).setColor(stand_color));
  }

  /// Everything in view, from the side and a little above.
  void set_view() {
    visualizer_->setBackgroundType(SimTK::Visualizer::SolidColor);
    visualizer_->setBackgroundColor(background_color);
    visualizer_->setSystemUpDirection(SimTK::ZAxis);
    visualizer_->setShowShadows(false);
    const SimTK::Vec3 centre = (lowest_ + highest_) / 2;
    const SimTK::UnitVec3 towards_viewer(0.45, -1, 0.3);
    const SimTK::Rotation R_GC(towards_viewer, SimTK::ZAxis, SimTK::Vec3(0, 0, 1), SimTK::YAxis);
    const double distance = 0.9 * reach_ + 1.1 * (highest_ - lowest_).norm();
    visualizer_->setCameraTransform(SimTK::Transform(R_GC, centre + distance * towards_viewer));
  }

  SimTK::MultibodySystem system_;
  SimTK::SimbodyMatterSubsystem matter_;
  double reach_;   ///< of the robot [m]
  double radius_;  ///< of the links [m]
  SimTK::State state_;
  std::vector<Joint> joints_;
  SimTK::Vec3 lowest_{0}, highest_{0};  ///< corners of the box around the robot [m]
  double floor_ = 0;                    ///< height [m]
  std::unique_ptr<SimTK::Visualizer> visualizer_;
};

ArmWindow::ArmWindow(const robot::Model& model, const Visuals& visuals,
                     const std::vector<std::string>& tools, const robot::Vector& initial,
                     const std::string& title, const std::filesystem::path& viewers) {
  // Where Simbody finds none, it goes on in two processes.
  if (access(SIMBODY_VIEWER, X_OK) != 0) {
    throw std::runtime_error("there is no " SIMBODY_VIEWER
                             "; as root, type: apt-get install --reinstall libsimbody3.7");
  }
  try {
    scene_ = std::make_unique<Scene>(model, visuals, tools, initial, title, viewers);
    scene_->show(0, initial);
  } catch (const std::exception& error) {
    // Simbody's own words, in several lines, or none at all.
    const std::string_view why = error.what();
    throw std::runtime_error(why == "std::exception" ? viewer_ended
                                                     : "Simbody's window cannot be opened: " +
                                                           diagnostics::one_line(why));
  }
}

ArmWindow::~ArmWindow() = default;

void ArmWindow::show(double t_s, const robot::Vector& q) {
  try {
    scene_->show(t_s, q);
  } catch (const std::exception& error) {
    throw std::runtime_error("Simbody's window does not draw: " +
                             diagnostics::one_line(error.what()));
  }
}

}  // namespace tachless::viewer
