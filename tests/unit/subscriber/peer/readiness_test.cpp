// SPDX-License-Identifier: Apache-2.0
// Readiness of bodies and regions; what teleports or spawns is uncertain until it is known, and
// never free before.

#include <limits>
#include <set>

#include "core/base/stopwatch.hpp"
#include "half_spaces.hpp"
#include "local_host.hpp"
#include "nearmesh/core/query/certify.hpp"
#include "nearmesh/subscriber/peer/wait_ready.hpp"
#include "subscriber/peer/region_readiness.hpp"

namespace nearmesh::test {
namespace {

using subscriber::Readiness;
using subscriber::ReadyStage;
using subscriber::RegionReadiness;
using subscriber::wait_ready;

template <class Visit>
void for_each_face(const TreeView& tree, const Visit& visit) {
  std::vector<TreeEntry> open{tree.root()};
  while (!open.empty()) {
    const TreeEntry entry = open.back();
    open.pop_back();
    if (entry.kind() == TreeEntry::Kind::kInner)
      tree.for_each_child(entry, [&](const TreeEntry& child) { open.push_back(child); });
    if (entry.kind() == TreeEntry::Kind::kFaces) tree.for_each_face(entry, visit);
  }
}

Readiness readiness(const LocalHost& host, BodyId body) {
  const auto result = host.session->readiness(body);
  EXPECT_TRUE(result.is_ok()) << result.status().message();
  return result.is_ok() ? result.value() : Readiness{};
}

TEST(Readiness, GoesFromWaitingToAnsweringToCertified) {
  LocalHost host;
  host.spawn("one");
  EXPECT_EQ(readiness(host, kOne).stage, ReadyStage::kWaiting);  // no update yet
  host.channel->set_connected(false);
  host.update();
  EXPECT_NE(readiness(host, kOne).reason.find("no publisher found"), std::string::npos);
  host.channel->set_connected(true);
  host.update();
  EXPECT_EQ(readiness(host, kOne).stage, ReadyStage::kWaiting);
  EXPECT_NE(readiness(host, kOne).reason.find("no pose of body one"), std::string::npos);
  host.update({{kOne, above_ground(800, 0)}});
  EXPECT_EQ(readiness(host, kOne).stage, ReadyStage::kAnswering);
  EXPECT_NE(readiness(host, kOne).reason.find("nodes of model terrain are missing"),
            std::string::npos)
      << readiness(host, kOne).reason;
  ASSERT_GT(host.settle(), 0);
  EXPECT_EQ(readiness(host, kOne).stage, ReadyStage::kCertified);
  EXPECT_EQ(readiness(host, kOne).reason, "");
}

TEST(Readiness, OfABodyIsNotHeldUpByOthers) {
  LocalHost host;
  host.spawn("one");
  const BodyId lost =
      host.session->add_body({.name = "lost", .model = "no such model", .own = true}).value();
  ASSERT_TRUE(host.session->watch(kGround, lost).is_ok());
  for (int i = 0; i < 10; ++i) host.update({{kOne, above_ground(800, 0)}, {lost, {}}});
  EXPECT_EQ(readiness(host, kOne).stage, ReadyStage::kCertified);
  EXPECT_EQ(readiness(host, lost).stage, ReadyStage::kWaiting);
  EXPECT_NE(readiness(host, lost).reason.find("no such model"), std::string::npos);
  const Readiness ground = readiness(host, kGround);  // in both pairs
  EXPECT_EQ(ground.stage, ReadyStage::kWaiting);
  EXPECT_EQ(ground.pairs, 2U);
  EXPECT_EQ(ground.certified, 1U);
}

TEST(Readiness, IsNeverCertifiedForWhatNoUpdateHasAnswered) {
  LocalHost host;
  host.spawn("one");
  EXPECT_NE(readiness(host, kGround).stage, ReadyStage::kCertified);
  ASSERT_GT(host.settle({{kOne, above_ground(800, 30)}}), 0);
  // A new pair, a new place, a body without pairs.
  ASSERT_TRUE(host.session->place_body(kGround, {}).is_ok());
  EXPECT_EQ(readiness(host, kOne).stage, ReadyStage::kWaiting);
  EXPECT_NE(readiness(host, kOne).reason.find("not asked"), std::string::npos);
  ASSERT_GT(host.settle(), 0);
  host.spawn("two");
  EXPECT_EQ(readiness(host, kGround).stage, ReadyStage::kWaiting);
  EXPECT_EQ(readiness(host, kOne).stage, ReadyStage::kCertified);
  const BodyId alone =
      host.session->add_body({.name = "alone", .model = "aircraft", .own = true}).value();
  EXPECT_EQ(readiness(host, alone).stage, ReadyStage::kWaiting);
  EXPECT_NE(readiness(host, alone).reason.find("watched against nothing"), std::string::npos);
  EXPECT_EQ(host.session->readiness({}).status().code(), StatusCode::kNotFound);
}

TEST(WaitReady, BlocksUntilCertifiedOrUntilTheTimeIsOver) {
  LocalHost host;
  host.spawn("one");
  const auto ready = wait_ready(*host.session, kOne, 100, {{kOne, above_ground(800, 0)}});
  ASSERT_TRUE(ready.is_ok()) << ready.status().message();
  EXPECT_EQ(ready.value().readiness.stage, ReadyStage::kCertified);
  EXPECT_TRUE(ready.value().report.all_certified());

  host.spawn("two");  // without a pose
  const Stopwatch watch;
  const auto late = wait_ready(*host.session, kTwo, 0.05);
  EXPECT_GE(watch.seconds(), 0.05);
  ASSERT_TRUE(late.is_ok());
  EXPECT_EQ(late.value().readiness.stage, ReadyStage::kWaiting);
  EXPECT_NE(late.value().readiness.reason.find("no pose of body two"), std::string::npos);

  EXPECT_EQ(wait_ready(*host.session, BodyId{}, 1).status().code(), StatusCode::kNotFound);
  for (const double timeout_s : {-1.0, std::numeric_limits<double>::quiet_NaN()})
    EXPECT_EQ(wait_ready(*host.session, kTwo, timeout_s).status().code(),
              StatusCode::kInvalidArgument);
  EXPECT_EQ(wait_ready(*host.session, kOne, 1, {{BodyId{7}, {}}}).status().code(),
            StatusCode::kNotFound);
}

TEST(WaitReady, KeepsTheComplaintsOfAllUpdates) {
  LocalHost host;
  host.spawn("one");
  wire::BodyPose pose;  // of a body that this peer moves: a complaint of the first update alone
  pose.peer = 77;
  pose.body = "one";
  ASSERT_TRUE(host.channel->deliver(pose).is_ok());
  const auto ready = wait_ready(*host.session, kOne, 100, {{kOne, above_ground(800, 0)}});
  ASSERT_TRUE(ready.is_ok());
  ASSERT_EQ(ready.value().readiness.stage, ReadyStage::kCertified);
  ASSERT_EQ(ready.value().report.complaints.size(), 1U);
  EXPECT_NE(ready.value().report.complaints[0].find("another peer also moves body one"),
            std::string::npos);
}

// ---- teleport and spawn -------------------------------------------------------------------------
// The judge fails the test for every free answer that the full meshes contradict.

TEST(Teleport, NextToAnotherBodyIsUncertainUntilKnown) {
  LocalHost host({.lookahead_s = 0});
  host.spawn("one");
  host.spawn("two");
  ASSERT_TRUE(host.session->watch(kOne, kTwo).is_ok());
  const Motion there = above_ground(800, 60);
  Motion far = above_ground(20, 500), beside = there;
  ASSERT_GT(host.settle({{kOne, there}, {kTwo, far}}), 0);
  ASSERT_EQ(host.judge.contact, 0U);
  beside.pose.translation_m[0] += 0.5;  // well inside the other
  const FrameReport first = host.update({{kTwo, beside}});
  EXPECT_FALSE(is_certified(first.answers[2].answer.status))
      << to_string(first.answers[2].answer.status);
  EXPECT_EQ(readiness(host, kTwo).stage, ReadyStage::kAnswering);
  int updates = 0;
  FrameReport report;
  do {
    report = host.update();
    EXPECT_NE(report.answers[2].answer.status, AnswerStatus::kFree);
  } while (!report.all_certified() && ++updates < 50);
  EXPECT_EQ(report.answers[2].answer.status, AnswerStatus::kContact);
  EXPECT_EQ(readiness(host, kTwo).stage, ReadyStage::kCertified);
}

TEST(Teleport, OfManyBodiesToManyPlacesIsNeverWronglyFree) {
  Random random(11);
  LocalHost host({.lookahead_s = 0});
  host.spawn("one");
  host.spawn("two");
  ASSERT_TRUE(host.session->watch(kOne, kTwo).is_ok());
  std::uint64_t first_uncertain = 0;
  for (int jump = 0; jump < 60; ++jump) {
    const Motion one =
        above_ground(random.below(terrain().model.header.vertex_count), random.between(-2, 10));
    Motion two = one;
    for (double& x : two.pose.translation_m) x += random.between(-4, 4);
    first_uncertain += host.update({{kOne, one}, {kTwo, two}}).all_certified() ? 0 : 1;
    ASSERT_GT(host.settle(), 0) << "jump " << jump;
  }
  EXPECT_GT(first_uncertain, 0U);
  EXPECT_GT(host.judge.contact, 0U);
}

TEST(Spawn, MidSessionIsUncertainUntilKnown) {
  LocalHost host;
  host.spawn("one");
  const Motion there = above_ground(800, 60);
  ASSERT_GT(host.settle({{kOne, there}}), 0);
  host.spawn("two");
  ASSERT_TRUE(host.session->watch(kOne, kTwo).is_ok());
  const FrameReport without_pose = host.update();
  for (std::size_t pair : {1U, 2U}) {
    EXPECT_EQ(without_pose.answers[pair].answer.status, AnswerStatus::kUncertain);
    EXPECT_NE(without_pose.answers[pair].reason.find("no pose of body two"), std::string::npos);
  }
  EXPECT_TRUE(is_certified(without_pose.answers[0].answer.status));  // no barrier for the other
  const FrameReport first = host.update({{kTwo, there}});
  EXPECT_FALSE(is_certified(first.answers[2].answer.status));
  ASSERT_GT(host.settle(), 0);
  EXPECT_GT(host.judge.contact, 0U);
}

TEST(Spawn, OfAModelThatNoBodyUsedSoFarWorksToo) {
  LocalHost host;
  host.update();  // hello and headers came, and nobody used the aircraft
  host.spawn("one");
  host.update({{kOne, above_ground(800, 0)}});
  EXPECT_EQ(readiness(host, kOne).stage, ReadyStage::kAnswering) << readiness(host, kOne).reason;
  EXPECT_GT(host.settle(), 0);
}

// ---- regions ------------------------------------------------------------------------------------

TEST(RegionReadiness, IsResolvedWhereABodyIsAndNotElsewhere) {
  LocalHost host({.lookahead_s = 0});
  host.spawn("one");
  const auto around = [](const Motion& at, double half_m) {
    std::array<std::array<double, 3>, 2> box{at.pose.translation_m, at.pose.translation_m};
    for (double& x : box[0]) x -= half_m;
    for (double& x : box[1]) x += half_m;
    return box;
  };
  const auto at_one = around(above_ground(800, 0), 0.5),
             elsewhere = around(above_ground(20, 0), 0.5);
  const auto ready = [&](const auto& box) {
    return host.session->region_readiness(kGround, box[0], box[1]).value();
  };
  EXPECT_FALSE(ready(at_one).resolved);
  EXPECT_TRUE(std::isinf(ready(at_one).uncertainty_m));
  EXPECT_NE(ready(at_one).reason.find("no publisher found"), std::string::npos);

  host.update({{kOne, above_ground(800, 0)}});
  const RegionReadiness before = ready(at_one);
  EXPECT_FALSE(before.resolved);
  EXPECT_GT(before.unresolved_nodes, 0U);
  EXPECT_GT(before.missing_vertices, 0U);
  EXPECT_GT(before.uncertainty_m, 0);

  ASSERT_GT(host.settle(), 0);
  EXPECT_TRUE(ready(at_one).resolved) << ready(at_one).reason;
  EXPECT_EQ(ready(at_one).reason, "");
  EXPECT_FALSE(ready(elsewhere).resolved);
  const double far_m = 1e12;  // beyond any grid
  EXPECT_TRUE(
      host.session->region_readiness(kGround, {0, 0, far_m}, {1, 1, far_m}).value().resolved);
  EXPECT_FALSE(
      host.session->region_readiness(kGround, {-far_m, -far_m, -far_m}, {far_m, far_m, far_m})
          .value()
          .resolved);
}

TEST(RegionReadiness, ResolvedMeansThatEveryFaceThereIsHere) {
  // Refined where an aircraft touches; then every face of the full mesh with a corner in a box that
  // is said to be resolved must be exact.
  const ServedModel &ground = terrain(), &plane = aircraft();
  LocalModel local(ground.model.store, ground.model.header.grid);
  LocalModel other(plane.model.store, plane.model.header.grid);
  const Pose touching = above_ground(800, 0).pose;
  const auto posed = pose_pair(local.grid, {}, "ground", other.grid, touching, "one");
  const Require complete = [](NodeSpan) { return Status::ok(); };
  ASSERT_TRUE(
      certify(local, posed.value().a, complete, other, posed.value().b, complete, {}).is_ok());
  // Of half of what is unresolved there are half-spaces, some of which keep it clear of a box.
  Random directions(6);
  test::tell_half_spaces(local, test::TrueHalfSpaces(ground.model.store), directions);
  std::set<FaceKey> exact;
  for_each_face(local.view(), [&](const TreeFace& face) { exact.insert(face.key); });
  std::vector<TreeFace> all;
  for_each_face(ground.full.tree.view(), [&](const TreeFace& face) { all.push_back(face); });
  ASSERT_LT(exact.size(), all.size());

  Random random(5);
  int resolved = 0, faces = 0;
  for (int i = 0; i < 2000; ++i) {
    Vector3 lo_m{}, hi_m{};
    for (std::size_t k = 0; k < 3; ++k) {
      lo_m[k] = touching.translation_m[k] + random.between(-100, 100);
      hi_m[k] = lo_m[k] + random.between(0, 100);
    }
    const RegionReadiness ready = subscriber::lacks_in_box(local.view(), lo_m, hi_m);
    EXPECT_EQ(ready.resolved, ready.unresolved_nodes == 0 && ready.reason.empty());
    if (!ready.resolved) continue;
    ++resolved;
    for (const TreeFace& face : all)
      for (const GridPoint& corner : face.corners) {
        bool inside = true;
        for (int k = 0; k < 3; ++k) {
          const auto axis = static_cast<std::size_t>(k);
          const double at_m =
              local.grid.origin_m[axis] + std::ldexp(corner[k], local.grid.exponent);
          inside = inside && lo_m[axis] <= at_m && at_m <= hi_m[axis];
        }
        if (!inside) continue;
        ++faces;
        EXPECT_TRUE(exact.contains(face.key));
        break;
      }
  }
  EXPECT_GT(resolved, 0);
  EXPECT_GT(faces, 0);
}

TEST(RegionReadiness, RefusesABoxThatIsNone) {
  const LocalHost host;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(host.session->region_readiness(kGround, {0, 0, 1}, {1, 1, 0}).status().code(),
            StatusCode::kInvalidArgument);
  EXPECT_EQ(host.session->region_readiness(kGround, {nan, 0, 0}, {1, 1, 1}).status().code(),
            StatusCode::kInvalidArgument);
  EXPECT_EQ(host.session->region_readiness(BodyId{7}, {0, 0, 0}, {1, 1, 1}).status().code(),
            StatusCode::kNotFound);
}

}  // namespace
}  // namespace nearmesh::test
