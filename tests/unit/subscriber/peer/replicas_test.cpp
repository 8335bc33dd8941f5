// SPDX-License-Identifier: Apache-2.0
// Which headers a peer keeps for models that nobody uses yet.

#include "subscriber/peer/replicas.hpp"

#include <gtest/gtest.h>

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

// Weeks bring many contents that nobody serves any more: those that are there now shall find room, and the others stay as long as there is some.
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

}  // namespace
}  // namespace nearmesh::subscriber
