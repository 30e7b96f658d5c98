#include "robot/urdf_tree.h"

#include <fmt/format.h>
#include <tinyxml.h>

#include <algorithm>
#include <set>
#include <stdexcept>

namespace tachless::robot {
namespace {

/// Refuses joints that close a chain.
class TreeCheck {
 public:
  explicit TreeCheck(const std::string& source) : source_(source) {}

  void add(const std::string& joint, const std::string& parent, const std::string& child) {
    const auto [above, fresh] = above_.emplace(child, Above{joint, parent});
    if (fresh) return;
    refuse_urdf(source_, fmt::format("link '{}' is the child of two joints, '{}' and '{}': closed "
                                     "chains are not supported; cut one",
                                     child, above->second.joint, joint));
  }

  /// Walks from every link towards the root, each link once.
  void finish() const {
    std::set<std::string> leads_to_root;
    for (const auto& [start, unused] : above_) {
      std::set<std::string> walked;
      for (auto at = above_.find(start); at != above_.end() && leads_to_root.count(at->first) == 0;
           at = above_.find(at->second.parent)) {
        if (walked.insert(at->first).second) continue;
        refuse_urdf(source_,
                    fmt::format("joint '{}' hangs link '{}' on its own descendant; hang it "
                                "on a link nearer the root",
                                at->second.joint, at->first));
      }
      leads_to_root.merge(walked);
    }
  }

 private:
  struct Above {
    std::string joint, parent;
  };
  std::string source_;
  std::map<std::string, Above> above_;  ///< by child link
};

}  // namespace

void refuse_urdf(const std::string& source, const std::string& problem) {
  std::string line = source + ": " + problem;
  std::replace_if(
      line.begin(), line.end(), [](char c) { return c == '\n' || c == '\r' || c == '\t'; }, ' ');
  throw std::invalid_argument(line);
}

std::map<std::string, int> joint_order(const std::string& text, const std::string& source) {
  TiXmlDocument document;
  document.Parse(text.c_str(), nullptr, TIXML_ENCODING_UTF8);
  if (document.Error()) {
    std::string why = document.ErrorDesc();
    if (!why.empty() && why.back() == '.') why.pop_back();
    refuse_urdf(source, fmt::format("line {}: malformed XML: {}; correct the file's XML",
                                    document.ErrorRow(), why));
  }
  const TiXmlElement* robot = document.FirstChildElement("robot");
  if (robot == nullptr) refuse_urdf(source, "no <robot> element; give a URDF file");
  std::map<std::string, int> order;
  TreeCheck tree(source);
  std::set<std::string> links;
  for (const TiXmlElement* e = robot->FirstChildElement(); e != nullptr;
       e = e->NextSiblingElement()) {
    const std::string& kind = e->ValueStr();
    const bool is_joint = kind == "joint";
    if (!is_joint && kind != "link") continue;
    const char* name = e->Attribute("name");
    if (name == nullptr || *name == '\0') {
      refuse_urdf(source,
                  fmt::format("line {}: a {} has no name; give it name=\"...\"", e->Row(), kind));
    }
    const bool fresh = is_joint ? order.emplace(name, static_cast<int>(order.size())).second
                                : links.insert(name).second;
    if (!fresh) {
      refuse_urdf(source, fmt::format("line {}: {} '{}' is defined twice; rename one", e->Row(),
                                      kind, name));
    }
    if (!is_joint) continue;
    const TiXmlElement* parent = e->FirstChildElement("parent");
    const TiXmlElement* child = e->FirstChildElement("child");
    const char* parent_link = parent != nullptr ? parent->Attribute("link") : nullptr;
    const char* child_link = child != nullptr ? child->Attribute("link") : nullptr;
    // urdfdom says which joint lacks one.
    if (parent_link != nullptr && child_link != nullptr) tree.add(name, parent_link, child_link);
  }
  tree.finish();
  return order;
}

}  // namespace tachless::robot
