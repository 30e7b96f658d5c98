#include "robot/mjcf_elements.h"

#include <algorithm>
#include <array>
#include <map>
#include <stdexcept>

namespace tachless::robot {
namespace {

using Names = std::vector<std::string_view>;

constexpr std::array<std::string_view, 12> actuators{
    "general", "motor",    "position", "velocity", "intvelocity", "damper",
    "muscle",  "cylinder", "adhesion", "dcmotor",  "plugin",      "pid"};

const Names orientation{"quat", "axisangle", "xyaxes", "zaxis", "euler"};
const Names transmission{"tendon", "site", "slidersite", "cranksite", "refsite", "body"};

Names with(Names names, const Names& more) {
  names.insert(names.end(), more.begin(), more.end());
  return names;
}

const Names joint{"name",
                  "class",
                  "type",
                  "group",
                  "pos",
                  "axis",
                  "springdamper",
                  "limited",
                  "actuatorfrclimited",
                  "solreflimit",
                  "solimplimit",
                  "solreffriction",
                  "solimpfriction",
                  "stiffness",
                  "range",
                  "actuatorfrcrange",
                  "actuatorgravcomp",
                  "margin",
                  "ref",
                  "springref",
                  "armature",
                  "damping",
                  "frictionloss",
                  "user"};
const Names geom =
    with({"name",         "class",  "type",     "contype",  "conaffinity", "condim",    "group",
          "priority",     "size",   "material", "rgba",     "friction",    "mass",      "density",
          "shellinertia", "solmix", "solref",   "solimp",   "margin",      "gap",       "fromto",
          "pos",          "hfield", "mesh",     "fitscale", "fluidshape",  "fluidcoef", "user"},
         orientation);
const Names mesh{"name",   "class",        "content_type",   "file",    "vertex",
                 "normal", "texcoord",     "face",           "refpos",  "refquat",
                 "scale",  "smoothnormal", "maxhullvert",    "inertia", "builtin",
                 "params", "material",     "octree_maxdepth"};
const Names material{"name",     "class",     "texture",     "texrepeat", "texuniform", "emission",
                     "specular", "shininess", "reflectance", "metallic",  "roughness",  "rgba"};
const Names actuator{
    "name",        "class",        "group",       "nsample",   "interp",        "delay",
    "ctrllimited", "forcelimited", "actlimited",  "ctrlrange", "forcerange",    "actrange",
    "lengthrange", "gear",         "cranklength", "joint",     "jointinparent", "tendon",
    "slidersite",  "cranksite",    "site",        "refsite",   "user",          "actdim",
    "dyntype",     "gaintype",     "biastype",    "dynprm",    "gainprm",       "biasprm",
    "actearly",    "kp",           "kv",          "dampratio", "timeconst",     "inheritrange",
    "timeconst",   "area",         "diameter",    "bias",      "range",         "force",
    "scale",       "lmin",         "lmax",        "vmax",      "fpmax",         "fvmax",
    "tausmooth",   "body",         "gain",        "plugin",    "instance",      "armature",
    "damping",     "motorconst",   "resistance",  "nominal",   "saturation",    "inductance"};
const Names body_children{"body", "frame", "joint", "freejoint", "inertial", "geom"};
const Names decoration{"site", "camera", "light"};
const Names generators{"composite", "flexcomp", "replicate", "attach", "plugin"};

const std::map<std::string_view, MjcfRule>& rules() {
  static const std::map<std::string_view, MjcfRule> all{
      {"mujoco",
       {{"model"},
        {"compiler", "option", "default", "asset", "worldbody", "equality", "tendon", "actuator",
         "keyframe"},
        {"size", "visual", "statistic", "custom", "contact", "sensor"},
        {"extension", "deformable"}}},
      {"compiler",
       {{"autolimits",       "boundmass",         "boundinertia", "settotalmass",
         "balanceinertia",   "strippath",         "coordinate",   "angle",
         "fitaabb",          "eulerseq",          "meshdir",      "texturedir",
         "assetdir",         "discardvisual",     "usethread",    "fusestatic",
         "inertiafromgeom",  "inertiagrouprange", "saveinertial", "convexhull",
         "exactmeshinertia", "alignfree",         "conflict"},
        {},
        {"lengthrange"},
        {}}},
      {"default",
       {{"class"},
        with({"default", "joint", "geom", "mesh", "material", "equality", "tendon"},
             {actuators.begin(), actuators.end()}),
        {"site", "camera", "light", "pair"},
        {}}},
      {"worldbody", {{}, {"body", "frame", "geom"}, decoration, generators}},
      {"body",
       {with({"name", "childclass", "pos", "mocap", "gravcomp", "user", "sleep"}, orientation),
        body_children, decoration, generators}},
      {"frame",
       {with({"name", "childclass", "pos"}, orientation), body_children, decoration, generators}},
      {"joint", {joint, {}, {}, {}}},
      {"freejoint", {{"name", "group", "align"}, {}, {}, {}}},
      {"inertial", {with({"pos", "mass", "diaginertia", "fullinertia"}, orientation), {}, {}, {}}},
      {"geom", {geom, {}, {}, {"plugin"}}},
      {"mesh", {mesh, {}, {"plugin"}, {}}},
      {"material", {material, {}, {"layer"}, {}}},
      {"equality/joint",
       {{"name", "class", "active", "solref", "solimp", "joint1", "joint2", "polycoef"},
        {},
        {},
        {}}},
      {"tendon/fixed",
       {{"name",
         "class",
         "group",
         "limited",
         "actuatorfrclimited",
         "range",
         "actuatorfrcrange",
         "solreflimit",
         "solimplimit",
         "solreffriction",
         "solimpfriction",
         "margin",
         "frictionloss",
         "springlength",
         "stiffness",
         "damping",
         "armature",
         "user",
         "width",
         "material",
         "rgba"},
        {},
        {"joint", "site", "geom", "pulley"},
        {}}},
      {"actuator", {actuator, {}, {"plugin", "config"}, {}}},
      {"key", {{"name", "time", "qpos", "qvel", "act", "ctrl", "mpos", "mquat"}, {}, {}, {}}}};
  return all;
}

}  // namespace

const MjcfRule& mjcf_rule(std::string_view element) { return rules().at(element); }

bool is_mjcf_actuator(std::string_view element) {
  return std::ranges::find(actuators, element) != actuators.end();
}

}  // namespace tachless::robot
