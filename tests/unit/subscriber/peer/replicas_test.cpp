// SPDX-License-Identifier: Apache-2.0
// Which headers a peer keeps for models that nobody uses yet.

#include "subscriber/peer/replicas.hpp"

#include <gtest/gtest.h>

namespace nearmesh::subscriber {
namespace {

wire::MeshHeader header_of(std::uint64_t number, std::size_t bytes) {
  return {wire::kWireVersion,
          "model" + std::to_string(number),
          {0, number},
          std::vector<std::uint8_t>(bytes)};
}

/// Whether a header was kept: it is no header really, so using it is complained about.
bool is_kept(ReplicaSet& replicas, std::uint64_t number) {
  const std::string name = "model" + std::to_string(number);
  replicas.add(name);
  wire::Hello hello;
  hello.models.push_back({name, {0, number}, 0});
  std::vector<std::string> complaints;
  EXPECT_EQ(replicas.announce_new(hello, complaints), 0U);
  return !complaints.empty();
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
  // Of a model in use, whose announcement has not come, always.
  replicas.add("model30");
  static_cast<void>(replicas.take_header(header_of(31, kMiB), complaints));  // fills the free place
  static_cast<void>(replicas.take_header(header_of(30, kMiB), complaints));
  EXPECT_TRUE(is_kept(replicas, 30));
}

TEST(ReplicaSet, AnnouncesAnewOnlyWhatIsNotKnown) {
  ReplicaSet replicas;
  std::vector<std::string> complaints;
  replicas.add("model1");
  wire::Hello hello;
  hello.models.push_back({"model1", {0, 1}, 0});
  static_cast<void>(replicas.announce(hello, complaints));
  hello.models[0].content_hash = {0, 2};  // of another publisher, announced before
  static_cast<void>(replicas.announce_new(hello, complaints));
  EXPECT_EQ(replicas.find("model1")->content_hash, (ContentHash{0, 1}));
  EXPECT_TRUE(complaints.empty());
}

}  // namespace
}  // namespace nearmesh::subscriber
