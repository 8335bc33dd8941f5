// SPDX-License-Identifier: Apache-2.0
// Source: G. Turk, "The PLY Polygon File Format", 1994.
#include <algorithm>
#include <bit>
#include <vector>

#include "plain_formats.hpp"
#include "polygon.hpp"
#include "text.hpp"

namespace nearmesh::meshio {
namespace {

enum class Encoding : std::uint8_t { kAscii, kLittleEndian, kBigEndian };

struct ScalarType {
  std::size_t size = 0;
  bool is_float = false;
  bool is_signed = false;
};

constexpr std::size_t kNoAxis = 3;

struct Property {
  std::string_view name;
  bool is_list = false;
  ScalarType count_type;  ///< of a list
  ScalarType type;
  std::size_t axis = kNoAxis;    ///< of a vertex's coordinate
  bool is_vertex_index = false;  ///< the list that makes a face
};

struct Element {
  std::string_view name;
  std::uint64_t count = 0;
  std::vector<Property> properties;
  unsigned axes = 0;  ///< bits of the coordinates found
};

struct Header {
  Encoding encoding = Encoding::kAscii;
  std::vector<Element> elements;
  std::uint64_t vertex_count = 0;
};

Status corrupt_ply(std::string message) {
  return {StatusCode::kCorrupt, "PLY " + std::move(message)};
}

std::optional<ScalarType> parse_type(std::string_view name) {
  if (name == "char" || name == "int8") return ScalarType{1, false, true};
  if (name == "uchar" || name == "uint8") return ScalarType{1, false, false};
  if (name == "short" || name == "int16") return ScalarType{2, false, true};
  if (name == "ushort" || name == "uint16") return ScalarType{2, false, false};
  if (name == "int" || name == "int32") return ScalarType{4, false, true};
  if (name == "uint" || name == "uint32") return ScalarType{4, false, false};
  if (name == "float" || name == "float32") return ScalarType{4, true, true};
  if (name == "double" || name == "float64") return ScalarType{8, true, true};
  return std::nullopt;
}

Status parse_format(std::string_view rest, Header& header) {
  const std::string_view encoding = take_word(rest), version = take_word(rest);
  if (encoding == "ascii")
    header.encoding = Encoding::kAscii;
  else if (encoding == "binary_little_endian")
    header.encoding = Encoding::kLittleEndian;
  else if (encoding == "binary_big_endian")
    header.encoding = Encoding::kBigEndian;
  else
    return corrupt_ply("header: expected format ascii or binary, found " + quote(encoding));
  if (version != "1.0")
    return corrupt_ply("header: expected format version 1.0, found " + quote(version));
  return Status::ok();
}

Status parse_element(std::string_view rest, Header& header) {
  Element element;
  element.name = take_word(rest);
  const std::string_view count_word = take_word(rest);
  const auto count = parse_integer(count_word);
  if (!count || *count < 0)
    return corrupt_ply("header: expected a count of element " + quote(element.name) + ", found " +
                       quote(count_word));
  for (const Element& other : header.elements)
    if (other.name == element.name)
      return corrupt_ply("header: element " + quote(element.name) + " appears twice");
  element.count = static_cast<std::uint64_t>(*count);
  if (element.name == "vertex") header.vertex_count = element.count;
  header.elements.push_back(std::move(element));
  return Status::ok();
}

Status parse_property(std::string_view rest, Header& header) {
  if (header.elements.empty()) return corrupt_ply("header: a property stands before any element");
  Property property;
  std::string_view type_name = take_word(rest);
  if (type_name == "list") {
    property.is_list = true;
    type_name = take_word(rest);
    const auto count_type = parse_type(type_name);
    if (!count_type || count_type->is_float)
      return corrupt_ply("header: expected an integer type of a list's length, found " +
                         quote(type_name));
    property.count_type = *count_type;
    type_name = take_word(rest);
  }
  const auto type = parse_type(type_name);
  if (!type) return corrupt_ply("header: expected a property's type, found " + quote(type_name));
  property.type = *type;
  property.name = take_word(rest);
  if (property.name.empty()) return corrupt_ply("header: a property has no name");
  Element& element = header.elements.back();
  if (element.name == "vertex" && !property.is_list) {
    constexpr std::array<std::string_view, 3> kAxes{"x", "y", "z"};
    property.axis =
        static_cast<std::size_t>(std::ranges::find(kAxes, property.name) - kAxes.begin());
    if (property.axis != kNoAxis) element.axes |= 1U << property.axis;
  }
  property.is_vertex_index = element.name == "face" && property.is_list &&
                             (property.name == "vertex_indices" || property.name == "vertex_index");
  if (property.is_vertex_index && property.type.is_float)
    return corrupt_ply("header: expected an integer type of vertex indices, found " +
                       quote(type_name));
  element.properties.push_back(property);
  return Status::ok();
}

/// Leaves `bytes` at the first byte of the body.
Result<Header> parse_header(std::string_view& bytes) {
  Header header;
  bool has_format = false;
  const auto magic = take_line(bytes);
  if (!magic || *magic != "ply") return corrupt_ply("header: expected \"ply\" at the start");
  while (const auto line = take_line(bytes)) {
    std::string_view rest = *line;
    const std::string_view keyword = take_word(rest);
    if (keyword == "end_header") {
      if (!has_format) return corrupt_ply("header: expected a format line, found none");
      return header;
    }
    if (keyword.empty() || keyword == "comment" || keyword == "obj_info") continue;
    if (keyword == "format") {
      has_format = true;
      NEARMESH_RETURN_IF_ERROR(parse_format(rest, header));
    } else if (keyword == "element") {
      NEARMESH_RETURN_IF_ERROR(parse_element(rest, header));
    } else if (keyword == "property") {
      NEARMESH_RETURN_IF_ERROR(parse_property(rest, header));
    } else {
      return corrupt_ply("header: expected a PLY keyword, found " + quote(keyword));
    }
  }
  return corrupt_ply("header: expected end_header, found the end of the file");
}

Status check_header(const Header& header, std::size_t body_size) {
  for (const Element& element : header.elements) {
    // A byte an instance is the least any element needs; counts beyond are lies, whatever follows.
    if (element.count > body_size)
      return corrupt_ply("header: element " + quote(element.name) + " announces " +
                         std::to_string(element.count) + " instances, but " +
                         std::to_string(body_size) + " bytes follow");
    if (element.name == "vertex" && element.count > 0 && element.axes != 7)
      return corrupt_ply("header: expected properties x, y and z of a vertex");
    if (element.name == "tristrips" && element.count > 0)
      return {StatusCode::kUnsupported, "PLY with triangle strips"};
  }
  if (header.vertex_count > 0xffffffffU)
    return {StatusCode::kUnsupported, "PLY with 2^32 vertices or more"};
  return Status::ok();
}

std::string place_of(const Element& element, std::uint64_t number) {
  return std::string(element.name.substr(0, 40)) + " " + std::to_string(number);
}

// --- values, from bytes or from words ---

std::uint64_t read_bits(const char* at, std::size_t size, Encoding encoding) {
  std::uint64_t value = 0;
  for (std::size_t k = 0; k < size; ++k) {
    const std::size_t place = encoding == Encoding::kBigEndian ? size - 1 - k : k;
    value |= static_cast<std::uint64_t>(static_cast<std::uint8_t>(at[k])) << (8 * place);
  }
  return value;
}

class BodyReader {
 public:
  BodyReader(std::string_view body, Encoding encoding) : body_(body), encoding_(encoding) {}

  /// Names the instance that is read, for messages.
  void enter(const Element& element, std::uint64_t number) {
    element_ = &element;
    number_ = number;
  }

  Status read_integer(const ScalarType& type, std::int64_t& value) {
    if (encoding_ == Encoding::kAscii) {
      const std::string_view word = take_word(body_);
      if (word.empty()) return truncated();
      const auto parsed = parse_integer(word);
      if (!parsed) return corrupt_ply(place() + ": expected a whole number, found " + quote(word));
      value = *parsed;
      return Status::ok();
    }
    if (body_.size() < type.size) return truncated();
    const std::size_t unused = 64 - 8 * type.size;
    const std::uint64_t bits = read_bits(body_.data(), type.size, encoding_) << unused;
    value = type.is_signed ? static_cast<std::int64_t>(bits) >> unused
                           : static_cast<std::int64_t>(bits >> unused);
    body_.remove_prefix(type.size);
    return Status::ok();
  }

  Status read_coordinate(const ScalarType& type, double& value) {
    if (encoding_ == Encoding::kAscii) {
      const std::string_view word = take_word(body_);
      if (word.empty()) return truncated();
      return parse_coordinate(word, "PLY " + place(), value);
    }
    if (!type.is_float) {
      std::int64_t whole = 0;
      NEARMESH_RETURN_IF_ERROR(read_integer(type, whole));
      value = static_cast<double>(whole);
      return Status::ok();
    }
    if (body_.size() < type.size) return truncated();
    const std::uint64_t bits = read_bits(body_.data(), type.size, encoding_);
    value = type.size == 4 ? std::bit_cast<float>(static_cast<std::uint32_t>(bits))
                           : std::bit_cast<double>(bits);
    body_.remove_prefix(type.size);
    return Status::ok();
  }

  Status skip(const ScalarType& type) {
    if (encoding_ == Encoding::kAscii) return take_word(body_).empty() ? truncated() : Status::ok();
    if (body_.size() < type.size) return truncated();
    body_.remove_prefix(type.size);
    return Status::ok();
  }

  [[nodiscard]] std::string place() const { return place_of(*element_, number_); }

 private:
  [[nodiscard]] Status truncated() const {
    return corrupt_ply(place() + " of " + std::to_string(element_->count) +
                       ": the file ends before it is complete");
  }

  std::string_view body_;
  Encoding encoding_;
  const Element* element_ = nullptr;
  std::uint64_t number_ = 0;
};

// --- the body ---

/// Reads one instance of an element; the polygon of a face into `corners`.
Status read_instance(const Header& header, const Element& element, BodyReader& body,
                     std::array<double, 3>& position, std::vector<std::uint32_t>& corners) {
  for (const Property& property : element.properties) {
    if (property.axis != kNoAxis) {
      NEARMESH_RETURN_IF_ERROR(body.read_coordinate(property.type, position[property.axis]));
      continue;
    }
    std::int64_t length = 1;
    if (property.is_list) {
      NEARMESH_RETURN_IF_ERROR(body.read_integer(property.count_type, length));
      if (length < 0)
        return corrupt_ply(body.place() + ": expected a list length, found " +
                           std::to_string(length));
    }
    for (std::int64_t k = 0; k < length; ++k) {
      if (!property.is_vertex_index) {
        NEARMESH_RETURN_IF_ERROR(body.skip(property.type));
        continue;
      }
      std::int64_t index = 0;
      NEARMESH_RETURN_IF_ERROR(body.read_integer(property.type, index));
      if (index < 0 || static_cast<std::uint64_t>(index) >= header.vertex_count)
        return corrupt_ply(body.place() + ": expected vertex indices from 0 and below " +
                           std::to_string(header.vertex_count) + ", found " +
                           std::to_string(index));
      corners.push_back(static_cast<std::uint32_t>(index));
    }
  }
  return Status::ok();
}

}  // namespace

Result<IndexedMesh> read_ply(std::string_view bytes) {
  const Result<Header> parsed = parse_header(bytes);
  NEARMESH_RETURN_IF_ERROR(parsed);
  const Header& header = parsed.value();
  NEARMESH_RETURN_IF_ERROR(check_header(header, bytes.size()));

  IndexedMesh mesh;
  BodyReader body(bytes, header.encoding);
  // Cut into triangles only at the end: faces may stand before their vertices.
  std::vector<std::uint32_t> corners;
  std::vector<std::size_t> ends;
  for (const Element& element : header.elements) {
    for (std::uint64_t i = 0; i < element.count; ++i) {
      body.enter(element, i);
      std::array<double, 3> position{};
      NEARMESH_RETURN_IF_ERROR(read_instance(header, element, body, position, corners));
      if (element.name == "vertex") mesh.positions_m.push_back(position);
      if (element.name == "face") ends.push_back(corners.size());
    }
  }
  std::size_t begin = 0;
  for (const std::size_t end : ends) {
    NEARMESH_RETURN_IF_ERROR(append_polygon(std::span(corners).subspan(begin, end - begin), mesh));
    begin = end;
  }
  return mesh;
}

}  // namespace nearmesh::meshio
