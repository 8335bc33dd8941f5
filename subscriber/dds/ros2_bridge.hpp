// SPDX-License-Identifier: Apache-2.0
#pragma once
// What ROS 2's tools see of a peer, and poses that ROS 2's programs say, on DDS as ROS 2 does:
// topics rt/NAME, types PACKAGE::msg::dds_::TYPE_, its default QoS. A participant and a thread of
// its own: nothing here touches the peer's channel, and no answer depends on what is written. What
// others say is refused or taken, and never ends anything.

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "idl/messages/ros2_messages.hpp"
#include "nearmesh/core/base/status.hpp"
#include "nearmesh/idl/dds/transport_options.hpp"
#include "nearmesh/idl/messages/messages.hpp"

namespace nearmesh::subscriber {

/// A body that ROS 2 moves: by transforms of a frame on /tf, or by PoseStamped on a topic.
struct Ros2Body {
  std::string body;
  std::string frame;  ///< child_frame_id on /tf; else
  std::string topic;  ///< as ROS 2 writes it, "/rig/pose"
};
/// "BODY": the frame of that name; "BODY=FRAME"; "BODY=/TOPIC". Errors: kInvalidArgument, saying
/// what was expected.
[[nodiscard]] Result<Ros2Body> parse_ros2_body(const std::string& text);

struct Ros2Options {
  /// Domain, interface, life signs, and who is looked for where. ROS 2 speaks UDP, whatever the
  /// transport.
  wire::TransportOptions transport;
  std::string frame = ros2::kWorld;  ///< what poses are in, those written and those taken
  bool writes = false;
  std::vector<Ros2Body> moved;
};

/// All that is to be seen now: what is not in it is taken away.
struct Ros2View {
  std::int64_t stamp_ns = 0;
  std::vector<ros2::Transform> moving;
  std::vector<ros2::Transform> placed;  ///< on /tf_static
  std::vector<ros2::Marker> contacts;
  std::vector<ros2::Marker> meshes;  ///< those that changed
};

/// Threads: one at a time; no call waits for the network.
class Ros2Bridge {
 public:
  /// Errors: kInvalidArgument naming the option; kUnsupported with security, since all of this goes
  /// out in the clear; kIo when Fast DDS refuses.
  [[nodiscard]] static Result<std::unique_ptr<Ros2Bridge>> create(const Ros2Options& options);
  ~Ros2Bridge();

  /// Is written soon, unless the next comes first; meshes in any case.
  void tell(Ros2View view);
  /// Somebody reads meshes. A number that grows with each who comes, and once more soon after: they
  /// have not seen what was written before.
  struct MeshReaders {
    bool are_there = false;
    std::uint64_t came = 0;
  };
  [[nodiscard]] MeshReaders mesh_readers() const;

  /// A body's latest pose, if it came since the last call. It is never at rest: who says nothing
  /// more shall not be taken for one who stays where he is, so a motion without velocity has 1e-9
  /// m/s.
  struct Heard {
    std::size_t moved = 0;  ///< its place in Ros2Options::moved
    std::int64_t stamp_ns = 0;
    Motion motion;
  };
  [[nodiscard]] std::vector<Heard> take_heard();

  struct Counts {
    std::uint64_t taken = 0;  ///< poses of the bodies in Ros2Options::moved
    /// Messages that cannot be read, poses that are none or in another frame.
    std::uint64_t refused = 0;
    std::uint64_t strange = 0;  ///< transforms of other frames
  };
  [[nodiscard]] Counts counts() const;
  [[nodiscard]] std::vector<std::string> take_complaints();

 private:
  class Impl;
  explicit Ros2Bridge(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace nearmesh::subscriber
