// SPDX-License-Identifier: Apache-2.0
#pragma once
// How much may be under way to one peer: as much as keeps the narrowest link of the path busy, and
// little more. What waits in front of that link cannot be overtaken by what is needed more, and
// what overflows there is lost; so it waits here. Knows nothing but when batches were sent and
// acknowledged, hence works on any transport and any participant.
//
// window = rate x (least round trip + allowed queue). The rate is the greatest at which batches
// were delivered of late; as the allowed queue keeps the link busy, a link that became faster shows
// as a greater rate, and one that became slower lowers the greatest within two periods. Losses
// alone do not shrink the window: repairs delay, but deliver. Source: Cardwell et al., BBR:
// Congestion-Based Congestion Control, ACM Queue 14 (2016): delivery-rate samples, those limited by
// the sender marked, greatest rate and least round trip. Instead of phases of probing there is a
// small standing queue: an answer ends within seconds, and the pause to the next request drains it.

#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>

namespace nearmesh::publisher {

struct PacingOptions {
  /// Before anything is known: ten full batches, as TCP begins (RFC 6928). Most first answers are
  /// less, so that they come in one round trip; a link of 0.25 Mbit/s takes 0.45 s for as much.
  std::size_t initial_window_bytes = 14'000;
  std::size_t least_window_bytes = 2800;  ///< two full batches, so that a link is not idle between
  double allowed_queue_s = 0.05;          ///< or half the round trip, where that is longer
  double timeout_s = 1;                   ///< a batch unacknowledged for so long stops counting
};

/// Cost: constant a batch; memory: the batches under way. Seconds are of any steady clock. Threads:
/// one at a time.
class Pacing {
 public:
  explicit Pacing(const PacingOptions& options) : options_(options) {}

  /// What the peer is ready to take; 0 at first. A window is never larger.
  void limit(std::size_t window_bytes) { limit_bytes_ = window_bytes; }
  /// One batch may always be under way, so that a tiny limit cannot stall a peer for good.
  [[nodiscard]] bool may_send(std::size_t bytes) const;
  /// Sequences ascend.
  void sent(std::uint32_t sequence, std::size_t bytes, double now_s);
  /// Nothing more waits to be sent, though the window has room: how fast that comes says little
  /// about the link.
  void ran_dry();
  /// All up to this one have come.
  void acknowledged(std::uint32_t sequence, double now_s);
  /// Gives up waiting for what is overdue. The window is the least until something comes through
  /// again.
  void expire(double now_s);

  [[nodiscard]] std::size_t window_bytes() const;
  [[nodiscard]] std::size_t under_way_bytes() const { return under_way_bytes_; }
  [[nodiscard]] double rate_bytes_per_s() const {
    return rate_.front() > rate_.back() ? rate_.front() : rate_.back();
  }

 private:
  struct Sent {
    std::uint32_t sequence = 0;
    std::size_t bytes = 0;
    double sent_s = 0;
    // As they were when it was sent.
    std::uint64_t delivered_bytes = 0;
    double delivered_s = 0, first_sent_s = 0;
    bool dry = false;
  };
  void sample(const Sent& batch, double now_s);

  const PacingOptions options_;
  std::size_t limit_bytes_ = 0;
  std::deque<Sent> under_way_;
  std::size_t under_way_bytes_ = 0;
  std::uint64_t delivered_bytes_ = 0, dry_until_bytes_ = 0;
  double delivered_s_ = 0, first_sent_s_ = 0;
  bool knows_link_ = false;  ///< the rate was limited by the link, once
  bool stalled_ = false;
  // The greatest and the least of this period and of the one before.
  std::array<double, 2> rate_{}, trip_s_{};
  double rate_since_s_ = 0, trip_since_s_ = 0;
};

}  // namespace nearmesh::publisher
