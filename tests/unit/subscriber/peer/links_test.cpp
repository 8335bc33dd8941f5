// SPDX-License-Identifier: Apache-2.0
// Robots: bodies whose poses count together. Whatever is lost or late, no frame of any peer has
// links of two instants.
#include <cmath>
#include <filesystem>
#include <optional>

#include "nearmesh/core/meshio/import.hpp"
#include "tests/support/kept_channel.hpp"
#include "world.hpp"

namespace nearmesh {
namespace {

using subscriber::BodyId;
using subscriber::BodyOptions;
using test::FrameReport;
using test::KeptChannel;
using test::KeptSamples;
using test::Session;
using test::SessionOptions;
using test::World;

constexpr wire::SessionId kRobotMover = 0xc1, kLooker = 0xc2;

/// One peer moves a robot, another looks at it.
class Links : public ::testing::Test {
 protected:
  Links() {
    world_.judges = false;  // bodies have other names here
    world_.start_publisher();
    mover_ = std::make_unique<Session>(
        std::make_unique<KeptChannel>(world_.bus.make_peer(kRobotMover), sent_),
        test::quick_options());
    looker_ = std::make_unique<Session>(world_.bus.make_peer(kLooker), test::quick_options());
    looker_->watch_all();
    looker_->discover_bodies();
  }
  std::vector<BodyId> add_links(std::size_t count, const std::string& robot = "arm") {
    std::vector<BodyId> links;
    for (std::size_t i = 0; i < count; ++i)
      links.push_back(
          mover_
              ->add_body(
                  {.name = robot + "/" + std::to_string(i), .model = "aircraft", .own = true})
              .value());
    return links;
  }
  /// Link i at the instant: both can be read from it.
  static Motion at_instant(std::size_t i, std::uint64_t instant) {
    Motion motion;
    motion.pose.translation_m = {1000.0 * static_cast<double>(i), static_cast<double>(instant), 0};
    motion.linear_velocity_mps = {0, 20, 0};
    return motion;
  }
  static std::vector<Session::OwnMotion> all_at(const std::vector<BodyId>& links,
                                                std::uint64_t instant) {
    std::vector<Session::OwnMotion> motions;
    for (std::size_t i = 0; i < links.size(); ++i)
      motions.push_back({links[i], at_instant(i, instant)});
    return motions;
  }
  /// Of each body that the looker has a pose of, the instant that it has it of.
  std::map<std::string, std::uint64_t> instants() const {
    std::map<std::string, std::uint64_t> found;
    for (std::uint32_t id = 0; id < 64; ++id)
      if (const auto motion = looker_->motion_of(BodyId{id}))
        found[looker_->name_of(BodyId{id})] =
            static_cast<std::uint64_t>(motion->pose.translation_m[1]);
    return found;
  }
  /// The looker's frame. Out: of which instant it has all links, never some of one and some of
  /// another; none where it has no pose of any.
  std::optional<std::uint64_t> look(std::uint64_t frame, std::size_t links) {
    world_.round(*looker_, frame);
    const auto found = instants();
    if (found.empty()) return std::nullopt;
    EXPECT_EQ(found.size(), links) << "frame " << frame;
    for (const auto& [name, instant] : found)
      EXPECT_EQ(instant, found.begin()->second) << name << ", frame " << frame;
    return found.begin()->second;
  }
  [[nodiscard]] std::size_t sent_poses() const {
    return static_cast<std::size_t>(std::count_if(
        sent_.begin(), sent_.end(),
        [](const test::KeptSample& sample) { return sample.as<wire::BodyPoses>() != nullptr; }));
  }

  World world_;
  KeptSamples sent_;
  std::unique_ptr<Session> mover_, looker_;
};

TEST_F(Links, OfUpToSevenTravelInOneSampleWhateverWasNumberedBefore) {
  const BodyId crate =
      mover_->add_body({.name = "crate", .model = "aircraft", .own = true}).value();
  const std::vector<BodyId> links = add_links(7);
  ASSERT_TRUE(mover_->link_bodies(links).is_ok());
  for (std::uint64_t frame = 0; frame < 10; ++frame)
    world_.round(*mover_, frame, all_at(links, frame));
  EXPECT_EQ(sent_poses(), 10U);
  world_.round(*mover_, 10, {{crate, Motion{}}});
  EXPECT_EQ(sent_poses(), 11U);
}

TEST_F(Links, NoFrameMixesInstantsWhateverIsLostOrLate) {
  const std::vector<BodyId> links = add_links(20);  // three parts
  ASSERT_TRUE(mover_->link_bodies(links).is_ok());
  world_.bus.on_poses = {.lose = 0.01, .repeat = 0.1, .max_delay = 3};
  std::set<std::uint64_t> seen;
  std::uint64_t last = 0;
  for (std::uint64_t frame = 0; frame < 600 && !HasFailure(); ++frame) {
    world_.round(*mover_, frame, all_at(links, frame));
    const auto instant = look(frame, links.size());
    if (!instant) continue;
    EXPECT_GE(*instant, last);
    last = *instant;
    seen.insert(*instant);
  }
  EXPECT_GT(seen.size(), 200U);
  EXPECT_GT(last, 580U);
}

// A host may set its robot right within a frame: two updates of one time.
TEST_F(Links, NoFrameMixesTwoUpdatesOfOneTimeWhateverIsLost) {
  const std::vector<BodyId> links = add_links(20);
  ASSERT_TRUE(mover_->link_bodies(links).is_ok());
  world_.bus.on_poses = {.lose = 0.02};
  std::set<std::uint64_t> seen;
  for (std::uint64_t frame = 0; frame < 300 && !HasFailure(); ++frame) {
    for (const std::uint64_t update : {2 * frame, 2 * frame + 1})
      world_.round(*mover_, frame, all_at(links, update));
    if (const auto instant = look(frame, links.size())) seen.insert(*instant);
  }
  EXPECT_GT(seen.size(), 150U);
}

TEST_F(Links, ATimeThatGoesBackIsTaken) {
  const std::vector<BodyId> links = add_links(9);
  ASSERT_TRUE(mover_->link_bodies(links).is_ok());
  for (const std::uint64_t frame : {100, 101, 5, 6}) {
    world_.round(*mover_, frame, all_at(links, frame));
    world_.round(*looker_, frame);
    ASSERT_EQ(instants().size(), links.size());
    for (const auto& [name, instant] : instants()) EXPECT_EQ(instant, frame) << name;
  }
}

// The parts of a robot at rest are repeated together: of one by itself, and of one beside a body
// that is set down elsewhere now and then.
TEST_F(Links, ARobotAtRestStaysKnown) {
  const std::vector<BodyId> links = add_links(10);
  ASSERT_TRUE(mover_->link_bodies(links).is_ok());
  const BodyId crate =
      mover_->add_body({.name = "crate", .model = "aircraft", .own = true}).value();
  const std::vector<BodyId> alone = add_links(10, "alone");
  ASSERT_TRUE(mover_->link_bodies(alone).is_ok());
  std::vector<Session::OwnMotion> rest;
  for (std::size_t i = 0; i < links.size(); ++i) {
    rest.push_back({links[i], {.pose = at_instant(i, 0).pose}});
    rest.push_back({alone[i], {.pose = at_instant(i + 10, 0).pose}});
  }
  for (std::uint64_t frame = 0; frame < 200; ++frame) {
    std::vector<Session::OwnMotion> motions;
    if (frame % 5 == 0) motions.push_back({crate, {.pose = at_instant(30, frame).pose}});
    if (frame == 0) motions.insert(motions.end(), rest.begin(), rest.end());
    world_.round(*mover_, frame, motions);
    const FrameReport report = world_.round(*looker_, frame);
    if (frame <= 5) continue;
    EXPECT_TRUE(report.unknown.empty()) << report.unknown.front().reason;
  }
}

TEST_F(Links, MotionsOfSomeAreRefusedAndChangeNothing) {
  const std::vector<BodyId> links = add_links(4);
  ASSERT_TRUE(mover_->link_bodies(links).is_ok());
  world_.round(*mover_, 0, all_at(links, 0));
  std::vector<Session::OwnMotion> some = all_at(links, 1);
  some.pop_back();
  const auto refused = mover_->update(1, 0.05, some, 1);
  EXPECT_EQ(refused.status().code(), StatusCode::kInvalidArgument);
  EXPECT_NE(refused.status().message().find("4 links, of which 3"), std::string::npos)
      << refused.status().message();
  EXPECT_EQ(mover_->motion_of(links[0])->pose.translation_m[1], 0);
  EXPECT_TRUE(mover_->update(1, 0.05, {}, 1).is_ok());
  EXPECT_EQ(mover_->place_body(links[0], {}).code(), StatusCode::kInvalidArgument);
}

TEST_F(Links, WhatCannotBeLinkedIsRefused) {
  const std::vector<BodyId> links = add_links(3);
  const BodyId other = mover_->add_body({.name = "other", .model = "aircraft"}).value(),
               fast =
                   mover_
                       ->add_body(
                           {.name = "fast", .model = "aircraft", .own = true, .max_speed_mps = 5})
                       .value();
  const auto code = [&](const std::vector<BodyId>& ids) { return mover_->link_bodies(ids).code(); };
  EXPECT_EQ(code({links[0]}), StatusCode::kInvalidArgument);
  EXPECT_EQ(code({links[0], other}), StatusCode::kInvalidArgument);
  EXPECT_EQ(code({links[0], fast}), StatusCode::kInvalidArgument);
  EXPECT_EQ(code({links[0], BodyId{77}}), StatusCode::kNotFound);
  EXPECT_EQ(code({links[0], links[0]}), StatusCode::kConflict);
  EXPECT_EQ(code({links[0], links[1]}), StatusCode::kOk);
  EXPECT_EQ(code({links[1], links[2]}), StatusCode::kConflict);
  world_.round(*mover_, 0, {{links[2], Motion{}}});
  const BodyId late = mover_->add_body({.name = "late", .model = "aircraft", .own = true}).value();
  EXPECT_EQ(code({links[2], late}), StatusCode::kConflict);
}

TEST_F(Links, GoAndComeTogether) {
  for (std::uint64_t visit = 0; visit < 3; ++visit) {
    const std::vector<BodyId> links = add_links(9);
    ASSERT_TRUE(mover_->link_bodies(links).is_ok());
    for (std::uint64_t frame = 10 * visit; frame < 10 * visit + 10; ++frame) {
      world_.round(*mover_, frame, all_at(links, frame));
      world_.round(*looker_, frame);
    }
    EXPECT_EQ(instants().size(), 9U);
    for (const auto& [name, instant] : instants()) EXPECT_EQ(instant, 10 * visit + 9) << name;
    ASSERT_TRUE(mover_->remove_body(links[4]).is_ok());
    for (const BodyId link : links) EXPECT_FALSE(mover_->options_of(link).is_ok());
    world_.round(*mover_, 10 * visit + 10);
    world_.round(*looker_, 10 * visit + 10);
    EXPECT_TRUE(instants().empty());
  }
}

// ---- a real one ---------------------------------------------------------------------------------

struct DhRow {
  double a_m, d_m, alpha_rad;
};
/// Denavit and Hartenberg's parameters of a UR5, as its maker publishes them.
constexpr DhRow kUr5[] = {{0, 0.089159, M_PI / 2}, {-0.425, 0, 0},          {-0.39225, 0, 0},
                          {0, 0.10915, M_PI / 2},  {0, 0.09465, -M_PI / 2}, {0, 0.0823, 0}};
constexpr const char* kUr5Links[] = {"base",   "shoulder", "upperarm", "forearm",
                                     "wrist1", "wrist2",   "wrist3"};

Pose after(const Pose& pose, const DhRow& row, double q_rad) {
  const double c = std::cos(q_rad), s = std::sin(q_rad), ca = std::cos(row.alpha_rad),
               sa = std::sin(row.alpha_rad);
  const std::array<double, 9> turn = {c, -s * ca, s * sa, s, c * ca, -c * sa, 0, sa, ca};
  const std::array<double, 3> way = {row.a_m * c, row.a_m * s, row.d_m};
  Pose next;
  for (std::size_t i = 0; i < 3; ++i) {
    next.translation_m[i] = pose.translation_m[i];
    for (std::size_t k = 0; k < 3; ++k) {
      next.translation_m[i] += pose.rotation[3 * i + k] * way[k];
      next.rotation[3 * i + k] = 0;
      for (std::size_t j = 0; j < 3; ++j)
        next.rotation[3 * i + k] += pose.rotation[3 * i + j] * turn[3 * j + k];
    }
  }
  return next;
}

/// Joints of an instant, and the links' poses by them; the velocities hold so that none counts as
/// at rest.
std::vector<Motion> ur5_at(std::uint64_t frame) {
  std::vector<Motion> links(std::size(kUr5Links));
  Pose pose;
  for (std::size_t i = 0; i < links.size(); ++i) {
    if (i > 0)
      pose = after(pose, kUr5[i - 1],
                   0.9 * std::sin(0.013 * static_cast<double>(frame) * static_cast<double>(i)));
    links[i].pose = pose;
    links[i].angular_velocity_radps = {0, 0, i == 0 ? 0.0 : 0.25};
  }
  return links;
}

/// Two arms: their links in two parts with a tool's, seen through a bus that loses and reorders.
TEST(Ur5, NoFrameMixesInstantsAndAnswersAreOfOne) {
  const std::filesystem::path folder =
      std::filesystem::path(NEARMESH_TEST_DATA) / "robot/ur5/collision";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "no test data at " << folder;
  World world;
  world.judges = false;
  world.start_publisher();
  std::vector<std::unique_ptr<test::ServedModel>> models;
  for (std::size_t i = 0; i < std::size(kUr5Links); ++i) {
    const auto mesh = import_mesh((folder / (std::string(kUr5Links[i]) + ".stl")).string());
    ASSERT_TRUE(mesh.is_ok()) << mesh.status().message();
    models.push_back(std::make_unique<test::ServedModel>(test::bake_mesh(mesh.value(), 16)));
    world.start_publisher_of(kUr5Links[i], *models.back(), 0xd0 + i);
  }
  Session mover(world.bus.make_peer(kRobotMover), test::quick_options()),
      looker(world.bus.make_peer(kLooker), test::quick_options());
  std::vector<BodyId> links;
  for (const std::string robot : {"left", "right"})  // 14 links of one robot with two arms
    for (const char* link : kUr5Links)
      links.push_back(
          mover.add_body({.name = robot + "/" + link, .model = link, .own = true}).value());
  ASSERT_TRUE(mover.link_bodies(links).is_ok());
  looker.watch_all();
  looker.discover_bodies();
  world.bus.on_poses = {.lose = 0.01, .repeat = 0.1, .max_delay = 2};
  const auto placed = [](const Motion& motion, std::size_t arm) {
    Motion moved = motion;
    if (arm == 1) moved.pose.translation_m[1] += 0.9;
    return moved;
  };
  std::uint64_t instants = 0, answers = 0;
  std::optional<std::uint64_t> last;
  for (std::uint64_t frame = 0; frame < 150; ++frame) {
    std::vector<Session::OwnMotion> motions;
    const std::vector<Motion> arm = ur5_at(frame);
    for (std::size_t i = 0; i < links.size(); ++i)
      motions.push_back({links[i], placed(arm[i % arm.size()], i / arm.size())});
    world.round(mover, frame, motions);
    const FrameReport report = world.round(looker, frame);
    std::map<std::string, Motion> heard;
    std::map<std::string, Pose> asked;
    for (std::uint32_t id = 0; id < 32; ++id)
      if (const auto motion = looker.motion_of(BodyId{id}))
        heard.emplace(looker.name_of(BodyId{id}), *motion);
    if (heard.empty()) continue;
    ASSERT_EQ(heard.size(), links.size());
    // Which instant: that of the last link, whose pose is of all joints.
    const Pose& tip = heard.at("left/wrist3").pose;
    std::optional<std::uint64_t> of;
    for (std::uint64_t then = last.value_or(0); then <= frame && !of; ++then)
      if (ur5_at(then).back().pose.translation_m == tip.translation_m) of = then;
    ASSERT_TRUE(of) << "frame " << frame;
    instants += last != of ? 1 : 0;
    last = of;
    const std::vector<Motion> then = ur5_at(*of);
    for (std::size_t i = 0; i < links.size(); ++i) {
      const std::string name =
          std::string(i < then.size() ? "left/" : "right/") + kUr5Links[i % then.size()];
      ASSERT_EQ(heard.at(name).pose.translation_m,
                placed(then[i % then.size()], i / then.size()).pose.translation_m)
          << name << ", frame " << frame;
    }
    for (const test::PairAnswer& answer : report.answers) {
      if (!answer.asked) continue;
      ++answers;
      EXPECT_EQ(answer.pose_a.translation_m, heard.at(looker.name_of(answer.a)).pose.translation_m);
      EXPECT_EQ(answer.age_a_s, answer.age_b_s);
    }
  }
  EXPECT_GT(instants, 60U);
  EXPECT_GT(answers, 1000U);
}

/// What comes is the test's.
class Scripted final : public subscriber::Channel {
 public:
  explicit Scripted(Inbox& next) : next_(next) {}
  [[nodiscard]] wire::SessionId own_id() const override { return kLooker; }
  void send(const wire::RegionSubscription&) override {}
  void send(const wire::BodyPoses&) override {}
  void send(const wire::BodyDirectory&) override {}
  void send(const wire::ContactReport&) override {}
  [[nodiscard]] Inbox take() override { return std::exchange(next_, {}); }

 private:
  Inbox& next_;
};

/// One that looks at the two links of a robot, each in a part of its own, whatever else is there.
struct LookerAtARobot {
  static constexpr std::uint32_t kFirstLink = wire::kBodiesPerPart - 1;

  LookerAtARobot() {
    for (const char* name : {"arm/0", "arm/1"})
      links.push_back(session.add_body({.name = name, .model = "aircraft"}).value());
  }
  /// At an instant, the numbers of whose samples these are.
  void say(double instant_s, std::uint32_t sequence, std::uint32_t next) {
    say_link(0, instant_s, sequence, instant_s);
    say_link(1, instant_s, next, instant_s);
  }
  /// Of one link alone; the place can be read from it.
  void say_link(std::uint32_t link, double instant_s, std::uint32_t sequence, double place_m) {
    wire::BodyPose pose{.peer = kRobotMover,
                        .body = "arm/" + std::to_string(link),
                        .time_s = instant_s,
                        .number = kFirstLink + link,
                        .sequence = sequence,
                        .links = 2,
                        .first_link = kFirstLink};
    pose.pose.translation_m = {place_m, 0, 0};
    inbox.poses.push_back(pose);
  }
  void update() {
    ASSERT_TRUE(session.update(frame, static_cast<double>(frame), {}, 1).is_ok());
    ++frame;
  }
  [[nodiscard]] double seen_s(std::size_t link) const {
    const auto motion = session.motion_of(links[link]);
    return motion ? motion->pose.translation_m[0] : -1;
  }

  subscriber::Channel::Inbox inbox;
  Session session{std::make_unique<Scripted>(inbox), test::quick_options()};
  std::vector<BodyId> links;
  std::uint64_t frame = 0;
};

// 10,000 bodies take 2^32 samples in a day. 0 is no number, so 1 follows the highest.
TEST(LinksOfWeeks, NumbersOfSamplesBeginAnewWhereTheyEnd) {
  LookerAtARobot looker;
  constexpr std::uint32_t kHighest = 0xffffffffU;
  double instant_s = 0;
  for (const std::uint32_t sequence : {kHighest - 3, kHighest - 1, kHighest, 2U, 4U}) {
    instant_s += 1;
    looker.say(instant_s, sequence, sequence == kHighest ? 1 : sequence + 1);
    looker.update();
    for (const std::size_t link : {0U, 1U}) EXPECT_EQ(looker.seen_s(link), instant_s) << sequence;
  }
  looker.say(0.5, kHighest - 5, kHighest - 4);  // late
  looker.update();
  EXPECT_EQ(looker.seen_s(0), instant_s);
}

// Of each update one part was lost: what is left of both is no robot. Also where the numbers begin
// anew between a robot's parts.
TEST(LinksOfWeeks, TwoUpdatesOfOneTimeAreNotMixed) {
  for (const std::uint32_t first : {1U, 0xfffffffdU}) {
    LookerAtARobot looker;
    looker.say_link(0, 1, first, 10);               // first + 1 was lost
    looker.say_link(1, 1, first == 1 ? 4 : 1, 20);  // and first + 2
    looker.update();
    for (const std::size_t link : {0U, 1U}) EXPECT_EQ(looker.seen_s(link), -1) << first;
    looker.say_link(0, 1, first + 2, 20);
    looker.update();
    for (const std::size_t link : {0U, 1U}) EXPECT_EQ(looker.seen_s(link), 20) << first;
  }
}

// In a replay that loops numbers and times go back together.
TEST(LinksOfWeeks, ARobotOfARecordingThatIsPlayedAgainMovesOn) {
  LookerAtARobot looker;
  for (int loop = 0; loop < 3; ++loop)
    for (const std::uint32_t frame : {1U, 20U, 40U}) {
      looker.say(frame, 2 * frame, 2 * frame + 1);
      looker.update();
      for (const std::size_t link : {0U, 1U}) EXPECT_EQ(looker.seen_s(link), frame) << loop;
    }
  looker.say(35, 70, 71);  // late
  looker.update();
  for (const std::size_t link : {0U, 1U}) EXPECT_EQ(looker.seen_s(link), 40);
}

// Of robots that are not looked at nobody tells a session that they are gone.
TEST(LinksOfWeeks, ARobotThatComesAfterManyOthersIsHeard) {
  LookerAtARobot looker;
  std::uint32_t others = 0;
  const auto hear_others = [&] {
    for (int i = 0; i < 5000; ++i)
      looker.inbox.poses.push_back(
          {.peer = 1000 + ++others, .body = "other", .time_s = 1, .sequence = 1, .links = 2});
    looker.update();
  };
  for (int day = 0; day < 3; ++day) hear_others();
  looker.say(1, 11, 12);
  looker.update();
  for (const std::size_t link : {0U, 1U}) EXPECT_EQ(looker.seen_s(link), 1);
  hear_others();
  looker.say(0.5, 1, 2);  // late: what is known of a robot that is looked at stays known
  looker.update();
  for (const std::size_t link : {0U, 1U}) EXPECT_EQ(looker.seen_s(link), 1);
}

}  // namespace
}  // namespace nearmesh
