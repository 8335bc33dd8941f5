// SPDX-License-Identifier: Apache-2.0
#pragma once
// Single bodies as peers say them: each alone in its part.

#include <map>
#include <string>

#include "nearmesh/subscriber/peer/channel.hpp"

namespace nearmesh::test {

struct Said {
  wire::BodyDirectory directory;
  wire::BodyPoses poses;
};

inline Said said_of(const wire::BodyPose& pose) {
  static std::map<std::string, std::uint32_t> parts;
  const std::uint32_t part =
      parts.try_emplace(pose.body, static_cast<std::uint32_t>(parts.size())).first->second;
  const std::uint32_t number = part * wire::kBodiesPerPart;
  return {
      {.peer = pose.peer, .part = part, .bodies = {{number, pose.body, "model of " + pose.body}}},
      {.peer = pose.peer,
       .part = part,
       .frame = pose.frame,
       .bodies = {{number,
                   pose.time_s,
                   {pose.pose, pose.linear_velocity_mps, pose.angular_velocity_radps}}}}};
}

inline void say(subscriber::Channel& channel, const wire::BodyPose& pose) {
  const Said said = said_of(pose);
  channel.send(said.directory);
  channel.send(said.poses);
}

}  // namespace nearmesh::test
