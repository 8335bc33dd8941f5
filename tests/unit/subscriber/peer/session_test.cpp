// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/subscriber/peer/session.hpp"

#include <chrono>
#include <cmath>
#include <limits>
#include <thread>

#include "bad_motions.hpp"
#include "core/base/hash.hpp"
#include "core/base/stopwatch.hpp"
#include "world.hpp"

namespace nearmesh {
namespace {

using subscriber::PairAnswer;
using subscriber::Session;
using subscriber::SessionOptions;
using test::aircraft;
using test::BodyId;
using test::Flight;
using test::FrameReport;
using test::kGround;
using test::kNan;
using test::kOne;
using test::kPeer;
using test::kPublisher;
using test::kTwo;
using test::make_flight;
using test::other_terrain;
using test::quick_options;
using test::terrain;
using test::World;

std::string reason_of(const FrameReport& report, std::size_t pair) {
  return report.answers.at(pair).reason;
}

// ---- what a host gives --------------------------------------------------------------------------

TEST(Session, OptionsOutOfRangeAreRefusedByEachUpdateAndNamed) {
  constexpr double kInfinite = std::numeric_limits<double>::infinity();
  const std::pair<const char*, SessionOptions> wrong[] = {
      {"margin_m", {.margin_m = -5}},
      {"margin_m", {.margin_m = kNan}},
      {"lookahead_s", {.lookahead_s = kNan}},
      {"lookahead_s", {.lookahead_s = kInfinite}},
      {"max_pose_age_s", {.max_pose_age_s = -1}},
      {"sweep_s", {.sweep_s = -1}},
      {"promise_s", {.promise_s = 0}},
      {"request_timeout_s", {.request_timeout_s = 0}},
      {"window_bytes", {.window_bytes = 100}},
      {"audit_s", {.audit_s = kNan}},
  };
  World world;
  for (const auto& [name, options] : wrong) {
    EXPECT_EQ(check(options).code(), StatusCode::kInvalidArgument) << name;
    Session session(world.bus.make_peer(kPeer), options);
    for (std::uint64_t frame = 0; frame < 2; ++frame) {
      const Result<FrameReport> report = session.update(frame, 0, {}, 1);
      ASSERT_FALSE(report.is_ok()) << name;
      EXPECT_EQ(report.status().message().rfind(name, 0), 0U) << report.status().message();
    }
  }
  EXPECT_EQ(check(SessionOptions{}).message(), "");
}

TEST(Session, ABudgetThatIsNoneIsRefusedAndChangesNothing) {
  World world;
  world.start_publisher();
  const auto session = world.make_peer();
  const Flight flight = make_flight(5, 2);
  for (const double budget_s : {kNan, -0.001, -std::numeric_limits<double>::infinity()}) {
    const Result<FrameReport> report =
        session->update(0, 0, {{kOne, flight.one[0]}, {kTwo, flight.two[0]}}, budget_s);
    ASSERT_FALSE(report.is_ok());
    EXPECT_EQ(report.status().code(), StatusCode::kInvalidArgument);
    EXPECT_NE(report.status().message().find("budget_s"), std::string::npos);
    EXPECT_FALSE(session->motion_of(kOne).has_value());
  }
  EXPECT_EQ(world.fly(*session, flight), flight.frames());
}

// ---- right answers under faults of the channel --------------------------------------------------

TEST(Session, CertifiesAWholeFlight) {
  for (const double lookahead_s : {0.0, 0.5}) {
    World world;
    world.start_publisher();
    SessionOptions options = quick_options();
    options.lookahead_s = lookahead_s;
    const auto session = world.make_peer(options);
    for (std::uint64_t seed = 1; seed <= 4; ++seed) {
      SCOPED_TRACE("seed " + std::to_string(seed));
      const Flight flight = make_flight(seed);
      EXPECT_EQ(world.fly(*session, flight), flight.frames());
    }
    // All kinds of answers occurred, so the judge had something to do.
    EXPECT_GT(world.judge.free, 50U);
    EXPECT_GT(world.judge.contact, 50U);
    if (lookahead_s == 0) {
      EXPECT_GT(world.judge.uncertain, 20U);
      EXPECT_GT(world.judge.partial, 20U);
    }
    EXPECT_TRUE(world.complaints.empty()) << world.complaints.front();
    EXPECT_EQ(session->stats().sequence_gaps, 0U);
    EXPECT_LT(session->stats().batch_bytes, session->stats().mesh_bytes);
  }
}

TEST(Session, CertifiesAWholeFlightThoughAFifthOfTheBatchesIsLost) {
  std::uint64_t gaps = 0;
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    World world(seed);
    world.bus.on_batches.lose = 0.2;
    world.start_publisher();
    const auto session = world.make_peer();
    const Flight flight = make_flight(seed);
    EXPECT_EQ(world.fly(*session, flight), flight.frames());
    gaps += session->stats().sequence_gaps;
  }
  EXPECT_GT(gaps, 0U);
}

TEST(Session, CertifiesAWholeFlightThoughMessagesAreRepeated) {
  World world(2);
  world.bus.on_batches = {.repeat = 0.5, .max_delay = 3};
  world.bus.on_subscriptions = {.repeat = 0.5, .max_delay = 3};
  world.start_publisher();
  const auto session = world.make_peer();
  const Flight flight = make_flight(2);
  EXPECT_EQ(world.fly(*session, flight), flight.frames());
  EXPECT_TRUE(world.complaints.empty()) << world.complaints.front();
}

TEST(Session, CertifiesAWholeFlightUnderAllFaultsAtOnce) {
  for (std::uint64_t seed = 11; seed <= 14; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    World world(seed);
    world.bus.on_batches = {.lose = 0.2, .repeat = 0.2, .max_delay = 10};
    world.bus.on_subscriptions = {.lose = 0.1, .repeat = 0.2, .max_delay = 4};
    world.start_publisher();
    SessionOptions options = quick_options();
    options.max_held_splits = 300;
    const auto session = world.make_peer(options);
    const Flight flight = make_flight(seed);
    EXPECT_EQ(world.fly(*session, flight), flight.frames());
  }
}

TEST(Session, AnySingleBatchMayBeLost) {
  const Flight flight = make_flight(5, 4);
  std::uint64_t batches = 1;  // of a flight; more where a loss brings repeats
  for (std::uint64_t lost = 0; lost < batches; ++lost) {
    SCOPED_TRACE("batch " + std::to_string(lost) + " lost");
    World world;
    std::uint64_t sent = 0;
    world.bus.batch_filter = [&](wire::SessionId, wire::SplitBatchMessage&) {
      return sent++ != lost;
    };
    world.start_publisher();
    const auto session = world.make_peer();
    ASSERT_EQ(world.fly(*session, flight), flight.frames());
    batches = std::max(batches, sent);
  }
  EXPECT_GT(batches, 5U);
}

TEST(Session, MeasuresSequenceGaps) {
  World world;
  std::uint64_t sent = 0, lost = 0;
  world.bus.batch_filter = [&](wire::SessionId, wire::SplitBatchMessage& sample) {
    ++sent;
    const bool is_lost = sent == 2 || sent == 5 || sent == 6;
    if (is_lost) lost += 1 + sample.joined.size();
    return !is_lost;
  };
  world.start_publisher();
  const auto session = world.make_peer();
  const Flight flight = make_flight(1);
  // Nodes whose own boxes were in what was lost must not stay missing for ever.
  EXPECT_EQ(world.fly(*session, flight), flight.frames());
  ASSERT_GT(sent, 7U);
  EXPECT_EQ(session->stats().sequence_gaps, lost);
}

// ---- who comes and goes -------------------------------------------------------------------------

TEST(Session, LateJoinerCatchesUp) {
  World world;
  world.start_publisher();
  const auto first = world.make_peer(quick_options(), kPeer, true, false);
  const Flight flight = make_flight(6);
  std::unique_ptr<Session> second;
  for (std::size_t i = 0; i < flight.frames(); ++i) {
    if (i == flight.frames() / 2) second = world.make_peer(quick_options(), kPeer + 1, false, true);
    // Before the second peer is there, nobody says where its aircraft is.
    const bool both = i > flight.frames() / 2;
    EXPECT_EQ(world.fly_frame(*first, i, {{kOne, flight.one[i]}}, both ? 0 : 20), both);
    if (second) {
      EXPECT_TRUE(world.fly_frame(*second, i, {{kTwo, flight.two[i]}}));
    }
    if (::testing::Test::HasFailure()) break;
    if (i + 1 == flight.frames() / 2) {
      const FrameReport report = world.round(*first, i);
      EXPECT_TRUE(is_certified(report.answers[0].answer.status));
      EXPECT_EQ(reason_of(report, 1), "no pose of body two has come");
    }
  }
  EXPECT_GT(world.judge.certified(), flight.frames());
}

TEST(Session, GoesOnWithARestartedPublisher) {
  World world;
  world.start_publisher();
  const auto session = world.make_peer();
  const Flight flight = make_flight(1);
  const std::size_t half = flight.frames() / 2;
  EXPECT_EQ(world.fly(*session, flight, 0, half), half);
  const std::uint64_t held = session->stats().held_splits;
  world.stop_publisher();
  world.start_publisher(kPublisher + 7);
  EXPECT_EQ(world.fly(*session, flight, half, flight.frames()), flight.frames() - half);
  EXPECT_GE(session->stats().held_splits, held);  // nothing was thrown away
  EXPECT_EQ(session->stats().sequence_gaps, 0U);
  EXPECT_TRUE(world.complaints.empty()) << world.complaints.front();
}

TEST(Session, GoesOnWithARestartedPublisherBeforeTheLossIsNoticed) {
  World world;
  world.bus.keep_quiet = true;
  world.start_publisher();
  const auto session = world.make_peer();
  const Flight flight = make_flight(1);
  world.fly(*session, flight, 0, 10);
  world.stop_publisher();
  world.start_publisher(kPublisher + 7);
  world.fly(*session, flight, 10, 20, 3);
  world.bus.lose_publisher(kPublisher);
  EXPECT_EQ(world.fly(*session, flight, 20, flight.frames()), flight.frames() - 20);
}

TEST(Session, WithoutPublisherKeepsWhatIsCertifiedAndIsUncertainBeyond) {
  World world;
  world.start_publisher();
  SessionOptions options = quick_options();
  options.lookahead_s = 0;  // nothing more than the first answers need
  const auto session = world.make_peer(options);
  const Flight flight = make_flight(1);
  ASSERT_EQ(world.fly(*session, flight, 0, 1), 1U);
  world.stop_publisher();
  const auto requests = world.bus.subscriptions.size();
  // The same place: as before.
  EXPECT_EQ(world.fly(*session, flight, 0, 1, 5), 1U);
  world.judge = {};
  world.on_report = [](const FrameReport& report) {
    for (const subscriber::PairAnswer& answer : report.answers)
      EXPECT_EQ(answer.awaited.find("no publisher is there") == std::string::npos,
                is_certified(answer.answer.status))
          << answer.awaited;
  };
  EXPECT_LT(world.fly(*session, flight, 1, flight.frames(), 3), flight.frames() - 1);
  EXPECT_GT(world.judge.uncertain + world.judge.partial, 10U);
  EXPECT_EQ(world.bus.subscriptions.size(), requests) << "asked a publisher that is gone";
  EXPECT_EQ(world.fly(*session, flight, 0, 1, 5), 1U);
}

TEST(Session, SendsNothingToALostPublisherWhoseBatchesComeLate) {
  World world;
  world.bus.keep_quiet = true;
  world.start_publisher();
  const auto session = world.make_peer();
  const Flight flight = make_flight(1);
  world.fly(*session, flight, 0, 1, 1);
  wire::SplitBatchMessage late;
  late.publisher = kPublisher;
  late.content_hash = terrain().open().content_hash();
  late.request = late.sequence = 1;
  world.stop_publisher();
  world.bus.lose_publisher(kPublisher);
  world.fly(*session, flight, 1, 2, 1);
  const auto sent = world.bus.subscriptions.size();
  for (late.sequence = 2; late.sequence < 10; ++late.sequence) {
    world.bus.inject(kPeer, late);
    world.fly(*session, flight, 1, 2, 1);
  }
  EXPECT_EQ(world.bus.subscriptions.size(), sent);
  // And whoever asks for a model that nobody serves is told that nobody is there.
  const BodyId ghost =
      session->add_body({.name = "ghost", .model = "spectre", .own = true}).value();
  ASSERT_TRUE(session->watch(ghost, kOne).is_ok());
  EXPECT_EQ(reason_of(world.round(*session), 3), "model spectre of body ghost: no publisher found");
}

TEST(Session, TwoPublishersOfOneModel) {
  World world;
  world.start_publisher();
  world.start_publisher(kPublisher + 1);
  const auto session = world.make_peer();
  const Flight flight = make_flight(2);
  const std::size_t half = flight.frames() / 2;
  EXPECT_EQ(world.fly(*session, flight, 0, half), half);
  // Each request is one publisher's; the last may be on its way.
  const std::uint64_t heard =
      world.service(kPublisher).stats().requests + world.service(kPublisher + 1).stats().requests;
  EXPECT_LE(heard, session->stats().requests);
  EXPECT_GE(heard + 1, session->stats().requests);
  // Whichever was asked, the other takes over.
  const bool first = world.service(kPublisher).stats().requests > 0;
  world.stop_publisher(first ? kPublisher : kPublisher + 1);
  EXPECT_EQ(world.fly(*session, flight, half, flight.frames()), flight.frames() - half);
  EXPECT_TRUE(world.complaints.empty()) << world.complaints.front();
}

// DDS tells that one is gone only when its lease is over.
TEST(Session, AsksAnotherPublisherWhenTheFirstFallsSilent) {
  World world;
  world.bus.keep_quiet = true;
  world.start_publisher();
  world.start_publisher(kPublisher + 1);
  const auto session = world.make_peer();
  const Flight flight = make_flight(2);
  const std::size_t half = flight.frames() / 2;
  EXPECT_EQ(world.fly(*session, flight, 0, half), half);
  const bool first = world.service(kPublisher).stats().requests > 0;
  world.stop_publisher(first ? kPublisher : kPublisher + 1);
  EXPECT_EQ(world.fly(*session, flight, half, flight.frames()), flight.frames() - half);
  EXPECT_TRUE(world.complaints.empty()) << world.complaints.front();
}

TEST(Session, SaysThatItsPublisherDoesNotAnswer) {
  World world;
  world.bus.keep_quiet = true;
  world.start_publisher();
  const auto session = world.make_peer();
  const Flight flight = make_flight(1);
  world.fly(*session, flight, 0, 1);
  world.stop_publisher();
  bool is_said = false;
  world.on_report = [&](const FrameReport& report) {
    for (const subscriber::PairAnswer& answer : report.answers)
      is_said = is_said || answer.awaited.find("publisher 00000000000000a1 has not answered") !=
                               std::string::npos;
  };
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(100);
  while (!is_said && std::chrono::steady_clock::now() < deadline)
    world.fly(*session, flight, 1, flight.frames(), 3);
  EXPECT_TRUE(is_said);
}

TEST(Session, StartsAgainWhenTheContentChanges) {
  World world;
  world.start_publisher();
  const auto session = world.make_peer();
  const Flight flight = make_flight(1);
  const std::size_t half = flight.frames() / 2;
  ASSERT_EQ(world.fly(*session, flight, 0, half), half);
  world.stop_publisher();
  world.start_publisher(kPublisher + 7, other_terrain());
  // The next update takes the news in, and from then on answers are about the new ground.
  world.judge.ground = &other_terrain();
  EXPECT_EQ(world.fly(*session, flight, half, flight.frames()), flight.frames() - half);
  ASSERT_EQ(world.complaints.size(), 1U);
  EXPECT_NE(world.complaints[0].find("model terrain"), std::string::npos);
  EXPECT_NE(world.complaints[0].find("starting again with it"), std::string::npos);
}

TEST(Session, LateBatchesOfTheOldContentDoNoHarm) {
  World world;
  std::vector<wire::SplitBatchMessage> old;
  world.bus.batch_filter = [&](wire::SessionId, wire::SplitBatchMessage& message) {
    old.push_back(message);
    return true;
  };
  world.start_publisher();
  const auto session = world.make_peer();
  const Flight flight = make_flight(1);
  world.fly(*session, flight, 0, 10);
  world.bus.batch_filter = nullptr;
  world.stop_publisher();
  world.start_publisher(kPublisher + 7, other_terrain());
  world.judge.ground = &other_terrain();
  world.fly(*session, flight, 10, 11, 1);
  for (const auto& message : old) world.bus.inject(kPeer, message);
  EXPECT_EQ(world.fly(*session, flight, 11, flight.frames()), flight.frames() - 11);
  EXPECT_EQ(world.complaints.size(), 1U);
}

// ---- what cannot be answered --------------------------------------------------------------------

TEST(Session, SaysThatThereIsNoPublisher) {
  World world;
  const auto session = world.make_peer();
  const Flight flight = make_flight(1);
  EXPECT_EQ(world.fly(*session, flight, 0, 3, 2), 0U);
  const FrameReport report = world.round(*session);
  EXPECT_EQ(reason_of(report, 0), "model terrain of body ground: no publisher found");
  EXPECT_EQ(reason_of(report, 2), "model aircraft of body one: no publisher found");
  EXPECT_TRUE(std::isinf(report.answers[0].answer.uncertainty_m));
  EXPECT_EQ(world.judge.certified(), 0U);
  EXPECT_EQ(session->header_of(kOne), nullptr);
}

TEST(Session, NamesAnUnknownModel) {
  World world;
  world.start_publisher();
  const auto session = world.make_peer();
  const BodyId ghost =
      session->add_body({.name = "ghost", .model = "spectre", .own = true}).value();
  ASSERT_TRUE(session->watch(ghost, kGround).is_ok());
  const Flight flight = make_flight(1);
  for (std::size_t i = 0; i < 5; ++i) {
    FrameReport report;
    for (int round = 0; round < 20; ++round)
      report = world.round(*session, i,
                           {{kOne, flight.one[i]}, {kTwo, flight.two[i]}, {ghost, flight.two[i]}});
    const PairAnswer* unknown = report.find(ghost, kGround);
    ASSERT_NE(unknown, nullptr);
    EXPECT_EQ(unknown->reason, "model spectre of body ghost: no publisher serves it");
    EXPECT_EQ(unknown->answer.status, AnswerStatus::kUncertain);
    EXPECT_FALSE(report.all_certified());
  }
  EXPECT_GT(world.judge.certified(), 10U);  // the other pairs are none the worse
}

TEST(Session, SaysThatAHeaderHasNotCome) {
  World world;
  world.bus.deliver_headers = false;
  world.start_publisher();
  const auto session = world.make_peer();
  const Flight flight = make_flight(1);
  EXPECT_EQ(world.fly(*session, flight, 0, 2, 5), 0U);
  EXPECT_EQ(reason_of(world.round(*session), 0),
            "model terrain of body ground: its header has not come");
  EXPECT_EQ(session->header_of(kOne), nullptr);
  EXPECT_TRUE(world.bus.subscriptions.empty());
  world.bus.release_headers();
  EXPECT_EQ(world.fly(*session, flight), flight.frames());
  EXPECT_EQ(session->header_of(kOne)->face_count, aircraft().model.header.face_count);
  EXPECT_EQ(session->header_of({}), nullptr);
}

TEST(Session, ComplainsOfAMalformedHeader) {
  World world;
  world.bus.deliver_headers = false;
  world.start_publisher();
  const auto session = world.make_peer();
  wire::MeshHeader header{.name = "terrain", .content_hash = terrain().open().content_hash()};
  header.bytes = encode_header(terrain().model.header);
  header.bytes.resize(header.bytes.size() / 2);
  world.bus.inject(kPublisher, header);
  world.round(*session);
  EXPECT_TRUE(world.has_complaint("model terrain: "));
  EXPECT_EQ(session->header_of(kGround), nullptr);
  world.bus.release_headers();  // the right one still can come
  EXPECT_EQ(world.fly(*session, make_flight(1), 0, 5), 5U);
}

TEST(Session, SaysThatAPoseHasNotCome) {
  World world;
  world.start_publisher();
  const auto session = world.make_peer(quick_options(), kPeer, true, false);
  const Flight flight = make_flight(1);
  world.fly_frame(*session, 0, {{kOne, flight.one[0]}}, 50);
  const FrameReport report = world.round(*session);
  EXPECT_TRUE(is_certified(report.answers[0].answer.status));
  EXPECT_EQ(reason_of(report, 1), "no pose of body two has come");
  EXPECT_EQ(reason_of(report, 2), "no pose of body two has come");
  // It comes from whoever moves the body.
  wire::BodyPose pose{.peer = kPeer + 1, .body = "two", .pose = flight.two[0].pose};
  world.bus.inject(pose);
  EXPECT_TRUE(world.fly_frame(*session, 1, {}));
}

TEST(Session, ComplainsWhenAnotherMovesItsBody) {
  World world;
  world.start_publisher();
  const auto session = world.make_peer();
  const Flight flight = make_flight(1);
  world.fly(*session, flight, 0, 1);
  world.bus.inject(wire::BodyPose{.peer = kPeer + 1, .body = "one"});
  const FrameReport report = world.round(*session);
  EXPECT_EQ(report.answers[0].pose_b.translation_m, flight.one[0].pose.translation_m);
  EXPECT_TRUE(world.has_complaint("another peer also moves body one"));
}

TEST(Session, RefusedMotionChangesNothing) {
  World world;
  world.start_publisher();
  const auto session = world.make_peer();
  const auto listener = world.bus.make_peer(kPeer + 1);
  const Flight flight = make_flight(1);
  world.fly(*session, flight, 0, 1);
  const FrameReport before = world.round(*session);
  static_cast<void>(listener->take());

  const auto expect_refused = [&](const std::vector<Session::OwnMotion>& motions, StatusCode code,
                                  const std::string& body) {
    const auto refused = session->update(1, 0.05, motions, 1);
    ASSERT_FALSE(refused.is_ok());
    EXPECT_EQ(refused.status().code(), code);
    EXPECT_NE(refused.status().message().find(body), std::string::npos)
        << refused.status().message();
    world.bus.tick();
    EXPECT_TRUE(listener->take().poses.empty());
    const FrameReport after = world.round(*session);
    for (std::size_t i = 0; i < 3; ++i) {
      EXPECT_EQ(after.answers[i].pose_a.translation_m, before.answers[i].pose_a.translation_m);
      EXPECT_EQ(after.answers[i].pose_b.translation_m, before.answers[i].pose_b.translation_m);
      EXPECT_EQ(after.answers[i].answer.status, before.answers[i].answer.status);
      EXPECT_EQ(after.answers[i].answer.pairs, before.answers[i].answer.pairs);
    }
  };
  const Motion good = flight.one[5];
  Motion nan_place = good, nan_turn = good, skewed = good, nan_speed = good, fast = good;
  nan_place.pose.translation_m[1] = kNan;
  nan_turn.pose.rotation[4] = kNan;
  skewed.pose.rotation[0] += 0.1;
  nan_speed.linear_velocity_mps[0] = kNan;
  fast.angular_velocity_radps[2] = std::numeric_limits<double>::infinity();
  for (const Motion& bad : {nan_place, nan_turn, skewed, nan_speed, fast})
    expect_refused({{kOne, good}, {kTwo, bad}}, StatusCode::kInvalidArgument, "two");
  expect_refused({{kOne, good}, {kGround, good}}, StatusCode::kNotFound, "ground");
  expect_refused({{kOne, good}, {BodyId{7}, good}}, StatusCode::kNotFound,
                 "body 7 is not of this session");
}

TEST(Session, TellsWhatItHoldsAndHowSureItIs) {
  World world;
  const auto session = world.make_peer();
  static_cast<void>(world.round(*session));
  const wire::ProcessStatus& alone = session->status();
  EXPECT_EQ(alone.session, kPeer);
  EXPECT_EQ(alone.watched_pairs, 3U);
  EXPECT_EQ(alone.certified_pairs, 0U);
  ASSERT_EQ(alone.models.size(), 2U);
  EXPECT_FALSE(alone.models[0].content_hash.is_set());

  world.start_publisher();
  const Flight flight = make_flight(3);
  world.fly(*session, flight);
  const Stopwatch clock;
  const double before_s = session->status().uptime_s;
  while (session->status().uptime_s == before_s && clock.seconds() < 100)
    static_cast<void>(world.round(*session));
  const wire::ProcessStatus& after = world.bus.statuses.at(kPeer);
  EXPECT_EQ(after.certified_pairs, 3U);
  EXPECT_EQ(after.uncertainty_m, 0);
  EXPECT_EQ(after.batches, session->stats().batches);
  EXPECT_EQ(after.bytes, session->stats().batch_bytes);
  std::uint64_t held = 0;
  for (const auto& model : after.models) {
    EXPECT_TRUE(model.content_hash.is_set());
    EXPECT_GT(model.faces, 0U);
    held += model.held_splits;
  }
  EXPECT_GT(held, 0U);
  EXPECT_EQ(held, session->stats().held_splits);
}

TEST(Session, RefusesMalformedDeclarations) {
  World world;
  const auto session = world.make_peer();
  const auto added = [&](const std::string& name, const std::string& model) {
    return session->add_body({.name = name, .model = model, .own = true}).status().code();
  };
  EXPECT_EQ(added("one", "aircraft"), StatusCode::kConflict);
  EXPECT_EQ(added("", "aircraft"), StatusCode::kInvalidArgument);
  EXPECT_EQ(added("x", std::string(64, 'm')), StatusCode::kInvalidArgument);
  // What the bus refuses, with all that is told beside it.
  for (const std::string& name : {std::string("H\xc3\xa4her"), std::string(" x"),
                                  std::string("x\ny"), std::string("x\0y", 3)}) {
    EXPECT_EQ(added(name, "aircraft"), StatusCode::kInvalidArgument);
    EXPECT_EQ(added("x", name), StatusCode::kInvalidArgument);
    EXPECT_EQ(session->replace_model(kOne, name).code(), StatusCode::kInvalidArgument);
  }
  EXPECT_EQ(session->place_body({}, {}).code(), StatusCode::kNotFound);
  EXPECT_EQ(session->place_body(kGround, {.translation_m = {kNan, 0, 0}}).code(),
            StatusCode::kInvalidArgument);
  EXPECT_EQ(session->watch(kOne, BodyId{3}).code(), StatusCode::kNotFound);
  EXPECT_EQ(session->watch(kOne, kOne).code(), StatusCode::kInvalidArgument);
}

TEST(Session, NumbersBodiesInTheirOrder) {
  World world;
  world.start_publisher();
  const auto session = world.make_peer();  // three bodies, three pairs
  const BodyId late = session->add_body({.name = "late", .model = "aircraft"}).value();
  EXPECT_EQ(late, BodyId{3});
  ASSERT_TRUE(session->watch(late, kGround).is_ok());
  EXPECT_EQ(session->name_of(late), "late");
  EXPECT_EQ(session->name_of(kTwo), "two");
  EXPECT_EQ(session->name_of(BodyId{4}), "");
  EXPECT_EQ(session->name_of({}), "");
  const FrameReport report = world.round(*session);
  ASSERT_EQ(report.answers.size(), 4U);
  const PairAnswer* pair = report.find(kGround, late);
  ASSERT_NE(pair, nullptr);
  EXPECT_EQ(pair, report.find(late, kGround));
  EXPECT_EQ(pair->a, late);  // as it was watched
  EXPECT_EQ(pair->b, kGround);
  EXPECT_EQ(report.find(late, kOne), nullptr);
}

// ---- bytes that are wrong -----------------------------------------------------------------------

TEST(Session, MalformedBatchesAreComplainedOfAndHarmNothing) {
  World world;
  std::uint64_t spoiled = 0, sent = 0;
  world.bus.batch_filter = [&](wire::SessionId, wire::SplitBatchMessage& message) {
    if (++sent % 3 != 0 || message.bytes.empty()) return true;
    switch (++spoiled % 3) {
      case 0:
        message.bytes[0] = 0x77;
        break;  // flags
      case 1:
        message.bytes.resize(message.bytes.size() - 2);
        break;  // cut
      case 2:
        message.bytes.insert(message.bytes.end(), 3, 0);
        break;  // too long
    }
    return true;
  };
  world.start_publisher();
  const auto session = world.make_peer();
  const Flight flight = make_flight(4);
  EXPECT_EQ(world.fly(*session, flight), flight.frames());
  EXPECT_GT(spoiled, 5U);
  // One line for each model and publisher.
  EXPECT_LE(world.complaints.size(), 2U);
  EXPECT_TRUE(world.has_complaint("model terrain: publisher " + to_hex(kPublisher) +
                                  " sent what came damaged"));
}

/// What it sends is sealed right and is no batch.
bool lie(wire::SplitBatchMessage& message) {
  if (message.bytes.empty()) return false;
  message.bytes = {1, 2, 3};
  seal_batch(message.content_hash, message.bytes);
  return true;
}

TEST(Session, APublisherThatContradictsAModelIsNamedOnceAndAnotherAsked) {
  World world;
  std::uint64_t lies = 0, sent = 0;
  wire::SessionId liar = 0;  // who is asked first, after a while
  world.bus.batch_filter = [&](wire::SessionId, wire::SplitBatchMessage& message) {
    if (liar == 0) liar = message.publisher;
    if (message.publisher == liar && ++sent > 3) lies += lie(message) ? 1 : 0;
    return true;
  };
  world.start_publisher();
  world.start_publisher(kPublisher + 1);
  const auto session = world.make_peer();
  const Flight flight = make_flight(4);
  EXPECT_EQ(world.fly(*session, flight), flight.frames());
  EXPECT_GT(lies, 0U);
  EXPECT_LE(world.complaints.size(), 2U) << "one for each model";
  EXPECT_TRUE(world.has_complaint("publisher " + to_hex(liar) + " contradicts the model"));
  EXPECT_NE(world.bus.subscriptions.back().publisher, liar);
}

TEST(Session, WhereTheOnlyPublisherContradictsAModelAnswersStayUncertain) {
  World world;
  world.bus.batch_filter = [](wire::SessionId, wire::SplitBatchMessage& message) {
    if (message.publisher == kPublisher) lie(message);
    return true;
  };
  world.start_publisher();
  const auto session = world.make_peer();
  const Flight flight = make_flight(4);
  EXPECT_EQ(world.fly(*session, flight, 0, 3, 20), 0U);
  EXPECT_LE(world.complaints.size(), 2U);
  EXPECT_LE(session->stats().requests, 2U) << "one for each model";
  bool is_said = false;
  for (const PairAnswer& answer : world.round(*session).answers)
    is_said |= answer.awaited.find("each publisher that serves it has contradicted it") !=
               std::string::npos;
  EXPECT_TRUE(is_said);
  world.start_publisher(kPublisher + 7);
  EXPECT_EQ(world.fly(*session, flight, 3, 6), 3U);
}

TEST(Session, FloodOfBatchesIsBoundedAndComplainedOfOnce) {
  World world;
  world.start_publisher();
  const auto session = world.make_peer();
  const Flight flight = make_flight(1);
  EXPECT_EQ(world.fly(*session, flight, 0, 1), 1U);
  wire::SplitBatchMessage message{
      .publisher = kPublisher, .content_hash = terrain().open().content_hash(), .sequence = 1};
  message.bytes = {1, 2, 3};
  constexpr std::size_t kMost = 16384;
  for (std::size_t i = 0; i < kMost + 100; ++i) world.bus.inject(kPeer, message);
  const auto report = session->update(2, 0.1, {}, 0);
  ASSERT_TRUE(report.is_ok());
  EXPECT_EQ(report.value().batches_waiting, kMost - 1);  // one is applied, whatever the budget
  std::size_t complaints = 0;
  for (const std::string& line : report.value().complaints)
    complaints += line.find("further ones are dropped") != std::string::npos ? 1 : 0;
  EXPECT_EQ(complaints, 1U);
}

TEST(Session, BatchOfAModelThatNobodyUsesIsIgnored) {
  World world;
  world.start_publisher();
  const auto session = world.make_peer();
  wire::SplitBatchMessage message{
      .publisher = kPublisher, .content_hash = {0, 12345}, .sequence = 1};
  message.bytes = {1, 2, 3};
  world.bus.inject(kPeer, message);
  EXPECT_EQ(world.fly(*session, make_flight(1), 0, 5), 5U);
  EXPECT_TRUE(world.complaints.empty());
}

TEST(Session, TellsWhyARequestWasRefused) {
  World world;
  world.start_publisher();
  const auto session = world.make_peer({.request_timeout_s = 3600});
  world.bus.accept_batches = false;
  const Flight flight = make_flight(1);
  world.fly(*session, flight, 0, 1, 3);
  const auto requests = session->stats().requests;
  ASSERT_GT(requests, 0U);
  wire::SplitBatchMessage refusal{
      .publisher = kPublisher, .request = 1, .sequence = 1, .last = true, .refused = true};
  refusal.content_hash = world.bus.subscriptions.at(0).content_hash;
  for (const char c : std::string("out of splits"))
    refusal.bytes.push_back(static_cast<std::uint8_t>(c));
  world.bus.inject(kPeer, refusal);
  world.fly(*session, flight, 0, 1, 10);
  EXPECT_TRUE(world.has_complaint("publisher refused request 1: out of splits"));
  // One of its two models may be what cannot be had, so each is asked for by itself, once.
  EXPECT_EQ(session->stats().requests, requests + 2) << "a refusal is not asked for at once again";
}

// A large answer may need longer than the time-out. What the publisher sends meanwhile, for others'
// models here, must not have it begun anew for ever.
TEST(Session, WaitsLongerEachTimeThoughThePublisherSendsSomethingElse) {
  constexpr double kTimeout_s = 0.004;
  World world;
  world.start_publisher();
  const auto session = world.make_peer({.request_timeout_s = kTimeout_s});
  world.bus.accept_batches = false;
  const Flight flight = make_flight(1);
  const Stopwatch watch;
  for (std::uint32_t sequence = 1; sequence <= 100; ++sequence) {
    wire::SplitBatchMessage other{
        .publisher = kPublisher, .content_hash = {0, 12345}, .sequence = sequence};
    other.bytes = {1, 2, 3};
    world.bus.inject(kPeer, other);
    world.round(*session, 0, {{kOne, flight.one[0]}, {kTwo, flight.two[0]}});
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  // Of two models at most, and the first of each at once.
  const double most = 2 * (2 + std::log2(watch.seconds() / kTimeout_s));
  EXPECT_GT(session->stats().requests, 1U);
  EXPECT_LE(static_cast<double>(session->stats().requests), most);
}

// ---- budget and memory --------------------------------------------------------------------------

TEST(Session, MakesProgressWithoutBudget) {
  World world;
  world.bus.most_splits = kMaxRequestSplits;
  world.start_publisher();
  SessionOptions options = quick_options();
  options.lookahead_s = 20;               // answers of several batches
  options.clearance = Clearance::kExact;  // no bound of it is kept: each pair is asked, or put off
  const auto session = world.make_peer(options);
  const Flight flight = make_flight(3);
  // One batch and one pair an update, whatever the budget.
  std::uint64_t most_waiting = 0, waiting = 0;
  std::set<std::pair<BodyId, BodyId>> certified;  // of the frame
  world.on_report = [&](const FrameReport& report) {
    EXPECT_EQ(report.pairs_put_off, 2U);
    for (const PairAnswer& answer : report.answers)
      if (is_certified(answer.answer.status)) certified.emplace(answer.a, answer.b);
    if (waiting > 0) {
      EXPECT_LE(waiting, report.batches_waiting + 1) << "more than one batch in one update";
    }
    waiting = report.batches_waiting;
    most_waiting = std::max(most_waiting, waiting);
  };
  for (std::size_t i = 0; i < flight.frames() && !HasFailure(); ++i) {
    certified.clear();
    world.round(*session, i, {{kOne, flight.one[i]}, {kTwo, flight.two[i]}}, 0);
    for (int rounds = 0; certified.size() < 3; ++rounds) {
      ASSERT_LT(rounds, 1000);
      world.round(*session, i, {}, 0);
    }
  }
  EXPECT_GT(most_waiting, 1U);
}

TEST(Session, IsNeverWrongWhenFramesDoNotWait) {
  World world;
  world.bus.on_batches = {.lose = 0.1, .max_delay = 4};
  world.start_publisher();
  const auto session = world.make_peer();
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    const Flight flight = make_flight(seed);
    world.fly(*session, flight, 0, flight.frames(), 1, 0);
  }
  EXPECT_GT(world.judge.certified(), 20U);
  EXPECT_GT(world.judge.uncertain + world.judge.partial, 20U);
}

TEST(Session, GivesUpDetailAboveTheLimit) {
  std::uint64_t most[2] = {};
  for (const bool limited : {false, true}) {
    World world;
    world.start_publisher();
    SessionOptions options = quick_options();
    options.lookahead_s = 0.1;
    if (limited) options.max_held_splits = 100;
    const auto session = world.make_peer(options);
    world.on_report = [&](const FrameReport&) {
      most[limited] = std::max(most[limited], session->stats().held_splits);
    };
    for (std::uint64_t seed = 1; seed <= 4; ++seed) {
      const Flight flight = make_flight(seed);
      EXPECT_EQ(world.fly(*session, flight), flight.frames());
    }
    EXPECT_TRUE(world.complaints.empty()) << world.complaints.front();
    if (!limited) most[0] = session->stats().held_splits;
  }
  std::printf("most splits held: %llu without a limit, %llu with one\n",
              static_cast<unsigned long long>(most[0]), static_cast<unsigned long long>(most[1]));
  EXPECT_LT(most[1], most[0] / 2);
}

TEST(Session, AsksAheadOfNeed) {
  // With look-ahead the first uncertain answer of a straight approach comes later, or never.
  std::uint64_t uncertain[2] = {};
  for (const bool ahead : {false, true}) {
    World world;
    world.bus.most_splits = kMaxRequestSplits;
    world.start_publisher();
    SessionOptions options = quick_options();
    options.lookahead_s = ahead ? 0.5 : 0;
    const auto session = world.make_peer(options);
    const Flight flight = make_flight(1, 6);
    world.fly(*session, flight, 0, 1);
    world.judge = {};
    for (std::size_t i = 1; i < flight.frames(); ++i)
      world.fly_frame(*session, i, {{kOne, flight.one[i]}, {kTwo, flight.two[i]}}, 3);
    uncertain[ahead] = world.judge.uncertain + world.judge.partial;
  }
  EXPECT_LT(uncertain[1], uncertain[0] / 2);
}

// ---- what else an answer says -------------------------------------------------------------------

TEST(Session, NothingTouchesWithinTheSafeHorizon) {
  World world;
  world.start_publisher();
  const auto session = world.make_peer();
  Random random(9);
  int checked = 0;
  double longest = 0;
  const Flight* now = nullptr;
  std::size_t frame = 0;
  world.on_report = [&](const FrameReport& report) {
    for (const auto& answer : report.answers) {
      if (answer.answer.status != AnswerStatus::kFree) {
        EXPECT_EQ(answer.safe_horizon_s, 0);
        continue;
      }
      ASSERT_GE(answer.safe_horizon_s, 0);
      const auto motion_of = [&](BodyId body) {
        return body == kGround ? Motion{} : body == kOne ? now->one[frame] : now->two[frame];
      };
      // Speeds at most as stated: as they are, slower, or another way.
      Motion a = motion_of(answer.a), b = motion_of(answer.b);
      for (Motion* motion : {&a, &b})
        for (auto* v : {&motion->linear_velocity_mps, &motion->angular_velocity_radps}) {
          const std::uint32_t change = random.below(4);
          const double speed = std::hypot((*v)[0], (*v)[1], (*v)[2]);
          const auto r = test::random_rotation(random);  // its first row is a random direction
          for (std::size_t k = 0; k < 3; ++k) {
            if (change == 1) (*v)[k] *= random.unit();
            if (change == 2) (*v)[k] = r[k] * speed;
          }
        }
      for (const double share : {0.25, 0.5, 0.75, 0.9, 0.999}) {
        const double t = std::min(answer.safe_horizon_s, 100.0) * share;
        EXPECT_TRUE(world.judge.touching(answer, test::moved(a, t), test::moved(b, t)).empty())
            << "touch " << t << " s later, safe for " << answer.safe_horizon_s;
        ++checked;
      }
      longest = std::max(longest, answer.safe_horizon_s);
    }
  };
  for (std::uint64_t seed = 1; seed <= 8 && !HasFailure(); ++seed) {
    const Flight flight = make_flight(seed);
    now = &flight;
    for (frame = 0; frame < flight.frames() && !HasFailure(); ++frame)
      world.fly_frame(*session, frame, {{kOne, flight.one[frame]}, {kTwo, flight.two[frame]}});
  }
  EXPECT_GT(checked, 1000);
  EXPECT_GT(longest, 0.05);
}

TEST(Session, SafeHorizonHoldsForAHeadOnApproach) {
  World world;
  world.start_publisher();
  const auto session = world.make_peer();
  // Nose to nose along x; the clearance is that of the noses, so the horizon is nearly the time of
  // contact.
  Motion one, two;
  two.pose.rotation = {-1, 0, 0, 0, -1, 0, 0, 0, 1};
  one.pose.translation_m = {0, 0, 9000};
  two.pose.translation_m = {100, 0, 9000};
  one.linear_velocity_mps = {5, 0, 0};
  two.linear_velocity_mps = {-5, 0, 0};
  ASSERT_TRUE(world.fly_frame(*session, 0, {{kOne, one}, {kTwo, two}}));
  const auto answer = world.round(*session).answers[2];
  ASSERT_EQ(answer.answer.status, AnswerStatus::kFree);
  const double horizon = answer.safe_horizon_s;
  EXPECT_GT(horizon, 1);
  for (int i = 1; i <= 1000; ++i) {
    const double t = horizon * i / 1000;
    ASSERT_TRUE(world.judge.touching(answer, test::moved(one, t), test::moved(two, t)).empty())
        << t;
  }
  one.linear_velocity_mps = two.linear_velocity_mps = {};
  ASSERT_TRUE(world.fly_frame(*session, 1, {{kOne, one}, {kTwo, two}}));
  EXPECT_TRUE(std::isinf(world.round(*session).answers[2].safe_horizon_s));
}

TEST(Session, SaysWhereBodiesTouchWhenAskedTo) {
  for (const bool asked : {true, false}) {
    World world;
    world.start_publisher();
    SessionOptions options = quick_options();
    options.contacts = asked;
    const auto session = world.make_peer(options);
    Motion one, two;
    one.pose.translation_m = {0, 0, 9000};
    two.pose.translation_m = {0, 0, 9001};
    ASSERT_TRUE(world.fly_frame(*session, 0, {{kOne, one}, {kTwo, two}}));
    std::size_t touching = 0;
    const FrameReport report = world.round(*session);
    for (const test::PairAnswer& pair : report.answers) {
      EXPECT_EQ(pair.contacts.has_value(), asked && !pair.answer.pairs.empty());
      if (!pair.contacts) continue;
      ++touching;
      EXPECT_EQ(pair.contacts->pair_total, pair.answer.pair_total);
      EXPECT_GE(pair.contacts->segments.size(), pair.answer.pairs.size());
      for (const ContactPatch& patch : pair.contacts->patches) {
        EXPECT_FALSE(patch.approximate);
        EXPECT_NEAR(patch.centroid_m[2], 9000, 20);  // world frame, far from the models' own
      }
    }
    EXPECT_EQ(touching, asked ? 1U : 0U);
  }
}

TEST(Session, ReportsEachFrameOnceAndWhatChangesInIt) {
  World world;
  world.start_publisher();
  const auto session = world.make_peer();
  Motion one, two;
  one.pose.translation_m = {0, 0, 9000};
  two.pose.translation_m = {0, 0, 9000};
  ASSERT_TRUE(world.fly_frame(*session, 3, {{kOne, one}, {kTwo, two}}));
  const wire::ContactReport last = world.bus.reports.back();
  EXPECT_EQ(last.body_a, "one");
  EXPECT_EQ(last.body_b, "two");
  EXPECT_EQ(last.frame, 3U);
  EXPECT_EQ(last.status, static_cast<std::uint8_t>(AnswerStatus::kContact));
  EXPECT_GT(last.pair_count, wire::kMaxReportPairs);
  EXPECT_EQ(last.pairs.size(), wire::kMaxReportPairs);
  EXPECT_TRUE(last.asked);
  EXPECT_EQ(last.a.era + last.b.era, 0U);
  EXPECT_FALSE(last.world);
  EXPECT_EQ(last.a.content_hash, aircraft().open().content_hash());
  EXPECT_EQ(last.a.pose.translation_m, one.pose.translation_m);
  EXPECT_GT(last.b.applied_batches, 0U);
  auto sent = world.bus.reports.size();
  for (int i = 0; i < 5; ++i) world.round(*session, 4);
  EXPECT_EQ(world.bus.reports.size(), sent + 3);  // three pairs
  two.pose.translation_m = {0, 0, 9100};
  world.round(*session, 4, {{kTwo, two}});
  EXPECT_GT(world.bus.reports.size(), sent + 3);
  EXPECT_NE(world.bus.reports.back().answer_digest, last.answer_digest);
  sent = world.bus.reports.size();

  SessionOptions silent = quick_options();
  silent.publish_reports = false;
  const auto other = world.make_peer(silent, kPeer + 1);
  ASSERT_TRUE(world.fly_frame(*other, 0, {{kOne, one}, {kTwo, two}}));
  EXPECT_EQ(world.bus.reports.size(), sent);
}

// In weeks there were bodies of more models than a status has room for.
TEST(Session, TheStatusTellsOfTheModelsOfBodiesThatAreHere) {
  World world;
  Session session(world.bus.make_peer(kPeer), quick_options());
  for (std::size_t i = 0; i < wire::kMaxModels; ++i) {
    const auto body = session.add_body({.name = "body", .model = "of day " + std::to_string(i)});
    ASSERT_TRUE(session.remove_body(body.value()).is_ok());
  }
  ASSERT_TRUE(session.add_body({.name = "body", .model = "of today"}).is_ok());
  ASSERT_TRUE(session.update(0, 0, {}, 1).is_ok());
  const auto& models = session.status().models;
  ASSERT_EQ(models.size(), 1U);
  EXPECT_EQ(models.front().name, "of today");
}

TEST(Session, NoUpdateTakesLong) {
  // Polled by a host: even an inbox full of batches is left for later once the budget is spent.
  World world;
  world.bus.most_splits = kMaxRequestSplits;
  world.start_publisher();
  const auto session = world.make_peer();
  const Flight flight = make_flight(1);
  world.fly(*session, flight, 0, 1, 1);
  EXPECT_GT(world.round(*session, 0, {}, 0).batches_waiting, 0U);
}

}  // namespace
}  // namespace nearmesh
