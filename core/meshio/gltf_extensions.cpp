// SPDX-License-Identifier: Apache-2.0
#include "gltf_extensions.hpp"

#include <algorithm>
#include <cstdint>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <string_view>
#include <utility>

#include "text.hpp"

namespace nearmesh::meshio {
namespace {

using nlohmann::json;

constexpr std::string_view kBinaryMagic = "glTF";

/// Extensions of looks, of lights, of words: whatever they say, the triangles stay where they are.
bool leaves_geometry_alone(std::string_view extension) {
  for (const std::string_view family :
       {"KHR_materials_", "KHR_texture_", "KHR_xmp", "EXT_texture_", "EXT_lights_"})
    if (extension.starts_with(family)) return true;
  return extension == "KHR_lights_punctual" || extension == "KHR_animation_pointer";
}

/// Told of a JSON text piece by piece, it looks at one list of the outermost object and keeps
/// nothing else: neither depth nor size of the rest costs memory. False, from any of these, ends
/// the reading.
class DemandReader : public nlohmann::json_sax<json> {
 public:
  [[nodiscard]] const Status& status() const { return status_; }
  [[nodiscard]] bool is_json() const { return is_json_; }

  bool null() override { return take_other("null"); }
  bool boolean(bool /*value*/) override { return take_other("a truth value"); }
  bool number_integer(number_integer_t /*value*/) override { return take_other("a number"); }
  bool number_unsigned(number_unsigned_t /*value*/) override { return take_other("a number"); }
  bool number_float(number_float_t /*value*/, const string_t& /*text*/) override {
    return take_other("a number");
  }
  bool binary(binary_t& /*value*/) override { return take_other("bytes"); }
  bool string(string_t& value) override {
    if (!is_in_list_) return take_other("a text");
    if (leaves_geometry_alone(value)) return true;
    return refuse({StatusCode::kUnsupported,
                   "glTF: extensionsRequired: expected extensions that leave the geometry alone "
                   "(of materials, textures, lights), found " +
                       quote(value) + "; export the mesh without it, uncompressed and as floats"});
  }
  bool key(string_t& name) override {
    is_value_of_list_ = depth_ == 1 && name == "extensionsRequired";
    return true;
  }
  bool start_object(std::size_t /*elements*/) override {
    if (!take_other("an object")) return false;
    ++depth_;
    return true;
  }
  bool end_object() override {
    --depth_;
    return true;
  }
  bool start_array(std::size_t /*elements*/) override {
    if (is_in_list_) return take_other("a list");
    is_in_list_ = is_value_of_list_;
    is_value_of_list_ = false;
    ++depth_;
    return true;
  }
  bool end_array() override {
    is_in_list_ = false;  // no list within it has been let in
    --depth_;
    return true;
  }
  bool parse_error(std::size_t at, const std::string& /*token*/,
                   const nlohmann::detail::exception& /*error*/) override {
    is_json_ = false;
    return refuse(corrupt("glTF: byte " + std::to_string(at) +
                          " of its JSON: expected JSON, found something else; export it again"));
  }

 private:
  bool refuse(Status status) {
    status_ = std::move(status);
    return false;
  }
  /// Anything but a name in the list, or the list itself.
  bool take_other(const char* found) {
    if (!is_value_of_list_ && !is_in_list_) return true;
    return refuse(corrupt(
        std::string("glTF: extensionsRequired: expected a list of names of extensions, found ") +
        found + "; export it again"));
  }

  Status status_;
  std::uint64_t depth_ = 0;
  bool is_json_ = true;
  bool is_value_of_list_ = false, is_in_list_ = false;
};

bool ends_as_gltf(std::string_view path) {
  for (const std::string_view ending : {".gltf", ".glb"})
    if (path.size() >= ending.size() &&
        equal_ignoring_case(path.substr(path.size() - ending.size()), ending))
      return true;
  return false;
}

/// The JSON of a binary file, in both versions of its header: magic, version, size; size of the
/// JSON, its type; the JSON.
std::string json_of_binary(std::string_view bytes) {
  constexpr std::size_t kSizeAt = 12, kJsonAt = 20;
  if (bytes.size() < kJsonAt) return {};
  std::uint32_t size = 0;
  for (std::size_t k = 4; k-- > 0;)
    size = size << 8 | static_cast<unsigned char>(bytes[kSizeAt + k]);
  return std::string(bytes.substr(kJsonAt, size));
}

}  // namespace

Status check_gltf_demands(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) return {StatusCode::kIo, "cannot be read"};
  std::string bytes(kBinaryMagic.size(), '\0');
  in.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  bytes.resize(static_cast<std::size_t>(in.gcount()));
  // Assimp goes by the ending, and by the content where that misleads it.
  const bool is_binary = bytes == kBinaryMagic, is_told = is_binary || ends_as_gltf(path);
  in.clear();
  in.seekg(0);
  if (!is_told && (in >> std::ws).peek() != '{') return Status::ok();
  in.clear();
  in.seekg(0);
  bytes.assign(std::istreambuf_iterator<char>(in), {});
  if (is_binary) bytes = json_of_binary(bytes);
  // Names of nodes may be in any encoding, which is nothing to refuse a mesh for; what is looked
  // for here is ASCII.
  std::ranges::replace_if(
      bytes, [](char c) { return static_cast<unsigned char>(c) >= 0x80; }, '?');
  std::string_view text = bytes;
  if (text.starts_with("???")) text.remove_prefix(3);  // what was a byte order mark
  DemandReader reader;
  // Not strict: padding behind the JSON is assimp's to judge.
  json::sax_parse(text.begin(), text.end(), &reader, json::input_format_t::json, false);
  if (!reader.is_json() && !is_told) return Status::ok();  // then it is another format's
  return reader.status();
}

}  // namespace nearmesh::meshio
