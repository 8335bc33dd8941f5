// SPDX-License-Identifier: Apache-2.0
#pragma once
// Messages of ROS 2 that others' tools draw, as bytes (takes plain structs, gives CDR): transforms,
// markers, numbers; and those that say where bodies are, read. No ROS is needed. Field orders and
// numbers are those of ROS 2's interface packages (geometry_msgs, tf2_msgs, std_msgs,
// visualization_msgs), as of Humble.

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "nearmesh/core/base/status.hpp"
#include "nearmesh/core/geometry/pose.hpp"

namespace nearmesh::ros2 {

/// A type's name, and its definition with those of the types in it, as MCAP's `ros2msg` has them.
struct Type {
  const char* name;
  std::string definition;
};
[[nodiscard]] Type tf_message();    ///< tf2_msgs/msg/TFMessage
[[nodiscard]] Type marker_array();  ///< visualization_msgs/msg/MarkerArray
[[nodiscard]] Type float64();       ///< std_msgs/msg/Float64

using Bytes = std::vector<std::uint8_t>;  ///< CDR, little-endian, with its encapsulation

inline constexpr const char* kWorld = "world";  ///< the frame that everything is in, unless told

/// Where a body is in the frame `frame`.
struct Transform {
  std::string child_frame;
  Pose pose;
};
[[nodiscard]] Bytes tf_message(std::int64_t stamp_ns, const std::vector<Transform>& transforms,
                               const std::string& frame = kWorld);

struct Marker {
  enum class Kind : std::int32_t { kLineList = 5, kTriangleList = 11 };
  std::string frame;  ///< in which the points are
  std::string name_space;
  std::int32_t id = 0;
  Kind kind = Kind::kLineList;
  double width_m = 0;  ///< of lines
  std::array<float, 4> rgba{};
  std::uint32_t lifetime_s = 0;                 ///< 0: until it is changed
  std::vector<std::array<double, 3>> points_m;  ///< by two or three; none: the marker goes
};
[[nodiscard]] Bytes marker_array(std::int64_t stamp_ns, const std::vector<Marker>& markers);

[[nodiscard]] Bytes float64(double value);

/// A pose as somebody else says it: nothing of it was checked but that it can be read.
struct SaidPose {
  std::int64_t stamp_ns = 0;
  std::string frame;        ///< in which it is
  std::string child_frame;  ///< of a transform: whose it is
  std::array<double, 3> translation_m{};
  std::array<double, 4> wxyz{};
};
/// geometry_msgs/msg/PoseStamped and tf2_msgs/msg/TFMessage, of either byte order. Trusts no count.
/// Errors: kCorrupt where the bytes are not such a message: too few, too many, another
/// encapsulation.
[[nodiscard]] Result<SaidPose> read_pose_stamped(std::span<const std::uint8_t> cdr);
[[nodiscard]] Result<std::vector<SaidPose>> read_tf_message(std::span<const std::uint8_t> cdr);
/// What it says, as a pose of a body. Errors: kInvalidArgument, naming `body`: not finite, too far,
/// no rotation.
[[nodiscard]] Result<Pose> to_pose(const SaidPose& said, const std::string& body);

/// A name made of what topics of ROS 2 may have: letters, digits and lines; no digit comes first.
[[nodiscard]] std::string topic_part(const std::string& name);

}  // namespace nearmesh::ros2
