// SPDX-License-Identifier: Apache-2.0
#include "conventions.hpp"

#include <assimp/commonMetaData.h>
#include <zlib.h>

#include <algorithm>
#include <charconv>
#include <cstring>
#include <fstream>
#include <iterator>

#include "nearmesh/core/meshio/import.hpp"
#include "text.hpp"

namespace nearmesh {

std::span<const MeshFormat> mesh_formats() {
  static constexpr MeshFormat kFormats[] = {
      {"PLY", "ply", "own", "none stated", "none stated", "none"},
      {"STL", "stl", "own", "none stated", "none stated", "none"},
      {"OFF", "off", "own", "none stated", "none stated", "none"},
      {"Wavefront OBJ", "obj", "own", "none stated", "none stated", "o, or g where there is no o"},
      {"Collada", "dae zae", "assimp", "<unit meter>, else 1 m", "<up_axis>, else y",
       "nodes, by id"},
      {"FBX", "fbx", "assimp", "UnitScaleFactor, else 1 cm", "UpAxis, else y", "models"},
      {"glTF", "gltf glb", "assimp", "always 1 m", "always y", "nodes"},
      {"3MF", "3mf", "assimp", "<model unit>, else 1 mm", "always z", "objects"},
      {"AMF", "amf", "assimp", "<amf unit>, else 1 mm", "always z", "objects"},
      {"3D Studio", "3ds prj", "assimp", "none stated", "always z", "objects"},
      {"3ds Max ASCII", "ase ask", "assimp", "none stated", "always z", "objects"},
      {"DXF", "dxf", "assimp", "$INSUNITS, else none stated", "always z", "layers"},
      {"AC3D", "ac acc ac3d", "assimp", "none stated", "always y", "objects"},
      {"DirectX, z negated", "x", "assimp", "none stated", "always y", "frames"},
  };
  return kFormats;
}

namespace meshio {
namespace {

constexpr std::size_t kMostLookedAt = 1 << 20;  // a file's head, where it speaks of itself

std::uint32_t word_at(std::string_view bytes, std::size_t at, std::size_t size) {
  std::uint32_t value = 0;
  for (std::size_t k = size; k-- > 0;)
    value = value << 8 | static_cast<unsigned char>(bytes[at + k]);
  return value;
}

std::string inflate_head(std::string_view packed) {
  std::string out(kMostLookedAt, '\0');
  z_stream stream{};
  if (inflateInit2(&stream, -MAX_WBITS) != Z_OK) return {};
  // zlib's interface lacks a const.
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(packed.data()));
  stream.avail_in = static_cast<uInt>(std::min<std::size_t>(packed.size(), 1U << 30));
  stream.next_out = reinterpret_cast<Bytef*>(out.data());
  stream.avail_out = static_cast<uInt>(out.size());
  inflate(&stream, Z_SYNC_FLUSH);
  out.resize(out.size() - stream.avail_out);
  inflateEnd(&stream);
  return out;
}

/// The head of the first file in an archive whose name ends so; empty where there is none.
std::string unzip_head(std::string_view archive, std::string_view ending) {
  constexpr std::size_t kEntry = 46, kLocal = 30, kEnd = 22;
  const std::size_t end = archive.rfind("PK\x05\x06");
  if (end == std::string_view::npos || end + kEnd > archive.size()) return {};
  std::size_t at = word_at(archive, end + 16, 4);
  while (at <= archive.size() && archive.size() - at >= kEntry &&
         archive.substr(at, 4) == "PK\x01\x02") {
    const std::uint32_t method = word_at(archive, at + 10, 2),
                        packed = word_at(archive, at + 20, 4),
                        name_size = word_at(archive, at + 28, 2),
                        local = word_at(archive, at + 42, 4);
    const std::string_view name = archive.substr(at + kEntry).substr(0, name_size);
    if (name.ends_with(ending)) {
      if (local > archive.size() || archive.size() - local < kLocal) return {};
      const std::size_t begin = std::size_t{local} + kLocal + word_at(archive, local + 26, 2) +
                                word_at(archive, local + 28, 2);
      if (begin > archive.size()) return {};
      const std::string_view content = archive.substr(begin, packed);
      return method == 8 ? inflate_head(content) : std::string(content.substr(0, kMostLookedAt));
    }
    at += kEntry + name_size + word_at(archive, at + 30, 2) + word_at(archive, at + 32, 2);
  }
  return {};
}

/// What the file says of itself: its text, or that of the first file in it whose name ends so.
std::string head_of(const std::string& path, std::string_view ending_in_archive) {
  std::ifstream in(path, std::ios::binary);
  std::string bytes(std::istreambuf_iterator<char>(in), {});
  return bytes.starts_with("PK\x03\x04") ? unzip_head(bytes, ending_in_archive) : bytes;
}

/// The value of an attribute in the first tag of that name, comments left out; empty where there is
/// none.
std::string_view attribute(std::string_view xml, std::string_view tag, std::string_view name) {
  constexpr std::string_view kComment = "<!--", kCommentEnd = "-->";
  for (std::size_t at = xml.find('<'); at != std::string_view::npos; at = xml.find('<', at + 1)) {
    std::string_view rest = xml.substr(at);
    if (rest.starts_with(kComment)) {
      at = xml.find(kCommentEnd, at + kComment.size());
      if (at == std::string_view::npos) return {};
      continue;
    }
    rest.remove_prefix(1);
    if (!rest.starts_with(tag)) continue;
    rest.remove_prefix(tag.size());
    if (rest.empty() || !is_blank(rest.front())) continue;
    rest = rest.substr(0, rest.find('>'));
    for (std::size_t found = rest.find(name); found != std::string_view::npos;
         found = rest.find(name, found + 1)) {
      std::string_view value = rest.substr(found + name.size());
      if (!is_blank(rest[found - 1])) continue;
      while (!value.empty() && (is_blank(value.front()) || value.front() == '='))
        value.remove_prefix(1);
      if (value.empty() || (value.front() != '"' && value.front() != '\'')) continue;
      return value.substr(1, value.find(value.front(), 1) - 1);
    }
    return {};
  }
  return {};
}

struct NamedUnit {
  std::string_view name;
  double unit_m;
};
/// Those of the standard of 3MF.
constexpr NamedUnit k3mfUnits[] = {{"micron", 1e-6}, {"millimeter", 1e-3}, {"centimeter", 1e-2},
                                   {"inch", 0.0254}, {"foot", 0.3048},     {"meter", 1}};
/// Those of the standard of AMF, and what its writers make of them.
constexpr NamedUnit kAmfUnits[] = {
    {"micron", 1e-6}, {"millimeter", 1e-3}, {"millimeters", 1e-3}, {"centimeter", 1e-2},
    {"meter", 1},     {"inch", 0.0254},     {"foot", 0.3048},      {"feet", 0.3048}};

/// Metres in the unit that $INSUNITS of a DXF file numbers so; 0: none, or one that is not known
/// here.
constexpr double kDxfUnits[] = {0,       0.0254,  0.3048, 1609.344, 1e-3, 1e-2,           1,   1e3,
                                2.54e-8, 2.54e-5, 0.9144, 1e-10,    1e-9, 1e-6,           0.1, 10,
                                100,     1e9,     0,      0,        0,    1200.0 / 3937.0};

/// The value of $INSUNITS in the section HEADER. The text is pairs of lines: a code, what stands
/// there.
std::optional<std::string_view> find_dxf_unit(std::string_view text) {
  bool is_section = false, is_header = false, is_unit = false;
  for (;;) {
    std::optional<std::string_view> code_line = take_line(text);
    const auto value_line = take_line(text);
    if (!code_line || !value_line) return std::nullopt;
    std::string_view rest = *value_line;
    const std::string_view code = take_word(*code_line), value = take_word(rest);
    if (is_header && code == "0") return std::nullopt;  // the section ends
    if (is_unit && code == "70") return value;
    if (is_section && code == "2" && value == "HEADER") is_header = true;
    is_section = code == "0" && value == "SECTION";
    is_unit = is_header && (code == "9" ? value == "$INSUNITS" : is_unit);
  }
}

/// The shortest decimal that a float stands for, which is what a file has had written: 0.0254, not
/// 0.0253999997.
double decimal(float x) {
  char text[64];
  const auto end = std::to_chars(text, text + sizeof text, x).ptr;
  double value = x;
  std::from_chars(text, end, value);
  return value;
}

ReadConvention collada(const aiScene& scene, const std::string& path) {
  // Assimp makes the visual scene the root, which has no transform in the file, and multiplies the
  // unit and the turn to Y-up onto it.
  const aiMatrix4x4& root = scene.mRootNode->mTransformation;
  const std::string text = head_of(path, ".dae");
  ReadConvention out;
  out.leaves_out_root = true;
  const bool states_unit = !attribute(text, "unit", "meter").empty();
  out.file.unit_m = decimal(root.a1 != 0 ? root.a1 : root.b1);
  out.file.unit_is_fixed = states_unit;
  out.file.unit_source = states_unit ? OriginSource::kFile : OriginSource::kFormat;
  out.file.up = root.b3 != 0 ? UpAxis::kZ : root.a2 != 0 ? UpAxis::kX : UpAxis::kY;
  out.file.up_source =
      text.find("<up_axis") != std::string::npos ? OriginSource::kFile : OriginSource::kFormat;
  return out;
}

ReadConvention fbx(const aiScene& scene, const std::string& path) {
  ReadConvention out;
  // The file has none; assimp 5.4 turns and scales to Y-up there, 5.2 does nothing.
  out.leaves_out_root = true;
  const std::string bytes = head_of(path, ".fbx");
  // In text it stands in quotes, in binary behind its length; OriginalUnitScaleFactor is another.
  const auto has = [&bytes](const std::string& name) {
    for (std::size_t at = bytes.find(name); at != std::string::npos; at = bytes.find(name, at + 1))
      if (at > 0 && (bytes[at - 1] == '"' || bytes[at - 1] == '\0')) return true;
    return false;
  };
  float centimetres = 1;
  std::int32_t axis = 1;
  if (scene.mMetaData != nullptr) {
    scene.mMetaData->Get("UnitScaleFactor", centimetres);
    scene.mMetaData->Get("UpAxis", axis);
  }
  const bool states_unit = has("UnitScaleFactor"), states_up = has("UpAxis");
  out.file.unit_m = decimal(centimetres) / 100;
  out.file.unit_is_fixed = states_unit;
  out.file.unit_source = states_unit ? OriginSource::kFile : OriginSource::kFormat;
  out.file.up = axis == 0 ? UpAxis::kX : axis == 2 ? UpAxis::kZ : UpAxis::kY;
  out.file.up_source = states_up ? OriginSource::kFile : OriginSource::kFormat;
  return out;
}

ReadConvention gltf(const aiScene& scene) {
  ReadConvention out;
  aiString generator;
  const bool is_ours = scene.mMetaData != nullptr &&
                       scene.mMetaData->Get(AI_METADATA_SOURCE_GENERATOR, generator) &&
                       std::string_view(generator.C_Str()) == "nearmesh-subscriber export";
  // Its world is z up, and its root does nothing but turn that to glTF's y up.
  out.leaves_out_root = is_ours;
  out.file = {.unit_source = OriginSource::kFormat,
              .up = is_ours ? UpAxis::kZ : UpAxis::kY,
              .up_source = is_ours ? OriginSource::kFile : OriginSource::kFormat,
              .unit_is_fixed = true};
  return out;
}

/// Errors: kCorrupt (a unit that is stated, and none of these).
Result<ReadConvention> millimetres_unless(std::string_view stated, const char* place,
                                          std::span<const NamedUnit> units) {
  ReadConvention out;
  out.file = {.unit_m = 1e-3,
              .unit_source = OriginSource::kFormat,
              .up = UpAxis::kZ,
              .up_source = OriginSource::kFormat};
  if (stated.empty()) return out;
  std::string names;
  for (const NamedUnit& unit : units) {
    if (equal_ignoring_case(unit.name, stated)) {
      out.file.unit_m = unit.unit_m;
      out.file.unit_source = OriginSource::kFile;
      out.file.unit_is_fixed = true;
      return out;
    }
    names += (names.empty() ? "" : ", ") + std::string(unit.name);
  }
  return corrupt(std::string(place) + ": expected one of " + names + ", found " + quote(stated) +
                 "; export it with one of these, or without a unit, for millimetres or --unit");
}

ReadConvention only_up(UpAxis up, bool leaves_out_root) {
  ReadConvention out;
  out.file.up = up;
  out.file.up_source = OriginSource::kFormat;
  out.leaves_out_root = leaves_out_root;
  return out;
}

Result<ReadConvention> dxf(const std::string& path) {
  ReadConvention out = only_up(UpAxis::kZ, true);
  const std::string text = head_of(path, ".dxf");
  const auto stated = find_dxf_unit(text);
  if (!stated) return out;
  const auto unit = parse_integer(*stated);
  if (!unit)
    return corrupt("DXF: $INSUNITS: expected a whole number, found " + quote(*stated) +
                   "; export it with 6 (m), say, or with 0, for no unit, and say --unit");
  if (*unit == 0) return out;  // "unitless"
  constexpr auto kCount = static_cast<std::int64_t>(std::size(kDxfUnits));
  const double unit_m = *unit > 0 && *unit < kCount ? kDxfUnits[*unit] : 0;
  if (unit_m == 0)
    return Status(StatusCode::kUnsupported,
                  "DXF: $INSUNITS: expected a unit that is known here, as 1 (inches), 2 (feet), 4 "
                  "(mm), 5 (cm) or 6 (m), found " +
                      quote(*stated) +
                      "; export it with one of these, or with 0, for no unit, and say --unit");
  out.file.unit_m = unit_m;
  out.file.unit_source = OriginSource::kFile;
  out.file.unit_is_fixed = true;
  return out;
}

}  // namespace

Result<ReadConvention> find_convention(std::string_view importer, const aiScene& scene,
                                       const std::string& path) {
  const auto is = [importer](std::string_view start) { return importer.starts_with(start); };
  if (is("Collada")) return collada(scene, path);
  if (is("Autodesk FBX")) return fbx(scene, path);
  if (is("3mf"))
    return millimetres_unless(attribute(head_of(path, ".model"), "model", "unit"),
                              "3MF: unit of <model>", k3mfUnits);
  if (is("Additive manufacturing"))
    return millimetres_unless(attribute(head_of(path, ".amf"), "amf", "unit"), "AMF: unit of <amf>",
                              kAmfUnits);
  if (is("glTF")) return gltf(scene);
  // These three are turned from Z-up to Y-up at the root; 3DS is also divided by its master scale.
  if (is("Drawing Interchange")) return dxf(path);
  if (is("Discreet 3DS") || is("ASE")) return only_up(UpAxis::kZ, true);
  if (is("AC3D") || is("Direct3D XFile")) return only_up(UpAxis::kY, false);
  ReadConvention unknown;
  unknown.file.is_known = false;
  return unknown;
}

}  // namespace meshio
}  // namespace nearmesh
