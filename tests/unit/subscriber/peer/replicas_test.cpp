// SPDX-License-Identifier: Apache-2.0
// Which headers a peer keeps for models that nobody uses yet.

#include "subscriber/peer/replicas.hpp"

#include <gtest/gtest.h>

#include <array>
#include <map>
#include <set>
#include <utility>

#include "core/base/digest.hpp"
#include "core/world/page.hpp"
#include "nearmesh/core/mesh/generate.hpp"
#include "test_models.hpp"

namespace nearmesh::subscriber {
namespace {

Channel::Header header_of(std::uint64_t number, std::size_t bytes) {
  return {7,
          {wire::kWireVersion,
           "model" + std::to_string(number),
           {0, number},
           std::vector<std::uint8_t>(bytes)}};
}

/// Whether a header was kept: it is no header really, so using it is complained about.
bool is_kept(ReplicaSet& replicas, std::uint64_t number) {
  std::vector<std::string> complaints;
  EXPECT_EQ(
      replicas.assign(replicas.add("model" + std::to_string(number)), {0, number}, complaints), 0U);
  return !complaints.empty();
}

TEST(WaitingBatches, AFloodOfOneTakesNoOthersPlace) {
  WaitingBatches waiting;
  for (std::size_t i = 0; i < WaitingBatches::kMostOfOne; ++i) ASSERT_TRUE(waiting.add({7, {1}}));
  EXPECT_FALSE(waiting.add({7, {2}}));
  EXPECT_TRUE(waiting.add({8, {3}}));
  // Who has a place again is let in; all come in the order in which they went in.
  EXPECT_EQ(waiting.take().publisher, 7U);
  EXPECT_TRUE(waiting.add({7, {4}}));
  EXPECT_FALSE(waiting.add({7, {5}}));
  std::vector<std::uint8_t> last;
  for (; !waiting.empty(); last.push_back(waiting.take().bytes.front()))
    if (last.size() == 2) last.erase(last.begin());
  EXPECT_EQ(last, (std::vector<std::uint8_t>{3, 4}));
}

TEST(ReplicaSet, KeepsHeadersOfUnusedModelsUpToACount) {
  ReplicaSet replicas;
  std::vector<std::string> complaints;
  for (std::uint64_t number = 1; number <= 400; ++number)
    EXPECT_EQ(replicas.take_header(header_of(number, 100), complaints), 0U);
  EXPECT_TRUE(is_kept(replicas, wire::kMaxModels));
  EXPECT_FALSE(is_kept(replicas, 399));
  // One place is free again; a repeat takes none.
  for (int i = 0; i < 3; ++i)
    static_cast<void>(replicas.take_header(header_of(500, 100), complaints));
  static_cast<void>(replicas.take_header(header_of(501, 100), complaints));
  EXPECT_TRUE(is_kept(replicas, 500));
  EXPECT_TRUE(complaints.empty());
}

TEST(ReplicaSet, KeepsHeadersOfUnusedModelsUpToASize) {
  constexpr std::size_t kMiB = 1U << 20;
  ReplicaSet replicas;
  std::vector<std::string> complaints;
  for (std::uint64_t number = 1; number <= 20; ++number)
    static_cast<void>(replicas.take_header(header_of(number, kMiB), complaints));
  EXPECT_FALSE(is_kept(replicas, kMaxSpareHeaderBytes / kMiB + 1));
  EXPECT_TRUE(is_kept(replicas, kMaxSpareHeaderBytes / kMiB));
  // Of a model in use that does not stand for it yet, always.
  replicas.add("model30");
  static_cast<void>(replicas.take_header(header_of(31, kMiB), complaints));  // fills the free place
  static_cast<void>(replicas.take_header(header_of(30, kMiB), complaints));
  EXPECT_TRUE(is_kept(replicas, 30));
}

// A world's tiles are many, and alike.
TEST(ReplicaSet, ModelsOfOneKindShareTheirCodingTables) {
  ReplicaSet replicas;
  std::vector<std::string> complaints;
  std::map<std::pair<CodingSet, std::array<std::uint8_t, 3>>, std::set<const void*>> tables;
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    const std::vector<std::uint8_t> bytes =
        encode_header(test::bake_mesh(generate_terrain(40, seed)).header);
    const ContentHash content = decode_header(bytes).value().content;
    const std::string name = "ground" + std::to_string(seed);
    PeerModel& model = replicas.add(name);
    static_cast<void>(
        replicas.take_header({7, {wire::kWireVersion, name, content, bytes}}, complaints));
    static_cast<void>(replicas.assign(model, content, complaints));
    ASSERT_TRUE(model.replica);
    const SpmHeader& header = model.replica->header();
    ASSERT_NE(header.tables.set().number, 0U);
    tables[{header.tables.set(), header.lattice_shift}].insert(header.tables.fast());
  }
  EXPECT_LT(tables.size(), 4U);
  for (const auto& [set, places] : tables) EXPECT_EQ(places.size(), 1U);
}

// Other peers name models, and in weeks there are many of which no body is left: each costs time in
// every frame.
TEST(ReplicaSet, ModelsThatBodiesLeftMakeRoom) {
  ReplicaSet replicas;
  std::vector<std::string> complaints;
  for (int i = 0; i < 1000; ++i)
    static_cast<void>(replicas.leave(replicas.add("never came" + std::to_string(i))));
  EXPECT_TRUE(replicas.all().empty());
  const auto use = [&](std::uint64_t number) -> PeerModel& {
    PeerModel& model = replicas.add("model" + std::to_string(number));
    if (model.is_held()) return model;
    static_cast<void>(replicas.assign(model, {0, number}, complaints));
    model.world.emplace();  // as if its header had come
    model.header = header_of(number, 100);
    return model;
  };
  use(1);
  for (std::uint64_t number = 2; number <= wire::kMaxModels + 1; ++number)
    EXPECT_TRUE(replicas.leave(use(number)).empty());
  static_cast<void>(use(2));  // a body came back
  EXPECT_TRUE(replicas.leave(use(1000)).empty());
  EXPECT_EQ(replicas.leave(use(1001)), std::vector<ContentHash>{(ContentHash{0, 3})});
  EXPECT_EQ(replicas.all().size(), wire::kMaxModels + 2);
  EXPECT_NE(replicas.find("model1"), nullptr);
  EXPECT_NE(replicas.find("model2"), nullptr);
  EXPECT_EQ(replicas.find("model3"), nullptr);
  EXPECT_EQ(replicas.find(ContentHash{0, 3}), nullptr);
  EXPECT_TRUE(is_kept(replicas, 3)) << "its header, for a body that comes back";
}

// Weeks bring many contents that nobody serves any more: those that are there now shall find room,
// and the others stay as long as there is some.
TEST(ReplicaSet, HeadersOfContentsThatNobodyServesMakeRoom) {
  ReplicaSet replicas;
  std::vector<std::string> complaints;
  const auto take = [&](std::uint64_t number, std::uint64_t first_served) {
    const Channel::Header header = header_of(number, 100);
    replicas.make_room_for(header.message, [&](const ContentHash& content) {
      return content.low >= first_served || content.low == 1;
    });
    static_cast<void>(replicas.take_header(header, complaints));
  };
  constexpr std::uint64_t kMost = wire::kMaxModels, kLast = 3 * kMost;
  for (std::uint64_t number = 1; number <= kLast; ++number) take(number, number);
  EXPECT_FALSE(is_kept(replicas, 2));
  EXPECT_FALSE(is_kept(replicas, kLast - kMost + 1));
  EXPECT_TRUE(is_kept(replicas, kLast - kMost + 2));
  EXPECT_TRUE(is_kept(replicas, kLast));
  EXPECT_TRUE(is_kept(replicas, 1));  // is served
  for (std::uint64_t number = kLast + 1; number <= kLast + kMost; ++number) take(number, 0);
  EXPECT_TRUE(is_kept(replicas, kLast + 3));
  EXPECT_FALSE(is_kept(replicas, kLast + 4));  // all are served
}

// A tile is asked for until its header is here: with each round trip there would be one more line,
// for ever.
TEST(ReplicaSet, AHeaderOfATileThatCannotBeTakenIsComplainedOfOnce) {
  ReplicaSet replicas;
  std::vector<std::string> complaints;
  std::vector<std::uint8_t> world_bytes = encode_world({});
  world_bytes[4] ^= 1;  // of another version
  std::vector<std::vector<std::uint8_t>> all{world_bytes};
  for (std::uint8_t i = 0; i < 250; ++i)
    for (std::uint8_t j = 0; j < 2; ++j) all.push_back({i, j, 3});
  ASSERT_TRUE(is_world_record(world_bytes));
  for (int round = 0; round < 3; ++round)
    for (std::size_t i = 0; i < all.size(); ++i) {
      const Channel::Header header{
          1, {.name = "tile", .content_hash = digest_of(all[i]), .bytes = all[i]}};
      PeerModel& model = replicas.add("tile" + std::to_string(i));
      static_cast<void>(replicas.assign(model, header.message.content_hash, complaints));
      model.is_tile = true;
      EXPECT_EQ(replicas.take_header(header, complaints), 0U);
    }
  EXPECT_EQ(complaints.size(), all.size());
}

// A tile that nothing is near goes, and comes back with the bodies.
TEST(ReplicaSet, WhoLiedOfAModelIsNotAskedAgainWhenItComesBack) {
  const auto path = test::write_model(test::bake_named("sphere"));
  const ModelFile file = ModelFile::open(path->path()).value();
  const Channel::Header header{7,
                               {wire::kWireVersion,
                                "tile",
                                file.content_hash(),
                                {file.header_bytes().begin(), file.header_bytes().end()}}};
  ReplicaSet replicas;
  std::vector<std::string> complaints;
  const auto come = [&]() -> PeerModel& {
    PeerModel& model = replicas.add("tile");
    static_cast<void>(replicas.assign(model, file.content_hash(), complaints));
    EXPECT_GT(replicas.take_header(header, complaints), 0U);
    return model;
  };
  come().replica->distrust(7);
  for (int i = 0; i < 2; ++i) {
    replicas.remove("tile");
    PeerModel& again = come();
    EXPECT_TRUE(again.replica->distrusts(7));
    EXPECT_FALSE(again.replica->distrusts(8));
    const std::uint32_t era = again.era;
    replicas.note_given_up();
    EXPECT_EQ(again.era, era) << "nothing was given up";
  }
  EXPECT_TRUE(complaints.empty());
}

}  // namespace
}  // namespace nearmesh::subscriber
