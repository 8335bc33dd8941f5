// SPDX-License-Identifier: Apache-2.0
// Samples that are well formed as CDR, but not as messages.
#include "idl/dds/codec.hpp"

#include <gtest/gtest.h>

#include "samples.hpp"

namespace nearmesh::wire {
namespace {

using namespace test;

template <class Sample, class Message, class Spoil>
void expect_refused(const Message& valid, const char* expected, Spoil spoil) {
  Sample sample;
  encode(valid, sample);
  ASSERT_TRUE(decode(sample).is_ok());
  spoil(sample);
  const auto decoded = decode(sample);
  ASSERT_FALSE(decoded.is_ok()) << expected;
  EXPECT_NE(decoded.status().message().find(expected), std::string::npos)
      << decoded.status().message();
}

TEST(Decode, RefusesHelloWhoseListsDiffer) {
  using S = wire_types::HelloSample;
  expect_refused<S>(valid_hello(), "models", [](S& s) { s.mesh_bytes().pop_back(); });
  expect_refused<S>(valid_hello(), "models", [](S& s) { s.replaced_hashes().pop_back(); });
  expect_refused<S>(valid_hello(), "fewer", [](S& s) { s.names().pop_back(); });
  expect_refused<S>(valid_hello(), "more than", [](S& s) { s.names().push_back('\n'); });
  expect_refused<S>(valid_hello(), "fewer", [](S& s) { s.names().push_back('x'); });
  expect_refused<S>(valid_hello(), "models", [](S& s) { s.content_hashes().resize(100'000); });
  expect_refused<S>(valid_hello(), "models", [](S& s) { s.names().assign(100'000, 'x'); });
}

TEST(Decode, RefusesSubscriptionWithPartialRecords) {
  using S = wire_types::RegionSubscriptionSample;
  expect_refused<S>(valid_subscription(), "attach", [](S& s) { s.attach().pop_back(); });
  expect_refused<S>(valid_subscription(), "boxes", [](S& s) { s.region_parts().push_back(1); });
  expect_refused<S>(valid_subscription(), "attach", [](S& s) { s.attach().resize(2000); });
  expect_refused<S>(valid_subscription(), "boxes", [](S& s) { s.region_parts().resize(6000); });
  expect_refused<S>(valid_subscription(), "steps", [](S& s) { s.region_shift(18); });
}

TEST(Decode, RefusesBatchWithUnknownFlags) {
  using S = wire_types::SplitBatchSample;
  expect_refused<S>(valid_batch(), "flags", [](S& s) { s.flags(64); });
}

TEST(Decode, RefusesStatusWhoseListsDiffer) {
  using S = wire_types::ProcessStatusSample;
  expect_refused<S>(valid_status(), "models", [](S& s) { s.faces().pop_back(); });
  expect_refused<S>(valid_status(), "models", [](S& s) { s.held_splits().push_back(1); });
  expect_refused<S>(valid_status(), "models", [](S& s) { s.splits().clear(); });
  expect_refused<S>(valid_status(), "names", [](S& s) { s.names().pop_back(); });
  expect_refused<S>(valid_status(), "flags", [](S& s) { s.flags(16); });
  expect_refused<S>(valid_status(), "complaints: more",
                    [](S& s) { s.complaints().assign(17, '\n'); });
  expect_refused<S>(valid_status(), "complaints: fewer",
                    [](S& s) { s.complaints().push_back('x'); });
}

TEST(Decode, RefusesStatusWithMoreBodiesThanItSays) {
  using S = wire_types::ProcessStatusSample;
  expect_refused<S>(valid_status(), "moved: more", [](S& s) { s.moved().assign(17, '\n'); });
  expect_refused<S>(valid_status(), "moved: fewer", [](S& s) { s.moved().push_back('x'); });
  expect_refused<S>(valid_status(), "bodies", [](S& s) { s.moved_bodies(1); });
}

/// Whatever a stranger calls itself, what it says else counts.
TEST(Decode, MakesNamesFitToBeShown) {
  wire_types::ProcessStatusSample status;
  encode(valid_status(), status);
  status.name("\x1b[2Jrig\n\xff");
  ASSERT_TRUE(decode(status).is_ok()) << decode(status).status().message();
  EXPECT_EQ(decode(status).value().name, "?[2Jrig??");
  wire_types::HelloSample hello;
  encode(valid_hello(), hello);
  hello.name("\x07  ");
  ASSERT_TRUE(decode(hello).is_ok());
  EXPECT_EQ(decode(hello).value().name, "?");
  hello.name("");
  ASSERT_TRUE(decode(hello).is_ok());
  EXPECT_EQ(decode(hello).value().name, "");
}

TEST(Decode, RefusesEchoWithUnknownFlags) {
  using S = wire_types::EchoSample;
  expect_refused<S>(valid_echo(), "flags", [](S& s) { s.flags(2); });
}

TEST(Decode, RefusesWhatIsHeldWithListsThatDoNotBelongTogether) {
  using S = wire_types::HeldDetailSample;
  expect_refused<S>(valid_held(), "heard", [](S& s) { s.heard_sequences().pop_back(); });
  expect_refused<S>(valid_held(), "heard", [](S& s) { s.heard_publishers().resize(1000); });
}

TEST(Decode, RefusesWatchedBodiesWithListsThatDoNotBelongTogether) {
  using S = wire_types::WatchedBodiesSample;
  const char* const lists = "do not belong together";
  expect_refused<S>(valid_watched(), lists, [](S& s) { s.runs().pop_back(); });
  expect_refused<S>(valid_watched(), lists, [](S& s) { s.max_ages_s().push_back(1); });
  expect_refused<S>(valid_watched(), lists, [](S& s) {
    s.max_ages_s().resize(1000);
    s.runs().resize(7000);
  });
  expect_refused<S>(valid_watched(), lists, [](S& s) { s.placed_companies().pop_back(); });
  expect_refused<S>(valid_watched(), lists, [](S& s) { s.placed_poses().resize(23); });
  expect_refused<S>(valid_watched(), lists, [](S& s) {
    s.placed_companies().resize(3000);
    s.placed_poses().resize(12000);
  });
  expect_refused<S>(valid_watched(), lists, [](S& s) { s.content_hashes().pop_back(); });
  expect_refused<S>(valid_watched(), lists, [](S& s) { s.content_hashes().resize(1000); });
  expect_refused<S>(valid_watched(), lists, [](S& s) { s.movers().resize(1000, 1); });
  expect_refused<S>(valid_watched(), lists, [](S& s) { s.names().resize(100'000, 'a'); });
  expect_refused<S>(valid_watched(), "fewer whole", [](S& s) { s.names().pop_back(); });
  expect_refused<S>(valid_watched(), "more than 2", [](S& s) { s.names().push_back('\n'); });
  expect_refused<S>(valid_watched(), "known by 9", [](S& s) { s.runs()[0] = 9; });
  expect_refused<S>(valid_watched(), "mover: found 2 of 2", [](S& s) { s.runs()[1] = 2; });
  expect_refused<S>(valid_watched(), "content: found 4294967295 of 3",
                    [](S& s) { s.runs()[4] = 0xffffffffU; });
  expect_refused<S>(valid_watched(), "content: found 3 of 3",
                    [](S& s) { s.placed_companies()[4] = 3; });
  expect_refused<S>(valid_watched(), "own: found 2 of 2",
                    [](S& s) { s.placed_companies()[3] = 2; });
  expect_refused<S>(valid_watched(), "unknown bits, 2", [](S& s) { s.flags(2); });
}

TEST(Decode, RefusesBoundsOfWhichOctetsDoNotFit) {
  using S = wire_types::BoundsReportSample;
  const char* const unfit = "too soon, or are too many";
  expect_refused<S>(valid_bounds(), unfit, [](S& s) { s.known().pop_back(); });
  expect_refused<S>(valid_bounds(), unfit, [](S& s) { s.known().clear(); });
  expect_refused<S>(valid_bounds(), unfit, [](S& s) { s.known().resize(200'000, 0); });
  expect_refused<S>(valid_bounds(), unfit, [](S& s) {
    s.known() = {2, 1, 0, 0, 0};
  });  // no promises
  expect_refused<S>(valid_bounds(), unfit, [](S& s) {
    s.known() = {2, 1, 1, 0, 0xff, 0xff, 0x7f};  // so many poses
  });
  expect_refused<S>(valid_bounds(), unfit, [](S& s) { s.known().resize(50'000, 0); });
}

TEST(Decode, RefusesReportOfAnUnknownMover) {
  using S = wire_types::ContactReportSample;
  expect_refused<S>(valid_report(), "flags: found unknown bits, 93", [](S& s) { s.flags(93); });
  expect_refused<S>(valid_report(), "movers: found 5", [](S& s) { s.movers()[1] = 5; });
}

TEST(Decode, RefusesReportWithPartialPairs) {
  using S = wire_types::ContactReportSample;
  expect_refused<S>(valid_report(), "pairs", [](S& s) { s.pairs().pop_back(); });
  expect_refused<S>(valid_report(), "pairs", [](S& s) { s.pairs().resize(4000); });
}

}  // namespace
}  // namespace nearmesh::wire
