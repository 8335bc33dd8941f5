// SPDX-License-Identifier: Apache-2.0
#include "publisher/serve/pacing.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <optional>

#include "core/base/random.hpp"

namespace nearmesh {
namespace {

using publisher::Pacing;
using publisher::PacingOptions;

constexpr std::size_t kBatch = 1384;

// A link with a rate, a delay each way and an endless queue, in simulated time. What is lost
// arrives after a repair, and holds up what follows, as a reliable stream has it.
class Path {
 public:
  Path(double rate_bytes_per_s, double one_way_s, double loss = 0)
      : rate(rate_bytes_per_s), one_way_s_(one_way_s), loss_(loss) {
    pacing.limit(1 << 20);
  }

  double rate;
  double tokens_bytes = 0;  ///< what a shaper lets through at once after a pause
  Pacing pacing{PacingOptions{}};
  double now_s = 100;
  std::uint64_t delivered_bytes = 0;
  double longest_queue_s = 0;

  /// Sends as much as the window allows, for so long; at most `most` batches.
  void run(double seconds, std::uint64_t most = 1u << 30) {
    const double end_s = now_s + seconds;
    for (constexpr double kStep_s = 0.0005; now_s < end_s; now_s += kStep_s) {
      while (!acks_.empty() && acks_.front().due_s <= now_s) {
        pacing.acknowledged(acks_.front().sequence, now_s);
        acks_.pop_front();
      }
      pacing.expire(now_s);
      for (; most > 0 && pacing.may_send(kBatch); --most) send();
      if (most == 0) pacing.ran_dry();
    }
  }

 private:
  struct Ack {
    double due_s;
    std::uint32_t sequence;
  };
  void send() {
    pacing.sent(++sequence_, kBatch, now_s);
    free_s_ = std::max(free_s_, now_s - tokens_bytes / rate) + static_cast<double>(kBatch) / rate;
    longest_queue_s = std::max(longest_queue_s, free_s_ - now_s);
    double arrives_s = std::max(free_s_, now_s) + one_way_s_;
    if (random_.unit() < loss_) arrives_s += 0.1 + 2 * one_way_s_;
    in_order_s_ = std::max(in_order_s_, arrives_s);
    acks_.push_back({in_order_s_ + one_way_s_, sequence_});
    delivered_bytes += kBatch;
  }

  const double one_way_s_, loss_;
  Random random_{7};
  std::uint32_t sequence_ = 0;
  double free_s_ = 0, in_order_s_ = 0;
  std::deque<Ack> acks_;
};

double rate_over(Path& path, double seconds) {
  const std::uint64_t before = path.delivered_bytes;
  path.run(seconds);
  return static_cast<double>(path.delivered_bytes - before) / seconds;
}

TEST(Pacing, FillsTheLinkWithAShortQueue) {
  for (const double mbit : {0.25, 1.0, 10.0, 40.0})
    for (const double one_way_s : {0.0005, 0.02, 0.1}) {
      Path path(mbit * 125e3, one_way_s);
      path.run(5);
      path.longest_queue_s = 0;
      const double share = rate_over(path, 3) / path.rate;
      EXPECT_GT(share, 0.9) << mbit << " Mbit/s, " << one_way_s << " s one way";
      EXPECT_LT(path.longest_queue_s, std::max(0.12, 1.6 * one_way_s))
          << mbit << " Mbit/s, " << one_way_s << " s one way";
    }
}

TEST(Pacing, StartsWithAShortQueueOnAThinLink) {
  Path path(31250, 0.005);
  path.run(2);
  EXPECT_LT(path.longest_queue_s, 0.46);  // the initial window
}

TEST(Pacing, TokensOfAShaperDoNotLookLikeAFastLink) {
  Path path(125e3, 0.0005);
  path.tokens_bytes = 3000;
  for (int i = 0; i < 20; ++i) path.run(0.2, 1);
  path.longest_queue_s = 0;
  path.run(1);
  EXPECT_LT(path.longest_queue_s, 0.15);
}

TEST(Pacing, FollowsALinkThatBecomesSlowerOrFaster) {
  Path path(1.25e6, 0.01);
  path.run(2);
  path.rate = 125e3;
  path.run(5);
  path.longest_queue_s = 0;
  EXPECT_NEAR(rate_over(path, 2) / path.rate, 1, 0.1);
  EXPECT_LT(path.longest_queue_s, 0.15);
  path.rate = 1.25e6;
  path.run(5);
  EXPECT_GT(rate_over(path, 2) / path.rate, 0.9);
}

TEST(Pacing, LossesDelayButNeitherStarveNorOpenTheWindow) {
  for (const double mbit : {0.25, 1.0, 10.0})
    for (const double loss : {0.01, 0.05, 0.1}) {
      Path path(mbit * 125e3, 0.002, loss);
      path.run(3);
      path.longest_queue_s = 0;
      EXPECT_GT(rate_over(path, 10) / path.rate, 0.3) << mbit << " Mbit/s, loss " << loss;
      EXPECT_LT(path.longest_queue_s, 0.2) << mbit << " Mbit/s, loss " << loss;
    }
}

TEST(Pacing, LittleToSayDoesNotLookLikeASlowLink) {
  Path path(1.25e6, 0.1);
  for (int i = 0; i < 50; ++i) path.run(0.3, 1);
  EXPECT_GE(path.pacing.window_bytes(), PacingOptions{}.initial_window_bytes);
  Path known(1.25e6, 0.02);
  known.run(3);
  const std::size_t window = known.pacing.window_bytes();
  for (int i = 0; i < 50; ++i) known.run(0.1, 1);
  EXPECT_EQ(known.pacing.window_bytes(), window);
}

TEST(Pacing, TricklesWhileNothingComesThrough) {
  Pacing pacing{PacingOptions{}};
  pacing.limit(1 << 20);
  std::uint32_t sequence = 0;
  for (double now_s = 0; now_s < 10; now_s += 0.01) {
    pacing.expire(now_s);
    while (pacing.may_send(kBatch)) pacing.sent(++sequence, kBatch, now_s);
  }
  // The initial window, then the least one a second.
  EXPECT_GE(sequence, 10U);
  EXPECT_LE(sequence, 10U + 2 * 10);
  EXPECT_LE(pacing.under_way_bytes(), PacingOptions{}.least_window_bytes);
}

TEST(Pacing, KeepsWithinWhatThePeerTakes) {
  Path path(5e6, 0.001);
  path.pacing.limit(4000);
  for (int i = 0; i < 100; ++i) {
    path.run(0.01);
    EXPECT_LE(path.pacing.under_way_bytes(), 4000U);
  }
  path.pacing.limit(1);
  path.run(0.1);
  EXPECT_EQ(path.pacing.under_way_bytes(), kBatch);
}

}  // namespace
}  // namespace nearmesh
