// SPDX-License-Identifier: Apache-2.0
// Bodies that nobody declared here: who moves them tells what they are.
#include "world.hpp"

namespace nearmesh {
namespace {

using subscriber::BodyId;
using subscriber::BodyOptions;
using subscriber::FrameReport;
using test::kPeer;
using test::World;

constexpr wire::SessionId kLooksOn = 99;

/// Two that fly, each one body, and one that looks on and names none.
class Discovery : public ::testing::Test {
 protected:
  Discovery() {
    world_.start_publisher();
    one_ = world_.make_peer(test::quick_options(), kPeer, true, false);
    two_ = world_.make_peer(test::quick_options(), kPeer + 1, false, true);
    watcher_ = std::make_unique<subscriber::Session>(world_.bus.make_peer(kLooksOn));
    watcher_->watch_all();
    watcher_->discover_bodies();
  }
  FrameReport look(std::uint64_t frame = 1) {
    world_.round(two_ ? *two_ : *one_, frame);  // who serves has its turn there
    FrameReport report = watcher_->update(frame, static_cast<double>(frame) * 0.05, {}, 1).value();
    for (const BodyId body : report.came) came_.push_back(watcher_->name_of(body));
    went_ += report.went.size();
    return report;
  }

  World world_;
  std::unique_ptr<subscriber::Session> one_, two_, watcher_;
  const test::Flight flight_ = test::make_flight(3, 2);
  std::vector<std::string> came_;
  std::size_t went_ = 0;
};

TEST_F(Discovery, BodiesComeWithTheirFirstPoseAsTheirMoverDescribesThem) {
  EXPECT_TRUE(look().came.empty());
  world_.round(*one_, 1, {{test::kOne, flight_.one[0]}});
  world_.round(*two_, 1, {{test::kTwo, flight_.two[0]}});
  FrameReport report;
  for (int i = 0; i < 50; ++i) report = look();
  ASSERT_EQ(came_, (std::vector<std::string>{"one", "two"}));
  const BodyOptions found = watcher_->options_of(BodyId{0}).value();
  EXPECT_EQ(found.model, "aircraft");
  EXPECT_FALSE(found.own);
  EXPECT_EQ(report.unknown_pairs, 0U);
  EXPECT_EQ(report.free_by_bounds.pairs + report.answers.size(), 1U);
}

TEST_F(Discovery, ThoseThatCameBeforeItWasAskedForComeToo) {
  subscriber::Session late(world_.bus.make_peer(kLooksOn - 1));
  late.watch_all();
  ASSERT_TRUE(late.add_body({.name = "two", .model = "aircraft"}).is_ok());
  world_.round(*one_, 1, {{test::kOne, flight_.one[0]}});
  world_.round(*two_, 1, {{test::kTwo, flight_.two[0]}});
  const auto update = [&] {
    look();
    std::vector<std::string> came;
    const FrameReport report = late.update(1, 0.05, {}, 1).value();
    for (const BodyId body : report.came) came.push_back(late.name_of(body));
    return came;
  };
  for (int i = 0; i < 20; ++i) EXPECT_TRUE(update().empty());
  late.discover_bodies();
  EXPECT_EQ(update(), (std::vector<std::string>{"one"}));
  EXPECT_TRUE(update().empty());
  // Declared no more, and still moved.
  ASSERT_TRUE(late.remove_body(BodyId{0}).is_ok());
  EXPECT_EQ(update(), (std::vector<std::string>{"two"}));
}

TEST_F(Discovery, ABodyThatIsRemovedGoesAndOneWhoseMoverLeftStaysUnknown) {
  world_.round(*one_, 1, {{test::kOne, flight_.one[0]}});
  world_.round(*two_, 1, {{test::kTwo, flight_.two[0]}});
  for (int i = 0; i < 20; ++i) look();
  two_.reset();
  FrameReport report = look();
  EXPECT_EQ(report.went.size(), 0U);
  EXPECT_EQ(report.unknown_pairs, 1U);
  EXPECT_EQ(report.free_by_bounds.pairs, 0U);
  EXPECT_FALSE(report.all_certified());
  ASSERT_TRUE(one_->remove_body(test::kOne).is_ok());
  world_.round(*one_, 2);
  report = look(2);
  ASSERT_EQ(report.went.size(), 1U);
  EXPECT_EQ(report.went[0], BodyId{0});
  EXPECT_EQ(watcher_->name_of(report.went[0]), "");
  EXPECT_EQ(report.unknown_pairs, 0U);
}

// A host that took nothing for long is told of all bodies that are there, not of each that came and
// went.
TEST_F(Discovery, ABodyThatIsNotAmongAllThatAreThereGoes) {
  world_.round(*one_, 1, {{test::kOne, flight_.one[0]}});
  world_.round(*two_, 1, {{test::kTwo, flight_.two[0]}});
  for (int i = 0; i < 20; ++i) look();
  ASSERT_EQ(came_.size(), 2U);
  auto& inbox = world_.bus.inbox_of(kLooksOn);
  inbox.are_all_bodies = true;
  inbox.bodies.push_back({{.number = 0, .name = "two", .model = "aircraft"}, false});
  const FrameReport report = look();
  EXPECT_EQ(came_.size(), 2U);
  ASSERT_EQ(report.went, std::vector<BodyId>{BodyId{0}});
  EXPECT_EQ(watcher_->name_of(BodyId{1}), "two");
}

TEST_F(Discovery, ABodyThatBecomesAnotherOneIsUnknownUntilItsNextPose) {
  world_.round(*one_, 1, {{test::kOne, flight_.one[0]}});
  world_.round(*two_, 1, {{test::kTwo, flight_.two[0]}});
  for (int i = 0; i < 20; ++i) look();
  ASSERT_TRUE(one_->replace_model(test::kOne, "terrain").is_ok());
  ASSERT_TRUE(one_->update(1, 0.05, {}, 1).is_ok());  // not judged: it is no aircraft
  const FrameReport report = look();
  EXPECT_EQ(report.went.size(), 1U);
  ASSERT_EQ(report.came.size(), 1U);
  EXPECT_EQ(watcher_->options_of(report.came[0]).value().model, "terrain");
  EXPECT_EQ(report.unknown_pairs, 1U);
}

TEST_F(Discovery, WhatTheHostDeclaredStaysAsItIs) {
  ASSERT_TRUE(watcher_->add_body({.name = "one", .model = "aircraft", .mask = 6}).is_ok());
  world_.round(*one_, 1, {{test::kOne, flight_.one[0]}});
  for (int i = 0; i < 5; ++i) look();
  EXPECT_TRUE(came_.empty());
  EXPECT_EQ(watcher_->options_of(BodyId{0}).value().mask, 6U);
}

}  // namespace
}  // namespace nearmesh
