// SPDX-License-Identifier: Apache-2.0
// A message of ROS 2 of any bytes, as it comes from whoever writes on a topic that moves a body.
// The first byte names the type. Holds: what is accepted as transforms survives the way to bytes
// and back; what is accepted as a pose is one.

#include <algorithm>

#include "fuzz_input.hpp"
#include "idl/messages/ros2_messages.hpp"

using namespace nearmesh;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::FuzzInput in(data, size);
  const bool is_tf = in.byte() % 2 == 0;
  // A buffer of just this size, so that a read beyond it is seen.
  const std::vector<std::uint8_t> bytes(in.rest().begin(), in.rest().end());
  std::vector<ros2::SaidPose> all;
  if (is_tf) {
    auto said = ros2::read_tf_message(bytes);
    if (said.is_ok()) all = std::move(said).value();
  } else if (auto said = ros2::read_pose_stamped(bytes); said.is_ok()) {
    all.push_back(std::move(said).value());
  }
  for (const ros2::SaidPose& said : all) {
    const Result<Pose> pose = ros2::to_pose(said, "body");
    if (!pose.is_ok()) continue;
    FUZZ_CHECK(check_pose(pose.value(), "body").is_ok());
    // Stamps of before 1970, or with too many nanoseconds, are written otherwise.
    const auto again =
        ros2::read_tf_message(ros2::tf_message(0, {{said.child_frame, pose.value()}}, said.frame));
    FUZZ_CHECK(again.is_ok() && again.value().size() == 1);
    FUZZ_CHECK(again.value()[0].frame == said.frame);
    FUZZ_CHECK(again.value()[0].child_frame == said.child_frame);
    FUZZ_CHECK(again.value()[0].translation_m == said.translation_m);
  }
  return 0;
}
