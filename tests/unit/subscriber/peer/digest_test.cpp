// SPDX-License-Identifier: Apache-2.0
// Digests of a frame: equal for peers that know the same, whatever the order in which they came to
// know it.
#include "world.hpp"

namespace nearmesh {
namespace {

using namespace test;

std::vector<Session::OwnMotion> motions_at(const Flight& flight, std::size_t frame) {
  return {{kOne, flight.one[frame]}, {kTwo, flight.two[frame]}};
}

// A first peer flies and is served; what it was sent then goes to two others, to each in its own
// order, with gaps.
class FrameDigests : public ::testing::Test {
 protected:
  void SetUp() override {
    world_.start_publisher();
    world_.bus.batch_filter = [this](wire::SessionId peer, wire::SplitBatchMessage& batch) {
      if (peer == kPeer) sent_.push_back(batch);
      return peer == kPeer;
    };
    // Overlapping requests, so that batches repeat splits with other boxes.
    world_.bus.on_batches = {.lose = 0.2, .max_delay = 3};
    const auto first = world_.make_peer();
    ASSERT_EQ(world_.fly(*first, flight_), flight_.frames());
    world_.bus.on_batches = {};
    one_ = world_.make_peer(quick_options(), kFirst);
    two_ = world_.make_peer(quick_options(), kSecond);
    // They ask as well, or would take nothing in.
    for (Session* session : {one_.get(), two_.get()})
      for (int i = 0; i < 3; ++i) ask(*session, 0);
  }
  FrameReport ask(Session& session, std::size_t frame) {
    return world_.round(session, frame, motions_at(flight_, frame));
  }
  void deliver(wire::SessionId peer, std::size_t begin, std::size_t end, std::uint64_t seed) {
    std::vector<wire::SplitBatchMessage> batches(sent_.begin() + static_cast<std::ptrdiff_t>(begin),
                                                 sent_.begin() + static_cast<std::ptrdiff_t>(end));
    Random random(seed);
    shuffle(batches, random);
    for (const wire::SplitBatchMessage& batch : batches) world_.bus.inject(peer, batch);
  }

  static constexpr wire::SessionId kFirst = 0xb2, kSecond = 0xb3;
  World world_;
  const Flight flight_ = make_flight(3);
  std::vector<wire::SplitBatchMessage> sent_;
  std::unique_ptr<Session> one_, two_;
};

TEST_F(FrameDigests, AgreeForTheSameBatchesInAnyOrder) {
  ASSERT_GT(sent_.size(), 10U);
  std::set<std::uint64_t> states, answers;
  constexpr std::size_t kParts = 6;
  for (std::size_t part = 0; part < kParts; ++part) {
    const std::size_t begin = sent_.size() * part / kParts;
    const std::size_t end = sent_.size() * (part + 1) / kParts;
    deliver(kFirst, begin, end, 1);
    deliver(kSecond, begin, end, 2);
    for (std::size_t frame = 0; frame < flight_.frames(); frame += 3) {
      const FrameReport a = ask(*one_, frame), b = ask(*two_, frame);
      ASSERT_EQ(a.batches_waiting + b.batches_waiting, 0U);
      EXPECT_EQ(a.state_digest, b.state_digest);
      EXPECT_EQ(a.answers_digest, b.answers_digest);
      states.insert(a.state_digest);
      answers.insert(a.answers_digest);
    }
  }
  EXPECT_GT(states.size(), kParts / 2);  // they follow what arrives
  EXPECT_GT(answers.size(), kParts);
}

TEST_F(FrameDigests, DifferWhereBatchesAreMissing) {
  deliver(kFirst, 0, sent_.size(), 1);
  deliver(kSecond, 0, sent_.size() / 4, 1);
  // Which frames need what came late depends on how fast the first peer was served.
  bool answers_differ = false;
  for (std::size_t frame = 0; frame < flight_.frames(); ++frame) {
    const FrameReport a = ask(*one_, frame), b = ask(*two_, frame);
    EXPECT_NE(a.state_digest, b.state_digest);
    answers_differ = answers_differ || a.answers_digest != b.answers_digest;
  }
  EXPECT_TRUE(answers_differ);
}

}  // namespace
}  // namespace nearmesh
