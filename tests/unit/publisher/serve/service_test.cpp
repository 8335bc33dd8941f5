// SPDX-License-Identifier: Apache-2.0
#include "publisher/serve/service.hpp"

#include <algorithm>
#include <set>

#include "core/demand/collect.hpp"
#include "core/replica/held_nodes.hpp"
#include "held_whole.hpp"
#include "memory_channel.hpp"
#include "test_models.hpp"

namespace nearmesh {
namespace {

using publisher::Service;
using publisher::ServiceOptions;

constexpr wire::SessionId kPublisher = 0xa1, kPeer = 0xb1, kOtherPeer = 0xb2;

// One service with a terrain, and a peer whose raw inbox the test reads.
struct Desk {
  // Time mostly stands still here, so the pace cannot be learnt: it is tested in pacing_test.cpp.
  static ServiceOptions unpaced(ServiceOptions options) {
    options.pacing.initial_window_bytes = options.pacing.least_window_bytes = 1 << 20;
    return options;
  }
  explicit Desk(ServiceOptions options = {})
      : service(*publisher_end, kPublisher, unpaced(options)) {
    EXPECT_EQ(service.add_model("terrain", open()).message(), "");
    service.announce();
  }
  ModelFile open() const { return std::move(ModelFile::open(file->path())).value(); }

  GridBox everything() const {
    return {{{0, 0, 0}},
            {{model.store.grid_max(), model.store.grid_max(), model.store.grid_max()}}};
  }
  ContentHash hash() const { return open().content_hash(); }
  std::vector<std::uint8_t> header_bytes() const {
    const ModelFile file_now = open();
    return {file_now.header_bytes().begin(), file_now.header_bytes().end()};
  }

  // For the whole model, from its roots.
  wire::RegionSubscription request(std::uint32_t number, std::uint32_t max_splits = 16384) const {
    wire::RegionSubscription subscription;
    subscription.peer = kPeer;
    subscription.request = number;
    subscription.content_hash = hash();
    subscription.publisher = kPublisher;
    subscription.window_bytes = 1 << 20;
    for (const BaseRoot& root : model.header.roots)
      if (root.node.size > 1) subscription.region.attach.push_back(root.node);
    subscription.region.region = {everything()};
    subscription.region.max_splits = max_splits;
    return subscription;
  }
  wire::RegionSubscription credit(std::uint32_t acknowledged, wire::SessionId peer = kPeer) const {
    wire::RegionSubscription subscription;
    subscription.peer = peer;
    subscription.publisher = kPublisher;
    subscription.acknowledged_sequence = acknowledged;
    subscription.window_bytes = 4096;
    return subscription;
  }
  std::vector<wire::SplitBatchMessage> received() { return peer_end->take().batches; }
  std::vector<wire::SplitBatchMessage> other_received() { return other_end->take().batches; }

  // Sends a request that must be refused, and gives the reason that both the peer and the log got.
  std::string refusal(const wire::RegionSubscription& subscription) {
    bus.inject(subscription);
    refused_s += Service::kRefusalPeriod_s;
    const auto complaints = service.step(refused_s);
    const auto batches = received();
    if (batches.size() != 1 || complaints.size() != 1) {
      ADD_FAILURE() << batches.size() << " batches, " << complaints.size() << " complaints";
      return {};
    }
    EXPECT_TRUE(batches[0].refused);
    EXPECT_TRUE(batches[0].last);
    EXPECT_EQ(batches[0].request, subscription.request);
    const std::string reason(batches[0].bytes.begin(), batches[0].bytes.end());
    EXPECT_NE(complaints[0].find(reason), std::string::npos) << complaints[0];
    EXPECT_NE(complaints[0].find("00000000000000b1"), std::string::npos) << complaints[0];
    return reason;
  }

  test::MemoryBus bus;
  std::unique_ptr<publisher::Channel> publisher_end = bus.make_publisher(kPublisher);
  std::unique_ptr<subscriber::Channel> peer_end = bus.make_peer(kPeer);
  std::unique_ptr<subscriber::Channel> other_end = bus.make_peer(kOtherPeer);
  // Large enough for a dozen batches.
  BakedModel model = test::bake_mesh(generate_terrain(64, 7), 16);
  std::unique_ptr<test::TempFile> file = test::write_model(model);
  Service service;
  double refused_s = 0;
};

std::size_t framed(const std::vector<wire::SplitBatchMessage>& batches) {
  std::size_t bytes = 0;
  for (const auto& batch : batches) bytes += batch.bytes.size() + kBatchFramingBytes;
  return bytes;
}

TEST(Service, TellsEachSecondWhatItServesAndRefuses) {
  Desk desk;
  static_cast<void>(desk.service.step(10));
  const wire::ProcessStatus& first = desk.bus.statuses.at(kPublisher);
  EXPECT_TRUE(first.is_publisher);
  EXPECT_EQ(first.requests, 0U);
  ASSERT_EQ(first.models.size(), 1U);
  EXPECT_EQ(first.models[0].content_hash, desk.hash());
  EXPECT_EQ(first.models[0].faces, desk.model.header.face_count);

  wire::RegionSubscription bad = desk.request(1);
  bad.content_hash = {0, 1};
  desk.bus.inject(bad);
  wire::RegionSubscription good = desk.request(2);
  good.window_bytes = 2000;
  desk.bus.inject(good);
  static_cast<void>(desk.service.step(10.5));
  EXPECT_EQ(desk.bus.statuses.at(kPublisher).requests, 0U);
  static_cast<void>(desk.service.step(11));
  const wire::ProcessStatus& second = desk.bus.statuses.at(kPublisher);
  EXPECT_EQ(second.requests, 2U);
  EXPECT_EQ(second.refused, 1U);
  EXPECT_EQ(second.peers, 1U);
  EXPECT_GT(second.waiting_batches, 0U);
  EXPECT_EQ(second.bytes, desk.service.stats().bytes);
  EXPECT_EQ(second.uptime_s, 1);
  EXPECT_EQ(second.bytes_per_s, static_cast<double>(second.bytes));
  ASSERT_EQ(second.complaints.size(), 1U);
  EXPECT_NE(second.complaints[0].find("no model, tile or page with that content hash"),
            std::string::npos);
  EXPECT_EQ(desk.service.status().requests, 2U);
}

TEST(Service, AnnouncesModelsWithTheirHeaders) {
  Desk desk;
  const subscriber::Channel::Inbox inbox = desk.peer_end->take();
  ASSERT_EQ(inbox.hellos.size(), 1U);
  EXPECT_EQ(inbox.hellos[0].publisher, kPublisher);
  ASSERT_EQ(inbox.hellos[0].models.size(), 1U);
  EXPECT_EQ(inbox.hellos[0].models[0].name, "terrain");
  EXPECT_EQ(inbox.hellos[0].models[0].content_hash, desk.hash());
  EXPECT_EQ(inbox.hellos[0].models[0].mesh_bytes, desk.open().mesh_bytes());
  ASSERT_EQ(inbox.headers.size(), 1U);
  EXPECT_EQ(inbox.headers[0].message.content_hash, desk.hash());
  EXPECT_EQ(inbox.headers[0].message.bytes, desk.header_bytes());
}

TEST(Service, AnswersWithTheBatchesThatCollectNames) {
  Desk desk;
  for (const std::uint32_t max_splits : {1U, 50U, 16384U}) {
    wire::RegionSubscription subscription = desk.request(max_splits, max_splits);
    const std::int32_t middle = desk.model.store.grid_max() / 2;
    subscription.region.region = {
        GridBox{{{0, 0, 0}}, {{middle, middle, desk.model.store.grid_max()}}}};
    const Result<Demand> demand =
        collect(desk.model.store, subscription.region, test::no_require, AttachRule::kAlways);
    ASSERT_TRUE(demand.is_ok());
    auto expected = encode_batches(desk.model.header, desk.model.store, demand.value().treelet,
                                   BoxPolicy::kCutNodes);
    for (auto& bytes : expected) seal_batch(desk.hash(), bytes);
    desk.bus.inject(subscription);
    EXPECT_TRUE(desk.service.step(0).empty());
    const auto batches = desk.received();
    ASSERT_EQ(batches.size(), expected.size());
    for (std::size_t i = 0; i < batches.size(); ++i) {
      EXPECT_EQ(batches[i].bytes, expected[i]);
      EXPECT_EQ(batches[i].last, i + 1 == batches.size());
      EXPECT_EQ(batches[i].request, subscription.request);
      EXPECT_EQ(batches[i].content_hash, desk.hash());
      EXPECT_EQ(batches[i].publisher, kPublisher);
      EXPECT_FALSE(batches[i].refused);
    }
  }
}

TEST(Service, PeerLostAndBackIsAnsweredAnew) {
  Desk desk;
  desk.bus.inject(desk.request(1));
  desk.service.step(0);
  const auto before = desk.received();
  // The loss, and what its writer says again once it is found.
  desk.bus.lose_peer(kPeer);
  desk.bus.inject(desk.request(1));
  desk.service.step(0.1);
  const auto after = desk.received();
  ASSERT_GT(before.size(), 2U);
  ASSERT_EQ(after.size(), before.size());
  for (std::size_t i = 0; i < after.size(); ++i) {
    EXPECT_EQ(after[i].sequence, i + 1);
    EXPECT_EQ(after[i].bytes, before[i].bytes);
  }
}

TEST(Service, NumbersItsBatchesFromOneForEachPeer) {
  Desk desk;
  wire::RegionSubscription other = desk.request(1);
  other.peer = kOtherPeer;
  desk.bus.inject(desk.request(1));
  desk.bus.inject(other);
  desk.service.step(0);
  for (const auto& batches : {desk.received(), desk.other_received()}) {
    ASSERT_GT(batches.size(), 2U);
    for (std::size_t i = 0; i < batches.size(); ++i) EXPECT_EQ(batches[i].sequence, i + 1);
  }
}

// A peer that lost the batch with a node's box goes by an ancestor's; it must get on all the same.
TEST(Service, SplitsAttachNodesWhateverTheirBoxes) {
  Desk desk;
  wire::RegionSubscription subscription = desk.request(1);
  subscription.region.region = {GridBox{{{0, 0, 0}}, {{0, 0, 0}}}};  // a corner of the grid
  const NodeSpan root = desk.model.header.roots.back().node;
  subscription.region.attach = {root};
  ASSERT_FALSE(subscription.region.region[0].meets(desk.model.store.box(root)));
  desk.bus.inject(subscription);
  desk.service.step(0);
  const auto batches = desk.received();
  ASSERT_EQ(batches.size(), 1U);
  EXPECT_TRUE(batches[0].last);
  const Result<SplitBatch> batch = decode_sealed(desk.open().header(), batches[0].bytes);
  ASSERT_TRUE(batch.is_ok());
  ASSERT_EQ(batch.value().splits.size(), 1U);
  EXPECT_EQ(batch.value().splits[0].node, root);
}

TEST(Service, SendsByPriorityThenByArrival) {
  Desk desk;
  desk.bus.accept_batches = false;
  std::vector<std::unique_ptr<test::TempFile>> files;
  std::uint32_t number = 0;
  for (const auto& [mesh, priority] : {std::pair("sphere", 1),
                                       {"soup", 1},
                                       {"components", 0},
                                       {"degenerate", 1},
                                       {"aircraft", 0}}) {
    const BakedModel model = test::bake_named(mesh);
    files.push_back(test::write_model(model));
    ModelFile file = std::move(ModelFile::open(files.back()->path())).value();
    wire::RegionSubscription subscription = desk.request(++number);
    subscription.content_hash = file.content_hash();
    subscription.priority = static_cast<std::uint8_t>(priority);
    subscription.region.attach.clear();
    for (const BaseRoot& root : model.header.roots)
      if (root.node.size > 1) subscription.region.attach.push_back(root.node);
    ASSERT_TRUE(desk.service.add_model(mesh, std::move(file)).is_ok());
    desk.bus.inject(subscription);
  }
  EXPECT_TRUE(desk.service.step(0).empty());
  EXPECT_TRUE(desk.received().empty());
  desk.bus.accept_batches = true;
  desk.service.step(0);
  std::vector<std::uint32_t> order;
  std::uint32_t sequence = 0;
  for (const auto& batch : desk.received()) {
    EXPECT_EQ(batch.sequence, ++sequence);  // by sending, not by arrival of the requests
    if (order.empty() || order.back() != batch.request) order.push_back(batch.request);
  }
  EXPECT_EQ(order, (std::vector<std::uint32_t>{3, 5, 1, 2, 4}));
}

TEST(Service, NewerRequestReplacesWhatWaitsForItsModel) {
  Desk desk;
  wire::RegionSubscription subscription = desk.request(1);
  subscription.window_bytes = 3000;
  desk.bus.inject(subscription);
  desk.service.step(0);
  EXPECT_EQ(desk.received().size(), 2U);  // more wait for credit
  subscription = desk.request(2, 10);
  subscription.acknowledged_sequence = 2;
  desk.bus.inject(subscription);
  desk.service.step(0);
  const auto batches = desk.received();
  ASSERT_EQ(batches.size(), 1U);
  EXPECT_EQ(batches[0].request, 2U);
  EXPECT_EQ(batches[0].sequence, 3U);
  EXPECT_TRUE(batches[0].last);
}

TEST(Service, KeepsTheWindowAndGoesOnWhenAcknowledged) {
  Desk whole;
  whole.bus.inject(whole.request(1));
  whole.service.step(0);
  const std::size_t expected = whole.received().size();

  Desk desk;
  wire::RegionSubscription subscription = desk.request(1);
  subscription.window_bytes = 4096;
  desk.bus.inject(subscription);
  std::size_t received = 0;
  for (std::uint32_t round = 0; round < 1000; ++round) {
    desk.service.step(0);  // time stands still: no credit comes back by itself
    const auto batches = desk.received();
    EXPECT_LE(framed(batches), 4096U);
    if (batches.empty()) break;
    received += batches.size();
    desk.service.step(0);
    EXPECT_TRUE(desk.received().empty()) << "sent without credit";
    desk.bus.inject(desk.credit(batches.back().sequence));
  }
  EXPECT_GT(expected, 5U);
  EXPECT_EQ(received, expected);
}

TEST(Service, CapsAWindowThatIsTooLarge) {
  Desk desk({.max_window_bytes = 4096});
  desk.bus.inject(desk.request(1));
  desk.service.step(0);
  const auto batches = desk.received();
  EXPECT_GE(batches.size(), 2U);
  EXPECT_LE(framed(batches), 4096U);
}

TEST(Service, SendsLittleBeforeItKnowsTheLink) {
  Desk desk;
  Service paced(*desk.publisher_end, kPublisher);
  ASSERT_TRUE(paced.add_model("terrain", desk.open()).is_ok());
  desk.bus.inject(desk.request(1));
  paced.step(0);
  EXPECT_LE(framed(desk.received()), ServiceOptions{}.pacing.initial_window_bytes);
}

// What is under way cannot be overtaken, so little is.
TEST(Service, NeededNowOvertakesWhatWaitsOfAHorizon) {
  Desk desk;
  Service paced(*desk.publisher_end, kPublisher);
  ASSERT_TRUE(paced.add_model("terrain", desk.open()).is_ok());
  const BakedModel sphere = test::bake_named("sphere");
  const auto file = test::write_model(sphere);
  ModelFile opened = std::move(ModelFile::open(file->path())).value();
  wire::RegionSubscription horizon = desk.request(1), urgent = desk.request(2, 10);
  horizon.priority = 1;
  urgent.content_hash = opened.content_hash();
  urgent.region.attach = {sphere.header.roots[0].node};
  ASSERT_TRUE(paced.add_model("sphere", std::move(opened)).is_ok());
  desk.bus.inject(horizon);
  paced.step(0);
  const auto before = desk.received();
  ASSERT_FALSE(before.empty());
  EXPECT_FALSE(before.back().last);
  EXPECT_LE(framed(before), ServiceOptions{}.pacing.initial_window_bytes);
  desk.bus.inject(urgent);
  desk.bus.inject(desk.credit(before.back().sequence));
  paced.step(0.1);
  const auto after = desk.received();
  ASSERT_FALSE(after.empty());
  EXPECT_EQ(after.front().request, 2U);
}

TEST(Service, SendsOneBatchAtATimeThroughATinyWindow) {
  Desk desk;
  wire::RegionSubscription subscription = desk.request(1);
  subscription.window_bytes = 1;
  desk.bus.inject(subscription);
  for (std::uint32_t i = 1; i <= 3; ++i) {
    desk.service.step(0);
    EXPECT_EQ(desk.received().size(), 1U);
    wire::RegionSubscription credit = desk.credit(i);
    credit.window_bytes = 1;
    desk.bus.inject(credit);
  }
}

TEST(Service, CreditOfLostBatchesComesBackAfterTheTimeOut) {
  Desk desk({.pacing = {.timeout_s = 1}});
  wire::RegionSubscription subscription = desk.request(1);
  subscription.window_bytes = 4096;
  desk.bus.inject(subscription);
  desk.service.step(10);
  const std::size_t first = desk.received().size();
  ASSERT_GT(first, 0U);
  desk.service.step(10.9);
  EXPECT_EQ(desk.received().size(), 0U);
  desk.service.step(11.1);
  EXPECT_GT(desk.received().size(), 0U);
}

TEST(Service, PeerThatNeverAcknowledgesStallsNoOther) {
  Desk desk;
  wire::RegionSubscription silent = desk.request(1), lively = desk.request(1);
  silent.window_bytes = 2000;
  lively.peer = kOtherPeer;
  lively.window_bytes = 4096;
  desk.bus.inject(silent);
  desk.bus.inject(lively);
  std::vector<wire::SplitBatchMessage> all;
  for (int round = 0; round < 1000 && (all.empty() || !all.back().last); ++round) {
    desk.service.step(0);
    for (auto& batch : desk.other_received()) all.push_back(std::move(batch));
    ASSERT_FALSE(all.empty());
    desk.bus.inject(desk.credit(all.back().sequence, kOtherPeer));
  }
  EXPECT_TRUE(all.back().last);
  EXPECT_EQ(desk.received().size(), 1U);
}

TEST(Service, PeersTakeTurns) {
  Desk desk;
  wire::RegionSubscription other = desk.request(1);
  other.peer = kOtherPeer;
  std::vector<wire::SessionId> order;
  desk.bus.batch_filter = [&](wire::SessionId peer, wire::SplitBatchMessage&) {
    order.push_back(peer);
    return true;
  };
  desk.bus.accept_batches = false;  // until there is something for both
  desk.bus.inject(desk.request(1));
  desk.bus.inject(other);
  desk.service.step(0);
  desk.bus.accept_batches = true;
  desk.service.step(0);
  ASSERT_GT(order.size(), 10U);
  for (std::size_t i = 1; i < 10; ++i) EXPECT_NE(order[i], order[i - 1]);
}

TEST(Service, KeepsBatchesThatTheChannelCannotTakeNow) {
  Desk desk;
  desk.bus.accept_batches = false;
  desk.bus.inject(desk.request(1));
  desk.service.step(0);
  EXPECT_EQ(desk.service.stats().batches, 0U);
  desk.bus.accept_batches = true;
  desk.service.step(0);
  const auto batches = desk.received();
  ASSERT_FALSE(batches.empty());
  EXPECT_EQ(batches.front().sequence, 1U);
  EXPECT_TRUE(batches.back().last);
}

TEST(Service, RefusesUnknownModel) {
  Desk desk;
  wire::RegionSubscription subscription = desk.request(1);
  subscription.content_hash.low ^= 1;
  EXPECT_EQ(desk.refusal(subscription),
            "no model, tile or page with that content hash is served here");
  EXPECT_EQ(desk.service.stats().refused, 1U);
}

TEST(Service, RefusesMalformedRequests) {
  Desk desk;
  std::uint32_t number = 0;
  const auto expect_refused = [&](const std::function<void(RegionRequest&)>& spoil,
                                  const std::string& why) {
    wire::RegionSubscription subscription = desk.request(++number);
    spoil(subscription.region);
    const std::string reason = desk.refusal(subscription);
    EXPECT_NE(reason.find(why), std::string::npos) << "expected " << why << ", got " << reason;
  };
  expect_refused([](RegionRequest& r) { r.attach.clear(); }, "no attach node");
  expect_refused([](RegionRequest& r) { r.attach.assign(kMaxAttachNodes + 1, r.attach[0]); },
                 "at most 512 attach nodes, found 513");
  expect_refused([](RegionRequest& r) { r.region.clear(); }, "no region box");
  expect_refused([](RegionRequest& r) { r.region.assign(kMaxRegionBoxes + 1, r.region[0]); },
                 "at most 256 region boxes, found 257");
  expect_refused([](RegionRequest& r) { r.region[0] = GridBox{}; }, "an empty region box");
  expect_refused([](RegionRequest& r) { r.max_splits = 0; }, "max_splits");
  expect_refused([](RegionRequest& r) { r.max_splits = kMaxRequestSplits + 1; }, "max_splits");
  expect_refused([](RegionRequest& r) { r.attach.back().size = 0xffffffffU; }, "outside any model");
  expect_refused([](RegionRequest& r) { r.attach = {{{0}, 1}}; }, "leaf");
  expect_refused([](RegionRequest& r) { std::swap(r.attach[0], r.attach[1]); }, "must ascend");
  EXPECT_EQ(desk.service.stats().refused, number);
  EXPECT_EQ(desk.service.stats().requests, number);
}

TEST(Service, RefusesAttachNodeThatIsNoNode) {
  Desk desk;
  wire::RegionSubscription subscription = desk.request(1);
  // The two halves of the first root's first split, shifted by one: an interval that no tree node
  // has.
  const NodeSpan root = desk.model.header.roots[0].node;
  ASSERT_GT(root.size, 4U);
  subscription.region.attach = {{{root.begin() + 1}, root.size - 1}};
  if (desk.model.store.is_node(subscription.region.attach[0])) --subscription.region.attach[0].size;
  ASSERT_FALSE(desk.model.store.is_node(subscription.region.attach[0]));
  EXPECT_NE(desk.refusal(subscription).find("is not a node of the model"), std::string::npos);
}

TEST(Service, RefusalsOfOnePeerAreOneLineInAWhile) {
  Desk desk;
  wire::RegionSubscription subscription = desk.request(0);
  subscription.content_hash.low ^= 1;
  std::size_t lines = 0, refusals = 0;
  for (std::uint32_t i = 1; i <= 50; ++i) {
    subscription.request = i;
    desk.bus.inject(subscription);
    lines += desk.service.step(0.1 * i).size();
    for (const auto& batch : desk.received()) refusals += batch.refused ? 1 : 0;
  }
  EXPECT_EQ(lines, 1U);
  EXPECT_EQ(refusals, 50U);
  subscription.request = 51;
  desk.bus.inject(subscription);
  const auto later = desk.service.step(0.1 + Service::kRefusalPeriod_s);
  ASSERT_EQ(later.size(), 1U);
  EXPECT_NE(later[0].find("(and 49 before it)"), std::string::npos) << later[0];
}

// A model whose answers have no end, and count what is made of them: 'A' for the peer that asks for
// all, 'B' for the other.
struct Endless {
  static constexpr ContentHash kHash{0, 77};
  static constexpr std::size_t kPartBytes = 4000;
  explicit Endless(Desk& desk) {
    desk.service.add_answerer(kHash, [this](const RegionRequest& request) {
      const bool all = request.max_splits == kMaxRequestSplits;
      begun += all ? 'A' : 'B';
      return Service::Parts([this, all]() -> Result<Service::Part> {
        made += all ? 'A' : 'B';
        const std::vector<std::uint8_t> batch(kPartBytes / 4);
        return Service::Part{kHash, {batch, batch, batch, batch}, !all};
      });
    });
  }
  static wire::RegionSubscription request(const Desk& desk, std::uint32_t number, bool all) {
    wire::RegionSubscription subscription = desk.request(number, all ? kMaxRequestSplits : 1);
    subscription.content_hash = kHash;
    if (!all) subscription.peer = kOtherPeer;
    return subscription;
  }
  std::string begun, made;
};

TEST(Service, FloodOfRequestsCostsTheOthersOneTurn) {
  Desk desk;
  Endless endless(desk);
  std::uint32_t flood = 0;
  for (std::uint32_t i = 1; i <= 30; ++i) {
    for (int repeat = 0; repeat < 100; ++repeat)
      desk.bus.inject(Endless::request(desk, ++flood, true));
    desk.bus.inject(Endless::request(desk, i, false));
    endless.begun.clear();
    endless.made.clear();
    desk.service.step(i);
    // One of a hundred was begun, and at most one part made before the other peer had its answer.
    EXPECT_EQ(std::count(endless.begun.begin(), endless.begun.end(), 'A'), 1);
    EXPECT_LE(endless.made.find('B'), 1U) << endless.made;
    const auto answered = desk.other_received();
    ASSERT_FALSE(answered.empty());
    EXPECT_TRUE(answered.back().last);
    EXPECT_EQ(answered.back().request, i);
    static_cast<void>(desk.received());
  }
  EXPECT_EQ(desk.service.stats().requests, 3030U);
}

// An answer in many short parts, as a certificate is, waits for one long part of another peer's,
// not for one at each of its own.
TEST(Service, ManyShortPartsWaitForOneLongPart) {
  Desk desk;
  constexpr ContentHash kShort{0, 78};
  constexpr int kParts = 10;
  Endless endless(desk);
  desk.service.add_answerer(kShort, [&](const RegionRequest&) {
    return Service::Parts([&, left = kParts]() mutable -> Result<Service::Part> {
      endless.made += 'B';
      return Service::Part{.content = kShort, .last = --left == 0, .took_s = Service::kTurn_s / 20};
    });
  });
  for (std::uint32_t i = 1; i <= 20; ++i) {
    desk.bus.inject(Endless::request(desk, i, true));
    wire::RegionSubscription other = desk.request(i, 10);
    other.peer = kOtherPeer;
    other.content_hash = kShort;
    desk.bus.inject(other);
    endless.made.clear();
    desk.service.step(i);
    const std::string until_answered = endless.made.substr(0, endless.made.rfind('B'));
    EXPECT_EQ(std::count(endless.made.begin(), endless.made.end(), 'B'), kParts);
    EXPECT_LE(std::count(until_answered.begin(), until_answered.end(), 'A'), 1) << endless.made;
    EXPECT_FALSE(desk.other_received().empty());
    static_cast<void>(desk.received());
  }
}

// Who asked for nothing for long has saved nothing up: it does not keep the others waiting for as
// long.
TEST(Service, WhoWaitedForNothingHasNoMoreThanTheOthers) {
  Desk desk;
  Endless endless(desk);
  constexpr ContentHash kLong{0, 78};
  desk.service.add_answerer(kLong, [&](const RegionRequest&) {
    return Service::Parts([&]() -> Result<Service::Part> {
      endless.made += 'B';
      return Service::Part{.content = kLong};
    });
  });
  for (std::uint32_t i = 1; i <= 50; ++i) {  // alone
    desk.bus.inject(Endless::request(desk, i, true));
    desk.service.step(i);
    static_cast<void>(desk.received());
  }
  endless.made.clear();
  desk.bus.inject(Endless::request(desk, 51, true));
  wire::RegionSubscription other = desk.request(1, 10);
  other.peer = kOtherPeer;
  other.content_hash = kLong;
  desk.bus.inject(other);
  desk.service.step(51);
  // A part with its batches takes twice what one without does.
  EXPECT_EQ(endless.made.substr(0, 9).find("BBBB"), std::string::npos) << endless.made;
  EXPECT_NE(endless.made.substr(0, 9).find('A'), std::string::npos) << endless.made;
}

// A thousand a second: each would give up what was begun for the one before it.
TEST(Service, FloodIsBegunAnewAHundredTimesASecond) {
  Desk desk;
  Endless endless(desk);
  const auto flood = [&](std::uint32_t from, double at_s, double step_s) {
    endless.begun.clear();
    for (std::uint32_t i = 0; i < 1000; ++i) {
      desk.bus.inject(Endless::request(desk, from + i, true));
      desk.service.step(at_s + i * step_s);
      static_cast<void>(desk.received());
    }
    return endless.begun.size();
  };
  const std::size_t begun = flood(1, 1, 0.001);
  EXPECT_GE(begun, 90U);
  EXPECT_LE(begun, 120U);
  // As fast as frames come none waits.
  EXPECT_EQ(flood(2001, 10, 0.0125), 1000U);
}

TEST(Service, FloodOfRequestsForWhatIsNotThereCostsTheOthersOneTurn) {
  Desk desk;
  std::uint32_t flood = 0;
  for (std::uint32_t i = 1; i <= 30; ++i) {
    for (int repeat = 0; repeat < 100; ++repeat) {
      wire::RegionSubscription nowhere = desk.request(++flood);
      nowhere.content_hash = {0, flood};
      desk.bus.inject(nowhere);
    }
    wire::RegionSubscription other = desk.request(i, 10);
    other.peer = kOtherPeer;
    desk.bus.inject(other);
    desk.service.step(0);
    const auto answered = desk.other_received();
    ASSERT_FALSE(answered.empty());
    EXPECT_TRUE(answered.back().last);
    EXPECT_FALSE(answered.back().refused);
    const auto refused = desk.received();
    ASSERT_EQ(refused.size(), 1U);  // the newest
    EXPECT_EQ(refused[0].request, flood);
    EXPECT_TRUE(refused[0].refused);
    desk.bus.inject(desk.credit(refused[0].sequence));
  }
}

/// Two bodies of a model, of a peer that says what it holds of it.
wire::RegionSubscription telling(std::uint32_t number, wire::SessionId peer,
                                 const CertificateRequest::Model& model) {
  wire::RegionSubscription subscription;
  subscription.peer = peer;
  subscription.request = number;
  subscription.publisher = kPublisher;
  subscription.window_bytes = 1 << 20;
  CertificateRequest& asked = subscription.certificate.emplace();
  asked.models = {model};
  asked.pairs.resize(1);
  asked.pairs[0].translation_m[2] = 1e5F;  // far off: nothing is lacking
  return subscription;
}

/// Of the terrain, all of it.
wire::RegionSubscription telling(const Desk& desk, std::uint32_t number, wire::SessionId peer,
                                 bool truly) {
  ModelFile file = desk.open();
  const std::vector<std::uint8_t> held = test::held_whole(file.header());
  const std::shared_ptr<Mirror> all = make_mirror(test::lent(file), held).value();
  return telling(number, peer, {desk.hash(), all->state() + (truly ? 0 : 1), held});
}

/// What a split that is told costs, and what is charged for it (service.cpp).
constexpr double kTold_s = 0.8e-6, kCharged_s = 2e-6;

// To make a mirror of a peer's word takes long, and the word may be false: a peer that says it
// again and again waits for its turn.
TEST(Service, WhatPeersSayThatTheyHoldIsPaidWithTime) {
  Desk desk;
  const wire::RegionSubscription lie = telling(desk, 0, kPeer, false);
  const std::size_t splits = desk.model.header.split_count();
  std::size_t judged = 0;
  constexpr double kBegin_s = 10, kSeconds = 4;
  for (std::uint32_t i = 1; i <= 1000 * kSeconds; ++i) {
    wire::RegionSubscription subscription = lie;
    subscription.request = i;
    subscription.acknowledged_sequence = i;
    desk.bus.inject(subscription);
    const double now_s = kBegin_s + 0.001 * i;
    desk.service.step(now_s);
    for (const auto& message : desk.received()) judged += message.wants_regions ? 1 : 0;
  }
  // And as much is lent as it costs to tell once all that is taken of a model.
  const double told_s = kCharged_s * static_cast<double>(splits),
               paid_s = told_s * static_cast<double>(judged);
  EXPECT_LE(paid_s, kSeconds + kCharged_s * static_cast<double>(MirrorMaker::kMostHeld) + told_s);
  EXPECT_GE(paid_s, kSeconds);
  // Another one is taken at its word at once, and so is who says nothing of the kind.
  desk.bus.inject(telling(desk, 1, kOtherPeer, true));
  wire::RegionSubscription silent = lie;
  silent.request = 100'000;
  silent.certificate->models[0].held.clear();
  silent.certificate->models[0].state = 0;
  desk.bus.inject(silent);
  for (int i = 0; i < 100; ++i) desk.service.step(kBegin_s + kSeconds);
  const auto answered = desk.other_received();
  ASSERT_FALSE(answered.empty());
  EXPECT_FALSE(answered.back().refused);
  EXPECT_TRUE(answered.back().last);
  const auto mine = desk.received();
  ASSERT_FALSE(mine.empty());
  EXPECT_EQ(mine.back().request, silent.request);
}

// To wake a mirror is to make it of such a word: who owes much waits for that, too.
TEST(Service, MirrorsThatWakeArePaidWithTime) {
  Desk desk;
  const BakedModel model = test::bake_mesh(generate_terrain(144, 7), 16);
  const std::unique_ptr<test::TempFile> path = test::write_model(model);
  ASSERT_EQ(desk.service.add_model("large", ModelFile::open(path->path()).value()).message(), "");
  ModelFile large = ModelFile::open(path->path()).value();
  const CertificateRequest::Model lie{large.content_hash(), 1, test::held_whole(large.header())};
  const wire::RegionSubscription truth = telling(desk, 1, kPeer, true);
  ModelFile file = desk.open();
  const CertificateRequest::Model known{desk.hash(), truth.certificate->models[0].state, {}};
  const CertificateRequest::Model nothing{desk.hash(), Mirror(test::lent(file)).state(), {}};
  std::uint32_t number = 0;
  const auto ask = [&](const CertificateRequest::Model& asked) {
    desk.bus.inject(telling(++number, kPeer, asked));
    do desk.service.step(1);
    while (desk.service.is_behind());
    std::vector<wire::SplitBatchMessage> batches = desk.received();
    if (!batches.empty()) desk.bus.inject(desk.credit(batches.back().sequence));
    return batches;
  };
  ASSERT_FALSE(ask(truth.certificate->models[0]).back().refused);
  const double lie_s = kCharged_s * static_cast<double>(large.header().split_count());
  const double lent_s = kCharged_s * static_cast<double>(MirrorMaker::kMostHeld);
  for (double owed_s = 0; owed_s < lent_s + 2 * lie_s; owed_s += lie_s) {
    if (const auto judged = ask(lie); !judged.empty()) {
      ASSERT_TRUE(judged.back().wants_regions);
    }
  }
  EXPECT_EQ(ask(known).size(), 1U) << "that is awake costs nothing";
  // Others come, and it falls asleep.
  constexpr wire::SessionId kFirst = 0x100;
  const std::size_t others = 2 * Mirrors::kMaxAwakeSplits / Mirrors::kSplitsAMirror;
  for (wire::SessionId id = kFirst; id < kFirst + others; ++id)
    desk.bus.inject(telling(1, id, nothing));
  do desk.service.step(1);
  while (desk.service.is_behind());
  EXPECT_EQ(ask(known).size(), 0U);
  desk.service.step(1 + lent_s);
  const auto answered = desk.received();
  ASSERT_EQ(answered.size(), 1U);
  EXPECT_TRUE(answered[0].last && !answered[0].refused);
}

// It is taken in turns, as all else is, so nobody waits for it, not even of many such.
TEST(Service, WhoSaysThatItHoldsMuchCostsTheOthersOneTurn) {
  Desk desk;
  const BakedModel model = test::bake_mesh(generate_terrain(260, 7), 16);
  const std::unique_ptr<test::TempFile> path = test::write_model(model);
  ASSERT_EQ(desk.service.add_model("large", ModelFile::open(path->path()).value()).message(), "");
  ModelFile file = ModelFile::open(path->path()).value();
  const std::vector<std::uint8_t> held = test::held_whole(file.header());
  const std::uint64_t state = make_mirror(test::lent(file), held).value()->state();
  std::vector<std::unique_ptr<subscriber::Channel>> ends;
  for (wire::SessionId id = 0xc0; id < 0xcc; ++id) {
    ends.push_back(desk.bus.make_peer(id));
    desk.bus.inject(telling(1, id, {file.content_hash(), state, held}));
  }
  desk.service.step(1);
  wire::RegionSubscription other = desk.request(1, 10);
  other.peer = kOtherPeer;
  desk.bus.inject(other);
  desk.service.step(1);
  const auto others = desk.other_received();
  ASSERT_FALSE(others.empty());
  EXPECT_TRUE(others.back().last);
  for (auto& end : ends) EXPECT_TRUE(end->take().batches.empty()) << "it takes more turns";
  // All have theirs in the end.
  for (int i = 0; i < 100 && desk.service.is_behind(); ++i) desk.service.step(1);
  for (auto& end : ends) {
    const auto answered = end->take().batches;
    ASSERT_FALSE(answered.empty());
    EXPECT_TRUE(answered.back().last && !answered.back().refused);
  }
}

// What comes by regions is not on its mirror, so it says what it holds with each request for a
// certificate.
TEST(Service, WhoMixesRegionsAndCertificatesWaitsNoLongerThanItsWordCosts) {
  Desk desk;
  const BakedModel model = test::bake_mesh(generate_terrain(144, 7), 16);
  const std::unique_ptr<test::TempFile> path = test::write_model(model);
  ASSERT_EQ(desk.service.add_model("large", ModelFile::open(path->path()).value()).message(), "");
  ModelFile file = ModelFile::open(path->path()).value();
  const ContentHash content = file.content_hash();
  const std::size_t splits = file.header().split_count();
  ASSERT_GT(splits, 20'000U);
  // All of it, and all but one split.
  const std::shared_ptr<Mirror> peers =
      make_mirror(test::lent(file), test::held_whole(file.header())).value();
  ActiveMesh& mesh = peers->model().mesh;
  const CertificateRequest::Model whole{content, mesh.state_hash(), held_nodes(mesh).bits};
  NodeSpan last = file.header().roots.front().node;
  while (last.size > 2) {
    const VertexId split = file.store().split_of(last);
    last = std::max(last.left_of(split), last.right_of(split),
                    [](NodeSpan one, NodeSpan other) { return one.size < other.size; });
  }
  RefineDelta delta;
  mesh.collapse(last, delta);
  const CertificateRequest::Model less{content, mesh.state_hash(), held_nodes(mesh).bits};

  wire::RegionSubscription region = desk.request(0, 1);
  region.content_hash = content;
  region.region.attach = {file.header().roots.front().node};
  const auto expect_answered = [&](std::uint32_t number, double at_s) {
    const auto batches = desk.received();
    ASSERT_FALSE(batches.empty()) << "request " << number << " at " << at_s;
    EXPECT_EQ(batches.back().request, number) << "at " << at_s;
    EXPECT_TRUE(batches.back().last && !batches.back().refused);
    desk.bus.inject(desk.credit(batches.back().sequence));
  };
  std::uint32_t number = 0;
  for (int i = 0; i < 40; ++i) {
    double now_s = 10 + 0.05 * i;
    region.request = ++number;
    desk.bus.inject(region);
    desk.service.step(now_s);
    expect_answered(number, now_s);
    desk.bus.inject(telling(++number, kPeer, i % 2 == 0 ? whole : less));
    desk.service.step(now_s);
    now_s += kTold_s * static_cast<double>(splits);
    desk.service.step(now_s);
    expect_answered(number, now_s);
  }
}

// Small batches of two models: one datagram, and each is numbered.
TEST(Service, BatchesOfOneAnswerShareADatagram) {
  Desk desk;
  const BakedModel model = test::bake_mesh(generate_terrain(24, 7), 32);  // the same ground
  const std::unique_ptr<test::TempFile> path = test::write_model(model);
  ASSERT_EQ(desk.service.add_model("other", ModelFile::open(path->path()).value()).message(), "");
  const ContentHash other = ModelFile::open(path->path()).value().content_hash();
  std::vector<std::size_t> joined, bytes;
  desk.bus.batch_filter = [&](wire::SessionId, wire::SplitBatchMessage& sample) {
    joined.push_back(sample.joined.size());
    bytes.push_back(sample_bytes(sample));
    return true;
  };
  wire::RegionSubscription asked = telling(1, kPeer, {desk.hash(), 0, {}});
  asked.certificate->models.push_back({other, 0, {}});
  asked.certificate->pairs[0] = {.b = 1, .translation_m = {0, 0, 40}};
  desk.bus.inject(asked);
  do desk.service.step(0);
  while (desk.service.is_behind());
  ASSERT_EQ(joined, std::vector<std::size_t>{1});
  const auto received = desk.received();
  ASSERT_EQ(received.size(), 2U);
  EXPECT_EQ(received[0].content_hash, desk.hash());
  EXPECT_EQ(received[1].content_hash, other);
  EXPECT_EQ(received[0].sequence + 1, received[1].sequence);
  EXPECT_FALSE(received[0].last);
  EXPECT_TRUE(received[1].last);
  EXPECT_EQ(desk.service.stats().batches, 2U);
  EXPECT_EQ(desk.service.stats().bytes, bytes[0] + kBatchFramingBytes);
  for (const auto& message : received)
    EXPECT_TRUE(unseal_batch(message.content_hash, message.bytes).is_ok());
}

// A request for one model replaces what waits of a certificate for it. Of its other model the peer
// waits for the end.
TEST(Service, ACertificateEndsThoughWhatWaitedOfItWasReplaced) {
  Desk desk;
  const BakedModel model = test::bake_mesh(generate_terrain(64, 7), 32);  // the same ground
  const std::unique_ptr<test::TempFile> path = test::write_model(model);
  ASSERT_EQ(desk.service.add_model("other", ModelFile::open(path->path()).value()).message(), "");
  const ContentHash other = ModelFile::open(path->path()).value().content_hash();

  wire::RegionSubscription both = telling(1, kPeer, {desk.hash(), 0, {}});
  both.window_bytes = 3000;
  both.certificate->models.push_back({other, 0, {}});
  both.certificate->pairs = {{.b = 1}};
  desk.bus.inject(both);
  desk.service.step(0);
  std::uint32_t sequence = 0;
  for (const auto& message : desk.received()) {
    EXPECT_FALSE(message.last);
    sequence = message.sequence;
  }
  ASSERT_GT(sequence, 0U);
  for (const std::uint32_t number : {2U, 3U}) {
    wire::RegionSubscription one = desk.request(number, 10);
    one.acknowledged_sequence = sequence;
    if (number == 3) one.content_hash = other;
    desk.bus.inject(one);
  }
  std::vector<std::uint32_t> ended;
  for (int i = 0; i < 50; ++i) {
    desk.service.step(0);
    for (const auto& message : desk.received()) {
      sequence = message.sequence;
      if (message.last) ended.push_back(message.request);
    }
    desk.bus.inject(desk.credit(sequence));
  }
  std::sort(ended.begin(), ended.end());
  EXPECT_EQ(ended, (std::vector<std::uint32_t>{1, 2, 3}));
}

TEST(Service, NothingIsMadeThatWouldOnlyWait) {
  Desk desk;
  Endless endless(desk);
  desk.bus.accept_batches = false;
  desk.bus.inject(Endless::request(desk, 1, true));
  for (int i = 0; i < 100; ++i) desk.service.step(0);
  EXPECT_FALSE(desk.service.is_behind());
  EXPECT_LE(endless.made.size() * Endless::kPartBytes,
            Service::kEnoughQueuedBytes + Endless::kPartBytes);
  // What it takes is what is made for it.
  desk.bus.accept_batches = true;
  wire::RegionSubscription credit = desk.credit(0);
  std::size_t taken = 0;
  for (int i = 0; i < 100; ++i) {
    desk.service.step(0.01 * i);
    const auto batches = desk.received();
    taken += framed(batches);
    if (!batches.empty()) credit.acknowledged_sequence = batches.back().sequence;
    desk.bus.inject(credit);
  }
  EXPECT_GT(taken, 10 * Service::kEnoughQueuedBytes);
  EXPECT_LE(endless.made.size() * Endless::kPartBytes,
            taken + Service::kEnoughQueuedBytes + Endless::kPartBytes);
}

TEST(Service, OneStepEndsThoughThereIsMoreToDo) {
  Desk desk;
  desk.service.add_answerer({0, 7}, [](const RegionRequest&) {
    return Service::Parts([] { return Result<Service::Part>(Service::Part{}); });
  });
  wire::RegionSubscription subscription = desk.request(1);
  subscription.content_hash = {0, 7};
  desk.bus.inject(subscription);
  desk.service.step(0);
  EXPECT_TRUE(desk.service.is_behind());
}

// Where each answer is begun but long in coming, only some are under way; none is left out for
// good.
TEST(Service, FewAnswersAreCollectedAtATime) {
  Desk desk;
  int under_way = 0, most = 0, answered = 0;
  desk.service.add_answerer({0, 7}, [&](const RegionRequest&) {
    most = std::max(most, ++under_way);
    return Service::Parts([&, left = 5]() mutable -> Result<Service::Part> {
      if (--left > 0) return Service::Part{};
      --under_way;
      ++answered;
      return Service::Part{{}, {}, true};
    });
  });
  for (wire::SessionId peer = 1; peer <= 40; ++peer) {
    wire::RegionSubscription subscription = desk.request(1);
    subscription.peer = peer;
    subscription.content_hash = {0, 7};
    desk.bus.inject(subscription);
  }
  for (int i = 0; i < 40; ++i) desk.service.step(0);
  EXPECT_EQ(answered, 40);
  EXPECT_EQ(most, 8);
}

// A place among those that collect is given up in the end, though the peer takes nothing and its
// queue is full of what is urgent.
TEST(Service, WhoTakesNothingHoldsUpNobodysCollecting) {
  Desk desk;
  constexpr wire::SessionId kStalled = 8;
  std::set<int> begun;
  int next = 0;
  desk.service.add_answerer({0, 7}, [&](const RegionRequest&) {
    begun.insert(next);
    return Service::Parts([left = 300]() mutable -> Result<Service::Part> {
      if (--left > 0) return Service::Part{};
      return Service::Part{{}, {}, true};
    });
  });
  desk.service.add_answerer({0, 9}, [&](const RegionRequest&) {
    return Service::Parts([]() -> Result<Service::Part> {
      return Service::Part{{0, 9}, {std::vector<std::uint8_t>(1000)}, false};
    });
  });
  desk.bus.accept_batches = false;
  const auto ask = [&](wire::SessionId peer, std::uint32_t number, std::uint64_t content,
                       std::uint8_t priority) {
    wire::RegionSubscription subscription = desk.request(number);
    subscription.peer = peer;
    subscription.content_hash = {0, content};
    subscription.priority = priority;
    desk.bus.inject(subscription);
  };
  for (wire::SessionId peer = 1; peer <= kStalled; ++peer) ask(peer, 1, 7, 1);
  desk.service.step(0);
  for (wire::SessionId peer = 1; peer <= kStalled; ++peer) ask(peer, 2, 9, 0);
  desk.service.step(0.01);
  next = 1;
  ask(kStalled + 1, 1, 7, 1);
  for (int i = 2; i < 60; ++i) desk.service.step(0.01 * i);
  EXPECT_TRUE(begun.contains(1)) << "the ninth waits for those that take nothing";
}

TEST(Service, KeepsServingAfterARefusal) {
  Desk desk;
  wire::RegionSubscription bad = desk.request(1);
  bad.region.attach.clear();
  EXPECT_FALSE(desk.refusal(bad).empty());
  desk.bus.inject(desk.request(2));
  EXPECT_TRUE(desk.service.step(0).empty());
  EXPECT_GT(desk.received().size(), 2U);
}

TEST(Service, AnswersRepeatsOnce) {
  Desk desk;
  for (int i = 0; i < 3; ++i) desk.bus.inject(desk.request(7, 10));
  desk.bus.inject(desk.request(6, 10));  // older still
  desk.service.step(0);
  const auto batches = desk.received();
  EXPECT_EQ(std::count_if(batches.begin(), batches.end(), [](const auto& b) { return b.last; }), 1);
  EXPECT_EQ(desk.service.stats().requests, 1U);
}

TEST(Service, CreditAloneIsNoRequest) {
  Desk desk;
  desk.bus.inject(desk.credit(0));
  EXPECT_TRUE(desk.service.step(0).empty());
  EXPECT_TRUE(desk.received().empty());
  EXPECT_EQ(desk.service.stats().requests, 0U);
}

TEST(Service, ForgetsLostPeers) {
  Desk desk;
  desk.bus.accept_batches = false;
  desk.bus.inject(desk.request(1));
  desk.service.step(0);
  EXPECT_EQ(desk.service.stats().peers, 1U);
  desk.bus.lose_peer(kPeer);
  desk.bus.accept_batches = true;
  desk.service.step(0);
  EXPECT_EQ(desk.service.stats().peers, 0U);
  EXPECT_TRUE(desk.received().empty());
  // One that comes back starts anew: numbers of requests and of batches too.
  desk.bus.inject(desk.request(1, 10));
  desk.service.step(0);
  const auto batches = desk.received();
  ASSERT_FALSE(batches.empty());
  EXPECT_EQ(batches[0].sequence, 1U);
}

TEST(Service, IgnoresMessagesForAnotherPublisher) {
  Desk desk;
  wire::RegionSubscription subscription = desk.request(1);
  subscription.publisher = kPublisher + 1;
  desk.bus.inject(subscription);
  EXPECT_TRUE(desk.service.step(0).empty());
  EXPECT_TRUE(desk.received().empty());
  EXPECT_EQ(desk.service.stats().peers, 0U);
}

TEST(Service, RefusesDuplicateNameAndContent) {
  Desk desk;
  const auto sphere = test::write_model(test::bake_named("sphere"));
  Status status =
      desk.service.add_model("terrain", std::move(ModelFile::open(sphere->path())).value());
  EXPECT_EQ(status.code(), StatusCode::kConflict);
  EXPECT_EQ(status.message(),
            sphere->path() + ": the name terrain is taken by " + desk.file->path());
  status = desk.service.add_model("ground", desk.open());
  EXPECT_EQ(status.code(), StatusCode::kConflict);
  EXPECT_NE(status.message().find("same content"), std::string::npos);
  EXPECT_NE(status.message().find("terrain"), std::string::npos);
}

TEST(Service, RefusesToReplaceItsOwnContent) {
  Desk desk;
  const Status status = desk.service.add_model("ground", desk.open(), desk.hash());
  EXPECT_EQ(status.code(), StatusCode::kInvalidArgument);
  EXPECT_NE(status.message().find(to_hex(desk.hash())), std::string::npos) << status.message();
}

// Two rivals, and one that takes the place of both one after the other; each line once.
TEST(Service, TellsOfRivalsOfItsNames) {
  Desk desk;
  const ContentHash first{0, 1}, second{0, 2};
  const auto announce = [&](publisher::Channel& channel, wire::SessionId id, ContentHash content,
                            ContentHash replaces) {
    wire::Hello hello{.publisher = id};
    hello.models.push_back({"terrain", content, 100, replaces});
    channel.announce(hello, {});
  };
  const auto one = desk.bus.make_publisher(0xa2), two = desk.bus.make_publisher(0xa3);
  announce(*two, 0xa3, desk.hash(), {});  // the same content: nothing is wrong
  EXPECT_TRUE(desk.service.step(0).empty());
  announce(*one, 0xa2, first, {});
  auto lines = desk.service.step(0.1);
  ASSERT_EQ(lines.size(), 1U);
  EXPECT_EQ(lines[0].find("model terrain: publisher 00000000000000a2 serves other content, " +
                          to_hex(first) + ", under this name, here it is " + to_hex(desk.hash())),
            0U)
      << lines[0];
  EXPECT_TRUE(desk.service.step(0.2).empty());
  const auto notes = [&] {
    const auto& all = desk.service.status().complaints;
    return std::count_if(all.begin(), all.end(), [](const std::string& line) {
      return line.find("model terrain: publisher") != std::string::npos;
    });
  };
  static_cast<void>(desk.service.step(200));  // longer than a line is kept
  EXPECT_EQ(notes(), 1);
  announce(*one, 0xa2, first, second);  // replaces what nobody serves: as before
  EXPECT_TRUE(desk.service.step(201).empty());
  announce(*one, 0xa2, first, desk.hash());
  lines = desk.service.step(202);
  ASSERT_EQ(lines.size(), 1U);
  EXPECT_EQ(lines[0].find("model terrain: publisher 00000000000000a2 replaces content " +
                          to_hex(desk.hash()) + ", which is served here, by " + to_hex(first)),
            0U)
      << lines[0];
  desk.bus.lose_publisher(0xa2);
  EXPECT_TRUE(desk.service.step(203).empty());
  static_cast<void>(desk.service.step(400));
  EXPECT_EQ(notes(), 0);
}

// Who serves an epoch before is told when peers leave it; who serves the later one has no rival.
TEST(Service, TellsOfALaterEpochOfItsNames) {
  Desk desk;
  const auto end = desk.bus.make_publisher(0xa2);
  Service later(*end, 0xa2);
  const auto file = test::write_model(test::bake_mesh(generate_terrain(8, 3), 16));
  ASSERT_TRUE(later
                  .add_model("terrain", ModelFile::open(file->path()).value(), desk.hash(),
                             {.number = 2, .from_s = 12.5})
                  .is_ok());
  later.announce();
  const auto lines = desk.service.step(0);
  ASSERT_EQ(lines.size(), 1U);
  EXPECT_NE(lines[0].find("serves epoch 2"), std::string::npos) << lines[0];
  EXPECT_NE(lines[0].find("peers go over to it at 12.5"), std::string::npos) << lines[0];
  EXPECT_TRUE(desk.service.step(0.1).empty());
  EXPECT_TRUE(later.step(0).empty());
}

TEST(Service, RefusesNamesThatDoNotFit) {
  Desk desk;
  // A hello with such a name is not sent, so that none of the models would be served.
  for (const std::string& name : {std::string(), std::string(64, 'x'), std::string("m\xc3\xa9")})
    EXPECT_EQ(desk.service.add_model(name, desk.open()).code(), StatusCode::kInvalidArgument);
}

TEST(Service, SaysWhenAModelFileIsDamaged) {
  Desk desk;
  const std::vector<std::uint8_t> bytes = desk.file->read();
  test::TempFile damaged;
  // Somewhere in a block: where the file still opens, but not all of it can be read.
  Service service(*desk.publisher_end, kPublisher);
  bool found = false;
  for (std::size_t at = 0; at < bytes.size() && !found; at += 256) {
    std::vector<std::uint8_t> changed = bytes;
    changed[at] ^= 0x55;
    damaged.write(changed);
    Result<ModelFile> opened = ModelFile::open(damaged.path());
    found = opened.is_ok() && !opened.value().require_all().is_ok();
    if (!found) continue;
    ASSERT_TRUE(
        service.add_model("terrain", std::move(ModelFile::open(damaged.path())).value()).is_ok());
  }
  ASSERT_TRUE(found);
  desk.bus.inject(desk.request(1));
  const auto complaints = service.step(0);
  ASSERT_EQ(complaints.size(), 1U);
  EXPECT_NE(complaints[0].find(damaged.path()), std::string::npos) << complaints[0];
  const auto batches = desk.received();
  ASSERT_EQ(batches.size(), 1U);
  EXPECT_TRUE(batches[0].refused);
}

}  // namespace
}  // namespace nearmesh
