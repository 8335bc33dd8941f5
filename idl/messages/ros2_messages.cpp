// SPDX-License-Identifier: Apache-2.0
#include "ros2_messages.hpp"

#include <algorithm>
#include <bit>
#include <cstring>
#include <utility>

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
    constexpr std::int64_t kSecond_ns = 1'000'000'000;
    const std::int64_t part_ns = (stamp_ns % kSecond_ns + kSecond_ns) % kSecond_ns;
    put(static_cast<std::int32_t>((stamp_ns - part_ns) / kSecond_ns));
    put(static_cast<std::uint32_t>(part_ns));
    put_text(frame);
  }
  [[nodiscard]] Bytes take() { return std::move(bytes_); }

 private:
  static constexpr std::size_t kHead = 4;
  Bytes bytes_{0, 1, 0, 0};  // CDR, little-endian
};

/// The other way: after the first value that is not there, all are 0 and is_ok() is false.
class CdrReader {
 public:
  explicit CdrReader(std::span<const std::uint8_t> cdr) : cdr_(cdr) {
    is_ok_ = cdr.size() >= kHead && cdr[0] == 0 && cdr[1] <= 1;
    is_swapped_ = is_ok_ && cdr[1] == 0;  // big-endian
  }
  template <class T>
  T take() {
    const std::size_t at = kHead + (at_ - kHead + sizeof(T) - 1) / sizeof(T) * sizeof(T);
    std::array<std::uint8_t, sizeof(T)> raw{};
    if (has(at, sizeof(T))) {
      std::copy_n(&cdr_[at], sizeof(T), raw.begin());
      at_ = at + sizeof(T);
    }
    if (is_swapped_) std::reverse(raw.begin(), raw.end());
    return std::bit_cast<T>(raw);
  }
  std::string take_text() {
    const std::size_t size = take<std::uint32_t>();
    if (!has(at_, size) || size == 0 || cdr_[at_ + size - 1] != 0) {
      is_ok_ = false;
      return {};
    }
    const std::size_t from = std::exchange(at_, at_ + size);
    return {reinterpret_cast<const char*>(&cdr_[from]), size - 1};
  }
  /// Of elements of at least so many bytes.
  std::size_t take_count(std::size_t least_bytes) {
    const std::size_t count = take<std::uint32_t>();
    return has(at_, count * least_bytes) ? count : 0;
  }
  [[nodiscard]] bool is_ok() const { return is_ok_; }
  /// Up to three bytes of padding follow a sample on the wire.
  [[nodiscard]] bool is_at_end() const { return is_ok_ && cdr_.size() - at_ < 4; }

 private:
  static constexpr std::size_t kHead = 4;
  bool has(std::size_t at, std::size_t size) {
    is_ok_ = is_ok_ && at <= cdr_.size() && size <= cdr_.size() - at;
    return is_ok_;
  }

  std::span<const std::uint8_t> cdr_;
  std::size_t at_ = kHead;
  bool is_ok_ = false, is_swapped_ = false;
};

/// Stamp, frame; of a transform then the child's frame.
SaidPose take_header(CdrReader& cdr) {
  SaidPose said;
  const std::int64_t seconds = cdr.take<std::int32_t>();
  said.stamp_ns = seconds * 1'000'000'000 + cdr.take<std::uint32_t>();
  said.frame = cdr.take_text();
  return said;
}

void take_placement(CdrReader& cdr, SaidPose& said) {
  for (double& x : said.translation_m) x = cdr.take<double>();
  for (const std::size_t i : {1U, 2U, 3U, 0U}) said.wxyz[i] = cdr.take<double>();
}

Status no_such_message(const char* type, std::size_t size) {
  return {StatusCode::kCorrupt, std::to_string(size) + " bytes that are no " + type};
}

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
  cdr.put(static_cast<std::int32_t>(marker.lifetime_s));
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

Bytes tf_message(std::int64_t stamp_ns, const std::vector<Transform>& transforms,
                 const std::string& frame) {
  Cdr cdr;
  cdr.put_count(transforms.size());
  for (const Transform& transform : transforms) {
    cdr.put_header(stamp_ns, frame);
    cdr.put_text(transform.child_frame);
    cdr.put_vector(transform.pose.translation_m);
    const std::array<double, 4> wxyz = quaternion_of_rotation(transform.pose.rotation);
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

Result<SaidPose> read_pose_stamped(std::span<const std::uint8_t> bytes) {
  CdrReader cdr(bytes);
  SaidPose said = take_header(cdr);
  take_placement(cdr, said);
  if (!cdr.is_at_end()) return no_such_message("PoseStamped", bytes.size());
  return said;
}

Result<std::vector<SaidPose>> read_tf_message(std::span<const std::uint8_t> bytes) {
  // Time, two empty names, seven numbers; less what aligns them.
  constexpr std::size_t kLeastBytes = 74;
  CdrReader cdr(bytes);
  const std::size_t count = cdr.take_count(kLeastBytes);
  std::vector<SaidPose> all;
  for (std::size_t i = 0; i < count && cdr.is_ok(); ++i) {
    SaidPose said = take_header(cdr);
    said.child_frame = cdr.take_text();
    take_placement(cdr, said);
    all.push_back(std::move(said));
  }
  if (!cdr.is_at_end()) return no_such_message("TFMessage", bytes.size());
  return all;
}

Result<Pose> to_pose(const SaidPose& said, const std::string& body) {
  auto rotation = rotation_of_quaternion(said.wxyz, body);
  NEARMESH_RETURN_IF_ERROR(rotation);
  const Pose pose{.rotation = rotation.value(), .translation_m = said.translation_m};
  NEARMESH_RETURN_IF_ERROR(check_pose(pose, body));
  return pose;
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
