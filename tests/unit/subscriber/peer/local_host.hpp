// SPDX-License-Identifier: Apache-2.0
#pragma once
// A host as its own unit test would make one: models from files, a channel without a network, a
// session.

#include "judge.hpp"
#include "nearmesh/subscriber/peer/local_channel.hpp"

namespace nearmesh::test {

using subscriber::LocalChannel;

/// Terrain and aircraft are served; a placed "ground", and nothing else yet.
class LocalHost {
 public:
  explicit LocalHost(SessionOptions options = {}) {
    auto made = std::make_unique<LocalChannel>();
    channel = made.get();
    EXPECT_TRUE(made->add_model("terrain", terrain().open()).is_ok());
    EXPECT_TRUE(made->add_model("aircraft", aircraft().open()).is_ok());
    session = std::make_unique<Session>(std::move(made), options);
    EXPECT_EQ(session->add_body({.name = "ground", .model = "terrain"}).value(), kGround);
    EXPECT_TRUE(session->place_body(kGround, {}).is_ok());
  }
  /// An own aircraft, watched against the ground: the first is kOne, the second kTwo.
  BodyId spawn(const std::string& name) {
    const BodyId id = session->add_body({.name = name, .model = "aircraft", .own = true}).value();
    EXPECT_TRUE(session->watch(kGround, id).is_ok());
    return id;
  }
  /// One update, judged.
  FrameReport update(const std::vector<Session::OwnMotion>& motions = {}) {
    Result<FrameReport> report = session->update(frame_++, time_s, motions, 1);
    EXPECT_TRUE(report.is_ok()) << report.status().message();
    for (const std::string& line : report.value().complaints) ADD_FAILURE() << line;
    judge.check(report.value());
    return std::move(report).value();
  }
  /// Updates until all is certified: how many it took, 0 when 50 are not enough.
  int settle(const std::vector<Session::OwnMotion>& motions = {}) {
    for (int updates = 1; updates <= 50; ++updates)
      if (update(motions).all_certified()) return updates;
    return 0;
  }

  LocalChannel* channel = nullptr;  ///< the session's
  std::unique_ptr<Session> session;
  Judge judge;
  double time_s = 0;  ///< of the next update

 private:
  std::uint64_t frame_ = 0;
};

/// Over a vertex of the ground, so much above it.
inline Motion above_ground(std::uint32_t vertex, double height_m) {
  const BakedModel& ground = terrain().model;
  Motion motion;
  motion.pose.translation_m = position_m(ground.header, ground.store, {vertex});
  motion.pose.translation_m[2] += height_m;
  return motion;
}

}  // namespace nearmesh::test
