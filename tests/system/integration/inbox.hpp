// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a peer's channel gave, kept for tests.

#include <iterator>

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

}  // namespace nearmesh::test
