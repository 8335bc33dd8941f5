// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a peer's channel gave, kept for tests.

#include <cstdint>
#include <iterator>
#include <set>
#include <string>
#include <utility>

#include "nearmesh/subscriber/peer/channel.hpp"

namespace nearmesh::test {

/// Takes what has come and appends it to what came before.
inline void take_into(subscriber::Channel& channel, subscriber::Channel::Inbox& all) {
  subscriber::Channel::Inbox now = channel.take();
  const auto append = [](auto& to, auto& from) {
    to.insert(to.end(), std::make_move_iterator(from.begin()), std::make_move_iterator(from.end()));
  };
  append(all.hellos, now.hellos);
  append(all.lost_publishers, now.lost_publishers);
  append(all.headers, now.headers);
  all.refused_headers += now.refused_headers;
  all.refused_poses += now.refused_poses;
  append(all.batches, now.batches);
  append(all.bodies, now.bodies);
  append(all.poses, now.poses);
  append(all.promises, now.promises);
  append(all.wanted, now.wanted);
  for (const auto& [body, mover] : now.movers) all.movers[body] = mover;
  append(all.complaints, now.complaints);
}

using Heard = std::set<std::pair<std::string, std::uint64_t>>;
/// The poses that came, by body and frame.
inline Heard heard_in(const subscriber::Channel::Inbox& inbox) {
  Heard heard;
  for (const wire::BodyPose& pose : inbox.poses) heard.emplace(pose.body, pose.frame);
  return heard;
}

}  // namespace nearmesh::test
