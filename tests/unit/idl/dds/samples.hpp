// SPDX-License-Identifier: Apache-2.0
#pragma once
// Valid messages with every field set, for the tests to spoil.

#include <limits>
#include <tuple>

#include "core/base/digest.hpp"
#include "nearmesh/idl/messages/topics.hpp"

namespace nearmesh::wire::test {

/// Of 1/8 m: as far as places may be.
inline constexpr std::int64_t kFarQuanta = std::int64_t{1} << 51;

inline Hello valid_hello() {
  Hello message;
  message.publisher = 0x1122334455667788;
  message.name = "rig 1";
  message.models = {{"bunny", {1, 11}, 100}, {"terrain 512", {2, 22}, 200, {3, 33}, {4, 120.5}}};
  return message;
}

inline MeshHeader valid_header() {
  MeshHeader message;
  message.name = "bunny";
  message.bytes = {1, 2, 3, 4, 5};
  message.content_hash = digest_of(message.bytes);
  return message;
}

inline RegionSubscription valid_subscription() {
  RegionSubscription message;
  message.peer = 42;
  message.request = 7;
  message.publisher = 8;
  message.content_hash = {1, 11};
  message.priority = 1;
  message.acknowledged_sequence = 17;
  message.window_bytes = 4096;
  message.region.attach = {{VertexId{3}, 10}, {VertexId{13}, 2}, {VertexId{50}, 2}};
  message.region.region = {GridBox{{{-5, 0, 1}}, {{5, 0, 9}}}, GridBox{{{1, 2, 3}}, {{4, 5, 6}}}};
  message.region.region[1].radius = 7;
  message.region.region[1].normal = {-60, 4, -1};
  message.region.region[1].slab_lo = -8;
  message.region.region[1].slab_hi = 1 << 10;
  message.region.region[1].min_extent = 6;
  message.region.max_splits = 99;
  return message;
}

inline RegionSubscription valid_certificate_subscription() {
  RegionSubscription message;
  message.peer = 42;
  message.request = 8;
  message.publisher = 8;
  CertificateRequest& told = message.certificate.emplace();
  told.horizon_s = 0.5F;
  told.margin_m = 0.25F;
  told.models = {{{1, 11}, 77, {}}, {{2, 12}, 78, {}}};
  told.pairs = {{.a = 0, .b = 1, .solid_b = true, .translation_m = {1, 2, 3}}};
  return message;
}

inline SplitBatchMessage valid_batch() {
  SplitBatchMessage message;
  message.publisher = 8;
  message.content_hash = {1, 11};
  message.request = 7;
  message.sequence = 3;
  message.last = true;
  message.is_piece = true;
  message.bytes = {9, 8, 7};
  return message;
}

/// Of three contents, in one sample.
inline SplitBatchMessage valid_joined_batches() {
  SplitBatchMessage message = valid_batch();
  message.is_piece = false;
  message.joined = {{{2, 22}, {1, 2, 3, 4, 5}}, {{3, 33}, {6}}};
  return message;
}

inline BodyPose valid_pose() {
  BodyPose pose;
  pose.peer = 42;
  pose.body = "robot/arm-1";
  pose.frame = 1000;
  pose.time_s = 1.5;
  pose.pose.translation_m = {1, 2, 3};
  pose.linear_velocity_mps = {0.1, 0.2, 0.3};
  pose.angular_velocity_radps = {4, 5, 6};
  return pose;
}

inline BodyPoses valid_poses() {
  const BodyPose pose = valid_pose();
  BodyPoses message;
  message.peer = 42;
  message.part = 3;
  message.frame = 1000;
  message.sequence = 77;
  message.bodies = {{21, 1.5, {pose.pose, pose.linear_velocity_mps, pose.angular_velocity_radps}},
                    {27, -2, {pose.pose, {}, {7, 8, 9}}}};
  return message;
}

inline BodyPromises valid_promises() {
  BodyPromises message;
  message.peer = 42;
  message.part = 2;
  message.from_s = 1.5;
  message.steps = 2048;
  message.sequence = 70'000;
  message.quantum = -3;
  message.bodies = {{64, {1, -2, 300}}, {70, {-100000, 0, 64}}, {95, {kFarQuanta, -kFarQuanta, 0}}};
  return message;
}

inline WantedPoses valid_wanted() {
  WantedPoses message;
  message.peer = 42;
  message.mover = 43;
  message.parts = {{0, 1}, {3, 0x41}};
  return message;
}

inline BodyDirectory valid_directory() {
  BodyDirectory message;
  message.peer = 42;
  message.part = 3;
  message.bodies = {{21, "robot/arm-1", "ur5", {5, 6}, true, 2, 6, 1.5}, {27, "crate", "box"}};
  return message;
}

inline ContactReport valid_report() {
  ContactReport message;
  message.peer = 42;
  message.body_a = "arm";
  message.body_b = "wall";
  message.frame = 9;
  message.time_s = 2.5;
  message.status = 1;
  message.clearance_m = 0.25;
  message.uncertainty_m = 0.5;
  message.pair_count = 3;
  message.asked = true;
  message.cut = true;
  message.answer_digest = 0x1020304050607080;
  message.a = {{1, 11}, 12, 13, 14, true, {.translation_m = {1, 2, 3}}, {Mover::kThere, 2.25, 4}};
  message.b = {{2, 21},
               22,
               23,
               0,
               false,
               {{0, -1, 0, 1, 0, 0, 0, 0, 1}, {4, 5, 6}},
               {Mover::kSilent, -7, std::numeric_limits<double>::infinity()}};
  message.pairs = {{FaceKey{VertexId{1}, 2}, FaceKey{VertexId{3}, 4}},
                   {FaceKey{VertexId{}, 6}, FaceKey{VertexId{7}, 8}}};
  message.world = {.is_a = true,
                   .reach_cells = 1U << 31,
                   .tiles = {{true, 0xfedcba9876543210, 1U << 31, 3}, {}, {true, 7, 0, 0}},
                   .missing_pages = {{5, 6}, {7, 8}}};
  return message;
}

inline WatchedBodies valid_watched() {
  WatchedBodies message;
  message.peer = 42;
  message.part = 3;
  message.edition = 5;
  message.horizon_s = 0.5;
  message.margin_m = 2;
  message.runs = {
      {.mover = 42, .first = 10, .count = 60, .content = {1, 11}},
      {.mover = 43,
       .first = 2,
       .count = 1,
       .content = {2, 21},
       .group = 4,
       .mask = 5,
       .max_age_s = std::numeric_limits<double>::infinity()},
      {.known = WatchedBodies::Known::kPromised, .mover = 43, .first = 3, .content = {2, 21}}};
  message.only_own = true;
  message.placed = {{"ground", {2, 21}, 2, 3, true, {{0, -1, 0, 1, 0, 0, 0, 0, 1}, {4, 5, 6}}},
                    {"tower/1", {3, 31}, 1, ~0U, false, {.translation_m = {1, 2, 3}}}};
  return message;
}

inline BoundsReport valid_bounds() {
  BoundsReport message;
  message.peer = 42;
  message.edition = 5;
  message.frame = 9;
  message.time_s = 2.5;
  message.places_digest = 0x1020304050607080;
  message.pairs = 499'500;
  message.clearance_m = 0.25F;
  message.horizon_s = 0.5F;
  message.rests_on_more = true;
  message.heard = {
      {.poses = 7, .promises = 0, .near = 9, .posed = {}},
      {.poses = 4'000'000'000U, .promises = 0, .near = 0, .posed = {}},
      {.poses = 0, .promises = 300, .near = 0, .posed = {{0, 17}, {3, 4'000'000'000U}}}};
  return message;
}

inline HeldDetail valid_held() {
  HeldDetail message;
  message.peer = 42;
  message.content_hash = {1, 11};
  message.model = "bunny";
  message.applied_batches = 12;
  message.last_request = 7;
  message.era = 3;
  message.state_digest = 0x1020304050607080;
  message.box_digest = 0x8070605040302010;
  message.heard = {{8, 17}, {9, 1}};
  message.nodes = {1, 2, 255};
  return message;
}

inline ProcessStatus valid_status() {
  ProcessStatus message;
  message.session = 42;
  message.is_publisher = true;
  message.name = "rig 1, left";
  message.host = "rig-1";
  message.process_id = 77;
  message.uptime_s = 12.5;
  message.bytes_per_s = 1e6;
  message.uncertainty_m = 0.25;
  message.peers = 3;
  message.watched_pairs = 5;
  message.certified_pairs = 4;
  message.requests = 100;
  message.refused = 1;
  message.batches = 2000;
  message.bytes = 2'000'000;
  message.lost_batches = 6;
  message.waiting_batches = 7;
  message.resident_bytes = 50'000'000;
  message.moved_bodies = 3;
  message.heard_bodies = 2;
  message.stale_bodies = 1;
  message.moved = {"arm", "robot/arm-1"};
  message.oldest_body = "wall";
  message.oldest_age_s = std::numeric_limits<double>::infinity();
  message.has_door = true;
  message.door_refused = {1, 2, 3, 4, 5, 6, 7, 8};
  message.models = {{"bunny", {1, 11}, 70000, 10, 35000}, {"terrain 512", {2, 22}, 500000, 0, 0}};
  message.complaints = {"first", "second: with, marks"};
  return message;
}

inline Echo valid_echo() {
  Echo message;
  message.from = 42;
  message.to = 43;
  message.number = 9;
  message.is_reply = true;
  message.bytes = {1, 2, 3};
  return message;
}

/// One of each topic of the table.
template <class Message>
Message valid() {
  return std::get<Message>(std::tuple(valid_hello(), valid_header(), valid_subscription(),
                                      valid_batch(), valid_poses(), NearPoses{valid_poses()},
                                      valid_wanted(), valid_promises(), valid_directory(),
                                      valid_report(), valid_watched(), valid_bounds(), valid_held(),
                                      valid_status(), valid_echo(), Probe{valid_echo()}));
}
/// use(message) with one of each.
template <class Use>
void for_each_valid(Use use) {
  for_each_topic([&]<class Message>(const Topic<Message>&) { use(valid<Message>()); });
}

}  // namespace nearmesh::wire::test
