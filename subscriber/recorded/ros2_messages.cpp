// SPDX-License-Identifier: Apache-2.0
#include "ros2_messages.hpp"

#include <bit>
#include <cstring>

#include "film_stream.hpp"

namespace nearmesh::ros2 {
namespace {

static_assert(std::endian::native == std::endian::little);

/// Values one behind the other, each at a multiple of its size from the first.
class Cdr {
 public:
  template <class T>
  void put(T value) {
    bytes_.resize(kHead + (bytes_.size() - kHead + sizeof value - 1) / sizeof value * sizeof value);
    const std::size_t at = bytes_.size();
    bytes_.resize(at + sizeof value);
    std::memcpy(&bytes_[at], &value, sizeof value);
  }
  void put_text(const std::string& text) {
    put_count(text.size() + 1);
    bytes_.insert(bytes_.end(), text.begin(), text.end());
    bytes_.push_back(0);
  }
  void put_count(std::size_t count) { put(static_cast<std::uint32_t>(count)); }
  void put_vector(const std::array<double, 3>& vector) {
    for (const double x : vector) put(x);
  }
  void put_header(std::int64_t stamp_ns, const std::string& frame) {
    put(static_cast<std::int32_t>(stamp_ns / 1'000'000'000));
    put(static_cast<std::uint32_t>(stamp_ns % 1'000'000'000));
    put_text(frame);
  }
  [[nodiscard]] Bytes take() { return std::move(bytes_); }

 private:
  static constexpr std::size_t kHead = 4;
  Bytes bytes_{0, 1, 0, 0};  // CDR, little-endian
};

// ---- definitions --------------------------------------------------------------------------------

constexpr const char* kTime = "int32 sec\nuint32 nanosec\n";
constexpr const char* kHeader = "builtin_interfaces/Time stamp\nstring frame_id\n";
constexpr const char* kXyz = "float64 x\nfloat64 y\nfloat64 z\n";
constexpr const char* kXyzw = "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n";

std::string part(const char* name, const char* definition) {
  return std::string(80, '=') + "\nMSG: " + name + "\n" + definition;
}

void put_marker(Cdr& cdr, std::int64_t stamp_ns, const Marker& marker) {
  constexpr std::int32_t kAdd = 0, kDelete = 2;
  cdr.put_header(stamp_ns, marker.frame);
  cdr.put_text(marker.name_space);
  cdr.put(marker.id);
  cdr.put(static_cast<std::int32_t>(marker.kind));
  cdr.put(marker.points_m.empty() ? kDelete : kAdd);
  cdr.put_vector({});  // pose: that of the frame
  for (const double x : {0.0, 0.0, 0.0, 1.0}) cdr.put(x);
  if (marker.kind == Marker::Kind::kLineList)
    cdr.put_vector({marker.width_m, 0, 0});
  else
    cdr.put_vector({1, 1, 1});
  for (const float channel : marker.rgba) cdr.put(channel);
  cdr.put(std::int32_t{0});  // lifetime: until it is changed
  cdr.put(std::uint32_t{0});
  cdr.put(std::uint8_t{1});  // it goes with its frame
  cdr.put_count(marker.points_m.size());
  for (const auto& point : marker.points_m) cdr.put_vector(point);
  cdr.put_count(0);  // colours of points
  cdr.put_text("");  // texture
  cdr.put_header(0, "");
  cdr.put_text("");
  cdr.put_count(0);
  cdr.put_count(0);  // its coordinates
  cdr.put_text("");  // text
  cdr.put_text("");  // mesh
  cdr.put_text("");
  cdr.put_count(0);
  cdr.put(std::uint8_t{0});
}

}  // namespace

Type tf_message() {
  return {"tf2_msgs/msg/TFMessage",
          "geometry_msgs/TransformStamped[] transforms\n" +
              part("geometry_msgs/TransformStamped",
                   "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform "
                   "transform\n") +
              part("std_msgs/Header", kHeader) + part("builtin_interfaces/Time", kTime) +
              part("geometry_msgs/Transform",
                   "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n") +
              part("geometry_msgs/Vector3", kXyz) + part("geometry_msgs/Quaternion", kXyzw)};
}

Type marker_array() {
  return {"visualization_msgs/msg/MarkerArray",
          "visualization_msgs/Marker[] markers\n" +
              part("visualization_msgs/Marker",
                   "int32 LINE_LIST=5\nint32 TRIANGLE_LIST=11\nint32 ADD=0\nint32 DELETE=2\n"
                   "std_msgs/Header header\nstring ns\nint32 id\nint32 type\nint32 action\n"
                   "geometry_msgs/Pose pose\ngeometry_msgs/Vector3 scale\nstd_msgs/ColorRGBA "
                   "color\nbuiltin_interfaces/Duration lifetime\nbool frame_locked\n"
                   "geometry_msgs/Point[] points\nstd_msgs/ColorRGBA[] colors\nstring "
                   "texture_resource\nsensor_msgs/CompressedImage texture\n"
                   "visualization_msgs/UVCoordinate[] uv_coordinates\nstring text\nstring "
                   "mesh_resource\nvisualization_msgs/MeshFile mesh_file\nbool "
                   "mesh_use_embedded_materials\n") +
              part("std_msgs/Header", kHeader) + part("builtin_interfaces/Time", kTime) +
              part("builtin_interfaces/Duration", kTime) +
              part("geometry_msgs/Pose",
                   "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n") +
              part("geometry_msgs/Point", kXyz) + part("geometry_msgs/Vector3", kXyz) +
              part("geometry_msgs/Quaternion", kXyzw) +
              part("std_msgs/ColorRGBA", "float32 r\nfloat32 g\nfloat32 b\nfloat32 a\n") +
              part("sensor_msgs/CompressedImage",
                   "std_msgs/Header header\nstring format\nuint8[] data\n") +
              part("visualization_msgs/UVCoordinate", "float32 u\nfloat32 v\n") +
              part("visualization_msgs/MeshFile", "string filename\nuint8[] data\n")};
}

Type float64() { return {"std_msgs/msg/Float64", "float64 data\n"}; }

Bytes tf_message(std::int64_t stamp_ns, const std::vector<Transform>& transforms) {
  Cdr cdr;
  cdr.put_count(transforms.size());
  for (const Transform& transform : transforms) {
    cdr.put_header(stamp_ns, "world");
    cdr.put_text(transform.child_frame);
    cdr.put_vector(transform.pose.translation_m);
    const std::array<double, 4> wxyz = subscriber::FilmPose::quaternion(transform.pose.rotation);
    for (const std::size_t i : {1U, 2U, 3U, 0U}) cdr.put(wxyz[i]);
  }
  return cdr.take();
}

Bytes marker_array(std::int64_t stamp_ns, const std::vector<Marker>& markers) {
  Cdr cdr;
  cdr.put_count(markers.size());
  for (const Marker& marker : markers) put_marker(cdr, stamp_ns, marker);
  return cdr.take();
}

Bytes float64(double value) {
  Cdr cdr;
  cdr.put(value);
  return cdr.take();
}

std::string topic_part(const std::string& name) {
  std::string part;
  for (const char c : name) {
    const bool is_digit = c >= '0' && c <= '9';
    if (part.empty() && is_digit) part = "_";
    part += is_digit || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ? c : '_';
  }
  return part.empty() ? "_" : part;
}

}  // namespace nearmesh::ros2
