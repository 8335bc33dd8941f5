// SPDX-License-Identifier: Apache-2.0
// Promises and full poses over real sockets: who gets them, and from whom they count.
#include <fastdds/dds/topic/IContentFilter.hpp>
#include <fastdds/dds/topic/IContentFilterFactory.hpp>

#include "dds_channel_fixture.hpp"
#include "idl/dds/routes.hpp"
#include "subscriber/dds/dds_poses.hpp"

namespace nearmesh::test {
namespace {

/// "arm", of which promises are made, alone in its parts.
wire::BodyDirectory directory_of(wire::SessionId peer, double max_speed_mps = 10) {
  wire::BodyDirectory directory{.peer = peer};
  directory.bodies.push_back(
      {.number = 0, .name = "arm", .model = "m", .max_speed_mps = max_speed_mps});
  return directory;
}

wire::BodyPromises promises_of(wire::SessionId peer, double from_s) {
  return {.peer = peer, .from_s = from_s, .steps = 2048, .bodies = {{0, {1, 2, 3}}}};
}

wire::NearPoses near_of(wire::SessionId peer, std::uint64_t frame) {
  wire::NearPoses poses;
  poses.peer = peer;
  poses.frame = frame;
  poses.bodies.push_back({.number = 0});
  return poses;
}

/// "leg", another body of a peer's, where it is: alone in a part.
void say_leg(PeerChannel& channel, std::uint32_t part = 1) {
  const std::uint32_t number = part * wire::kBodiesPerPart;
  channel.send(wire::BodyDirectory{
      .peer = channel.own_id(), .part = part, .bodies = {{number, "leg", "model of leg"}}});
}
/// Says where it is until the other has heard it.
bool hears_leg(Peer& watcher, PeerChannel& mover, std::uint32_t part = 1) {
  SaysAgain again;
  return watcher.await([&](const Inbox& in) {
    if (again.is_due())
      mover.send(wire::BodyPoses{
          .peer = mover.own_id(), .part = part, .bodies = {{part * wire::kBodiesPerPart}}});
    return heard_in(in).contains({"leg", 0});
  });
}

/// A reader's filter that lets everything pass: what does not come, its writer chose not to send.
class OpenFilters : public fdds::IContentFilterFactory, public fdds::IContentFilter {
 public:
  wire::ReturnCode create_content_filter(const char*, const char*, const fdds::TopicDataType*,
                                         const char*, const ParameterSeq&,
                                         fdds::IContentFilter*& filter) override {
    filter = this;
    return {};
  }
  wire::ReturnCode delete_content_filter(const char*, fdds::IContentFilter*) override { return {}; }
  bool evaluate(const SerializedPayload&, const FilterSampleInfo&, const GUID_t&) const override {
    return true;
  }
};

TEST(DdsChannel, NearPosesAreSentToThoseAloneWhoWantThem) {
  OpenFilters open;
  fdds::DomainParticipant* host = make_participant(own_prefix());
  ASSERT_TRUE(wire::is_ok(host->register_content_filter_factory(wire::kRoutesFilter, &open)));
  {
    Peer mover(make_peer(own_prefix())), wants(make_peer(own_prefix())),
        does_not(make_peer(own_prefix(), host));
    const wire::SessionId id = mover.channel->own_id();
    mover.channel->send(directory_of(id));
    mover.channel->promise(promises_of(id, 1));
    const auto has_promise = [](const Inbox& in) { return !in.promises.empty(); };
    ASSERT_TRUE(wants.await(has_promise)) << wants.story();
    ASSERT_TRUE(does_not.await(has_promise)) << does_not.story();
    EXPECT_EQ(wants.all.promises[0].body, "arm");
    EXPECT_EQ(wants.all.promises[0].max_speed_mps, 10);
    ASSERT_EQ(wants.all.bodies.size(), 1U);
    std::uint64_t frame = 0;
    for (int i = 0; i < 20; ++i) mover.channel->send_near(near_of(id, ++frame));
    // Wishes and near poses are not repeated by the bus, and a wish ends by itself: both are said
    // again.
    using Parts = std::vector<wire::WantedPoses::Part>;
    const auto say_wish = [&](Peer& peer, Parts parts) {
      peer.channel->want({.peer = peer.channel->own_id(), .mover = id, .parts = std::move(parts)});
    };
    const auto is_known = [&](Peer& peer, const Parts& parts) {
      return mover.await([&](const Inbox& in) {
        say_wish(peer, parts);
        return std::any_of(in.wanted.begin(), in.wanted.end(), [&](const auto& wanted) {
          return wanted.peer == peer.channel->own_id() && wanted.parts == parts;
        });
      });
    };
    // Sends until so many have come since then.
    const auto gets = [&](Peer& peer, std::size_t count) {
      const std::size_t before = peer.collect().poses.size();
      return peer.await([&](const Inbox& in) {
        mover.channel->send_near(near_of(id, ++frame));
        for (Peer* wishing : {&wants, &peer}) say_wish(*wishing, {{0, 1}});
        return in.poses.size() >= before + count;
      });
    };
    ASSERT_TRUE(is_known(wants, {{0, 1}}));
    ASSERT_TRUE(gets(wants, 150)) << wants.story();
    EXPECT_EQ(does_not.collect().poses.size(), 0U);
    // Nothing is announced anew: who wants them too gets them from then on.
    const std::uint64_t alone = frame;
    ASSERT_TRUE(is_known(does_not, {{0, 1}}));
    ASSERT_TRUE(gets(does_not, 1)) << does_not.story();
    EXPECT_GT(does_not.all.poses[0].frame, alone);
    // And who wants them no more gets none.
    ASSERT_TRUE(is_known(does_not, {}));
    const std::uint64_t both = frame;
    ASSERT_TRUE(gets(wants, 20)) << wants.story();
    EXPECT_LE(does_not.collect().poses.back().frame, both);
  }
  fdds::DomainParticipantFactory::get_instance()->delete_participant(host);
}

TEST(DdsChannel, FewPosesAreSentToWhoNamesNoneOfTheBodies) {
  const auto join_naming = [](const std::vector<std::string>& bodies) {
    subscriber::DdsChannelOptions options;
    options.transport = transport(own_prefix());
    options.bodies = bodies;
    auto made = PeerChannel::create(options);
    EXPECT_TRUE(made.is_ok()) << made.status().message();
    return std::move(made).value();
  };
  Peer any(make_peer(own_prefix())), arms(join_naming({"ground", "arm"})), none(join_naming({})),
      mover(make_peer(own_prefix())), other(make_peer(own_prefix()));
  const wire::BodyPose arm = pose_of(mover.channel->own_id(), "arm", 1),
                       leg = pose_of(other.channel->own_id(), "leg", 2);
  say(*mover.channel, arm);
  say(*other.channel, leg);
  ASSERT_TRUE(any.await_said(*mover.channel, {arm}) && any.await_said(*other.channel, {leg}));
  ASSERT_TRUE(arms.await_said(*mover.channel, {arm}));
  // By now all know each other. What follows is heard by whoever names the body.
  std::uint64_t frame = 10;
  ASSERT_TRUE(any.await([&](const Inbox& in) {
    ++frame;
    other.channel->send(said_of(pose_of(other.channel->own_id(), "leg", frame)).poses);
    return in.poses.size() > 300;
  }));
  // One each five seconds, for the clock.
  EXPECT_LT(arms.collect().poses.size(), 50U);
  EXPECT_LT(none.collect().poses.size(), 50U);
  // Its next body is named.
  const wire::BodyPose ground = pose_of(other.channel->own_id(), "ground", 3);
  say(*other.channel, ground);
  EXPECT_TRUE(arms.await_said(*other.channel, {ground}));
}

// The exercise's clock is one for all.
TEST(DdsChannel, StrangersHearEachOtherAfterAWhile) {
  const auto join_moving = [](const std::string& body) {
    subscriber::DdsChannelOptions options;
    options.transport = transport(own_prefix());
    options.bodies = {"ground", body};
    options.moves = {body};
    auto made = PeerChannel::create(options);
    EXPECT_TRUE(made.is_ok()) << made.status().message();
    return std::move(made).value();
  };
  Peer arm(join_moving("arm")), leg(join_moving("leg"));
  const wire::BodyPose at = pose_of(leg.channel->own_id(), "leg", 1);
  say(*leg.channel, at);
  ASSERT_TRUE(arm.await_said(*leg.channel, {at})) << arm.story();
  // A body that it did not tell of: others may wait for it in vain.
  say(*leg.channel, pose_of(leg.channel->own_id(), "foot", 2));
  EXPECT_TRUE(leg.await([](const Inbox& in) {
    return std::any_of(in.complaints.begin(), in.complaints.end(), [](const std::string& line) {
      return line.find("body foot is moved here, but") != std::string::npos;
    });
  })) << leg.story();
}

// The session knows who wants what by the peer's name alone.
TEST(DdsChannel, NobodyWantsPosesInThePlaceOfAnotherPeer) {
  Peer mover(make_peer(own_prefix())), wants(make_peer(own_prefix()));
  const wire::SessionId id = mover.channel->own_id(), victim = wants.channel->own_id();
  mover.channel->send(directory_of(id));
  mover.channel->promise(promises_of(id, 1));
  ASSERT_TRUE(wants.await([](const Inbox& in) { return !in.promises.empty(); }));
  const wire::WantedPoses wish{.peer = victim, .mover = id, .parts = {{0, 1}}};
  std::uint64_t frame = 0;
  // Wishes and near poses are not repeated by the bus, and a wish ends by itself: both are said
  // again.
  const auto reaches_victim = [&] {
    wants.channel->want(wish);
    const std::uint64_t since = frame;
    return wants.await([&](const Inbox& in) {
      mover.channel->send_near(near_of(id, ++frame));
      return !in.poses.empty() && in.poses.back().frame > since;
    });
  };
  ASSERT_TRUE(mover.await([&](const Inbox& in) {
    wants.channel->want(wish);
    return !in.wanted.empty();
  }));
  EXPECT_TRUE(reaches_victim());
  {
    Peer thief(make_peer(own_prefix()));
    ASSERT_TRUE(thief.await([&](const Inbox& in) {
      wants.channel->want(wish);
      return !in.promises.empty();
    }));
    const wire::WantedPoses other{.peer = victim, .mover = id, .parts = {{7, 1}}},
        nothing{.peer = victim, .mover = id};
    ASSERT_TRUE(mover.await([&](const Inbox& in) {
      wants.channel->want(wish);
      thief.channel->want(other);
      thief.channel->want(nothing);
      return !in.complaints.empty();
    }));
    EXPECT_NE(mover.all.complaints[0].find("speaks through another writer"), std::string::npos)
        << mover.all.complaints[0];
    EXPECT_TRUE(reaches_victim());
  }
  for (const wire::WantedPoses& taken : mover.collect().wanted)
    EXPECT_EQ(taken.parts, wish.parts) << "of the thief";
  // With the thief nothing of the peer goes.
  const wire::WantedPoses later{.peer = victim, .mover = id, .parts = {{2, 1}}};
  EXPECT_TRUE(mover.await([&](const Inbox& in) {
    wants.channel->want(later);
    return in.wanted.back().parts == later.parts;
  }));
}

TEST(DdsChannel, WhoWantsPosesAgainAfterItWasLostIsHeard) {
  Peer mover(make_peer(own_prefix()));
  const wire::SessionId id = mover.channel->own_id(), again = 0x77;
  mover.channel->send(directory_of(id));
  mover.channel->promise(promises_of(id, 1));
  std::size_t heard = 0;
  for (int time = 1; time <= 2; ++time) {
    Peer wants(make_peer(own_prefix(), nullptr, again));
    ASSERT_TRUE(wants.await([](const Inbox& in) { return !in.promises.empty(); }));
    // As sessions do: again and again.
    EXPECT_TRUE(mover.await([&](const Inbox& in) {
      wants.channel->want({.peer = again, .mover = id, .parts = {{0, 1}}});
      return in.wanted.size() > heard;
    })) << time;
    wants.channel.reset();
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    heard = mover.collect().wanted.size();  // with what was on its way
  }
}

TEST(DdsChannel, WhoJoinsLaterIsPromisedAtOnce) {
  Peer mover(make_peer(own_prefix()));
  const wire::SessionId id = mover.channel->own_id();
  mover.channel->send(directory_of(id));
  mover.channel->promise(promises_of(id, 1));
  mover.channel->promise(promises_of(id, 5));
  Peer late(make_peer(own_prefix()));
  ASSERT_TRUE(late.await([](const Inbox& in) { return !in.promises.empty(); }));
  EXPECT_EQ(late.all.promises.size(), 1U);
  EXPECT_EQ(late.all.promises[0].from_s, 5);
  EXPECT_EQ(late.all.promises[0].place_m, (std::array<double, 3>{1, 2, 3}));
  EXPECT_EQ(late.all.movers.at("arm"), wire::Mover::kThere);
}

// A session uses no number twice, so it has told of as many parts as it has had bodies.
TEST(DdsChannel, WhoJoinsLaterHearsAMoverThatHasRemovedMoreBodiesThanAreKept) {
  Peer mover(make_peer(own_prefix())), watcher(make_peer(own_prefix()));
  const wire::SessionId id = mover.channel->own_id();
  constexpr auto kRemoved = static_cast<std::uint32_t>(subscriber::DdsPoses::kMaxPartsOfOne);
  for (std::uint32_t part = 0; part < kRemoved; ++part)
    for (const bool is_there : {true, false}) {
      wire::BodyDirectory directory{.peer = id, .part = part};
      if (is_there)
        directory.bodies.push_back({part * wire::kBodiesPerPart, std::to_string(part), "m"});
      mover.channel->send(directory);
    }
  say_leg(*mover.channel, kRemoved);  // the last, by time and by key
  Peer late(make_peer(own_prefix()));
  for (Peer* peer : {&watcher, &late}) {
    ASSERT_TRUE(hears_leg(*peer, *mover.channel, kRemoved)) << peer->story();
    EXPECT_EQ(peer->all.poses[0].body, "leg");
    EXPECT_EQ(peer->all.complaints, std::vector<std::string>{});
  }
}

/// As promises_of, of one body: each of another key where it is of another part of promises.
wire::BodyPromises promise_of(wire::SessionId peer, std::uint32_t number, double from_s) {
  wire::BodyPromises promises = promises_of(peer, from_s);
  promises.part = number / wire::kBodiesPerPromise;
  promises.bodies[0].number = number;
  return promises;
}

/// Promises that wait for one of several directories are told again with each that comes, so they
/// are not counted.
bool is_promised(const Inbox& in, const std::string& body, double from_s) {
  return std::any_of(in.promises.begin(), in.promises.end(), [&](const auto& promise) {
    return promise.body == body && promise.from_s == from_s;
  });
}

// As of poses. A part of promises is of bodies that several directories tell of.
TEST(DdsChannel, NothingIsKeptOfPromisesOfBodiesThatAreGone) {
  Peer mover(make_peer(own_prefix())), watcher(make_peer(own_prefix()));
  const wire::SessionId id = mover.channel->own_id();
  constexpr std::uint32_t kHand = wire::kBodiesPerPart, kLeg = 5 * wire::kBodiesPerPart;
  static_assert(kHand / wire::kBodiesPerPromise == 0 && kLeg / wire::kBodiesPerPromise == 1);
  const auto tell = [&](std::uint32_t number, const std::string& name) {
    wire::BodyDirectory directory{.peer = id, .part = number / wire::kBodiesPerPart};
    if (!name.empty())
      directory.bodies.push_back(
          {.number = number, .name = name, .model = "m", .max_speed_mps = 10});
    mover.channel->send(directory);
  };
  tell(0, "arm");
  tell(kHand, "hand");
  tell(kLeg, "leg");
  wire::BodyPromises both = promise_of(id, 0, 1);
  both.bodies.push_back({kHand, {4, 5, 6}});
  mover.channel->promise(both);
  mover.channel->promise(promise_of(id, kLeg, 1));
  ASSERT_TRUE(watcher.await([](const Inbox& in) {
    return is_promised(in, "arm", 1) && is_promised(in, "hand", 1) && is_promised(in, "leg", 1);
  })) << watcher.story();
  // Of the hand it still holds.
  tell(0, "");
  mover.channel->promise(promise_of(id, kLeg, 2));
  ASSERT_TRUE(watcher.await([](const Inbox& in) {
    return in.movers.at("arm") == wire::Mover::kLeft && is_promised(in, "leg", 2);
  })) << watcher.story();
  EXPECT_EQ(find_kept<wire::BodyPromises>(own_prefix(), 1).messages, 2U);
  tell(kHand, "");
  ASSERT_TRUE(watcher.await([](const Inbox& in) {
    return in.movers.at("hand") == wire::Mover::kLeft;
  })) << watcher.story();
  // Until all readers have heard of it, what was taken back is told of.
  EXPECT_TRUE(wait_for([&] {
    const Found found = find_kept<wire::BodyPromises>(own_prefix(), 1);
    return found.messages == 1 && found.all == 1;
  }));
  // To those who were there that is no news.
  EXPECT_EQ(watcher.collect().movers.at("leg"), wire::Mover::kThere);
  // The part is used again.
  tell(1, "arm");
  mover.channel->promise(promise_of(id, 1, 3));
  ASSERT_TRUE(watcher.await([](const Inbox& in) { return is_promised(in, "arm", 3); }));
  EXPECT_EQ(watcher.all.complaints, std::vector<std::string>{});
  EXPECT_EQ(watcher.channel->pose_counts()[id].lost_promises, 0U);
  Peer late(make_peer(own_prefix()));
  EXPECT_TRUE(late.await(
      [](const Inbox& in) { return is_promised(in, "arm", 3) && is_promised(in, "leg", 2); }));
  EXPECT_FALSE(is_promised(late.all, "hand", 1));
}

TEST(DdsChannel, PromisesCountOnceADirectoryNamesThemAndOfWhoHasASpeed) {
  Peer mover(make_peer(own_prefix())), watcher(make_peer(own_prefix()));
  const wire::SessionId id = mover.channel->own_id();
  mover.channel->promise(promises_of(id, 1));
  say(*mover.channel, pose_of(id, "leg", 1));
  ASSERT_TRUE(watcher.await_said(*mover.channel, {pose_of(id, "leg", 1)}));
  EXPECT_TRUE(watcher.all.promises.empty());
  // Of a body that may have any speed a promise says nothing.
  mover.channel->send(directory_of(id, 0));
  say(*mover.channel, pose_of(id, "leg", 2));
  ASSERT_TRUE(watcher.await_said(*mover.channel, {pose_of(id, "leg", 2)}));
  EXPECT_TRUE(watcher.all.promises.empty());
  mover.channel->send(directory_of(id));
  mover.channel->promise(promises_of(id, 2));
  ASSERT_TRUE(watcher.await([](const Inbox& in) { return !in.promises.empty(); }));
  EXPECT_EQ(watcher.all.promises[0].from_s, 2);
}

TEST(DdsChannel, NobodyPromisesForABodyThatAnotherMoves) {
  Peer watcher(make_peer(own_prefix())), thief(make_peer(own_prefix()));
  const wire::SessionId thief_id = thief.channel->own_id();
  {
    Peer mover(make_peer(own_prefix()));
    const wire::SessionId id = mover.channel->own_id();
    mover.channel->send(directory_of(id));
    mover.channel->promise(promises_of(id, 1));
    ASSERT_TRUE(watcher.await([](const Inbox& in) { return in.promises.size() == 1; }));
    thief.channel->send(directory_of(thief_id));
    thief.channel->promise(promises_of(thief_id, 7));
    ASSERT_TRUE(watcher.await([](const Inbox& in) { return !in.complaints.empty(); }));
    EXPECT_NE(watcher.all.complaints[0].find("body arm"), std::string::npos);
    EXPECT_NE(watcher.all.complaints[0].find("is moved by another peer already"),
              std::string::npos);
    // Nor in the name of the mover's session.
    thief.channel->promise(promises_of(id, 8));
    // Both have one key: what waits unread is displaced by what comes later.
    say_leg(*thief.channel);
    ASSERT_TRUE(hears_leg(watcher, *thief.channel));
    mover.channel->promise(promises_of(id, 2));
    ASSERT_TRUE(watcher.await([](const Inbox& in) { return in.promises.size() == 2; }));
    EXPECT_EQ(watcher.all.promises[1].from_s, 2);
  }
  // The body is free: what the other said last counts then, though it says no more.
  ASSERT_TRUE(watcher.await([](const Inbox& in) { return in.promises.size() == 3; }));
  EXPECT_EQ(watcher.all.promises[2].from_s, 7);
  EXPECT_EQ(watcher.all.promises[2].peer, thief_id);
  EXPECT_EQ(watcher.all.movers.at("arm"), wire::Mover::kThere);
}

// Nobody moves it then, and who comes may.
TEST(DdsChannel, WhoRemovesABodyThatAnotherMovesDoesNotGetItsNameLater) {
  Peer watcher(make_peer(own_prefix())), second(make_peer(own_prefix()));
  const wire::SessionId second_id = second.channel->own_id();
  {
    Peer first(make_peer(own_prefix()));
    first.channel->send(directory_of(first.channel->own_id()));
    first.channel->promise(promises_of(first.channel->own_id(), 1));
    ASSERT_TRUE(watcher.await([](const Inbox& in) { return in.promises.size() == 1; }));
    second.channel->send(directory_of(second_id));
    second.channel->promise(promises_of(second_id, 7));
    ASSERT_TRUE(watcher.await([](const Inbox& in) { return !in.complaints.empty(); }));
    second.channel->send(wire::BodyDirectory{.peer = second_id});
    say_leg(*second.channel);  // behind that
    ASSERT_TRUE(hears_leg(watcher, *second.channel));
  }
  ASSERT_TRUE(
      watcher.await([](const Inbox& in) { return in.movers.at("arm") != wire::Mover::kThere; }));
  Peer third(make_peer(own_prefix()));
  const wire::BodyPose next = pose_of(third.channel->own_id(), "arm", 3);
  say(*third.channel, next);
  ASSERT_TRUE(watcher.await_said(*third.channel, {next})) << watcher.story();
  EXPECT_EQ(heard_in(watcher.all), Heard({{"leg", 0}, {"arm", 3}}));
  EXPECT_EQ(watcher.all.promises.size(), 1U);
  EXPECT_EQ(watcher.all.complaints.size(), 1U);
}

// A host that takes seldom finds one and the other in one inbox, each kind by itself.
TEST(DdsChannel, APromiseOfABodyThatIsGoneDoesNotWaitBesideThePoseOfTheNextOfItsName) {
  for (const bool leaves : {false, true}) {
    const std::string prefix = own_prefix() + (leaves ? "/leaves" : "/removes");
    Peer watcher(make_peer(prefix)), first(make_peer(prefix)), second(make_peer(prefix));
    const wire::SessionId first_id = first.channel->own_id(), second_id = second.channel->own_id();
    first.channel->send(directory_of(first_id));
    first.channel->promise(promises_of(first_id, 1));
    watcher.channel->wait(kDeadline_s);  // it has come, and is not taken
    if (leaves)
      first.channel.reset();
    else
      first.channel->send(wire::BodyDirectory{.peer = first_id});
    const wire::BodyPose next = pose_of(second_id, "arm", 2);
    say(*second.channel, next);
    // Time for all of it: without, each may have an inbox of its own, and the test would say
    // nothing.
    for (int i = 0; i < 20; ++i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
      second.channel->send(said_of(next).poses);
    }
    Inbox taken;
    ASSERT_TRUE(wait_for([&] {
      taken = watcher.channel->take();
      return !taken.poses.empty();
    })) << leaves;
    EXPECT_EQ(taken.poses[0].peer, second_id);
    EXPECT_TRUE(taken.promises.empty()) << leaves;
  }
}

TEST(DdsChannel, WhatIsToldOfADirectoryAndAPromiseFromTwoSessionsOfOneHostStaysApart) {
  fdds::DomainParticipant* host = make_participant(own_prefix());
  {
    Peer one(make_peer(own_prefix(), host)), two(make_peer(own_prefix(), host)),
        watcher(make_peer(own_prefix()));
    one.channel->send(directory_of(one.channel->own_id()));
    one.channel->promise(promises_of(one.channel->own_id(), 1));
    ASSERT_TRUE(watcher.await([](const Inbox& in) { return in.promises.size() == 1; }));
    two.channel->send(directory_of(two.channel->own_id()));
    two.channel->promise(promises_of(two.channel->own_id(), 2));
    ASSERT_TRUE(watcher.await([](const Inbox& in) { return !in.complaints.empty(); }));
    EXPECT_EQ(watcher.all.promises.size(), 1U);
  }
  fdds::DomainParticipantFactory::get_instance()->delete_participant(host);
}

}  // namespace
}  // namespace nearmesh::test
