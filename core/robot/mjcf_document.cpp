#include "robot/mjcf_document.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <numbers>
#include <sstream>
#include <stdexcept>

#include "base/elementary.h"
#include "base/text.h"
#include "robot/mjcf_elements.h"
#include "robot/urdf_xml.h"

namespace tachless::robot {
namespace {

constexpr std::array<const char*, 5> orientations{"quat", "axisangle", "xyaxes", "zaxis", "euler"};

/// Returns the rule of an element in a body, an asset, an actuator or a <default>.
std::string rule_name(const std::string& element) {
  if (is_mjcf_actuator(element)) return "actuator";
  if (element == "equality") return "equality/joint";
  if (element == "tendon") return "tendon/fixed";
  return element;
}

/// Adds own attributes to those of a class. An own orientation replaces one of another form.
void override_with(MjcfAttributes::Values& values, const XmlElement& element) {
  const auto own = [&](const char* name) { return element.Attribute(name) != nullptr; };
  if (std::ranges::any_of(orientations, own)) {
    for (const char* name : orientations) values.erase(name);
  }
  for (const auto* a = element.FirstAttribute(); a != nullptr; a = a->Next()) {
    values[a->Name()] = a->Value();
  }
}

}  // namespace

Eigen::Quaterniond rotation_about(const Eigen::Vector3d& axis, double angle) {
  double s = 0, c = 0;
  base::sin_cos(angle / 2, s, c);
  const Eigen::Vector3d v = s * axis.normalized();
  return {c, v.x(), v.y(), v.z()};
}

Eigen::Quaterniond from_z_to(const Eigen::Vector3d& direction) {
  const Eigen::Vector3d z = direction.normalized();
  if (z.z() < -1 + 1e-14) return {0, 1, 0, 0};  // half a turn about x, as MuJoCo takes it
  return Eigen::Quaterniond(1 + z.z(), -z.y(), z.x(), 0).normalized();
}

std::string MjcfAttributes::text(const std::string& name, const std::string& otherwise) const {
  const auto found = values_.find(name);
  return found == values_.end() ? otherwise : found->second;
}

std::vector<double> MjcfAttributes::numbers(const std::string& name, std::size_t least,
                                            std::size_t most) const {
  const auto found = values_.find(name);
  if (found == values_.end()) return {};
  std::istringstream words(found->second);
  std::vector<double> read;
  bool valid = true;
  for (std::string word; words >> word;) {
    if (word.starts_with('+')) word.erase(0, 1);
    const std::optional<double> value = base::number_in(word);
    valid = valid && value && std::isfinite(*value);
    read.push_back(value.value_or(0));
  }
  if (valid && read.size() >= least && read.size() <= most) return read;
  const std::string count =
      least == most ? std::to_string(least) : fmt::format("{} to {}", least, most);
  refuse(fmt::format("{}=\"{:.60}\"; allowed: {} finite number{}", name, found->second, count,
                     most == 1 ? "" : "s"));
}

double MjcfAttributes::number(const std::string& name, double otherwise) const {
  const std::vector<double> read = numbers(name, 1, 1);
  return read.empty() ? otherwise : read.front();
}

double MjcfAttributes::coefficient(const std::string& name) const {
  constexpr std::size_t most = 3;  // MuJoCo has coefficients of higher powers of the velocity
  const std::vector<double> read = numbers(name, 1, most);
  if (read.empty()) return 0;
  if (read.front() < 0) {
    refuse(fmt::format("{}=\"{}\"; allowed: a finite number from 0 on", name, text(name)));
  }
  if (std::any_of(read.begin() + 1, read.end(), [](double x) { return x != 0; })) {
    refuse(
        fmt::format("{}=\"{}\": coefficients of higher powers; allowed: 0 behind the first number",
                    name, text(name)));
  }
  return read.front();
}

Eigen::Vector3d MjcfAttributes::vector(const std::string& name,
                                       const Eigen::Vector3d& otherwise) const {
  const std::vector<double> read = numbers(name, 3, 3);
  return read.empty() ? otherwise : Eigen::Vector3d(read[0], read[1], read[2]);
}

bool MjcfAttributes::flag(const std::string& name, bool otherwise) const {
  const std::string given = text(name, "auto");
  if (given == "auto") return otherwise;
  if (given == "true" || given == "false") return given == "true";
  refuse(fmt::format("{}=\"{:.60}\"; allowed: true, false, auto", name, given));
}

std::optional<std::pair<double, double>> MjcfAttributes::range(const std::string& name,
                                                               const std::string& limited) const {
  const std::vector<double> ends = numbers(name, 2, 2);
  const bool given = !ends.empty() && (ends[0] != 0 || ends[1] != 0);
  const bool by_itself = document_->compiler().flag("autolimits", true);
  if (given && !by_itself && text(limited, "auto") == "auto") {
    refuse(fmt::format("{} without {}, and autolimits is false; give {}=\"true\" or \"false\"",
                       name, limited, limited));
  }
  if (!flag(limited, given)) return std::nullopt;
  if (!given || ends[0] >= ends[1]) {
    refuse(fmt::format("{}=\"true\" with {}=\"{}\"; give a range, the lower end first", limited,
                       name, text(name)));
  }
  return std::pair{ends[0], ends[1]};
}

void MjcfAttributes::refuse(const std::string& problem) const {
  const std::string name = text("name");
  document_->refuse(*element_,
                    fmt::format("<{}>{}: {}", name_of(*element_),
                                name.empty() ? "" : fmt::format(" '{:.60}'", name), problem));
}

MjcfDocument::MjcfDocument(const std::string& text, std::string source,
                           const IncludedText& included)
    : source_(std::move(source)) {
  parse(text, "");
  root_ = files_.front().FirstChildElement("mujoco");
  if (root_ == nullptr) {
    refuse_urdf(source_, "no <mujoco> element: it is " + xml_kind(text, source_));
  }
  read_includes(*root_, included);
  check_names(*root_, "mujoco");
  MjcfAttributes::Values options;
  const XmlElement* last = root_;
  for (const XmlElement* each : sections("compiler")) {
    check_names(*each, "compiler");
    override_with(options, *each);
    last = each;
  }
  compiler_.emplace(*this, *last, options);
  classes_["main"] = {};
  for (const XmlElement* each : sections("default")) read_top_defaults(*each);
}

void MjcfDocument::parse(const std::string& text, const std::string& file) {
  const std::string prefix = file.empty() ? "" : file + ": ";
  XmlDocument& document = files_.emplace_back();
  if (const std::string problem = parse_xml(text, document); !problem.empty()) {
    refuse_urdf(source_, prefix + problem);
  }
  names_[&document] = file;
}

void MjcfDocument::read_includes(const XmlElement& parent, const IncludedText& included) {
  for (const auto* e = parent.FirstChildElement(); e; e = e->NextSiblingElement()) {
    if (name_of(*e) != "include") {
      read_includes(*e, included);
      continue;
    }
    const char* const file = e->Attribute("file");
    if (file == nullptr) refuse(*e, "<include> has no file; give file=\"...\"");
    constexpr std::size_t most_files = 64;
    if (files_.size() > most_files) {
      refuse(*e, fmt::format("more than {} included files; merge some", most_files));
    }
    for (const auto& [document, name] : names_) {
      if (name == file) {
        refuse(*e, fmt::format("{:.60} is included twice; remove one <include>", name));
      }
    }
    parse(included(file), file);
    const XmlElement* const root = files_.back().RootElement();
    if (root == nullptr) {
      refuse(*e, fmt::format("{:.60} has no element; give an MJCF, or remove the <include>", file));
    }
    included_[e] = root;
    read_includes(*root, included);
  }
}

std::vector<const XmlElement*> MjcfDocument::children(const XmlElement& parent) const {
  std::vector<const XmlElement*> all;
  for (const auto* e = parent.FirstChildElement(); e; e = e->NextSiblingElement()) {
    if (const auto found = included_.find(e); found != included_.end()) {
      const auto inner = children(*found->second);
      all.insert(all.end(), inner.begin(), inner.end());
    } else {
      all.push_back(e);
    }
  }
  return all;
}

std::vector<const XmlElement*> MjcfDocument::sections(std::string_view section) const {
  std::vector<const XmlElement*> found = children(*root_);
  std::erase_if(found, [&](const XmlElement* e) { return name_of(*e) != section; });
  return found;
}

std::vector<const XmlElement*> MjcfDocument::in_sections(std::string_view section) const {
  std::vector<const XmlElement*> all;
  for (const XmlElement* each : sections(section)) {
    const auto inner = children(*each);
    all.insert(all.end(), inner.begin(), inner.end());
  }
  return all;
}

void MjcfDocument::check_names(const XmlElement& element, std::string_view known_as) const {
  const std::string& name = name_of(element);
  const MjcfRule& rule = mjcf_rule(known_as);
  const auto has = [](const std::vector<std::string_view>& names, std::string_view each) {
    return std::ranges::find(names, each) != names.end();
  };
  const auto hint = [](std::string_view word, const std::vector<std::string_view>& known) {
    const auto near = base::nearest(word, known);
    return near ? "the nearest known name is " + *near : "known are " + base::joined(known);
  };
  for (const auto* a = element.FirstAttribute(); a != nullptr; a = a->Next()) {
    if (has(rule.attributes, a->Name())) continue;
    refuse(element, fmt::format("<{:.60}> has the attribute {:.60}, which is not read; {}", name,
                                a->Name(), hint(a->Name(), rule.attributes)));
  }
  for (const auto* node = element.FirstChild(); node != nullptr; node = node->NextSibling()) {
    const auto letter = [](unsigned char c) { return std::isalpha(c) != 0; };
    if (node->ToText() != nullptr && std::ranges::any_of(std::string_view(node->Value()), letter)) {
      refuse(element, fmt::format("text in <{:.60}>; remove it", name));
    }
  }
  for (const XmlElement* child : children(element)) {
    const std::string& each = name_of(*child);
    if (has(rule.children, each) || has(rule.others, each)) continue;
    if (has(rule.refused, each)) {
      refuse(*child, fmt::format("<{}> in <{}> is not read; give the model with it written out, as "
                                 "MuJoCo saves it (mj_saveLastXML), or remove it",
                                 each, name));
    }
    std::vector<std::string_view> known = rule.children;
    known.insert(known.end(), rule.others.begin(), rule.others.end());
    refuse(*child,
           fmt::format("<{:.60}> in <{:.60}> is not read; {}", each, name, hint(each, known)));
  }
}

void MjcfDocument::read_top_defaults(const XmlElement& section) {
  const char* const given = section.Attribute("class");
  const std::string name = given == nullptr ? top_class_ : given;
  if (name != top_class_ && (top_class_ != "main" || !classes_["main"].empty())) {
    refuse(section, fmt::format("class \"{:.60}\" beside \"{}\" at the top; put it into the other "
                                "<default>",
                                name, top_class_));
  }
  top_class_ = name;
  classes_.erase(name);
  const auto before = classes_["main"];
  read_class(section, name, before);
  classes_["main"] = classes_[name];
}

void MjcfDocument::read_class(const XmlElement& element, const std::string& name,
                              std::map<std::string, MjcfAttributes::Values> values) {
  check_names(element, "default");
  if (classes_.contains(name) && name != "main") {
    refuse(element, fmt::format("two classes \"{:.60}\"; rename one", name));
  }
  std::map<std::string, const XmlElement*> seen;
  for (const XmlElement* each : children(element)) {
    const std::string& kind = name_of(*each);
    const auto& others = mjcf_rule("default").others;
    if (kind == "default" || std::ranges::find(others, kind) != others.end()) continue;
    const std::string key = rule_name(kind);
    check_names(*each, key);
    if (!seen.emplace(kind, each).second) {
      refuse(*each, fmt::format("<default> has two <{}>; remove one", kind));
    }
    override_with(values[key], *each);
  }
  classes_[name] = values;
  for (const XmlElement* each : children(element)) {
    if (name_of(*each) != "default") continue;
    const char* const inner = each->Attribute("class");
    if (inner == nullptr)
      refuse(*each, "a <default> in another has no class; give it class=\"...\"");
    read_class(*each, inner, values);
  }
}

MjcfAttributes MjcfDocument::attributes(const XmlElement& element, const std::string& around,
                                        std::string_view rule) const {
  const std::string key = rule.empty() ? rule_name(name_of(element)) : std::string(rule);
  check_names(element, key);
  const char* const own = element.Attribute("class");
  const auto of_class = classes_.find(own == nullptr ? around : own);
  if (of_class == classes_.end()) {
    refuse(element, fmt::format("class \"{:.60}\" is not among the defaults; correct the name",
                                own == nullptr ? around : own));
  }
  const auto found = of_class->second.find(key);
  MjcfAttributes::Values values =
      found == of_class->second.end() ? MjcfAttributes::Values{} : found->second;
  override_with(values, element);
  return {*this, element, std::move(values)};
}

MjcfAttributes MjcfDocument::own_attributes(const XmlElement& element) const {
  MjcfAttributes::Values values;
  override_with(values, element);
  return {*this, element, std::move(values)};
}

double MjcfDocument::angle_unit() const {
  const std::string unit = compiler().text("angle", "degree");
  if (unit == "degree") return std::numbers::pi / 180;
  if (unit == "radian") return 1;
  compiler().refuse(fmt::format("angle=\"{:.60}\"; allowed: degree, radian", unit));
}

MjcfPose MjcfDocument::pose(const MjcfAttributes& frame) const {
  MjcfPose pose;
  pose.p = frame.vector("pos", Eigen::Vector3d::Zero());
  const auto given = [&](const char* name) { return frame.has(name); };
  if (std::ranges::count_if(orientations, given) > 1) {
    frame.refuse("two orientations; give one of quat, axisangle, xyaxes, zaxis, euler");
  }
  const auto direction = [&](const char* name, double x, double y, double z) {
    const Eigen::Vector3d v(x, y, z);
    if (v.norm() < 1e-10) {
      frame.refuse(fmt::format("{}: an axis of length 0; give its direction", name));
    }
    return v;
  };
  if (const auto q = frame.numbers("quat", 4, 4); !q.empty()) {
    pose.q = Eigen::Quaterniond(q[0], q[1], q[2], q[3]);
    if (pose.q.norm() < 1e-10) frame.refuse("quat: four zeros; give a rotation, or leave it out");
    if (pose.q.squaredNorm() != 1) pose.q.normalize();
  } else if (const auto a = frame.numbers("axisangle", 4, 4); !a.empty()) {
    pose.q = rotation_about(direction("axisangle", a[0], a[1], a[2]), a[3] * angle_unit());
  } else if (const auto z = frame.numbers("zaxis", 3, 3); !z.empty()) {
    pose.q = from_z_to(direction("zaxis", z[0], z[1], z[2]));
  } else if (const auto xy = frame.numbers("xyaxes", 6, 6); !xy.empty()) {
    Eigen::Matrix3d R;
    R.col(0) = direction("xyaxes", xy[0], xy[1], xy[2]).normalized();
    const Eigen::Vector3d y(xy[3], xy[4], xy[5]), across = y - R.col(0).dot(y) * R.col(0);
    R.col(1) = direction("xyaxes", across.x(), across.y(), across.z()).normalized();
    R.col(2) = R.col(0).cross(R.col(1));
    pose.q = Eigen::Quaterniond(R);
  } else if (const auto angles = frame.numbers("euler", 3, 3); !angles.empty()) {
    const std::string sequence = compiler().text("eulerseq", "xyz");
    for (std::size_t i = 0; i < 3; ++i) {
      const char letter = i < sequence.size() ? sequence[i] : '?';
      const int axis = std::tolower(static_cast<unsigned char>(letter)) - 'x';
      if (sequence.size() != 3 || axis < 0 || axis > 2) {
        compiler().refuse(fmt::format("eulerseq=\"{:.60}\"; allowed: three of xyzXYZ", sequence));
      }
      const Eigen::Quaterniond each =
          rotation_about(Eigen::Vector3d::Unit(axis), angles[i] * angle_unit());
      pose.q = letter >= 'x' ? pose.q * each : each * pose.q;
    }
  }
  return pose;
}

std::string MjcfDocument::where(const XmlElement& at) const {
  const std::string& file = names_.at(at.GetDocument());
  return fmt::format("{}: {}line {}", source_, file.empty() ? "" : file + ": ",
                     std::max(at.GetLineNum(), 1));
}

void MjcfDocument::refuse(const XmlElement& at, const std::string& problem) const {
  throw std::invalid_argument(base::one_line(where(at) + ": " + problem));
}

}  // namespace tachless::robot
