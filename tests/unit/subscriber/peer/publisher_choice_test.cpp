// SPDX-License-Identifier: Apache-2.0
#include "subscriber/peer/publisher_choice.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <vector>

#include "core/base/random.hpp"

namespace nearmesh::subscriber {
namespace {

constexpr std::size_t kPublishers = 3, kPeers = 12;
using Publishers = std::array<wire::SessionId, kPublishers>;

std::size_t favourite(wire::SessionId peer, const Publishers& publishers) {
  const auto best = std::max_element(publishers.begin(), publishers.end(),
                                     [&](wire::SessionId a, wire::SessionId b) {
                                       return preference(peer, a) < preference(peer, b);
                                     });
  return static_cast<std::size_t>(best - publishers.begin());
}

TEST(PublisherChoice, SpreadsPeersEvenly) {
  for (const bool in_sequence : {false, true}) {
    Random random(7);
    std::vector<std::size_t> largest;
    std::array<std::size_t, kPublishers> sums{};
    for (int draw = 0; draw < 1000; ++draw) {
      std::uint64_t next = random.next();
      const auto id = [&] { return in_sequence ? ++next : random.next(); };
      Publishers publishers{};
      for (wire::SessionId& publisher : publishers) publisher = id();
      std::array<std::size_t, kPublishers> load{};
      for (std::size_t peer = 0; peer < kPeers; ++peer) ++load[favourite(id(), publishers)];
      for (std::size_t i = 0; i < kPublishers; ++i) sums[i] += load[i];
      largest.push_back(*std::max_element(load.begin(), load.end()));
    }
    std::sort(largest.begin(), largest.end());
    std::printf("largest of three loads, ids %s: median %zu, 99th percentile %zu, worst %zu\n",
                in_sequence ? "in sequence" : "drawn", largest[500], largest[989], largest.back());
    for (const std::size_t sum : sums) EXPECT_NEAR(static_cast<double>(sum) / 1000, 4, 0.2);
    // As of twelve fair throws of a die with three sides: 99 % have at most 9 of one kind.
    EXPECT_LE(largest[989], 9U);
  }
}

TEST(PublisherChoice, PublisherThatGoesMovesItsOwnPeersAlone) {
  Random random(8);
  for (int draw = 0; draw < 1000; ++draw) {
    const Publishers publishers{random.next(), random.next(), random.next()};
    const wire::SessionId peer = random.next();
    const std::size_t first = favourite(peer, publishers);
    Publishers fewer = publishers;
    fewer[(first + 1) % kPublishers] = fewer[first];  // one of the others is gone
    EXPECT_EQ(fewer[favourite(peer, fewer)], publishers[first]);
  }
}

// Peers of a hundred versions must agree with themselves, not with each other; but a figure in a
// log should mean something later.
TEST(PublisherChoice, IsTheSameEverywhere) {
  EXPECT_EQ(preference(0xb1, 0xa1), 11248885029692542633U);
}

}  // namespace
}  // namespace nearmesh::subscriber
