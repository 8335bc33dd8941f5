// SPDX-License-Identifier: Apache-2.0
#include "idl/dds/routes.hpp"

#include <gtest/gtest.h>

#include "idl/dds/type_support.hpp"

namespace nearmesh::wire {
namespace {

constexpr SessionId kMover = 0xa0, kPeer = 0xb0;

Routes::Participant participant(std::uint8_t n) {
  Routes::Participant made{};
  made[11] = n;
  return made;
}

template <class Message>
std::vector<std::uint8_t> bytes_of(const Message& message) {
  TypeOf<Message> type;
  typename TypeOf<Message>::Data data;
  encode(message, data);
  return to_cdr(type, data);
}

/// Of the first body of a part.
std::vector<std::uint8_t> near_of(std::uint32_t part) {
  NearPoses poses;
  poses.peer = kMover;
  poses.part = part;
  poses.bodies.push_back({.number = part * kBodiesPerPart});
  return bytes_of(poses);
}

WantedPoses wish_for(std::initializer_list<std::uint32_t> parts) {
  WantedPoses wanted{.peer = kPeer, .mover = kMover};
  for (const std::uint32_t part : parts) wanted.parts.push_back({part, 1});
  return wanted;
}

TEST(Routes, WhatAStrangerWantsInAPeersNameDisplacesNothing) {
  Routes routes(kMover);
  const auto peer = participant(1), stranger = participant(2);
  routes.want(wish_for({3}), peer);
  EXPECT_TRUE(routes.gets_near_poses(near_of(3), peer));
  EXPECT_FALSE(routes.gets_near_poses(near_of(4), peer));
  EXPECT_FALSE(routes.gets_near_poses(near_of(3), stranger));
  routes.want(wish_for({4}), stranger);
  EXPECT_TRUE(routes.gets_near_poses(near_of(3), peer));
  EXPECT_FALSE(routes.gets_near_poses(near_of(4), peer));
  EXPECT_TRUE(routes.gets_near_poses(near_of(4), stranger));
  // Nor that it wants nothing.
  routes.want(wish_for({}), stranger);
  EXPECT_TRUE(routes.gets_near_poses(near_of(3), peer));
  EXPECT_FALSE(routes.gets_near_poses(near_of(4), stranger));
  routes.want(wish_for({}), peer);
  EXPECT_FALSE(routes.gets_near_poses(near_of(3), peer));
}

// Movers come and go for weeks: what is wanted of one that comes then goes to nobody else all the
// same.
TEST(Routes, WhoComesAfterManyThatAreGoneIsFound) {
  Routes routes(kPeer);
  const auto there = participant(1), gone = participant(2);
  for (SessionId mover = 1; mover <= 2 * Routes::kMaxPeers; ++mover) {
    routes.find(kMover + mover, gone);
    routes.lose(gone);
  }
  routes.find(kMover, there);
  const std::vector<std::uint8_t> wish = bytes_of(wish_for({3}));
  EXPECT_TRUE(routes.gets_wanted_poses(wish, there));
  EXPECT_FALSE(routes.gets_wanted_poses(wish, gone));
  routes.lose(gone);
  EXPECT_FALSE(routes.gets_wanted_poses(wish, gone));
  routes.lose(there);
  EXPECT_TRUE(routes.gets_wanted_poses(wish, gone));  // nobody knows where it is
  // Of one that spoke through more participants than are kept each gets what is for it.
  for (std::uint8_t n = 10; n < 20; ++n) routes.find(kMover, participant(n));
  routes.lose(participant(10));
  EXPECT_TRUE(routes.gets_wanted_poses(wish, participant(19)));
}

// Those that are there now are counted, after as many in weeks as are kept.
TEST(Routes, WhatGoesToWhoComesAfterManyThatAreGoneIsCounted) {
  Routes routes(kMover);
  const auto there = participant(1);
  const std::vector<std::uint8_t> near = near_of(3);
  WantedPoses wanted{.mover = kMover};
  for (std::uint32_t i = 0; i <= Routes::kMaxPeers; ++i) {
    wanted.peer = kPeer + 1 + i;
    wanted.parts = {{3, 1}};
    routes.want(wanted, there);
    EXPECT_TRUE(routes.gets_near_poses(near, there));
    wanted.parts = {};
    routes.want(wanted, there);
  }
  EXPECT_EQ(routes.sent().at(wanted.peer), 1U);
  EXPECT_LE(routes.sent().size(), Routes::kMaxPeers);
}

TEST(Routes, SessionsOfOneParticipantWantEachTheirOwn) {
  Routes routes(kMover);
  const auto host = participant(1);
  WantedPoses other = wish_for({4});
  other.peer = kPeer + 1;
  routes.want(wish_for({3}), host);
  routes.want(other, host);
  EXPECT_TRUE(routes.gets_near_poses(near_of(3), host));
  EXPECT_TRUE(routes.gets_near_poses(near_of(4), host));
  routes.want(wish_for({}), host);
  EXPECT_FALSE(routes.gets_near_poses(near_of(3), host));
  EXPECT_TRUE(routes.gets_near_poses(near_of(4), host));
  EXPECT_EQ(routes.sent(), (std::map<SessionId, std::uint64_t>{{kPeer, 1}, {kPeer + 1, 2}}));
}

TEST(Routes, WishesReachTheirMoverThoughAStrangerBearsItsName) {
  Routes routes(kPeer);
  const auto mover = participant(1), stranger = participant(2), other = participant(3);
  const auto wish = bytes_of(wish_for({3}));
  EXPECT_TRUE(routes.gets_wanted_poses(wish, other)) << "nobody knows yet where the mover is";
  routes.find(kMover, mover);
  EXPECT_FALSE(routes.gets_wanted_poses(wish, other));
  routes.find(kMover, stranger);
  EXPECT_TRUE(routes.gets_wanted_poses(wish, mover));
  EXPECT_FALSE(routes.gets_wanted_poses(wish, other));
  // However many there are.
  for (std::uint8_t n = 10; n < 40; ++n) routes.find(kMover, participant(n));
  routes.find(kMover, mover);
  EXPECT_TRUE(routes.gets_wanted_poses(wish, mover));
}

Handle wisher(std::uint8_t n) {
  Handle handle;
  handle.value[11] = n;
  handle.value[15] = 1;
  return handle;
}

TEST(Wishers, FirstWriterSpeaksForAPeerUntilItIsGoneOrSilent) {
  Wishers wishers;
  const Wishers::Time start{};
  const auto at = [&](double seconds) {
    return start + std::chrono::milliseconds(static_cast<int>(seconds * 1000));
  };
  EXPECT_EQ(wishers.claim(kPeer, wisher(1), at(0)), Wishers::Claim::kOwn);
  EXPECT_EQ(wishers.claim(kPeer, wisher(2), at(1)), Wishers::Claim::kOthers);
  EXPECT_EQ(wishers.claim(kPeer, wisher(1), at(2)), Wishers::Claim::kOwn);
  // That it was contested takes nothing from its time.
  EXPECT_EQ(wishers.claim(kPeer, wisher(2), at(2 + kWantedFor_s - 0.1)), Wishers::Claim::kOthers);
  EXPECT_EQ(wishers.claim(kPeer, wisher(2), at(2 + kWantedFor_s + 0.1)), Wishers::Claim::kOwn);
  EXPECT_EQ(wishers.claim(kPeer, wisher(1), at(6)), Wishers::Claim::kOthers);
  wishers.forget(wisher(1));
  EXPECT_EQ(wishers.claim(kPeer, wisher(1), at(6)), Wishers::Claim::kOthers);
  wishers.forget(wisher(2));
  EXPECT_EQ(wishers.claim(kPeer, wisher(1), at(6)), Wishers::Claim::kOwn);
}

TEST(Wishers, OneWriterMaySpeakForManyAsARouterDoes) {
  Wishers wishers;
  const Wishers::Time now{};
  for (SessionId peer = 1; peer <= Wishers::kMaxOfOne; ++peer)
    ASSERT_EQ(wishers.claim(peer, wisher(1), now), Wishers::Claim::kOwn) << peer;
  // But for so many that it leaves room for others.
  EXPECT_EQ(wishers.claim(Wishers::kMaxOfOne + 1, wisher(1), now), Wishers::Claim::kFull);
  EXPECT_EQ(wishers.claim(Wishers::kMaxOfOne + 1, wisher(2), now), Wishers::Claim::kOwn);
  EXPECT_EQ(wishers.claim(1, wisher(1), now), Wishers::Claim::kOwn);
  // What it said ends.
  const Wishers::Time later = now + std::chrono::seconds(static_cast<int>(kWantedFor_s) + 1);
  EXPECT_EQ(wishers.claim(Wishers::kMaxOfOne + 2, wisher(1), later), Wishers::Claim::kOwn);
}

}  // namespace
}  // namespace nearmesh::wire
