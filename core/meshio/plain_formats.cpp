// SPDX-License-Identifier: Apache-2.0
#include "plain_formats.hpp"

#include <algorithm>
#include <array>
#include <bit>

#include "polygon.hpp"
#include "text.hpp"

namespace nearmesh::meshio {
namespace {

// --- STL ---

std::uint32_t read_u32(std::string_view bytes, std::size_t at) {
  std::uint32_t value = 0;
  for (std::size_t k = 0; k < 4; ++k)
    value |= static_cast<std::uint32_t>(static_cast<std::uint8_t>(bytes[at + k])) << (8 * k);
  return value;
}

constexpr std::size_t kStlHeaderSize = 84, kStlFacetSize = 50;

std::uint64_t announced_stl_size(std::string_view bytes) {
  return kStlHeaderSize + std::uint64_t{kStlFacetSize} * read_u32(bytes, 80);
}

/// Expects these words next; says which is missing.
Status expect_words(std::string_view& text, std::initializer_list<std::string_view> words,
                    const std::string& place) {
  for (const std::string_view expected : words) {
    const std::string_view word = take_word(text);
    if (!equal_ignoring_case(word, expected))
      return corrupt(place + ": expected " + quote(expected) + ", found " +
                     (word.empty() ? std::string("the end of the file") : quote(word)));
  }
  return Status::ok();
}

/// Three vertices of their own for each facet, as the format has it.
void append_facet(const std::array<std::array<double, 3>, 3>& corners, IndexedMesh& mesh) {
  const auto first = static_cast<std::uint32_t>(mesh.positions_m.size());
  mesh.positions_m.insert(mesh.positions_m.end(), corners.begin(), corners.end());
  mesh.faces.push_back({first, first + 1, first + 2});
}

IndexedMesh read_binary_stl(std::string_view bytes) {
  IndexedMesh mesh;
  for (std::size_t facet = kStlHeaderSize; facet < bytes.size(); facet += kStlFacetSize) {
    std::array<std::array<double, 3>, 3> corners{};
    for (std::size_t k = 0; k < 9; ++k)  // behind the normal of three floats
      corners[k / 3][k % 3] = std::bit_cast<float>(read_u32(bytes, facet + 12 + 4 * k));
    append_facet(corners, mesh);
  }
  return mesh;
}

Status read_ascii_facet(std::string_view& text, const std::string& place, IndexedMesh& mesh) {
  NEARMESH_RETURN_IF_ERROR(expect_words(text, {"normal"}, place));
  for (int k = 0; k < 3; ++k)
    if (take_word(text).empty())
      return corrupt(place + ": expected a normal, found the end of the file");
  NEARMESH_RETURN_IF_ERROR(expect_words(text, {"outer", "loop"}, place));
  std::array<std::array<double, 3>, 3> corners{};
  for (auto& corner : corners) {
    NEARMESH_RETURN_IF_ERROR(expect_words(text, {"vertex"}, place));
    for (double& x : corner) NEARMESH_RETURN_IF_ERROR(parse_coordinate(take_word(text), place, x));
  }
  append_facet(corners, mesh);
  return expect_words(text, {"endloop", "endfacet"}, place);
}

Result<IndexedMesh> read_ascii_stl(std::string_view text) {
  IndexedMesh mesh;
  std::uint64_t facets = 0;
  bool inside = false;
  for (std::string_view word = take_word(text); !word.empty(); word = take_word(text)) {
    const std::string place = "STL facet " + std::to_string(facets);
    if (!inside) {
      if (!equal_ignoring_case(word, "solid"))
        return corrupt(place + ": expected \"solid\", found " + quote(word));
      inside = true;
      take_line(text);  // its name: any words
    } else if (equal_ignoring_case(word, "endsolid")) {
      inside = false;
      take_line(text);
    } else if (equal_ignoring_case(word, "facet")) {
      NEARMESH_RETURN_IF_ERROR(read_ascii_facet(text, place, mesh));
      ++facets;
    } else {
      return corrupt(place + ": expected \"facet\" or \"endsolid\", found " + quote(word));
    }
  }
  if (inside)
    return corrupt("STL after facet " + std::to_string(facets) +
                   ": expected \"endsolid\", found the end of the file");
  return mesh;
}

// --- OFF ---

/// Lines that say something: without comments, not blank.
class OffLines {
 public:
  explicit OffLines(std::string_view text) : text_(text) {}

  std::optional<std::string_view> next() {
    while (auto line = take_line(text_)) {
      ++number_;
      const std::string_view content = line->substr(0, line->find('#'));
      if (!std::ranges::all_of(content, is_blank)) return content;
    }
    return std::nullopt;
  }
  [[nodiscard]] std::string place() const { return "OFF line " + std::to_string(number_); }

 private:
  std::string_view text_;
  std::uint64_t number_ = 0;
};

struct OffCounts {
  std::int64_t vertices = 0, faces = 0;
};

Result<OffCounts> parse_off_header(OffLines& lines) {
  auto line = lines.next();
  if (!line) return corrupt("OFF: expected counts, found a blank file");
  const std::string_view whole = *line;
  const std::string_view keyword = take_word(*line);
  if (keyword.ends_with("OFF")) {
    if (keyword.find_first_of("4n") != std::string_view::npos)
      return Status(StatusCode::kUnsupported, "OFF: expected coordinates x, y, z, found " +
                                                  quote(keyword) + "; export it without others");
    if (std::ranges::all_of(*line, is_blank))
      line = lines.next();  // the counts follow on their own line
  } else {
    line = whole;  // the keyword may be left out
  }
  if (!line) return corrupt(lines.place() + ": expected counts, found the end of the file");
  const std::string_view vertices_word = take_word(*line), faces_word = take_word(*line);
  if (equal_ignoring_case(vertices_word, "binary"))
    return Status(StatusCode::kUnsupported,
                  "OFF: expected text, found a binary file; export it as text");
  const auto vertices = parse_integer(vertices_word), faces = parse_integer(faces_word);
  if (!vertices || !faces || *vertices < 0 || *faces < 0)
    return corrupt(lines.place() + ": expected counts of vertices and faces, found " +
                   quote(vertices_word) + " " + quote(faces_word));
  return OffCounts{*vertices, *faces};
}

Status read_off_face(std::string_view line, const std::string& place,
                     std::vector<std::uint32_t>& corners, IndexedMesh& mesh) {
  const auto vertex_count = static_cast<std::int64_t>(mesh.positions_m.size());
  corners.clear();
  const std::string_view length_word = take_word(line);
  const auto length = parse_integer(length_word);
  if (!length || *length < 0)
    return corrupt(place + ": expected a face's corner count, found " + quote(length_word));
  for (std::int64_t k = 0; k < *length; ++k) {
    const std::string_view word = take_word(line);
    const auto index = parse_integer(word);
    if (!index || *index < 0 || *index >= vertex_count)
      return corrupt(place + ": expected vertex index " + std::to_string(k + 1) + " of " +
                     std::to_string(*length) + ", below " + std::to_string(vertex_count) +
                     ", found " + quote(word));
    corners.push_back(static_cast<std::uint32_t>(*index));
  }
  return append_polygon(corners, mesh);
}

// --- OBJ ---

/// Lines with "\" at their end joined to the next.
class ObjLines {
 public:
  explicit ObjLines(std::string_view text) : text_(text) {}

  std::optional<std::string_view> next() {
    auto line = take_line(text_);
    ++number_;
    if (!line || !line->ends_with('\\')) return line;
    joined_.clear();
    while (line && line->ends_with('\\')) {
      joined_ += line->substr(0, line->size() - 1);
      joined_ += ' ';
      line = take_line(text_);
      ++number_;
    }
    if (line) joined_ += *line;
    return joined_;
  }
  [[nodiscard]] std::uint64_t number() const { return number_; }

 private:
  std::string_view text_;
  std::string joined_;
  std::uint64_t number_ = 0;
};

/// Corners of one face: as written from 1 (its vertex may stand further down) or counted back from
/// here.
Status read_obj_face(std::string_view line, std::int64_t vertices_so_far, const std::string& place,
                     std::vector<std::uint32_t>& corners) {
  for (std::string_view word = take_word(line); !word.empty() && word.front() != '#';
       word = take_word(line)) {
    const auto index = parse_integer(word.substr(0, word.find('/')));
    if (!index || *index == 0 || *index < -vertices_so_far || *index > 0xffffffffLL)
      return corrupt(place + ": expected a vertex index from 1 or from -1 down to -" +
                     std::to_string(vertices_so_far) + ", found " + quote(word));
    corners.push_back(
        static_cast<std::uint32_t>(*index > 0 ? *index - 1 : vertices_so_far + *index));
  }
  return Status::ok();
}

struct ObjFace {
  std::size_t end;  ///< of its corners
  std::uint64_t line;
};

std::string obj_place(std::uint64_t line) { return "OBJ line " + std::to_string(line); }

std::string_view file_ending(std::string_view path) {
  const std::size_t dot = path.find_last_of("./");
  return dot == std::string_view::npos || path[dot] != '.' ? std::string_view()
                                                           : path.substr(dot + 1);
}

}  // namespace

Result<IndexedMesh> read_stl(std::string_view bytes) {
  const bool has_count = bytes.size() >= kStlHeaderSize;
  if (has_count && announced_stl_size(bytes) == bytes.size()) return read_binary_stl(bytes);
  std::string_view rest = bytes;
  if (equal_ignoring_case(take_word(rest), "solid")) return read_ascii_stl(bytes);
  if (!has_count)
    return corrupt("STL: expected 84 bytes of header, found " + std::to_string(bytes.size()));
  return corrupt("STL: " + std::to_string(read_u32(bytes, 80)) + " facets announced make " +
                 std::to_string(announced_stl_size(bytes)) + " bytes, found " +
                 std::to_string(bytes.size()));
}

Result<IndexedMesh> read_off(std::string_view bytes) {
  OffLines lines(bytes);
  const auto counts = parse_off_header(lines);
  NEARMESH_RETURN_IF_ERROR(counts);
  IndexedMesh mesh;
  for (std::int64_t v = 0; v < counts.value().vertices; ++v) {
    auto line = lines.next();
    if (!line)
      return corrupt(lines.place() + ": expected " + std::to_string(counts.value().vertices) +
                     " vertices, the file ends after " + std::to_string(v));
    std::array<double, 3> position{};
    for (double& x : position)
      NEARMESH_RETURN_IF_ERROR(parse_coordinate(take_word(*line), lines.place(), x));
    mesh.positions_m.push_back(position);
  }
  std::vector<std::uint32_t> corners;
  for (std::int64_t f = 0; f < counts.value().faces; ++f) {
    const auto line = lines.next();
    if (!line)
      return corrupt(lines.place() + ": expected " + std::to_string(counts.value().faces) +
                     " faces, the file ends after " + std::to_string(f));
    NEARMESH_RETURN_IF_ERROR(read_off_face(*line, lines.place(), corners, mesh));
  }
  return mesh;
}

Result<IndexedMesh> read_obj(std::string_view bytes, std::vector<ObjObject>* objects) {
  if (bytes.starts_with("\xfe\xff") || bytes.starts_with("\xff\xfe"))
    return Status(StatusCode::kUnsupported,
                  "OBJ: expected ASCII or UTF-8, found UTF-16; save it as UTF-8");
  if (bytes.starts_with("\xef\xbb\xbf")) bytes.remove_prefix(3);
  IndexedMesh mesh;
  std::vector<std::uint32_t> corners;
  std::vector<ObjFace> faces;
  std::vector<ObjObject> named, groups;  // by polygon, until these are cut into triangles
  ObjLines lines(bytes);
  while (auto line = lines.next()) {
    const std::string_view keyword = take_word(*line);
    if (keyword == "v") {
      std::array<double, 3> position{};
      for (double& x : position)
        NEARMESH_RETURN_IF_ERROR(parse_coordinate(take_word(*line), obj_place(lines.number()), x));
      mesh.positions_m.push_back(position);
    } else if (keyword == "f") {
      NEARMESH_RETURN_IF_ERROR(read_obj_face(*line,
                                             static_cast<std::int64_t>(mesh.positions_m.size()),
                                             obj_place(lines.number()), corners));
      faces.push_back({corners.size(), lines.number()});
    } else if (objects != nullptr && (keyword == "o" || keyword == "g")) {
      const std::string_view name = take_word(*line);
      (keyword == "o" ? named : groups).push_back({std::string(name), faces.size()});
    }
  }
  if (named.empty()) named = std::move(groups);
  std::size_t polygons = 0, next_object = 0;
  std::size_t begin = 0;
  for (const ObjFace& face : faces) {
    for (; next_object < named.size() && named[next_object].first_face <= polygons; ++next_object)
      named[next_object].first_face = mesh.faces.size();
    ++polygons;
    const auto polygon = std::span(corners).subspan(begin, face.end - begin);
    for (const std::uint32_t corner : polygon)
      if (corner >= mesh.positions_m.size())
        return corrupt(obj_place(face.line) + ": expected vertex indices up to " +
                       std::to_string(mesh.positions_m.size()) + ", found " +
                       std::to_string(corner + 1ULL));
    NEARMESH_RETURN_IF_ERROR(append_polygon(polygon, mesh));
    begin = face.end;
  }
  for (; next_object < named.size(); ++next_object)
    named[next_object].first_face = mesh.faces.size();
  if (objects != nullptr) *objects = std::move(named);
  return mesh;
}

std::optional<PlainFormat> find_plain_format(const std::string& path, std::string_view bytes) {
  const std::string_view ending = file_ending(path);
  const auto ends = [ending](std::string_view format) {
    return equal_ignoring_case(ending, format);
  };
  if (ends("ply") || bytes.starts_with("ply\n") || bytes.starts_with("ply\r"))
    return PlainFormat::kPly;
  if (ends("stl")) return PlainFormat::kStl;
  if (ends("off") || bytes.starts_with("OFF")) return PlainFormat::kOff;
  if (ends("obj")) return PlainFormat::kObj;
  return std::nullopt;
}

Result<IndexedMesh> read_plain(PlainFormat format, std::string_view bytes) {
  if (bytes.starts_with("PK\x03\x04"))
    return corrupt("expected a mesh as its name says, found a zip archive; unpack it before");
  switch (format) {
    case PlainFormat::kPly:
      return read_ply(bytes);
    case PlainFormat::kStl:
      return read_stl(bytes);
    case PlainFormat::kOff:
      return read_off(bytes);
    case PlainFormat::kObj:
      return read_obj(bytes);
  }
  return Status(StatusCode::kUnsupported, "no such format");
}

}  // namespace nearmesh::meshio
