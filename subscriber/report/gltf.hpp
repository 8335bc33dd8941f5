// SPDX-License-Identifier: Apache-2.0
#pragma once
// The parts of a binary glTF 2.0 file (takes positions, faces, nodes and times, gives bytes).

#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "mesh_colours.hpp"
#include "nearmesh/core/base/status.hpp"

namespace nearmesh::subscriber::report {

static_assert(std::endian::native == std::endian::little);

using Vector = std::array<double, 3>;

template <class T>
void put(std::string& out, T value) {
  char bytes[sizeof(T)];
  std::memcpy(bytes, &value, sizeof(T));
  out.append(bytes, sizeof(T));
}
inline void put(std::string& out, const Colour& colour) {
  for (const std::uint8_t channel : colour) put(out, channel);
}

/// The parts of a glTF file as they are put together.
class Gltf {
 public:
  static constexpr std::size_t kScene = 1;  // the node that all others are below

  /// Positions relative to `origin`.
  std::size_t add_positions(std::span<const Vector> positions, const Vector& origin) {
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
  /// An attribute of an application's own, by the rules of glTF: its name begins with a line.
  std::size_t add_numbers(std::span<const double> numbers) {
    return add_scalars(numbers, kVertices);
  }
  std::size_t add_mesh(const std::string& name, std::vector<nlohmann::ordered_json> primitives) {
    for (nlohmann::ordered_json& primitive : primitives) primitive["material"] = 0;
    json_["meshes"].push_back({{"name", name}, {"primitives", std::move(primitives)}});
    return json_["meshes"].size() - 1;
  }
  /// Below another node; kScene is the one that moves to the origin.
  std::size_t add_node(const std::string& name, std::size_t parent = kScene) {
    const std::size_t node = json_["nodes"].size();
    json_["nodes"][parent]["children"].push_back(node);
    json_["nodes"].push_back({{"name", name}});
    return node;
  }
  void set(std::size_t node, const char* property, nlohmann::ordered_json value) {
    json_["nodes"][node][property] = std::move(value);
  }
  /// A property of a node over time: "translation", "rotation" (x, y, z, w) or "scale". `values`:
  /// as many for each time. `is_step`: it stays as it is until the next time, else it goes there in
  /// a straight line.
  void animate(std::size_t node, const char* property, std::span<const double> times_s,
               std::span<const double> values, bool is_step) {
    const std::size_t width = values.size() / times_s.size();
    const std::size_t input = add_scalars(times_s);
    json_["accessors"][input]["min"] = {static_cast<float>(times_s.front())};
    json_["accessors"][input]["max"] = {static_cast<float>(times_s.back())};
    const std::size_t begin = binary_.size();
    for (const double value : values) put(binary_, static_cast<float>(value));
    const std::size_t output =
        add_accessor(begin, times_s.size(), kFloat, width == 4 ? "VEC4" : "VEC3", kNoTarget);
    nlohmann::ordered_json& animation = json_["animations"][0];
    animation["samplers"].push_back(
        {{"input", input}, {"output", output}, {"interpolation", is_step ? "STEP" : "LINEAR"}});
    animation["channels"].push_back({{"sampler", animation["samplers"].size() - 1},
                                     {"target", {{"node", node}, {"path", property}}}});
  }
  /// How large it is by now.
  [[nodiscard]] std::size_t bytes() const { return binary_.size(); }
  Result<std::string> finish(const Vector& origin, nlohmann::ordered_json extras) && {
    constexpr std::size_t kHeader = 12, kChunkHeader = 8;
    json_["nodes"][1]["translation"] = origin;
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
  static constexpr int kByte = 5121, kInteger = 5125, kFloat = 5126;        // component types
  static constexpr int kVertices = 34962, kIndices = 34963, kNoTarget = 0;  // what a view holds

  /// sRGB to linear, within 0.003, by a cubic: every machine gives the same byte.
  static std::uint8_t linear(std::uint8_t channel) {
    const double c = channel / 255.0;
    return static_cast<std::uint8_t>(255 * c * (c * (c * 0.305306011 + 0.682171111) + 0.012522878) +
                                     0.5);
  }
  std::size_t add_scalars(std::span<const double> numbers, int target = kNoTarget) {
    const std::size_t begin = binary_.size();
    for (const double number : numbers) put(binary_, static_cast<float>(number));
    return add_accessor(begin, numbers.size(), kFloat, "SCALAR", target);
  }
  std::size_t add_accessor(std::size_t begin, std::size_t count, int component, const char* type,
                           int target) {
    json_["bufferViews"].push_back(
        {{"buffer", 0}, {"byteOffset", begin}, {"byteLength", binary_.size() - begin}});
    if (target != kNoTarget) json_["bufferViews"].back()["target"] = target;
    json_["accessors"].push_back({{"bufferView", json_["bufferViews"].size() - 1},
                                  {"componentType", component},
                                  {"count", count},
                                  {"type", type}});
    return json_["accessors"].size() - 1;
  }

  // Node 0 does nothing but turn z up into y up, by -90 degrees about x. Who knows the generator
  // can leave that out, as core/meshio does.
  nlohmann::ordered_json json_ = {
      {"asset", {{"version", "2.0"}, {"generator", "nearmesh-subscriber export"}}},
      {"scene", 0},
      {"scenes", {{{"nodes", {0}}}}},
      {"nodes",
       {{{"name", "y_up"},
         {"rotation", {-0.7071067811865476, 0, 0, 0.7071067811865476}},
         {"children", {1}}},
        {{"name", "scene"}, {"children", nlohmann::ordered_json::array()}}}},
      {"materials",
       {{{"name", "by_eps"},
         {"doubleSided", true},
         {"pbrMetallicRoughness", {{"metallicFactor", 0}, {"roughnessFactor", 1}}}}}}};
  std::string binary_;
};

}  // namespace nearmesh::subscriber::report
