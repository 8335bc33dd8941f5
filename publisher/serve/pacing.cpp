// SPDX-License-Identifier: Apache-2.0
#include "pacing.hpp"

#include <algorithm>

namespace nearmesh::publisher {
namespace {

/// Longer than a loss and its repair, so that one window that went smoothly is remembered.
constexpr double kRatePeriod_s = 1;
constexpr double kTripPeriod_s = 10;
/// A shaper lets the first few datagrams after a pause through at once: what came in less time says
/// nothing of the rate.
constexpr double kLeastInterval_s = 0.02;

}  // namespace

bool Pacing::may_send(std::size_t bytes) const {
  return under_way_.empty() || under_way_bytes_ + bytes <= window_bytes();
}

void Pacing::sent(std::uint32_t sequence, std::size_t bytes, double now_s) {
  if (under_way_.empty()) first_sent_s_ = delivered_s_ = now_s;
  under_way_.push_back({sequence, bytes, now_s, delivered_bytes_, delivered_s_, first_sent_s_,
                        dry_until_bytes_ > delivered_bytes_});
  under_way_bytes_ += bytes;
}

void Pacing::ran_dry() {
  dry_until_bytes_ = delivered_bytes_ + under_way_bytes_;
  for (Sent& batch : under_way_) batch.dry = true;
}

void Pacing::acknowledged(std::uint32_t sequence, double now_s) {
  if (under_way_.empty() || under_way_.front().sequence > sequence) return;
  Sent last;
  while (!under_way_.empty() && under_way_.front().sequence <= sequence) {
    last = under_way_.front();
    under_way_.pop_front();
    under_way_bytes_ -= last.bytes;
    delivered_bytes_ += last.bytes;
  }
  delivered_s_ = now_s;
  first_sent_s_ = last.sent_s;
  stalled_ = false;
  sample(last, now_s);
}

void Pacing::sample(const Sent& batch, double now_s) {
  const double trip_s = now_s - batch.sent_s;
  if (trip_s_[1] == 0 || now_s - trip_since_s_ > kTripPeriod_s) {
    trip_s_ = {trip_s_[1] == 0 ? trip_s : trip_s_[1], trip_s};
    trip_since_s_ = now_s;
  }
  trip_s_[1] = std::min(trip_s_[1], trip_s);

  // The slower of sending and arriving: acknowledgements that come bunched must not look like a
  // fast link.
  const double interval_s =
      std::max({now_s - batch.delivered_s, batch.sent_s - batch.first_sent_s, kLeastInterval_s});
  const double rate = static_cast<double>(delivered_bytes_ - batch.delivered_bytes) / interval_s;
  if (batch.dry && rate <= rate_bytes_per_s()) return;
  knows_link_ = knows_link_ || !batch.dry;
  if (now_s - rate_since_s_ > kRatePeriod_s) {
    rate_ = {rate_[1], rate};
    rate_since_s_ = now_s;
  }
  rate_[1] = std::max(rate_[1], rate);
}

void Pacing::expire(double now_s) {
  while (!under_way_.empty() && now_s - under_way_.front().sent_s > options_.timeout_s) {
    under_way_bytes_ -= under_way_.front().bytes;
    under_way_.pop_front();
    stalled_ = true;
  }
}

std::size_t Pacing::window_bytes() const {
  double window = static_cast<double>(options_.initial_window_bytes);
  if (const double rate = rate_bytes_per_s(); rate > 0) {
    const double trip_s = std::min(trip_s_.front(), trip_s_.back());
    const double fitting = rate * (trip_s + std::max(options_.allowed_queue_s, trip_s / 2));
    // A sender with little to say has not learnt that the link is slow.
    window = knows_link_ ? std::max(fitting, static_cast<double>(options_.least_window_bytes))
                         : std::max(fitting, window);
  }
  if (stalled_) window = static_cast<double>(options_.least_window_bytes);
  return static_cast<std::size_t>(std::min(window, static_cast<double>(limit_bytes_)));
}

}  // namespace nearmesh::publisher
