#pragma once

#include <tinyxml2.h>

#include <Eigen/Core>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

/// XML by TinyXML-2: reading with refusals, elements with attributes to write, and their text.
namespace tachless::robot {

using XmlDocument = tinyxml2::XMLDocument;
using XmlElement = tinyxml2::XMLElement;

/// Parses a text in UTF-8. A document may have a document type and instructions beside its root.
/// @return the problem with its line, for example "line 3: malformed XML: …"; empty if there is
///   none. Problems are malformed XML, a text without an element, markup
///   that is no element, and too much text, depth, or attributes.
std::string parse_xml(const std::string& text, XmlDocument& document);

/// Returns the name of an element.
inline std::string name_of(const XmlElement& element) { return element.Name(); }

/// Returns the finite number that `word` is, with a sign or without; nothing for another text.
std::optional<double> finite_number(std::string_view word);

/// Returns the finite numbers of a text, which white space separates; nothing if it has another
/// word.
std::optional<std::vector<double>> finite_numbers(const std::string& text);

/// Gives an element the attribute `name`.
inline void set(XmlElement& element, const char* name, const std::string& value) {
  element.SetAttribute(name, value.c_str());
}

/// Adds a child at the end.
/// @return the child
inline XmlElement& add(tinyxml2::XMLNode& parent, const char* name) {
  return *parent.InsertEndChild(parent.GetDocument()->NewElement(name))->ToElement();
}

/// Adds a child with one attribute at the end.
/// @return the child
inline XmlElement& add(tinyxml2::XMLNode& parent, const char* name, const char* attribute,
                       const std::string& value) {
  XmlElement& child = add(parent, name);
  set(child, attribute, value);
  return child;
}

/// Adds a URDF's <inertia> with the entries of `inertia` [kg m^2].
void add_inertia(XmlElement& inertial, const Eigen::Matrix3d& inertia);

/// Returns the text of a document, in lines or as one line.
std::string xml_text(const XmlDocument& document, bool in_lines);

}  // namespace tachless::robot
