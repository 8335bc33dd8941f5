// SPDX-License-Identifier: Apache-2.0
#include "scene_files.hpp"

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <span>

#include "scene_colours.hpp"

namespace nearmesh::subscriber {
namespace {

static_assert(std::endian::native == std::endian::little);

template <class T>
void put(std::string& out, T value) {
  char bytes[sizeof(T)];
  std::memcpy(bytes, &value, sizeof(T));
  out.append(bytes, sizeof(T));
}
void put(std::string& out, const Colour& colour) {
  for (const std::uint8_t channel : colour) put(out, channel);
}

/// One vertex of a PLY file.
void put_vertex(std::string& out, const std::array<double, 3>& at, const Colour& colour,
                double eps_m) {
  for (const double x : at) put(out, x);
  put(out, colour);
  put(out, static_cast<float>(eps_m));
}

/// The parts of a glTF file as they are put together.
class Gltf {
 public:
  /// Positions relative to `origin`.
  std::size_t add_positions(std::span<const std::array<double, 3>> positions,
                            const std::array<double, 3>& origin) {
    std::array<float, 3> lo, hi;
    lo.fill(std::numeric_limits<float>::max());
    hi.fill(std::numeric_limits<float>::lowest());
    const std::size_t begin = binary_.size();
    for (const auto& at : positions)
      for (std::size_t k = 0; k < 3; ++k) {
        const auto x = static_cast<float>(at[k] - origin[k]);
        lo[k] = std::min(lo[k], x);
        hi[k] = std::max(hi[k], x);
        put(binary_, x);
      }
    const std::size_t accessor = add_accessor(begin, positions.size(), kFloat, "VEC3", kVertices);
    json_["accessors"][accessor]["min"] = lo;
    json_["accessors"][accessor]["max"] = hi;
    return accessor;
  }
  /// glTF's vertex colours are linear, four bytes each.
  std::size_t add_colours(std::span<const Colour> colours) {
    const std::size_t begin = binary_.size();
    for (const Colour& colour : colours) {
      for (const std::uint8_t channel : colour) put(binary_, linear(channel));
      put(binary_, std::uint8_t{255});
    }
    const std::size_t accessor = add_accessor(begin, colours.size(), kByte, "VEC4", kVertices);
    json_["accessors"][accessor]["normalized"] = true;
    return accessor;
  }
  std::size_t add_indices(std::span<const std::array<std::uint32_t, 3>> faces) {
    const std::size_t begin = binary_.size();
    for (const auto& face : faces)
      for (const std::uint32_t corner : face) put(binary_, corner);
    return add_accessor(begin, 3 * faces.size(), kInteger, "SCALAR", kIndices);
  }
  void add_node(const std::string& name, nlohmann::ordered_json primitive) {
    primitive["material"] = 0;
    json_["nodes"][0]["children"].push_back(json_["nodes"].size());
    json_["nodes"].push_back({{"name", name}, {"mesh", json_["meshes"].size()}});
    json_["meshes"].push_back({{"name", name}, {"primitives", {std::move(primitive)}}});
  }
  Result<std::string> finish(const std::array<double, 3>& origin,
                             nlohmann::ordered_json extras) && {
    constexpr std::size_t kHeader = 12, kChunkHeader = 8;
    json_["nodes"][0]["translation"] = {origin[0], origin[2], -origin[1]};
    json_["asset"]["extras"] = std::move(extras);
    json_["buffers"] = {{{"byteLength", binary_.size()}}};
    // Names come from the wire: bytes that are no UTF-8 are replaced.
    std::string text = json_.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
    text.resize((text.size() + 3) / 4 * 4, ' ');
    const std::size_t total = kHeader + 2 * kChunkHeader + text.size() + binary_.size();
    if (total > std::numeric_limits<std::uint32_t>::max())
      return Status{StatusCode::kUnsupported,
                    "more than 4 GiB, which is all that GLB can be; PLY "
                    "has no such limit"};
    std::string out = "glTF";
    put(out, std::uint32_t{2});
    put(out, static_cast<std::uint32_t>(total));
    put(out, static_cast<std::uint32_t>(text.size()));
    out += "JSON" + text;
    put(out, static_cast<std::uint32_t>(binary_.size()));
    out.append("BIN\0", 4);
    return out + binary_;
  }

 private:
  static constexpr int kByte = 5121, kInteger = 5125, kFloat = 5126;  // component types
  static constexpr int kVertices = 34962, kIndices = 34963;           // what a view holds

  /// sRGB to linear, within 0.003, by a cubic: every machine gives the same byte.
  static std::uint8_t linear(std::uint8_t channel) {
    const double c = channel / 255.0;
    return static_cast<std::uint8_t>(255 * c * (c * (c * 0.305306011 + 0.682171111) + 0.012522878) +
                                     0.5);
  }
  std::size_t add_accessor(std::size_t begin, std::size_t count, int component, const char* type,
                           int target) {
    json_["bufferViews"].push_back({{"buffer", 0},
                                    {"byteOffset", begin},
                                    {"byteLength", binary_.size() - begin},
                                    {"target", target}});
    json_["accessors"].push_back({{"bufferView", json_["bufferViews"].size() - 1},
                                  {"componentType", component},
                                  {"count", count},
                                  {"type", type}});
    return json_["accessors"].size() - 1;
  }

  // Node 0 turns z up into y up: by -90 degrees about x.
  nlohmann::ordered_json json_ = {
      {"asset", {{"version", "2.0"}, {"generator", "nearmesh-subscriber export"}}},
      {"scene", 0},
      {"scenes", {{{"nodes", {0}}}}},
      {"nodes",
       {{{"name", "scene"},
         {"rotation", {-0.7071067811865476, 0, 0, 0.7071067811865476}},
         {"children", nlohmann::ordered_json::array()}}}},
      {"materials",
       {{{"name", "by_eps"},
         {"doubleSided", true},
         {"pbrMetallicRoughness", {{"metallicFactor", 0}, {"roughnessFactor", 1}}}}}}};
  std::string binary_;
};

std::vector<Colour> colours_of(const SceneBody& body, bool other) {
  std::vector<Colour> colours;
  for (const double eps_m : body.eps_m) colours.push_back(vertex_colour(eps_m, body.size_m, other));
  return colours;
}

}  // namespace

std::string to_ply(const RecordedScene& scene, std::size_t looked_at) {
  const std::array<const SceneBody*, 2> bodies{&scene.bodies[looked_at],
                                               &scene.bodies[1 - looked_at]};
  const std::size_t segments = scene.contacts.segments.size();
  std::size_t vertices = 2 * segments, faces = 0;
  for (const SceneBody* body : bodies) {
    vertices += body->positions_world_m.size();
    faces += body->faces.size();
  }
  std::string out = "ply\nformat binary_little_endian 1.0\n";
  out += std::string("comment ") + kColourScale + "\n";
  out += "comment quality: eps in metres, 0 where exact\n";
  out += "element vertex " + std::to_string(vertices) + "\n";
  out += "property double x\nproperty double y\nproperty double z\n";
  out += "property uchar red\nproperty uchar green\nproperty uchar blue\n";
  out += "property float quality\n";
  out += "element face " + std::to_string(faces) + "\n";
  out += "property list uchar int vertex_indices\n";
  out += "element edge " + std::to_string(segments) + "\n";
  out += "property int vertex1\nproperty int vertex2\n";
  out += "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n";
  for (const SceneBody* body : bodies)
    for (std::size_t i = 0; i < body->positions_world_m.size(); ++i)
      put_vertex(out, body->positions_world_m[i],
                 vertex_colour(body->eps_m[i], body->size_m, body != bodies[0]), body->eps_m[i]);
  for (const ContactSegment& segment : scene.contacts.segments) {
    put_vertex(out, segment.p_m, kContactColour, 0);
    put_vertex(out, segment.q_m, kContactColour, 0);
  }
  std::uint32_t first = 0;
  for (const SceneBody* body : bodies) {
    for (const auto& face : body->faces) {
      put(out, std::uint8_t{3});
      for (const std::uint32_t corner : face) put(out, first + corner);
    }
    first += static_cast<std::uint32_t>(body->positions_world_m.size());
  }
  for (std::size_t i = 0; i < segments; ++i, first += 2) {
    put(out, first);
    put(out, first + 1);
    put(out, kContactColour);
  }
  return out;
}

Result<std::string> to_glb(const RecordedScene& scene, std::size_t looked_at) {
  const std::array<double, 3> origin =
      (looked_at == 0 ? scene.report.a : scene.report.b).pose.translation_m;
  Gltf gltf;
  for (const bool other : {false, true}) {
    const SceneBody& body = scene.bodies[other ? 1 - looked_at : looked_at];
    if (body.faces.empty()) continue;  // an accessor may not be empty
    const auto positions = gltf.add_positions(body.positions_world_m, origin);
    const auto colours = gltf.add_colours(colours_of(body, other));
    gltf.add_node(body.name, {{"attributes", {{"POSITION", positions}, {"COLOR_0", colours}}},
                              {"indices", gltf.add_indices(body.faces)},
                              {"mode", 4}});
  }
  if (!scene.contacts.segments.empty()) {
    std::vector<std::array<double, 3>> ends;
    for (const ContactSegment& segment : scene.contacts.segments) {
      ends.push_back(segment.p_m);
      ends.push_back(segment.q_m);
    }
    const auto positions = gltf.add_positions(ends, origin);
    const auto colours = gltf.add_colours(std::vector<Colour>(ends.size(), kContactColour));
    gltf.add_node("contacts",
                  {{"attributes", {{"POSITION", positions}, {"COLOR_0", colours}}}, {"mode", 1}});
  }
  return std::move(gltf).finish(origin, {{"colours", kColourScale}});
}

Status write_file(const std::string& bytes, const std::string& path) {
  const std::string partial = path + ".partial";
  std::ofstream out(partial, std::ios::binary | std::ios::trunc);
  out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  out.close();
  if (!out || std::rename(partial.c_str(), path.c_str()) != 0) {
    const std::string reason = std::strerror(errno);
    std::remove(partial.c_str());
    return {StatusCode::kIo, path + ": cannot write: " + reason};
  }
  return Status::ok();
}

}  // namespace nearmesh::subscriber
